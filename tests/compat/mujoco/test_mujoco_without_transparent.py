"""Depth of what is behind transparent shapes, of a model that changes."""

import mujoco
import numpy as np
import pytest
import warp as wp

from warpcam.compat.mujoco.frame_renderer import FrameRenderer, GlCamera, Style

WORLD = """
<mujoco><worldbody>
  <{kind} name="behind" type="box" size=".5 .5 .5" rgba="1 0 0 1"/>
  <geom type="box" size="3 .05 3" pos="0 -1.5 0" rgba="1 1 1 .3"/>
</worldbody></mujoco>
"""
VIEW = GlCamera(
    np.array((0.0, -4.0, 0.0)), np.array((0.5**0.5, 0.5**0.5, 0, 0)), -0.01, 0.01, -0.01, 0.01, 0.02, 50, False
)


@pytest.mark.parametrize("kind", ["geom", "site"])
def test_types_are_followed_behind_glass(device: wp.Device, kind: str) -> None:
    model = mujoco.MjModel.from_xml_string(WORLD.format(kind=kind))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    studio, depths = FrameRenderer(model, device), []
    for shape in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE):
        getattr(model, f"{kind}_type")[0] = int(shape)
        studio.take(data)
        images = studio.look(VIEW, Style(), 33, 33, ("rgb", "depth"), through=True)
        depths.append(images["depth"][16, 12, 0])
    np.testing.assert_allclose(depths[0], 3.5, atol=1e-3)
    assert depths[1] > 3.55
