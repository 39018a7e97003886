"""Poses and lenses of a stereo camera's second imager and projector, which follow its first imager."""

import warp as wp

from warpcam.kernels.passes.views import CameraPose, camera_pose
from warpcam.kernels.runtime.compile import compiler_flags

wp.set_module_options(compiler_flags())


@wp.func
def quaternion_of(rotation: wp.mat33) -> wp.vec4:
    """Quaternion w x y z of a rotation matrix; zeros, a fault of a camera, for a matrix of zeros."""
    turn = wp.quat()
    if wp.ddot(rotation, rotation) > 0.0:
        turn = wp.normalize(wp.quat_from_matrix(rotation))
    return wp.vec4(turn[3], turn[0], turn[1], turn[2])


@wp.kernel(enable_backward=False)
def place_beside(
    pose: CameraPose,
    baseline: wp.array(dtype=wp.float32),
    share: wp.float32,
    offset: wp.vec3,
    positions: wp.array(dtype=wp.vec3),
    rotations: wp.array(dtype=wp.vec4),
    first: wp.int32,
):
    """Write the pose of a camera at ``offset`` [m] and a share of the baseline to the right of another camera."""
    world = first + wp.tid()
    position, rotation = camera_pose(world, pose)
    positions[world] = position + rotation * (offset + wp.vec3(share * baseline[world], 0.0, 0.0))
    rotations[world] = quaternion_of(rotation)


@wp.kernel(enable_backward=False)
def copy_numbers(source: wp.array(dtype=wp.float32), target: wp.array(dtype=wp.float32), first: wp.int32):
    """Copy what one camera has for each world to another."""
    number = first + wp.tid()
    target[number] = source[number]
