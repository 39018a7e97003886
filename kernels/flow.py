"""What was where when a world was last drawn, and how shapes have moved in a camera's image since.

The trace itself writes ``flow`` and ``flow_valid`` (native/flow.h). Before it one thread for each shape composes how it
has moved; after it what is seen now becomes what was.
"""

from typing import Any

import warp as wp

from .launch import Stage, compiler_flags, record
from .tables import Tables
from .types import (
    BARREL,
    CAPSULE,
    CONE,
    CYLINDER,
    HEIGHT_FIELD,
    MESH,
    PLANE,
    SCALED,
    SPHERE,
    SPLATS,
    Shapes,
    View,
)
from .views import NEW

wp.set_module_options(compiler_flags())

ROWS, MOVING_ROWS = 4, 7  # of a shape in Trail.motions, without and with meshes that move

# What of a surface was farther than what was seen around it was hidden: by more than this, as parts of its depth and of
# a pixel's width there. Of what bends inwards neighbouring pixels may be nearer than what lies between them.
CONVEX = wp.constant(wp.vec2(0.004, 0.25))
HOLLOW = wp.constant(wp.vec2(0.004, 1.0))
STEPS = 120.0
BRIEF_SHAPES = 255  # as many have an id in eight bits, beside none


@wp.struct
class Trail:
    """What the trace reads of all that and writes."""

    flow: wp.array(dtype=wp.float32)  # (pixel * 2,) may be empty
    flow_valid: wp.array(dtype=wp.uint8)  # (pixel,) may be empty
    # (word / 2 or word,) what was seen, and in the other what is seen, 16 or 32 bits a pixel; see native/flow.h
    kept_first: wp.array(dtype=wp.uint32)
    kept_second: wp.array(dtype=wp.uint32)
    known: wp.array(dtype=wp.uint8)  # (world,) which of these two has what was seen, or NEW: see views.py
    # (world, ROWS or MOVING_ROWS of each shape). Three rows take what pixel (column, row) sees to where it was: column,
    # row and 1 times the planar depth then, or for parallel rays column, row, depth. Each is
    # depth * (x column + y row + z) + w, or for parallel rays x column + y row + z depth + w. A fourth: a part of the
    # depth then and what is added to it [m], and nothing nearer than that may have been seen there; nearest planar
    # depth then [m]; as int bits twice the first corner of a mesh that moves, or -2, and 1 more where the three rows
    # lead to the same pixel. Three more: what a shift in the own frame of such a mesh adds to the first three. Of a
    # motion that is not known the rows lead to the same pixel, but to a depth behind the camera. Where words are brief
    # the fourth has: part and shift in the steps that the depth then was counted in; nearest depth, or -1 where the
    # rows lead to the same pixel; how many steps a metre of the depth now has.
    motions: wp.array2d(dtype=wp.vec4)
    corners: wp.array(dtype=wp.vec3)  # CornersBefore.corners; this and what follows only where meshes move
    faces: wp.array(dtype=wp.vec4)  # Meshes.faces
    face_start: wp.array(dtype=wp.int32)  # Meshes.face_start
    columns: wp.int32  # shapes
    width: wp.int32
    height: wp.int32


@wp.func
def ratio(then: wp.float32, now: wp.float32) -> wp.float32:
    if now == 0.0:
        return 1.0
    return then / now


@wp.func
def stretch(kind: wp.int32, then: wp.vec3, now: wp.vec3, scaled: wp.int32) -> wp.vec3:
    """How many times as large the shape was along its axes."""
    if kind == SPHERE:
        return ratio(then[0], now[0]) * wp.vec3(1.0, 1.0, 1.0)
    if kind == CAPSULE or kind == CYLINDER or kind == CONE or kind == BARREL:
        wide = ratio(then[0], now[0])
        return wp.vec3(wide, wide, ratio(then[1], now[1]))
    if kind == PLANE or ((kind == MESH or kind == HEIGHT_FIELD) and scaled == 0):
        return wp.vec3(1.0, 1.0, 1.0)
    return wp.vec3(ratio(then[0], now[0]), ratio(then[1], now[1]), ratio(then[2], now[2]))


@wp.func
def number_of(bits: wp.int32) -> wp.float32:
    return wp.cast(bits, wp.float32)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float4 r = reinterpret_cast<const float4*>(rows.data)[index];
    return wp::vec_t<4, float>(r.x, r.y, r.z, r.w);
#else
    return rows.data[index];
#endif
""")
def get_row(rows: wp.array2d(dtype=wp.vec4), index: wp.int32) -> wp.vec4: ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    reinterpret_cast<float4*>(rows.data)[index] = make_float4(row[0], row[1], row[2], row[3]);
#else
    rows.data[index] = row;
#endif
""")
def put_row(rows: wp.array2d(dtype=wp.vec4), index: wp.int32, row: wp.vec4): ...


@wp.func
def reach_of(kind: wp.int32, view: View, pinhole: wp.int32) -> wp.vec2:
    """A part of a depth and what is added to it [m]: nothing nearer may have been seen at a point's place."""
    reach = CONVEX
    if kind == MESH or kind == HEIGHT_FIELD or kind == SPLATS:
        reach = HOLLOW
    wide = reach[1] * wp.max(view.scale[0], view.scale[1])
    if kind == PLANE:
        wide = wp.float32(0.0)  # it hides nothing of itself
    if pinhole != 0:
        return wp.vec2(1.0 / (1.0 + reach[0] + wide), 0.0)
    return wp.vec2(1.0 / (1.0 + reach[0]), -wide)


@wp.func
def steps_of(
    kind: wp.int32, position: wp.vec3, rotation: wp.mat33, size: wp.vec3, view: View, pinhole: wp.int32
) -> wp.float32:
    """Steps a metre in which the depths of a convex shape are counted.

    What may be compared is at most 120 of 256 steps apart, of which eight bits are kept.
    """
    if kind == PLANE:
        return 0.0
    half = size
    if kind == SPHERE:
        half = wp.vec3(size[0], size[0], size[0])
    elif kind == CAPSULE:
        half = wp.vec3(size[0], size[0], size[0] + size[1])
    elif kind == CYLINDER or kind == CONE:
        half = wp.vec3(size[0], size[0], size[1])
    elif kind == BARREL:  # its side is bent by less than its half length
        half = wp.vec3(size[0] + size[1], size[0] + size[1], size[1])
    axis = wp.vec3(view.rotation[0, 2], view.rotation[1, 2], view.rotation[2, 2])
    along = wp.abs(wp.transpose(rotation) * axis)
    radius = wp.dot(along, half)
    farthest = wp.abs(wp.dot(axis, view.origin - position)) + radius
    reach = reach_of(kind, view, pinhole)
    return STEPS / wp.max(2.0 * radius + (1.0 - reach[0]) * farthest - reach[1], 1.0e-6 * farthest + 1.0e-12)


@wp.func
def put_unknown(motions: wp.array2d(dtype=wp.vec4), row: wp.int32):
    put_row(motions, row, wp.vec4(1.0, 0.0, 0.0, 0.0))
    put_row(motions, row + 1, wp.vec4(0.0, 1.0, 0.0, 0.0))
    put_row(motions, row + 2, wp.vec4(0.0, 0.0, 0.0, -1.0))


@wp.kernel(enable_backward=False)
def write_motions(
    shapes: Shapes,
    before: wp.array2d(dtype=wp.vec4),
    starts: wp.array(dtype=wp.int32),
    views: wp.array(dtype=View),
    views_before: wp.array(dtype=View),
    known: wp.array(dtype=wp.uint8),
    mask: wp.array(dtype=wp.uint8),
    pinhole: wp.int32,
    scaled: wp.int32,
    brief: wp.int32,
    keep: wp.int32,
    rows: wp.int32,
    motions: wp.array2d(dtype=wp.vec4),
    first: wp.int32,
):
    """``before`` has four rows for each shape: its position and the rows of its rotation, with its size and asset."""
    index = first + wp.tid()
    columns = before.shape[1] // 4
    world = index // columns
    shape = index - world * columns
    # All is loaded before the first decision: memory is waited for once.
    a = get_row(before, 4 * index)
    b = get_row(before, 4 * index + 1)
    c = get_row(before, 4 * index + 2)
    d = get_row(before, 4 * index + 3)
    position = shapes.positions[world, shape]
    rotation = shapes.rotations[world, shape]
    size = shapes.sizes[world % shapes.sizes.shape[0], shape]
    asset = shapes.assets[world % shapes.assets.shape[0], shape]
    now = views[world]
    then = views_before[world]
    state = known[world]
    kind = shapes.types[shape]
    drawn = shapes.places[shape] >= 0 or kind == SPLATS
    if mask[world] == wp.uint8(0) or not drawn:
        return
    same = False
    last = wp.vec4()
    if state != wp.uint8(NEW):
        old_position = wp.vec3(a[0], a[1], a[2])
        old_rotation = wp.mat33(b[0], b[1], b[2], c[0], c[1], c[2], d[0], d[1], d[2])
        old_size = wp.vec3(a[3], b[3], c[3])
        old_asset = wp.cast(d[3], wp.int32)
        same = old_position == position and old_rotation == rotation and old_size == size and old_asset == asset
        grown = wp.vec3(1.0, 1.0, 1.0)
        if not (old_size == size):
            grown = stretch(kind, old_size, size, scaled)
        # By how much a point of the shape, then one of the camera's frame, was elsewhere: 0 if nothing has moved.
        turn = (old_rotation * wp.diag(grown) - rotation) * wp.transpose(rotation)
        shift = (now.origin - then.origin) + (old_position - position) + turn * (now.origin - position)
        back = wp.transpose(then.rotation)
        motion = (back - wp.transpose(now.rotation)) * now.rotation + back * turn * now.rotation
        shift = back * shift
        moved = wp.length_sq(shift) + wp.ddot(motion, motion)
        moved += wp.length_sq(now.center - then.center) + wp.length_sq(now.scale - then.scale)
        # From pixels, and to pixels as they were. The camera looks along -z, and rows run down.
        into = wp.diag(wp.vec3(1.0 / then.scale[0], -1.0 / then.scale[1], -1.0))
        middle = wp.vec3(then.center[0] - 0.5, then.center[1] - 0.5, 0.0)
        if pinhole != 0:
            into[0, 2] = -middle[0]
            into[1, 2] = -middle[1]
            middle = wp.vec3(0.0, 0.0, 0.0)
        corner = wp.int32(-1)
        if rows > 4 and kind == MESH and asset >= 0:
            corner = starts[asset]
        if moved != 0.0 or corner >= 0:
            whole = into * (wp.identity(n=3, dtype=wp.float32) + motion)
            out = whole * wp.diag(wp.vec3(now.scale[0], -now.scale[1], -1.0))
            corner_ray = wp.vec3(0.5 - now.center[0], 0.5 - now.center[1], 0.0)  # of pixel (0, 0)
            end = into * shift + middle
            for i in range(3):
                start = out[i, 0] * corner_ray[0] + out[i, 1] * corner_ray[1]
                row = wp.vec4(out[i, 0], out[i, 1], out[i, 2] + start, end[i])
                if pinhole == 0:
                    row = wp.vec4(out[i, 0], out[i, 1], out[i, 2], end[i] + start)
                put_row(motions, rows * index + i, row)
        if corner >= 0:
            within = into * back * old_rotation
            if scaled != 0:
                within = within * wp.diag(old_size)
            for i in range(3):
                put_row(motions, rows * index + 4 + i, wp.vec4(within[i, 0], within[i, 1], within[i, 2], 0.0))

        reach = reach_of(kind, then, pinhole)
        if kind == PLANE:
            reach[1] = -1.0e30
        flags = 2 * corner
        if moved == 0.0:
            flags += 1
        if not wp.isfinite(moved) or old_asset != asset:
            put_unknown(motions, rows * index)
            flags = -2
        last = wp.vec4(reach[0], reach[1], then.near, number_of(flags))
        if brief != 0:
            steps = steps_of(kind, old_position, old_rotation, old_size, then, pinhole)
            last = wp.vec4(reach[0] * steps, reach[1] * steps, then.near, 0.0)
            if flags == -1:
                last[2] = -1.0
    else:
        put_unknown(motions, rows * index)
        last = wp.vec4(0.0, 0.0, 0.0, number_of(-2))
    if brief != 0:
        last[3] = steps_of(kind, position, rotation, size, now, pinhole)
    put_row(motions, rows * index + 3, last)

    if keep != 0 and not same:
        put_row(before, 4 * index, wp.vec4(position[0], position[1], position[2], size[0]))
        put_row(before, 4 * index + 1, wp.vec4(rotation[0, 0], rotation[0, 1], rotation[0, 2], size[1]))
        put_row(before, 4 * index + 2, wp.vec4(rotation[1, 0], rotation[1, 1], rotation[1, 2], size[2]))
        put_row(before, 4 * index + 3, wp.vec4(rotation[2, 0], rotation[2, 1], rotation[2, 2], number_of(asset)))


@wp.kernel(enable_backward=False)
def forget(known: wp.array(dtype=wp.uint8), mask: wp.array(dtype=wp.uint8), first: wp.int32):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        known[world] = wp.uint8(0)


def record_motions(
    tables: Tables,
    before: wp.array,
    starts: wp.array,
    views: wp.array,
    views_before: wp.array,
    known: wp.array,
    mask: wp.array,
    lens: str,
    keep: bool,
    trail: Any,
    device: wp.Device,
) -> Stage:
    """Bind the stage that composes how shapes have moved in one camera's image.

    Args:
        tables: The scene.
        before: vec4, (world, 4 for each shape), shapes as they were: see ``write_motions``.
        starts: CornersBefore.starts; empty where no mesh moves.
        views: View, (world,).
        views_before: View, (world,), as they were.
        known: uint8, (world,); NEW where nothing is known of what was: see views.py.
        mask: uint8, (world,); worlds with 0 are left alone.
        lens: "pinhole" or "orthographic".
        keep: ``before`` becomes what is now: so for the last camera.
        trail: Trail; its motions are written.
        device: Where all of these lie.
    """
    inputs = [
        tables.shapes, before, starts, views, views_before, known, mask, int(lens == "pinhole"),
        int(SCALED in tables.shape_types), int(brief(tables)), int(keep),
        MOVING_ROWS if tables.moving else ROWS, trail.motions,
    ]  # fmt: skip
    return record(write_motions, tables.num_worlds * tables.num_shapes, inputs, device)


def brief(tables: Tables) -> bool:
    """Whether what is kept of a pixel has 16 bits, not 32: where all shapes are convex and few."""
    convex = tables.splats is None and {MESH, HEIGHT_FIELD}.isdisjoint(tables.shape_types)
    return convex and tables.num_shapes <= BRIEF_SHAPES


def kept_words(tables: Tables, width: int, height: int) -> int:
    """Numbers of 32 bits in which one image's words are kept: those of strips of eight pixels' width."""
    return -(-width // 8) * 8 * height // (2 if brief(tables) else 1)


def motion_rows(tables: Tables) -> int:
    """Rows of Trail.motions a world; at least those of one shape, which are read where nothing is hit."""
    return (MOVING_ROWS if tables.moving else ROWS) * max(tables.num_shapes, 1)


def record_forget(known: wp.array, mask: wp.array, device: wp.Device) -> Stage:
    """Bind the stage after which nothing is known of the worlds that a mask has."""
    return record(forget, known.shape[0], [known, mask], device)
