"""Random numbers with which episodes begin."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def draw_starts(
    mask: wp.array(dtype=wp.uint8),
    seed: wp.array(dtype=wp.int32),
    episodes: wp.array(dtype=wp.int32),
    out: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column = row_and_column(first + wp.tid(), out.shape[1])
    if mask[world] == wp.uint8(0):
        return
    episode = wp.rand_init(seed[0], episodes[world])
    out[world, column] = wp.randf(wp.rand_init(wp.int32(episode), wp.int32(wp.rand_init(world, column))))
