"""Returns of a lidar: what it makes of the distances that its rays have met.

Functions take numbers here: on a CPU Warp copies structs for each call.
"""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.depth_values import happens, not_negative
from warpcam.sensors.kernels.random import Randomness, world_state
from warpcam.sensors.kernels.range_limits import at_limit
from warpcam.sensors.kernels.scan_planes import FAR_AWAY, EndlessPlanes, runs_along_plane, within_reach
from warpcam.sensors.kernels.scan_poses import ScanPoses, pose_at
from warpcam.sensors.kernels.scan_rays import ScanRays, direction_of, origin_of

wp.set_module_options(compiler_flags())


@wp.struct
class TracedScan:
    """What rays have met; arrays that nothing needs are empty."""

    distance: wp.array2d(dtype=wp.float32)  # (world, ray) inf: nothing [m]
    shapes: wp.array2d(dtype=wp.int32)
    bodies: wp.array2d(dtype=wp.int32)
    normals: wp.array3d(dtype=wp.float32)  # (world, ray, 3) world frame
    albedo: wp.array3d(dtype=wp.uint8)  # (world, ray, 3)
    luminance: wp.array(dtype=wp.float32)  # (3 * 256,) share of it, by channel and value


@wp.struct
class ScanParams:
    """Numbers of each world, (world,)."""

    min_range: wp.array(dtype=wp.float32)  # [m]
    max_range: wp.array(dtype=wp.float32)  # [m]
    noise_constant: wp.array(dtype=wp.float32)  # [m]
    noise_linear: wp.array(dtype=wp.float32)
    noise_quadratic: wp.array(dtype=wp.float32)  # [1 / m]
    noise_offset: wp.array(dtype=wp.float32)  # [m]
    noise_resolution: wp.array(dtype=wp.float32)  # [m]; 0: none
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
class Echoes:
    """Surfaces that beams of several rays have met, (world, return); empty where a beam is one ray."""

    distance: wp.array2d(dtype=wp.float32)  # inf: none [m]
    rays: wp.array2d(dtype=wp.int32)  # the nearest ray that ends there
    light: wp.array2d(dtype=wp.float32)
    count: wp.int32  # of returns of each beam
    spread: wp.int32  # rays of each beam, one below the other, the first along the beam


@wp.func
def is_dropped(
    light: wp.float32, rate: wp.float32, limit: wp.float32, zero: wp.float32, one: wp.float32, other: wp.float32
) -> wp.bool:
    """Dropout of CARLA's ray-cast lidar, of two numbers drawn from [0, 1)."""
    dropped = happens(one, rate) or wp.isnan(light)
    if limit != 0.0 and not (light > limit):
        dropped = dropped or not (other < zero / limit * light + 1.0 - zero)
    return dropped


@wp.func
def ray_light(
    traced: TracedScan, rays: ScanRays, poses: ScanPoses, world: wp.int32, ray: wp.int32, attenuation: wp.float32
) -> wp.float32:
    """Light of a ray that returns: luminance of the albedo times the cosine of incidence, less what the air takes."""
    rotation = poses.rotations[world]
    if rays.parts.shape[0] > 0:
        _, rotation = pose_at(poses, world, rays.parts[ray])
    direction = wp.quat_rotate(rotation, direction_of(rays, ray))
    normal = wp.vec3(traced.normals[world, ray, 0], traced.normals[world, ray, 1], traced.normals[world, ray, 2])
    luminance = wp.float32(0.0)
    for c in range(3):
        luminance += traced.luminance[256 * c + wp.int32(traced.albedo[world, ray, c])]
    light = luminance * wp.abs(wp.dot(normal, direction))
    if attenuation > 0.0:
        light *= wp.exp(-attenuation * traced.distance[world, ray])
    return light


@wp.kernel(enable_backward=False)
def measure(
    mask: wp.array(dtype=wp.uint8),
    rays: ScanRays,
    poses: ScanPoses,
    traced: TracedScan,
    planes: EndlessPlanes,
    echoes: Echoes,
    params: ScanParams,
    randomness: Randomness,
    scan: Scan,
    run: wp.int32,
    first: wp.int32,
):
    """Write what is reported; a thread writes ``run`` returns, one after another."""
    count = scan.ranges.shape[1]
    world, start = row_and_column(first + wp.tid(), (count + run - 1) // run)
    if mask[world] == wp.uint8(0):
        return
    near = params.min_range[world]
    far = params.max_range[world]
    constant = params.noise_constant[world]
    linear = params.noise_linear[world]
    quadratic = params.noise_quadratic[world]
    offset = params.noise_offset[world]
    step = params.noise_resolution[world]
    rate = params.dropout_rate[world]
    limit = params.dropout_intensity_limit[world]
    zero = params.dropout_zero_intensity[world]
    attenuation = params.dropout_attenuation[world]
    # Numbers that are NaN count, and nothing returns.
    is_random = wp.isnan(attenuation + limit) or not (
        wp.abs(constant) + wp.abs(linear) + wp.abs(quadratic) + rate + zero <= 0.0
    )
    common = wp.int32(0)  # of the random numbers of the world
    if is_random:
        common = world_state(randomness, world, randomness.frames[world])
    for k in range(run):
        place = start * run + k
        if place >= count:
            return
        beam = place  # the ray along it
        ray = place  # the traced ray that returns
        distance = wp.float32(0.0)
        if echoes.spread > 0:
            row, column = row_and_column(place // echoes.count, rays.columns)
            beam = row * echoes.spread * rays.columns + column
            ray = echoes.rays[world, place]
            distance = echoes.distance[world, place]
        else:
            if rays.flipped != 0:
                row, column = row_and_column(place, rays.columns)
                ray = (rays.rows - 1 - row) * rays.columns + column
            distance = traced.distance[world, ray]
            if distance > FAR_AWAY:
                if runs_along_plane(planes, rays, poses, world, ray, distance):
                    distance = wp.inf
            distance = within_reach(distance, far)
        measured = distance
        returns = distance >= near and distance <= far and wp.isfinite(distance)
        if returns:
            if is_random:
                state = wp.rand_init(common, place)
                one = wp.randf(state)
                other = wp.randf(state)
                sigma = constant + distance * (linear + distance * quadratic)
                measured += not_negative(sigma) * wp.randn(state)
                returns = not is_dropped(wp.exp(-attenuation * distance), rate, limit, zero, one, other)
            measured += offset
            if step != 0.0:
                measured = at_limit(step * wp.round(measured / step), near, far)
            returns = returns and measured >= near and measured <= far
        if not returns:
            measured = scan.miss
        scan.ranges[world, place] = measured
        if scan.intensities.shape[0] > 0:
            light = wp.float32(0.0)
            if returns:
                if echoes.spread > 0:
                    light = echoes.light[world, place]
                else:
                    light = ray_light(traced, rays, poses, world, ray, attenuation)
                if scan.raw != 0:
                    light = light / (distance * distance)
            scan.intensities[world, place] = light
        if scan.ids.shape[0] > 0:
            scan.ids[world, place] = wp.where(returns, traced.shapes[world, ray], -1)
        if scan.bodies.shape[0] > 0:
            scan.bodies[world, place] = wp.where(returns, traced.bodies[world, ray], -1)
        if scan.normals.shape[0] > 0:
            for c in range(3):
                scan.normals[world, place, c] = wp.where(returns, traced.normals[world, ray, c], 0.0)
        if scan.points.shape[0] > 0:
            point = wp.vec3(scan.miss, scan.miss, scan.miss)
            if returns:
                point = origin_of(rays, beam) + measured * direction_of(rays, beam)
                if scan.in_world != 0:
                    position = poses.positions[world]
                    rotation = poses.rotations[world]
                    if rays.parts.shape[0] > 0:
                        position, rotation = pose_at(poses, world, rays.parts[beam])
                    point = position + wp.quat_rotate(rotation, point)
            for c in range(3):
                scan.points[world, place, c] = point[c]
