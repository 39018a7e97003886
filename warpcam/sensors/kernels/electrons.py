"""Noise of light and electronics: numbers of electrons, and what is read of them."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.random import Randomness, element_state
from warpcam.sensors.kernels.tone import greatest_number

wp.set_module_options(compiler_flags())

# Least mean for which Poisson's distribution is approximated. The approximation's distribution function is off by less
# than 5e-4 from here on, and its mean and variance by less than 1e-3 of the mean.
APPROXIMATE_FROM = wp.constant(32.0)
# Probability below which the tail of the exact distribution is cut off: less than the step of a random number.
LEAST_PROBABILITY = wp.constant(1.0e-8)


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
def two_normals(state: wp.uint32):
    """Two independent numbers of the standard normal distribution, by Box and Muller, and the next state."""
    radius = wp.sqrt(-2.0 * wp.log(1.0 - wp.randf(state)))
    angle = 6.2831853 * wp.randf(state)
    return radius * wp.cos(angle), radius * wp.sin(angle), state


@wp.func
def three_normals(state: wp.uint32):
    """Three independent numbers of the standard normal distribution, and the next state."""
    red, green, state = two_normals(state)
    blue, _, state = two_normals(state)
    return wp.vec3(red, green, blue), state


@wp.func
def electrons_of(mean: wp.float32, uniform: wp.float32, normal: wp.float32) -> wp.float32:
    """A number of Poisson's distribution with that mean.

    Few electrons are counted along the distribution function until it passes ``uniform``, which ends after at most
    69 steps. Many are a normal number with the skewness of Poisson's distribution, after Cornish and Fisher, and
    with its variance once rounded: (z^2 - 1) / 6 adds 1 / 18 to the variance and rounding 1 / 12.
    """
    if mean >= APPROXIMATE_FROM:
        spread = wp.sqrt(mean - 5.0 / 36.0)
        return wp.max(wp.floor(mean + spread * normal + (normal * normal - 1.0) / 6.0 + 0.5), 0.0)
    count = wp.float32(0.0)
    probability = wp.exp(-mean)
    passed = wp.float32(probability)
    while uniform >= passed and (count < mean or probability > LEAST_PROBABILITY):
        count += 1.0
        probability *= mean / count
        passed += probability
    return count


@wp.kernel(enable_backward=False)
def count_electrons(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    electrons_at_white: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    normals, state = three_normals(element_state(randomness, world, pixel))
    scale = electrons_at_white[world]
    light = source[world, pixel]
    measured = wp.vec3()
    for k in range(3):
        measured[k] = electrons_of(wp.max(light[k], 0.0) * scale, wp.randf(state), normals[k]) / scale
    target[world, pixel] = measured


@wp.kernel(enable_backward=False)
def add_normal(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    sigma: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    normals, _ = three_normals(element_state(randomness, world, pixel))
    target[world, pixel] = source[world, pixel] + sigma[world] * normals


@wp.kernel(enable_backward=False)
def measure_linearly(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    camera: LinearCamera,
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Photons to electrons to digital numbers, and these as linear light again."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    state = element_state(randomness, world, pixel)
    at_white = camera.quantum_efficiency[world] * camera.photons_at_white[world]
    dark = camera.dark_current[world] * camera.exposure_time[world]
    black = camera.black_level[world]
    gain = camera.gain[world]
    highest = greatest_number(camera.bits[world])
    light = source[world, pixel]
    measured = wp.vec3()
    for k in range(3):
        of_light, of_dark, state = two_normals(state)
        electrons = electrons_of(wp.max(light[k], 0.0) * at_white + dark, wp.randf(state), of_light)
        electrons = wp.min(electrons, camera.full_well[world]) + camera.dark_noise[world] * of_dark
        number = wp.clamp(wp.floor(gain * electrons + black + 0.5), 0.0, highest)
        measured[k] = (number - black) / (gain * at_white)
    target[world, pixel] = measured
