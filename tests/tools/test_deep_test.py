"""``warpcam doctor --deep``: its checks run on every device, and it sees what is not the CPU's."""

import re
from typing import Any

import numpy as np
import pytest
import warp as wp

from warpcam.tools import cli, deep_test, doctor, self_test

CPU = wp.get_device("cpu")


@pytest.fixture(params=sorted(deep_test.checks()))
def check(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_a_device_makes_what_the_cpu_makes(check: str, device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    only = {check: deep_test.checks()[check]}
    monkeypatch.setattr(deep_test, "checks", lambda: only)
    compared = list(deep_test.compare(device))
    assert compared and all(each.passed for each in compared), compared
    assert device.is_cuda or all(each.different == 0.0 for each in compared)


def test_images_show_what_is_compared(device: wp.Device) -> None:
    images = deep_test.checks()["outputs"](device)
    assert {0, 1, 2} <= set(images["segmentation"].flat)
    assert (np.abs(images["flow"]).max(axis=-1) > 1.0).any()


@pytest.mark.parametrize(
    ("dtype", "within", "beyond"),
    [("uint8", 3, 4), ("int32", 0, 1), ("float32", 1e-4, 1e-3)],
    ids=lambda value: str(value),
)
def test_what_counts_as_different(dtype: str, within: float, beyond: float) -> None:
    judge = np.full((1, 10, 10, 3), 1, dtype)
    for off, share in ((within, 0.0), (beyond, 0.02)):
        image = judge.copy()
        image[0, 3, 4:6, 1] += np.array(off, dtype)
        assert deep_test.different(image, judge) == share
    assert deep_test.different(judge[:, 1:], judge) == 1.0


def test_numbers_that_are_none_are_equal_to_themselves_alone() -> None:
    judge = np.array([np.inf, np.nan, 1.0, np.inf], np.float32)[:, None]
    assert deep_test.different(judge, judge) == 0.0
    assert deep_test.different(np.array([1.0, 1.0, np.nan, -np.inf], np.float32)[:, None], judge) == 1.0


def test_a_gpu_that_renders_something_else_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def compare(devices: Any, said: Any) -> list[self_test.Comparison]:
        return [
            self_test.Comparison("cuda:0", "lidar", "ranges", 0.25, False),
            self_test.Comparison("cuda:0", "outputs", "rgb", 0.001, True),
        ]

    monkeypatch.setattr(doctor, "_compared", compare)
    report = doctor.examine([CPU], deep=True)
    assert "cuda:0: lidar, ranges: 25.0% of the pixels are not the CPU's" in report.problems
    console = doctor.Console(width=200)
    with console.capture() as capture:
        console.print(doctor.screen_of(report))
    assert re.search(r"cuda:0 +lidar +ranges +FAILED +25.00% of the pixels differ", capture.get())
    assert re.search(r"cuda:0 +outputs +rgb +passed +0.10% of the pixels differ", capture.get())


@pytest.mark.skipif(wp.is_cuda_available(), reason="there is a GPU to compare with")
def test_without_a_gpu_it_is_said_that_there_is_nothing_to_compare(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "--deep"]) == 0
    assert "--deep compares GPUs with the CPU, and there is none" in capsys.readouterr().out
