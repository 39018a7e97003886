"""The stage that writes the table of shapes where a source draws more than its shapes: marks, segments, edges."""

from typing import Any

import warp as wp

from .arcs import arc_between, arc_pieces, arc_point
from .catenary import hanging_point
from .launch import Stage, compiler_flags, record
from .types import SPHERE

wp.set_module_options(compiler_flags())

# What stands in a column that is written each frame: Entries.what, first component. The second is the column.
COPY, MARK, SEGMENT, EDGE, STRING, ARC, ROD, CRANK = 0, 1, 2, 3, 4, 5, 6, 7
MOST_PIECES = 8  # of an arc


@wp.struct
class Entries:
    """The columns that are written each frame, and what the simulator has for them."""

    # (entry,) COPY: a shape of its own, third component; MARK: something with a pose, third, in which it stands as a
    # row of offsets and turns, fourth, says; SEGMENT: of a path, third, the segment's number among those drawn,
    # fourth; EDGE: between two vertices, third and fourth; STRING: as SEGMENT, of a path between two stops that may
    # hang slack; ARC: a piece of where a path, third, lies on something, fourth: the piece's number and, times
    # MOST_PIECES, that of the place along the path; ROD: of a slider-crank, from a mark, third, along its z axis to
    # where a crank begins that ends at another, fourth; CRANK: this
    what: wp.array(dtype=wp.vec4i)
    radii: wp.array(dtype=wp.float32)  # (entry,) of segments and edges [m]
    lengths: wp.array(dtype=wp.float32)  # (entry,) of strings and cranks [m]
    crank_colors: wp.array(dtype=wp.vec4)  # (2,) of cranks, and of those that are too short
    up: wp.vec3  # where strings do not hang, unit
    num_points: wp.int32  # of a string
    slices: wp.int32  # pieces of half a turn of an arc; 0: there are no arcs but straight segments of half the width
    types: wp.array(dtype=wp.int32)  # (shape,) see Shapes
    positions: wp.array2d(dtype=wp.vec3)  # (world, shape) and so on: see Shapes
    rotations: wp.array2d(dtype=wp.mat33)
    sizes: wp.array2d(dtype=wp.vec3)
    assets: wp.array2d(dtype=wp.int32)
    materials: wp.array2d(dtype=wp.int32)
    colors: wp.array2d(dtype=wp.vec4)
    mark_positions: wp.array2d(dtype=wp.vec3)  # (world, mark) world frame [m]
    mark_rotations: wp.array2d(dtype=wp.mat33)  # (world, mark)
    offsets: wp.array(dtype=wp.vec3)  # (row,) in a mark's frame [m]
    turns: wp.array(dtype=wp.mat33)  # (row,)
    vertices: wp.array2d(dtype=wp.vec3)  # (world, vertex) world frame [m]
    stops: wp.array2d(dtype=wp.vec3)  # (world, stop) of paths, world frame [m]
    stop_objects: wp.array2d(dtype=wp.int32)  # (world, stop) what a path lies on: from 0 a shape; -2: a gap
    path_starts: wp.array2d(dtype=wp.int32)  # (world, path) first stop
    path_counts: wp.array2d(dtype=wp.int32)  # (world, path) stops


@wp.struct
class Table:
    """What is written: see Shapes. A field of one row is the same in all worlds."""

    positions: wp.array2d(dtype=wp.vec3)
    rotations: wp.array2d(dtype=wp.mat33)
    sizes: wp.array2d(dtype=wp.vec3)
    assets: wp.array2d(dtype=wp.int32)
    materials: wp.array2d(dtype=wp.int32)
    colors: wp.array2d(dtype=wp.vec4)


@wp.func
def turn_to(axis: wp.vec3) -> wp.mat33:
    """The shortest turn that takes z to a unit vector."""
    x, y, z = axis[0], axis[1], axis[2]
    if z < -0.999999:
        return wp.mat33(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0)
    k = 1.0 / (1.0 + z)
    return wp.mat33(1.0 - x * x * k, -x * y * k, x, -x * y * k, 1.0 - y * y * k, y, -x, -y, z)


@wp.func
def find_arc(live: Entries, world: wp.int32, path: wp.int32, number: wp.int32) -> wp.int32:
    """The stop where a path begins to lie on something for the time of this number, from 0; -1 if it does not."""
    first = live.path_starts[world, path]
    found = wp.int32(-1)
    left = number
    for stop in range(first + 1, first + live.path_counts[world, path] - 2):
        if live.stop_objects[world, stop] >= 0 and live.stop_objects[world, stop + 1] >= 0:
            if left == 0 and found < 0:
                found = stop
            left = left - 1
    return found


@wp.func
def find_segment(live: Entries, world: wp.int32, path: wp.int32, number: wp.int32) -> wp.int32:
    """The stop where a path's straight segment of this number, from 0, begins; -1 if it has fewer."""
    first = live.path_starts[world, path]
    found = wp.int32(-1)
    left = number
    for stop in range(first, first + live.path_counts[world, path] - 1):
        here = live.stop_objects[world, stop]
        there = live.stop_objects[world, stop + 1]
        arc = here >= 0 and there >= 0 and live.slices > 0
        if here != -2 and there != -2 and not arc:
            if left == 0:
                found = stop
            left = left - 1
    return found


@wp.kernel(enable_backward=False)
def write_table(live: Entries, out: Table, first: wp.int32):
    index = first + wp.tid()
    width = live.what.shape[0]
    world = index // width
    entry = index - world * width
    what = live.what[entry]
    kind = what[0]
    column = what[1]
    a = what[2]
    b = what[3]
    if kind == COPY:
        out.positions[world, column] = live.positions[world, a]
        out.rotations[world, column] = live.rotations[world, a]
        if world < out.sizes.shape[0]:
            out.sizes[world, column] = live.sizes[world % live.sizes.shape[0], a]
        if world < out.assets.shape[0]:
            out.assets[world, column] = live.assets[world % live.assets.shape[0], a]
        if world < out.materials.shape[0]:
            out.materials[world, column] = live.materials[world % live.materials.shape[0], a]
        if world < out.colors.shape[0]:
            out.colors[world, column] = live.colors[world % live.colors.shape[0], a]
        return
    if kind == MARK:
        frame = live.mark_rotations[world, a]
        out.positions[world, column] = live.mark_positions[world, a] + frame @ live.offsets[b]
        out.rotations[world, column] = frame @ live.turns[b]
        return
    start = wp.vec3(0.0, 0.0, 0.0)
    end = start
    radius = live.radii[entry]
    if kind == EDGE:
        start = live.vertices[world, a]
        end = live.vertices[world, b]
    elif kind == ROD or kind == CRANK:
        frame = live.mark_rotations[world, a]
        axis = wp.vec3(frame[0, 2], frame[1, 2], frame[2, 2])
        start = live.mark_positions[world, a]
        end = live.mark_positions[world, b]
        away = end - start
        far = wp.dot(away, axis)
        left = far * far + live.lengths[entry] * live.lengths[entry] - wp.dot(away, away)
        middle = start + (far - wp.sqrt(wp.max(left, 0.0))) * axis
        if kind == ROD:
            end = middle
        else:
            start = middle
            if world < out.colors.shape[0]:
                out.colors[world, column] = live.crank_colors[wp.where(left < 0.0, 1, 0)]
    elif kind == STRING:
        stop = live.path_starts[world, a]
        first_end = live.stops[world, stop]
        second_end = live.stops[world, stop + 1]
        start = hanging_point(first_end, second_end, live.up, live.lengths[entry], b, live.num_points)
        end = hanging_point(first_end, second_end, live.up, live.lengths[entry], b + 1, live.num_points)
        if start == end:
            radius = 0.0
    elif kind == ARC:
        number = b / MOST_PIECES
        piece = b - number * MOST_PIECES
        stop = find_arc(live, world, a, number)
        if stop < 0:
            radius = 0.0
        else:
            on = live.stop_objects[world, stop]
            arc = arc_between(
                live.stops[world, stop - 1],
                live.stops[world, stop],
                live.stops[world, stop + 1],
                live.stops[world, stop + 2],
                live.positions[world, on],
                live.rotations[world, on],
                live.types[on] == SPHERE,
            )
            pieces = arc_pieces(arc, live.slices, MOST_PIECES)
            start = arc_point(arc, wp.float32(piece) / wp.float32(pieces))
            end = arc_point(arc, wp.float32(piece + 1) / wp.float32(pieces))
            if piece >= pieces:
                radius = 0.0
    else:
        stop = find_segment(live, world, a, b)
        if stop < 0:
            radius = 0.0
        else:
            start = live.stops[world, stop]
            end = live.stops[world, stop + 1]
            if live.stop_objects[world, stop] >= 0 and live.stop_objects[world, stop + 1] >= 0:
                radius = 0.5 * radius  # around what the path lies on
    along = end - start
    length = wp.length(along)
    upright = wp.vec3(0.0, 0.0, 1.0)
    if length > 1.0e-15:
        upright = along / length
    out.positions[world, column] = 0.5 * (start + end)
    out.rotations[world, column] = turn_to(upright)
    out.sizes[world, column] = wp.vec3(radius, 0.5 * length, wp.where(kind == EDGE, -1.0, 0.0))


def record_table(live: Any, out: Any, device: wp.Device) -> Stage:
    """Bind the stage that writes ``out`` from ``live``, ``Table`` and ``Entries`` on ``device``."""
    return record(write_table, out.positions.shape[0] * live.what.shape[0], [live, out], device)
