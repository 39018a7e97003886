"""The colour of paths that a limit of their length holds, as MuJoCo blends it by the limit's impedance."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())


@wp.struct
class TendonLimits:
    """Columns whose colour follows the length of a path."""

    columns: wp.array(dtype=wp.int32)  # (entry,) of the table of shapes
    paths: wp.array(dtype=wp.int32)  # (entry,)
    hangs: wp.array(dtype=wp.bool)  # (entry,) slack below the greatest length, and then as it is
    ranges: wp.array(dtype=wp.vec3)  # (entry,) least and greatest length, margin within which the limit holds [m]
    impedance: wp.array(dtype=wp.vec4)  # (entry,) at the limit, beyond the width; width, middle of it: MuJoCo's solimp
    power: wp.array(dtype=wp.float32)  # (entry,) the fifth of these
    held: wp.vec3  # RGB of what a limit holds
    lengths: wp.array2d(dtype=wp.float32)  # (world, path) as they are [m]
    colors: wp.array2d(dtype=wp.vec4)  # (world*, column) RGBA of what nothing holds


@wp.func
def impedance_at(limits: TendonLimits, entry: wp.int32, beyond: wp.float32) -> wp.float32:
    """At so many metres beyond where the limit begins to hold."""
    given = limits.impedance[entry]
    if given[0] == given[1] or given[2] <= 1.0e-15:
        return 0.5 * (given[0] + given[1])
    x = wp.min(beyond / given[2], 1.0)
    power = limits.power[entry]
    y = x
    if power > 1.0:
        y = 1.0 - (1.0 - given[3]) * wp.pow((1.0 - x) / (1.0 - given[3]), power)
        if x <= given[3]:
            y = given[3] * wp.pow(x / given[3], power)
    return given[0] + y * (given[1] - given[0])


@wp.kernel(enable_backward=False)
def write_limit_impedance(limits: TendonLimits, colors: wp.array2d(dtype=wp.vec4), first: wp.int32):
    world, entry = row_and_column(first + wp.tid(), limits.columns.shape[0])
    length = limits.lengths[world, limits.paths[entry]]
    span = limits.ranges[entry]
    hold = wp.float32(0.0)
    if length - span[0] < span[2]:
        hold = impedance_at(limits, entry, span[2] + span[0] - length)
    if span[1] - length < span[2]:
        hold = impedance_at(limits, entry, span[2] + length - span[1])
    if limits.hangs[entry] and length < span[1]:
        hold = 0.0
    column = limits.columns[entry]
    color = limits.colors[world % limits.colors.shape[0], column]
    if color[0] == 0.5 and color[1] == 0.5 and color[2] == 0.5 and color[3] == 1.0:
        mixed = (1.0 - hold) * wp.vec3(color[0], color[1], color[2]) + hold * limits.held
        color = wp.vec4(mixed[0], mixed[1], mixed[2], color[3])
    colors[world, column] = color


def bind_limit_impedance(limits: Any, colors: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that writes ``colors``, (world, column), on ``device``; it may be ``limits.colors``."""
    return bind_launch(write_limit_impedance, colors.shape[0] * limits.columns.shape[0], [limits, colors], device)
