"""Point clouds of given points: packed, thinned out and chosen as numpy does it, the same in every run."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

from warpcam import WarpcamError, sensors
from warpcam.sensors.kernels import point_clouds as kernels

WORLDS = 3


def given(device: wp.Device, worlds: int = WORLDS, shape: tuple[int, ...] = (17, 40), seed: int = 0) -> torch.Tensor:
    """Points in worlds that each have others, a fifth of which is missing; a world is the same among more of them."""
    points = np.empty((worlds, *shape, 3), np.float32)
    for world in range(worlds):
        random = np.random.default_rng((seed, world))
        points[world] = random.normal(size=(*shape, 3))
        points[world][random.random(shape) < 0.2] = (np.inf, np.nan, -np.inf)[world % 3]
    return torch.from_numpy(points).to(wp.device_to_torch(device))


def host(cloud: dict[str, torch.Tensor]) -> dict[str, np.ndarray]:
    return {name: values.cpu().numpy().copy() for name, values in cloud.items()}


def usable(points: np.ndarray) -> np.ndarray:
    """Numbers of the pixels of one world that have points."""
    return np.flatnonzero(np.isfinite(points.reshape(-1, 3)).all(axis=1))


def farthest(points: np.ndarray, count: int) -> np.ndarray:
    """Farthest point sampling by its definition, in float32 as it is rounded on every device."""
    distances, picks = np.full(len(points), np.inf, np.float32), [0]
    while len(picks) < count:
        square = (points - points[picks[-1]]) ** 2
        distances = np.minimum(distances, square[:, 0] + square[:, 1] + square[:, 2])
        distances[picks[-1]] = -1.0
        picks.append(int(np.argmax(distances)))
    return np.array(picks)


def first_of_voxels(points: np.ndarray, size: float) -> np.ndarray:
    _, firsts = np.unique(np.floor(points / np.float32(size)), axis=0, return_index=True)
    return np.sort(firsts)


def test_the_first_points_in_the_order_of_pixels(device: wp.Device) -> None:
    points = given(device)
    cloud = host(sensors.PointClouds.of(points, num_points=300, method="first").read())
    for world, all_points in enumerate(points.cpu().numpy()):
        pixels = usable(all_points)[:300]
        np.testing.assert_array_equal(cloud["pixels"][world], pixels)
        np.testing.assert_array_equal(cloud["points"][world], all_points.reshape(-1, 3)[pixels])
    assert cloud["points"].dtype == np.float32 and cloud["pixels"].dtype == np.int32
    assert cloud["count"].tolist() == [300] * WORLDS and cloud["count"].dtype == np.int32


@pytest.mark.parametrize(("shape", "count"), [((17, 40), 64), ((17, 40), 500), ((5000,), 40), ((300, 300), 20)])
def test_farthest_point_sampling(device: wp.Device, shape: tuple[int, ...], count: int) -> None:
    """The largest has chunks of more points than a warp."""
    points = given(device, shape=shape)
    cloud = host(sensors.PointClouds.of(points, num_points=count).read())
    for world, all_points in enumerate(points.cpu().numpy()):
        pixels = usable(all_points)
        chosen = pixels[farthest(all_points.reshape(-1, 3)[pixels], count)]
        np.testing.assert_array_equal(cloud["pixels"][world], chosen)
        np.testing.assert_array_equal(cloud["points"][world], all_points.reshape(-1, 3)[chosen])


def test_farthest_points_of_equal_ones_are_each_picked_once(device: wp.Device) -> None:
    points = torch.zeros((1, 10, 30, 3), device=wp.device_to_torch(device))
    points[:, ::2, :, 0] = 1.0
    cloud = host(sensors.PointClouds.of(points, num_points=200).read())
    assert len(set(cloud["pixels"][0].tolist())) == 200
    np.testing.assert_array_equal(cloud["pixels"][0], farthest(points[0].reshape(-1, 3).cpu().numpy(), 200))


@pytest.mark.parametrize("size", [0.1, 0.5, 2.0, 1e-12])
def test_the_first_point_of_each_voxel(device: wp.Device, size: float) -> None:
    points = given(device)
    cloud = host(
        sensors.PointClouds.of(points, num_points=800, method="first", voxel_size=size, padding="zeros").read()
    )
    for world, all_points in enumerate(points.cpu().numpy()):
        pixels = usable(all_points)
        kept = pixels if size < 1e-9 else pixels[first_of_voxels(all_points.reshape(-1, 3)[pixels], size)]
        if size > 1e-9:
            assert cloud["count"][world] == len(kept)
            np.testing.assert_array_equal(cloud["pixels"][world, : len(kept)], kept)
        assert 0 < cloud["count"][world] <= len(kept)


def test_voxels_in_which_points_repeat(device: wp.Device) -> None:
    """Tables hold many candidates of few voxels and few of many."""
    points = given(device, shape=(64, 64))
    points[0, :, :, :2] = 0.25
    points[1, ::2] = points[1, 1::2]
    cloud = host(sensors.PointClouds.of(points, num_points=4096, method="first", voxel_size=0.01).read())
    for world, all_points in enumerate(points.cpu().numpy()):
        pixels = usable(all_points)
        kept = pixels[first_of_voxels(all_points.reshape(-1, 3)[pixels], 0.01)]
        np.testing.assert_array_equal(cloud["pixels"][world, : len(kept)], kept)
        assert cloud["count"][world] == len(kept)


def test_farthest_points_of_voxels(device: wp.Device) -> None:
    points = given(device)
    cloud = host(sensors.PointClouds.of(points, num_points=32, voxel_size=0.3).read())
    for world, all_points in enumerate(points.cpu().numpy()):
        pixels = usable(all_points)
        pixels = pixels[first_of_voxels(all_points.reshape(-1, 3)[pixels], 0.3)]
        assert len(pixels) > 32
        chosen = pixels[farthest(all_points.reshape(-1, 3)[pixels], 32)]
        np.testing.assert_array_equal(cloud["pixels"][world], chosen)


def test_uniform_points_are_all_as_likely(device: wp.Device) -> None:
    """Each of 10 points is among 3 in three of ten draws, and in each place in one of ten."""
    points = torch.rand((2000, 10, 3), device=wp.device_to_torch(device))
    clouds = sensors.PointClouds.of(points, num_points=3, method="uniform")
    places = np.zeros((3, 10))
    for _ in range(5):
        pixels = host(clouds.read())["pixels"]
        assert all(len(set(row)) == 3 for row in pixels.tolist())
        places += [np.bincount(pixels[:, place], minlength=10) for place in range(3)]
    expected = 5 * 2000 / 10
    assert (((places - expected) ** 2 / expected).sum(axis=1) < 27.9).all()  # chi-square, 9 degrees, 0.1 %


def test_uniform_points_are_pairwise_independent(device: wp.Device) -> None:
    points = torch.rand((20000, 8, 3), device=wp.device_to_torch(device))
    pixels = host(sensors.PointClouds.of(points, num_points=2, method="uniform", seed=3).read())["pixels"]
    pairs = np.bincount(8 * pixels[:, 0] + pixels[:, 1], minlength=64).reshape(8, 8)
    assert not pairs.diagonal().any()
    apart = pairs[~np.eye(8, dtype=bool)]
    assert ((apart - 20000 / 56) ** 2 / (20000 / 56)).sum() < 93.2  # chi-square, 55 degrees, 0.1 %


def test_draws_change_with_each_read_and_begin_anew_after_a_reset(device: wp.Device) -> None:
    points = given(device)
    clouds = sensors.PointClouds.of(points, num_points=50, method="uniform", seed=5)
    first, second = (host(clouds.read())["pixels"] for _ in range(2))
    assert (first != second).any(axis=1).all()
    other = host(sensors.PointClouds.of(points, num_points=50, method="uniform", seed=6).read())["pixels"]
    assert (first != other).any(axis=1).all()
    clouds.reset([1])
    third = host(clouds.read())["pixels"]
    np.testing.assert_array_equal(third[1], first[1])
    assert (third[[0, 2]] != first[[0, 2]]).any(axis=1).all()
    clouds.reset()
    np.testing.assert_array_equal(host(clouds.read())["pixels"], first)


@pytest.mark.parametrize("method", ["farthest", "uniform", "first"])
@pytest.mark.parametrize("voxel_size", [None, 0.2])
def test_a_world_is_the_same_among_any_number_of_worlds(device: wp.Device, method: Any, voxel_size: Any) -> None:
    few, many = given(device, 2), given(device, 9)
    options: dict[str, Any] = {"num_points": 60, "method": method, "voxel_size": voxel_size, "seed": 2}
    expected = host(sensors.PointClouds.of(few, **options).read())
    for _ in range(2):
        found = host(sensors.PointClouds.of(many, **options).read())
        for name, values in expected.items():
            np.testing.assert_array_equal(found[name][:2], values)


@pytest.mark.parametrize("method", ["farthest", "uniform", "first"])
@pytest.mark.parametrize("padding", ["repeat", "zeros"])
@pytest.mark.parametrize("num_points", [8, 100])
def test_padding(device: wp.Device, method: Any, padding: Any, num_points: int) -> None:
    """A world with fewer points than wanted, one with as many, and one with none."""
    points = given(device, shape=(num_points + 6,))
    points[:] = torch.arange(points.numel(), device=points.device).reshape(points.shape)
    points[0, 5:] = torch.inf
    points[1, num_points:] = torch.inf
    points[2] = torch.inf
    ids = torch.arange(3 * (num_points + 6), device=points.device, dtype=torch.int32).reshape(3, -1) + 1
    clouds = sensors.PointClouds.of(
        points, attributes={"ids": ids}, num_points=num_points, method=method, padding=padding
    )
    cloud = host(clouds.read())
    assert cloud["count"].tolist() == [5, num_points, 0]
    repeated = (
        np.arange(num_points) % 5
        if padding == "repeat"
        else np.where(np.arange(num_points) < 5, np.arange(num_points), -1)
    )
    np.testing.assert_array_equal(cloud["pixels"], [repeated, np.arange(num_points), np.full(num_points, -1)])
    rows = points.cpu().numpy().reshape(3, -1, 3)
    for world in range(3):
        there = cloud["pixels"][world] >= 0
        np.testing.assert_array_equal(cloud["points"][world][there], rows[world][cloud["pixels"][world][there]])
        np.testing.assert_array_equal(
            cloud["ids"][world][there], ids[world].cpu().numpy()[cloud["pixels"][world][there]]
        )
        assert not cloud["points"][world][~there].any() and not cloud["ids"][world][~there].any()


def test_worlds_that_are_not_read_keep_their_clouds(device: wp.Device) -> None:
    points = given(device)
    clouds = sensors.PointClouds.of(
        points, num_points=40, voxel_size=0.1, attributes={"x": points[..., 0].contiguous()}
    )
    memory = {name: values.data_ptr() for name, values in clouds.read().items()}
    before = host(clouds.cloud)
    points += 1.0
    after = host(clouds.read([1]))
    whole = host(sensors.PointClouds.of(points, num_points=40, voxel_size=0.1).read())
    for name in ("points", "pixels", "count"):
        np.testing.assert_array_equal(after[name][[0, 2]], before[name][[0, 2]])
        np.testing.assert_array_equal(after[name][1], whole[name][1])
    assert {name: values.data_ptr() for name, values in clouds.cloud.items()} == memory
    mask = torch.tensor([True, False, True], device=points.device)
    np.testing.assert_array_equal(host(clouds.read(mask))["points"], whole["points"])


def test_points_that_are_not_valid_out_of_bounds_or_excluded(device: wp.Device) -> None:
    points = given(device)
    random = np.random.default_rng(0)
    valid = torch.from_numpy(random.random(points.shape[:-1]) < 0.7).to(points.device)
    ids = torch.from_numpy(random.integers(-1, 9, (*points.shape[:-1], 1)).astype(np.int32)).to(points.device)
    low, high = (-0.5, -1.0, -np.inf), (0.75, 1.0, 0.9)
    clouds = sensors.PointClouds.of(
        points, valid=valid, attributes={"ids": ids}, exclude={"ids": (2, 5)}, bounds=(low, high),
        num_points=600, method="first", padding="zeros",
    )  # fmt: skip
    cloud = host(clouds.read())
    rows, numbers = points.cpu().numpy().reshape(WORLDS, -1, 3), ids.cpu().numpy().reshape(WORLDS, -1)
    inside = ((rows >= np.float32(low)) & (rows <= np.float32(high))).all(axis=2) & np.isfinite(rows).all(axis=2)
    kept = inside & valid.cpu().numpy().reshape(WORLDS, -1) & ~np.isin(numbers, (2, 5))
    for world in range(WORLDS):
        pixels = np.flatnonzero(kept[world])
        assert cloud["count"][world] == len(pixels) > 0
        np.testing.assert_array_equal(cloud["pixels"][world, : len(pixels)], pixels)
        np.testing.assert_array_equal(cloud["ids"][world, : len(pixels)], numbers[world][pixels])


@pytest.mark.parametrize("call", ["read", "reset"])
def test_worlds_that_are_not_there(device: wp.Device, call: str) -> None:
    clouds = sensors.PointClouds.of(given(device), num_points=40, method="uniform")
    with pytest.raises(WarpcamError, match=rf"PointClouds.{call}: worlds has id 3; allowed are 0 to 2"):
        getattr(clouds, call)([0, 3])


def test_a_captured_read(device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("needs CUDA: graphs")
    points = given(device)
    clouds = sensors.PointClouds.of(points, num_points=40, voxel_size=0.1)
    clouds.read()
    with wp.ScopedCapture(device=device) as capture:
        clouds.read()
    points += 1.0
    wp.capture_launch(capture.graph)
    expected = host(sensors.PointClouds.of(points, num_points=40, voxel_size=0.1).read())
    for name, values in host(clouds.cloud).items():
        np.testing.assert_array_equal(values, expected[name])


@pytest.mark.parametrize("method", ["farthest", "uniform"])
def test_kernels_compile_for_cuda(method: Any, tmp_path: Path) -> None:
    """Also without a GPU: NVRTC comes with Warp."""
    points = given(wp.get_device("cpu"))
    clouds = sensors.PointClouds.of(points, num_points=40, voxel_size=0.1, method=method, attributes={"x": points})
    modules = {stage.module.name: stage.module for stage in clouds._stages}
    assert len(modules) >= 4
    for name, module in modules.items():
        (path,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path / name, use_ptx=True)
        assert path.stat().st_size > 0


@pytest.mark.parametrize("kernel", [kernels.pack_points, kernels.thin_to_voxels, kernels.pick_farthest])
def test_kernels_of_blocks_are_compiled_for_their_blocks(kernel: wp.Kernel) -> None:
    """The compiler knows how many threads a block has, and how many blocks of them registers are to suffice for."""
    threads, blocks = kernel.options["launch_bounds"]
    assert threads == kernels.THREADS and 1 < blocks <= 2048 // threads
