"""Path of a tendon around an object: an arc on a sphere, a helix on a cylinder."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags

wp.set_module_options(compiler_flags())

BACK = 0.01  # so far back an arc seems to turn only where its ends are one point [radians]


@wp.struct
class Arc:
    """From a place on what it lies on, about an axis."""

    center: wp.vec3  # world frame [m]
    axis: wp.vec3  # unit
    start: wp.vec3  # from the axis, at right angles to it [m]
    height: wp.float32  # of the start along the axis, from the centre [m]
    rise: wp.float32  # of the end over the start [m]
    angle: wp.float32  # that it turns by, right-handed [radians]


@wp.func
def across(axis: wp.vec3, v: wp.vec3) -> wp.vec3:
    return v - wp.dot(axis, v) * axis


@wp.func
def arc_between(
    before: wp.vec3,
    first: wp.vec3,
    second: wp.vec3,
    after: wp.vec3,
    center: wp.vec3,
    rotation: wp.mat33,
    on_sphere: wp.bool,
) -> Arc:
    """The arc from ``first`` to ``second``, of a path that comes straight from ``before`` and goes on to ``after``."""
    u = first - center
    v = second - center
    come = first - before
    go = after - second
    axis = wp.vec3(rotation[0, 2], rotation[1, 2], rotation[2, 2])
    if on_sphere:
        axis = wp.normalize(wp.cross(u, v))
    turn = wp.dot(axis, wp.cross(u, come)) + wp.dot(axis, wp.cross(v, go))
    if turn < 0.0:
        axis = -axis
    arc = Arc()
    arc.center = center
    arc.axis = axis
    arc.start = across(axis, u)
    arc.height = wp.dot(axis, u)
    arc.rise = wp.dot(axis, v) - arc.height
    arc.angle = wp.atan2(wp.dot(axis, wp.cross(u, v)), wp.dot(arc.start, across(axis, v)))
    if arc.angle < 0.0:
        arc.angle = wp.where(arc.angle > -BACK, 0.0, arc.angle + 2.0 * wp.pi)
    return arc


@wp.func
def arc_pieces(arc: Arc, slices: wp.int32, most: wp.int32) -> wp.int32:
    """Return the number of straight pieces of the arc, where half a turn has ``slices``."""
    return wp.clamp(wp.int32(wp.round(wp.float32(slices) * arc.angle / wp.pi)), 1, wp.min(slices, most))


@wp.func
def arc_point(arc: Arc, part: wp.float32) -> wp.vec3:
    """Return the point after a part of the path, from 0 to 1."""
    turned = wp.cos(part * arc.angle) * arc.start + wp.sin(part * arc.angle) * wp.cross(arc.axis, arc.start)
    return arc.center + turned + (arc.height + part * arc.rise) * arc.axis
