"""The stage that writes the table of shapes where clouds of Gaussians are fixed to a scene's bodies."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())


@wp.struct
class ShapeColumns:
    """Arrays of shapes: see Shapes. A field of one row is shared by all worlds."""

    positions: wp.array2d(dtype=wp.vec3)
    rotations: wp.array2d(dtype=wp.mat33)
    sizes: wp.array2d(dtype=wp.vec3)
    assets: wp.array2d(dtype=wp.int32)
    materials: wp.array2d(dtype=wp.int32)
    colors: wp.array2d(dtype=wp.vec4)


@wp.struct
class FixedClouds:
    """Where clouds are, and which of them each world has."""

    bodies: wp.array(dtype=wp.int32)  # (place,) or -1 for the world
    positions: wp.array(dtype=wp.vec3)  # (place,) in the body's frame [m]
    rotations: wp.array(dtype=wp.mat33)  # (place,) to the body's frame
    first: wp.array(dtype=wp.int32)  # (place,) first of its clouds
    counts: wp.array(dtype=wp.int32)  # (place,) how many these are
    choice: wp.array2d(dtype=wp.int32)  # (world, place) one of them, or -1 for none
    body_positions: wp.array2d(dtype=wp.vec3)  # (world, body) world frame [m]
    body_rotations: wp.array2d(dtype=wp.mat33)


@wp.kernel(enable_backward=False)
def write_fixed_clouds(live: ShapeColumns, clouds: FixedClouds, out: ShapeColumns, first: wp.int32):
    world, column = row_and_column(first + wp.tid(), out.positions.shape[1])
    count = live.positions.shape[1]
    if column < count:
        out.positions[world, column] = live.positions[world, column]
        out.rotations[world, column] = live.rotations[world, column]
        out.assets[world, column] = live.assets[world % live.assets.shape[0], column]
        if world < out.sizes.shape[0]:
            out.sizes[world, column] = live.sizes[world, column]
        if world < out.materials.shape[0]:
            out.materials[world, column] = live.materials[world, column]
        if world < out.colors.shape[0]:
            out.colors[world, column] = live.colors[world, column]
        return
    place = column - count
    choice = clouds.choice[world, place]
    position = clouds.positions[place]
    rotation = clouds.rotations[place]
    body = clouds.bodies[place]
    if body >= 0:
        frame = clouds.body_rotations[world, body]
        position = clouds.body_positions[world, body] + frame @ position
        rotation = frame @ rotation
    asset = wp.int32(-1)
    if choice >= 0 and choice < clouds.counts[place]:
        asset = clouds.first[place] + choice
    elif choice != -1:
        rotation = wp.mat33()  # no such cloud: zeros are a fault of the world
    out.positions[world, column] = position
    out.rotations[world, column] = rotation
    out.assets[world, column] = asset


def bind_fixed_clouds(live: Any, clouds: Any, out: Any, device: wp.Device) -> Stage:
    """Bind the stage that writes ``out``: the columns of ``live``, and after them those of ``clouds``."""
    count = out.positions.shape[0] * out.positions.shape[1]
    return bind_launch(write_fixed_clouds, count, [live, clouds, out], device)
