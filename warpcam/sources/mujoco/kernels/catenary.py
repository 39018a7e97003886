"""Strings that hang slack between two points."""

import warp as wp

STEEP = 100.0  # so many times longer than its ends are apart, a string hangs as if from a bead


@wp.func
def asinh(x: wp.float64) -> wp.float64:
    return wp.log(x + wp.sqrt(x * x + wp.float64(1.0)))


@wp.func
def half_span(ratio: wp.float64) -> wp.float64:
    """The x above 0 where sinh(x) is ``ratio`` times x, for a ratio above 1. All steps come from above."""
    x = wp.sqrt(wp.float64(6.0) * (ratio - wp.float64(1.0)))
    for _step in range(3):
        x = wp.min(x, asinh(ratio * x))
    for _step in range(12):
        rise = wp.sinh(x)
        x -= (rise - ratio * x) / (wp.cosh(x) - ratio)
    return x


@wp.func
def hanging_point(
    start: wp.vec3, end: wp.vec3, up: wp.vec3, length: wp.float32, number: wp.int32, points: wp.int32
) -> wp.vec3:
    """Point ``number`` of a string between two ends: of ``points``, the last is the second end.

    A string that is too short is straight, from its first point to its second; one that hangs nearly straight down has
    three points. Further points are the end.
    """
    along = end - start
    if number == 0:
        return start
    if wp.length(along) > length:
        return end
    rise = wp.dot(along, up)
    level = along - rise * up
    across = wp.length(level)
    if across > 1.0e-12:
        level = level / across
    if length > STEEP * across:
        if number > 1:
            return end
        down = -0.5 * (wp.sqrt(length * length - across * across) - rise)
        return start + down * up + across * down / (2.0 * down - rise) * level
    if number >= points - 1:
        return end
    h, v, s = wp.float64(across), wp.float64(rise), wp.float64(length)
    ratio = wp.sqrt(s * s - v * v) / h
    place = wp.float64(number) * h / wp.float64(points)
    height = v * place / h
    if ratio > wp.float64(1.0) + wp.float64(1.0e-12):
        flatness = wp.float64(0.5) * h / half_span(ratio)
        lowest = wp.float64(0.5) * (h - flatness * wp.log((s + v) / (s - v)))
        height = flatness * (wp.cosh((place - lowest) / flatness) - wp.cosh(lowest / flatness))
    return start + wp.float32(place) * level + wp.float32(height) * up
