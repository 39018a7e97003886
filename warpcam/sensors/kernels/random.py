"""Random numbers of measurements: each follows from a seed, its world, frame, effect and element alone."""

import warp as wp

ANY_WORLD = -1
OF_24_BITS, OF_16_BITS = wp.constant(2.0**-24), wp.constant(2.0**-16)  # parts of 1


@wp.struct
class Randomness:
    """Sources of the random numbers of one effect."""

    seeds: wp.array(dtype=wp.int32)  # (world,)
    frames: wp.array(dtype=wp.int32)  # (world,) frames that were measured, this one among them
    # Number of the first world of the arrays, so that random numbers do not depend on how worlds are grouped; or
    # ANY_WORLD: worlds with the same seed have the same numbers.
    first_world: wp.int32
    stream: wp.int32  # a number of the effect, other effects have others


@wp.func
def world_state(randomness: Randomness, world: wp.int32, frame: wp.int32) -> wp.int32:
    """State that is common to a world's elements in one frame."""
    state = wp.rand_init(randomness.seeds[world], randomness.stream)
    number = wp.where(randomness.first_world == ANY_WORLD, 0, randomness.first_world + world)
    state = wp.rand_init(wp.int32(state), number)
    return wp.int32(wp.rand_init(wp.int32(state), frame))


@wp.func
def frame_state(randomness: Randomness, world: wp.int32) -> wp.int32:
    """State that is common to a world's elements in this frame; ``wp.rand_init`` takes it and an element."""
    return world_state(randomness, world, randomness.frames[world])


@wp.func
def device_state(randomness: Randomness, world: wp.int32) -> wp.int32:
    """State that is common to a world's elements in all frames; ``wp.rand_init`` takes it and an element."""
    return world_state(randomness, world, -1)


@wp.func
def element_state(randomness: Randomness, world: wp.int32, element: wp.int32) -> wp.uint32:
    """State of Warp's random generator for one element, most often a pixel, of a world in this frame.

    ``wp.randf``, ``wp.randn`` and ``wp.poisson`` draw from it, each the next number.
    """
    return wp.rand_init(frame_state(randomness, world), element)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
float radius, sine, cosine;
asm("lg2.approx.ftz.f32 %0, %1;" : "=f"(radius) : "f"(1.0f - first));
asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(radius) : "f"(fabsf(1.3862944f * radius)));  // 2 ln 2
__sincosf(6.2831853f * second, &sine, &cosine);
#else
const float radius = wp::sqrt(-2.0f * wp::log(1.0f - first)), angle = 6.2831853f * second;
const float sine = wp::sin(angle), cosine = wp::cos(angle);
#endif
return wp::vec2(radius * cosine, radius * sine);
""")
def polar_normals(first: wp.float32, second: wp.float32) -> wp.vec2:
    """Two independent numbers of the standard normal distribution from two from 0 to below 1, by Box and Muller.

    On CUDA to 1e-6.
    """
    ...


@wp.func
def one_normal(state: wp.uint32) -> wp.float32:
    """A number of the standard normal distribution."""
    first = wp.randf(state)
    return polar_normals(first, wp.randf(state))[0]


@wp.func
def two_normals(state: wp.uint32):
    """Two independent numbers of the standard normal distribution, and the next state."""
    first = wp.randf(state)
    normals = polar_normals(first, wp.randf(state))
    return normals[0], normals[1], state


@wp.func
def three_normals(state: wp.uint32) -> wp.vec3:
    """Three independent numbers of the standard normal distribution, their angles to 2^-16 of a turn."""
    first = wp.randu(state)
    second = wp.randu(state)
    angles = wp.randu(state)
    upper = wp.float32(angles >> wp.uint32(16)) * OF_16_BITS
    lower = wp.float32(angles & wp.uint32(0xFFFF)) * OF_16_BITS
    pair = polar_normals(wp.float32(first >> wp.uint32(8)) * OF_24_BITS, upper)
    other = polar_normals(wp.float32(second >> wp.uint32(8)) * OF_24_BITS, lower)
    return wp.vec3(pair[0], pair[1], other[0])
