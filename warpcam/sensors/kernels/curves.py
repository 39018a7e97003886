"""The curves of sRGB, quick on a GPU, and as tables between bytes and linear light."""

import warp as wp

from warpcam.core.color import decode_srgb, encode_srgb
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import bind_launch
from warpcam.sensors.kernels.arithmetic import power

wp.set_module_options(compiler_flags())

# Bytes of display values by bits of linear light: a table has an entry for each number of the upper 16 bits of a float
# from 2^-13, which is less than the byte 1 needs, to 1. An entry spans less light than two bytes are apart.
LEAST = wp.constant(2.0**-13)
FIRST_ENTRY = wp.constant(0x3900)  # upper bits of LEAST
BYTE_ENTRIES = 0x3F80 - 0x3900 + 1


@wp.func
def encode(light: wp.float32) -> wp.float32:
    """Linear light, cut off at black and white, as a display value."""
    bounded = wp.clamp(light, 0.0, 1.0)
    return wp.where(bounded <= 0.0031308, 12.92 * bounded, 1.055 * power(bounded, 1.0 / 2.4) - 0.055)


@wp.func
def decode(value: wp.float32) -> wp.float32:
    """A display value, without an upper bound, as linear light."""
    if value <= 0.04045:
        return value / 12.92
    return power((value + 0.055) / 1.055, 2.4)


@wp.func
def display_byte(light: wp.float32) -> wp.int32:
    """Byte of linear light from 0 to 1."""
    return wp.int32(encode_srgb(light) * 255.0 + 0.5)


@wp.func_native("return bytes_of_light.data[entry];")
def byte_entry(bytes_of_light: wp.array(dtype=wp.int32), entry: wp.int32) -> wp.int32:
    """An entry of ``byte_table``, without the strides of arrays."""
    ...


@wp.func
def encode_byte(bytes_of_light: wp.array(dtype=wp.int32), light: wp.float32) -> wp.int32:
    """Linear light, cut off at black and white, as a byte by the table of ``byte_table``."""
    bits = wp.cast(wp.min(wp.max(LEAST, light), 1.0), wp.int32)
    return (byte_entry(bytes_of_light, (bits >> 16) - FIRST_ENTRY) + (bits & 0xFFFF)) >> 16


@wp.kernel(enable_backward=False)
def fill_light(light: wp.array(dtype=wp.float32), first: wp.int32):
    byte = first + wp.tid()
    light[byte] = decode_srgb(wp.float32(byte) / 255.0)


@wp.kernel(enable_backward=False)
def fill_bytes(entries: wp.array(dtype=wp.int32), first: wp.int32):
    """Entries to which the lower 16 bits of light are added: the upper half of the sum is the byte.

    An entry is its first byte times 2^16, plus 2^16 less the lower bits with which the next byte begins.
    """
    entry = first + wp.tid()
    start = (entry + FIRST_ENTRY) << 16
    byte = display_byte(wp.cast(start, wp.float32))
    low = wp.int32(0)
    high = wp.int32(0x10000)  # the next byte begins above low, at high or below
    while high - low > 1:
        middle = (low + high) // 2
        if display_byte(wp.cast(start + middle, wp.float32)) > byte:
            high = middle
        else:
            low = middle
    entries[entry] = (byte << 16) + 0x10000 - high


def light_table(device: wp.Device) -> wp.array:
    """Linear light of each byte of a display colour, (256,) float32."""
    light = wp.empty(256, dtype=wp.float32, device=device)
    bind_launch(fill_light, light.size, [light], device).launch()
    return light


def byte_table(device: wp.Device) -> wp.array:
    """Table by which ``encode_byte`` finds the byte of a display colour, (BYTE_ENTRIES,) int32."""
    entries = wp.empty(BYTE_ENTRIES, dtype=wp.int32, device=device)
    bind_launch(fill_bytes, entries.size, [entries], device).launch()
    return entries
