"""Gaussian splats: against closed forms, against every Gaussian for every pixel, against Newton's own camera."""

from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.accel.gaussians import GaussianCloud, pack_gaussians
from warpcam.core.color import encoded_beyond, srgb_to_linear

newton = pytest.importorskip("newton")
import splat_scenes  # noqa: E402, newton may be missing
from newton.sensors import SensorCamera  # noqa: E402
from newton_scenes import finalize, pose  # noqa: E402
from splat_scenes import FOVY, Placed, eye, gaussians, nothing, random_gaussians, reference, shown  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

RED, GREEN, GREY = (0.9, 0.1, 0.2), (0.1, 0.8, 0.3), np.array((0.2, 0.4, 0.6))
STEP = 1.0 / 255.0


def model_of(*clouds: Placed, builder: Any = None, device: Any = None) -> tuple[Any, Any]:
    builder = builder or newton.ModelBuilder()
    for cloud in clouds:
        xform = pose(*cloud.position, np.asarray(cloud.rotation))
        builder.add_shape_gaussian(-1, gaussian=cloud.source, xform=xform)
    model, state = finalize(builder, device)
    scenes.write(model.shape_scale, slice(model.shape_count - len(clouds), None), [cloud.scale for cloud in clouds])
    return model, state


def see(
    *clouds: Placed, device: wp.Device, camera: wc.Camera | None = None, builder: Any = None
) -> dict[str, np.ndarray]:
    scene = wc.from_newton(*model_of(*clouds, builder=builder, device=device))
    return {name: image[0] for name, image in shown(scenes.look(scene, camera or eye())).items()}


def check(seen: dict[str, np.ndarray], expected: dict[str, np.ndarray], tolerance: float = 2.0 * STEP) -> None:
    """Colours everywhere; the surface wherever rounding does not decide which Gaussian it is."""
    assert np.abs(seen["hdr"] - expected["hdr"]).max() < tolerance
    assert np.abs(seen["rgb"] * STEP - np.clip(expected["hdr"], 0.0, 1.0)).max() < tolerance + STEP
    sure = expected["halves"] > 1e-4
    assert sure.mean() > 0.9
    assert (seen["segmentation"] == expected["segmentation"])[sure].all()
    finite = sure & np.isfinite(expected["depth"])
    assert (np.isinf(seen["depth"]) == np.isinf(expected["depth"]))[sure].all()
    assert seen["depth"][finite] == pytest.approx(expected["depth"][finite], rel=1e-4)
    assert (seen["normals"] * expected["normals"]).sum(-1)[finite] == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("opacity", [0.3, 0.8, 1.0])
def test_one_gaussian(device: wp.Device, opacity: float) -> None:
    size = 0.3
    seen = see(Placed(gaussians(np.zeros((1, 3)), [RED], scales=size, opacities=opacity)), device=device)
    origins, directions, _ = splat_scenes.rays(eye())
    t = -(origins * directions).sum(-1) / (directions**2).sum(-1)
    offset = np.linalg.norm(origins + t[..., None] * directions, axis=-1)
    response = np.exp(-0.5 * (offset / size) ** 2)
    alpha = np.where((response > 0.01) & (opacity * response > STEP), opacity * response, 0.0)[..., None]
    assert np.abs(seen["hdr"] - (alpha * RED + (1.0 - alpha) * GREY)).max() < 1e-5
    assert seen["hdr"][12, 16] == pytest.approx(opacity * np.array(RED) + (1.0 - opacity) * GREY, abs=1e-5)
    assert np.abs(seen["rgba"][..., 3] * STEP - alpha[..., 0]).max() < STEP
    surface = alpha[..., 0] >= 0.5
    assert (seen["segmentation"] == np.where(surface, 0, -1)).all()
    assert surface.any() == (opacity > 0.5)
    assert seen["depth"][surface] == pytest.approx(t[surface], rel=1e-5)
    assert np.isinf(seen["depth"][~surface]).all()
    assert seen["distance"][surface] == pytest.approx((t * np.linalg.norm(directions, axis=-1))[surface], rel=1e-5)
    assert seen["points"][surface] == pytest.approx((origins + t[..., None] * directions)[surface], abs=1e-5)


def test_two_gaussians_in_either_order(device: wp.Device) -> None:
    near, far = (0.0, -0.5, 0.0), (0.0, 0.5, 0.0)
    for places, colors in (((near, far), (RED, GREEN)), ((far, near), (GREEN, RED))):
        seen = see(Placed(gaussians(places, colors, opacities=0.6)), device=device)
        expected = 0.6 * np.array(RED) + 0.4 * 0.6 * np.array(GREEN) + 0.16 * GREY
        assert seen["hdr"][12, 16] == pytest.approx(expected, abs=1e-5)
        assert seen["depth"][12, 16] == pytest.approx(3.5, rel=1e-5)
    thin = see(Placed(gaussians((near, far), (RED, GREEN), opacities=0.4)), device=device)
    assert thin["depth"][12, 16] == pytest.approx(4.5, rel=1e-5)


@pytest.mark.parametrize("at", [-1.0, 1.0])
def test_before_and_behind_a_box(device: wp.Device, at: float) -> None:
    """The box has its front at y = 0."""
    builder = newton.ModelBuilder()
    builder.add_shape_box(-1, hx=1.0, hy=0.5, hz=1.0, xform=pose(0.0, 0.5, 0.0))
    cloud = Placed(gaussians([(0.0, at, 0.0)], [RED]))
    camera = eye(outputs=("rgb", "depth", "segmentation", "albedo"))
    alone = {name: image[0] for name, image in scenes.look(wc.from_newton(*finalize(builder, device)), camera).items()}
    seen = see(cloud, device=device, camera=camera, builder=builder)
    if at > 0.0:
        inside = alone["segmentation"] == 0
        assert (seen["rgb"] == alone["rgb"])[inside].all()
        assert (seen["depth"] == alone["depth"])[inside].all()
        return
    middle = 0.8 * np.array(RED) + 0.2 * alone["rgb"][12, 16] * STEP
    assert seen["rgb"][12, 16] * STEP == pytest.approx(middle, abs=STEP)
    assert seen["albedo"][12, 16] * STEP == pytest.approx(
        0.8 * np.array(RED) + 0.2 * alone["albedo"][12, 16] * STEP, abs=STEP
    )
    assert (seen["depth"][12, 16], seen["segmentation"][12, 16]) == (pytest.approx(3.0, rel=1e-5), 1)
    outside = (
        np.exp(-0.5 * (np.hypot(*np.mgrid[-12:13, -16:17]) * 3.0 * 2.0 * np.tan(np.radians(FOVY / 2)) / 25 / 0.3) ** 2)
        < 0.005
    )
    assert (seen["rgb"] == alone["rgb"])[outside].all()


@pytest.mark.parametrize("lens", [wc.Pinhole(fovy=FOVY), wc.Orthographic(height=3.0)])
def test_flat_gaussians_turned(device: wp.Device, lens: wc.Lens) -> None:
    turned = np.array([(0.3, -0.2, 0.5, 0.8), (0.9, 0.1, -0.3, 0.2)])
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    source = gaussians(
        [(-0.4, 0.0, 0.1), (0.4, 0.3, -0.2)],
        (RED, GREEN),
        scales=[(0.4, 0.02, 0.2), (0.05, 0.3, 0.3)],
        rotations=turned,
        opacities=0.95,
    )
    camera = eye(lens=lens)
    check(see(Placed(source), device=device, camera=camera), reference([Placed(source)], camera, nothing(camera)), 1e-3)


@pytest.mark.parametrize(("count", "size"), [(200, 0.15), (200, 0.5), (3000, 0.06)])
def test_every_gaussian_for_every_pixel(device: wp.Device, count: int, size: float) -> None:
    cloud = Placed(random_gaussians(count, seed=count, size=size))
    check(see(cloud, device=device), reference([cloud], eye(), nothing(eye())))


def test_clouds_within_each_other(device: wp.Device) -> None:
    """Scaled along their axes, mirrored, turned; one source twice."""
    one, other = random_gaussians(150, seed=1), random_gaussians(90, seed=2)
    clouds = [
        Placed(one, (0.2, 0.1, 0.0), (0.1, 0.2, 0.3, 0.9), (0.5, 1.2, 0.8)),
        Placed(other, (-0.2, 0.3, 0.1), (0.5, 0.2, -0.3, 0.4), (1.0, -0.7, 1.1), shape=1),
        Placed(one, (-0.3, -0.3, 0.2), (0.0, 0.0, 1.0, 0.2), (0.6, 0.6, 0.6), shape=2),
    ]
    check(see(*clouds, device=device), reference(clouds, eye(), nothing(eye())))


def test_many_at_one_place(device: wp.Device) -> None:
    """More hits at the same depth than a ray keeps at once."""
    source = gaussians(np.zeros((150, 3)), np.full((150, 3), 0.7), opacities=0.02, least=0.3)
    seen = see(Placed(source), device=device)
    assert seen["hdr"][12, 16] == pytest.approx(0.7 + 0.98**150 * (GREY - 0.7), abs=1e-4)


def test_worlds_have_their_own_poses_scales_and_opacities(device: wp.Device) -> None:
    source = random_gaussians(60, seed=4, size=0.3)
    robot = newton.ModelBuilder()
    body = robot.add_body(label="carrier")
    robot.add_shape_gaussian(body, gaussian=source)
    worlds = newton.ModelBuilder()
    worlds.replicate(robot, 3)
    model, state = finalize(worlds, device)
    scene = wc.from_newton(model, state)
    assert len(scene._parts.clouds) == 1
    renderer = wc.Renderer(scene, [eye()])
    renderer.render()
    places = [
        ((0.2, 0.0, 0.1), (0.3, 0.1, -0.2, 0.9)),
        ((-0.4, 0.5, 0.0), (0, 0, 1, 1)),
        ((0.0, 1.0, 0.2), (1, 0, 0, 1)),
    ]
    scenes.write(state.body_q, slice(None), [pose(*position, np.array(turn, float)) for position, turn in places])
    scales = [(1.0, 1.0, 1.0), (0.5, 0.8, 1.2), (1.3, 1.3, 1.3)]
    scenes.write(model.shape_scale, slice(None), scales)
    scenes.write(model.shape_opacity, slice(None), (1.0, 0.6, 1.0))
    seen = shown(scenes.on_host(renderer.render()["eye"]))
    for world, (position, turn) in enumerate(places):
        cloud = Placed(source, position, turn, scales[world], (1.0, 0.6, 1.0)[world], world)
        check({name: image[world] for name, image in seen.items()}, reference([cloud], eye(), nothing(eye())))
    scenes.write(model.shape_flags, 1, 0)
    scenes.write(state.body_q, (2, 0), np.nan)
    seen = scenes.on_host(renderer.render()["eye"])
    assert renderer.faulty.tolist() == [0, 0, 1]
    assert (seen["segmentation"][1:] == -1).all() and (seen["segmentation"][0] == 0).any()
    assert (seen["rgb"][1:] == (51, 102, 153)).all()


def test_chosen_worlds_and_graphs(device: wp.Device) -> None:
    robot = newton.ModelBuilder()
    robot.add_shape_gaussian(robot.add_body(), gaussian=random_gaussians(40, seed=5))
    robot.add_shape_sphere(-1, radius=0.4)
    worlds = newton.ModelBuilder()
    worlds.replicate(robot, 3)
    model, state = finalize(worlds, device)
    renderer = wc.Renderer(wc.from_newton(model, state), [eye()])
    before = scenes.on_host(renderer.render()["eye"])
    scenes.write(state.body_q, (slice(None), 2), 0.5)
    with wp.ScopedCapture(device) as capture:
        renderer.render(worlds=wp.array([0, 1, 0], dtype=wp.uint8, device=device))
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    replayed = scenes.on_host(renderer.images["eye"])
    after = scenes.on_host(renderer.render(worlds=[1])["eye"])
    for name, image in after.items():
        assert (image[[0, 2]] == before[name][[0, 2]]).all(), name
        assert (image == replayed[name]).all(), name
    assert (after["rgb"][1] != before["rgb"][1]).any()


def test_depth_alone_and_its_clipping(device: wp.Device) -> None:
    cloud = Placed(random_gaussians(200, seed=6, size=0.4))
    full = see(cloud, device=device)
    camera = eye(outputs=("depth", "bodies"), far=20.0, depth_clipping="max")
    seen = see(cloud, device=device, camera=camera)
    assert (seen["depth"] == np.where(np.isinf(full["depth"]), 20.0, full["depth"])).all()
    near = see(cloud, device=device, camera=eye(near=4.0))
    assert near["depth"].min() > 4.0


def test_against_newtons_own_camera(device: wp.Device) -> None:
    """Both cameras see the same where hardly any light comes through.

    Elsewhere Newton shows either a solid cloud, if 51 % of the light is lost, or what is behind: the surfaces are the
    same but where it is about half.
    """
    some = random_gaussians(300, seed=7, size=0.25)
    source = newton.Gaussian(
        some.positions, some.rotations, some.scales, np.ones(300), np.abs(some.sh_coeffs), min_response=0.1
    )
    builder = newton.ModelBuilder()
    builder.add_shape_box(-1, hx=3.0, hy=0.1, hz=0.6, xform=pose(0.0, 0.2, 0.0))
    camera = eye(width=48, height=32)
    box = shown(scenes.look(wc.from_newton(*finalize(builder, device)), camera))
    expected = reference([Placed(source, shape=1)], camera, {name: image[0] for name, image in box.items()})
    model, state = model_of(Placed(source), builder=builder, device=device)
    seen = {name: image[0] for name, image in shown(scenes.look(wc.from_newton(model, state), camera)).items()}
    check(seen, expected)

    sensor = SensorCamera(model)
    config = SensorCamera.RenderConfig(gaussians_max_num_hits=64)
    w, *xyz = (float(value) for value in camera.rotation)
    view = wp.array([wp.transform(wp.vec3(*camera.position), wp.quat(*xyz, w))], dtype=wp.transformf, device=device)
    size = (1, camera.width, camera.height)
    depth, shape = sensor.allocate_image_depth_forward(*size), sensor.allocate_image_shape_index(*size)
    color = sensor.allocate_image_color(*size)
    model.bvh_refit_shapes(state)
    rays = SensorCamera.compute_camera_rays_pinhole(*size[1:], camera_fov=np.radians(FOVY), device=device)
    sensor.update(
        state, view, rays, forward_depth_image=depth, shape_index_image=shape, color_image=color, render_config=config
    )
    ids, theirs = shape.numpy()[0].astype(np.int64), depth.numpy()[0]
    sure = expected["halves"] > 0.02
    assert sure.mean() > 0.8
    assert (seen["segmentation"] == np.where(ids < 2, ids, -1))[sure].mean() > 0.999
    hit = sure & (seen["segmentation"] == 1)
    assert seen["depth"][hit] == pytest.approx(theirs[hit], rel=1e-4)
    dense = hit & (expected["light"] < 0.002)
    assert dense.sum() > 50
    rgb = np.stack([color.numpy()[0] >> shift & 255 for shift in (0, 8, 16)], axis=-1).astype(int)
    assert np.abs(seen["rgb"].astype(int) - rgb)[dense].max() <= 2


def test_linear_colours_are_shown_encoded(device: wp.Device) -> None:
    linear = np.array((0.5, 0.1, 0.001))
    source = newton.Gaussian(
        np.zeros((1, 3)),
        sh_coeffs=((linear - 0.5) / splat_scenes.BASE)[None],
        sh_color_space=newton.utils.ColorSpace.LINEAR,
    )
    seen = see(Placed(source), device=device)
    assert seen["rgb"][12, 16] == pytest.approx((188, 89, 3), abs=1)


def test_tone_mapping_is_refused(device: wp.Device) -> None:
    """Colours of clouds are those of a display already."""
    robot = newton.ModelBuilder()
    robot.add_shape_gaussian(-1, gaussian=gaussians(np.zeros((1, 3)), [RED], opacities=0.6))
    scene = wc.from_newton(*finalize(robot, device))
    with pytest.raises(wc.WarpcamError, match="tone_mapping is 'aces', and the scene has clouds of Gaussians"):
        wc.Renderer(scene, [eye(tone_mapping="aces")])


def test_exposure_and_gain_of_each_world(device: wp.Device) -> None:
    """A cloud's colour is light as well: with what is behind exposed likewise, and its opacity as it is."""
    robot = newton.ModelBuilder()
    robot.add_shape_gaussian(-1, gaussian=gaussians(np.zeros((1, 3)), [RED], opacities=0.6))
    worlds = newton.ModelBuilder()
    worlds.replicate(robot, 3)
    scene = wc.from_newton(*finalize(worlds, device))
    outputs = ("rgb", "rgba", "hdr", "albedo")
    plain = scenes.look(scene, eye(outputs=outputs))
    renderer = wc.Renderer(scene, [eye(outputs=outputs, exposure=0.0, gain=1.0)])
    same = scenes.on_host(renderer.render()["eye"])
    assert np.abs(same["hdr"] - plain["hdr"]).max() < 1e-5
    for name in ("rgb", "rgba", "albedo"):
        assert np.abs(same[name].astype(int) - plain[name]).max() <= 1, name
    front = renderer.camera("eye")
    front.exposure[1] = -1.0
    front.gain[1, 2] = 0.5
    seen = scenes.on_host(renderer.render()["eye"])
    gains = np.array((0.5, 0.5, 0.25))
    splat, behind = (encoded_beyond(gains * srgb_to_linear(np.array(color))) for color in (RED, GREY))
    middle = 0.6 * splat + 0.4 * behind
    assert seen["rgb"][1, 12, 16] * STEP == pytest.approx(middle, abs=2.0 * STEP)
    assert seen["rgba"][1, 12, 16, :3] * STEP == pytest.approx(middle, abs=2.0 * STEP)
    assert seen["hdr"][1, 12, 16] == pytest.approx(srgb_to_linear(middle), abs=1e-4)
    assert (seen["rgba"][..., 3] == same["rgba"][..., 3]).all()
    assert (seen["albedo"] == same["albedo"]).all()
    for world in (0, 2):
        assert (seen["rgb"][world] == same["rgb"][world]).all() and (seen["hdr"][world] == same["hdr"][world]).all()
    front.exposure[2] = 4.0
    bright = scenes.on_host(renderer.render()["eye"])
    assert bright["hdr"][2, 12, 16, 0] > 1.0 and bright["rgb"][2, 12, 16, 0] == 255


def test_colours_are_blended_once_behind_transparent_shapes(device: wp.Device) -> None:
    """Colour and albedo come from two traces then."""
    builder = newton.ModelBuilder()
    pane = builder.add_shape_box(-1, hx=1.0, hy=0.05, hz=1.0, xform=pose(0.0, 0.5, 0.0))
    model, state = model_of(Placed(gaussians(np.zeros((1, 3)), [RED], opacities=0.6)), builder=builder, device=device)
    scenes.write(model.shape_opacity, pane, 0.5)
    scene = wc.from_newton(model, state)
    both = scenes.look(scene, eye(outputs=("rgb", "albedo", "depth")))
    alone = scenes.look(scene, eye(outputs=("albedo", "depth")))
    assert scene.tables().layers is not None
    for name in ("albedo", "depth"):
        np.testing.assert_array_equal(both[name], alone[name])


def test_hardly_any_gaussian_can_be_seen(device: wp.Device) -> None:
    """Transparent ones and flat ones."""
    source = gaussians(
        np.zeros((3, 3)), [RED] * 3, opacities=(0.003, 1.0, 0.0), scales=[(1, 1, 1), (1, 0, 1), (1, 1, 1)]
    )
    seen = see(Placed(source), device=device)
    assert (seen["rgb"] == (51, 102, 153)).all()
    assert (seen["segmentation"] == -1).all()


def test_bounds_and_memory(device: wp.Device) -> None:
    source = gaussians([(1.0, 0.0, 0.0)], [RED], scales=0.1, opacities=1.0, least=float(np.exp(-2.0)))
    scene = wc.from_newton(*model_of(Placed(source, (0.0, 0.0, 1.0), scale=(1.0, 2.0, 1.0)), device=device))
    low, high = scene.bounds()
    assert low == pytest.approx((0.8, -0.4, 0.8), abs=1e-4)
    assert high == pytest.approx((1.2, 0.4, 1.2), abs=1e-4)
    memory = wc.estimate_memory(scene, [eye(outputs=("rgb",))])
    assert memory.scratch >= 33 * 25 * (4 + 1)  # depth and shape, which the trace leaves for the clouds


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions": [(0.0, np.nan, 0.0)]}, r"positions must be finite and below 1e\+18, got .* at Gaussian 0"),
        ({"opacities": [np.inf]}, r"opacities must be finite and below 1e\+18, got inf at Gaussian 0"),
        ({"rotations": [(0.0, 0.0, 0.0, 0.0)]}, "rotations must be quaternions of any length but 0"),
    ],
)
def test_bad_gaussians_are_named(device: wp.Device, changes: dict[str, Any], message: str) -> None:
    values = {"positions": np.zeros((1, 3)), **changes}
    cloud = GaussianCloud(
        name="garden",
        positions=np.asarray(values["positions"], np.float32),
        rotations=np.asarray(values.get("rotations", [(1.0, 0.0, 0.0, 0.0)]), np.float32),
        scales=np.ones((1, 3), np.float32),
        opacities=np.asarray(values.get("opacities", [1.0]), np.float32),
        colors=np.ones((1, 3), np.float32),
        least_response=0.1,
    )
    with pytest.raises(wc.WarpcamError, match="splats 'garden': " + message):
        pack_gaussians([cloud], [0], device)


def test_too_many_clouds_are_counted(device: wp.Device) -> None:
    with pytest.raises(wc.WarpcamError, match="splats: 129 shapes came, at most 128 are allowed"):
        pack_gaussians([], range(129), device)
