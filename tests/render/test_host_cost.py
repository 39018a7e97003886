"""Cost of a frame in Python: a few calls, however many worlds, cameras and outputs there are.

Seconds are not judged here: `warpcam bench --host` measures them.
"""

import sys
from types import FrameType
from typing import Any

import mujoco
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.runtime.launch import FrameGraph
from warpcam.outputs import OUTPUTS

MOST = 100  # calls of Python functions in `render()`, of which thirty microseconds are enough for more
MODEL = """
<light pos="0 0 3"/>
<camera name="a" pos="0 0 3"/><camera name="b" pos="0 0 4"/><camera name="c" pos="0 0 5"/><camera name="d" pos="0 0 6"/>
<body><freejoint/><geom size=".5"/></body>
"""


def renderer_of(num_worlds: int, cameras: str, outputs: tuple[str, ...]) -> wc.Renderer:
    mjm: mujoco.MjModel = scenes.compile_xml(MODEL)
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, num_worlds))
    return wc.Renderer(scene, [wc.Camera(name, width=8, height=8, outputs=outputs) for name in cameras])


def calls_of(renderer: wc.Renderer) -> int:
    """Python functions that a replayed frame calls."""
    count = 0

    def noted(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal count
        count += event == "call"

    renderer.render()
    renderer.render()
    sys.setprofile(noted)
    try:
        renderer.render()
    finally:
        sys.setprofile(None)
    return count


def test_a_frame_runs_little_python(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    if not device.is_cuda:  # where kernels are launched one by one, as there is no graph to replay
        monkeypatch.setattr(FrameGraph, "launch", lambda self, *stream: None)
    few = calls_of(renderer_of(1, "a", ("depth",)))
    assert 0 < few <= MOST
    assert calls_of(renderer_of(300, "abcd", tuple(OUTPUTS))) <= few + 3  # flow's own
