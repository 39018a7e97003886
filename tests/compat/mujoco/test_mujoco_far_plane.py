"""Surfaces at the far plane: whether they are seen, in each front end as in the system it stands for."""

import mujoco
import mujoco_warp as mjw
import pytest
import scenes
import warp as wp
from mujoco_reference import reference_renderer

from warpcam.compat import mujoco_warp as ours
from warpcam.compat.mujoco import Renderer

SIZE = 16
OFF = (-1e-3, -1e-4, -1e-5, -1e-6, 0.0, 1e-6, 1e-5, 1e-4, 1e-3)  # of the far plane's distance


def wall(zfar: float, znear: float, extent: float, off: float, lens: str = "") -> mujoco.MjModel:
    """A wall so far beyond the far plane."""
    distance = zfar * extent * (1.0 + off) + 0.1
    visual = f'<visual><quality offsamples="0" shadowsize="16"/><map zfar="{zfar}" znear="{znear}"/></visual>'
    return scenes.compile_xml(
        f'<camera xyaxes="1 0 0 0 0 1" {lens}/><geom type="box" size="99 .1 99" pos="0 {distance!r} 0"/>',
        more=f'<statistic extent="{extent}"/>{visual}',
    )


@pytest.mark.parametrize("lens", ["", 'projection="orthographic" fovy="1"'])
@pytest.mark.parametrize(
    ("zfar", "znear", "extent"), [(1.0, 0.01, 0.4), (1.0, 0.1, 3.3), (2.5, 0.01, 1.0), (50.0, 0.01, 1.0)]
)
def test_the_far_plane_is_where_rounding_puts_mujocos(
    device: wp.Device, zfar: float, znear: float, extent: float, lens: str
) -> None:
    """OpenGL's projection has 32 bits, which moves the far plane by up to some ten-thousandths of its distance."""
    theirs, seen = [], []
    for off in OFF:
        model = wall(zfar, znear, extent, off, lens)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        with reference_renderer(model, SIZE, SIZE) as judge, Renderer(model, SIZE, SIZE, device=device) as renderer:
            for one, into in ((judge, theirs), (renderer, seen)):
                one.update_scene(data, camera=0)
                one.enable_segmentation_rendering()
                into.append(bool((one.render()[..., 0] >= 0).all()))
            renderer.enable_depth_rendering()
            assert renderer.render() == pytest.approx(zfar * extent, rel=2e-3)
    assert theirs == seen and theirs[0] and not theirs[-1]


def test_what_lies_at_the_far_plane_is_seen_as_in_mujoco_warp(device: wp.Device) -> None:
    for off, visible in ((0.0, True), (-1e-6, True), (2e-6, False)):
        model = wall(1.0, 0.01, 0.5, off)
        m, d = scenes.put(model, 1)
        hits = []
        for system in (mjw, ours):
            context = system.create_render_context(model, nworld=1, cam_res=(SIZE, SIZE), render_depth=True)
            system.refit_bvh(m, d, context)
            system.render(m, d, context)
            hits.append((context.depth_data.numpy() > 0.0).mean())
        assert (hits[1] == 1.0) == visible and (hits[0] > 0.5) == visible
