"""Kernels of Isaac Gym's front end: states to and from its tensors, camera poses, images.

States of bodies and actors are rows of 13: position, quaternion x y z w, linear and angular velocity. What is read by
place is one row for each body, actor, degree of freedom or camera.
"""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import launch_kernel

wp.set_module_options(compiler_flags())

FREE = 0  # modes of a camera: where it was put
POSITION = 1  # at a fixed offset from a body, turned as it was
TRANSFORM = 2  # fixed to a body

MAX_FLOW = wp.constant(32767.0)


@wp.kernel(enable_backward=False)
def read_bodies(
    poses: wp.array(dtype=wp.transform),
    velocities: wp.array(dtype=wp.spatial_vector),
    bodies: wp.array(dtype=wp.int32),  # (row,)
    states: wp.array2d(dtype=wp.float32),  # (row, 13)
):
    row = wp.tid()
    body = bodies[row]
    pose = poses[body]
    velocity = velocities[body]
    for i in range(7):
        states[row, i] = pose[i]
    for i in range(6):
        states[row, 7 + i] = velocity[i]


@wp.kernel(enable_backward=False)
def write_roots(
    states: wp.array2d(dtype=wp.float32),  # (actor, 13)
    chosen: wp.array(dtype=wp.int32),  # (n,) actors
    coordinates: wp.array(dtype=wp.int32),  # (actor,) first of its free joint, or -1: fixed
    speeds: wp.array(dtype=wp.int32),  # (actor,) first of its free joint
    joints: wp.array(dtype=wp.int32),  # (actor,) its first joint
    joint_q: wp.array(dtype=wp.float32),
    joint_qd: wp.array(dtype=wp.float32),
    joint_frames: wp.array(dtype=wp.transform),
):
    actor = chosen[wp.tid()]
    if actor < 0 or actor >= states.shape[0]:
        return
    turn = wp.normalize(wp.quat(states[actor, 3], states[actor, 4], states[actor, 5], states[actor, 6]))
    place = wp.vec3(states[actor, 0], states[actor, 1], states[actor, 2])
    first = coordinates[actor]
    if first < 0:
        joint_frames[joints[actor]] = wp.transform(place, turn)
        return
    for i in range(3):
        joint_q[first + i] = place[i]
    for i in range(4):
        joint_q[first + 3 + i] = turn[i]
    for i in range(6):
        joint_qd[speeds[actor] + i] = states[actor, 7 + i]


@wp.kernel(enable_backward=False)
def read_dofs(
    joint_q: wp.array(dtype=wp.float32),
    joint_qd: wp.array(dtype=wp.float32),
    coordinates: wp.array(dtype=wp.int32),  # (dof,)
    speeds: wp.array(dtype=wp.int32),  # (dof,)
    states: wp.array2d(dtype=wp.float32),  # (dof, 2)
):
    dof = wp.tid()
    states[dof, 0] = joint_q[coordinates[dof]]
    states[dof, 1] = joint_qd[speeds[dof]]


@wp.kernel(enable_backward=False)
def write_dofs(
    states: wp.array2d(dtype=wp.float32),  # (dof, 2)
    chosen: wp.array(dtype=wp.int32),  # (n,) actors
    first_dofs: wp.array(dtype=wp.int32),  # (actor + 1,)
    coordinates: wp.array(dtype=wp.int32),  # (dof,)
    speeds: wp.array(dtype=wp.int32),  # (dof,)
    joint_q: wp.array(dtype=wp.float32),
    joint_qd: wp.array(dtype=wp.float32),
):
    actor = chosen[wp.tid()]
    if actor < 0 or actor >= first_dofs.shape[0] - 1:
        return
    for dof in range(first_dofs[actor], first_dofs[actor + 1]):
        joint_q[coordinates[dof]] = states[dof, 0]
        joint_qd[speeds[dof]] = states[dof, 1]


@wp.kernel(enable_backward=False)
def write_targets(
    values: wp.array(dtype=wp.float32),  # (dof,)
    chosen: wp.array(dtype=wp.int32),  # (n,) actors
    first_dofs: wp.array(dtype=wp.int32),  # (actor + 1,)
    places: wp.array(dtype=wp.int32),  # (dof,)
    targets: wp.array(dtype=wp.float32),
):
    actor = chosen[wp.tid()]
    if actor < 0 or actor >= first_dofs.shape[0] - 1:
        return
    for dof in range(first_dofs[actor], first_dofs[actor + 1]):
        targets[places[dof]] = values[dof]


@wp.kernel(enable_backward=False)
def hold_up(
    bodies: wp.array(dtype=wp.int32),  # (n,) those that gravity passes over
    masses: wp.array(dtype=wp.float32),
    gravity: wp.vec3,
    forces: wp.array(dtype=wp.spatial_vector),
):
    body = bodies[wp.tid()]
    forces[body] = forces[body] - masses[body] * wp.spatial_vector(gravity, wp.vec3())


@wp.kernel(enable_backward=False)
def gather_poses(
    poses: wp.array(dtype=wp.transform),
    bodies: wp.array(dtype=wp.int32),  # (row,)
    gathered: wp.array(dtype=wp.transform),  # (row,)
    first: wp.int32,
):
    row = first + wp.tid()
    gathered[row] = poses[bodies[row]]


@wp.kernel(enable_backward=False)
def place_cameras(
    poses: wp.array(dtype=wp.transform),
    modes: wp.array(dtype=wp.int32),  # (world,)
    bodies: wp.array(dtype=wp.int32),  # (world,) -1 for none
    offsets: wp.array(dtype=wp.transform),  # (world,) in the body's frame, or in its world's
    axes: wp.quat,  # from our camera's axes to theirs
    positions: wp.array2d(dtype=wp.float32),  # (world, 3)
    rotations: wp.array2d(dtype=wp.float32),  # (world, 4) w x y z
    first: wp.int32,
):
    world = first + wp.tid()
    pose = offsets[world]
    if modes[world] == TRANSFORM:
        pose = poses[bodies[world]] * pose
    elif modes[world] == POSITION:
        away = wp.transform_get_translation(poses[bodies[world]])
        pose = wp.transform(away + wp.transform_get_translation(pose), wp.transform_get_rotation(pose))
    turn = wp.transform_get_rotation(pose) * axes
    place = wp.transform_get_translation(pose)
    rotations[world, 0] = turn[3]
    for i in range(3):
        positions[world, i] = place[i]
        rotations[world, 1 + i] = turn[i]


# Images go to memory of their own for each camera, at addresses that never change: 0 is none.


@wp.func
def place_of(addresses: wp.array(dtype=wp.uint64), pixels: wp.int32, index: wp.int32):
    """World and pixel of a thread, and the address of the world's image."""
    world, pixel = row_and_column(index, pixels)
    return world, pixel, addresses[world]


@wp.kernel(enable_backward=False)
def write_colors(
    image: wp.array2d(dtype=wp.uint32),  # (world, pixel)
    addresses: wp.array(dtype=wp.uint64),  # (world,)
    first: wp.int32,
):
    world, pixel, address = place_of(addresses, image.shape[1], first + wp.tid())
    if address != wp.uint64(0):
        out = wp.array(ptr=address, shape=(image.shape[1],), dtype=wp.uint32)
        out[pixel] = image[world, pixel]


@wp.kernel(enable_backward=False)
def write_depth(
    image: wp.array2d(dtype=wp.float32),  # (world, pixel) [m], inf at a miss
    addresses: wp.array(dtype=wp.uint64),  # (world,)
    first: wp.int32,
):
    world, pixel, address = place_of(addresses, image.shape[1], first + wp.tid())
    if address != wp.uint64(0):
        out = wp.array(ptr=address, shape=(image.shape[1],), dtype=wp.float32)
        out[pixel] = -image[world, pixel]


@wp.kernel(enable_backward=False)
def write_ids(
    image: wp.array2d(dtype=wp.int32),  # (world, pixel) shape, or -1
    ids: wp.array(dtype=wp.int32),  # (shape,)
    addresses: wp.array(dtype=wp.uint64),  # (world,)
    first: wp.int32,
):
    world, pixel, address = place_of(addresses, image.shape[1], first + wp.tid())
    if address != wp.uint64(0):
        out = wp.array(ptr=address, shape=(image.shape[1],), dtype=wp.int32)
        shape = image[world, pixel]
        number = wp.int32(0)
        if shape >= 0:
            number = ids[shape]
        out[pixel] = number


@wp.func
def coded(pixels: wp.float32, size: wp.float32) -> wp.int16:
    """Return a flow component in 2^15 parts of the image's size."""
    return wp.int16(wp.clamp(wp.round(pixels * 32768.0 / size), -MAX_FLOW, MAX_FLOW))


@wp.kernel(enable_backward=False)
def write_flow(
    image: wp.array3d(dtype=wp.float32),  # (world, pixel, 2) pixels to the right and down
    valid: wp.array2d(dtype=wp.uint8),  # (world, pixel)
    width: wp.float32,
    height: wp.float32,
    addresses: wp.array(dtype=wp.uint64),  # (world,)
    first: wp.int32,
):
    world, pixel, address = place_of(addresses, image.shape[1], first + wp.tid())
    if address != wp.uint64(0):
        out = wp.array(ptr=address, shape=(2 * image.shape[1],), dtype=wp.int16)
        right = wp.int16(0)
        down = wp.int16(0)
        if valid[world, pixel] != wp.uint8(0):
            right = coded(image[world, pixel, 0], width)
            down = coded(image[world, pixel, 1], height)
        out[2 * pixel] = right
        out[2 * pixel + 1] = down


def launch(kernel: wp.Kernel, dim: Any, inputs: list[Any], device: wp.Device) -> None:
    """On the device's current stream; nothing for an empty one."""
    if (dim if isinstance(dim, int) else min(dim)) > 0:
        launch_kernel(kernel, dim, inputs, device=device)
