"""Clocks of the frames that a rig measures."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def advance(
    mask: wp.array(dtype=wp.uint8),
    now: wp.array(dtype=wp.float32),
    times: wp.array(dtype=wp.float32),
    elapsed: wp.array(dtype=wp.float32),
    first: wp.int32,
):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        elapsed[world] = now[world] - times[world]
        times[world] = now[world]
