"""Newton's camera sensors by our classes: beside its own, and in its own tests."""

import inspect
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
import newton_scenes  # noqa: E402, newton may be missing
import newton_upstream  # noqa: E402
from newton.sensors import SensorCamera as TheirCamera  # noqa: E402
from newton.sensors import SensorTiledCamera as TheirTiled  # noqa: E402

from warpcam.compat.newton import SensorCamera, SensorTiledCamera  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

SIZE = (24, 16)
IMAGES = {
    "color_image": "color",
    "depth_image": "depth",
    "forward_depth_image": "depth_forward",
    "shape_index_image": "shape_index",
    "normal_image": "normal",
    "albedo_image": "albedo",
    "hdr_color_image": "color_hdr",
}
# Of Newton's own tests of its camera, those that are of what is offered here; docs/compat/newton.md has what is not.
OF_NEWTON = (
    "test_albedo_output_follows_output_color_space",
    "test_camera_multisample_offsets_center_on_pixel",
    "test_camera_ray_helpers_live_on_sensor_camera",
    "test_camera_ray_helpers_support_preallocated_output",
    "test_camera_ray_helpers_generate_multisamples",
    "test_camera_ray_helpers_reject_batched_inputs",
    "test_cloth_renders_triangle_colors_from_both_sides",
    "test_cloth_respects_backface_culling",
    "test_convex_hull_renders_like_its_mesh",
    "test_default_ambient_light_matches_previous_constants",
    "test_forward_depth_uses_camera_origin",
    "test_fully_transparent_shape_does_not_occlude",
    "test_gaussian_radiance_is_clamped_and_srgb_decoded",
    "test_gaussian_srgb_overlapping_splats_blend_in_encoded_space",
    "test_hdr_color_matches_linear_packed_color",
    "test_hdr_color_matches_srgb_packed_color",
    "test_in_memory_rgb_and_grayscale_textures",
    "test_lighting_follows_model_up_axis",
    "test_mesh_texture_transform_maps_uvs",
    "test_msaa_shades_fully_covered_shape_at_center",
    "test_multiple_sensor_cameras_render_same_model",
    "test_pinhole_rays_reject_out_of_range_parameters",
    "test_render_forward_depth_output",
    "test_set_ambient_light_uniform_ground",
    "test_texture_projection_modes_texture_uvless_shapes",
    "test_update_clears_reserved_and_out_of_range_world_indices",
    "test_update_defaults_world_indices_to_identity",
    "test_update_overrides_default_render_settings",
    "test_update_rejects_default_world_indices_exceeding_world_count",
    "test_update_rejects_invalid_anti_aliasing",
    "test_update_rejects_multisample_rays_without_anti_aliasing",
    "test_update_renders_from_camera_transforms",
    "test_update_respects_disable_clear_flag",
    "test_update_respects_disable_preserve_flag",
    "test_update_supports_all_render_orders_with_3d_outputs",
    "test_update_uses_default_render_settings",
    "test_update_validates_rays_and_transforms",
    "test_update_without_world_indices_maps_view_to_world",
    "test_utils_postprocessing_helpers",
    "test_world_indices_decouple_views_from_worlds",
)
# Likewise of its older one, and of helpers that both have.
OF_OTHERS = (
    ("test_sensor_tiled_camera", "TestSensorTiledCamera", "test_cloth_triangle_mesh_respects_particle_worlds"),
    ("test_sensor_tiled_camera", "TestSensorTiledCamera", "test_constructor_config_alias_deprecated"),
    ("test_sensor_tiled_camera", "TestSensorTiledCamera", "test_constructor_config_none_warns_deprecated"),
    ("test_sensor_tiled_camera", "TestSensorTiledCamera", "test_constructor_rejects_default_render_config_and_config"),
    ("test_sensor_camera", "TestSensorCameraDeformable", "test_distinct_skin_textures"),
    ("test_sensor_camera", "TestSensorCameraDeformable", "test_visual_depth_and_world_mapping"),
    ("test_sensor_tiled_camera", "TestSensorTiledCamera", "test_forward_depth_image_matches_utility"),
    ("test_sensor_tiled_camera", "TestSensorTiledCamera", "test_render_config_can_enable_particles_with_triangle_mesh"),
    ("test_sensor_tiled_camera", "TestSensorTiledCamera", "test_checkerboard_material_requires_keyword_arguments"),
    ("test_sensor_tiled_camera", "TestSensorTiledCamera",
     "test_utils_explicit_render_config_field_update_does_not_warn"),
    ("test_sensor_tiled_camera", "TestSensorTiledCamera", "test_utils_implicit_default_render_config_update_warns"),
    ("test_sensor_tiled_camera_hdr_color", "TestSensorTiledCameraHdrColor",
     "test_hdr_color_matches_srgb_packed_color_after_encoding"),
    ("test_sensor_to_rgba", "TestToRgba", "test_world_camera_axis_ordering"),
    ("test_sensor_usd_camera", "TestSensorCameraRays", "test_usd_pinhole_camera_rays_accepts_prim_and_camera"),
    ("test_sensor_usd_camera", "TestSensorCameraRays", "test_zero_direction_ray_renders_clear_values"),
)  # fmt: skip


@pytest.mark.parametrize(("module", "case", "name"), OF_OTHERS, ids=[name for *_, name in OF_OTHERS])
def test_newtons_own_of_others(module: str, case: str, name: str) -> None:
    tests = pytest.importorskip(f"newton.tests.{module}", reason="this version's wheel has no tests")
    if not hasattr(getattr(tests, case, None), name):
        pytest.skip("this version of Newton has no such test")
    ours = {"SensorCamera": SensorCamera, "SensorTiledCamera": SensorTiledCamera}
    result = newton_upstream.run(module, case, name, {key: each for key, each in ours.items() if hasattr(tests, key)})
    assert not result.failures + result.errors, result.failures + result.errors


@pytest.mark.parametrize("name", OF_NEWTON)
def test_newtons_own(name: str) -> None:
    tests = pytest.importorskip("newton.tests.test_sensor_camera", reason="this version's wheel has no tests")
    if not hasattr(tests.TestSensorCamera, name):
        pytest.skip("this version of Newton has no such test")
    result = newton_upstream.run("test_sensor_camera", "TestSensorCamera", name, {"SensorCamera": SensorCamera})
    assert not result.failures + result.errors, result.failures + result.errors


@pytest.fixture
def worlds(device: wp.Device) -> tuple[Any, Any]:
    """Three worlds, a ball lower in each, and a floor and a box that all share."""
    builder = newton.ModelBuilder()
    builder.add_ground_plane()
    builder.add_shape_box(-1, hx=0.2, hy=0.2, hz=0.4, xform=newton_scenes.pose(0.7, 0.3, 0.4), color=(0.9, 0.2, 0.1))
    for world in range(3):
        part = newton.ModelBuilder()
        body = part.add_body(xform=newton_scenes.pose(-0.2, 0.0, 1.2 - 0.3 * world))
        part.add_shape_sphere(body, radius=0.35, color=(0.2, 0.5, 0.9))
        builder.add_world(part)
    return newton_scenes.finalize(builder, device)


def look_from(positions: Any, device: wp.Device) -> wp.array:
    """Views towards the middle."""
    poses = []
    for position in positions:
        w, x, y, z = (float(part) for part in scenes.looking(position, (0.0, 0.0, 0.5)))
        poses.append(wp.transform(wp.vec3(*position), wp.quat(x, y, z, w)))
    return wp.array(poses, dtype=wp.transformf, device=device)


def seen_by(kind: Any, model: Any, state: Any, positions: Any, **settings: Any) -> dict[str, np.ndarray]:
    sensor = kind(model)
    sensor.create_default_light()
    rays = kind.compute_camera_rays_pinhole(*SIZE, camera_fov=0.8, device=model.device)
    images = {name: getattr(sensor, f"allocate_image_{what}")(len(positions), *SIZE) for name, what in IMAGES.items()}
    model.bvh_refit_shapes(state)
    sensor.update(state, look_from(positions, model.device), rays, **images, **settings)
    return {name: image.numpy().copy() for name, image in images.items()}


def test_all_images_are_newtons_own(worlds: tuple[Any, Any]) -> None:
    model, state = worlds
    positions = [(2.5, -2.0, 1.5), (2.0, -2.5, 1.2), (-2.0, -2.0, 2.0)]
    clear = TheirCamera.ClearData(0xFF336699, -7.0, 99, (0.5, 0.0, 0.5), 0xFF000001)
    theirs, mine = (seen_by(k, model, state, positions, clear_data=clear) for k in (TheirCamera, SensorCamera))
    same = mine["shape_index_image"] == theirs["shape_index_image"]
    assert same.mean() > 0.995 and (theirs["shape_index_image"] == 99).any()
    for name in ("depth_image", "forward_depth_image", "normal_image"):
        np.testing.assert_allclose(mine[name][same], theirs[name][same], atol=2e-3, err_msg=name)
    for name in ("color_image", "albedo_image"):
        channels = [images[name].view(np.uint8).reshape(*images[name].shape, 4)[same] for images in (mine, theirs)]
        difference = np.abs(channels[0].astype(int) - channels[1])
        assert np.percentile(difference, 99) <= 2, name
    np.testing.assert_allclose(mine["hdr_color_image"][same], theirs["hdr_color_image"][same], atol=5e-3)


@pytest.mark.parametrize("kind", ["linear", "smooth"])
def test_what_is_cleared_is_newtons_own(device: wp.Device, kind: str) -> None:
    """In linear light, too, and with its alpha behind smooth edges."""
    builder = newton.ModelBuilder()
    builder.add_shape_box(-1, hx=0.5, hy=0.5, hz=0.5, xform=newton_scenes.pose(0.0, 0.0, 0.5, (0.2, 0.1, 0.3, 1.0)))
    model, state = newton_scenes.finalize(builder, device)
    clear = TheirCamera.ClearData(clear_color=0x80336699, clear_albedo=0x40AA5511)
    found = []
    for camera in (TheirCamera, SensorCamera):
        sensor = camera(model)
        sensor.create_default_light()
        smooth = kind == "smooth"
        rays = camera.compute_camera_rays_pinhole(
            *SIZE, camera_fov=0.8, device=model.device, sample_count=4 if smooth else 1
        )
        space = newton.utils.ColorSpace.SRGB if smooth else newton.utils.ColorSpace.LINEAR
        config = camera.RenderConfig(output_color_space=space, anti_aliasing=int(smooth))
        color, albedo = sensor.allocate_image_color(1, *SIZE), sensor.allocate_image_albedo(1, *SIZE)
        shape = sensor.allocate_image_shape_index(1, *SIZE)
        views = look_from([(2.0, -2.0, 1.5)], model.device)
        sensor.update(
            state, views, rays, color_image=color, albedo_image=albedo, shape_index_image=shape, clear_data=clear,
            render_config=config,
        )  # fmt: skip
        found.append([image.numpy()[0] for image in (color, albedo, shape)])
    theirs, mine = found
    miss = (theirs[2] == 0xFFFFFFFF) & (mine[2] == 0xFFFFFFFF)
    for _ in range(2):  # what is around is missed, too
        miss[1:-1, 1:-1] &= miss[:-2, 1:-1] & miss[2:, 1:-1] & miss[1:-1, :-2] & miss[1:-1, 2:]
    assert miss.sum() > 50
    for own, expected in zip(mine[:2], theirs[:2], strict=True):
        own, expected = (image[miss].astype(np.uint32).view(np.uint8).astype(int) for image in (own, expected))
        assert np.abs(own - expected).max() <= 1
    alphas = [image[0] >> 24 for image in (mine, theirs)]
    assert np.abs(alphas[0].astype(int) - alphas[1]).mean() < 4.0 and alphas[0].min() == 0x80


def test_what_is_missed_beside_smooth_edges_is_of_its_own_world(worlds: tuple[Any, Any], device: wp.Device) -> None:
    """Each world's view alone is what it is among those of other worlds."""
    model, state = worlds
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.8, device=device, sample_count=4)
    positions = [(2.5, -2.0, 0.5)] * 3
    config = SensorCamera.RenderConfig(anti_aliasing=1)
    clear = TheirCamera.ClearData(clear_color=0x00336699)

    def seen(indices: list[int]) -> np.ndarray:
        sensor = SensorCamera(model)
        sensor.create_default_light()
        color = sensor.allocate_image_color(len(indices), *SIZE)
        views, chosen = look_from(positions[: len(indices)], device), wp.array(indices, dtype=wp.int32, device=device)
        sensor.update(
            state, views, rays, color_image=color, world_indices=chosen, clear_data=clear, render_config=config
        )
        return color.numpy()

    together = seen([0, 1, 2])
    assert ((together[0] != together[2]) & (together[2] == 0x00336699)).any(), (
        "nothing is hit where the first world's ball is"
    )
    for world in (1, 2):
        np.testing.assert_array_equal(together[world], seen([world])[0], err_msg=f"{world}")


def test_two_views_of_a_world_in_any_order(worlds: tuple[Any, Any]) -> None:
    model, state = worlds
    positions = [(2.5, -2.0, 1.5), (2.0, -2.5, 1.2), (-2.0, -2.0, 2.0), (0.0, -3.0, 1.0)]
    indices = wp.array([2, 0, 2, TheirCamera.WorldRenderFlag.DISABLE_CLEAR], dtype=wp.int32, device=model.device)
    theirs, mine = (seen_by(k, model, state, positions, world_indices=indices) for k in (TheirCamera, SensorCamera))
    same = mine["shape_index_image"] == theirs["shape_index_image"]
    assert same.mean() > 0.995
    np.testing.assert_allclose(mine["depth_image"][same], theirs["depth_image"][same], atol=2e-3)
    sensor = SensorCamera(model, views_per_world=1)
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.8, device=model.device)
    depth = sensor.allocate_image_depth(4, *SIZE)
    sensor.update(state, look_from(positions, model.device), rays, depth_image=depth, world_indices=indices)
    assert int(sensor.left_out.numpy()[0]) == 1
    assert sum(image.any() for image in depth.numpy()) == 2


def test_the_state_and_the_settings_are_followed(worlds: tuple[Any, Any]) -> None:
    model, state = worlds
    sensor = SensorCamera(model)
    sensor.create_default_light(direction=(0.0, 0.0, -1.0))
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.8, device=model.device)
    transforms = look_from([(0.1, -3.0, 1.0)] * 3, model.device)
    color, shape = sensor.allocate_image_color(3, *SIZE), sensor.allocate_image_shape_index(3, *SIZE)

    def frame(**settings: Any) -> tuple[np.ndarray, np.ndarray]:
        config = SensorCamera.RenderConfig(**settings)
        sensor.update(state, transforms, rays, color_image=color, shape_index_image=shape, render_config=config)
        return color.numpy().copy(), shape.numpy().copy()

    plain, before = frame()
    assert (frame(enable_shadows=True)[0] != plain).any()
    assert (frame(enable_ambient_lighting=False)[0] != plain).any()
    assert (frame()[0] == plain).all()
    far = frame(max_distance=2.9)[1]
    assert (far == 0xFFFFFFFF).sum() > (before == 0xFFFFFFFF).sum()
    moved = state.body_q.numpy()
    moved[:, 2] += 0.4
    state.body_q.assign(moved)
    assert (frame()[1] != before).any()
    wider = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=1.6, out_rays=rays)
    assert wider is rays
    assert (frame()[1] == 2).sum() < (before == 2).sum()


def test_deformables_are_of_the_state_that_is_seen(worlds: tuple[Any, Any]) -> None:
    model, state = worlds
    sensor, other = SensorCamera(model), model.state()
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.8, device=model.device)
    given = (look_from([(0.1, -3.0, 1.0)] * 3, model.device), rays)
    depth = sensor.allocate_image_depth(3, *SIZE)
    sensor.sync_deformable_meshes(other)
    sensor.update(other, *given, depth_image=depth, sync_deformables=False)
    with pytest.raises(wc.WarpcamError, match="given another state than update"):
        sensor.update(state, *given, depth_image=depth, sync_deformables=False)
    sensor.update(state, *given, depth_image=depth)
    sensor.update(state, *given, depth_image=depth, sync_deformables=False)
    with pytest.raises(TypeError, match="must be DeformableVisuals, got int"):
        sensor.update(state, *given, depth_image=depth, deformable_visuals=3)


def test_the_signatures_are_newtons() -> None:
    for mine, theirs in ((SensorCamera, TheirCamera), (SensorTiledCamera, TheirTiled)):
        for name in ("__init__", "update"):
            expected, found = (inspect.signature(getattr(kind, name)).parameters for kind in (theirs, mine))
            images = {key for key in expected if key.endswith("_image")}
            assert set(expected) - set(found) == (images if name == "update" else set()), name
            assert images in (set(), set(IMAGES))
            added = [each for key, each in found.items() if key not in expected and key != "images"]
            assert all(each.kind is each.KEYWORD_ONLY for each in added)
        public = {name for name in dir(theirs) if not name.startswith("_")}
        assert public <= set(dir(mine))


def test_tiled_cameras_are_newtons_own(worlds: tuple[Any, Any]) -> None:
    model, state = worlds
    places = [[(2.5, -2.0, 1.5)] * 3, [(-2.0, -2.0, 2.0), (0.0, -3.0, 1.0), (1.0, -3.0, 2.0)]]
    images = []
    for kind in (TheirTiled, SensorTiledCamera):
        sensor = kind(model)
        rays = sensor.utils.compute_camera_rays_pinhole(*SIZE, camera_fovs=[0.8, 1.1])
        poses = np.stack([look_from(row, model.device).numpy() for row in places])
        transforms = wp.array(poses, dtype=wp.transformf, ndim=2, device=model.device)
        depth = sensor.utils.create_depth_image_output(*SIZE, camera_count=2)
        shape = sensor.utils.create_shape_index_image_output(*SIZE, camera_count=2)
        color = sensor.utils.create_color_image_output(*SIZE, camera_count=2)
        model.bvh_refit_shapes(state)
        sensor.update(
            state, transforms, rays, depth_image=depth, shape_index_image=shape, color_image=color,
            clear_data=TheirTiled.GRAY_CLEAR_DATA,
        )  # fmt: skip
        assert depth.shape == (3, 2, SIZE[1], SIZE[0])
        images.append((depth.numpy(), shape.numpy(), color.numpy()))
    (their_depth, their_shape, their_color), (depth, shape, color) = images
    same = shape == their_shape
    assert same.mean() > 0.995
    np.testing.assert_allclose(depth[same], their_depth[same], atol=2e-3)
    miss = same & (shape == 0xFFFFFFFF)
    assert miss.any() and (color[miss] == their_color[miss]).all()


def test_what_is_not_offered_is_refused_by_name(worlds: tuple[Any, Any]) -> None:
    model, state = worlds
    sensor = SensorCamera(model)
    transforms = look_from([(2.0, -2.0, 1.0)] * 3, model.device)
    depth = sensor.allocate_image_depth(3, *SIZE)
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.8, device=model.device)
    config = SensorCamera.RenderConfig(texture_projection_mode=2)
    with pytest.raises(wc.WarpcamError, match="Invalid texture_projection_mode: 2"):
        sensor.update(state, transforms, rays, depth_image=depth, render_config=config)
    with pytest.raises(wc.WarpcamError, match=r"direction must be finite and not zero, got \(0, 0, 0\)"):
        sensor.create_default_light(direction=(0, 0, 0))
    with pytest.raises(wc.WarpcamError, match="depth_image shape must be"):
        sensor.update(state, transforms, rays, depth_image=sensor.allocate_image_depth(2, *SIZE))
    with pytest.raises(wc.WarpcamError, match=r"state must be a newton\.State, got NoneType"):
        sensor.update(None, transforms, rays, depth_image=depth)


FISHEYES = {
    "fisheye_opencv": ((4.5, 4.7, 12.5, 8.0), {"k1": 0.02, "max_fov": 6.0}),
    "fisheye_ftheta": ((12.0, 8.0), {"k1": 6.5, "k3": 0.1, "max_fov": 6.0}),
    "fisheye_kannala_brandt": ((12.0, 8.5), {"k0": 6.0, "k1": 0.3}),
    "pinhole_opencv": ((20.0, 20.0, 12.0, 8.0), {"k1": -0.1, "k2": 0.02, "p1": 0.01, "p2": -0.01}),
}


@pytest.mark.parametrize("helper", FISHEYES)
def test_wide_and_distorted_rays_are_newtons_own(worlds: tuple[Any, Any], helper: str) -> None:
    """All of Newton's helpers, and what lies behind the camera."""
    model, state = worlds
    numbers, settings = FISHEYES[helper]
    positions = [(1.0, -1.0, 0.9), (0.5, -1.2, 1.2), (-0.8, -0.7, 1.0)]
    found = []
    for kind in (TheirCamera, SensorCamera):
        sensor = kind(model)
        sensor.create_default_light()
        rays = getattr(kind, f"compute_camera_rays_{helper}")(*SIZE, *numbers, **settings, device=model.device)
        images = {name: getattr(sensor, f"allocate_image_{what}")(3, *SIZE) for name, what in IMAGES.items()}
        model.bvh_refit_shapes(state)
        sensor.update(state, look_from(positions, model.device), rays, **images)
        found.append({name: image.numpy().copy() for name, image in images.items()})
    theirs, mine = found
    same = mine["shape_index_image"] == theirs["shape_index_image"]
    assert same.mean() > 0.99 and len(np.unique(theirs["shape_index_image"])) > 3
    for name in ("depth_image", "forward_depth_image", "normal_image"):
        np.testing.assert_allclose(mine[name][same], theirs[name][same], atol=2e-3, rtol=1e-3, err_msg=name)
    for name in ("color_image", "albedo_image"):
        channels = [images[name].view(np.uint8).reshape(*images[name].shape, 4)[same] for images in (mine, theirs)]
        assert np.percentile(np.abs(channels[0].astype(int) - channels[1]), 99) <= 2, name
    if helper == "fisheye_opencv":
        assert (theirs["forward_depth_image"] < 0.0).any()  # or nothing behind was looked at


def test_a_camera_within_a_solid_sees_out(device: wp.Device) -> None:
    """Newton's own camera sees the inside of solids, except for cones and meshes."""
    seen = {}
    for kind, add in (
        ("box", lambda builder: builder.add_shape_box(-1, hx=1.0, hy=1.0, hz=1.0)),
        ("mesh", lambda builder: builder.add_shape_mesh(-1, mesh=newton.Mesh.create_box(1.0, compute_inertia=False))),
    ):
        builder = newton.ModelBuilder()
        builder.add_shape_plane(plane=(0.0, 0.0, 1.0, 3.0), width=0.0, length=0.0)
        add(builder)
        model, state = newton_scenes.finalize(builder, device)
        transforms = wp.array([wp.transform_identity()], dtype=wp.transformf, device=model.device)
        for camera in (TheirCamera, SensorCamera):
            sensor = camera(model)
            rays = camera.compute_camera_rays_pinhole(8, 8, camera_fov=0.8, device=model.device)
            image = sensor.allocate_image_shape_index(1, 8, 8)
            sensor.update(state, transforms, rays, shape_index_image=image)
            seen[kind, camera] = set(np.unique(image.numpy()))
    assert seen["box", SensorCamera] == seen["mesh", SensorCamera] == seen["mesh", TheirCamera] == {0}
    assert seen["box", TheirCamera] == {1}  # else the page on this sensor is to be changed
