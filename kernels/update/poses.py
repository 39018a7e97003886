"""Poses that a user gives, and the shapes, bodies, lights and cameras that follow them."""

import warp as wp

from warpcam.kernels.passes.views import rotation_of
from warpcam.kernels.runtime.compile import compiler_flags

wp.set_module_options(compiler_flags())


@wp.struct
class AttachedPoses:
    """Things of one kind. Each hangs on a driven frame, or stands still in the world."""

    drivers: wp.array(dtype=wp.int32)  # (thing,) column of Drives, or -1 for the world
    positions: wp.array(dtype=wp.vec3)  # (thing,) in the driver's frame [m]
    rotations: wp.array(dtype=wp.mat33)  # (thing,) to the driver's frame


@wp.kernel(enable_backward=False)
def write_driven_poses(
    poses: wp.array3d(dtype=wp.float32),
    columns: wp.array(dtype=wp.int32),
    positions: wp.array2d(dtype=wp.vec3),
    rotations: wp.array2d(dtype=wp.mat33),
):
    """Poses (world*, path, 7), position [m] and quaternion w x y z, to the driven frames they are of."""
    world, path = wp.tid()
    row = world % poses.shape[0]
    quaternion = wp.vec4(poses[row, path, 3], poses[row, path, 4], poses[row, path, 5], poses[row, path, 6])
    positions[world, columns[path]] = wp.vec3(poses[row, path, 0], poses[row, path, 1], poses[row, path, 2])
    rotations[world, columns[path]] = rotation_of(quaternion)


@wp.func
def attached_pose(
    followers: AttachedPoses,
    positions: wp.array2d(dtype=wp.vec3),
    rotations: wp.array2d(dtype=wp.mat33),
    world: wp.int32,
    thing: wp.int32,
):
    position = followers.positions[thing]
    rotation = followers.rotations[thing]
    driver = followers.drivers[thing]
    if driver >= 0:
        frame = rotations[world, driver]
        position = positions[world, driver] + frame * position
        rotation = frame * rotation
    return position, rotation


@wp.kernel(enable_backward=False)
def update_attached(
    followers: AttachedPoses,
    positions: wp.array2d(dtype=wp.vec3),
    rotations: wp.array2d(dtype=wp.mat33),
    out_positions: wp.array2d(dtype=wp.vec3),
    out_rotations: wp.array2d(dtype=wp.mat33),
):
    world, thing = wp.tid()
    position, rotation = attached_pose(followers, positions, rotations, world, thing)
    out_positions[world, thing] = position
    out_rotations[world, thing] = rotation


@wp.kernel(enable_backward=False)
def update_attached_lights(
    followers: AttachedPoses,
    positions: wp.array2d(dtype=wp.vec3),
    rotations: wp.array2d(dtype=wp.mat33),
    out_positions: wp.array2d(dtype=wp.vec3),
    out_rotations: wp.array2d(dtype=wp.mat33),
    out_directions: wp.array2d(dtype=wp.vec3),
):
    """A light shines along its frame's -z."""
    world, thing = wp.tid()
    position, rotation = attached_pose(followers, positions, rotations, world, thing)
    out_positions[world, thing] = position
    out_rotations[world, thing] = rotation
    out_directions[world, thing] = rotation * wp.vec3(0.0, 0.0, -1.0)


@wp.kernel(enable_backward=False)
def set_colors(
    values: wp.array3d(dtype=wp.float32),
    groups: wp.array(dtype=wp.int32),
    shapes: wp.array(dtype=wp.int32),
    colors: wp.array2d(dtype=wp.vec4),
):
    """Colours (world*, path, 3 or 4) to all shapes of each path; without an alpha theirs stays."""
    world, place = wp.tid()
    row = world % values.shape[0]
    group = groups[place]
    alpha = colors[world, shapes[place]][3]
    if values.shape[2] > 3:
        alpha = values[row, group, 3]
    colors[world, shapes[place]] = wp.vec4(values[row, group, 0], values[row, group, 1], values[row, group, 2], alpha)


@wp.kernel(enable_backward=False)
def set_visible(
    values: wp.array2d(dtype=wp.uint8),
    groups: wp.array(dtype=wp.int32),
    shapes: wp.array(dtype=wp.int32),
    visible: wp.array2d(dtype=wp.uint8),
):
    world, place = wp.tid()
    visible[world, shapes[place]] = values[world % values.shape[0], groups[place]]


@wp.kernel(enable_backward=False)
def finish_colors(
    colors: wp.array2d(dtype=wp.vec4), visible: wp.array2d(dtype=wp.uint8), out: wp.array2d(dtype=wp.vec4)
):
    """Set the alpha of hidden shapes to 0, so that the trace leaves them out."""
    world, shape = wp.tid()
    color = colors[world % colors.shape[0], shape]
    if visible[world % visible.shape[0], shape] == wp.uint8(0):
        color = wp.vec4(color[0], color[1], color[2], 0.0)
    out[world, shape] = color


@wp.kernel(enable_backward=False)
def set_textures(
    values: wp.array2d(dtype=wp.int32),
    materials: wp.array(dtype=wp.int32),
    count: wp.int32,
    textures: wp.array3d(dtype=wp.int32),
):
    """Set texture indices; indices outside the ``count`` textures mean no texture."""
    world, place = wp.tid()
    value = values[world % values.shape[0], place]
    textures[world, materials[place], 1] = wp.where(value < count, wp.max(value, -1), -1)
