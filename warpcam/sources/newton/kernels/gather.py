"""The stage that gathers shapes, which a simulator keeps in one list over all worlds, into the worlds' tables."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import PLANE

wp.set_module_options(compiler_flags())

VISIBLE = 1  # bit of FlatShapes.flags
ACTIVE = 1  # bit of FlatShapes.point_flags
WHITE = -3  # less the number of a triangle: see WorldShapes.faces


@wp.struct
class FlatShapes:
    """Shapes and bodies of all worlds, one after another, where the simulator keeps them."""

    transforms: wp.array(dtype=wp.transform)  # (shape,) from the shape to its body, or to the world if it has none
    bodies: wp.array(dtype=wp.int32)  # (shape,) the body, or -1
    scales: wp.array(dtype=wp.vec3)  # (shape,) as Shapes.sizes has them, but for planes: full widths
    colors: wp.array(dtype=wp.vec3)  # (shape,) display colour
    opacities: wp.array(dtype=wp.float32)  # (shape,) 0 hides the shape
    flags: wp.array(dtype=wp.int32)  # (shape,) without VISIBLE the shape is hidden
    types: wp.array(dtype=wp.int32)  # (shape,) this and the next: the simulator's, read where WorldShapes.wanted is
    sources: wp.array(dtype=wp.uint64)  # (shape,)
    body_transforms: wp.array(dtype=wp.transform)  # (body,) from the body to the world
    face_colors: wp.array(dtype=wp.vec3)  # (triangle,) display colour of soft surfaces; may be empty: white
    face_opacities: wp.array(dtype=wp.float32)  # (triangle,) may be empty: 1
    points: wp.array(dtype=wp.vec3)  # (particle,) world frame [m]
    radii: wp.array(dtype=wp.float32)  # (particle,) [m]; 0 hides the particle
    point_flags: wp.array(dtype=wp.int32)  # (particle,) without ACTIVE the particle is hidden


@wp.struct
class WorldShapes:
    """Output arrays, and the shape that each column shows."""

    ids: wp.array2d(dtype=wp.int32)  # (world, column) the shape, or -1
    faces: wp.array2d(
        dtype=wp.int32
    )  # (world, soft column) a triangle of the surface, -1 for none, -2 for a white one, WHITE less a triangle for one
    # that is white but for its texture; these follow on the shapes
    particles: wp.array2d(dtype=wp.int32)  # (world, particle's column) the particle, or -1; these follow on those
    types: wp.array(dtype=wp.int32)  # (column,)
    # (world, column) where shapes may change, the type and the source that one must have to be seen in this column, of
    # type -1 if any will do; else empty
    wanted: wp.array2d(dtype=wp.int32)
    pointers: wp.array2d(dtype=wp.uint64)
    positions: wp.array2d(dtype=wp.vec3)  # (world, column) and so on: see Shapes
    rotations: wp.array2d(dtype=wp.mat33)
    sizes: wp.array2d(dtype=wp.vec3)
    colors: wp.array2d(dtype=wp.vec4)
    bodies: wp.array2d(dtype=wp.int32)  # (world, place) the body, or -1
    body_positions: wp.array2d(dtype=wp.vec3)  # (world, place); NaN where there is no body
    body_rotations: wp.array2d(dtype=wp.mat33)


@wp.func
def rotation_in(pose: wp.transform) -> wp.mat33:
    """Rotation matrix of a pose; zeros for a quaternion of zeros, which makes no image."""
    turn = wp.transform_get_rotation(pose)
    rotation = wp.quat_to_matrix(turn)
    if wp.length_sq(turn) == 0.0:
        rotation = wp.mat33()
    return rotation


@wp.kernel(enable_backward=False)
def write_worlds(flat: FlatShapes, out: WorldShapes, first: wp.int32):
    shapes = out.ids.shape[1]
    soft = shapes + out.faces.shape[1]
    columns = soft + out.particles.shape[1]
    width = columns + out.bodies.shape[1]
    world, column = row_and_column(first + wp.tid(), width)
    if column >= columns:
        place = column - columns
        body = out.bodies[world, place]
        position = wp.vec3(wp.nan, wp.nan, wp.nan)
        rotation = wp.identity(n=3, dtype=wp.float32)
        if body >= 0:
            pose = flat.body_transforms[body]
            position = wp.transform_get_translation(pose)
            rotation = rotation_in(pose)
        out.body_positions[world, place] = position
        out.body_rotations[world, place] = rotation
        return

    if column >= soft:
        particle = out.particles[world, column - soft]
        shown = wp.float32(0.0)
        if particle >= 0:
            out.positions[world, column] = flat.points[particle]
            radius = flat.radii[particle]
            out.sizes[world, column] = wp.vec3(radius, 0.0, 0.0)
            if (flat.point_flags[particle] & ACTIVE) != 0 and radius > 0.0:
                shown = 1.0
        out.rotations[world, column] = wp.identity(n=3, dtype=wp.float32)
        out.colors[world, column] = wp.vec4(1.0, 1.0, 1.0, shown)
        return
    if column >= shapes:
        face = out.faces[world, column - shapes]
        tint = wp.vec3(1.0, 1.0, 1.0)
        shown = wp.float32(0.0)
        if face != -1:
            shown = 1.0
        if face >= 0 and flat.face_colors.shape[0] > 0:
            tint = flat.face_colors[face]
        if face <= wp.static(WHITE):
            face = wp.static(WHITE) - face
        if face >= 0 and flat.face_opacities.shape[0] > 0:
            shown = flat.face_opacities[face]
        out.rotations[world, column] = wp.identity(n=3, dtype=wp.float32)
        out.sizes[world, column] = wp.vec3(1.0, 1.0, 1.0)
        out.colors[world, column] = wp.vec4(tint[0], tint[1], tint[2], shown)
        return

    shape = out.ids[world, column]
    if shape < 0:
        out.colors[world, column] = wp.vec4(0.0, 0.0, 0.0, 0.0)
        return
    pose = flat.transforms[shape]
    body = flat.bodies[shape]
    if body >= 0:
        pose = flat.body_transforms[body] * pose
    size = flat.scales[shape]
    if out.types[column] == PLANE:
        size = 0.5 * size
    opacity = wp.float32(1.0)
    if flat.opacities.shape[0] > 0:
        opacity = flat.opacities[shape]
    if (flat.flags[shape] & VISIBLE) == 0:
        opacity = 0.0
    if out.wanted.shape[0] > 0:
        wanted = out.wanted[world, column]
        if wanted >= 0 and (flat.types[shape] != wanted or flat.sources[shape] != out.pointers[world, column]):
            opacity = 0.0
    color = flat.colors[shape]
    out.positions[world, column] = wp.transform_get_translation(pose)
    out.rotations[world, column] = rotation_in(pose)
    out.sizes[world, column] = size
    out.colors[world, column] = wp.vec4(color[0], color[1], color[2], opacity)


def bind_gather(flat: FlatShapes, out: WorldShapes, device: wp.Device) -> Stage:
    """Bind the stage that writes ``out`` from ``flat``, both on ``device``."""
    width = sum(table.shape[1] for table in (out.ids, out.faces, out.particles, out.bodies))
    return bind_launch(write_worlds, out.ids.shape[0] * width, [flat, out], device)
