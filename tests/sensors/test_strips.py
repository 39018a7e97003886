"""Strips, in which effects go through an image, and effects whose threads share what neighbours read."""

import numpy as np
import pytest
import warp as wp
from depth_frames import FOCAL, DepthBench

from warpcam import sensors
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import strip_of, strips_of
from warpcam.kernels.runtime.launch import bind_launch, run

wp.set_module_options(compiler_flags())
SIZES = ((1, 1), (5, 3), (3, 4), (8, 5), (2, 9))  # width and height


@wp.kernel(enable_backward=False)
def count_visits(size: wp.vec2i, visits: wp.array3d(dtype=wp.int32), first: wp.int32):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    for row in range(top, bottom):
        wp.atomic_add(visits, world, row, column, 1)


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_each_pixel_is_in_one_strip(width: int, height: int, device: wp.Device) -> None:
    visits = wp.zeros((3, height, width), dtype=wp.int32, device=device)
    run([bind_launch(count_visits, 3 * strips_of(width, height), [wp.vec2i(width, height), visits], device)])
    assert (visits.numpy() == 1).all()


def depth_image(width: int, height: int) -> np.ndarray:
    """Two worlds of slopes and steps, with pixels of 0 and of infinity."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:height, :width]
    image = np.stack([1.0 + 0.01 * x + 0.004 * y, np.where(x < 0.4 * width, 1.0, 1.15) + 0.02 * (y > 0.6 * height)])
    image[rng.random(image.shape) < 0.03] = 0.0
    image[rng.random(image.shape) < 0.03] = np.inf
    return image.astype(np.float32)


def windows(image: np.ndarray, radius: int, outside: float) -> np.ndarray:
    """Windows of all pixels, (world, height, width, 2 radius + 1, 2 radius + 1)."""
    padded = np.pad(image, ((0, 0), (radius, radius), (radius, radius)), constant_values=outside)
    return np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1, 2 * radius + 1), axis=(1, 2))


WINDOWS = [(1, 0.1, 0.89), (2, 0.1, 0.83), (4, 0.1, 0.81), (7, 0.03, 0.91), (12, 0.02, 0.93)]


@pytest.mark.parametrize(("radius", "tolerance", "share"), WINDOWS)
@pytest.mark.parametrize(("width", "height"), [*SIZES, (37, 30), (70, 40)])
def test_windows_match_by_their_rule(
    radius: int, tolerance: float, share: float, width: int, height: int, device: wp.Device
) -> None:
    image = depth_image(width, height)
    near = windows(image.astype(np.float64), radius, -1.0)
    valid, inside = (near > 0.0) & np.isfinite(near), near >= 0.0
    disparities = FOCAL * 0.05 / np.where(valid, near, 1.0)
    means = (disparities * valid).sum(axis=(3, 4)) / np.maximum(valid.sum(axis=(3, 4)), 1)
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    limits = tolerance * np.where(x * x + y * y > 0, 1.44 * (x * x + y * y), 1.0)
    deviations = np.abs(disparities - means[..., None, None])
    needed = share * inside.sum(axis=(3, 4))
    least, most = (((deviations < limits + margin) & valid).sum(axis=(3, 4)) for margin in (-1e-4, 1e-4))
    measured = (image > 0.0) & np.isfinite(image)
    kept = DepthBench(sensors.MatchingWindow(0.05, tolerance, share, radius=radius), device).measure(image)
    assert (kept == np.where(measured & (kept == 0.0), 0.0, image)).all()
    assert (kept == image)[measured & (least >= needed + 1e-4)].all()
    assert (kept == 0.0)[measured & (most < needed - 1e-4)].all()
    sure = (least >= needed + 1e-4) | (most < needed - 1e-4)
    assert sure[measured].mean() > 0.9
    if width >= 37:
        assert 0.01 < (kept == 0.0)[measured].mean() < 0.98


@pytest.mark.parametrize(("width", "height"), [*SIZES, (37, 30)])
def test_edges_are_those_of_three_by_three_pixels(width: int, height: int, device: wp.Device) -> None:
    image = depth_image(width, height)
    near = windows(image, 1, 0.0)
    greatest = near.max(axis=(3, 4))
    with np.errstate(invalid="ignore"):
        spans = greatest - np.where(near > 0.0, near, np.inf).min(axis=(3, 4))
    edges = (image > 0.0) & np.isfinite(image) & (spans > 0.1)
    dropped = DepthBench(sensors.EdgeDropout(threshold=0.1), device).measure(image)
    assert (dropped == np.where(edges, 0.0, image)).all()
    flying = DepthBench(sensors.FlyingPixels(threshold=0.1, probability=1.0), device).measure(image)
    mixed = edges & np.isfinite(greatest)
    assert (flying == image)[~mixed].all()
    assert (flying <= greatest)[mixed].all() and (flying > 0.0)[mixed].all()


@pytest.mark.parametrize("baseline", [0.1, -0.1])
def test_shadows_of_rows_of_any_length(baseline: float, device: wp.Device) -> None:
    """The nearest surface of a row counts, wherever it lies."""
    for width in (1, 15, 17, 50):
        image = np.full((1, 5, width), 1.0, np.float32)
        place = width - 1 if baseline > 0.0 else 0
        image[0, 1:, place] = 0.6
        holes = DepthBench(sensors.StereoShadow(baseline, border=False), device).measure(image)[0] == 0.0
        hidden = place - np.sign(baseline) * FOCAL * 0.1 * (1.0 / 0.6 - 1.0)
        found = np.flatnonzero(holes[1])
        assert not holes[0].any() and (holes[1:] == holes[1]).all()
        assert found.size == (0 if width < 14 else 1) and (abs(found - hidden) <= 0.5).all()
