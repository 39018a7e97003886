"""Changes from frame to frame, or from renderer to renderer, compile nothing and record no graph again."""

from collections.abc import Callable
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import visual_geom_scenes
import warp as wp

import warpcam as wc

MODEL = """
<mujoco>
  <asset><material name="paint" rgba="0 0 1 1" shininess=".4"/></asset>
  <worldbody>
    <light pos="2 1 4" dir="-2 -1 -4" diffuse=".6 .6 .6"/>
    <camera name="top" pos="0 0 5" fovy="60"/>
    <body pos="0 0 1"><freejoint/><geom size=".6" rgba="1 0 0 1"/></body>
    <geom type="box" size="3 3 .1" pos="0 0 -.5" material="paint"/>
  </worldbody>
</mujoco>
"""
OUTPUTS = ("rgb", "depth")
BALL = 1


class Simulation:
    def __init__(self, device: wp.Device):
        self.mjm = mujoco.MjModel.from_xml_string(MODEL)
        mjd = mujoco.MjData(self.mjm)
        mujoco.mj_forward(self.mjm, mjd)
        self.m, self.d = mjw.put_model(self.mjm), mjw.put_data(self.mjm, mjd, nworld=2)
        self.scene = wc.from_mujoco_warp(self.mjm, self.m, self.d)

    def renderer(self, **options: Any) -> wc.Renderer:
        own = {"position": (0.0, 0.0, 5.0), "lens": wc.Pinhole(fovy=60.0)} | options
        cameras = [
            wc.Camera("top", width=16, height=12, outputs=OUTPUTS, shadows=True),
            wc.Camera("mine", width=16, height=12, outputs=OUTPUTS, shadows=True, **own),
        ]
        return wc.Renderer(self.scene, cameras)


def write(array: wp.array, values: Callable[[np.ndarray], Any]) -> None:
    """Change a simulator's array in place."""
    array.assign(np.asarray(values(array.numpy()), np.float32).reshape(array.numpy().shape))


def moved(positions: np.ndarray) -> np.ndarray:
    positions[:, BALL] += (0.7, 0.0, 0.3)
    return positions


# What is changed in place, and the camera and output that show it.
CHANGES: dict[str, tuple[Callable[[Simulation, Any], None], str, str]] = {
    "near": (lambda s, mine: mine.near.fill_(4.0), "mine", "depth"),
    "far": (lambda s, mine: mine.far.fill_(3.0), "mine", "depth"),
    "position": (lambda s, mine: mine.position.add_(0.4), "mine", "depth"),
    "rotation": (lambda s, mine: mine.rotation.copy_(mine.rotation + 0.1), "mine", "depth"),
    "fovy": (lambda s, mine: mine.fovy.fill_(20.0), "mine", "depth"),
    "scene camera": (lambda s, mine: write(s.d.cam_xpos, lambda p: p + 0.4), "top", "depth"),
    "shape": (lambda s, mine: write(s.d.geom_xpos, moved), "top", "depth"),
    "shape color": (lambda s, mine: write(s.m.geom_rgba, lambda c: 0.5 * c + 0.5), "top", "rgb"),
    "material": (lambda s, mine: write(s.m.mat_rgba, lambda c: 1.0 - 0.5 * c), "top", "rgb"),
    "light color": (lambda s, mine: write(s.m.light_diffuse, lambda c: 0.3 * c), "top", "rgb"),
    "light place": (lambda s, mine: write(s.d.light_xpos, lambda p: p + 1.0), "top", "rgb"),
    "light direction": (lambda s, mine: write(s.d.light_xdir, lambda d: d * (1, 1, -1)), "top", "rgb"),
    "light off": (lambda s, mine: s.m.light_active.zero_(), "top", "rgb"),
    "background": (lambda s, mine: mine.background.fill_(0.7), "mine", "rgb"),
    "gain": (lambda s, mine: mine.gain.fill_(0.5), "mine", "rgb"),
}

# What the camera must have been given for there to be an array of it.
MADE_WITH: dict[str, dict[str, Any]] = {"background": {"background": np.zeros((2, 3))}, "gain": {"gain": 1.0}}


@pytest.mark.parametrize("what", CHANGES)
def test_changes_in_place_are_seen_and_cost_nothing(what: str, device: wp.Device, loads: list[str]) -> None:
    simulation = Simulation(device)
    renderer = simulation.renderer(**MADE_WITH.get(what, {}))
    change, camera, output = CHANGES[what]
    before = renderer.render()[camera][output].clone()
    loads.clear()
    (recording,) = renderer._recordings.values()
    graphs = dict(recording.graphs)
    change(simulation, renderer.camera("mine"))
    after = renderer.render()[camera][output]
    assert (before != after).any()
    assert loads == []
    assert list(renderer._recordings.values()) == [recording]
    assert list(recording.graphs) == list(graphs)
    assert all(recording.graphs[key] is graph for key, graph in graphs.items())


@pytest.mark.parametrize(
    "options",
    [
        {"near": 0.1, "far": 8.0},
        {"far": 9.0, "depth_clipping": "max"},
        {"background": (0.2, 0.4, 0.6)},
        {"position": (0.0, -1.0, 4.0), "rotation": (0.9, 0.1, 0.0, 0.0), "parent": 1},
        {"lens": wc.Pinhole(fx=20.0)},
    ],
    ids=lambda options: "+".join(options),
)
def test_other_values_need_no_other_kernels(options: dict[str, Any], device: wp.Device, loads: list[str]) -> None:
    simulation = Simulation(device)
    simulation.renderer().render()
    loads.clear()
    simulation.renderer(**options).render()
    assert loads == []


def test_mazes_with_other_numbers_of_walls_share_kernels(loads: list[str]) -> None:
    """On a CPU, where a program that builds a maze anew for each episode would wait for each number of walls."""
    for walls in (66, 90):
        standing = "".join(f'<geom type="plane" size=".2 .2 .1" pos="{k % 10} {k // 10} 0"/>' for k in range(walls))
        inside = f'<light pos="0 0 3"/><geom size=".3" pos="0 0 1" rgba="1 0 0 .5"/>{standing}'
        mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{inside}</worldbody></mujoco>")
        mjd = mujoco.MjData(mjm)
        mujoco.mj_forward(mjm, mjd)
        scene = wc.from_mujoco(mjm, mjd, device="cpu")
        own = {"position": (0.0, 0.0, 5.0), "lens": wc.Pinhole(fovy=60.0)}
        loads.clear()
        image = wc.Renderer(scene, [wc.Camera("mine", width=16, height=12, shadows=True, **own)]).render()["mine"][
            "rgb"
        ]
        assert image.numpy().std() > 1.0
    assert loads == []


def test_the_loads_are_counted(device: wp.Device, loads: list[str]) -> None:
    """Or the tests above would find none whatever happens: an output nobody asked for yet needs a kernel."""
    scene = Simulation(device).scene
    wc.Renderer(scene, [wc.Camera("top", width=16, height=12, outputs=("albedo", "hdr", "distance"))]).render()
    assert loads


@pytest.mark.parametrize("name", ["sites", "held", "cloth", "skin"])
def test_what_is_compiled_while_trees_are_built_is_launched(name: str, device: wp.Device) -> None:
    mjm, mjd = visual_geom_scenes.bent(name)
    scene = wc.from_mujoco(mjm, mjd, device=device)
    assert {kernel.module for kernel in scene._source.kernels()} == {stage.module for stage in scene.stages()}
