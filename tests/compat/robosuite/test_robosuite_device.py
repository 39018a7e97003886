"""On which device robosuite's images are drawn, and that nothing of OpenGL is loaded for them."""

import os
import subprocess
import sys
import textwrap
from typing import Any

import fast_compile
import pytest
import warp as wp
from fake_devices import PART, UUIDS, Machine

import warpcam as wc
from warpcam.compat.robosuite import renderer as ours

pytest.importorskip(
    "robosuite", reason="robosuite needs an environment of its own: see 'robosuite' in .ci/run", exc_type=ImportError
)
pytestmark = pytest.mark.filterwarnings("ignore")  # robosuite and what it imports warn of their own use


def set_variables(monkeypatch: pytest.MonkeyPatch, visible: str | None, egl: str | None) -> None:
    """None: is not set."""
    for name, value in (("CUDA_VISIBLE_DEVICES", visible), ("MUJOCO_EGL_DEVICE_ID", egl)):
        if value is None:
            monkeypatch.delenv(name, raising=False)
        else:
            monkeypatch.setenv(name, value)


class Fake:
    """A Warp device that is not there."""

    def __init__(self, alias: str):
        self.alias = alias


def resolved(device: Any) -> Fake:
    """On a machine with two visible GPUs."""
    names = {None: "cuda:0", "cuda:1": "cuda:1", "cuda:0": "cuda:0", "cpu": "cpu", 0: "cuda:0", 1: "cuda:1"}
    if device not in names:
        raise wc.WarpcamError(f"device: {device!r} came, this process sees cpu, cuda:0, cuda:1")
    return FAKES[names[device]]


FAKES = {alias: Fake(alias) for alias in ("cpu", "cuda:0", "cuda:1")}


@pytest.mark.parametrize("visible", [None, "", "2", "2,3", "GPU-8"])
@pytest.mark.parametrize("egl", [None, "0", "2"])
@pytest.mark.parametrize(
    ("given", "asked", "expected"),
    [
        (None, -1, "cuda:0"),
        (None, None, "cuda:0"),
        (None, 0, "cuda:0"),
        (None, 1, "cuda:1"),
        (None, 3, "device: 3 came, this process sees cpu, cuda:0, cuda:1"),
        ("cuda:1", -1, "cuda:1"),
        ("cuda:1", 1, "cuda:1"),
        ("cuda:1", 0, "render_gpu_device_id is 0, which is cuda:0, but install was given cuda:1"),
        ("cpu", -1, "cpu"),
        ("cpu", 0, "render_gpu_device_id is 0, which is cuda:0, but install was given cpu"),
    ],
)
def test_one_answer_to_where(
    monkeypatch: pytest.MonkeyPatch, visible: str | None, egl: str | None, given: Any, asked: int, expected: str
) -> None:
    """One rule answers what robosuite asks of three places; variables of OpenGL change nothing."""
    set_variables(monkeypatch, visible, egl)
    monkeypatch.setattr(ours.device_rule, "resolve", resolved)
    monkeypatch.setattr(ours, "_chosen", [given])
    if expected.startswith(("cuda", "cpu")):
        assert ours._device(asked).alias == expected
    else:
        with pytest.raises(wc.WarpcamError, match=expected):
            ours._device(asked)


@pytest.mark.parametrize("egl", [None, "0", "3"])
@pytest.mark.parametrize(
    ("visible", "asked", "card"),
    [
        (None, 0, 0),
        (None, 1, 1),
        (None, 7, "device: 7 came, this process sees cpu, cuda:0, cuda:1, cuda:2, cuda:3"),
        ("2", -1, 2),
        ("2", 0, 2),
        (" 2", 0, 2),
        ("2", 3, "device: 3 came, this process sees cpu, cuda:0; CUDA_VISIBLE_DEVICES='2': cuda:0 is GPU 2"),
        ("2,3", 0, 2),
        ("2,3", 1, 3),
        ("", -1, None),
        ("", 0, "device: 0 came, this process sees cpu; CUDA_VISIBLE_DEVICES='': every GPU is hidden"),
        (UUIDS[1], -1, 1),
        (UUIDS[1], 0, 1),
        (PART, -1, 3),
    ],
)
def test_the_card_that_is_meant(
    monkeypatch: pytest.MonkeyPatch, visible: str | None, asked: int, card: Any, egl: str | None
) -> None:
    """The table of the page, on a machine of four cards; a None for the card is the CPU."""
    set_variables(monkeypatch, visible, egl)
    monkeypatch.setattr(ours.device_rule, "wp", Machine(visible))
    monkeypatch.setattr(ours.device_rule, "driver_installed", lambda: True)
    if isinstance(card, str):
        with pytest.raises(wc.WarpcamError, match=card):
            ours._device(asked)
    else:
        assert ours._device(asked).card == card


def test_nothing_of_opengl(tmp_path: Any) -> None:
    """Neither imported nor mapped, whatever the variables say that robosuite stumbles over."""
    code = """
        import os, sys
        from warpcam.compat import robosuite as ours
        ours.install()
        assert os.environ["MUJOCO_EGL_DEVICE_ID"] == "7" and os.environ["MUJOCO_GL"] == "disable"
        import robosuite
        env = robosuite.make("Lift", robots="Panda", has_renderer=False, has_offscreen_renderer=True,
                             use_camera_obs=True, camera_heights=32, camera_widths=32)
        assert env.reset()["agentview_image"].std() > 5.0
        loaded = open("/proc/self/maps").read().lower()
        for library in ("libgl.", "libegl", "libopengl", "libosmesa", "libvulkan", "libglx"):
            assert library not in loaded, library
        assert not [name for name in sys.modules if name.split(".")[0] == "OpenGL"]
        print("nothing")
    """
    variables = {"MUJOCO_GL": "disable", "MUJOCO_EGL_DEVICE_ID": "7", "CUDA_VISIBLE_DEVICES": "0"}
    done = subprocess.run(
        [sys.executable, fast_compile.__file__, "-c", textwrap.dedent(code)], cwd=tmp_path,
        env={**os.environ, **variables}, check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout.endswith("nothing\n"), done.stderr[-2000:]
    assert done.stderr.count("MUJOCO_EGL_DEVICE_ID=7 chooses a GPU for OpenGL; warpcam uses none and ignores it") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere robosuite has no EGL to import")
@pytest.mark.parametrize(
    ("there", "variable", "seen"),
    [(None, "disable", "glx"), (None, "osmesa", "osmesa"), ("libEGL.so.1", "disable", "disable")],
)
def test_robosuite_1_4_is_imported_without_egl(
    monkeypatch: pytest.MonkeyPatch, there: str | None, variable: str, seen: str
) -> None:
    """Without these two, robosuite 1.4 would load EGL whatever ``MUJOCO_GL`` says."""
    monkeypatch.setattr(ours, "find_library", {"EGL": there}.get)
    monkeypatch.setenv("MUJOCO_GL", variable)
    with ours._unguarded():
        assert os.environ["MUJOCO_GL"] == seen
    assert os.environ["MUJOCO_GL"] == variable


def test_modules_that_lack_the_context_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Robosuite 1.4's tester of grippers forgets to import it."""
    from robosuite.environments import base
    from robosuite.models.grippers import gripper_tester

    monkeypatch.delattr(gripper_tester, "MjRenderContextOffscreen")
    ours.install()
    assert base.MjRenderContextOffscreen is ours.OffscreenContext
    assert not hasattr(gripper_tester, "MjRenderContextOffscreen")
    ours.uninstall()
    assert base.MjRenderContextOffscreen is not ours.OffscreenContext


def test_devices_are_checked_when_installing() -> None:
    with pytest.raises(wc.WarpcamError, match=r"device: 'cuda:99' came"):
        ours.install("cuda:99")
    assert wp.get_devices()
