"""Bounds of round shapes in a view: no point of them lies outside, and little is left free."""

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels.types import CAPSULE, CYLINDER, ELLIPSOID, SPHERE

DEVICES = [str(device) for device in wp.get_devices()]
SHAPES, POINTS = 4000, 400


@wp.func_native("""
    using namespace warpcam;
    Mat3 rows;
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
            rows.at[r][c] = axes.data[r][c];
    ViewSpan span { MISS, -MISS, MISS, -MISS };
    if (pinhole)
        span_round<PINHOLE>(kind, as_vec3(center), -center[2], rows, as_vec3(half), span);
    else
        span_round<ORTHOGRAPHIC>(kind, as_vec3(center), -center[2], rows, as_vec3(half), span);
    wp::index(spans, i) = wp::vec4(span.left, span.right, span.low, span.high);
""")
def find_span(
    kind: wp.int32,
    pinhole: wp.int32,
    center: wp.vec3,
    axes: wp.mat33,
    half: wp.vec3,
    i: wp.int32,
    spans: wp.array(dtype=wp.vec4),
): ...


@native_kernel("camera/shape_setup.h")
def span(
    kind: wp.int32,
    pinhole: wp.int32,
    center: wp.array(dtype=wp.vec3),
    axes: wp.array(dtype=wp.mat33),
    half: wp.array(dtype=wp.vec3),
    spans: wp.array(dtype=wp.vec4),
):
    i = wp.tid()
    find_span(kind, pinhole, center[i], axes[i], half[i], i, spans)


def surface(kind: int, half: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Points of each shape in its own frame, (shape, point, 3)."""
    ways = random.normal(size=(len(half), POINTS, 3))
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    if kind in (SPHERE, ELLIPSOID):
        return ways * half[:, None]
    points = ways * half[:, None, :1]
    straight = half[:, None, 2] - (half[:, None, 0] if kind == CAPSULE else 0.0)
    if kind == CYLINDER:
        points[..., :2] /= np.linalg.norm(ways[..., :2], axis=-1, keepdims=True)
        points[..., 2] = 0.0
    points[..., 2] += np.where(ways[..., 2] > 0.0, 1.0, -1.0) * straight
    return points


@pytest.mark.parametrize("pinhole", [True, False])
@pytest.mark.parametrize("kind", [SPHERE, CAPSULE, ELLIPSOID, CYLINDER])
@pytest.mark.parametrize("where", DEVICES)
def test_all_of_a_round_shape_lies_in_its_span(where: str, kind: int, pinhole: bool) -> None:
    random = np.random.default_rng(kind)
    half = (10.0 ** random.uniform(-2.0, 0.0, (SHAPES, 3))).astype(np.float32)
    if kind != ELLIPSOID:
        half[:, 1] = half[:, 0]
    if kind == SPHERE:
        half[:, 2] = half[:, 0]
    if kind == CAPSULE:
        half[:, 2] += half[:, 0]
    axes = np.linalg.qr(random.normal(size=(SHAPES, 3, 3)))[0].astype(
        np.float32
    )  # rows: its axes as the camera has them
    depth = np.linalg.norm(half, axis=1) * (1.01 + 10.0 ** random.uniform(-2.0, 2.0, SHAPES))
    aside = random.uniform(-1.0, 1.0, (SHAPES, 2)) * depth[:, None]
    center = np.concatenate((aside, -depth[:, None]), axis=1).astype(np.float32)
    with wp.ScopedDevice(where):
        spans = wp.zeros(SHAPES, dtype=wp.vec4)
        inputs = [kind, int(pinhole), *(wp.array(a, dtype=t) for a, t in ((center, wp.vec3), (axes, wp.mat33)))]
        wp.launch(span, SHAPES, [*inputs, wp.array(half, dtype=wp.vec3), spans])
        found = spans.numpy().astype(np.float64)
    seen = surface(kind, half.astype(np.float64), random) @ axes.astype(np.float64) + center[:, None]
    places = seen[..., :2] / (-seen[..., 2:] if pinhole else 1.0)
    least, most = places.min(axis=1), places.max(axis=1)
    low, high = found[:, (0, 2)], found[:, (1, 3)]
    rounding = 1e-6 * (1.0 + np.abs(center[:, :2]))  # a thousandth of a pixel, in a view of 1,000
    assert (low <= least + rounding).all()
    assert (high >= most - rounding).all()
    assert np.median((high - low) / (most - least)) < 1.03
