"""Tables of rays that are written at each read, as native/camera/ray_table.h reads them."""

import warp as wp

from warpcam.accel import offset_ray_tables, ray_tables
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.scan_poses import ScanPoses, pose_at

wp.set_module_options(compiler_flags())

TILE_WIDTH, TILE_HEIGHT = ray_tables.TILE_WIDTH, ray_tables.TILE_HEIGHT


@wp.struct
class ScanRays:
    """Rays of a sweep in the sensor's frame. Ray (i, j) is number i * columns + j."""

    directions: wp.array(dtype=wp.vec3)  # (n,) unit, or 0 for none
    origins: wp.array(dtype=wp.vec3)  # (ray,) where it begins [m]; empty: at the sensor's position
    parts: wp.array(dtype=wp.float32)  # (ray,) part of the sweep that is over when it is sent; empty: all of it
    # (1,) row of `directions` that this read begins with, column after column; empty: rows are rays
    window: wp.array(dtype=wp.int32)
    rows: wp.int32
    columns: wp.int32
    flipped: wp.int32  # 1: rows of the traced images run the other way


@wp.func
def direction_of(rays: ScanRays, ray: wp.int32) -> wp.vec3:
    if rays.window.shape[0] == 0:
        return rays.directions[ray]
    row, column = row_and_column(ray, rays.columns)
    return rays.directions[(rays.window[0] + column * rays.rows + row) % rays.directions.shape[0]]


@wp.func
def origin_of(rays: ScanRays, ray: wp.int32) -> wp.vec3:
    origin = wp.vec3()
    if rays.origins.shape[0] > 0:
        origin = rays.origins[ray]
    return origin


@wp.kernel(enable_backward=False)
def advance_window(rays: ScanRays, first: wp.int32):
    """Go on by the rays of a read; one thread."""
    start = first + rays.window[0] + rays.rows * rays.columns
    rays.window[0] = start % rays.directions.shape[0]


@wp.func
def write_row(table: wp.array2d(dtype=wp.float32), world: wp.int32, place: wp.int32, values: wp.vec3, last: wp.float32):
    for k in range(3):
        table[world, place + k] = values[k]
    table[world, place + 3] = last


@wp.func
def write_cone(table: wp.array2d(dtype=wp.float32), world: wp.int32, place: wp.int32, axis: wp.vec3, least: wp.float32):
    """Axis of the cone about a tile's rays, and the cosine of its half angle."""
    write_row(table, world, place, axis, wp.max(least - wp.static(ray_tables.ROUNDING), -1.0))


@wp.func
def axis_of(total: wp.vec3) -> wp.vec3:
    """Axis of the cone about rays of that sum."""
    axis = wp.vec3(0.0, 0.0, -1.0)
    if wp.length(total) > 1.0e-4:
        axis = wp.normalize(total)
    return axis


@wp.func
def tile_ray(rays: ScanRays, tile: wp.int32, k: wp.int32) -> wp.int32:
    """Ray k of a tile, -1 beyond the image."""
    across = (rays.columns + TILE_WIDTH - 1) // TILE_WIDTH
    tile_row, tile_column = row_and_column(tile, across)
    row = tile_row * TILE_HEIGHT + k // TILE_WIDTH
    column = tile_column * TILE_WIDTH + k % TILE_WIDTH
    ray = wp.int32(-1)
    if row < rays.rows and column < rays.columns:
        ray = row * rays.columns + column
    return ray


@wp.func
def flattened(direction: wp.vec3) -> wp.vec2:
    """``warpcam.accel.ray_tables.flattened`` of one direction."""
    aside = direction[0] * direction[0] + direction[1] * direction[1]
    if wp.length_sq(direction) == 0.0:
        return wp.vec2(wp.static(ray_tables.BLIND), 0.0)
    if direction[2] > 0.0 and aside <= wp.static(ray_tables.BEHIND**-2):
        return wp.vec2(wp.static(ray_tables.BEHIND), 0.0)
    rate = 1.0 / (1.0 - direction[2])
    if direction[2] >= 0.0:
        rate = (1.0 + direction[2]) / aside
    return wp.vec2(rate * direction[0], rate * direction[1])


@wp.kernel(enable_backward=False)
def write_rays(rays: ScanRays, table: wp.array2d(dtype=wp.float32), tiles: wp.int32, first: wp.int32):
    """Table of rays that begin at one place, for all worlds; a thread for each tile."""
    tile = first + wp.tid()
    total = wp.vec3()
    for k in range(TILE_WIDTH * TILE_HEIGHT):
        ray = tile_ray(rays, tile, k)
        if ray >= 0:
            total += direction_of(rays, ray)
    axis = axis_of(total)
    least = wp.float32(1.0)
    for k in range(TILE_WIDTH * TILE_HEIGHT):
        ray = tile_ray(rays, tile, k)
        if ray >= 0:
            direction = direction_of(rays, ray)
            if wp.length_sq(direction) > 0.0:
                least = wp.min(least, wp.dot(axis, direction))
            point = flattened(direction)
            table[0, 4 * tiles + 2 * ray] = point[0]
            table[0, 4 * tiles + 2 * ray + 1] = point[1]
    write_cone(table, 0, 4 * tile, axis, least)


@wp.kernel(enable_backward=False)
def write_moving_rays(
    rays: ScanRays,
    poses: ScanPoses,
    reach: wp.float32,
    mask: wp.array(dtype=wp.uint8),
    everything: wp.int32,
    table: wp.array2d(dtype=wp.float32),
    tiles: wp.int32,
    first: wp.int32,
):
    """Table of rays that are sent on the way, of each world; a thread for each tile of each world.

    Bits and width of pixels stay. ``reach`` is how far from the sensor's position rays begin at most [m].
    """
    world, tile = row_and_column(first + wp.tid(), tiles)
    if everything == 0 and mask[world] == wp.uint8(0):
        return
    now = poses.positions[world]
    back = wp.quat_inverse(poses.rotations[world])
    total = wp.vec3()
    low = wp.vec3(wp.inf, wp.inf, wp.inf)
    high = -low
    pixels = 4 * (1 + 2 * tiles)
    part = wp.float32(-1.0)
    position = wp.vec3()
    rotation = wp.quat()
    for place in range(TILE_WIDTH * TILE_HEIGHT):
        k = place // TILE_HEIGHT + place % TILE_HEIGHT * TILE_WIDTH  # down each column, whose rays often go at once
        ray = tile_ray(rays, tile, k)
        if ray >= 0:
            direction = direction_of(rays, ray)
            if wp.length_sq(direction) > 0.0:
                if rays.parts[ray] != part:
                    part = rays.parts[ray]
                    position, rotation = pose_at(poses, world, part)
                    position = wp.quat_rotate(back, position - now)
                    rotation = wp.normalize(back * rotation)
                origin = position + wp.quat_rotate(rotation, origin_of(rays, ray))
                direction = wp.normalize(wp.quat_rotate(rotation, direction))
                total += direction
                low = wp.min(low, origin)
                high = wp.max(high, origin)
                for c in range(3):
                    table[world, pixels + 8 * ray + c] = origin[c]
                    table[world, pixels + 8 * ray + 4 + c] = direction[c]
    axis = axis_of(total)
    middle = wp.vec3()
    if low[0] <= high[0]:
        middle = 0.5 * (low + high)
    least = wp.float32(1.0)
    radius = wp.float32(0.0)
    for k in range(TILE_WIDTH * TILE_HEIGHT):
        ray = tile_ray(rays, tile, k)
        if ray >= 0:
            row = pixels + 8 * ray
            if wp.length_sq(direction_of(rays, ray)) > 0.0:
                direction = wp.vec3(table[world, row + 4], table[world, row + 5], table[world, row + 6])
                origin = wp.vec3(table[world, row], table[world, row + 1], table[world, row + 2])
                least = wp.min(least, wp.dot(axis, direction))
                radius = wp.max(radius, wp.length(origin - middle))
    larger = wp.float32(wp.static(1.0 + offset_ray_tables.ROUNDING))
    write_cone(table, world, 4 + 8 * tile, axis, least)
    write_row(table, world, 8 + 8 * tile, middle, larger * radius)
    if tile == 0:
        way = wp.quat_rotate(back, poses.last_positions[world] - poses.positions[world])
        write_row(table, world, 0, 0.5 * way, larger * (0.5 * wp.length(way) + reach))
