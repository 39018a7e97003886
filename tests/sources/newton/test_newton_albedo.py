"""Colours of single faces and textures without coordinates, beside Newton's own camera."""

from typing import Any

import newton_scenes
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
from newton.sensors import SensorCamera  # noqa: E402, newton may be missing
from newton_scenes import eye, finalize, pose  # noqa: E402

from warpcam.compat.newton import SensorCamera as OurCamera  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own


def newtons_albedo(
    model: "newton.Model", state: "newton.State", camera: wc.Camera, kind: Any = SensorCamera, textures: bool = True
) -> np.ndarray:
    """Display values, (world, height, width, 3)."""
    config = SensorCamera.RenderConfig(enable_textures=textures, enable_backface_culling=False)
    sensor = kind(model, default_render_config=config)
    rays = SensorCamera.compute_camera_rays_pinhole(
        camera.width, camera.height, camera_fov=np.radians(newton_scenes.FOVY), device=model.device
    )
    w, x, y, z = (float(value) for value in camera.rotation)
    views = [wp.transform(wp.vec3(*camera.position), wp.quat(x, y, z, w))] * model.world_count
    image = sensor.allocate_image_albedo(model.world_count, camera.width, camera.height)
    model.bvh_refit_shapes(state)
    sensor.update(state, wp.array(views, dtype=wp.transformf, device=model.device), rays, albedo_image=image)
    packed = image.numpy()
    return np.stack([packed >> shift & 255 for shift in (0, 8, 16)], axis=-1).astype(np.int32)


def alike(model: "newton.Model", state: "newton.State", scene: wc.Scene, camera: wc.Camera) -> np.ndarray:
    """Return where the albedo of visible surfaces is the same, but for the filtering of textures."""
    seen = scenes.look(scene, camera)
    there = seen["segmentation"] != -1
    return np.abs(seen["albedo"].astype(int) - newtons_albedo(model, state, camera)).max(axis=-1)[there] <= 30


@pytest.mark.parametrize("convex", [False, True])
def test_a_texture_without_coordinates_lies_along_the_axes(device: wp.Device, convex: bool) -> None:
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 64, endpoint=False), np.linspace(0.0, 1.0, 64, endpoint=False))
    waves = np.stack((np.sin(2 * np.pi * x), np.sin(2 * np.pi * y), np.cos(2 * np.pi * (x + y))), axis=-1)
    pixels = (128 + 100 * waves).astype(np.uint8)
    mesh = newton_scenes.tetrahedron()
    mesh.texture = pixels
    builder = newton.ModelBuilder()
    add = builder.add_shape_convex_hull if convex else builder.add_shape_mesh
    add(-1, mesh=mesh, scale=(2.0, 1.5, -1.2), color=(1.0, 1.0, 1.0), xform=pose(-1.0, 0.0, 1.5, (0.3, 0.2, 0.5, 1.0)))
    add(-1, mesh=mesh, scale=(1.0, 2.5, 1.5), color=(0.9, 0.6, 1.0), xform=pose(0.5, 0.0, 0.7, (0.0, 0.1, -0.9, 1.0)))
    model, state = finalize(builder, device)
    same = alike(model, state, wc.from_newton(model, state), eye(outputs=("albedo", "segmentation")))
    assert len(same) > 400 and same.mean() > 0.96


def test_each_triangle_of_a_cloth_has_its_colour(device: wp.Device) -> None:
    """Also where they are changed in place, and on both sides."""
    random = np.random.default_rng(0)
    sheet = newton.ModelBuilder()
    sheet.add_cloth_grid(
        pos=wp.vec3(-0.5, -0.5, 0.9), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=4, dim_y=4, cell_x=0.3,
        cell_y=0.3, mass=0.1,
    )  # fmt: skip
    sheet.add_shape_box(-1, hx=0.2, hy=0.2, hz=0.2, color=(0.3, 0.9, 0.5))
    builder = newton.ModelBuilder()
    builder.replicate(sheet, 2)
    model, state = finalize(builder, device)
    colors = random.uniform(size=(model.tri_count, 3)).astype(np.float32)
    model.tri_color.assign(colors)
    scene = wc.from_newton(model, state)
    for height in (3.0, -1.0):
        position = (0.0, -2.0, height)
        camera = eye(
            outputs=("albedo", "segmentation"), position=position, rotation=scenes.looking(position, (0, 0, 0.8))
        )
        same = alike(model, state, scene, camera)
        assert len(same) > 1000 and same.mean() > 0.95
    for textures in (False, True):  # in place of Newton's, too
        mine, theirs = (newtons_albedo(model, state, camera, kind, textures) for kind in (OurCamera, SensorCamera))
        assert (np.abs(mine - theirs).max(axis=-1) <= 2).mean() > 0.97
    renderer = wc.Renderer(scene, [camera])
    before = scenes.on_host(renderer.render()["eye"])["albedo"]
    colors[: len(colors) // 2] = colors[0]
    model.tri_color.assign(colors)
    after = scenes.on_host(renderer.render()["eye"])
    assert (after["albedo"][1] == before[1]).all()
    cloth = after["albedo"][0][after["segmentation"][0] == -3]
    assert (np.abs(cloth - 255.0 * colors[0]) <= 1.0).all()
