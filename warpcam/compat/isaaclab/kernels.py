"""Kernels of Isaac Lab's ray casters: where their rays begin, and what they meet."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.scan_poses import BASE, YAW, ScanPoses

wp.set_module_options(compiler_flags())


@wp.struct
class CasterMount:
    """Where a ray caster is, in every world."""

    body: wp.int32
    body_positions: wp.array2d(dtype=wp.vec3)  # (world, body) [m]
    body_rotations: wp.array2d(dtype=wp.mat33)
    alignment: wp.int32  # BASE, YAW or WORLD
    offset: wp.vec3  # of all rays, in the aligned frame [m]
    drift: wp.array(dtype=wp.vec3)  # (world,) of the sensor, world frame [m]
    ray_drift: wp.array(dtype=wp.vec3)  # (world,) x and y of the rays, in the aligned frame; z of what they meet [m]
    positions: wp.array(dtype=wp.vec3)  # (world,) of the sensor; written
    rotations: wp.array(dtype=wp.quat)  # likewise


@wp.func
def yaw_alone(turn: wp.quat) -> wp.quat:
    """Turn about z of the angle that Isaac Lab calls yaw."""
    x, y, z, w = turn[0], turn[1], turn[2], turn[3]
    half = 0.5 * wp.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return wp.quat(0.0, 0.0, wp.sin(half), wp.cos(half))


@wp.kernel(enable_backward=False)
def place_caster(
    mount: CasterMount,
    poses: ScanPoses,
    ray_positions: wp.array(dtype=wp.vec3),
    ray_rotations: wp.array(dtype=wp.vec4),
    first: wp.int32,
):
    """Write the poses of the sensor and of its rays, w x y z; a thread for each world."""
    world = first + wp.tid()
    turn = wp.quat_from_matrix(mount.body_rotations[world, mount.body])
    position = mount.body_positions[world, mount.body] + mount.drift[world]
    mount.positions[world] = position
    mount.rotations[world] = turn
    aligned = wp.quat_identity()
    if mount.alignment == BASE:
        aligned = turn
    elif mount.alignment == YAW:
        aligned = yaw_alone(turn)
    aside = wp.quat_rotate(aligned, mount.ray_drift[world])
    start = position + wp.vec3(aside[0], aside[1], 0.0) + wp.quat_rotate(aligned, mount.offset)
    poses.positions[world] = start
    poses.rotations[world] = aligned
    ray_positions[world] = start
    ray_rotations[world] = wp.vec4(aligned[3], aligned[0], aligned[1], aligned[2])


@wp.kernel(enable_backward=False)
def write_caster_hits(
    ray_drift: wp.array(dtype=wp.vec3),
    points: wp.array2d(dtype=wp.vec3),
    ranges: wp.array2d(dtype=wp.float32),
    normals: wp.array2d(dtype=wp.vec3),
    hits_out: wp.array2d(dtype=wp.vec3),
    normals_out: wp.array2d(dtype=wp.vec3),
    run: wp.int32,
    first: wp.int32,
):
    """Add what drifts along z, and make all infinite where nothing is met; a thread writes ``run`` rays."""
    count = ranges.shape[1]
    world, start = row_and_column(first + wp.tid(), (count + run - 1) // run)
    none = wp.vec3(wp.inf, wp.inf, wp.inf)
    up = wp.vec3(0.0, 0.0, ray_drift[world][2])
    for ray in range(start * run, wp.min(start * run + run, count)):
        if wp.isfinite(ranges[world, ray]):
            hits_out[world, ray] = points[world, ray] + up
            normals_out[world, ray] = normals[world, ray]
        else:
            hits_out[world, ray] = none
            normals_out[world, ray] = none


@wp.struct
class CasterCameraMount:
    """Where a ray-caster camera is, in every world; its own frame has x ahead and z up."""

    body: wp.int32
    body_positions: wp.array2d(dtype=wp.vec3)  # (world, body) [m]
    body_rotations: wp.array2d(dtype=wp.mat33)
    offsets: wp.array(dtype=wp.vec3)  # (world,) in the body's frame [m]
    turns: wp.array(dtype=wp.quat)  # (world,) from the camera's frame to the body's
    drift: wp.array(dtype=wp.vec3)  # (world,) of the camera, world frame [m]
    ray_drift: wp.array(dtype=wp.vec3)  # (world,) x and y of the rays, in the camera's frame [m]
    opengl: wp.quat  # from the frame with -z ahead and y up to the camera's
    ros: wp.quat  # from the frame with z ahead and y down
    w_first: wp.int32  # order of the quaternions that are reported
    positions: wp.array(dtype=wp.vec3)  # (world,) of the camera [m]; written
    rotations_world: wp.array(dtype=wp.vec4)  # likewise
    rotations_ros: wp.array(dtype=wp.vec4)
    rotations_opengl: wp.array(dtype=wp.vec4)


@wp.func
def in_order(turn: wp.quat, w_first: wp.int32) -> wp.vec4:
    """Numbers of a quaternion, w x y z or x y z w."""
    numbers = wp.vec4(turn[0], turn[1], turn[2], turn[3])
    if w_first != 0:
        numbers = wp.vec4(turn[3], turn[0], turn[1], turn[2])
    return numbers


@wp.kernel(enable_backward=False)
def place_caster_camera(
    mount: CasterCameraMount,
    view_positions: wp.array(dtype=wp.vec3),
    view_rotations: wp.array(dtype=wp.vec4),
    first: wp.int32,
):
    """Write the poses of the camera and of its view, w x y z; a thread for each world."""
    world = first + wp.tid()
    body = wp.quat_from_matrix(mount.body_rotations[world, mount.body])
    turn = body * mount.turns[world]
    position = mount.body_positions[world, mount.body] + wp.quat_rotate(body, mount.offsets[world]) + mount.drift[world]
    view = turn * mount.opengl
    mount.positions[world] = position
    mount.rotations_world[world] = in_order(turn, mount.w_first)
    mount.rotations_ros[world] = in_order(turn * mount.ros, mount.w_first)
    mount.rotations_opengl[world] = in_order(view, mount.w_first)
    aside = wp.quat_rotate(turn, mount.ray_drift[world])
    view_positions[world] = position + wp.vec3(aside[0], aside[1], 0.0)
    view_rotations[world] = in_order(view, 1)


@wp.kernel(enable_backward=False)
def turn_caster_camera(
    mount: CasterCameraMount,
    worlds: wp.array(dtype=wp.int64),
    positions: wp.array(dtype=wp.vec3),
    turns: wp.array(dtype=wp.quat),
):
    """Write the offsets of some worlds by which their cameras are in these poses; empty arrays leave them."""
    row = wp.tid()
    world = wp.int32(worlds[row])
    body = wp.quat_from_matrix(mount.body_rotations[world, mount.body])
    if positions.shape[0] > 0:
        away = positions[row] - mount.body_positions[world, mount.body]
        mount.offsets[world] = wp.quat_rotate_inv(body, away)
    if turns.shape[0] > 0:
        mount.turns[world] = wp.quat_inverse(body) * wp.normalize(turns[row])


@wp.kernel(enable_backward=False)
def clip_distances(image: wp.array(dtype=wp.float32), limit: wp.float32, beyond: wp.float32, first: wp.int32):
    """Replace what is beyond the limit, a miss too."""
    pixel = first + wp.tid()
    if image[pixel] > limit:
        image[pixel] = beyond


@wp.kernel(enable_backward=False)
def mark_missing_normals(normals: wp.array(dtype=wp.vec3), first: wp.int32):
    """Make the normals infinite where nothing is met, where they are 0."""
    pixel = first + wp.tid()
    if wp.length_sq(normals[pixel]) == 0.0:
        normals[pixel] = wp.vec3(wp.inf, wp.inf, wp.inf)
