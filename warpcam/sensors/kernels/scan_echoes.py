"""Several echoes of a beam, as lidars report them where it meets more than one surface."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.scan_measurement import Echoes, ScanParams, TracedScan, ray_light
from warpcam.sensors.kernels.scan_planes import FAR_AWAY, EndlessPlanes, runs_along_plane, within_reach
from warpcam.sensors.kernels.scan_poses import ScanPoses
from warpcam.sensors.kernels.scan_rays import ScanRays

wp.set_module_options(compiler_flags())

SPREAD = 7  # rays of a beam that widens
Spread = wp.types.vector(length=SPREAD, dtype=wp.float32)


@wp.kernel(enable_backward=False)
def find_echoes(
    mask: wp.array(dtype=wp.uint8),
    rays: ScanRays,
    poses: ScanPoses,
    traced: TracedScan,
    planes: EndlessPlanes,
    params: ScanParams,
    gap: wp.float32,
    echoes: Echoes,
    first: wp.int32,
):
    """Find the echoes of beams of SPREAD rays.

    Rays that end within ``gap`` behind the nearest of them make one echo, at their mean. The strongest comes first.
    """
    columns = rays.columns
    world, beam = row_and_column(first + wp.tid(), traced.distance.shape[1] / SPREAD)
    if mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(beam, columns)
    center = row * SPREAD * columns + column
    left = Spread()  # distances that belong to no echo yet
    lights = Spread()
    far = params.max_range[world]
    for k in range(SPREAD):
        ray = center + k * columns
        distance = traced.distance[world, ray]
        if distance > FAR_AWAY:
            if runs_along_plane(planes, rays, poses, world, ray, distance):
                distance = wp.inf
        distance = within_reach(distance, far)
        left[k] = wp.inf
        if distance >= params.min_range[world] and distance <= far:
            left[k] = distance
            lights[k] = 1.0
            if traced.albedo.shape[0] > 0 and wp.isfinite(distance):
                lights[k] = ray_light(traced, rays, poses, world, ray, params.dropout_attenuation[world])
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
    for echo in range(echoes.count):
        best = wp.int32(0)
        for k in range(SPREAD):
            if strengths[k] > strengths[best]:
                best = k
        place = beam * echoes.count + echo
        echoes.distance[world, place] = wp.where(strengths[best] >= 0.0, middles[best], wp.inf)
        echoes.rays[world, place] = center + wp.int32(nearest[best]) * columns
        echoes.light[world, place] = strengths[best]
        strengths[best] = -1.0
