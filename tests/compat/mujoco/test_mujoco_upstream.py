"""MuJoCo's own tests of ``mujoco.Renderer``, as they came with it, of ``warpcam.compat.mujoco.Renderer``."""

import inspect
from typing import Any

import mujoco
import pytest
import warp as wp

from warpcam.compat.mujoco import Renderer

theirs = pytest.importorskip("mujoco.renderer_test", reason="this MuJoCo has no tests in it, or absl-py is missing")


def names() -> list[str]:
    """Return the names of those that make a renderer, and do nothing with OpenGL besides."""
    case = theirs.MuJoCoRendererTest
    sources = {name: inspect.getsource(getattr(case, name)) for name in dir(case) if name.startswith("test")}
    return [name for name, text in sources.items() if "mujoco.Renderer(" in text and "mujoco.GLContext" not in text]


def test_there_are_some() -> None:
    assert len(names()) >= 8


@pytest.mark.parametrize("name", names())
def test_a_case_of_mujocos(device: wp.Device, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Renderer | None] = []

    def ours(*given: Any, **named: Any) -> Renderer:
        made.append(None)
        made[-1] = Renderer(*given, **named, device=device)
        return made[-1]

    monkeypatch.setattr(mujoco, "Renderer", ours)
    getattr(theirs.MuJoCoRendererTest(name), name)()
    assert made
