"""Random numbers in arrays of many worlds, each drawn from a seed and its own place alone."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())

# What is done with what was drawn.
VALUE, OFFSET, FACTOR, TURN = 0, 1, 2, 3


@wp.struct
class Draw:
    """Entries of which worlds and rows are drawn anew, and between what."""

    mask: wp.array(dtype=wp.uint8)  # (world,) worlds with 0 are left alone
    seeds: wp.array(dtype=wp.int32)  # (world*,)
    rows: wp.array(dtype=wp.int32)  # (n,)
    owners: wp.array(dtype=wp.int32)  # (n,) the row that a row looks like: itself, or that of which it is a piece
    low: wp.array(dtype=wp.float32)  # (width,)
    high: wp.array(dtype=wp.float32)  # (width,)
    salt: wp.int32  # of the attribute
    kind: wp.int32  # VALUE, OFFSET, FACTOR or TURN
    linked: wp.int32  # 1: all numbers of an entry are as far between their bounds
    by_world: wp.int32  # 0: worlds with the same seed draw the same


@wp.func
def start(draw: Draw, place: wp.int32):
    """World and row of an entry, and the state of its random generator."""
    world, entry = row_and_column(place, draw.rows.shape[0])
    seed = draw.seeds[world % draw.seeds.shape[0]]
    own = wp.rand_init(world * draw.by_world, draw.owners[entry])
    return world, draw.rows[entry], wp.rand_init(wp.int32(wp.rand_init(seed, draw.salt)), wp.int32(own))


@wp.func
def choose(choices: wp.array(dtype=wp.int32), state: wp.uint32) -> wp.int32:
    """Draw one of ``choices``, all as likely."""
    count = choices.shape[0]
    return choices[wp.min(wp.int32(wp.randf(state) * wp.float32(count)), count - 1)]


@wp.kernel(enable_backward=False)
def draw_numbers(
    draw: Draw,
    nominal: wp.array3d(dtype=wp.float32),
    out: wp.array3d(dtype=wp.float32),
    first: wp.int32,
):
    world, row, state = start(draw, first + wp.tid())
    if draw.mask[world] == wp.uint8(0):
        return
    part = wp.randf(state)
    for k in range(out.shape[2]):
        if draw.linked == 0 and k > 0:
            part = wp.randf(state)
        value = draw.low[k] + part * (draw.high[k] - draw.low[k])
        if draw.kind == wp.static(OFFSET):
            value += nominal[world, row, k]
        elif draw.kind == wp.static(FACTOR):
            value *= nominal[world, row, k]
        out[world, row, k] = value


@wp.kernel(enable_backward=False)
def draw_turns(
    draw: Draw,
    nominal: wp.array3d(dtype=wp.float32),
    out: wp.array3d(dtype=wp.float32),
    first: wp.int32,
):
    """Turn directions x y z, or quaternions w x y z, by an angle about any axis."""
    world, row, state = start(draw, first + wp.tid())
    if draw.mask[world] == wp.uint8(0):
        return
    angle = wp.radians(draw.low[0] + wp.randf(state) * (draw.high[0] - draw.low[0]))
    axis = wp.sample_unit_sphere_surface(state)
    if out.shape[2] == 3:
        direction = wp.vec3(nominal[world, row, 0], nominal[world, row, 1], nominal[world, row, 2])
        across = wp.cross(direction, axis)  # about an axis that stands on it, so that the angle is all of the change
        size = wp.length(across)
        if size > 0.0:
            direction = wp.quat_rotate(wp.quat_from_axis_angle(across / size, angle), direction)
        for k in range(3):
            out[world, row, k] = direction[k]
    else:
        w, x, y, z = nominal[world, row, 0], nominal[world, row, 1], nominal[world, row, 2], nominal[world, row, 3]
        turned = wp.quat_from_axis_angle(axis, angle) * wp.quat(x, y, z, w)
        out[world, row, 0] = turned[3]
        for k in range(3):
            out[world, row, k + 1] = turned[k]


@wp.kernel(enable_backward=False)
def draw_choices(
    draw: Draw,
    choices: wp.array(dtype=wp.int32),
    column: wp.int32,
    out: wp.array3d(dtype=wp.int32),
    first: wp.int32,
):
    world, row, state = start(draw, first + wp.tid())
    if draw.mask[world] == wp.uint8(0):
        return
    out[world, row, column] = choose(choices, state)


@wp.kernel(enable_backward=False)
def draw_switches(
    draw: Draw,
    choices: wp.array(dtype=wp.int32),
    out: wp.array3d(dtype=wp.uint8),
    first: wp.int32,
):
    world, row, state = start(draw, first + wp.tid())
    if draw.mask[world] == wp.uint8(0):
        return
    chosen = choose(choices, state)
    for k in range(out.shape[2]):
        out[world, row, k] = wp.uint8(chosen)


def bind_draw(draw: Draw, out: wp.array, more: Any, device: wp.Device, column: int = 0) -> Stage:
    """Bind the stage that draws.

    Args:
        draw: What.
        out: (world, row, width) of float32, int32 or uint8; written.
        more: Of numbers: what they are added to or multiply, likewise; else what is chosen from, int32, (n,).
        device: Where all of these lie.
        column: Of int32: which number of each row is written.
    """
    dim = out.shape[0] * draw.rows.shape[0]
    if out.dtype is wp.float32:
        return bind_launch(draw_turns if draw.kind == TURN else draw_numbers, dim, [draw, more, out], device)
    if out.dtype is wp.int32:
        return bind_launch(draw_choices, dim, [draw, more, column, out], device)
    return bind_launch(draw_switches, dim, [draw, more, out], device)
