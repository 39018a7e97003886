"""Rays that begin within a solid shape meet its far side: see native/sensors/far_sides.h."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import Materials, Shapes
from warpcam.sensors.kernels.scan_measurement import TracedScan
from warpcam.sensors.kernels.scan_poses import ScanPoses
from warpcam.sensors.kernels.scan_rays import ScanRays

# Rays of a run, for which all shapes are looked at once: of rays that begin in one place, and of others, of which more
# have more shapes around them.
RUN, RUN_WITH_ORIGINS = 1024, 256
LANES = 32  # threads of CUDA that work on a run

meet_far_sides = make_kernel(
    "meet_far_sides",
    "warpcam::meet_far_sides(mask, max_range, shapes, materials, rays, poses, traced, length, index);",
    {
        "mask": wp.array(dtype=wp.uint8),
        "max_range": wp.array(dtype=wp.float32),
        "shapes": Shapes,
        "materials": Materials,
        "rays": ScanRays,
        "poses": ScanPoses,
        "traced": TracedScan,
        "length": wp.int32,
    },
    native_module("sensors/far_sides.h"),
)


meet_far_sides_of_table = make_kernel(
    "meet_far_sides_of_table",
    "warpcam::meet_far_sides_of_table(shapes, materials, table, first_row, count, traced, length, index);",
    {
        "shapes": Shapes,
        "materials": Materials,
        "table": wp.array2d(dtype=wp.float32),
        "first_row": wp.int32,
        "count": wp.int32,
        "traced": TracedScan,
        "length": wp.int32,
    },
    native_module("sensors/far_sides.h"),
)


def bind_far_sides(
    mask: wp.array,
    max_range: wp.array,
    shapes: Any,
    materials: Any,
    rays: Any,
    poses: Any,
    traced: Any,
    num_worlds: int,
    device: wp.Device,
) -> Stage:
    """The stage that puts far sides in place of what ``traced`` has behind them."""
    length = RUN_WITH_ORIGINS if rays.origins is not None and rays.origins.shape[0] > 0 else RUN
    runs = -(-rays.rows * rays.columns // length)
    inputs = [mask, max_range, shapes, materials, rays, poses, traced, length]
    return bind_launch(meet_far_sides, num_worlds * runs * _lanes(device), inputs, device)


def bind_table_far_sides(
    shapes: Any, materials: Any, table: wp.array, first_row: int, traced: Any, count: int, device: wp.Device
) -> Stage:
    """Likewise for ``count`` rays of a table with origins, whose camera stands at the world's origin.

    Args:
        shapes: ``Shapes``.
        materials: ``Materials``.
        table: (world, number) float32, as native/camera/ray_table.h reads it.
        first_row: Numbers before those of the first ray.
        traced: ``TracedScan``; written.
        count: Rays of each world.
        device: Where it is launched.
    """
    inputs = [shapes, materials, table, first_row, count, traced, RUN_WITH_ORIGINS]
    runs = table.shape[0] * -(-count // RUN_WITH_ORIGINS)
    return bind_launch(meet_far_sides_of_table, runs * _lanes(device), inputs, device)


def _lanes(device: wp.Device) -> int:
    return LANES if device.is_cuda else 1
