"""Sums of light over several frames."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def count_samples(mask: wp.array(dtype=wp.uint8), samples: wp.int32, counts: wp.array(dtype=wp.int32), first: wp.int32):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        counts[world] = counts[world] % samples + 1


@wp.kernel(enable_backward=False)
def add_light(
    mask: wp.array(dtype=wp.uint8),
    counts: wp.array(dtype=wp.int32),
    source: wp.array2d(dtype=wp.vec3),
    sums: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    total = source[world, pixel]
    if counts[world] > 1:
        total += sums[world, pixel]
    sums[world, pixel] = total
    target[world, pixel] = total / wp.float32(counts[world])
