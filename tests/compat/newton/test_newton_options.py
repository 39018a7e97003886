"""Parts of a model that Newton's settings have drawn, and their sides, beside Newton's own camera."""

import gc
import weakref
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.core import torch_interop

newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
import newton_scenes  # noqa: E402, newton may be missing
from newton.sensors import SensorCamera as TheirCamera  # noqa: E402
from newton_scenes import pose  # noqa: E402

from warpcam.compat.newton import SensorCamera, SensorTiledCamera  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

SIZE = (64, 48)
IMAGES = {"depth_image": "depth", "shape_index_image": "shape_index", "normal_image": "normal"}
SOFT, PARTICLE, NOTHING = 0xFFFFFFFD, 0xFFFFFFFE, 0xFFFFFFFF
ABOVE, BELOW = (0.4, -2.5, 2.6), (0.3, -2.0, -1.2)
has_modes = pytest.mark.skipif(
    not hasattr(TheirCamera, "DeformableSurfaceMode"), reason="this version of Newton has no visual meshes"
)


def all_soft() -> "newton.ModelBuilder":
    """A cloth with a visual mesh below it, wider; a soft body; a mesh that is open; a ball, and loose particles."""
    builder = newton.ModelBuilder()
    builder.add_cloth_grid(
        pos=wp.vec3(-0.8, -0.5, 1.0), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=5, dim_y=4, cell_x=0.2, cell_y=0.2,
        mass=0.1,
    )  # fmt: skip
    body = builder.add_body(xform=pose(-0.3, -0.1, 0.8))
    corners = np.array([[-0.8, -0.7, 0], [0.8, -0.7, 0], [0.8, 0.7, 0], [-0.8, 0.7, 0.1]])
    below = np.add(corners, (-0.3, -0.1, 0.8))
    if hasattr(builder, "add_deformable_visual_mesh"):
        builder.add_deformable_visual_mesh(below, [0, 1, 2, 0, 2, 3], kind="body", bodies=[body])
    builder.add_soft_grid(
        pos=wp.vec3(0.7, -0.3, 0.4), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=2, dim_y=2, dim_z=2, cell_x=0.2,
        cell_y=0.2, cell_z=0.2, density=1.0, k_mu=1.0, k_lambda=1.0, k_damp=0.0,
    )  # fmt: skip
    sheet = newton.Mesh(np.float32(0.5 * corners), np.array((0, 1, 2, 0, 2, 3)), compute_inertia=False)
    builder.add_shape_mesh(-1, mesh=sheet, xform=pose(0.1, 0.9, 0.6, (0.3, 0.2, 0.0, 1.0)))
    builder.add_shape_sphere(-1, radius=0.25, xform=pose(0.9, 0.6, 0.6))
    for x in (-1.2, -1.5):
        builder.add_particle(wp.vec3(x, 0.0, 0.7), wp.vec3(), 0.1, radius=0.12)
    return builder


def seen_by(
    sensor: Any, state: Any, positions: Any = (ABOVE,), target: Any = (0.0, 0.0, 0.7), **settings: Any
) -> dict[str, np.ndarray]:
    kind, model = type(sensor), sensor._render_context.model
    poses = []
    for position in positions:
        w, x, y, z = (float(part) for part in scenes.looking(position, target))
        poses.append(wp.transform(wp.vec3(*position), wp.quat(x, y, z, w)))
    views = wp.array(poses, dtype=wp.transformf, device=model.device)
    rays = kind.compute_camera_rays_pinhole(*SIZE, camera_fov=0.9, device=model.device)
    images = {name: getattr(sensor, f"allocate_image_{what}")(len(poses), *SIZE) for name, what in IMAGES.items()}
    images["hdr_color_image"] = sensor.allocate_image_color_hdr(len(poses), *SIZE)
    model.bvh_refit_shapes(state)
    model.bvh_refit_particles(state)
    worlds = wp.array(np.arange(len(poses)) % model.world_count, dtype=wp.int32, device=model.device)
    config = kind.RenderConfig(**settings)
    sensor.update(state, views, rays, world_indices=worlds, render_config=config, **images)
    return {name: image.numpy().copy() for name, image in images.items()}


def require_alike(mine: dict[str, np.ndarray], theirs: dict[str, np.ndarray], least: float = 0.995) -> None:
    ids = theirs["shape_index_image"]
    same = mine["shape_index_image"] == ids
    assert same.mean() > least
    close = np.abs(mine["depth_image"] - theirs["depth_image"]) < 2e-3
    assert close[same].mean() > 0.99
    turned = np.abs(mine["normal_image"] - theirs["normal_image"]).max(axis=-1) < 5e-3
    assert turned[same].mean() > 0.99
    lit = np.abs(mine["hdr_color_image"] - theirs["hdr_color_image"]).max(axis=-1) < 1e-2
    assert lit[same].mean() > 0.98


@has_modes
@pytest.mark.parametrize("backs", [False, True])
@pytest.mark.parametrize("mode", ["BOTH", "SIMULATION_ONLY", "VISUAL_ONLY"])
def test_deformable_surfaces_are_newtons_own(device: wp.Device, mode: str, backs: bool) -> None:
    model, state = newton_scenes.finalize(all_soft(), device)
    found = []
    for kind in (TheirCamera, SensorCamera):
        sensor = kind(model, deformable_surface_mode=kind.DeformableSurfaceMode[mode])
        sensor.create_default_light()
        found.append(seen_by(sensor, state, (ABOVE, BELOW), enable_backface_culling=not backs))
    theirs, mine = found
    require_alike(mine, theirs)
    from_above, from_below = ((image == SOFT).sum() for image in theirs["shape_index_image"])
    assert from_above > 100 and (from_below > 100 or not backs)


def worlds_and_all() -> "newton.ModelBuilder":
    """Two worlds, each with a ball, a cloth and a particle; and one of each that is in both, with a floor."""

    def add(builder: Any, x: float) -> None:
        builder.add_shape_sphere(-1, radius=0.2, xform=pose(x, 0.6, 0.5))
        builder.add_particle(wp.vec3(x, 0.0, 0.5), wp.vec3(), 0.1, radius=0.15)
        builder.add_cloth_grid(
            pos=wp.vec3(x - 0.2, -0.7, 0.5), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=2, dim_y=2, cell_x=0.2,
            cell_y=0.2, mass=0.1,
        )  # fmt: skip

    builder = newton.ModelBuilder()
    add(builder, -0.9)
    builder.add_ground_plane()
    for world in range(2):
        builder.begin_world()
        add(builder, 0.6 * world)
        builder.end_world()
    return builder


@pytest.mark.parametrize("kind", [SensorCamera, SensorTiledCamera], ids=["camera", "tiled"])
def test_particles_and_what_is_in_all_worlds_may_be_left_out(device: wp.Device, kind: Any) -> None:
    model, state = newton_scenes.finalize(worlds_and_all(), device)
    sensors = [each(model) for each in (kind.__mro__[1], kind)]
    w, x, y, z = (float(part) for part in scenes.looking(ABOVE, (0.0, 0.0, 0.5)))
    view = wp.transform(wp.vec3(*ABOVE), wp.quat(x, y, z, w))
    model.bvh_refit_shapes(state)
    model.bvh_refit_particles(state)
    ids = {}
    for settings in ({}, {"enable_particles": False}, {"enable_global_world": False}, {}):
        found = []
        for sensor in sensors:
            config = type(sensor).RenderConfig(**settings)
            if kind is SensorCamera:
                rays = kind.compute_camera_rays_pinhole(*SIZE, camera_fov=0.9, device=model.device)
                views = wp.array([view] * 2, dtype=wp.transformf, device=model.device)
                image = sensor.allocate_image_shape_index(2, *SIZE)
            else:
                rays = sensor.utils.compute_camera_rays_pinhole(*SIZE, camera_fovs=[0.9])
                views = wp.array([[view] * 2], dtype=wp.transformf, ndim=2, device=model.device)
                image = sensor.utils.create_shape_index_image_output(*SIZE, camera_count=1)
            sensor.update(state, views, rays, shape_index_image=image, render_config=config)
            found.append(image.numpy().reshape(2, -1))
        theirs, mine = found
        assert (theirs == mine).mean() > 0.995, settings
        ids[str(settings)] = set(np.unique(mine))
    everything = ids["{}"]
    assert everything == {0, 1, 2, 3, SOFT, PARTICLE}
    assert everything - ids["{'enable_particles': False}"] == {PARTICLE}
    assert ids["{'enable_global_world': False}"] == {2, 3, SOFT, PARTICLE, NOTHING}


@pytest.mark.parametrize("down", [False, True])
def test_what_is_seen_from_one_side_casts_shadows_from_both(device: wp.Device, down: bool) -> None:
    builder = newton.ModelBuilder()
    builder.add_ground_plane()
    turn = (1.0, 0.0, 0.0, 0.0) if down else (0.0, 0.0, 0.0, 1.0)
    builder.add_cloth_grid(
        pos=wp.vec3(-0.5, 0.5 if down else -0.5, 1.0), rot=wp.quat(*turn), vel=wp.vec3(), dim_x=4, dim_y=4, cell_x=0.25,
        cell_y=0.25, mass=0.1,
    )  # fmt: skip
    corners = np.float32(((-0.3, -0.3, 0.0), (0.3, -0.3, 0.0), (0.0, 0.4, 0.0)))
    sheet = newton.Mesh(corners, np.array((0, 1, 2)), compute_inertia=False)
    builder.add_shape_mesh(-1, mesh=sheet, xform=pose(1.2, 0.0, 0.8, turn))
    model, state = newton_scenes.finalize(builder, device)
    found = []
    for kind in (TheirCamera, SensorCamera):
        sensor = kind(model)
        sensor.set_ambient_light((0.0, 0.0, 0.0))
        sensor.create_default_light(direction=(0.0, 0.0, -1.0))
        found.append(seen_by(sensor, state, ((0.4, -3.5, 2.6),), (0.4, 0.0, 0.5), enable_shadows=True))
    theirs, mine = found
    same = theirs["shape_index_image"] == mine["shape_index_image"]
    assert same.mean() > 0.995 and ((theirs["shape_index_image"] == SOFT).sum() > 50) != down
    floor = same & (theirs["shape_index_image"] == 0)
    light, expected = (seen["hdr_color_image"][floor][:, 1] for seen in (mine, theirs))
    dark = expected < 0.5 * expected.max()
    assert 60 < dark.sum() < 0.5 * len(dark)
    assert (np.abs(light - expected) < 1e-3).mean() > 0.995  # three tenths of it are left
    assert expected[dark] == pytest.approx(0.3 * expected.max(), rel=1e-3)


def test_a_cone_does_not_shade_itself_where_light_falls(device: wp.Device) -> None:
    """A cone is convex: its sides that face the light are lit."""
    builder = newton.ModelBuilder()
    builder.add_shape_cone(-1, radius=0.4, half_height=0.6, xform=pose(0.0, 0.0, 0.5))
    model, state = newton_scenes.finalize(builder, device)
    lit, shaded = {}, {}
    for kind in (TheirCamera, SensorCamera):
        sensor = kind(model)
        sensor.create_default_light()
        lit[kind], shaded[kind] = (seen_by(sensor, state, enable_shadows=shadows) for shadows in (False, True))
    require_alike(lit[SensorCamera], lit[TheirCamera])
    name = "hdr_color_image"
    there = lit[SensorCamera]["shape_index_image"] == 0
    assert np.abs(shaded[SensorCamera][name] - lit[SensorCamera][name])[there].max() < 1e-5
    theirs = np.abs(shaded[TheirCamera][name] - lit[TheirCamera][name]).max(axis=-1)[there] > 0.01
    assert theirs.mean() > 0.2  # else the page on this sensor is to be changed


def test_a_capture_draws_what_was_drawn_before(device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("only CUDA has captures")
    model, state = newton_scenes.finalize(worlds_and_all(), device)
    sensor = SensorCamera(model)
    views = wp.array([wp.transform_identity()] * 2, dtype=wp.transformf, device=device)
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.9, device=device)
    shape = sensor.allocate_image_shape_index(2, *SIZE)
    sensor.update(state, views, rays, shape_index_image=shape)
    without = SensorCamera.RenderConfig(enable_particles=False)
    with wp.ScopedCapture(device):
        with pytest.raises(wc.WarpcamError, match=r"render_config\.enable_particles: a capture is under way"):
            sensor.update(state, views, rays, shape_index_image=shape, render_config=without)
        sensor.update(state, views, rays, shape_index_image=shape)


CHANGED = (
    ("enable_particles", False),
    ("enable_textures", True),
    ("enable_ambient_lighting", False),
    ("enable_shadows", True),
)


def test_what_is_captured_stays_as_it_was(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other settings than before are refused, and its renderer is kept when the scene is made anew."""
    model, state = newton_scenes.finalize(worlds_and_all(), device)
    sensor = SensorCamera(model)
    sensor.create_default_light()
    views = wp.array([wp.transform_identity()] * 2, dtype=wp.transformf, device=device)
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.9, device=device)
    color = sensor.allocate_image_color(2, *SIZE)

    def update(**settings: Any) -> None:
        sensor.update(state, views, rays, color_image=color, render_config=SensorCamera.RenderConfig(**settings))

    update()
    with monkeypatch.context() as capture:
        capture.setattr(torch_interop, "is_capturing", lambda device: True)
        for name, value in CHANGED:
            with pytest.raises(wc.WarpcamError, match=rf"render_config\.{name}: a capture is under way, and it is ano"):
                update(**{name: value})
        update()
    (traced,) = sensor._views._renderers.values()
    captured = weakref.ref(traced.renderer), weakref.ref(sensor.scene)
    del traced
    update(enable_particles=False)
    gc.collect()
    assert all(kept() is not None for kept in captured) and captured[1]() is not sensor.scene
    scene = weakref.ref(sensor.scene)
    update()
    gc.collect()
    assert scene() is None  # which no capture has


def test_a_scene_that_cannot_be_made_is_made_when_it_is_asked_for_again(
    device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The scene cannot be made while memory is short; the images of the scene before take none then."""
    model, state = newton_scenes.finalize(worlds_and_all(), device)
    sensor = SensorCamera(model)
    seen_by(sensor, state)
    (traced,) = map(weakref.ref, sensor._views._renderers.values())

    def fail(*_: Any, **__: Any) -> None:
        gc.collect()
        assert traced() is None
        raise MemoryError

    with monkeypatch.context() as full:
        full.setattr("warpcam.compat.newton.renderers.load", fail)
        with pytest.raises(MemoryError):
            seen_by(sensor, state, enable_particles=False)
    for particles in (False, True):
        ids = seen_by(sensor, state, enable_particles=particles)["shape_index_image"]
        assert (PARTICLE in ids) == particles


def test_an_unknown_mode_is_named(device: wp.Device) -> None:
    model = newton.ModelBuilder().finalize(device=device)
    with pytest.raises(wc.WarpcamError, match="Invalid deformable_surface_mode: 3; allowed are BOTH"):
        SensorCamera(model, deformable_surface_mode=3)


@pytest.mark.parametrize("colored", [False, True])
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (0.8, 1.0, 1.9), (-1.0, 1.2, 0.5)])
def test_smooth_meshes_have_newtons_normals(device: wp.Device, scale: Any, colored: bool) -> None:
    """Normals are those that light takes, also if a mesh is scaled unevenly."""
    builder = newton.ModelBuilder()
    mesh = newton.Mesh.create_sphere(0.6, num_latitudes=7, num_longitudes=9, compute_inertia=False)
    builder.add_shape_mesh(-1, mesh=mesh, scale=scale, xform=pose(-0.5, 0.0, 0.6, (0.3, 0.2, 0.1, 1.0)))
    builder.add_shape_mesh(-1, mesh=newton_scenes.tetrahedron(), xform=pose(0.5, 0.0, 0.5))
    model, state = newton_scenes.finalize(builder, device)
    w, x, y, z = (float(part) for part in scenes.looking(ABOVE, (0.0, 0.0, 0.6)))
    views = wp.array([wp.transform(ABOVE, wp.quat(x, y, z, w))], dtype=wp.transformf, device=model.device)
    found = []
    for kind in (TheirCamera, SensorCamera):
        sensor = kind(model)
        sensor.create_default_light()
        rays = kind.compute_camera_rays_pinhole(*SIZE, camera_fov=0.9, device=model.device)
        images = {name: getattr(sensor, f"allocate_image_{what}")(1, *SIZE) for name, what in IMAGES.items()}
        if colored:
            images["hdr_color_image"] = sensor.allocate_image_color_hdr(1, *SIZE)
        sensor.update(state, views, rays, **images)
        found.append({name: image.numpy() for name, image in images.items()})
    theirs, mine = found
    if not colored:
        theirs["hdr_color_image"] = mine["hdr_color_image"] = np.zeros((*mine["shape_index_image"].shape, 3))
    assert {0, 1} <= set(np.unique(theirs["shape_index_image"]))
    require_alike(mine, theirs)
