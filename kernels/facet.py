"""The triangles that light is computed at.

MuJoCo's renderer lights the corners of triangles and interpolates. Where the triangles are large that shows: a floor
of one quad has no highlight and knows no spot light but at its corners. So meshes and height fields are lit at the
corners of their faces, planes and boxes at those of the triangles MuJoCo cuts them into, and all else, which is finely
cut there, at each pixel.
"""

import functools
from typing import Any

import warp as wp

from .surface import TOP, Finish, Surface, axis_vector, component, face_corner
from .types import BOX, HEIGHT_FIELD, MESH, PLANE, HeightFields, Meshes, Shapes

PLANE_CELLS = 200  # at most, along a side of a plane
BOX_CELLS = 4  # along a side of a box


@wp.struct
class Facet:
    """A triangle in the shape's frame and a place on it."""

    corners: wp.int32  # 3; 1 where light is computed at the place itself
    origin: wp.vec3  # the first corner [m]
    edge1: wp.vec3  # to the second corner [m]
    edge2: wp.vec3  # to the third corner [m]
    weights: wp.vec3  # of the three corners, together 1


@wp.func
def facet_corner(facet: Facet, corner: wp.int32) -> wp.vec3:
    """Corner 0, 1 or 2."""
    place = facet.origin
    if corner == 1:
        place += facet.edge1
    elif corner == 2:
        place += facet.edge2
    return place


@wp.func
def facet_weight(facet: Facet, corner: wp.int32) -> wp.float32:
    """The weight of corner 0, 1 or 2."""
    return component(facet.weights, corner)


@wp.func
def plane_cell(x: wp.float32, half: wp.float32, spacing: wp.float32) -> wp.vec2:
    """Start and length of the cell around ``x`` on a side from ``-half`` to ``half``.

    An even number of cells twice ``spacing`` long lies in the middle; the first and last cell take what is left.
    """
    step = wp.max(spacing, half / wp.float32(PLANE_CELLS - 2))
    rest = half - 2.0 * step * wp.floor(0.5 * wp.floor(half / step))
    cell = wp.vec2(-half, rest)
    if x > half - rest:
        cell = wp.vec2(half - rest, rest)
    elif x > rest - half:
        start = rest - half
        cell = wp.vec2(start + 2.0 * step * wp.floor((x - start) / (2.0 * step)), 2.0 * step)
    return cell


@wp.func
def endless_cell(x: wp.float32, eye: wp.float32, repeat: wp.float32, horizon: wp.float32) -> wp.vec2:
    """Start and length of the cell around ``x`` on an endless side, which is drawn around the eye in whole tiles."""
    tile = 2.1 * horizon / wp.float32(PLANE_CELLS - 2)
    pairs = 0.5 * eye / tile
    if repeat > 0.0:
        tile = 2.0 / repeat
        pairs = 0.25 * eye * repeat
    middle = 2.0 * tile * wp.floor(pairs + 0.5)
    step = (2.1 * horizon + 2.0 * tile) / wp.float32(PLANE_CELLS)
    return wp.vec2(middle + step * wp.floor((x - middle) / step), step)


@wp.func
def in_quad(place: wp.vec3, u_axis: wp.int32, v_axis: wp.int32, u: wp.vec2, v: wp.vec2, mirrored: wp.bool) -> Facet:
    """The half of an axis-aligned quad that ``place`` lies in; ``u`` and ``v`` are (start, length) of its sides.

    The quad is cut from its second to its fourth corner; mirrored, from its first to its third.
    """
    facet = Facet()
    facet.corners = 3
    a = wp.clamp((component(place, u_axis) - u[0]) / wp.max(u[1], 1.0e-20), 0.0, 1.0)
    b = wp.clamp((component(place, v_axis) - v[0]) / wp.max(v[1], 1.0e-20), 0.0, 1.0)
    along = axis_vector(u_axis, u[1])
    across = axis_vector(v_axis, v[1])
    origin = place + axis_vector(u_axis, u[0] - component(place, u_axis))
    origin = origin + axis_vector(v_axis, v[0] - component(place, v_axis))
    if mirrored:
        origin += across
        across = -across
        b = 1.0 - b
    if a + b > 1.0:
        origin += along + across
        along = -along
        across = -across
        a = 1.0 - a
        b = 1.0 - b
    facet.origin = origin
    facet.edge1 = along
    facet.edge2 = across
    facet.weights = wp.vec3(1.0 - a - b, a, b)
    return facet


@wp.func
def box_facet(surface: Surface, half: wp.vec3) -> Facet:
    """Each side is a grid of quads."""
    u_axis = wp.where(surface.part == 0, 1, 0)
    v_axis = wp.where(surface.part == 2, 1, 2)
    u_half = component(half, u_axis)
    v_half = component(half, v_axis)
    width = 2.0 * u_half / wp.float32(BOX_CELLS)
    height = 2.0 * v_half / wp.float32(BOX_CELLS)
    last = wp.float32(BOX_CELLS - 1)
    i = wp.clamp(wp.floor((component(surface.local, u_axis) + u_half) / width), 0.0, last)
    j = wp.clamp(wp.floor((component(surface.local, v_axis) + v_half) / height), 0.0, last)
    u = wp.vec2(i * width - u_half, width)
    v = wp.vec2(j * height - v_half, height)
    outwards = component(surface.normal, surface.part)
    mirrored = (surface.part == 1) == (outwards > 0.0)
    return in_quad(surface.local, u_axis, v_axis, u, v, mirrored)


@wp.func
def height_field_facet(fields: HeightFields, field: wp.int32, face: wp.int32, local: wp.vec3) -> Facet:
    """The triangle of a top; ``face`` as in surface.py, not negative."""
    columns = fields.columns[field]
    rows = fields.rows[field]
    size = fields.size[field]
    cell = face // 2
    row = cell // (columns - 1)
    column = cell % (columns - 1)
    step_x = 2.0 * size[0] / wp.float32(columns - 1)
    step_y = 2.0 * size[1] / wp.float32(rows - 1)
    first = fields.height_start[field] + row * columns + column
    height = fields.heights[first]
    facet = Facet()
    facet.corners = 3
    facet.origin = wp.vec3(wp.float32(column) * step_x - size[0], wp.float32(row) * step_y - size[1], height)
    a = (local[0] - facet.origin[0]) / step_x
    b = (local[1] - facet.origin[1]) / step_y
    facet.edge2 = wp.vec3(step_x, step_y, fields.heights[first + columns + 1] - height)
    if face % 2 == 0:
        facet.edge1 = wp.vec3(step_x, 0.0, fields.heights[first + 1] - height)
        facet.weights = wp.vec3(1.0 - a, a - b, b)
    else:
        facet.edge1 = wp.vec3(0.0, step_y, fields.heights[first + columns] - height)
        facet.weights = wp.vec3(1.0 - b, b - a, a)
    return facet


@functools.cache
def make_facet(shape_types: frozenset[int]) -> Any:
    """``(shapes, meshes, fields, world, shape, face, surface, finish, eye, horizon) -> Facet`` for the given types.

    ``eye`` is the centre of projection in the shape's frame and ``horizon`` how far the camera of MuJoCo's renderer
    sees [m], which the cells of endless planes depend on; 0 lights those at each pixel.
    """

    @wp.func
    def facet_at(
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        world: wp.int32,
        shape: wp.int32,
        face: wp.int32,
        surface: Surface,
        finish: Finish,
        eye: wp.vec3,
        horizon: wp.float32,
    ):
        kind = shapes.types[shape]
        facet = Facet()
        facet.corners = 1
        facet.origin = surface.local
        facet.weights = wp.vec3(1.0, 0.0, 0.0)
        if wp.static(MESH in shape_types):
            if kind == MESH:
                facet.corners = 3
                facet.origin = face_corner(meshes, surface.row)
                facet.edge1 = face_corner(meshes, surface.row + 1) - facet.origin
                facet.edge2 = face_corner(meshes, surface.row + 2) - facet.origin
                first = 1.0 - surface.weights[0] - surface.weights[1]
                facet.weights = wp.vec3(first, surface.weights[0], surface.weights[1])
        if wp.static(HEIGHT_FIELD in shape_types):
            if kind == HEIGHT_FIELD and surface.part == TOP:
                field = shapes.assets[world % shapes.assets.shape[0], shape]
                facet = height_field_facet(fields, field, face, surface.local)
        if wp.static(BOX in shape_types):
            if kind == BOX:
                facet = box_facet(surface, shapes.sizes[world % shapes.sizes.shape[0], shape])
        if wp.static(PLANE in shape_types):
            if kind == PLANE:
                size = shapes.sizes[world % shapes.sizes.shape[0], shape]
                if (size[0] > 0.0 and size[1] > 0.0) or horizon > 0.0:
                    u = endless_cell(surface.local[0], eye[0], finish.texture_repeat[0], horizon)
                    if size[0] > 0.0:
                        u = plane_cell(surface.local[0], size[0], size[2])
                    v = endless_cell(surface.local[1], eye[1], finish.texture_repeat[1], horizon)
                    if size[1] > 0.0:
                        v = plane_cell(surface.local[1], size[1], size[2])
                    facet = in_quad(surface.local, 0, 1, u, v, False)
        return facet

    return facet_at
