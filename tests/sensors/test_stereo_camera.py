"""Stereo cameras: disparities of known walls, holes, and the rules that all sensors keep."""

import copy
import gc
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from allocation_ledger import Ledger
from stereo_scenes import BASELINE, FOCAL, PLAIN, SIZE, TEXTURED, eye, read, scene_of, stereo_of, true_disparity, wall

import warpcam as wc
from warpcam import sensors

PASSIVE = {"projector": None, "ambient": 1.0}
WALLS = {
    "near": wall(0.8, TEXTURED),
    "far": wall(1.9, TEXTURED),
    "across": wall(1.2, TEXTURED, "0 35 0"),
    "down": wall(1.2, TEXTURED, "-40 0 0"),
}
BOX = f'<geom type="box" size=".15 .2 .1" pos="0 0 -.9" {TEXTURED}/>'
INNER = slice(10, -10), slice(24, -10)  # without the border, and the band that the right imager does not see


def errors(stereo: sensors.StereoCamera, measured: np.ndarray) -> np.ndarray:
    """Errors of measured disparities [pixels], NaN at holes."""
    return np.where(measured > 0.0, measured - true_disparity(stereo), np.nan)


@pytest.mark.parametrize("subpixel", ["parabola", "equiangular"])
@pytest.mark.parametrize("name", WALLS)
def test_disparities_of_textured_walls(device: wp.Device, name: str, subpixel: Any) -> None:
    matching = sensors.StereoMatching(max_disparity=32, subpixel=subpixel)
    stereo = stereo_of(WALLS[name], device, matching=matching, **PASSIVE)
    images = read(stereo)
    off = errors(stereo, images["disparity"])[:, *INNER]
    assert np.isfinite(off).mean() > 0.97
    assert np.nanmedian(np.abs(off)) < 0.25
    assert (np.abs(off) > 1.0).mean() < 0.01
    depth = np.where(images["disparity"] > 0.0, FOCAL * BASELINE / np.maximum(images["disparity"], 1e-6), 0.0)
    assert np.allclose(images["depth"], depth, rtol=1e-5)


def test_a_plain_wall_needs_the_projector(device: wp.Device) -> None:
    without = stereo_of(wall(1.2, PLAIN), device, **PASSIVE)
    off = errors(without, read(without)["disparity"])[:, *INNER]
    assert np.isnan(off).mean() > 0.7 and (np.abs(off) < 1.0).mean() < 0.03  # noise is matched here and there
    stereo = stereo_of(wall(1.2, PLAIN, "0 20 0"), device)
    off = errors(stereo, read(stereo)["disparity"])[:, *INNER]
    assert np.isfinite(off).mean() > 0.97 and np.nanmedian(np.abs(off)) < 0.25


def test_even_images_without_noise_are_holes(device: wp.Device) -> None:
    """Costs of all disparities are 0 then, and none is better than another."""
    images = read(stereo_of(wall(1.2, PLAIN), device, noise=None, **PASSIVE))
    assert len(np.unique(images["infrared_left"])) == 1 and (images["depth"] == 0.0).all()


def test_pixels_that_the_right_imager_does_not_see_are_holes(device: wp.Device) -> None:
    matching = sensors.StereoMatching(max_disparity=32, block=(3, 3))
    stereo = stereo_of(wall(2.0, TEXTURED) + BOX, device, matching=matching, **PASSIVE)
    depth, truth = read(stereo)["depth"][0], stereo.truth.cpu().numpy()[0, ..., 0]
    row = slice(SIZE[1] // 2 - 12, SIZE[1] // 2 + 12)
    edges = np.flatnonzero(truth[SIZE[1] // 2] < 1.0)[[0, -1]]
    strip = round(FOCAL * BASELINE * (1.0 / 0.8 - 1.0 / 2.0))  # pixels of the wall to the left of the box
    assert strip > 8
    assert (depth[row, edges[0] - strip + 3 : edges[0] - 1] == 0.0).mean() > 0.85
    assert (depth[row, edges[0] + 2 : edges[1] - 1] > 0.0).mean() > 0.97
    assert (depth[row, edges[1] + 3 : edges[1] + 3 + strip] > 0.0).mean() > 0.9
    assert (depth[row, edges[0] - 3 * strip : edges[0] - strip - 3] > 0.0).mean() > 0.9


def test_depth_out_of_range_is_a_hole(device: wp.Device) -> None:
    stereo = stereo_of(WALLS["across"], device, 2, min_depth=[0.2, 1.1], max_depth=1.3, **PASSIVE)
    images, other = read(stereo), read(stereo_of(WALLS["across"], device, 2, **PASSIVE))
    for world, least in enumerate((0.2, 1.1)):
        there = (other["depth"][world] >= np.float32(least)) & (other["depth"][world] <= np.float32(1.3))
        assert there.any() and not there.all()
        for name in ("depth", "disparity"):
            assert (images[name][world] == np.where(there, other[name][world], 0.0)).all()


def test_the_right_imager_follows_the_left_one(device: wp.Device) -> None:
    stereo = stereo_of(wall(1.2, TEXTURED), device, 2, baseline=[0.1, 0.05])
    left = stereo.renderer.camera("eye")
    left.position[1] = torch.tensor([0.1, 0.2, 0.1])
    left.rotation[1] = torch.tensor([0.9, 0.1, 0.0, 0.2])
    left.fovy[1], left.far[1] = 40.0, 5.0
    stereo.parameters.baseline[1] = 0.08
    stereo.read()
    views = {name: stereo.renderer.views(name).numpy() for name in ("eye", "eye right", "eye projector")}
    for world, baseline in enumerate((0.1, 0.08)):
        eye, right, light = (view[world] for view in views.values())
        axis = eye["rotation"][:, 0]
        assert np.allclose(right["origin"], eye["origin"] + baseline * axis, atol=1e-6)
        assert np.allclose(light["origin"], eye["origin"] + 0.5 * baseline * axis, atol=1e-6)
        for view in (right, light):
            assert np.allclose(view["rotation"], eye["rotation"], atol=1e-6)
        for number in ("scale", "center", "near", "far"):
            assert (right[number] == eye[number]).all()
    assert views["eye"][1]["far"] == 5.0


def test_a_camera_on_a_body_and_one_of_the_scene(device: wp.Device) -> None:
    world = wall(1.5, TEXTURED) + '<body name="head" pos=".1 0 .2"><geom size=".01" rgba="0 0 0 0"/></body>'
    world += '<camera name="eye" pos=".1 0 .2"/>'
    images = []
    for options in ({"parent": "head", "position": None, "rotation": None}, {"position": None}):
        scene = scene_of(world, 1, device)
        options = {"exclude_bodies": "head", **options}
        images.append(read(sensors.StereoCamera(scene, eye(**options), baseline=BASELINE, seed=4)))
    assert (images[0]["depth"] > 0.0).mean() > 0.8
    assert all((images[0][name] == images[1][name]).all() for name in images[0])


@pytest.mark.parametrize("near", [0.3, [0.3, 0.2]])
def test_what_is_nearer_than_near_casts_no_shadow_of_dots(device: wp.Device, near: Any) -> None:
    """A housing about both imagers and the projector."""
    world = wall(1.2, PLAIN) + '<geom type="box" size=".3 .3 .02" pos="0 0 -.1"/>'
    stereo = sensors.StereoCamera(scene_of(world, 2, device), eye(near=near), baseline=BASELINE)
    assert (read(stereo)["depth"] > 0.0).mean(axis=(1, 2)).min() > 0.8
    stereo.renderer.camera("eye").near[1] = 0.0  # within the housing
    assert (read(stereo)["depth"] > 0.0).mean(axis=(1, 2))[1] < 0.3


def test_noise_follows_from_the_seed_whatever_the_number_of_worlds(device: wp.Device) -> None:
    world, matching = wall(1.2, PLAIN), sensors.StereoMatching(max_disparity=32)
    work = 2 * matching.bytes_per_world(*SIZE)
    several = stereo_of(world, device, 5, seed=3, work_memory=work)
    together, other = (stereo_of(world, device, 5, seed=seed) for seed in (3, 4))
    one = stereo_of(world, device, 1, seed=3)
    first, second = read(several), read(several)
    for number, expected in enumerate((first, second)):
        for name, image in read(together).items():
            assert (image == expected[name]).all(), (number, name)
        alone = read(one)
        assert all((alone[name][0] == expected[name][0]).all() for name in alone)
    for name in ("infrared_left", "infrared_right", "depth"):
        assert (first[name] != second[name]).any() and (first[name][0] != first[name][1]).any()
        assert (first[name] != read(other)[name]).any()
    assert (first["infrared_left"] != first["infrared_right"]).any()


def test_some_worlds_are_read_and_others_stay(device: wp.Device) -> None:
    stereo, other = (stereo_of(wall(1.2, PLAIN), device, 3, seed=3, work_memory=1) for _ in range(2))
    first = read(stereo)
    stereo.reset([1])
    second = read(stereo, worlds=[1])
    both = [read(other), read(other)]
    for name in first:
        assert (second[name][[0, 2]] == first[name][[0, 2]]).all()
        assert (second[name][1] == both[1][name][1]).all()
    assert (second["depth"][1] != first["depth"][1]).any()


@pytest.mark.parametrize("options", [{"worlds": [3]}, {"worlds": "all"}, {"forward": 1}])
def test_errors_of_a_read_say_what_was_called(device: wp.Device, options: dict[str, Any]) -> None:
    with pytest.raises(wc.WarpcamError, match=f"^StereoCamera.read: {next(iter(options))} "):
        stereo_of(wall(1.2, PLAIN), device, 3).read(**options)


def test_reads_compile_and_allocate_nothing(
    device: wp.Device, loads: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    stereo = stereo_of(wall(1.2, PLAIN), device, 3, work_memory=1)
    pointers = {name: image.data_ptr() for name, image in stereo.read().items()}
    loads.clear()
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    ledger = Ledger(getattr(device, slot))
    monkeypatch.setattr(device, slot, ledger)
    mask = wp.full(3, 1, dtype=wp.uint8, device=device)
    gc.collect()
    held = ledger.held
    for worlds in (None, mask):
        stereo.parameters.ambient[:] += 0.1
        assert pointers == {name: image.data_ptr() for name, image in stereo.read(worlds=worlds).items()}
        stereo.reset(worlds=worlds)
    gc.collect()
    assert ledger.held == held and loads == []


def test_memory_is_told_before(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, matching = scene_of(wall(1.2, PLAIN), 3, device), sensors.StereoMatching(max_disparity=32)
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    ledger = Ledger(getattr(device, slot))
    monkeypatch.setattr(device, slot, ledger)
    stereo = sensors.StereoCamera(scene, eye(), baseline=BASELINE, matching=matching)
    assert abs(ledger.held - stereo.memory.total) < 8192  # numbers of each world, and the table of luminances
    assert stereo.memory.total > 3 * matching.bytes_per_world(*SIZE) == 3 * SIZE[0] * SIZE[1] * (4 * 32 + 20)
    less = sensors.StereoCamera(scene, eye(), baseline=BASELINE, matching=matching, work_memory=1)
    assert stereo.memory.total - less.memory.total == 2 * matching.bytes_per_world(*SIZE)


def test_a_read_may_be_captured(device: wp.Device) -> None:
    stereo, other = (stereo_of(wall(1.2, PLAIN), device, 2, work_memory=1) for _ in range(2))
    stereo.read()
    with wp.ScopedCapture(device) as capture:
        stereo.read()
    expected = [read(other) for _ in range(4)]
    wp.capture_launch(capture.graph)
    counted = stereo.renderer.frames.tolist()[0]
    for name, image in stereo.images.items():
        assert (image.cpu().numpy()[..., 0] == expected[counted - 1][name]).all()


@pytest.mark.parametrize("by_rig", [False, True])
def test_point_clouds_are_of_measured_depth_though_true_points_are_there(device: wp.Device, by_rig: bool) -> None:
    scene = scene_of(WALLS["across"], 1, device)
    stereo = sensors.StereoCamera(scene, eye(outputs=("rgb", "points")), baseline=BASELINE, **PASSIVE)
    rig = sensors.Rig(stereo.renderer, {"eye": [sensors.Blur(sigma=1.0)]})
    source, pixels = rig if by_rig else stereo.renderer, SIZE[0] * SIZE[1]
    clouds, true = (
        sensors.PointClouds(source, ["eye"], num_points=pixels, method="first", positions=positions)
        for positions in (None, "points")
    )
    (rig if by_rig else stereo).read()
    count = int((stereo.images["depth"] > 0.0).sum())
    assert int(clouds.read()["count"][0]) == count < pixels == int(true.read()["count"][0])


def test_rigs_and_point_clouds_go_on_from_the_measured_depth(device: wp.Device) -> None:
    stereo = stereo_of(WALLS["across"], device, **PASSIVE)
    rig = sensors.Rig(stereo.renderer, {"eye": [sensors.DepthBias(offset=0.5)]})
    frames = rig.read()
    depth = stereo.images["depth"]
    assert (depth > 0.0).any() and (depth != stereo.truth).any()
    assert torch.equal(frames["eye"]["depth"], torch.where(depth > 0.0, depth + 0.5, depth))
    cloud = sensors.PointClouds(stereo.renderer, ["eye"], num_points=depth.numel(), method="first").read()
    count = int(cloud["count"][0])
    assert count == int((depth > 0.0).sum())
    assert torch.allclose(-cloud["points"][0, :count, 2], depth[depth > 0.0], atol=1e-5)


@pytest.mark.parametrize(
    "effects",
    [
        [sensors.DepthOfField(focus_distance=0.8, f_number=1.2, focal_length=0.05)],
        [sensors.MotionBlur(exposure=0.1)],
        [sensors.RollingShutter(readout=0.1), sensors.RollingShutter(readout=0.1, changes="depth")],
    ],
    ids=lambda effects: type(effects[0]).__name__,
)
def test_effects_on_colors_look_up_true_depth(device: wp.Device, effects: list[sensors.Effect]) -> None:
    """Holes are no surface that lies before all others. Depth that goes on, late or not, is the measured one."""
    camera = eye(outputs=("rgb", "depth", "flow", "flow_valid"))
    scene = scene_of(wall(2.0, TEXTURED) + BOX, 1, device)
    matching = sensors.StereoMatching(max_disparity=32)
    stereo = sensors.StereoCamera(scene, camera, baseline=BASELINE, matching=matching, noise=None, **PASSIVE)
    plain = wc.Renderer(scene, [camera])
    rigs = [sensors.Rig(renderer, {"eye": effects}) for renderer in (plain, stereo.renderer)]
    for time, place in enumerate((0.0, 0.1)):
        for rig in rigs:
            rig.renderer.camera("eye").position[:, 0] = place
            rig.read(time=0.1 * time)
    images, expected = rigs[1].images["eye"], rigs[0].images["eye"]
    assert torch.equal(images["rgb"], expected["rgb"]) and not torch.equal(images["rgb"], plain.images["eye"]["rgb"])
    assert ((images["depth"] == 0.0) != (expected["depth"] == 0.0)).any()
    late = sensors.Rig(stereo.renderer, {"eye": [sensors.Delivery(rate=10.0)]})
    assert torch.equal(late.read(time=0.0)["eye"]["depth"], stereo.images["depth"])


def test_parameters_are_drawn(device: wp.Device) -> None:
    stereo = stereo_of(wall(1.2, PLAIN), device, 3)
    names = {"baseline", "min_depth", "max_depth", "ambient", "projector_intensity"}
    assert set(stereo.parameters) == names | {"noise_speckle", "noise_sigma", "noise_offset"}
    bare = stereo_of(wall(1.2, PLAIN), device, 1, noise=None, **PASSIVE)
    assert set(bare.parameters) == names - {"projector_intensity"}
    wc.randomize(stereo.parameters, projector_intensity=(1.0, 4.0), seed=1)
    drawn = stereo.parameters.projector_intensity
    assert len(set(drawn.tolist())) == 3
    dots = read(stereo)["infrared_left"].max(axis=(1, 2))
    assert (np.argsort(dots) == np.argsort(drawn.cpu().numpy())).all()


def test_other_outputs_of_the_camera_are_there(device: wp.Device) -> None:
    scene = scene_of(wall(1.2, TEXTURED), 1, device)
    stereo = sensors.StereoCamera(scene, eye(outputs=("rgb", "segmentation")), baseline=BASELINE)
    images = stereo.read()
    assert set(images) == {"depth", "disparity", "infrared_left", "infrared_right", "rgb", "segmentation"}
    assert images["rgb"].shape == (1, SIZE[1], SIZE[0], 3) and int(images["rgb"].max()) > 0
    assert images["depth"].shape == (1, SIZE[1], SIZE[0], 1) and images["depth"].dtype == torch.float32
    assert images["infrared_left"].dtype == torch.uint8


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scene": None}, "scene must be made by from_mujoco_warp or the like, got NoneType"),
        ({"camera": "eye"}, "camera must be a Camera with a Pinhole lens of its own, got str"),
        ({"camera": wc.Camera("top", width=8, height=8)}, "got Camera with the lens None"),
        ({"camera": eye(lens=wc.Orthographic(height=1.0))}, "got Camera with the lens Orthographic"),
        ({"baseline": 0.0}, "baseline must be from 1e-06 to inf, got 0"),
        ({"baseline": [0.1, 0.1]}, r"baseline must have shape a number or \(1,\), got \(2,\)"),
        ({"ambient": -1.0}, "ambient must be from 0 to inf, got -1"),
        ({"min_depth": float("nan")}, "min_depth must be finite, got nan"),
        ({"min_depth": 2.0, "max_depth": 2.0}, "min_depth must be below max_depth, got 2 and 2"),
        ({"projector": 3.0}, "projector must be sensors.DotProjector or None, got 3.0"),
        ({"matching": None}, "matching must be sensors.StereoMatching, got None"),
        ({"noise": 0.1}, "noise must be sensors.InfraredNoise or None, got 0.1"),
        ({"noise": sensors.InfraredNoise(speckle=2.0)}, "InfraredNoise: speckle must be from 0 to 1, got 2"),
        ({"projector": sensors.DotProjector(intensity=-1.0)}, "DotProjector: intensity must be from 0 to inf, got -1"),
        ({"work_memory": 0}, "work_memory must be a whole number of bytes, at least 1, got 0"),
        ({"seed": 0.5}, "seed must be a whole number of 32 bits"),
    ],
)
def test_bad_input_is_refused(options: dict[str, Any], message: str) -> None:
    scene = scene_of(wall(1.2, PLAIN), 1, wp.get_device("cpu"))
    given = {"scene": scene, "camera": eye(), "baseline": BASELINE, **options}
    with pytest.raises(wc.WarpcamError, match=f"StereoCamera: .*{message}"):
        sensors.StereoCamera(given.pop("scene"), given.pop("camera"), **given)


def test_it_cannot_be_copied(device: wp.Device) -> None:
    with pytest.raises(wc.WarpcamError, match="StereoCamera: it cannot be copied or pickled"):
        copy.deepcopy(stereo_of(wall(1.2, PLAIN), device))
