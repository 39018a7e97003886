"""Kernels of mjlab's ray-cast sensor: where its frames are, and what their rays meet."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.scan_poses import BASE, YAW, yaw_of

wp.set_module_options(compiler_flags())


@wp.func
def wxyz(rotation: wp.mat33) -> wp.vec4:
    turn = wp.quat_from_matrix(rotation)
    return wp.vec4(turn[3], turn[0], turn[1], turn[2])


@wp.kernel(enable_backward=False)
def place_frame(
    positions: wp.array2d(dtype=wp.vec3),
    rotations: wp.array2d(dtype=wp.mat33),
    source: wp.int32,
    alignment: wp.int32,
    frame: wp.int32,
    frame_positions: wp.array2d(dtype=wp.vec3),
    frame_rotations: wp.array2d(dtype=wp.vec4),
    mount_positions: wp.array(dtype=wp.vec3),
    mount_rotations: wp.array(dtype=wp.vec4),
    first: wp.int32,
):
    """Write the pose of a frame, which is object ``source`` of its kind, and of its rays; a thread for each world."""
    world = first + wp.tid()
    position = positions[world, source]
    rotation = rotations[world, source]
    frame_positions[world, frame] = position
    frame_rotations[world, frame] = wxyz(rotation)
    aligned = wp.identity(n=3, dtype=wp.float32)
    if alignment == BASE:
        aligned = rotation
    elif alignment == YAW:
        aligned = yaw_of(rotation)
    mount_positions[world] = position
    mount_rotations[world] = wxyz(aligned)


@wp.kernel(enable_backward=False)
def write_hits(
    mount_positions: wp.array(dtype=wp.vec3),
    mount_rotations: wp.array(dtype=wp.vec4),
    starts: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    ranges: wp.array2d(dtype=wp.float32),
    normals: wp.array2d(dtype=wp.vec3),
    first_ray: wp.int32,
    distances_out: wp.array2d(dtype=wp.float32),
    normals_out: wp.array2d(dtype=wp.vec3),
    hits_out: wp.array2d(dtype=wp.vec3),
    run: wp.int32,
    first: wp.int32,
):
    """Write what the rays of a frame meet, from ``first_ray`` on: of a ray that misses its start is the hit.

    A thread writes ``run`` rays, one after another.
    """
    count = ranges.shape[1]
    world, start = row_and_column(first + wp.tid(), (count + run - 1) // run)
    position = mount_positions[world]
    turn = mount_rotations[world]
    rotation = wp.quat(turn[1], turn[2], turn[3], turn[0])
    for ray in range(start * run, wp.min(start * run + run, count)):
        distance = ranges[world, ray]
        along = starts[ray] + wp.max(distance, 0.0) * directions[ray]
        distances_out[world, first_ray + ray] = distance
        normals_out[world, first_ray + ray] = normals[world, ray]
        hits_out[world, first_ray + ray] = position + wp.quat_rotate(rotation, along)
