"""Poses of a lidar: on its body now, when it was read last, and between."""

import warp as wp

from warpcam.kernels.passes.views import rotation_of
from warpcam.kernels.runtime.compile import compiler_flags

wp.set_module_options(compiler_flags())

BASE, YAW, WORLD = 0, 1, 2  # Mount.alignment
# By how much the camera sees farther than the greatest range, at which surfaces are seen, rounding and all.
BEYOND = wp.constant(1.0 + 2.0**-20)
UPRIGHT = wp.constant(0.1)  # shorter is the shadow of an axis from which no yaw is taken


@wp.struct
class Mount:
    """Where a lidar is fixed."""

    parent: wp.int32  # body, or -1
    parent_positions: wp.array2d(dtype=wp.vec3)  # (world, body) world frame [m]
    parent_rotations: wp.array2d(dtype=wp.mat33)  # (world, body)
    positions: wp.array(dtype=wp.vec3)  # (world,) in the parent's frame [m]
    rotations: wp.array(dtype=wp.vec4)  # (world,) w x y z of any length but 0
    alignment: wp.int32  # BASE, YAW or WORLD: what of the parent's rotation it follows


@wp.struct
class ScanPoses:
    """Poses in the world frame of a sweep's end, which is now, and of its beginning."""

    known: wp.array(dtype=wp.uint8)  # (world,) 0: nothing is known of the last read
    positions: wp.array(dtype=wp.vec3)  # (world,) now [m]
    rotations: wp.array(dtype=wp.quat)  # (world,)
    last_positions: wp.array(dtype=wp.vec3)  # (world,) at the last read
    last_rotations: wp.array(dtype=wp.quat)  # (world,) as far from `rotations` as quaternions as they are as rotations


@wp.func
def yaw_of(rotation: wp.mat33) -> wp.mat33:
    """Turn about z that is left of a rotation: that of its x axis, or of its y axis where x points up or down."""
    cosine = rotation[0, 0]
    sine = rotation[1, 0]
    if wp.sqrt(cosine * cosine + sine * sine) < UPRIGHT:
        cosine = rotation[1, 1]
        sine = -rotation[0, 1]
    length = wp.sqrt(cosine * cosine + sine * sine)
    cosine = cosine / length
    sine = sine / length
    return wp.mat33(cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0)


@wp.kernel(enable_backward=False)
def place_sensor(
    mount: Mount,
    mask: wp.array(dtype=wp.uint8),
    everything: wp.int32,
    poses: ScanPoses,
    positions: wp.array(dtype=wp.vec3),
    rotations: wp.array(dtype=wp.vec4),
    ranges: wp.array(dtype=wp.float32),
    far: wp.array(dtype=wp.float32),
    first: wp.int32,
):
    """Write the pose of now, also to the camera that traces, and how far that sees.

    ``everything`` is 1 where all worlds are drawn.
    """
    world = first + wp.tid()
    if everything == 0 and mask[world] == wp.uint8(0):
        return
    position = mount.positions[world]
    rotation = rotation_of(mount.rotations[world])
    if mount.parent >= 0:
        frame = mount.parent_rotations[world, mount.parent]
        position = mount.parent_positions[world, mount.parent] + frame * position
        if mount.alignment == BASE:
            rotation = frame * rotation
        elif mount.alignment == YAW:
            rotation = yaw_of(frame) * rotation
    turn = wp.quat()  # of zeros: a fault of the world, as its kinematics never ran
    if wp.ddot(rotation, rotation) > 0.0:
        turn = wp.normalize(wp.quat_from_matrix(rotation))
    last_position = position
    last_turn = turn
    if poses.known[world] != wp.uint8(0):
        last_position = poses.positions[world]
        last_turn = poses.rotations[world]
        if wp.dot(last_turn, turn) < 0.0:
            last_turn = -last_turn
    poses.last_positions[world] = last_position
    poses.last_rotations[world] = last_turn
    poses.positions[world] = position
    poses.rotations[world] = turn
    is_pose = wp.isfinite(position) and wp.isfinite(turn) and wp.length(turn) > 0.0
    poses.known[world] = wp.where(is_pose, wp.uint8(1), wp.uint8(0))
    positions[world] = position
    far[world] = BEYOND * ranges[world]
    rotations[world] = wp.vec4(turn[3], turn[0], turn[1], turn[2])


@wp.func
def pose_at(poses: ScanPoses, world: wp.int32, part: wp.float32):
    """Position and rotation when that part of a sweep is over."""
    position = wp.lerp(poses.last_positions[world], poses.positions[world], part)
    return position, wp.quat_slerp(poses.last_rotations[world], poses.rotations[world], part)


@wp.kernel(enable_backward=False)
def forget_poses(mask: wp.array(dtype=wp.uint8), known: wp.array(dtype=wp.uint8), first: wp.int32):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        known[world] = wp.uint8(0)
