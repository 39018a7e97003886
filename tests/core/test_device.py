"""The one device rule, on machines that are made up: which GPU is meant, and what is said where there is none."""

import logging
import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from fake_devices import PART, UUIDS, Machine, cards_shown

import warpcam as wc
from warpcam.core import device as device_rule


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Sets the variable and puts the rule on such a machine."""

    def put(setting: str | None, **more: Any) -> None:
        if setting is None:
            monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
        else:
            monkeypatch.setenv("CUDA_VISIBLE_DEVICES", setting)
        there = Machine(setting, **more)
        monkeypatch.setattr(device_rule, "wp", there)
        monkeypatch.setattr(device_rule, "driver_installed", lambda: there.driver is not None)

    return put


# CUDA_VISIBLE_DEVICES, and what is said of it.
SETTINGS: dict[str | None, str] = {
    None: "CUDA_VISIBLE_DEVICES is not set: all GPUs that CUDA finds are visible",
    "": "CUDA_VISIBLE_DEVICES='': every GPU is hidden",
    "  ": "CUDA_VISIBLE_DEVICES='  ': every GPU is hidden",
    "2": "CUDA_VISIBLE_DEVICES='2': cuda:0 is GPU 2",
    "2,3": "CUDA_VISIBLE_DEVICES='2,3': cuda:0 is GPU 2, cuda:1 is GPU 3",
    "3,0": "CUDA_VISIBLE_DEVICES='3,0': cuda:0 is GPU 3, cuda:1 is GPU 0",
    " 2": "CUDA_VISIBLE_DEVICES=' 2': cuda:0 is GPU 2",
    "2 , 3 ": "CUDA_VISIBLE_DEVICES='2 , 3 ': cuda:0 is GPU 2, cuda:1 is GPU 3",
    UUIDS[1]: f"CUDA_VISIBLE_DEVICES='{UUIDS[1]}': cuda:0 is {UUIDS[1]}",
    f"{UUIDS[3]},1": f"CUDA_VISIBLE_DEVICES='{UUIDS[3]},1': cuda:0 is {UUIDS[3]}, cuda:1 is GPU 1",
    PART: f"CUDA_VISIBLE_DEVICES='{PART}': cuda:0 is {PART}",
    "1,7,2": "CUDA_VISIBLE_DEVICES='1,7,2': it names 3, and CUDA shows 1: it stops at the first that it does not find",
    "7": "CUDA_VISIBLE_DEVICES='7': it names 1, and CUDA shows 0: it stops at the first that it does not find",
    "-1": "CUDA_VISIBLE_DEVICES='-1': it names 1, and CUDA shows 0: it stops at the first",
    "1,1": "CUDA_VISIBLE_DEVICES='1,1': it names 2, and CUDA shows 0: it stops at the first that it does not find, "
    "shows none if one comes twice",
    "GPU-nowhere": "CUDA_VISIBLE_DEVICES='GPU-nowhere': it names 1, and CUDA shows 0",
}


@pytest.mark.parametrize("setting", SETTINGS, ids=repr)
def test_ordinals_are_those_that_are_visible(setting: str | None, machine: Callable[..., None]) -> None:
    machine(setting)
    cards = cards_shown(setting)
    for ordinal, card in enumerate(cards):
        for name in (ordinal, f"cuda:{ordinal}", np.int64(ordinal), torch.device("cuda", ordinal)):
            assert device_rule.resolve(name).card == card, name
    for name in ("cpu", torch.device("cpu")):
        assert device_rule.resolve(name).alias == "cpu"
    assert device_rule.resolve().alias == (f"cuda:{len(cards) - 1}" if cards else "cpu")
    if cards:
        assert device_rule.resolve("cuda").card == device_rule.resolve(torch.device("cuda")).card == cards[0]


@pytest.mark.parametrize("setting", SETTINGS, ids=repr)
def test_what_is_not_there_is_told_with_what_is(setting: str | None, machine: Callable[..., None]) -> None:
    machine(setting)
    cards = cards_shown(setting)
    visible = ", ".join(["cpu", *(f"cuda:{ordinal}" for ordinal in range(len(cards)))])
    missing: list[Any] = [len(cards), -1, f"cuda:{len(cards)}", "cuda:99", torch.device("cuda", len(cards))]
    strange = ["gpu", "cuda:", "cuda:00", " cuda:0", "0", "CPU", "", 0.0, True, torch.device("meta"), [0]]
    for name in missing + strange + ([] if cards else ["cuda", torch.device("cuda")]):
        with pytest.raises(wc.WarpcamError) as caught:
            device_rule.resolve(name)
        said = f"device: {name!r} came, this process sees {visible}; {SETTINGS[setting]}"
        assert str(caught.value).startswith(said)


@pytest.mark.parametrize("setting", [each for each in SETTINGS if each is not None], ids=repr)
def test_the_card_that_is_named_is_the_one_behind_the_ordinal(setting: str, machine: Callable[..., None]) -> None:
    machine(setting)
    told = dict(re.findall(r"cuda:(\d+) is (?:GPU )?([\w-]+)", device_rule.ordinals()))
    for ordinal, name in told.items():
        card = 3 if name == PART else UUIDS.index(name) if name in UUIDS else int(name)
        assert device_rule.resolve(int(ordinal)).card == card


def test_a_machine_without_a_driver(machine: Callable[..., None]) -> None:
    machine(None, driver=None)
    with pytest.raises(wc.WarpcamError, match=r"'cuda' came, this process sees cpu; there is no CUDA driver$"):
        device_rule.resolve("cuda")
    machine("2", driver=None)
    with pytest.raises(wc.WarpcamError, match=re.escape("there is no CUDA driver (CUDA_VISIBLE_DEVICES='2')")):
        device_rule.resolve(0)


def test_a_device_of_this_machine_by_any_name() -> None:
    for name in ("cpu", torch.device("cpu"), wp.get_device("cpu")):
        assert device_rule.resolve(name) == wp.get_device("cpu")
    assert device_rule.resolve() == wp.get_device()
    with pytest.raises(wc.WarpcamError, match=re.escape("device: 'cuda:99' came, this process sees cpu")):
        device_rule.resolve("cuda:99")


@pytest.mark.skipif(wp.get_cuda_device_count() > 0, reason="there is a GPU")
def test_nothing_else_is_printed_where_there_is_no_gpu(capfd: pytest.CaptureFixture[str]) -> None:
    capfd.readouterr()
    for name in ("cuda", torch.device("cuda")):
        with pytest.raises(wc.WarpcamError, match=r"'cuda'.* came, this process sees cpu"):
            device_rule.resolve(name)
    assert capfd.readouterr() == ("", "")


def test_devices_that_differ_are_both_named() -> None:
    with pytest.raises(wc.WarpcamError, match="device: m is on cuda:1, but d is on cpu; both must be on one"):
        device_rule.require_same(wp.get_device("cpu"), "d is", SimpleNamespace(alias="cuda:1"), "m")


def test_graphics_variables_are_ignored_and_said_so_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, machine: Callable[..., None]
) -> None:
    machine("2,3")
    monkeypatch.setattr(device_rule, "_told", set())
    with caplog.at_level(logging.WARNING, "warpcam"):
        device_rule.resolve("cpu")
        assert not caplog.records
        monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "3")
        assert [device_rule.resolve(name).card for name in ("cuda:0", 1, "cuda")] == [2, 3, 2]
        monkeypatch.setenv("EGL_DEVICE_ID", "1")  # set while the program runs
        assert [device_rule.resolve(name).card for name in ("cuda:0", 1, "cuda")] == [2, 3, 2]
    assert [record.getMessage() for record in caplog.records] == [
        "MUJOCO_EGL_DEVICE_ID=3 chooses a GPU for OpenGL; warpcam uses none and ignores it",
        "EGL_DEVICE_ID=1 chooses a GPU for OpenGL; warpcam uses none and ignores it",
    ]
