"""The stage that writes the table of shapes where a source draws more than its shapes: marks, segments, edges."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import SPHERE
from warpcam.sources.mujoco.kernels.catenary import hanging_point
from warpcam.sources.mujoco.kernels.wrap_arcs import arc_between, arc_pieces, arc_point

# What stands in a column that is written each frame: VisualGeomTable.what, first component. The second is the column.
COPY, MARK, SEGMENT, EDGE, STRING, ARC, ROD, CRANK = 0, 1, 2, 3, 4, 5, 6, 7
MOST_PIECES = 8  # of an arc


@wp.struct
class VisualGeomTable:
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
class ShapeTable:
    """Rows of the shape table that the kernel writes: see Shapes. A field of one row is shared by all worlds."""

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
    k = 1.0 / wp.max(1.0 + z, 0.5)
    if z < -0.5:  # the same, of which next to -z digits are left
        aside = x * x + y * y
        if aside < 1.0e-30:
            return wp.mat33(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0)
        k = (1.0 - z) / aside
    return wp.mat33(1.0 - x * x * k, -x * y * k, x, -x * y * k, 1.0 - y * y * k, y, -x, -y, z)


@wp.func
def find_arc(live: VisualGeomTable, world: wp.int32, path: wp.int32, number: wp.int32) -> wp.int32:
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
def find_segment(live: VisualGeomTable, world: wp.int32, path: wp.int32, number: wp.int32) -> wp.int32:
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


@wp.struct
class Line:
    """Axis of a capsule or a cylinder in the world frame [m]; radius 0 draws nothing."""

    start: wp.vec3
    end: wp.vec3
    radius: wp.float32


@wp.func
def line_along(start: wp.vec3, end: wp.vec3, radius: wp.float32) -> Line:
    line = Line()
    line.start = start
    line.end = end
    line.radius = radius
    return line


@wp.func
def edge_of(live: VisualGeomTable, world: wp.int32, a: wp.int32, b: wp.int32, radius: wp.float32) -> Line:
    return line_along(live.vertices[world, a], live.vertices[world, b], radius)


@wp.func
def string_of(live: VisualGeomTable, world: wp.int32, path: wp.int32, b: wp.int32, entry: wp.int32) -> Line:
    stop = live.path_starts[world, path]
    first_end = live.stops[world, stop]
    second_end = live.stops[world, stop + 1]
    length = live.lengths[entry]
    start = hanging_point(first_end, second_end, live.up, length, b, live.num_points)
    end = hanging_point(first_end, second_end, live.up, length, b + 1, live.num_points)
    return line_along(start, end, wp.where(start == end, 0.0, live.radii[entry]))


@wp.func
def arc_of(live: VisualGeomTable, world: wp.int32, path: wp.int32, b: wp.int32, radius: wp.float32) -> Line:
    number = b / MOST_PIECES
    piece = b - number * MOST_PIECES
    stop = find_arc(live, world, path, number)
    if stop < 0:
        return line_along(wp.vec3(), wp.vec3(), 0.0)
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
    return line_along(start, end, wp.where(piece >= pieces, 0.0, radius))


@wp.func
def segment_of(live: VisualGeomTable, world: wp.int32, path: wp.int32, number: wp.int32, radius: wp.float32) -> Line:
    stop = find_segment(live, world, path, number)
    if stop < 0:
        return line_along(wp.vec3(), wp.vec3(), 0.0)
    around = live.stop_objects[world, stop] >= 0 and live.stop_objects[world, stop + 1] >= 0
    return line_along(live.stops[world, stop], live.stops[world, stop + 1], wp.where(around, 0.5 * radius, radius))


@wp.func
def copy_shape(live: VisualGeomTable, out: ShapeTable, world: wp.int32, column: wp.int32, shape: wp.int32):
    out.positions[world, column] = live.positions[world, shape]
    out.rotations[world, column] = live.rotations[world, shape]
    if world < out.sizes.shape[0]:
        out.sizes[world, column] = live.sizes[world % live.sizes.shape[0], shape]
    if world < out.assets.shape[0]:
        out.assets[world, column] = live.assets[world % live.assets.shape[0], shape]
    if world < out.materials.shape[0]:
        out.materials[world, column] = live.materials[world % live.materials.shape[0], shape]
    if world < out.colors.shape[0]:
        out.colors[world, column] = live.colors[world % live.colors.shape[0], shape]


@wp.func
def copy_mark(live: VisualGeomTable, out: ShapeTable, world: wp.int32, column: wp.int32, mark: wp.int32, row: wp.int32):
    frame = live.mark_rotations[world, mark]
    out.positions[world, column] = live.mark_positions[world, mark] + frame @ live.offsets[row]
    out.rotations[world, column] = frame @ live.turns[row]


@functools.cache
def kernel_of(kinds: frozenset[int]) -> wp.Kernel:
    """Return the kernel that writes entries of these kinds."""

    @wp.kernel(module="unique", enable_backward=False, module_options=compiler_flags())
    def write_table(live: VisualGeomTable, out: ShapeTable, first: wp.int32):
        world, entry = row_and_column(first + wp.tid(), live.what.shape[0])
        what = live.what[entry]
        kind = what[0]
        column = what[1]
        a = what[2]
        b = what[3]
        if wp.static(COPY in kinds):
            if kind == COPY:
                copy_shape(live, out, world, column, a)
                return
        if wp.static(MARK in kinds):
            if kind == MARK:
                copy_mark(live, out, world, column, a, b)
                return
        if wp.static(not kinds <= {COPY, MARK}):
            radius = live.radii[entry]
            line = line_along(wp.vec3(), wp.vec3(), 0.0)
            if wp.static(EDGE in kinds):
                if kind == EDGE:
                    line = edge_of(live, world, a, b, radius)
            if wp.static(STRING in kinds):
                if kind == STRING:
                    line = string_of(live, world, a, b, entry)
            if wp.static(ARC in kinds):
                if kind == ARC:
                    line = arc_of(live, world, a, b, radius)
            if wp.static(SEGMENT in kinds):
                if kind == SEGMENT:
                    line = segment_of(live, world, a, b, radius)
            if wp.static(ROD in kinds):
                if kind == ROD or kind == CRANK:
                    frame = live.mark_rotations[world, a]
                    axis = wp.vec3(frame[0, 2], frame[1, 2], frame[2, 2])
                    start = live.mark_positions[world, a]
                    end = live.mark_positions[world, b]
                    away = end - start
                    far = wp.dot(away, axis)
                    left = far * far + live.lengths[entry] * live.lengths[entry] - wp.dot(away, away)
                    middle = start + (far - wp.sqrt(wp.max(left, 0.0))) * axis
                    if kind == ROD:
                        line = line_along(start, middle, radius)
                    else:
                        line = line_along(middle, end, radius)
                        if world < out.colors.shape[0]:
                            out.colors[world, column] = live.crank_colors[wp.where(left < 0.0, 1, 0)]
            along = line.end - line.start
            length = wp.length(along)
            upright = wp.vec3(0.0, 0.0, 1.0)
            if length > 1.0e-15:
                upright = along / length
            out.positions[world, column] = 0.5 * (line.start + line.end)
            out.rotations[world, column] = turn_to(upright)
            half = wp.where(line.radius > 0.0, 0.5 * length, 1.0)  # zeros alone would be a fault of the world
            out.sizes[world, column] = wp.vec3(line.radius, half, wp.where(kind == EDGE, -1.0, 0.0))

    return write_table


def bind_shape_table(live: Any, out: Any, kinds: frozenset[int], device: wp.Device) -> Stage:
    """Bind the stage that writes ``out`` from ``live``, tables of these kinds, on ``device``."""
    return bind_launch(kernel_of(kinds), out.positions.shape[0] * live.what.shape[0], [live, out], device)
