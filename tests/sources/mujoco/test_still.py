"""Still worlds of the command line: as those of one MjData each, posed once."""

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc
from warpcam.sources.mujoco import batch_file, still

# A tendon, a site and a soft body move with the joints, too.
MODEL = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/><camera name="front" pos="0 -2 1" xyaxes="1 0 0 0 0.4 1"/>
    <geom type="plane" size="1 1 .1"/><site name="hook" pos="0 0 1" size=".05"/>
    <body pos="0 0 .5">
      <joint name="turn" axis="0 1 0" range="-60 60" limited="true"/>
      <geom type="box" size=".2 .1 .1"/><site name="end" pos=".2 0 0" size=".05"/>
      <camera name="riding" pos="0 -1 0" xyaxes="1 0 0 0 0 1"/>
    </body>
    <flexcomp name="cloth" type="grid" count="3 3 1" spacing=".2 .2 .2" pos="-.5 0 .6" dim="2" radius=".01"/>
  </worldbody>
  <tendon><spatial width=".02"><site site="hook"/><site site="end"/></spatial></tendon>
</mujoco>
"""
OUTPUTS = ("depth", "segmentation", "rgb")
CAMERAS = [wc.Camera(name, width=24, height=16, outputs=OUTPUTS) for name in ("front", "riding")]


def worlds() -> tuple[mujoco.MjModel, np.ndarray]:
    mjm = mujoco.MjModel.from_xml_string(MODEL)
    return mjm, batch_file.joint_positions(mjm, mjm.qpos0, num_worlds=3, seed=1)


def expected(mjm: mujoco.MjModel, positions: np.ndarray, device: wp.Device) -> dict[str, dict[str, torch.Tensor]]:
    states = [mujoco.MjData(mjm) for _ in positions]
    for state, position in zip(states, positions, strict=True):
        state.qpos = position
        mujoco.mj_forward(mjm, state)
    return wc.Renderer(wc.from_mujoco(mjm, states, device=device), CAMERAS).render()


def same(images: dict[str, dict[str, torch.Tensor]], others: dict[str, dict[str, torch.Tensor]]) -> bool:
    return all(torch.equal(images[c.name][name], others[c.name][name]) for c in CAMERAS for name in OUTPUTS)


def test_images_are_those_of_worlds_with_states_of_their_own(device: wp.Device) -> None:
    mjm, positions = worlds()
    scene, source = still.load(mjm, mujoco.MjData(mjm), positions.copy(), device)
    renderer = wc.Renderer(scene, CAMERAS)
    first = expected(mjm, positions, device)
    assert same(renderer.render(), first)
    source.positions[:] = moved = batch_file.moved(mjm, positions, seed=7)
    assert same(renderer.render(), first)  # nothing is copied until it is asked for
    second = expected(mjm, moved, device)
    assert same(renderer.render(forward=True), second)
    assert not same(first, second)


def test_worlds_are_posed_once(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    mjm, positions = worlds()
    scene, _ = still.load(mjm, mujoco.MjData(mjm), positions, device)
    posed: list[object] = []
    pose = still.StillSource._pose
    monkeypatch.setattr(still.StillSource, "_pose", lambda self, mjd: (posed.append(mjd), pose(self, mjd)))
    renderer = wc.Renderer(scene, CAMERAS[:1])
    for _ in range(3):
        renderer.render()
    assert len(posed) in (0, len(positions))  # the scene may have asked for arrays before
