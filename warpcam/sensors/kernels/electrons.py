"""Noise of light and electronics: numbers of electrons, and what is read of them."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import color_strip_of
from warpcam.sensors.kernels.arithmetic import inverse_root, quotient
from warpcam.sensors.kernels.color_images import ColorSource, ColorTarget, color_at, set_color
from warpcam.sensors.kernels.random import Randomness, frame_state, three_normals, two_normals
from warpcam.sensors.kernels.tone import greatest_number

wp.set_module_options(compiler_flags())

# Least mean for which Poisson's distribution is approximated. The approximation's distribution function is off by less
# than 4e-4 from here on, and its mean and variance by less than 1e-3 of the mean.
APPROXIMATE_FROM = wp.constant(4.0)
CHANNELS_APART = wp.constant(wp.uint32(0x9E3779B9))  # of a pixel: between states of the random generator


@wp.struct
class LinearCamera:
    """Parameters of the EMVA 1288 camera model, (world,) each."""

    quantum_efficiency: wp.array(dtype=wp.float32)  # electrons for each photon
    photons_at_white: wp.array(dtype=wp.float32)  # photons that light of 1 brings to a pixel in an exposure
    full_well: wp.array(dtype=wp.float32)  # most electrons that a pixel holds
    gain: wp.array(dtype=wp.float32)  # K [DN / e-]
    dark_current: wp.array(dtype=wp.float32)  # [e- / s]
    exposure_time: wp.array(dtype=wp.float32)  # [s]
    dark_noise: wp.array(dtype=wp.float32)  # standard deviation [e-]
    black_level: wp.array(dtype=wp.float32)  # [DN]
    bits: wp.array(dtype=wp.float32)  # of the converter


@wp.func
def many_electrons(mean: wp.float32, normal: wp.float32) -> wp.float32:
    """A number of Poisson's distribution with a mean of at least APPROXIMATE_FROM, from a standard normal number.

    The expansion of the inverse distribution function to 1 / mean: Giles, "Algorithm 955: approximation of the inverse
    Poisson cumulative distribution function", ACM TOMS 42(1), 2016.
    """
    inverse = inverse_root(mean)
    root = mean * inverse
    square = normal * normal
    correction = (2.0 + square) * (1.0 / 6.0 - (1.0 / 72.0) * normal * inverse)
    small = ((square * (1.0 / 270.0) + 7.0 / 810.0) * square - 8.0 / 405.0) * inverse * inverse
    return wp.max(wp.floor(mean + root * normal + correction + small), 0.0)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
float exponential;
asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(exponential) : "f"(1.44269504f * mean));
#else
const float exponential = wp::exp(mean);
#endif
union { float number; unsigned int bits; } above = { 1.0f - wp::min(uniform, 0.9999996f) * exponential };
unsigned int count = above.bits >> 31;  // 1 of a number below 0
float power = 1.0f, share = 1.0f;
#if defined(__CUDA_ARCH__)
#pragma unroll
#endif
for (int step = 1; step < 19; ++step) {
    power *= mean;
    share *= 1.0f / step;
    above.number += power * share;
    count += above.bits >> 31;
    if (step > 3 && step % 2 == 0 && above.number >= 0.0f)
        break;
}
return (float)count;
""")
def few_electrons(mean: wp.float32, uniform: wp.float32) -> wp.float32:
    """A number of Poisson's distribution with a mean below APPROXIMATE_FROM, by inversion: exact to 1e-6.

    It is counted along the distribution function, over ``exp(-mean)``, until that passes ``uniform``, of which the last
    4e-7 count as one number: rounded sums do not come closer to 1. With a mean of 4 it is at most 18.
    """
    ...


@wp.func
def many_of(means: wp.vec3, normals: wp.vec3) -> wp.vec3:
    """Numbers of Poisson's distribution with those means, as far as they are of many electrons."""
    return wp.vec3(
        many_electrons(wp.max(means[0], APPROXIMATE_FROM), normals[0]),
        many_electrons(wp.max(means[1], APPROXIMATE_FROM), normals[1]),
        many_electrons(wp.max(means[2], APPROXIMATE_FROM), normals[2]),
    )


@wp.func
def few_of(means: wp.vec3, many: wp.vec3, state: wp.uint32) -> wp.vec3:
    """Numbers of Poisson's distribution with those means: of many electrons those given, others from the state.

    A channel is on its own, as in many images one is dark where others are not. Its random number follows from the
    state and from none that normal numbers are made of.
    """
    counts = many
    for k in range(3):
        if means[k] < APPROXIMATE_FROM:
            own = state + wp.uint32(k + 1) * CHANNELS_APART
            counts[k] = few_electrons(means[k], wp.randf(own))
    return counts


@wp.kernel(enable_backward=False, grid_stride=False)
def count_electrons(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    electrons_at_white: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    scale = electrons_at_white[world]
    light = quotient(1.0, scale)  # of an electron
    random = frame_state(randomness, world)
    ahead = color_at(source, world, top * size[0] + column)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        means = scale * wp.vec3(wp.max(ahead[0], 0.0), wp.max(ahead[1], 0.0), wp.max(ahead[2], 0.0))
        ahead = color_at(source, world, wp.min(row + 1, bottom - 1) * size[0] + column)
        state = wp.rand_init(random, pixel)
        counts = wp.vec3()
        if wp.max(means) >= APPROXIMATE_FROM:
            counts = many_of(means, three_normals(state))
        set_color(target, world, pixel, light * few_of(means, counts, state))


@wp.kernel(enable_backward=False, grid_stride=False)
def add_normal(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    sigma: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    spread = sigma[world]
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        normals = three_normals(wp.rand_init(random, pixel))
        set_color(target, world, pixel, color_at(source, world, pixel) + spread * normals)


@wp.kernel(enable_backward=False, grid_stride=False)
def measure_linearly(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    camera: LinearCamera,
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    """Photons to electrons to digital numbers, and these as linear light again."""
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    at_white = camera.quantum_efficiency[world] * camera.photons_at_white[world]
    dark = camera.dark_current[world] * camera.exposure_time[world]
    black = camera.black_level[world]
    gain = camera.gain[world]
    highest = greatest_number(camera.bits[world])
    full_well = camera.full_well[world]
    dark_noise = camera.dark_noise[world]
    step = quotient(1.0, gain * at_white)  # light of a digital number
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        state = wp.rand_init(random, pixel)
        light = color_at(source, world, pixel)
        means = wp.vec3()
        normals = wp.vec3()
        noise = wp.vec3()
        for k in range(3):
            of_light, of_dark, state = two_normals(state)
            means[k] = wp.max(light[k], 0.0) * at_white + dark
            normals[k] = of_light
            noise[k] = dark_noise * of_dark
        electrons = wp.vec3()
        if wp.max(means) >= APPROXIMATE_FROM:
            electrons = many_of(means, normals)
        electrons = few_of(means, electrons, state)
        for k in range(3):
            number = wp.floor(gain * (wp.min(electrons[k], full_well) + noise[k]) + black + 0.5)
            light[k] = (wp.clamp(number, 0.0, highest) - black) * step
        set_color(target, world, pixel, light)
