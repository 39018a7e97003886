"""The sRGB transfer function (IEC 61966-2-1): display colours and linear light, on the host and in Warp kernels.

``native/core/srgb.h`` has the same functions for native code.
"""

from typing import Any

import numpy as np
import warp as wp


def srgb_to_linear(value: Any) -> np.ndarray:
    """Decode display values to linear light; floats keep their precision."""
    value = np.asarray(value)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def encoded_beyond(light: Any) -> np.ndarray:
    """Encode linear light without an upper bound: light brighter than white is more than 1."""
    light = np.asarray(light)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0) ** (1.0 / 2.4) - 0.055)


def linear_to_srgb(light: Any) -> np.ndarray:
    """Encode linear light in float64, cut off at what a display can show; NaN is 0."""
    return encoded_beyond(np.clip(np.nan_to_num(np.asarray(light, np.float64)), 0.0, 1.0))


@wp.func
def decode_srgb(value: wp.float32) -> wp.float32:
    """Decode a display value to linear light in a kernel."""
    if value <= 0.04045:
        return value / 12.92
    return wp.pow((value + 0.055) / 1.055, 2.4)


@wp.func
def encode_srgb(light: wp.float32) -> wp.float32:
    """Encode linear light in a kernel, without an upper bound."""
    if light <= 0.0031308:
        return 12.92 * light
    return 1.055 * wp.pow(light, 1.0 / 2.4) - 0.055
