"""The surface at a hit: position, normals, material, and where it lies on its texture.

All places and directions here are in the shape's own frame. The functions are made for the shape types a scene has,
so that no other type's code is compiled.
"""

import functools
from typing import Any

import warp as wp

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
    Materials,
    Meshes,
    Shapes,
)

# Parts of a shape that are normal to, or mapped, in their own ways. A box has its three axes instead, 0 to 2.
SIDE = 0
TOP = 1
BOTTOM = 2

# The material of a shape without one is MuJoCo's: a geom's colour then is all its own.
DEFAULT_COLOR = wp.vec4(0.5, 0.5, 0.5, 1.0)
DEFAULT_SPECULAR = 0.5
DEFAULT_SHININESS = 0.5


@wp.struct
class Surface:
    """The surface at one hit, in the shape's frame."""

    local: wp.vec3  # the hit [m]
    normal: wp.vec3  # unit, outwards, of the geometry itself: a mesh's flat face
    shading: wp.vec3  # unit, the normal to light with: a mesh's interpolated corner normals, else `normal`
    part: wp.int32  # SIDE, TOP, BOTTOM; of a box the axis; TOP of a height field is its triangles
    row: wp.int32  # mesh: first row of the face in Meshes.faces
    corner: wp.int32  # mesh: first corner of the face in Meshes.normals and Meshes.uvs
    weights: wp.vec2  # mesh: barycentric weights of the face's second and third corner


@wp.struct
class Finish:
    """How a shape looks, its material and its own colour resolved."""

    color: wp.vec4  # RGBA
    emission: wp.float32
    specular: wp.float32
    shininess: wp.float32  # in [0, 1]
    texture: wp.int32  # or -1
    texture_repeat: wp.vec2
    texture_uniform: wp.bool


@wp.func
def component(v: wp.vec3, axis: wp.int32) -> wp.float32:
    """``v[axis]`` of a vector that stays in registers."""
    return wp.where(axis == 0, v[0], wp.where(axis == 1, v[1], v[2]))


@wp.func
def axis_vector(axis: wp.int32, value: wp.float32) -> wp.vec3:
    """The vector of length ``value`` along an axis."""
    return wp.vec3(wp.where(axis == 0, value, 0.0), wp.where(axis == 1, value, 0.0), wp.where(axis == 2, value, 0.0))


@wp.func
def box_surface(local: wp.vec3, half: wp.vec3, ray: wp.vec3) -> Surface:
    """On each axis a ray can enter by one side only; the hit is on the nearest of the three."""
    axis = wp.int32(0)
    nearest = wp.float32(wp.inf)
    for k in range(3):
        gap = wp.abs(half[k] + wp.sign(ray[k]) * local[k])
        if gap < nearest:
            nearest = gap
            axis = k
    surface = Surface()
    surface.part = axis
    surface.normal = axis_vector(axis, -wp.sign(component(ray, axis)))
    return surface


@wp.func
def cylinder_surface(local: wp.vec3, radius: wp.float32, half_length: wp.float32, ray: wp.vec3) -> Surface:
    """The side, or the cap by which the ray can enter, whichever is nearer to the hit."""
    surface = Surface()
    axial = wp.sqrt(local[0] * local[0] + local[1] * local[1])
    if wp.abs(half_length + wp.sign(ray[2]) * local[2]) < wp.abs(radius - axial):
        surface.part = wp.where(ray[2] < 0.0, TOP, BOTTOM)
        surface.normal = wp.vec3(0.0, 0.0, -wp.sign(ray[2]))
    else:
        surface.part = SIDE
        surface.normal = wp.normalize(wp.vec3(local[0], local[1], 0.0))
    return surface


@wp.func
def capsule_surface(local: wp.vec3, half_length: wp.float32) -> Surface:
    """The normal points away from the nearest point of the axis."""
    surface = Surface()
    nearest = wp.clamp(local[2], -half_length, half_length)
    surface.part = SIDE
    if local[2] > half_length:
        surface.part = TOP
    elif local[2] < -half_length:
        surface.part = BOTTOM
    surface.normal = wp.normalize(local - wp.vec3(0.0, 0.0, nearest))
    return surface


@wp.func
def ellipsoid_surface(local: wp.vec3, half: wp.vec3) -> Surface:
    """The normal is the gradient of the sum of (x / half)^2."""
    surface = Surface()
    surface.normal = wp.normalize(wp.cw_div(wp.cw_div(local, half), half))
    return surface


@wp.func
def height_field_surface(fields: HeightFields, field: wp.int32, face: wp.int32, local: wp.vec3) -> Surface:
    """Triangle 0 of a cell lies below its diagonal from (row, column) to (row + 1, column + 1), triangle 1 above."""
    surface = Surface()
    size = fields.size[field]
    columns = fields.columns[field]
    rows = fields.rows[field]
    if face >= 0 and face < 2 * (rows - 1) * (columns - 1):
        surface.part = TOP
        cell = face // 2
        row = cell // (columns - 1)
        first = fields.height_start[field] + row * columns + cell % (columns - 1)
        diagonal = fields.heights[first + columns + 1] - fields.heights[first]
        rise = wp.vec2()  # along the cell's two sides
        if face % 2 == 0:
            along = fields.heights[first + 1] - fields.heights[first]
            rise = wp.vec2(along, diagonal - along)
        else:
            along = fields.heights[first + columns] - fields.heights[first]
            rise = wp.vec2(diagonal - along, along)
        slope_x = rise[0] * wp.float32(columns - 1) / (2.0 * size[0])
        slope_y = rise[1] * wp.float32(rows - 1) / (2.0 * size[1])
        surface.normal = wp.normalize(wp.vec3(-slope_x, -slope_y, 1.0))
    else:
        gap_x = wp.abs(size[0] - wp.abs(local[0]))
        gap_y = wp.abs(size[1] - wp.abs(local[1]))
        gap_z = wp.abs(local[2] + size[3])
        if gap_z < gap_x and gap_z < gap_y:
            surface.normal = wp.vec3(0.0, 0.0, -1.0)
        elif gap_x < gap_y:
            surface.normal = wp.vec3(wp.sign(local[0]), 0.0, 0.0)
        else:
            surface.normal = wp.vec3(0.0, wp.sign(local[1]), 0.0)
    return surface


@wp.func
def face_corner(meshes: Meshes, row: wp.int32) -> wp.vec3:
    """The corner of a mesh in one row of ``Meshes.faces``."""
    corner = meshes.faces[row]
    return wp.vec3(corner[0], corner[1], corner[2])


@wp.func
def mesh_surface(meshes: Meshes, mesh: wp.int32, face: wp.int32, local: wp.vec3) -> Surface:
    """``face`` counts the mesh's faces in leaf order."""
    surface = Surface()
    row = meshes.face_start[mesh] + 3 * face
    first = meshes.faces[row]
    given = wp.cast(first[3], wp.int32)
    origin = wp.vec3(first[0], first[1], first[2])
    edge1 = face_corner(meshes, row + 1) - origin
    edge2 = face_corner(meshes, row + 2) - origin
    cross = wp.cross(edge1, edge2)
    square = wp.max(wp.dot(cross, cross), 1.0e-37)
    surface.normal = wp.normalize(cross)
    weight1 = wp.clamp(wp.dot(wp.cross(local - origin, edge2), cross) / square, 0.0, 1.0)
    weight2 = wp.clamp(wp.dot(wp.cross(edge1, local - origin), cross) / square, 0.0, 1.0 - weight1)
    surface.row = row
    surface.corner = 3 * (meshes.corner_start[mesh] + given)
    surface.weights = wp.vec2(weight1, weight2)
    smooth = (
        (1.0 - weight1 - weight2) * meshes.normals[surface.corner]
        + weight1 * meshes.normals[surface.corner + 1]
        + weight2 * meshes.normals[surface.corner + 2]
    )
    length = wp.length(smooth)
    if length > 1.0e-6:
        surface.shading = smooth / length
    else:
        surface.shading = surface.normal
    return surface


@functools.cache
def make_surface(shape_types: frozenset[int]) -> Any:
    """``(shapes, meshes, fields, world, shape, face, local, ray) -> Surface`` for the given types.

    ``local`` is the hit and ``ray`` the direction it was seen along, of any length, in the shape's frame. ``face`` is
    what the trace found there.
    """

    @wp.func
    def surface_at(
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        world: wp.int32,
        shape: wp.int32,
        face: wp.int32,
        local: wp.vec3,
        ray: wp.vec3,
    ):
        kind = shapes.types[shape]
        size = shapes.sizes[world % shapes.sizes.shape[0], shape]
        surface = Surface()
        if wp.static(PLANE in shape_types):
            if kind == PLANE:
                surface.normal = wp.vec3(0.0, 0.0, 1.0)
        if wp.static(SPHERE in shape_types):
            if kind == SPHERE:
                surface.normal = wp.normalize(local)
        if wp.static(CAPSULE in shape_types):
            if kind == CAPSULE:
                surface = capsule_surface(local, size[1])
        if wp.static(ELLIPSOID in shape_types):
            if kind == ELLIPSOID:
                surface = ellipsoid_surface(local, size)
        if wp.static(CYLINDER in shape_types):
            if kind == CYLINDER:
                surface = cylinder_surface(local, size[0], size[1], ray)
        if wp.static(BOX in shape_types):
            if kind == BOX:
                surface = box_surface(local, size, ray)
        if wp.static(HEIGHT_FIELD in shape_types):
            if kind == HEIGHT_FIELD:
                field = shapes.assets[world % shapes.assets.shape[0], shape]
                surface = height_field_surface(fields, field, face, local)
        surface.shading = surface.normal
        if wp.static(MESH in shape_types):
            if kind == MESH:
                mesh = shapes.assets[world % shapes.assets.shape[0], shape]
                surface = mesh_surface(meshes, mesh, face, local)
        surface.local = local
        return surface

    return surface_at


@functools.cache
def make_finish(has_materials: bool) -> Any:
    """``(shapes, materials, world, shape) -> Finish``; without materials their tables are not read."""

    @wp.func
    def finish_of(shapes: Shapes, materials: Materials, world: wp.int32, shape: wp.int32):
        finish = Finish()
        finish.color = shapes.colors[world % shapes.colors.shape[0], shape]
        finish.specular = DEFAULT_SPECULAR
        finish.shininess = DEFAULT_SHININESS
        finish.texture = -1
        if wp.static(has_materials):
            index = shapes.materials[world % shapes.materials.shape[0], shape]
            if index >= 0 and index < materials.color.shape[1]:
                # A shape's own colour counts where it has been set: where it differs from the default.
                if finish.color == DEFAULT_COLOR:
                    finish.color = materials.color[world % materials.color.shape[0], index]
                finish.emission = materials.emission[world % materials.emission.shape[0], index]
                finish.specular = materials.specular[world % materials.specular.shape[0], index]
                finish.shininess = materials.shininess[world % materials.shininess.shape[0], index]
                finish.texture = materials.texture[world % materials.texture.shape[0], index, 1]
                finish.texture_repeat = materials.texture_repeat[world % materials.texture_repeat.shape[0], index]
                finish.texture_uniform = materials.texture_uniform[world % materials.texture_uniform.shape[0], index]
        return finish

    return finish_of
