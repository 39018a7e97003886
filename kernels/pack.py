"""Colours as bytes."""

import warp as wp


@wp.func
def to_byte(value: wp.float32) -> wp.uint8:
    """The nearest of 255 steps of [0, 1]; what lies outside is clipped, NaN is 0."""
    byte = wp.int32(0)
    if value > 0.0:
        byte = wp.int32(wp.min(value, 1.0) * 255.0 + 0.5)
    return wp.uint8(byte)
