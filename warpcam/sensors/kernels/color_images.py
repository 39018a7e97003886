"""Colours that effects read and write: numbers, or bytes where a chain of effects begins or ends."""

from collections.abc import Mapping
from typing import Any

import warp as wp

from warpcam.sensors.kernels.curves import byte_table, encode, encode_byte, light_table

NUMBERS = wp.constant(0)
LIGHT_BYTES = wp.constant(1)  # bytes of display colours, which come and go as linear light
DISPLAY_BYTES = wp.constant(2)  # likewise, which come and go as display values
DISPLAY_NUMBERS = wp.constant(3)  # display values of linear light


@wp.struct
class ColorSource:
    """Colours before an effect."""

    kind: wp.int32  # NUMBERS or LIGHT_BYTES
    numbers: wp.array2d(dtype=wp.vec3)  # (world, pixel)
    bytes: wp.array3d(dtype=wp.uint8)  # (world, pixel, channel)
    light_of_bytes: wp.array(dtype=wp.float32)  # see ``curves.light_table``


@wp.struct
class ColorTarget:
    """Colours after an effect."""

    kind: wp.int32
    numbers: wp.array2d(dtype=wp.vec3)  # (world, pixel)
    bytes: wp.array3d(dtype=wp.uint8)  # (world, pixel, channel)
    truth: wp.array3d(dtype=wp.uint8)  # rendered bytes, whose alpha stays
    bytes_of_light: wp.array(dtype=wp.int32)  # see ``curves.byte_table``


# Images of an effect lie in memory one pixel after another: places are found without the strides of arrays. On CUDA a
# world's first pixel has a register of its own, or all that it is made of is added up anew for each pixel.


@wp.func_native("""
const wp::vec3* pixels = image.data + (size_t)image.shape[1] * world;
#if defined(__CUDA_ARCH__)
asm("" : "+l"(pixels));
__builtin_assume(__isGlobal(pixels));
#endif
return pixels[pixel];
""")
def numbers_at(image: wp.array2d(dtype=wp.vec3), world: wp.int32, pixel: wp.int32) -> wp.vec3:
    """Three numbers of a pixel."""
    ...


@wp.func_native("""
wp::vec3* pixels = image.data + (size_t)image.shape[1] * world;
#if defined(__CUDA_ARCH__)
asm("" : "+l"(pixels));
__builtin_assume(__isGlobal(pixels));
#endif
pixels[pixel] = value;
""")
def set_numbers(image: wp.array2d(dtype=wp.vec3), world: wp.int32, pixel: wp.int32, value: wp.vec3):
    """Write three numbers of a pixel."""
    ...


@wp.func_native("""
const int channels = image.shape[2];
const unsigned char* at = image.data + (size_t)(image.shape[1] * channels) * world;
#if defined(__CUDA_ARCH__)
asm("" : "+l"(at));
__builtin_assume(__isGlobal(at));
at += channels * pixel;
const float* light = light_of_bytes.data;  // with signs taken off, or loads of numbers are made one with these
return wp::vec3(fabsf(__ldg(light + at[0])), fabsf(__ldg(light + at[1])), fabsf(__ldg(light + at[2])));
#else
at += channels * pixel;
return wp::vec3(light_of_bytes.data[at[0]], light_of_bytes.data[at[1]], light_of_bytes.data[at[2]]);
#endif
""")
def light_at(
    image: wp.array3d(dtype=wp.uint8), light_of_bytes: wp.array(dtype=wp.float32), world: wp.int32, pixel: wp.int32
) -> wp.vec3:
    """Linear light of the first three bytes of a pixel."""
    ...


@wp.func_native("""
const int channels = image.shape[2];
const size_t start = (size_t)(image.shape[1] * channels) * world;
unsigned char* at = image.data + start;
#if defined(__CUDA_ARCH__)
asm("" : "+l"(at));
__builtin_assume(__isGlobal(at));
#endif
at += channels * pixel;
at[0] = (unsigned char)value[0];
at[1] = (unsigned char)value[1];
at[2] = (unsigned char)value[2];
if (channels == 4)
    at[3] = truth.data[start + 4 * pixel + 3];
""")
def set_bytes(
    image: wp.array3d(dtype=wp.uint8),
    truth: wp.array3d(dtype=wp.uint8),
    world: wp.int32,
    pixel: wp.int32,
    value: wp.vec3i,
):
    """Write the first three bytes of a pixel; a fourth is that of the truth."""
    ...


@wp.func
def color_at(source: ColorSource, world: wp.int32, pixel: wp.int32) -> wp.vec3:
    """Numbers of a pixel; linear light of bytes."""
    if source.kind == NUMBERS:
        return numbers_at(source.numbers, world, pixel)
    return light_at(source.bytes, source.light_of_bytes, world, pixel)


@wp.func
def set_color(target: ColorTarget, world: wp.int32, pixel: wp.int32, value: wp.vec3):
    """Write numbers of a pixel, or their bytes."""
    if target.kind == NUMBERS:
        set_numbers(target.numbers, world, pixel, value)
    elif target.kind == DISPLAY_NUMBERS:
        set_numbers(target.numbers, world, pixel, wp.vec3(encode(value[0]), encode(value[1]), encode(value[2])))
    else:
        shown = wp.vec3i()
        if target.kind == LIGHT_BYTES:
            for k in range(3):
                shown[k] = encode_byte(target.bytes_of_light, value[k])
        else:
            for k in range(3):
                shown[k] = wp.int32(wp.clamp(value[k], 0.0, 1.0) * 255.0 + 0.5)
        set_bytes(target.bytes, target.truth, world, pixel, shown)


def color_source(image: wp.array) -> Any:
    """``ColorSource`` of numbers, (world, pixel) vec3, or of bytes, (world, pixel, channel) uint8."""
    source = ColorSource()
    if image.dtype is wp.uint8:
        source.kind, source.bytes, source.light_of_bytes = int(LIGHT_BYTES), image, light_table(image.device)
    else:
        source.numbers = image
    return source


def color_target(image: wp.array, truth: Mapping[str, wp.array], is_linear: bool, through_srgb: bool = False) -> Any:
    """``ColorTarget`` of numbers or bytes, likewise.

    Args:
        image: Where colours are written to.
        truth: Rendered outputs by name; alpha of bytes with four channels is that of "rgba".
        is_linear: Bytes are made of linear light.
        through_srgb: Numbers are made of linear light, too.
    """
    target = ColorTarget()
    if image.dtype is wp.uint8:
        target.kind, target.bytes = int(LIGHT_BYTES if is_linear else DISPLAY_BYTES), image
        target.truth = truth["rgba"].reshape(image.shape) if image.shape[2] == 4 else image
        target.bytes_of_light = byte_table(image.device)
    else:
        target.kind, target.numbers = int(DISPLAY_NUMBERS if through_srgb else NUMBERS), image
    return target
