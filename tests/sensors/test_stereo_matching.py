"""Stages of stereo matching, against the same written in NumPy."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from warpcam import WarpcamError, sensors
from warpcam.kernels.runtime.launch import run
from warpcam.kernels.types import View
from warpcam.sensors.kernels import stereo_matching

WORLDS, HEIGHT, WIDTH = 2, 21, 37
STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))  # rows and columns of paths


def images(shift: int = 5, seed: int = 0) -> list[np.ndarray]:
    """Two images (world, row, column) uint8, the right one mostly the left one moved, with noise."""
    random = np.random.default_rng(seed)
    left = random.integers(0, 256, (WORLDS, HEIGHT, WIDTH))
    right = np.roll(left, -shift, axis=2)
    right[:, : HEIGHT // 2] = np.roll(left, -2 * shift, axis=2)[:, : HEIGHT // 2]
    noisy = right + random.integers(-20, 21, right.shape)
    return [left.astype(np.uint8), np.clip(noisy, 0, 255).astype(np.uint8)]


def matched(matching: sensors.StereoMatching, pair: list[np.ndarray], device: wp.Device) -> dict[str, np.ndarray]:
    """All arrays of a matcher, (world, row, column, ...), and results with focal length and baseline of 1."""
    pixels = HEIGHT * WIDTH
    matcher = matching.matcher(WIDTH, HEIGHT)
    sizes = {"costs": pixels * matching.max_disparity, "totals": pixels * matching.max_disparity}
    dtypes = {"costs": wp.uint16, "totals": wp.uint16, "left": wp.uint32, "right": wp.uint32, "found_right": wp.int32}
    for name in ("left", "right", "costs", "totals", "found", "found_right", "checked"):
        shape = (WORLDS, sizes.get(name, pixels))
        setattr(matcher, name, wp.zeros(shape, dtype=dtypes.get(name, wp.float32), device=device))
    out = stereo_matching.MeasuredDepth()
    view = View()
    view.scale = wp.vec2(1.0, 1.0)
    out.views = wp.array([view] * WORLDS, dtype=View, device=device)
    for name, value in (("baseline", 1.0), ("min_depth", 0.0), ("max_depth", 1.0)):
        setattr(out, name, wp.full(WORLDS, value, dtype=wp.float32, device=device))
    out.depth, out.disparity = (wp.zeros((WORLDS, pixels), dtype=wp.float32, device=device) for _ in range(2))
    mask = wp.full(WORLDS, 1, dtype=wp.uint8, device=device)
    both = [wp.array(image.reshape(WORLDS, pixels), dtype=wp.uint8, device=device) for image in pair]
    run(stereo_matching.bind_matching(mask, matcher, both, out, matching.paths // 2, device))
    arrays = {name: getattr(matcher, name) for name in ("costs", "totals", "found", "found_right", "checked")}
    arrays |= {"depth": out.depth, "disparity": out.disparity}
    shape = (WORLDS, HEIGHT, WIDTH, -1)
    found = {name: array.numpy().reshape(shape).astype(np.float64) for name, array in arrays.items()}
    return {name: array[..., 0] if array.shape[-1] == 1 else array for name, array in found.items()}


def census(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Bits (row, column, bit)."""
    across, down = size[0] // 2, size[1] // 2
    padded = np.pad(image, ((down, down), (across, across)), mode="edge").astype(int)
    pairs = [(i, j) for i in range(-down, 1) for j in range(-across, across + 1) if (i, j) < (0, 0)]
    height, width = image.shape

    def moved(i: int, j: int) -> np.ndarray:
        return padded[down + i : down + i + height, across + j : across + j + width]

    return np.stack([moved(i, j) >= moved(-i, -j) for i, j in pairs], axis=-1)


def block_costs(pair: list[np.ndarray], matching: sensors.StereoMatching) -> np.ndarray:
    """Costs of one world, (row, column, disparity)."""
    left, right = (census(image, matching.census) for image in pair)
    costs = np.full((HEIGHT, WIDTH, matching.max_disparity), left.shape[-1])
    for d in range(min(matching.max_disparity, WIDTH)):
        costs[:, d:, d] = (left[:, d:] != right[:, : WIDTH - d]).sum(axis=-1)
    across, down = matching.block[0] // 2, matching.block[1] // 2
    padded = np.pad(costs, ((down, down), (across, across), (0, 0)), mode="edge")
    windows = [
        padded[i : i + HEIGHT, j : j + WIDTH] for i in range(matching.block[1]) for j in range(matching.block[0])
    ]
    return np.sum(windows, axis=0)


def path_costs(costs: np.ndarray, step: tuple[int, int], p1: int, p2: int) -> np.ndarray:
    """Costs along the paths of one direction, pixel by pixel as it is defined."""
    paths = np.zeros(costs.shape, int)
    rows = range(HEIGHT) if step[0] >= 0 else range(HEIGHT - 1, -1, -1)
    columns = range(WIDTH) if step[1] >= 0 else range(WIDTH - 1, -1, -1)
    for row in rows:
        for column in columns:
            i, j = row - step[0], column - step[1]
            paths[row, column] = costs[row, column]
            if 0 <= i < HEIGHT and 0 <= j < WIDTH:
                before, least = paths[i, j], paths[i, j].min()
                beside = np.minimum(np.append(before[1:], 10**6), np.append(10**6, before[:-1])) + p1
                paths[row, column] += np.minimum(np.minimum(before, beside), least + p2) - least
    return paths


def contrast(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Greatest difference of the pairs that a census compares."""
    across, down = size[0] // 2, size[1] // 2
    padded = np.pad(image, ((down, down), (across, across)), mode="edge").astype(int)
    windows = np.lib.stride_tricks.sliding_window_view(padded, size[::-1])
    return np.abs(windows - windows[..., ::-1, ::-1]).max(axis=(-2, -1))


def chosen(totals: np.ndarray, matching: sensors.StereoMatching) -> tuple[np.ndarray, np.ndarray]:
    """Disparities of the left and the right image of one world."""
    left, right = np.full((HEIGHT, WIDTH), -1.0), np.zeros((HEIGHT, WIDTH))
    disparities = matching.max_disparity
    for row in range(HEIGHT):
        for column in range(WIDTH):
            costs = totals[row, column, : min(disparities, column + 1)]
            best = int(np.argmin(costs))
            others = costs[np.abs(np.arange(len(costs)) - best) > 1]
            if not matching.uniqueness or 100 * costs[best] < min(others, default=10**6) * (100 - matching.uniqueness):
                left[row, column] = best
                if 0 < best < len(costs) - 1:
                    below, least, above = costs[best - 1 : best + 2]
                    bend = below - 2 * least + above
                    if matching.subpixel == "equiangular":
                        bend = max(below, above) - least
                    left[row, column] += (below - above) / (2 * bend) if bend else 0.0
            reach = min(disparities, WIDTH - column)
            right[row, column] = np.argmin([totals[row, column + d, d] for d in range(reach)])
    return left, right


CASES: dict[str, dict[str, Any]] = {
    "as SAPIEN": {"max_disparity": 16},
    "more than a warp": {"max_disparity": 48, "block": (3, 5)},
    "many disparities": {"max_disparity": 80, "block": (1, 1), "census": (9, 7)},
    "most disparities": {"max_disparity": 144, "block": (5, 1), "census": (3, 3), "contrast": 150},
    "all directions": {"max_disparity": 32, "block": (3, 3), "paths": 8, "subpixel": "equiangular"},
    "nothing refused": {"max_disparity": 16, "uniqueness": 0, "max_difference": None, "census": (5, 3)},
}


@pytest.mark.parametrize("name", CASES)
def test_matching_is_what_its_formulas_say(device: wp.Device, name: str) -> None:
    matching = sensors.StereoMatching(**CASES[name])
    pair = images()
    found = matched(matching, pair, device)
    area = matching.block[0] * matching.block[1]
    for world in range(WORLDS):
        costs = block_costs([image[world] for image in pair], matching)
        assert (found["costs"][world] == costs).all()
        steps = STEPS[: matching.paths]
        totals = sum(path_costs(costs, step, matching.p1 * area, matching.p2 * area) for step in steps)
        assert (found["totals"][world] == totals).all()
        left, right = chosen(np.asarray(totals), matching)
        left = np.where(contrast(pair[0][world], matching.census) >= matching.contrast, left, -1.0)
        assert np.abs(found["found"][world] - left).max() < 1e-6 and (found["found_right"][world] == right).all()
    assert 0.3 < (found["found"] >= 0.0).mean()


def test_both_images_must_agree(device: wp.Device) -> None:
    pair = images()
    # An object that the left image alone has.
    pair[0][:, 5:12, 18:26] = np.random.default_rng(1).integers(0, 256, (WORLDS, 7, 8))
    options = {"max_disparity": 16, "uniqueness": 0}
    checked = {
        limit: matched(sensors.StereoMatching(**options, max_difference=limit), pair, device) for limit in (0, 2)
    }
    without = matched(sensors.StereoMatching(**options, max_difference=None), pair, device)
    found, right = without["found"], without["found_right"].astype(int)
    assert (without["checked"] == found).all()
    whole = np.floor(found + 0.5).astype(int)
    worlds, rows, columns = np.indices(found.shape)
    place = columns - whole
    for limit, result in checked.items():
        agrees = (place >= 0) & (np.abs(whole - right[worlds, rows, np.maximum(place, 0)]) <= limit)
        assert not agrees.all() and agrees.any()
        assert (result["checked"] == np.where(agrees, found, -1.0)).all()
    assert (checked[0]["checked"] < 0.0).sum() > (checked[2]["checked"] < 0.0).sum()


def test_even_parts_of_an_image_do_not_take_over_what_is_around_them(device: wp.Device) -> None:
    pair = images()
    for image in pair:
        image[:, 3:17, 12:34] = 90
    options = {"max_disparity": 16, "block": (3, 3), "median": 1}
    depths = [matched(sensors.StereoMatching(**options, contrast=level), pair, device)["depth"] for level in (0, 1)]
    inner = np.s_[:, 6:14, 22:31]  # their windows are even
    assert (depths[0][inner] > 0.0).mean() > 0.05 and not depths[1][inner].any()


@pytest.mark.parametrize("side", [1, 3, 5, 7])
def test_depth_follows_from_the_median(device: wp.Device, side: int) -> None:
    found = matched(sensors.StereoMatching(max_disparity=16, block=(1, 1), median=side), images(), device)
    checked, radius = found["checked"], side // 2
    assert (checked < 0.0).any()
    expected = checked.copy()
    windows = np.lib.stride_tricks.sliding_window_view(checked, (side, side), axis=(1, 2))
    inner = slice(radius, HEIGHT - radius), slice(radius, WIDTH - radius)
    expected[:, *inner] = np.median(windows, axis=(-2, -1))
    measured = expected >= 1.0  # baseline and focal length are 1, and so is the greatest depth
    assert measured.any() and not measured.all()
    assert (found["disparity"] == np.where(measured, expected, 0.0)).all()
    assert np.abs(found["depth"] - np.where(measured, 1.0 / np.maximum(expected, 1.0), 0.0)).max() < 1e-6


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_disparity": 24}, "max_disparity must be a multiple of 16 from 16 to 256, got 24"),
        ({"max_disparity": 272}, "max_disparity must be a multiple of 16 from 16 to 256, got 272"),
        ({"max_disparity": 64.0}, "max_disparity must be a multiple of 16 from 16 to 256, got 64.0"),
        ({"census": (6, 7)}, r"census must be width and height, both odd, got \(6, 7\)"),
        ({"census": 7}, "census must be width and height, both odd, got 7"),
        ({"census": (13, 5)}, r"census must have from 3 to 63 pixels, got \(13, 5\)"),
        ({"census": (1, 1)}, r"census must have from 3 to 63 pixels, got \(1, 1\)"),
        ({"block": (3, -1)}, r"block must be width and height, both odd, got \(3, -1\)"),
        ({"block": (21, 21)}, "must be below 32768, got 4 .* 441 .*"),
        ({"p1": 0}, "p1 must be a whole number of at least 1, got 0"),
        ({"p1": 8, "p2": 8}, "p2 must be a whole number above p1, which is 8, got 8"),
        ({"p2": "32"}, "p2 must be a whole number above p1, which is 8, got '32'"),
        ({"p2": 40000}, r"must be below 32768, got 4 .* 49 .* \(24 . 40000\)"),
        ({"paths": 5}, "paths must be 4 or 8, got 5"),
        ({"paths": 4.0}, "paths must be 4 or 8, got 4.0"),
        ({"paths": np.array([4, 8])}, r"paths must be 4 or 8, got array"),
        ({"contrast": 256}, "contrast must be a whole number from 0 to 255, got 256"),
        ({"uniqueness": 100}, "uniqueness must be a whole number from 0 to 99, got 100"),
        ({"subpixel": "cubic"}, "subpixel must be 'parabola' or 'equiangular', got 'cubic'"),
        ({"max_difference": -1}, "max_difference must be a whole number of at least 0, or None, got -1"),
        ({"median": 4}, "median must be 1, 3, 5 or 7, got 4"),
        ({"median": 3.0}, "median must be 1, 3, 5 or 7, got 3.0"),
    ],
)
def test_settings_that_cannot_be_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(WarpcamError, match=f"StereoMatching: .*{message}"):
        sensors.StereoMatching(**options)


@pytest.mark.filterwarnings("error")
def test_whole_numbers_of_numpy_do_not_overflow() -> None:
    options = {"max_disparity": 64, "p1": 8, "p2": 33, "paths": 8, "contrast": 3, "uniqueness": 90, "median": 5}
    plain, small = (
        sensors.StereoMatching(**{name: kind(number) for name, number in options.items()}) for kind in (int, np.int8)
    )
    assert plain == small and plain.bytes_per_world(80, 60) == small.bytes_per_world(80, 60)
    assert all(type(getattr(small, name)) is int for name in options)
    assert sensors.StereoMatching(max_difference=2**31).matcher(8, 8).max_difference >= 256


def test_settings_are_sapiens() -> None:
    """As of ``StereoDepthSensorConfig``."""
    matching = sensors.StereoMatching()
    assert (matching.max_disparity, matching.census, matching.block) == (128, (7, 7), (7, 7))
    assert (matching.p1, matching.p2, matching.paths) == (8, 32, 4)
    assert (matching.uniqueness, matching.max_difference, matching.median) == (15, 1, 3)
