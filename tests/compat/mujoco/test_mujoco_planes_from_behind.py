"""Ids and depth of planes seen from behind, from the front ends of MuJoCo's renderer, as MuJoCo draws them."""

import mujoco
import numpy as np
import pytest
import warp as wp
from mujoco_reference import reference_renderer

from warpcam.compat.mujoco import Renderer

WIDTH, HEIGHT = 64, 48
PLANES = {
    "finite": '<geom name="wall" type="plane" size="1 1 .1" pos="0 -1 1" euler="-90 0 0"/>',
    "slanted": '<geom name="wall" type="plane" size=".7 1 .1" pos="0 -1 1" euler="-60 20 0"/>',
    "strip": '<geom name="wall" type="plane" size="0 .3 .1" pos="0 -1 1" euler="-90 0 0"/>',
    "endless": '<geom name="wall" type="plane" size="0 0 .1" pos="0 -1 1" euler="-80 0 0"/>',
    "transparent": '<geom name="wall" type="plane" size="1 1 .1" pos="0 -1 1" euler="-90 0 0" rgba="1 0 0 .4"/>',
    "invisible": '<geom name="wall" type="plane" size="1 1 .1" pos="0 -1 1" euler="-90 0 0" rgba="1 0 0 0"/>',
    "other group": '<geom name="wall" type="plane" size="1 1 .1" pos="0 -1 1" euler="-90 0 0" group="4"/>',
    "two": """<geom name="wall" type="plane" size="1 1 .1" pos="0 -1 1" euler="-90 0 0"/>
              <geom name="other" type="plane" size=".5 .5 .1" pos=".3 -1.5 1" euler="-70 0 0"/>""",
}
CAMERAS = {"perspective": 'fovy="60"', "orthographic": 'projection="orthographic" fovy="2.4"'}


def world(planes: str, lens: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <visual><quality offsamples="0"/></visual><statistic extent="4"/>
          <worldbody>
            <light pos="0 0 4"/>
            <geom name="floor" type="plane" size="3 3 .1"/>
            <geom name="box" type="box" size=".3 .3 .3" pos="0 0 1"/>
            {planes}
            <camera pos="0 -3 1" xyaxes="1 0 0 0 0 1" {lens}/>
          </worldbody>
        </mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def solid(renderer: mujoco.Renderer, data: mujoco.MjData, draw: object = None) -> tuple[np.ndarray, np.ndarray]:
    """Ids and depth."""
    renderer.update_scene(data, camera=0)
    if callable(draw):
        draw(renderer.scene)
    renderer.enable_segmentation_rendering()
    ids = renderer.render()
    renderer.enable_depth_rendering()
    depth = renderer.render()
    renderer.disable_depth_rendering()
    return ids, depth


def compare(one: tuple[np.ndarray, np.ndarray], two: tuple[np.ndarray, np.ndarray]) -> None:
    same = (one[0] == two[0]).all(axis=-1)
    assert same.mean() > 0.985
    near = np.abs(one[1] - two[1]) <= 2e-3 * one[1]
    assert near[same].mean() > 0.98


@pytest.mark.parametrize("lens", CAMERAS)
@pytest.mark.parametrize("name", PLANES)
def test_ids_and_depth_are_those_of_mujocos_own(device: wp.Device, name: str, lens: str) -> None:
    if lens == "orthographic" and mujoco.mj_version() < 3017000:
        pytest.skip("MuJoCo 3.9 takes depths of orthographic cameras for those of perspective ones")
    model, data = world(PLANES[name], CAMERAS[lens])
    poses = data.geom_xmat.copy()
    with reference_renderer(model, HEIGHT, WIDTH) as theirs, Renderer(model, HEIGHT, WIDTH, device=device) as ours:
        expected, seen = solid(theirs, data), solid(ours, data)
        compare(expected, seen)
        covered = (expected[0][..., 0] == model.geom("wall").id).mean()
        assert (covered > 0.05) == (name not in ("invisible", "other group"))
        again = solid(ours, data)  # colours do not change what ids show, nor ids the state
    assert all((one == two).all() for one, two in zip(seen, again, strict=True))
    assert (data.geom_xmat == poses).all()


def test_planes_of_the_scene_likewise(device: wp.Device) -> None:
    def draw(scene: mujoco.MjvScene) -> None:
        turn = np.array((1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0))
        geom = scene.geoms[scene.ngeom]
        args = (mujoco.mjtGeom.mjGEOM_PLANE, np.array((0.5, 0.5, 0.1)), np.array((0.0, -1.0, 1.0)), turn)
        mujoco.mjv_initGeom(geom, *args, np.array((1, 0, 0, 1), np.float32))
        geom.segid, geom.objid, geom.objtype = scene.ngeom, 77, 5
        scene.ngeom += 1

    model, data = world("", CAMERAS["perspective"])
    with reference_renderer(model, HEIGHT, WIDTH) as theirs, Renderer(model, HEIGHT, WIDTH, device=device) as ours:
        expected, seen = solid(theirs, data, draw), solid(ours, data, draw)
    compare(expected, seen)
    assert ((expected[0] == (77, 5)).all(axis=-1)).mean() > 0.05
