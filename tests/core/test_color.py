"""The sRGB transfer function, on the host and in Warp kernels."""

import numpy as np
import pytest
import warp as wp

from warpcam.core.color import decode_srgb, encode_srgb, encoded_beyond, linear_to_srgb, srgb_to_linear

VALUES = np.concatenate((np.linspace(0.0, 1.0, 1001), (0.04045, 0.0031308)))


@wp.kernel
def convert(values: wp.array(dtype=wp.float32), out: wp.array2d(dtype=wp.float32)):
    i = wp.tid()
    out[0, i] = decode_srgb(values[i])
    out[1, i] = encode_srgb(values[i])


def test_known_values() -> None:
    np.testing.assert_allclose(srgb_to_linear((0.0, 0.02, 0.5, 1.0)), (0.0, 0.02 / 12.92, 0.21404114, 1.0), rtol=1e-7)


@pytest.mark.parametrize("encode", [encoded_beyond, linear_to_srgb])
def test_encoding_inverts_decoding(encode) -> None:
    np.testing.assert_allclose(encode(srgb_to_linear(VALUES)), VALUES, atol=1e-7)


def test_light_beyond_white() -> None:
    assert encoded_beyond(4.0) > 1.5
    np.testing.assert_allclose(linear_to_srgb((4.0, -1.0, np.nan, np.inf)), (1.0, 0.0, 0.0, 1.0))


def test_precision_is_kept() -> None:
    values = VALUES.astype(np.float32)
    assert srgb_to_linear(values).dtype == encoded_beyond(values).dtype == np.float32


def test_kernels_agree_with_the_host(device: wp.Device) -> None:
    values = wp.array(VALUES.astype(np.float32), device=device)
    out = wp.zeros((2, len(VALUES)), dtype=wp.float32, device=device)
    wp.launch(convert, len(VALUES), [values, out], device=device)
    np.testing.assert_allclose(out.numpy(), (srgb_to_linear(VALUES), encoded_beyond(VALUES)), atol=1e-6)
