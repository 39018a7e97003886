"""A tile leaves no box out that one of its rays meets, and leaves most of the others out."""

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

BOXES, RAYS = 20_000, 400  # so many rays of each tile, its corners among them
DEVICES = [str(device) for device in wp.get_devices()]


@wp.func_native("""
    using namespace warpcam;
    ShapeRecord record {};
    record.axis_x = { turn.data[0][0], turn.data[0][1], turn.data[0][2], 0 };
    record.axis_y = { turn.data[1][0], turn.data[1][1], turn.data[1][2], 0 };
    record.axis_z = { turn.data[2][0], turn.data[2][1], turn.data[2][2], 0 };
    record.origin = { origin[0], origin[1], origin[2], 0 };
    record.size.x = extent;
    wp::index(may, i) = may_meet_box(record, { low[0], low[1], low[2] }, { high[0], high[1], high[2] },
                                     { tile[0], tile[1], tile[2], tile[3] });
""")
def try_box(
    turn: wp.mat33,
    origin: wp.vec3,
    extent: wp.float32,
    low: wp.vec3,
    high: wp.vec3,
    tile: wp.vec4,
    i: wp.int32,
    may: wp.array(dtype=wp.bool),
): ...


@native_kernel("camera/tile_frustum.h")
def try_boxes(
    turn: wp.array(dtype=wp.mat33),
    origin: wp.array(dtype=wp.vec3),
    extent: wp.array(dtype=wp.float32),
    low: wp.array(dtype=wp.vec3),
    high: wp.array(dtype=wp.vec3),
    tile: wp.array(dtype=wp.vec4),
    may: wp.array(dtype=wp.bool),
):
    i = wp.tid()
    try_box(turn[i], origin[i], extent[i], low[i], high[i], tile[i], i, may)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("distance", [0.3, 30.0])
def test_boxes_that_rays_meet_are_kept(device: str, distance: float):
    random = np.random.default_rng(7)
    turn = np.linalg.qr(random.normal(size=(BOXES, 3, 3)))[0]
    half = 10.0 ** random.uniform(-3.0, 0.0, (BOXES, 3))
    middle = random.normal(scale=0.3, size=(BOXES, 3))
    low, high = middle - half, middle + half
    # where rays begin: around the box, sometimes in it, and seen from there it is about before the camera, or behind
    origin = middle + distance * random.normal(size=(BOXES, 3))
    center = random.uniform(-1.0, 1.0, (BOXES, 2))
    size = 10.0 ** random.uniform(-3.0, -0.5, (BOXES, 2))
    # half of the tiles look at a point of their box
    aimed = np.arange(BOXES) % 2 == 0
    away = np.einsum("nji,nj->ni", turn, middle + random.uniform(-1.0, 1.0, (BOXES, 3)) * half - origin)
    aimed &= np.abs(away[:, 2]) > 1e-3
    x, y = -away[:, 0] / away[:, 2], -away[:, 1] / away[:, 2]
    aimed &= np.maximum(abs(x), abs(y)) < 3.0
    center[aimed] = np.stack([x, y], 1)[aimed]
    first, last = center - size, center + size
    tile = np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], 1)
    tile, turn, origin = (np.asarray(a, np.float32) for a in (tile, turn, origin))
    low, high = np.asarray(low, np.float32), np.asarray(high, np.float32)

    met = np.zeros(BOXES, bool)
    for ray in range(RAYS):
        part = random.uniform(size=(BOXES, 2)) if ray > 3 else np.full((BOXES, 2), (ray % 2, ray // 2), np.float64)
        x = tile[:, 0] + part[:, 0] * (tile[:, 1].astype(np.float64) - tile[:, 0])
        y = tile[:, 2] + part[:, 1] * (tile[:, 3].astype(np.float64) - tile[:, 2])
        step = np.einsum("nij,nj->ni", turn.astype(np.float64), np.stack([x, y, -np.ones(BOXES)], 1))
        ends = np.sort([(low - origin.astype(np.float64)) / step, (high - origin.astype(np.float64)) / step], axis=0)
        met |= np.maximum(ends[0].max(axis=1), 0.0) <= ends[1].min(axis=1)

    may = wp.zeros(BOXES, dtype=wp.bool, device=device)
    extent = np.maximum(abs(low), abs(high)).max(axis=1)
    inputs = [
        wp.array(array, dtype=dtype, device=device)
        for array, dtype in (
            (turn, wp.mat33), (origin, wp.vec3), (extent, wp.float32), (low, wp.vec3), (high, wp.vec3), (tile, wp.vec4),
        )
    ]  # fmt: skip
    wp.launch(try_boxes, dim=BOXES, inputs=[*inputs, may], device=device)
    kept = may.numpy()
    assert met.sum() > BOXES // 10
    assert kept[met].all()
    assert (kept & ~met).sum() < 0.2 * (~met).sum()
