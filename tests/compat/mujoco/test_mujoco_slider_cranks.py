"""Slider-cranks beside ``mujoco.Renderer``."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from mujoco_reference import reference_renderer

import warpcam as wc
from warpcam.compat.mujoco import Renderer

SIZE = 96
XML = """
<mujoco>
  <statistic meansize=".3"/>
  <visual><quality offsamples="0" numslices="100" numstacks="60"/><headlight ambient=".4 .4 .4" specular="0 0 0"/>
    <rgba slidercrank=".2 .7 .3 1" crankbroken=".9 .2 .1 1"/></visual>
  <worldbody>
    <body><joint name="slide" type="slide" axis="1 0 0"/><geom type="box" size=".06 .06 .06"/>
      <site name="slider" zaxis="1 0 0" rgba="0 0 0 0"/></body>
    <body pos="1 0 0"><joint name="turn" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 .4" size=".03"/>
      <site name="pin" pos="0 .1 .4" rgba="0 0 0 0"/></body>
    <camera pos=".5 -2.2 .6" xyaxes="1 0 0 0 .2 1" fovy="45"/>
  </worldbody>
  <actuator>
    <motor name="other" joint="turn"/>
    <general name="crank" cranksite="pin" slidersite="slider" cranklength=".7"/>
  </actuator>
</mujoco>
"""


def posed(slide: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm = mujoco.MjModel.from_xml_string(XML)
    mjd = mujoco.MjData(mjm)
    mjd.qpos[:] = slide, 0.4
    mujoco.mj_forward(mjm, mjd)
    return mjm, mjd


def drawn(
    mjm: mujoco.MjModel, mjd: mujoco.MjData, make: Callable[..., Any] = reference_renderer
) -> tuple[np.ndarray, np.ndarray]:
    """Colours, and ids with their ``mjtObj``."""
    with make(mjm, SIZE, SIZE) as renderer:
        renderer.update_scene(mjd, camera=0)
        colors = renderer.render().copy()
        renderer.enable_segmentation_rendering()
        renderer.update_scene(mjd, camera=0)
        return colors, renderer.render().copy()


def thicker(mjm: mujoco.MjModel) -> None:
    mjm.vis.scale.slidercrank *= 2.0


def smaller(mjm: mujoco.MjModel) -> None:
    mjm.stat.meansize *= 0.5


def longer(mjm: mujoco.MjModel) -> None:
    mjm.actuator_cranklength *= 1.2


def painted(mjm: mujoco.MjModel) -> None:
    mjm.vis.rgba.slidercrank[:] = 0.9, 0.1, 0.8, 1.0


@pytest.mark.parametrize("change", [thicker, smaller, longer, painted])
def test_they_follow_the_model(device: wp.Device, change: Callable[[mujoco.MjModel], None]) -> None:
    mjm, mjd = posed(0.0)
    with Renderer(mjm, SIZE, SIZE, device=device) as renderer:
        renderer.update_scene(mjd, camera=0)
        before = renderer.render().copy()
        change(mjm)
        renderer.update_scene(mjd, camera=0)
        after = renderer.render().copy()
    with Renderer(mjm, SIZE, SIZE, device=device) as anew:
        anew.update_scene(mjd, camera=0)
        assert (after == anew.render()).all()
    assert (after != before).any()


def alike(colors: np.ndarray, pairs: np.ndarray, painted: np.ndarray, theirs: np.ndarray) -> None:
    crank = (theirs == (1, int(mujoco.mjtObj.mjOBJ_ACTUATOR))).all(axis=-1)
    same = (pairs == theirs).all(axis=-1)
    assert crank.sum() > 120 and same.mean() > 0.99 and same[crank].mean() > 0.9
    difference = np.abs(colors.astype(int) - painted).max(axis=-1)
    assert (difference[same & crank] <= 12).mean() > 0.95


@pytest.mark.parametrize("slide", [0.0, 0.35, -0.5])
def test_they_are_drawn_as_mujoco_draws_them(device: wp.Device, slide: float) -> None:
    """The last one does not reach: its colour is another."""
    mjm, mjd = posed(slide)
    painted, theirs = drawn(mjm, mjd)
    scene = wc.from_mujoco(mjm, mjd, device=device)
    image = wc.Renderer(scene, [wc.Camera(0, width=SIZE, height=SIZE, outputs=("rgb", "segmentation"))]).render()[0]
    seen = {name: output[0].cpu().numpy() for name, output in image.items()}
    alike(seen["rgb"], scene.objects[seen["segmentation"][..., 0]], painted, theirs)
    alike(*drawn(mjm, mjd, Renderer), painted, theirs)


def test_each_world_has_its_own(device: wp.Device) -> None:
    states = [posed(slide) for slide in (0.35, -0.5)]
    scene = wc.from_mujoco(states[0][0], [mjd for _, mjd in states], device=device)
    image = wc.Renderer(scene, [wc.Camera(0, width=SIZE, height=SIZE, outputs=("rgb", "segmentation"))]).render()[0]
    for world, (mjm, mjd) in enumerate(states):
        pairs = scene.objects[image["segmentation"][world, ..., 0].cpu().numpy()]
        alike(image["rgb"][world].cpu().numpy(), pairs, *drawn(mjm, mjd))


def test_they_may_be_left_out(device: wp.Device) -> None:
    mjm, mjd = posed(0.0)
    scene = wc.from_mujoco(mjm, mjd, device=device, draw=("geoms", "sites"))
    camera = wc.Camera(0, width=SIZE, height=SIZE, outputs=("segmentation",))
    ids = wc.Renderer(scene, [camera]).render()[0]["segmentation"].cpu().numpy()
    assert set(np.unique(ids)) == {-1, 0, 1}
    assert len(scene.objects) == mjm.ngeom + mjm.nsite + mjm.nu + 1
    for drive in range(mjm.nu):
        mjm.actuator_trntype[drive] = mujoco.mjtTrn.mjTRN_JOINT  # no slider-crank: actuators have no ids
        mjm.actuator_trnid[drive] = 0, -1
    assert len(wc.from_mujoco(mjm, mjd, device=device).objects) == mjm.ngeom + mjm.nsite + 1
