"""Several returns of a beam, as lidars report them where it meets more than one surface."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.scan_measurement import ScanFrame, energy, has_range, write_miss, write_return

wp.set_module_options(compiler_flags())

SPREAD = 7  # rays of a beam that widens
Spread = wp.types.vector(length=SPREAD, dtype=wp.float32)


@wp.kernel(enable_backward=False)
def measure_echoes(
    mask: wp.array(dtype=wp.uint8), frame: ScanFrame, gap: wp.float32, echoes: wp.int32, first: wp.int32
):
    """Returns of beams that widen: of SPREAD rays one below the other, the first along the beam.

    Rays that end within ``gap`` behind the nearest of them make one echo, at their mean. The strongest comes first.
    """
    columns = frame.rays.columns
    world, beam = row_and_column(first + wp.tid(), frame.traced.distance.shape[1] / SPREAD)
    if mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(beam, columns)
    center = row * SPREAD * columns + column
    left = Spread()  # distances that belong to no echo yet
    lights = Spread()
    for k in range(SPREAD):
        ray = center + k * columns
        left[k] = frame.traced.distance[world, ray]
        if not has_range(frame.params, world, left[k]):
            left[k] = wp.inf
        elif frame.scan.intensities.shape[0] > 0:
            lights[k] = energy(frame, world, ray)
        else:
            lights[k] = 1.0
    strengths = Spread()  # of echoes, -1: none
    middles = Spread()
    nearest = Spread()  # number of the ray, in a float
    for echo in range(SPREAD):
        least = wp.float32(wp.inf)
        for k in range(SPREAD):
            if left[k] < least:
                least = left[k]
                nearest[echo] = wp.float32(k)
        strengths[echo] = -1.0
        if wp.isfinite(least):
            count = wp.float32(0.0)
            total = wp.float32(0.0)
            strength = wp.float32(0.0)
            for k in range(SPREAD):
                if left[k] <= least + gap:
                    count += 1.0
                    total += left[k] - least
                    strength += lights[k]
                    left[k] = wp.inf
            strengths[echo] = strength / wp.float32(SPREAD)
            middles[echo] = least + total / count
    for echo in range(echoes):
        best = wp.int32(0)
        for k in range(SPREAD):
            if strengths[k] > strengths[best]:
                best = k
        place = beam * echoes + echo
        if strengths[best] >= 0.0:
            ray = center + wp.int32(nearest[best]) * columns
            write_return(frame, world, place, center, ray, middles[best], strengths[best])
            strengths[best] = -1.0
        else:
            write_miss(frame.scan, world, place)
