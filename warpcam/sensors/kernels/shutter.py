"""Images at moments between two frames, looked up along the optical flow between them."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.types import View

wp.set_module_options(compiler_flags())

DOWN, UP, RIGHT, LEFT = 0, 1, 2, 3
REACH = 4  # tiles around a tile in which motion towards it is looked for
STEPS = 3  # of the iteration that finds a surface from where it was
CONVERGED = 0.02  # step of it after which it ends [pixels]
TOLERANCE = 0.75  # of its end [pixels]
SAME_SURFACE = 0.1  # depths that differ by less of themselves are of one surface


@wp.struct
class Motion:
    """Optical flow of a frame."""

    mask: wp.array(dtype=wp.uint8)  # (world,)
    flow: wp.array2d(dtype=wp.vec2)  # (world, pixel) [pixels]
    depth: wp.array2d(dtype=wp.float32)  # (world, pixel) [m]
    elapsed: wp.array(dtype=wp.float32)  # (world,) time since the frame before [s]; NaN: there is none
    tile_flow: wp.array2d(dtype=wp.vec4)  # (world, tile) flow of the longest and of the nearest in it
    tile_depth: wp.array2d(dtype=wp.float32)  # (world, tile) of the nearest [m]
    spread_flow: wp.array2d(dtype=wp.vec4)  # (world, tile) of those that may have been in it
    tile: wp.int32  # its width and height [pixels]
    width: wp.int32  # of the image [pixels]
    height: wp.int32
    # (world,) from homogeneous places of pixels to those that looked the same way in the frame before
    turns: wp.array(dtype=wp.mat33)
    miss: wp.array(dtype=wp.float32)  # (world,) depth where nothing is hit [m]; NaN: what is there does not move


@wp.struct
class Exposure:
    """Times at which the lines of an image are exposed."""

    readout: wp.array(dtype=wp.float32)  # (world,) from the first line to the last [s]
    duration: wp.array(dtype=wp.float32)  # (world,) of each line [s]
    direction: wp.int32  # DOWN, UP, RIGHT or LEFT: from the first line to the last
    samples: wp.int32


@wp.struct
class Place:
    """Part of an image that a pixel showed at an earlier moment."""

    pixel: wp.vec2  # [pixels]
    earlier: wp.bool  # in the frame before


@wp.kernel(enable_backward=False)
def follow_frames(
    mask: wp.array(dtype=wp.uint8),
    renders: wp.array(dtype=wp.int32),
    elapsed: wp.array(dtype=wp.float32),
    known: wp.array(dtype=wp.int32),
    since: wp.array(dtype=wp.float32),
    first: wp.int32,
):
    """Find the time since the frame before [s], NaN if that is not the one that the renderer has drawn before.

    ``known`` is the number of the frame before, 0 for none.
    """
    world = first + wp.tid()
    if mask[world] == wp.uint8(0):
        return
    time = wp.float32(wp.nan)
    if known[world] != 0 and renders[world] == known[world] + 1:
        time = elapsed[world]
    since[world] = time
    known[world] = renders[world]


@wp.kernel(enable_backward=False)
def find_turns(motion: Motion, views: wp.array(dtype=View), before: wp.array(dtype=View), first: wp.int32):
    """Find how the camera of a pinhole has turned since the frame before, and remember its view."""
    world = first + wp.tid()
    if motion.mask[world] == wp.uint8(0):
        return
    now = views[world]
    last = before[world]
    before[world] = now
    motion.miss[world] = wp.nan
    turn = wp.transpose(last.rotation) * now.rotation
    if now.rotation == last.rotation and now.scale == last.scale and now.center == last.center:
        return
    along = wp.mat33(
        now.scale[0], 0.0, (0.5 - now.center[0]) * now.scale[0],
        0.0, -now.scale[1], (now.center[1] - 0.5) * now.scale[1],
        0.0, 0.0, -1.0,
    )  # fmt: skip
    back = wp.mat33(
        1.0 / last.scale[0], 0.0, 0.5 - last.center[0],
        0.0, -1.0 / last.scale[1], 0.5 - last.center[1],
        0.0, 0.0, -1.0,
    )  # fmt: skip
    motion.turns[world] = back * turn * along
    motion.miss[world] = wp.inf


@wp.func
def flow_at(motion: Motion, world: wp.int32, pixel: wp.int32) -> wp.vec2:
    """Flow of a pixel; where nothing is hit that of what is infinitely far away."""
    flow = motion.flow[world, pixel]
    if motion.depth[world, pixel] == motion.miss[world]:
        row, column = row_and_column(pixel, motion.width)
        here = wp.vec3(wp.float32(column), wp.float32(row), 1.0)
        then = motion.turns[world] * here
        if then[2] > 0.0:
            flow = wp.vec2(here[0] - then[0] / then[2], here[1] - then[1] / then[2])
    return flow


@wp.func
def frames_of(time: wp.float32, elapsed: wp.float32) -> wp.float32:
    """A time before now in units of the time between the two frames; 0 where that is not known."""
    lag = wp.float32(0.0)
    if elapsed > 0.0:  # not of NaN
        lag = time / elapsed
    return lag


@wp.func
def line_lag(exposure: Exposure, world: wp.int32, row: wp.int32, column: wp.int32, width: wp.int32, height: wp.int32):
    """Time from the end of a line's exposure to the end of the last line's [s]."""
    number = row
    count = height
    if exposure.direction >= RIGHT:
        number = column
        count = width
    left = count - 1 - number
    if exposure.direction == UP or exposure.direction == LEFT:
        left = number
    return exposure.readout[world] * wp.float32(left) / wp.float32(wp.max(count - 1, 1))


@wp.func
def pixel_at(motion: Motion, place: wp.vec2) -> wp.int32:
    """Number of the pixel that is nearest to a place, -1 outside of the image."""
    column = wp.int32(wp.floor(place[0] + 0.5))
    row = wp.int32(wp.floor(place[1] + 0.5))
    pixel = row * motion.width + column
    if column < 0 or column >= motion.width or row < 0 or row >= motion.height:
        pixel = -1
    return pixel


@wp.kernel(enable_backward=False)
def find_tile_flow(motion: Motion, first: wp.int32):
    world, tile = row_and_column(first + wp.tid(), motion.tile_flow.shape[1])
    if motion.mask[world] == wp.uint8(0):
        return
    across = (motion.width + motion.tile - 1) // motion.tile
    top, left = row_and_column(tile, across)
    longest = wp.vec2()
    nearest = wp.vec2()
    depth = wp.float32(wp.inf)
    for row in range(top * motion.tile, wp.min((top + 1) * motion.tile, motion.height)):
        for column in range(left * motion.tile, wp.min((left + 1) * motion.tile, motion.width)):
            pixel = row * motion.width + column
            flow = flow_at(motion, world, pixel)
            if wp.length_sq(flow) > wp.length_sq(longest):
                longest = flow
            if motion.depth[world, pixel] < depth:
                depth = motion.depth[world, pixel]
                nearest = flow
    motion.tile_flow[world, tile] = wp.vec4(longest[0], longest[1], nearest[0], nearest[1])
    motion.tile_depth[world, tile] = depth


@wp.func
def reaches(offset: wp.vec2, flow: wp.vec2, lag: wp.float32, size: wp.float32) -> wp.bool:
    """True if what is seen at an offset was, at some moment of the lag, not farther away than a tile."""
    share = wp.clamp(wp.dot(offset, flow) / wp.max(wp.length_sq(flow), 1.0e-12), 0.0, lag)
    left = offset - share * flow
    return wp.max(wp.abs(left[0]), wp.abs(left[1])) <= size + 1.0


@wp.kernel(enable_backward=False)
def spread_tile_flow(motion: Motion, exposure: Exposure, first: wp.int32):
    world, tile = row_and_column(first + wp.tid(), motion.tile_flow.shape[1])
    if motion.mask[world] == wp.uint8(0):
        return
    across = (motion.width + motion.tile - 1) // motion.tile
    down = (motion.height + motion.tile - 1) // motion.tile
    row, column = row_and_column(tile, across)
    lag = frames_of(exposure.readout[world] + exposure.duration[world], motion.elapsed[world])
    size = wp.float32(motion.tile)
    longest = wp.vec2()
    nearest = wp.vec2()
    depth = wp.float32(wp.inf)
    for i in range(wp.max(row - REACH, 0), wp.min(row + REACH + 1, down)):
        for j in range(wp.max(column - REACH, 0), wp.min(column + REACH + 1, across)):
            offset = wp.vec2(wp.float32(j - column), wp.float32(i - row)) * size
            both = motion.tile_flow[world, i * across + j]
            flow = wp.vec2(both[0], both[1])
            if wp.length_sq(flow) > wp.length_sq(longest) and reaches(offset, flow, lag, size):
                longest = flow
            flow = wp.vec2(both[2], both[3])
            if motion.tile_depth[world, i * across + j] < depth and reaches(offset, flow, lag, size):
                depth = motion.tile_depth[world, i * across + j]
                nearest = flow
    motion.spread_flow[world, tile] = wp.vec4(longest[0], longest[1], nearest[0], nearest[1])


@wp.func
def surface_from(motion: Motion, world: wp.int32, place: wp.vec2, lag: wp.float32, flow: wp.vec2) -> wp.vec3:
    """Where what was at a place is now, found from a guess of its flow, and its depth; that is NaN if none is found."""
    now = place + lag * flow
    error = wp.float32(wp.inf)
    depth = wp.float32(wp.nan)
    for _step in range(STEPS):
        pixel = pixel_at(motion, now)
        if pixel >= 0 and error > CONVERGED:
            then = place + lag * flow_at(motion, world, pixel)
            error = wp.length(then - now)
            now = then
            depth = motion.depth[world, pixel]
    if not (error < TOLERANCE) or pixel_at(motion, now) < 0:
        depth = wp.nan
    return wp.vec3(now[0], now[1], depth)


@wp.func
def is_other_guess(flow: wp.vec2, known: wp.vec2, lag: wp.float32) -> wp.bool:
    """True if two guesses begin more than half a pixel apart."""
    return lag * lag * wp.length_sq(flow - known) > 0.25


@wp.func
def place_before(motion: Motion, world: wp.int32, row: wp.int32, column: wp.int32, lag: wp.float32) -> Place:
    """Where a pixel's surface at an earlier moment is seen: in this frame, or in the one before if it is hidden now."""
    here = wp.vec2(wp.float32(column), wp.float32(row))
    pixel = row * motion.width + column
    across = (motion.width + motion.tile - 1) // motion.tile
    own = flow_at(motion, world, pixel)
    both = motion.spread_flow[world, row // motion.tile * across + column // motion.tile]
    result = Place()
    result.pixel = here
    result.earlier = False
    if lag == 0.0 or (wp.length_sq(own) == 0.0 and wp.length_sq(both) == 0.0):
        return result
    least = wp.float32(wp.inf)
    is_found = wp.bool(False)
    longest = wp.vec2(both[0], both[1])
    nearest = wp.vec2(both[2], both[3])
    for k in range(3):
        flow = own
        is_new = wp.bool(True)
        if k == 1:
            flow = longest
            is_new = is_other_guess(flow, own, lag)
        if k == 2:
            flow = nearest
            is_new = is_other_guess(flow, own, lag) and is_other_guess(flow, longest, lag)
        if is_new:
            surface = surface_from(motion, world, here, lag, flow)
            if not wp.isnan(surface[2]) and (not is_found or surface[2] < least):
                is_found = True
                least = surface[2]
                result.pixel = wp.vec2(surface[0], surface[1])
    if is_found:
        return result
    # Hidden now, or outside of the image: behind what is here or where that was.
    flow = own
    there = pixel_at(motion, here + lag * own)
    if there >= 0:
        if motion.depth[world, there] > motion.depth[world, pixel]:
            flow = flow_at(motion, world, there)
    then = here - (1.0 - lag) * flow
    result.earlier = pixel_at(motion, then) >= 0
    result.pixel = wp.where(result.earlier, then, here + lag * flow)
    return result


@wp.func
def weight_of(depth: wp.float32, other: wp.float32, weight: wp.float32) -> wp.float32:
    """Weight of a neighbour, 0 if it shows another surface."""
    is_same = depth == other or wp.abs(depth - other) < SAME_SURFACE * wp.min(depth, other)
    return wp.where(is_same, weight, 0.0)


@wp.func
def color_at(image: wp.array2d(dtype=wp.vec3), motion: Motion, world: wp.int32, place: Place) -> wp.vec3:
    """Colour between four pixels, of those that show the surface of the nearest."""
    x = wp.clamp(place.pixel[0], 0.0, wp.float32(motion.width - 1))
    y = wp.clamp(place.pixel[1], 0.0, wp.float32(motion.height - 1))
    column = wp.int32(x)
    row = wp.int32(y)
    u = x - wp.float32(column)
    v = y - wp.float32(row)
    nearest = pixel_at(motion, wp.vec2(x, y))
    total = wp.vec3()
    weights = wp.float32(0.0)
    for i in range(2):
        for j in range(2):
            pixel = wp.min(row + i, motion.height - 1) * motion.width + wp.min(column + j, motion.width - 1)
            weight = wp.where(i == 0, 1.0 - v, v) * wp.where(j == 0, 1.0 - u, u)
            if not place.earlier:  # whose depth is not kept
                weight = weight_of(motion.depth[world, nearest], motion.depth[world, pixel], weight)
            if weight > 0.0:
                total += weight * image[world, pixel]
                weights += weight
    return total / weights


@wp.kernel(enable_backward=False)
def expose_colors(
    motion: Motion,
    exposure: Exposure,
    source: wp.array2d(dtype=wp.vec3),
    before: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Mean of a pixel's colours over its exposure."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if motion.mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(pixel, motion.width)
    line = line_lag(exposure, world, row, column, motion.width, motion.height)
    total = wp.vec3()
    for k in range(exposure.samples):
        share = (wp.float32(k) + 0.5) / wp.float32(exposure.samples)
        lag = frames_of(line + share * exposure.duration[world], motion.elapsed[world])
        place = place_before(motion, world, row, column, lag)
        if place.earlier:
            total += color_at(before, motion, world, place)
        else:
            total += color_at(source, motion, world, place)
    target[world, pixel] = total / wp.float32(exposure.samples)


@wp.kernel(enable_backward=False)
def expose_depth(
    motion: Motion,
    exposure: Exposure,
    valid: wp.array2d(dtype=wp.uint8),
    source: wp.array2d(dtype=wp.float32),
    before: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Depth that a pixel had when its line was read, between those of its surface in both frames."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if motion.mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(pixel, motion.width)
    line = line_lag(exposure, world, row, column, motion.width, motion.height)
    lag = frames_of(line, motion.elapsed[world])
    place = place_before(motion, world, row, column, lag)
    width = wp.float32(motion.width - 1)
    height = wp.float32(motion.height - 1)
    seen = pixel_at(motion, wp.vec2(wp.clamp(place.pixel[0], 0.0, width), wp.clamp(place.pixel[1], 0.0, height)))
    if place.earlier:
        target[world, pixel] = before[world, seen]
        return
    depth = source[world, seen]
    if valid[world, seen] != wp.uint8(0) and lag > 0.0:
        was = pixel_at(motion, place.pixel - flow_at(motion, world, seen))
        if was >= 0:
            between = depth + lag * (before[world, was] - depth)
            if wp.isfinite(between) and depth > 0.0 and before[world, was] > 0.0:
                depth = between
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def remember_colors(
    mask: wp.array(dtype=wp.uint8),
    source: wp.array2d(dtype=wp.vec3),
    before: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] != wp.uint8(0):
        before[world, pixel] = source[world, pixel]


@wp.kernel(enable_backward=False)
def remember_depth(
    mask: wp.array(dtype=wp.uint8),
    source: wp.array2d(dtype=wp.float32),
    before: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] != wp.uint8(0):
        before[world, pixel] = source[world, pixel]
