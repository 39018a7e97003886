"""Where a point of a surface lies on its texture, as MuJoCo maps it.

A mapping gives the place and its gradient over the shape's frame; the gradient turns the step to the next pixel into
a step on the texture. Measured against ``mujoco.Renderer`` 3.17 with a texture that shows its own coordinates.
"""

import functools
from typing import Any

import warp as wp

from .surface import BOTTOM, SIDE, TOP, Finish, Surface, axis_vector, component, face_corner
from .types import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    HEIGHT_FIELD,
    MESH,
    PLANE,
    SPHERE,
    HeightFields,
    Meshes,
    Shapes,
)

TURN = 6.283185307179586
HALF_TURN = 3.141592653589793


@wp.struct
class Mapping:
    """A place on a 2-D texture, in images: (0, 0) is the top left corner, (1, 1) the bottom right."""

    uv: wp.vec2
    du: wp.vec3  # gradient of u over the shape's frame [1/m]
    dv: wp.vec3  # gradient of v [1/m]


@wp.struct
class CubeMapping:
    """A direction into a cube texture."""

    direction: wp.vec3
    scale: wp.vec3  # change of `direction` with the place in the shape's frame, axis by axis [1/m]


@wp.func
def around(x: wp.float32, y: wp.float32, radius: wp.vec2) -> Mapping:
    """Map u once around the z axis from +x, for a cross section of the given half axes."""
    mapping = Mapping()
    a = x / radius[0]
    b = y / radius[1]
    turn = wp.atan2(b, a) / TURN
    mapping.uv = wp.vec2(wp.where(turn < 0.0, turn + 1.0, turn), 0.0)
    square = wp.max(a * a + b * b, 1.0e-12) * TURN
    mapping.du = wp.vec3(-b / (square * radius[0]), a / (square * radius[1]), 0.0)
    return mapping


@wp.func
def on_globe(q: wp.vec3, half: wp.vec3, upper: wp.float32, scale: wp.float32) -> Mapping:
    """Map u around the z axis and v to ``upper`` - elevation * ``scale``, on an ellipsoid of half axes ``half``."""
    mapping = around(q[0], q[1], wp.vec2(half[0], half[1]))
    unit = wp.cw_div(q, half)
    flat = wp.max(wp.sqrt(unit[0] * unit[0] + unit[1] * unit[1]), 1.0e-6)
    mapping.uv[1] = upper - wp.atan2(unit[2], flat) * scale
    square = wp.dot(unit, unit)
    gradient = wp.vec3(-unit[2] * unit[0] / flat, -unit[2] * unit[1] / flat, flat) * (-scale / square)
    mapping.dv = wp.cw_div(gradient, half)
    return mapping


@wp.func
def along_axis(mapping: Mapping, z: wp.float32, half_length: wp.float32) -> Mapping:
    """Map v from the top of a cylinder's side to its bottom."""
    mapping.uv[1] = 0.5 - 0.5 * z / half_length
    mapping.dv = wp.vec3(0.0, 0.0, -0.5 / half_length)
    return mapping


@wp.func
def flat_axes(surface: Surface, size: wp.vec3, u_axis: wp.int32, v_axis: wp.int32) -> Mapping:
    """Map u and v over a rectangle; an axis of size 0 is endless, two metres an image."""
    mapping = Mapping()
    half = component(size, u_axis)
    rate = wp.where(half > 0.0, 0.5 / half, 0.5)
    u = wp.where(half > 0.0, 0.5, 0.0) + component(surface.local, u_axis) * rate
    mapping.du = axis_vector(u_axis, rate)
    half = component(size, v_axis)
    rate = wp.where(half > 0.0, 0.5 / half, 0.5)
    v = wp.where(half > 0.0, 0.5, 0.0) - component(surface.local, v_axis) * rate
    mapping.dv = axis_vector(v_axis, -rate)
    mapping.uv = wp.vec2(u, v)
    return mapping


@wp.func
def projected(local: wp.vec3, size: wp.vec3) -> Mapping:
    """The image laid on from above, for shapes without texture coordinates of their own."""
    mapping = Mapping()
    mapping.du = wp.vec3(0.5 / wp.max(size[0], 1.0e-12), 0.0, 0.0)
    mapping.dv = wp.vec3(0.0, -0.5 / wp.max(size[1], 1.0e-12), 0.0)
    mapping.uv = wp.vec2(mapping.du[0] * local[0], mapping.dv[1] * local[1])
    return mapping


@wp.func
def by_corners(meshes: Meshes, surface: Surface) -> Mapping:
    """A mesh's own texture coordinates."""
    mapping = Mapping()
    start = meshes.uvs[surface.corner]
    along1 = meshes.uvs[surface.corner + 1] - start
    along2 = meshes.uvs[surface.corner + 2] - start
    uv = start + surface.weights[0] * along1 + surface.weights[1] * along2
    mapping.uv = wp.vec2(uv[0], 1.0 - uv[1])
    origin = face_corner(meshes, surface.row)
    edge1 = face_corner(meshes, surface.row + 1) - origin
    edge2 = face_corner(meshes, surface.row + 2) - origin
    cross = wp.cross(edge1, edge2)
    square = wp.max(wp.dot(cross, cross), 1.0e-37)
    weight1 = wp.cross(edge2, cross) / square  # gradients of the barycentric weights
    weight2 = wp.cross(cross, edge1) / square
    mapping.du = along1[0] * weight1 + along2[0] * weight2
    mapping.dv = -(along1[1] * weight1 + along2[1] * weight2)
    return mapping


@functools.cache
def make_mapping(shape_types: frozenset[int]) -> tuple[Any, Any, Any]:
    """The 2-D and the cube mapping of the given shape types, and a test.

    ``(shapes, meshes, fields, world, shape, surface, finish) -> Mapping``; the same to a ``CubeMapping``; and
    ``(shapes, meshes, world, shape) -> bool``, whether a shape is a mesh with texture coordinates of its own: on such
    a mesh a cube texture does not show.
    """

    @wp.func
    def has_own_uvs(shapes: Shapes, meshes: Meshes, world: wp.int32, shape: wp.int32):
        own = wp.bool(False)
        if wp.static(MESH in shape_types):
            if shapes.types[shape] == MESH:
                own = meshes.has_uvs[shapes.assets[world % shapes.assets.shape[0], shape]] != 0
        return own

    @wp.func
    def extent(shapes: Shapes, meshes: Meshes, fields: HeightFields, world: wp.int32, shape: wp.int32, kind: wp.int32):
        """The shape's half extents as MuJoCo gives them to its renderer."""
        size = shapes.sizes[world % shapes.sizes.shape[0], shape]
        if wp.static(SPHERE in shape_types):
            if kind == SPHERE:
                size = wp.vec3(size[0], size[0], size[0])
        if wp.static(CAPSULE in shape_types or CYLINDER in shape_types):
            if kind == CAPSULE or kind == CYLINDER:
                size = wp.vec3(size[0], size[0], size[1])
        if wp.static(MESH in shape_types):
            if kind == MESH:
                mesh = shapes.assets[world % shapes.assets.shape[0], shape]
                lower = meshes.lower[mesh]
                upper = meshes.upper[mesh]
                for k in range(3):
                    size[k] = wp.max(wp.abs(lower[k]), wp.abs(upper[k]))
        if wp.static(HEIGHT_FIELD in shape_types):
            if kind == HEIGHT_FIELD:
                field = fields.size[shapes.assets[world % shapes.assets.shape[0], shape]]
                size = wp.vec3(field[0], field[1], 0.25 * field[2] + 0.5 * field[3])
        return size

    @wp.func
    def map_2d(
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        world: wp.int32,
        shape: wp.int32,
        surface: Surface,
        finish: Finish,
    ):
        kind = shapes.types[shape]
        size = extent(shapes, meshes, fields, world, shape, kind)
        mapping = Mapping()
        offset = wp.float32(0.0)
        if wp.static(PLANE in shape_types):
            if kind == PLANE:
                mapping = flat_axes(surface, size, 0, 1)
                if size[0] <= 0.0 or size[1] <= 0.0:
                    offset = -0.5
        if wp.static(BOX in shape_types):
            if kind == BOX:
                u_axis = wp.where(surface.part == 0, 1, 0)
                v_axis = wp.where(surface.part == 2, 1, 2)
                mapping = flat_axes(surface, size, u_axis, v_axis)
        if wp.static(SPHERE in shape_types or ELLIPSOID in shape_types):
            if kind == SPHERE or kind == ELLIPSOID:
                mapping = on_globe(surface.local, size, 0.5, 1.0 / HALF_TURN)
        if wp.static(CAPSULE in shape_types or CYLINDER in shape_types):
            if kind == CAPSULE or kind == CYLINDER:
                if surface.part == SIDE:
                    mapping = around(surface.local[0], surface.local[1], wp.vec2(size[0], size[0]))
                    mapping = along_axis(mapping, surface.local[2], size[2])
                elif kind == CAPSULE:
                    up = wp.where(surface.part == TOP, 1.0, -1.0)
                    ball = wp.vec3(surface.local[0], surface.local[1], surface.local[2] - up * size[2])
                    upper = wp.where(surface.part == TOP, 1.0, 0.0)
                    mapping = on_globe(ball, wp.vec3(size[0], size[0], size[0]), upper, 4.0 / TURN)
                else:
                    mapping = flat_axes(surface, size, 0, 1)
                    mapping.uv[1] = 1.0 - mapping.uv[1]
                    mapping.dv = -mapping.dv
        if wp.static(HEIGHT_FIELD in shape_types):
            if kind == HEIGHT_FIELD:
                mapping = projected(surface.local, size)
                offset = -0.5
        if wp.static(MESH in shape_types):
            if kind == MESH:
                if has_own_uvs(shapes, meshes, world, shape):
                    mapping = by_corners(meshes, surface)
                else:
                    mapping = projected(surface.local, size)
                    offset = -0.5
        repeat = finish.texture_repeat
        if finish.texture_uniform:
            for k in range(2):
                if size[k] > 0.0:
                    repeat[k] = repeat[k] * size[k]
        mapping.uv = wp.vec2(mapping.uv[0] * repeat[0] + offset, mapping.uv[1] * repeat[1] + offset)
        mapping.du = mapping.du * repeat[0]
        mapping.dv = mapping.dv * repeat[1]
        return mapping

    @wp.func
    def map_cube(
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        world: wp.int32,
        shape: wp.int32,
        surface: Surface,
        finish: Finish,
    ):
        kind = shapes.types[shape]
        size = extent(shapes, meshes, fields, world, shape, kind)
        place = surface.local
        scale = wp.vec3(1.0, 1.0, 1.0)  # planes, height fields and meshes: metres
        if kind == SPHERE or kind == ELLIPSOID or kind == BOX or kind == CYLINDER or kind == CAPSULE:
            scale = wp.cw_div(scale, size)
        if wp.static(CAPSULE in shape_types):
            if kind == CAPSULE and surface.part != SIDE:
                # Each cap is a unit sphere whose middle is one above or below the origin.
                up = wp.where(surface.part == BOTTOM, -1.0, 1.0)
                scale = wp.vec3(scale[0], scale[0], scale[0])
                place[2] = place[2] + up * (size[0] - size[2])
        if finish.texture_uniform:
            scale = wp.cw_mul(scale, size)
        mapping = CubeMapping()
        mapping.direction = wp.cw_mul(place, scale)
        mapping.scale = scale
        return mapping

    return map_2d, map_cube, has_own_uvs
