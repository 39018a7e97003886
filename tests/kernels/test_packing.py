"""Images in others' buffers, against numpy: rows of any length, from any column on."""

import numpy as np
import pytest
import warp as wp

from warpcam.compat.common import packing

WORLDS = 3
SIZES = [(4, 8), (3, 5), (1, 1), (2, 3)]  # height and width


def rows(device: wp.Device, dtype: object, columns: int) -> wp.array:
    """Make rows to write to, filled with sevens."""
    return wp.full((WORLDS, columns), dtype(7), dtype=dtype, device=device)


@pytest.mark.parametrize("offset", [0, 1, 4])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("order", [packing.RGBA, packing.BGRA], ids=["rgba", "bgra"])
def test_colors(device: wp.Device, order: tuple[int, int], channels: int, size: tuple[int, int], offset: int) -> None:
    random = np.random.default_rng(2)
    image = random.integers(0, 256, (WORLDS, *size, channels), np.uint8)
    image[..., 3:] = np.where(image[..., 3:] < 128, 0, image[..., 3:])
    pixels = size[0] * size[1]
    out = rows(device, wp.uint32, offset + pixels + 2)
    source = wp.array(image, dtype=wp.uint8, device=device)
    packing.bind_color(source, order, out, offset, device, miss_alpha=9).launch()
    seen = out.numpy()
    flat = image.reshape(WORLDS, pixels, channels).astype(np.uint32)
    alpha = np.where(flat[..., 3] == 0, 9, 255) if channels == 4 else np.full(flat.shape[:2], 255)
    expected = flat[..., 0] << order[0] | flat[..., 1] << 8 | flat[..., 2] << order[1] | alpha.astype(np.uint32) << 24
    np.testing.assert_array_equal(seen[:, offset : offset + pixels], expected)
    assert (np.delete(seen, np.s_[offset : offset + pixels], axis=1) == 7).all()


@pytest.mark.parametrize("size", SIZES)
def test_numbers(device: wp.Device, size: tuple[int, int]) -> None:
    random = np.random.default_rng(3)
    values = random.normal(size=(WORLDS, *size, 1)).astype(np.float32)
    values[random.uniform(size=values.shape) < 0.3] = np.inf
    values[0, 0, 0, 0] = -np.inf
    pixels = size[0] * size[1]
    flat, source = values.reshape(WORLDS, pixels), wp.array(values, dtype=wp.float32, device=device)
    out = rows(device, wp.float32, 3 + pixels)
    packing.bind_values(source, out, 3, device).launch()
    np.testing.assert_array_equal(out.numpy()[:, 3:], flat)
    assert (out.numpy()[:, :3] == 7).all()
    out = rows(device, wp.float32, pixels)
    packing.bind_clipped(source, 5.0, out, device).launch()
    np.testing.assert_array_equal(out.numpy(), np.where(flat == np.inf, 5.0, flat))
    packing.bind_negated(source, out, device).launch()
    np.testing.assert_array_equal(out.numpy(), -flat)


@pytest.mark.parametrize("size", SIZES)
def test_ids(device: wp.Device, size: tuple[int, int]) -> None:
    ids = np.random.default_rng(4).integers(-2, 6, (WORLDS, *size, 1)).astype(np.int32)
    pixels = size[0] * size[1]
    flat, source = ids.reshape(WORLDS, pixels), wp.array(ids, dtype=wp.int32, device=device)
    table = np.array([40, 41, 42, 43], np.int32)
    out = rows(device, wp.int32, pixels)
    numbers = wp.array(table, dtype=wp.int32, device=device)
    packing.bind_look_up(source, numbers, -9, -8, out, device).launch()
    known = (flat >= 0) & (flat < 4)
    np.testing.assert_array_equal(out.numpy(), np.where(known, table[flat % 4], np.where(flat == -1, -9, -8)))
    objects = np.arange(14, dtype=np.int32).reshape(7, 2)
    pairs = wp.zeros((WORLDS, 2 + pixels), dtype=wp.vec2i, device=device)
    packing.bind_objects(source, wp.array(objects, dtype=wp.vec2i, device=device), pairs, 2, device).launch()
    np.testing.assert_array_equal(pairs.numpy()[:, 2:], objects[np.where(flat < 0, 6, flat)])
    assert (pairs.numpy()[:, :2] == 0).all()
