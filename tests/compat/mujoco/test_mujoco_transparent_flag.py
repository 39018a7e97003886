"""Images with ``mjVIS_TRANSPARENT``, as ``mujoco.Renderer`` shows them."""

import mujoco
import numpy as np
import warp as wp
from mujoco_reference import reference_renderer

from warpcam.compat.mujoco import Renderer

WIDTH, HEIGHT = 96, 72
XML = """
<mujoco>
  <visual>
    <global offwidth="96" offheight="72"/><quality offsamples="0" numslices="120" numstacks="120"/><map alpha=".4"/>
  </visual>
  <asset>
    <texture name="checks" type="2d" builtin="checker" width="32" height="32" rgb1=".9 .2 .1" rgb2=".1 .3 .9"/>
    <material name="checked" texture="checks"/>
    <material name="blue" rgba=".2 .3 .9 .9"/>
  </asset>
  <worldbody>
    <light pos="0 0 3" dir=".2 .1 -1" directional="true" castshadow="false"/>
    <geom type="plane" size="2 2 .1" rgba=".7 .7 .6 1"/>
    <camera name="fixed" pos="0 -2 1.2" xyaxes="1 0 0 0 .5 1"/>
    <body pos="-.6 .8 .3"><geom name="welded" type="box" size=".15 .15 .3" rgba=".2 .7 .3 1"/></body>
    <body pos=".7 .6 .3" mocap="true"><geom name="target" size=".2" rgba=".9 .8 .1 1"/></body>
    <body pos="0 0 .4">
      <joint axis="0 1 0"/>
      <geom name="box" type="box" size=".2 .15 .2" material="checked"/>
      <geom name="ball" size=".15" pos="-.5 0 0" material="blue"/>
      <geom name="own" type="capsule" size=".08 .15" pos=".5 0 0" rgba="1 .3 .3 .6" material="blue"/>
      <site name="tip" pos="0 0 .35" size=".08" rgba="0 0 1 1"/>
    </body>
    <site name="anchor" pos=".6 0 .9" size=".04" rgba="1 0 1 1"/>
    <flexcomp name="cloth" type="grid" dim="2" count="4 3 1" spacing=".15 .15 .15" pos="-.7 -.4 .5" radius=".02"
      material="blue" rigid="true"/>
  </worldbody>
  <tendon><spatial width=".03" rgba="1 .8 0 1"><site site="anchor"/><site site="tip"/></spatial></tendon>
</mujoco>
"""


def made() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.3
    mujoco.mj_forward(model, data)
    return model, data


def option(transparent: bool) -> mujoco.MjvOption:
    chosen = mujoco.MjvOption()
    chosen.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = transparent
    return chosen


def picture(renderer: Renderer, data: mujoco.MjData, transparent: bool = True) -> np.ndarray:
    renderer.update_scene(data, "fixed", option(transparent))
    return renderer.render()


def test_pictures_are_those_of_mujocos_own(device: wp.Device) -> None:
    model, data = made()
    judge = reference_renderer(model, HEIGHT, WIDTH)
    ours = Renderer(model, HEIGHT, WIDTH, device=device)
    with judge:
        plain = picture(judge, data, transparent=False)
        for alpha in (0.4, 0.15):
            model.vis.map.alpha = alpha
            theirs, own = picture(judge, data), picture(ours, data)
            off = np.abs(theirs.astype(int) - own).max(axis=-1) > 24
            assert off.mean() < 0.02, alpha
            assert (np.abs(theirs.astype(int) - plain).max(axis=-1) > 24).mean() > 0.1
        judge.enable_segmentation_rendering()
        ours.enable_segmentation_rendering()
        assert (picture(judge, data) != picture(ours, data)).any(axis=-1).mean() < 0.02


def test_it_follows_the_model_and_is_gone_without_the_flag(device: wp.Device) -> None:
    model, data = made()
    ours = Renderer(model, HEIGHT, WIDTH, device=device)
    plain = picture(ours, data, transparent=False)
    thin = picture(ours, data)
    assert (thin != plain).any(axis=-1).mean() > 0.1
    model.geom_rgba[model.geom("target").id] = (0.1, 0.1, 0.1, 1.0)
    model.vis.headlight.diffuse[:] = 0.2
    changed = picture(ours, data)
    fresh = Renderer(model, HEIGHT, WIDTH, device=device)
    np.testing.assert_array_equal(changed, picture(fresh, data))
    assert (changed != thin).any(axis=-1).mean() > 0.1
    data.qpos[0] = -0.5
    mujoco.mj_forward(model, data)
    assert (picture(ours, data) != changed).any()
    model.vis.map.alpha = 1.0
    np.testing.assert_array_equal(picture(ours, data), picture(ours, data, transparent=False))


def test_what_is_fixed_to_the_world_stays_solid(device: wp.Device) -> None:
    model, data = made()
    model.vis.map.alpha = 0.0  # what moves is gone
    ours = Renderer(model, HEIGHT, WIDTH, device=device)
    ours.enable_segmentation_rendering()
    seen = picture(ours, data)
    geom, site = int(mujoco.mjtObj.mjOBJ_GEOM), int(mujoco.mjtObj.mjOBJ_SITE)
    geoms, sites = (set(seen[seen[..., 1] == kind][:, 0].tolist()) for kind in (geom, site))
    assert geoms == {0, model.geom("welded").id} and sites == {model.site("anchor").id}
    assert not (seen[..., 1] == int(mujoco.mjtObj.mjOBJ_TENDON)).any()
