"""Point clouds of cameras: what they show, merged, in other frames, and beside other worlds."""

import re
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors

WORLDS = 3
LABELS = ("rgb", "normals", "segmentation", "bodies")
LAST = 24 * 20  # pixels of a camera


def eye(name: str = "eye", **options: Any) -> wc.Camera:
    own: dict[str, Any] = {"lens": wc.Pinhole(fovy=60.0), "position": (0.3, 0.1, 0.0), "parent": 1, **options}
    return camera(name, **{"outputs": ("points", "depth", *LABELS), **own})


def drawn(device: wp.Device, *cameras: wc.Camera, worlds: int = WORLDS) -> wc.Renderer:
    both = (camera("top", outputs=("points", *LABELS)), camera("side", outputs=("points", *LABELS)))
    renderer = wc.Renderer(scene_of(device, worlds), cameras or both)
    renderer.render()
    return renderer


def host(cloud: dict[str, torch.Tensor]) -> dict[str, np.ndarray]:
    return {name: values.cpu().numpy().copy() for name, values in cloud.items()}


def image(renderer: wc.Renderer, name: str, output: str) -> np.ndarray:
    """An image as (world, pixel, channel)."""
    values = renderer.images[name][output].cpu().numpy()
    return values.reshape(len(values), -1, values.shape[-1])


def says(text: str) -> Any:
    return pytest.raises(wc.WarpcamError, match=re.escape(text))


def test_cameras_are_merged_with_what_belongs_to_their_pixels(device: wp.Device) -> None:
    renderer = drawn(device)
    clouds = sensors.PointClouds(renderer, num_points=2 * LAST, method="first", padding="zeros", attributes=LABELS)
    cloud = host(clouds.read())
    both = {
        name: np.concatenate([image(renderer, key, name) for key in ("top", "side")], axis=1)
        for name in ("points", *LABELS)
    }
    for world in range(WORLDS):
        pixels = np.flatnonzero(np.isfinite(both["points"][world]).all(axis=1))
        count = cloud["count"][world]
        assert count == len(pixels) and (pixels < LAST).any() and (pixels >= LAST).any()
        np.testing.assert_array_equal(cloud["pixels"][world, :count], pixels)
        for name, values in both.items():
            np.testing.assert_array_equal(cloud[name][world, :count].reshape(count, -1), values[world][pixels])
            rest = -1 if name in ("segmentation", "bodies") else 0
            assert (cloud[name][world, count:] == rest).all()
    assert {name: (values.dtype, values.shape[2:]) for name, values in cloud.items() if name in LABELS} == {
        "rgb": (np.uint8, (3,)),
        "normals": (np.float32, (3,)),
        "segmentation": (np.int32, ()),
        "bodies": (np.int32, ()),
    }


def test_cameras_that_are_named_in_their_order(device: wp.Device) -> None:
    renderer = drawn(device)
    cloud = host(sensors.PointClouds(renderer, ("side", "top"), num_points=2 * LAST, method="first").read())
    alone = host(sensors.PointClouds(renderer, ("side",), num_points=2 * LAST, method="first").read())
    for world, count in enumerate(alone["count"]):
        assert count < cloud["count"][world]
        np.testing.assert_array_equal(cloud["points"][world, :count], alone["points"][world, :count])


@pytest.mark.parametrize("method", ["farthest", "uniform"])
def test_clouds_are_the_same_among_more_worlds(device: wp.Device, method: Any) -> None:
    options: dict[str, Any] = {"num_points": 50, "method": method, "voxel_size": 0.05, "attributes": LABELS}
    renderer = drawn(device)
    cloud = host(sensors.PointClouds(renderer, **options).read())
    images = {
        key: {name: tensor[:1].clone() for name, tensor in shown.items()} for key, shown in renderer.images.items()
    }
    single = sensors.PointClouds(drawn(device, worlds=1), images=images, **options)
    for name, values in host(single.read()).items():
        np.testing.assert_array_equal(values[0], cloud[name][0])


@pytest.mark.parametrize(
    "lens", [wc.Pinhole(fovy=60.0), wc.Pinhole(fx=20.0, fy=24.0, cx=11.0, cy=12.5), wc.Orthographic(height=3.0)]
)
@pytest.mark.parametrize("clipping", ["none", "max", "zero"])
def test_points_of_depth_are_those_of_the_trace(device: wp.Device, lens: Any, clipping: Any) -> None:
    options: dict[str, Any] = {"lens": lens, "depth_clipping": clipping, "far": 3.2, "near": 0.05}
    renderer = drawn(device, eye(position=(0.0, 0.1, 2.0), **options))
    found = {}
    for positions in ("points", "depth"):
        clouds = sensors.PointClouds(renderer, num_points=LAST, method="first", positions=positions, padding="zeros")
        found[positions] = host(clouds.read())
    np.testing.assert_array_equal(found["depth"]["pixels"], found["points"]["pixels"])
    np.testing.assert_allclose(found["depth"]["points"], found["points"]["points"], atol=1e-5)
    assert (found["points"]["count"] > 0).all() and (found["points"]["count"] < LAST).all()


@pytest.mark.parametrize("given", ["rig", "images"])
def test_depth_that_was_measured(device: wp.Device, given: str) -> None:
    renderer = drawn(device, eye(position=(0.0, 0.5, 3.0), outputs=("depth", "points")))
    limits = sensors.DepthRange(min=0.5, max=4.0, invalid=0.0)
    rig = sensors.Rig(renderer, {"eye": [limits]})
    options: dict[str, Any] = {"num_points": LAST, "method": "first", "frame": "eye", "padding": "zeros"}
    if given == "rig":
        clouds, truth = sensors.PointClouds(rig, **options), sensors.PointClouds(rig, positions="points", **options)
    else:
        clouds = sensors.PointClouds(renderer, images=rig.images, **options)
        truth = sensors.PointClouds(renderer, **options)
    rig.read()
    assert (truth.read()["count"] == LAST).all()
    cloud, depth = host(clouds.read()), image(renderer, "eye", "depth")
    for world in range(WORLDS):
        pixels = np.flatnonzero(depth[world, :, 0] <= 4.0)
        assert cloud["count"][world] == len(pixels) > 0
        np.testing.assert_allclose(-cloud["points"][world, : len(pixels), 2], depth[world, pixels, 0], rtol=1e-5)


def test_the_frame_of_a_camera_and_of_a_body(device: wp.Device) -> None:
    """A camera that turns with a body: both frames are found from the points in the world."""
    turn = (0.9, 0.3, -0.2, 0.1)
    renderer = drawn(device, eye(position=(0.0, 0.5, 3.0), rotation=turn), eye("other", position=(0.0, 0.0, 4.0)))
    options: dict[str, Any] = {
        "num_points": 2 * LAST,
        "method": "first",
        "attributes": ("normals",),
        "padding": "zeros",
    }
    world = host(sensors.PointClouds(renderer, **options).read())
    scene = renderer.scene
    body = scene.array("body_positions").numpy()[:, 1], scene.array("body_rotations").numpy()[:, 1]
    views = renderer._passes["eye"].views.numpy()
    frames = {("body", 1): body, "eye": (views["origin"], views["rotation"])}
    for frame, (origins, rotations) in frames.items():
        cloud = host(sensors.PointClouds(renderer, frame=frame, **options).read())
        np.testing.assert_array_equal(cloud["pixels"], world["pixels"])
        for number in range(WORLDS):
            count = world["count"][number]
            moved = (world["points"][number, :count] - origins[number]) @ rotations[number]
            np.testing.assert_allclose(cloud["points"][number, :count], moved, atol=2e-6)
            turned = world["normals"][number] @ rotations[number]
            np.testing.assert_allclose(cloud["normals"][number], turned, atol=1e-6)


def test_bounds_are_in_the_frame(device: wp.Device) -> None:
    renderer = drawn(device)
    low, high = (-0.5, -0.5, -4.5), (0.5, 0.25, -0.5)
    clouds = sensors.PointClouds(renderer, frame="top", bounds=(low, high), num_points=LAST, padding="zeros")
    cloud = host(clouds.read())
    for world, count in enumerate(cloud["count"]):
        points = cloud["points"][world, :count]
        assert 0 < count < LAST and (points >= np.float32(low)).all() and (points <= np.float32(high)).all()


def test_excluded_ids(device: wp.Device) -> None:
    renderer = drawn(device)
    clouds = sensors.PointClouds(
        renderer, num_points=2 * LAST, method="first", attributes=("bodies", "segmentation"), padding="zeros",
        exclude={"bodies": (0,), "segmentation": [0, 77]},
    )  # fmt: skip
    cloud = host(clouds.read())
    for world, count in enumerate(cloud["count"]):
        shown = [image(renderer, key, "bodies")[world] for key in ("top", "side")]
        geoms = [image(renderer, key, "segmentation")[world] for key in ("top", "side")]
        bodies, geoms = np.concatenate(shown)[:, 0], np.concatenate(geoms)[:, 0]
        pixels = np.flatnonzero((bodies > 0) & (geoms != 0) & (geoms >= 0))
        np.testing.assert_array_equal(cloud["pixels"][world, :count], pixels)
        assert count == len(pixels) > 0


def test_a_frame_after_the_state_has_changed(device: wp.Device) -> None:
    """Clouds follow the images and a body's pose, in the worlds that are read."""
    renderer = drawn(device, eye(position=(0.0, 0.5, 3.0)))
    clouds = sensors.PointClouds(renderer, num_points=64, frame=("body", 1), attributes=("segmentation",))
    before = host(clouds.read())
    positions = renderer.scene.array("body_positions")
    moved = positions.numpy()
    moved[:, 1, 1] += 0.25
    positions.assign(moved)
    renderer.render()
    after = host(clouds.read([0, 2]))
    fresh = sensors.PointClouds(renderer, num_points=64, frame=("body", 1), attributes=("segmentation",))
    expected = host(fresh.read())
    for name, values in after.items():
        np.testing.assert_array_equal(values[1], before[name][1])
        np.testing.assert_array_equal(values[[0, 2]], expected[name][[0, 2]])
    assert (after["points"][0] != before["points"][0]).any()


def test_a_world_that_shows_nothing_is_empty(device: wp.Device) -> None:
    renderer = drawn(device, eye(position=(0.0, 0.0, 9.0), rotation=(0.0, 1.0, 0.0, 0.0), parent=None))
    for method in ("farthest", "uniform", "first"):
        clouds = sensors.PointClouds(renderer, num_points=40, method=method, voxel_size=0.1, attributes=LABELS)
        cloud = host(clouds.read())
        assert not cloud["count"].any() and not cloud["points"].any() and not cloud["rgb"].any()
        assert (cloud["pixels"] == -1).all() and (cloud["segmentation"] == -1).all()


def test_a_read_compiles_nothing(device: wp.Device, loads: list[str]) -> None:
    renderer = drawn(device)
    clouds = sensors.PointClouds(renderer, num_points=40, voxel_size=0.1, frame="top", attributes=LABELS)
    del loads[:]
    clouds.read()
    clouds.read([0])
    clouds.reset()
    assert not loads


def test_a_captured_frame(device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("needs CUDA: graphs")
    renderer = drawn(device)
    clouds = sensors.PointClouds(renderer, num_points=40, voxel_size=0.1, frame=("body", 1), attributes=LABELS)
    clouds.read()
    with wp.ScopedCapture(device=device) as capture:
        renderer.render()
        clouds.read()
    positions = renderer.scene.array("body_positions")
    moved = positions.numpy()
    moved[:, 1, 1] += 0.25
    positions.assign(moved)
    wp.capture_launch(capture.graph)
    replayed = host(clouds.cloud)
    for name, values in host(clouds.read()).items():
        np.testing.assert_array_equal(values, replayed[name])


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"cameras": ("front",)}, "cameras has 'front', the renderer has 'top', 'side'"),
        ({"cameras": "top"}, "cameras must be names of some of 'top', 'side', or None for all, got 'top'"),
        ({"cameras": ()}, "cameras must be names of some of 'top', 'side', or None for all, got ()"),
        ({"cameras": ("top", "top")}, "cameras has 'top' more than once"),
        ({"num_points": 0}, "num_points must be a whole number, at least 1 and below 2^31, got 0"),
        ({"num_points": 2.0}, "num_points must be a whole number"),
        ({"num_points": 2**30}, "num_points must be below 2^31 in all 3 worlds together, got 1073741824 for each"),
        ({"method": "fps"}, "method must be one of farthest, uniform, first, got 'fps'"),
        ({"padding": None}, "padding must be one of repeat, zeros, got None"),
        ({"voxel_size": 0}, "voxel_size must be above 0 and finite [m], or None, got 0"),
        ({"voxel_size": 1e-46}, "voxel_size must be above 0 and finite [m], or None, got 1e-46"),
        ({"voxel_size": 1e300}, "voxel_size must be above 0 and finite [m], or None, got 1e+300"),
        (
            {"voxel_size": 1e-9, "bounds": ((-2.0, -2.0, -2.0), (np.inf, 1.0, 1.0))},
            "voxel_size must be at least 1.86e-09 m for bounds within 2^30 voxels of the origin, got 1e-09",
        ),
        ({"voxel_size": "1 cm"}, "voxel_size must be above 0 and finite [m], or None, got '1 cm'"),
        ({"bounds": (1, 2)}, "bounds must be the lowest and the highest corner of a box"),
        ({"bounds": ((0, 0, 0), (1, -1, 1))}, "bounds must be the lowest and the highest corner of a box"),
        ({"bounds": ((0, 0, 0), (1, np.nan, 1))}, "bounds must be the lowest and the highest corner of a box"),
        ({"seed": -1}, "seed must be a whole number, at least 0 and below 2^31, got -1"),
        ({"attributes": "rgb"}, "attributes must be names of outputs, got 'rgb'"),
        ({"attributes": ("rgb", "rgb")}, "attributes has 'rgb', which clouds have already"),
        ({"attributes": ("points",)}, "attributes has 'points', which clouds have already"),
        ({"attributes": ("albedo",)}, "Camera('top'): outputs must have 'albedo', got points, rgb"),
        ({"exclude": (1, 2)}, "exclude must be a dictionary of ids by output, got (1, 2)"),
        ({"exclude": {"bodies": (1.5,)}}, "exclude: 'bodies' must be ids, whole numbers of at least 0"),
        ({"exclude": {"bodies": (-1,)}}, "exclude: 'bodies' must be ids, whole numbers of at least 0"),
        ({"exclude": {"bodies": "floor"}}, "exclude: 'bodies' must be ids, got 'floor'"),
        ({"exclude": {"rgb": (1,)}}, "exclude has 'rgb', which is uint8 (3, 480, 3) and no ids"),
        ({"exclude": {"instances": (1,)}}, "Camera('top'): outputs must have 'instances'"),
        ({"positions": "depth"}, "Camera('top'): outputs must have 'depth', got points, rgb"),
        ({"positions": "range"}, 'positions must be "points", "depth" or None, got \'range\''),
        ({"positions": np.array(["points", "depth"])}, 'positions must be "points", "depth" or None, got array'),
        ({"frame": "hand"}, "frame: the scene has no body 'hand'"),
        ({"frame": ("camera", "hand")}, "frame: camera 'hand' came, the renderer has 'top', 'side'"),
        ({"frame": ("robot", "hand")}, 'frame must be "world", the name of a camera or a body'),
        ({"frame": 1}, 'frame must be "world", the name of a camera or a body'),
        ({"images": {"front": {}}}, "images must be a dictionary by camera, of 'top', 'side'"),
        ({"images": {"top": 5}}, "Camera('top'): images must be a dictionary of tensors by output, got 5"),
        ({"images": {"top": {"range": None}}}, "Camera('top'): images: range is no output"),
        ({"images": {"top": {"depth": torch.zeros(3, 4, 5, 1)}}}, "depth must be float32 (3, 20, 24, 1), got float32"),
        ({"images": {"top": {"depth": [1.0]}}}, "depth must be float32 (3, 20, 24, 1), got list"),
    ],
)
def test_mistakes(options: dict[str, Any], text: str) -> None:
    renderer = drawn(wp.get_device("cpu"))
    with says(text):
        sensors.PointClouds(renderer, **options)


def test_mistakes_of_what_clouds_are_made_of() -> None:
    device = wp.get_device("cpu")
    with says("renderer must be a Renderer or a Rig, got Scene"):
        sensors.PointClouds(scene_of(device, 1))
    fisheye = camera("top", outputs=("depth",), lens=wc.Fisheye(fovy=100.0))
    with says("Camera('top'): its lens is a table of rays, along which planar depth finds no points"):
        sensors.PointClouds(drawn(device, fisheye))
    fisheye = camera("top", outputs=("depth", "points"), lens=wc.Fisheye(fovy=100.0))
    rig = sensors.Rig(drawn(device, fisheye), {"top": [sensors.DepthRange(min=0.5, max=4.0)]})
    with says('give it the output "points", and positions="points" if its depth is measured'):
        sensors.PointClouds(rig)
    with says("Camera('top'): outputs must have 'points' or 'depth', got rgb"):
        sensors.PointClouds(drawn(device, camera("top", outputs=("rgb",))))
    named = eye("hand", parent="hand")
    with says("frame: 'hand' is a camera and a body; give (\"camera\", 'hand') or (\"body\", 'hand')"):
        xml = '<mujoco><worldbody><body name="hand"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
        sensors.PointClouds(wc.Renderer(_of_xml(xml, device), [named]), frame="hand")


def _of_xml(xml: str, device: wp.Device) -> wc.Scene:
    import mujoco

    mjm = mujoco.MjModel.from_xml_string(xml)
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    return wc.from_mujoco(mjm, mjd, device=device)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (
            {"points": np.zeros((1, 4, 3), np.float32)},
            "points must be float32 (world, ..., 3) on a device, got ndarray",
        ),
        ({"points": torch.zeros(4, 3)}, "points must be float32 (world, ..., 3) on a device, got float32 (4, 3)"),
        ({"points": torch.zeros(1, 4, 3, dtype=torch.float64)}, "points must be float32 (world, ..., 3)"),
        ({"points": torch.zeros(1, 8, 3)[:, ::2]}, "points must be contiguous, got strides"),
        ({"valid": torch.zeros(1, 5, dtype=torch.bool)}, "valid must be bool or uint8 (1, 4), got bool (1, 5)"),
        ({"valid": torch.zeros(1, 4)}, "valid must be bool or uint8 (1, 4), got float32 (1, 4)"),
        ({"attributes": ("ids",)}, "attributes must be a dictionary of tensors, got ('ids',)"),
        ({"attributes": {"ids": torch.zeros(1, 5)}}, "attributes: ids must be (1, 4) or (1, 4, 'n') of uint8, int32"),
        ({"attributes": {"ids": torch.zeros(1, 4, dtype=torch.int64)}}, "of uint8, int32, float32, got int64 (1, 4)"),
        ({"attributes": {"count": torch.zeros(1, 4)}}, "attributes has 'count', which clouds have already"),
        ({"exclude": {"ids": (1,)}}, "exclude has 'ids'; attributes are none"),
    ],
)
def test_mistakes_with_tensors(options: dict[str, Any], text: str) -> None:
    with says(text):
        sensors.PointClouds.of(**{"points": torch.zeros(1, 4, 3), **options})


def test_clouds_are_not_copied() -> None:
    import copy

    with says("PointClouds: it cannot be copied or pickled"):
        copy.deepcopy(sensors.PointClouds.of(torch.zeros(1, 4, 3)))
