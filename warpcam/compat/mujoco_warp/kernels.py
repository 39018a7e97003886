"""Kernels of rays that are given in arrays: as the table of a camera that stands at the world's origin."""

import warp as wp

from warpcam.accel import offset_ray_tables, ray_tables
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.scan_measurement import TracedScan
from warpcam.sensors.kernels.scan_rays import axis_of, write_cone, write_row

wp.set_module_options(compiler_flags())

TILE = ray_tables.TILE_WIDTH * ray_tables.TILE_HEIGHT


@wp.struct
class GivenRays:
    """Rays of some worlds, and those of them that one camera traces."""

    starts: wp.array2d(dtype=wp.vec3)  # (world or 1, ray) world frame [m]
    vectors: wp.array2d(dtype=wp.vec3)  # (world or 1, ray) of any length
    excludes: wp.array(dtype=wp.int32)  # (ray,) body that it does not meet, or -1
    order: wp.array(dtype=wp.int32)  # (place,) ray at each place of the table, whose tiles are TILE places in turn
    excluded: wp.int32  # what `excludes` has of all these rays
    tiles: wp.int32


@wp.struct
class RayHits:
    """What rays meet, (world, ray)."""

    distances: wp.array2d(dtype=wp.float32)  # along the ray, in lengths of its vector; -1 for nothing
    geoms: wp.array2d(dtype=wp.int32)  # -1 for none
    normals: wp.array2d(dtype=wp.vec3)  # unit, or 0


@wp.func
def ray_at(given: GivenRays, place: wp.int32) -> wp.int32:
    """Ray at a place of the table, -1 for none."""
    ray = wp.int32(-1)
    if place < given.order.shape[0]:
        ray = given.order[place]
    return ray


@wp.kernel(enable_backward=False)
def write_given_rays(given: GivenRays, table: wp.array2d(dtype=wp.float32), first: wp.int32):
    """Rows of a tile: of its rays, its cone, the ball that they begin in; a thread for each tile of each world."""
    world, tile = row_and_column(first + wp.tid(), given.tiles)
    total = wp.vec3()
    low = wp.vec3(wp.inf, wp.inf, wp.inf)
    high = -low
    pixels = 4 * (1 + 2 * given.tiles)
    for k in range(TILE):
        place = tile * TILE + k
        ray = ray_at(given, place)
        if ray >= 0:
            start = given.starts[world % given.starts.shape[0], ray]
            vector = given.vectors[world % given.vectors.shape[0], ray]
            direction = wp.vec3(0.0, 0.0, 1.0)  # of no length: such a ray meets nothing, see write_ray_hits
            if wp.length_sq(vector) > 0.0:
                direction = wp.normalize(vector)
            total += direction
            low = wp.min(low, start)
            high = wp.max(high, start)
            for c in range(3):
                table[world, pixels + 8 * place + c] = start[c]
                table[world, pixels + 8 * place + 4 + c] = direction[c]
    axis = axis_of(total)
    middle = wp.vec3()
    if low[0] <= high[0]:
        middle = 0.5 * (low + high)
    least = wp.float32(1.0)
    radius = wp.float32(0.0)
    for k in range(TILE):
        place = tile * TILE + k
        if ray_at(given, place) >= 0:
            row = pixels + 8 * place
            direction = wp.vec3(table[world, row + 4], table[world, row + 5], table[world, row + 6])
            start = wp.vec3(table[world, row], table[world, row + 1], table[world, row + 2])
            least = wp.min(least, wp.dot(axis, direction))
            radius = wp.max(radius, wp.length(start - middle))
    larger = wp.float32(wp.static(1.0 + offset_ray_tables.ROUNDING))
    write_cone(table, world, 4 + 8 * tile, axis, least)
    write_row(table, world, 8 + 8 * tile, middle, larger * radius)


@wp.kernel(enable_backward=False)
def write_whole_ball(tiles: wp.int32, table: wp.array2d(dtype=wp.float32), first: wp.int32):
    """The ball about those of all tiles; a thread for each world."""
    world = first + wp.tid()
    low = wp.vec3(wp.inf, wp.inf, wp.inf)
    high = -low
    for tile in range(tiles):
        row = 8 + 8 * tile
        middle = wp.vec3(table[world, row], table[world, row + 1], table[world, row + 2])
        reach = wp.vec3(table[world, row + 3], table[world, row + 3], table[world, row + 3])
        low = wp.min(low, middle - reach)
        high = wp.max(high, middle + reach)
    larger = wp.float32(wp.static(1.0 + offset_ray_tables.ROUNDING))
    write_row(table, world, 0, 0.5 * (low + high), larger * 0.5 * wp.length(high - low))


@wp.kernel(enable_backward=False)
def write_ray_hits(given: GivenRays, traced: TracedScan, hits: RayHits, first: wp.int32):
    """Write what is met; a thread for each place of each world. NaN: the ray's excluded body is another one by now."""
    world, place = row_and_column(first + wp.tid(), given.order.shape[0])
    ray = given.order[place]
    if ray < 0:
        return
    vector = given.vectors[world % given.vectors.shape[0], ray]
    length = wp.length(vector)
    distance = traced.distance[world, place]
    found = wp.float32(-1.0)
    geom = wp.int32(-1)
    normal = wp.vec3()
    if wp.isfinite(distance) and length > 0.0:
        found = distance / length
        geom = traced.shapes[world, place]
        for c in range(3):
            normal[c] = traced.normals[world, place, c]
    if given.excludes[ray] != given.excluded:
        found = wp.nan
    hits.distances[world, ray] = found
    hits.geoms[world, ray] = geom
    hits.normals[world, ray] = normal
