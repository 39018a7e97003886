"""Returns of a lidar: what it makes of the distances that its rays have met."""

import warp as wp

from warpcam.core.color import decode_srgb
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.random import Randomness, element_state
from warpcam.sensors.kernels.scan_poses import ScanPoses, pose_at
from warpcam.sensors.kernels.scan_rays import ScanRays, direction_of, origin_of, part_of

wp.set_module_options(compiler_flags())


@wp.struct
class TracedScan:
    """What rays have met; arrays that nothing needs are empty."""

    distance: wp.array2d(dtype=wp.float32)  # (world, ray) inf: nothing [m]
    shapes: wp.array2d(dtype=wp.int32)
    bodies: wp.array2d(dtype=wp.int32)
    normals: wp.array3d(dtype=wp.float32)  # (world, ray, 3) world frame
    albedo: wp.array3d(dtype=wp.uint8)  # (world, ray, 3)


@wp.struct
class ScanParams:
    """Numbers of each world, (world,)."""

    min_range: wp.array(dtype=wp.float32)  # [m]
    max_range: wp.array(dtype=wp.float32)  # [m]
    range_noise_constant: wp.array(dtype=wp.float32)  # [m]
    range_noise_linear: wp.array(dtype=wp.float32)
    range_noise_quadratic: wp.array(dtype=wp.float32)  # [1 / m]
    range_noise_bias: wp.array(dtype=wp.float32)  # [m]
    range_noise_resolution: wp.array(dtype=wp.float32)  # [m]; 0: none
    dropout_rate: wp.array(dtype=wp.float32)
    dropout_intensity_limit: wp.array(dtype=wp.float32)
    dropout_zero_intensity: wp.array(dtype=wp.float32)
    dropout_attenuation: wp.array(dtype=wp.float32)  # [1 / m]


@wp.struct
class Scan:
    """What a lidar reports, (world, return); arrays that nobody asked for are empty."""

    ranges: wp.array2d(dtype=wp.float32)
    intensities: wp.array2d(dtype=wp.float32)
    ids: wp.array2d(dtype=wp.int32)
    bodies: wp.array2d(dtype=wp.int32)
    normals: wp.array3d(dtype=wp.float32)
    points: wp.array3d(dtype=wp.float32)
    miss: wp.float32  # in ranges and points where nothing returns
    raw: wp.int32  # 1: intensities fall with the square of the range
    in_world: wp.int32  # 1: points are in the world frame


@wp.struct
class ScanFrame:
    """All that a return follows from, and where it goes."""

    rays: ScanRays
    poses: ScanPoses
    traced: TracedScan
    params: ScanParams
    randomness: Randomness
    scan: Scan


@wp.func
def has_range(params: ScanParams, world: wp.int32, distance: wp.float32) -> wp.bool:
    return distance >= params.min_range[world] and distance <= params.max_range[world] and wp.isfinite(distance)


@wp.func
def energy(frame: ScanFrame, world: wp.int32, ray: wp.int32) -> wp.float32:
    """Share of a ray's light that returns: reflectance times the cosine of incidence, less what the air takes."""
    traced = frame.traced
    distance = traced.distance[world, ray]
    reflectance = wp.float32(0.0)
    for c in range(3):
        weight = wp.where(c == 0, 0.2126, wp.where(c == 1, 0.7152, 0.0722))
        reflectance += weight * decode_srgb(wp.float32(traced.albedo[world, ray, c]) / 255.0)
    normal = wp.vec3(traced.normals[world, ray, 0], traced.normals[world, ray, 1], traced.normals[world, ray, 2])
    _, rotation = pose_at(frame.poses, world, part_of(frame.rays, ray))
    cosine = wp.abs(wp.dot(normal, wp.quat_rotate(rotation, direction_of(frame.rays, ray))))
    light = reflectance * cosine * wp.exp(-frame.params.dropout_attenuation[world] * distance)
    if frame.scan.raw != 0:
        light = light / (distance * distance)
    return light


@wp.func
def is_dropped(
    params: ScanParams, world: wp.int32, distance: wp.float32, one: wp.float32, other: wp.float32
) -> wp.bool:
    """Dropout of CARLA's ray-cast lidar, of two numbers drawn from [0, 1)."""
    light = wp.exp(-params.dropout_attenuation[world] * distance)
    limit = params.dropout_intensity_limit[world]
    zero = params.dropout_zero_intensity[world]
    dropped = one < params.dropout_rate[world]
    if limit > 0.0 and light <= limit:
        dropped = dropped or other >= zero / limit * light + 1.0 - zero
    return dropped


@wp.func
def measured_range(params: ScanParams, world: wp.int32, distance: wp.float32, normal: wp.float32) -> wp.float32:
    """Range with noise, of a number drawn from a normal distribution."""
    sigma = params.range_noise_constant[world] + distance * (
        params.range_noise_linear[world] + distance * params.range_noise_quadratic[world]
    )
    measured = distance + params.range_noise_bias[world] + wp.max(sigma, 0.0) * normal
    step = params.range_noise_resolution[world]
    if step > 0.0:
        measured = step * wp.round(measured / step)
    return measured


@wp.func
def is_random(params: ScanParams, world: wp.int32) -> wp.bool:
    """True if some number of a world's returns is drawn."""
    total = wp.abs(params.range_noise_constant[world]) + wp.abs(params.range_noise_linear[world])
    total += (
        wp.abs(params.range_noise_quadratic[world]) + params.dropout_rate[world] + params.dropout_zero_intensity[world]
    )
    return total > 0.0


@wp.func
def write_miss(scan: Scan, world: wp.int32, place: wp.int32):
    scan.ranges[world, place] = scan.miss
    if scan.intensities.shape[0] > 0:
        scan.intensities[world, place] = 0.0
    if scan.ids.shape[0] > 0:
        scan.ids[world, place] = -1
    if scan.bodies.shape[0] > 0:
        scan.bodies[world, place] = -1
    for c in range(3):
        if scan.normals.shape[0] > 0:
            scan.normals[world, place, c] = 0.0
        if scan.points.shape[0] > 0:
            scan.points[world, place, c] = scan.miss


@wp.func
def write_hit(
    frame: ScanFrame,
    world: wp.int32,
    place: wp.int32,
    beam: wp.int32,
    ray: wp.int32,
    measured: wp.float32,
    light: wp.float32,
):
    """Write a return: its point lies on the ray ``beam``, its ids and normal are those of ``ray``."""
    scan, traced = frame.scan, frame.traced
    scan.ranges[world, place] = measured
    if scan.intensities.shape[0] > 0:
        scan.intensities[world, place] = light
    if scan.ids.shape[0] > 0:
        scan.ids[world, place] = traced.shapes[world, ray]
    if scan.bodies.shape[0] > 0:
        scan.bodies[world, place] = traced.bodies[world, ray]
    if scan.normals.shape[0] > 0:
        for c in range(3):
            scan.normals[world, place, c] = traced.normals[world, ray, c]
    if scan.points.shape[0] > 0:
        point = origin_of(frame.rays, beam) + measured * direction_of(frame.rays, beam)
        if scan.in_world != 0:
            position, rotation = pose_at(frame.poses, world, part_of(frame.rays, beam))
            point = position + wp.quat_rotate(rotation, point)
        for c in range(3):
            scan.points[world, place, c] = point[c]


@wp.func
def write_return(
    frame: ScanFrame,
    world: wp.int32,
    place: wp.int32,
    beam: wp.int32,
    ray: wp.int32,
    distance: wp.float32,
    light: wp.float32,
):
    """Write what is measured of a surface at ``distance``, see ``write_hit``."""
    params = frame.params
    normal = wp.float32(0.0)
    dropped = wp.bool(False)
    if is_random(params, world):
        state = element_state(frame.randomness, world, place)
        one = wp.randf(state)
        other = wp.randf(state)
        normal = wp.randn(state)
        dropped = is_dropped(params, world, distance, one, other)
    measured = measured_range(params, world, distance, normal)
    if dropped or not has_range(params, world, measured):
        write_miss(frame.scan, world, place)
    else:
        write_hit(frame, world, place, beam, ray, measured, light)


@wp.kernel(enable_backward=False)
def measure(mask: wp.array(dtype=wp.uint8), frame: ScanFrame, first: wp.int32):
    """Returns of beams that are one ray each."""
    world, ray = row_and_column(first + wp.tid(), frame.traced.distance.shape[1])
    if mask[world] == wp.uint8(0):
        return
    distance = frame.traced.distance[world, ray]
    if not has_range(frame.params, world, distance):
        write_miss(frame.scan, world, ray)
        return
    light = wp.float32(0.0)
    if frame.scan.intensities.shape[0] > 0:
        light = energy(frame, world, ray)
    write_return(frame, world, ray, ray, ray, distance, light)
