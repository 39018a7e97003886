"""``planes_from_behind``: a plane seen from behind is what a plane that faces the camera would be, in all but light."""

import re

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from mujoco_reference import reference_renderer

import warpcam as wc

UNLIT = ("depth", "distance", "normals", "points", "segmentation", "bodies", "flow", "flow_valid", "albedo")
SIZE = {"width": 48, "height": 40}
AROUND = """
  <geom name="floor" type="plane" size="3 3 .1"/>
  <body pos="0 0 1"><freejoint/><geom name="box" type="box" size=".3 .3 .3" rgba=".2 .4 .8 1"/></body>
"""
MESH = '<mesh name="mesh" vertex="0 0 0  .6 0 0  0 .6 0  0 0 .6"/>'
KINDS = {"finite": "1.2 .8 .1", "strip": "0 .5 .1", "endless": "0 0 .1"}
LENSES = {
    "pinhole": wc.Pinhole(fovy=60.0),
    "orthographic": wc.Orthographic(height=3.0),
    "fisheye": wc.Fisheye(fovy=150.0),
}


def world(size: str, turned: bool, meshes: bool) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A wall between the camera and a box; ``turned``: its front is what is seen of it."""
    wall = f'<geom name="wall" type="plane" size="{size}" rgba=".9 .1 .1 1" euler="{180 if turned else 0} 0 0"/>'
    more = '<geom type="mesh" mesh="mesh" pos="-1 0 .5"/>' if meshes else ""
    mjm = scenes.compile_xml(
        f'<light pos="0 0 4"/>{AROUND}{more}<body name="wall" pos="0 -1 1" euler="-75 10 0">{wall}</body>',
        assets=MESH if meshes else "",
    )
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    return mjm, mjd


def camera(lens: str, outputs: tuple[str, ...]) -> wc.Camera:
    turn = scenes.looking((0.0, -3.0, 1.2), (0.0, 0.0, 1.0))
    return wc.Camera("eye", **SIZE, outputs=outputs, lens=LENSES[lens], position=(0.0, -3.0, 1.2), rotation=turn)


def seen(
    device: wp.Device, size: str, lens: str, outputs: tuple[str, ...], meshes: bool, turned: bool, **asked: bool
) -> dict[str, np.ndarray]:
    """Images of the second of two frames, between which the camera and the box have moved."""
    mjm, mjd = world(size, turned, meshes)
    renderer = wc.Renderer(wc.from_mujoco(mjm, mjd, device=device, **asked), [camera(lens, outputs)])
    renderer.render()
    renderer.camera("eye").position[:] += 0.03
    mjd.qpos[:3] += 0.02
    mujoco.mj_forward(mjm, mjd)
    return scenes.on_host(renderer.render()["eye"])


@pytest.mark.parametrize("meshes", [False, True])
@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("size", KINDS)
def test_a_plane_from_behind_is_a_plane_that_is_turned(device: wp.Device, size: str, lens: str, meshes: bool) -> None:
    outputs = UNLIT if lens != "fisheye" else tuple(name for name in UNLIT if not name.startswith("flow"))
    one = seen(device, KINDS[size], lens, outputs, meshes, turned=False, planes_from_behind=True)
    two = seen(device, KINDS[size], lens, outputs, meshes, turned=True)
    without = seen(device, KINDS[size], lens, outputs, meshes, turned=False)
    wall = one["segmentation"][0] == mujoco.MjModel.geom(world(KINDS[size], False, meshes)[0], "wall").id
    assert wall.mean() > 0.05 and not (without["segmentation"][0][wall] == one["segmentation"][0][wall]).any()
    for name in outputs:
        np.testing.assert_allclose(one[name], two[name], rtol=1e-4, atol=2e-3, err_msg=name)


def test_colours_show_it_as_transparent_and_ids_as_mujoco_does(device: wp.Device) -> None:
    mjm, mjd = world(KINDS["finite"], False, False)
    mjm.vis.quality.offsamples = 0
    look = mujoco.MjvCamera()
    look.lookat[:], look.distance, look.azimuth, look.elevation = (0.0, 0.0, 1.0), 3.0, 90.0, -3.0
    with reference_renderer(mjm, SIZE["height"], SIZE["width"]) as judge:
        judge.update_scene(mjd, look)
        colors = judge.render()
        eyes = judge.scene.camera
        place = 0.5 * (eyes[0].pos + eyes[1].pos)
        turn = scenes.looking((0, 0, 0), eyes[0].forward, eyes[0].up)
        judge.enable_segmentation_rendering()
        ids = judge.render()[..., 0]
        judge.enable_depth_rendering()
        depth = judge.render()
    eye = wc.Camera(
        "eye", **SIZE, outputs=("rgb", "depth", "segmentation"), lens=wc.Pinhole(fovy=float(mjm.vis.global_.fovy)),
        position=place, rotation=turn,
    )  # fmt: skip
    m, d = scenes.put(mjm, 1, mjd=mjd)
    for scene in (
        wc.from_mujoco(mjm, mjd, device=device, planes_from_behind=True),
        wc.from_mujoco_warp(mjm, m, d, planes_from_behind=True),
    ):
        image = scenes.look(scene, eye)
        same = image["segmentation"][0] == ids
        hit = same & (ids >= 0)
        assert same.mean() > 0.98 and (np.abs(image["depth"][0] - depth) < 2e-3 * depth)[hit].mean() > 0.98
        assert np.abs(image["rgb"][0].astype(int) - colors).mean() < 3.0


def test_what_cannot_be_is_told(device: wp.Device) -> None:
    mjm, mjd = world(KINDS["finite"], False, False)
    with pytest.raises(wc.WarpcamError, match=re.escape("planes_from_behind must be True or False, got 'both'")):
        wc.from_mujoco(mjm, mjd, planes_from_behind="both")
    with pytest.raises(wc.WarpcamError, match="allowed are transparency None and True"):
        wc.from_mujoco(mjm, mjd, planes_from_behind=True, transparency=False)


def test_nothing_else_is_compiled_for_scenes_that_do_not_ask(device: wp.Device) -> None:
    mjm, mjd = world(KINDS["finite"], False, False)
    outputs = ("depth", "rgb")
    plain = wc.Renderer(wc.from_mujoco(mjm, mjd, device=device), [camera("pinhole", outputs)])
    asked = wc.Renderer(wc.from_mujoco(mjm, mjd, device=device, planes_from_behind=True), [camera("pinhole", outputs)])
    assert "PLANES_FROM_BEHIND" not in str(plain.plan["eye"])
    traces = [str(line) for line in str(asked.plan["eye"]).splitlines() if "PLANES_FROM_BEHIND" in line]
    assert len(traces) == 1 and traces[0].startswith("trace")
