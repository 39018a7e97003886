"""Stages of point clouds: points that count, one of each voxel, the choice of some, and what belongs to those."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import View
from warpcam.sensors.kernels.random import Randomness, world_state

wp.set_module_options(compiler_flags())

THREADS = 256  # of a CUDA block that works on a world

# Kinds of sources: PointKind of native/sensors/pack_points.h.
GIVEN_POINTS, PINHOLE_DEPTH, ORTHOGRAPHIC_DEPTH = 0, 1, 2

# Choices among candidates.
FIRST, UNIFORM, PICKED = 0, 1, 2

ROUNDS = 12  # of the Feistel network that shuffles candidates


@wp.struct
class PointSource:
    """Images of one camera, or a user's points."""

    kind: wp.int32  # one of the kinds above
    points: wp.array3d(dtype=wp.float32)  # (world, pixel, 3) world frame [m]; of depth (world, pixel, 1) [m]
    views: wp.array(dtype=View)  # (world,) of depth
    width: wp.int32  # of the image [pixels]
    num_pixels: wp.int32
    first_pixel: wp.int32  # number of the pixels of all sources before
    valid: wp.array2d(dtype=wp.uint8)  # (world, pixel) 0 leaves a pixel out; or empty
    # (2 * filter,) addresses of ids, (world, pixel) int32, and of a table that has 1 for the ids to be left out, uint8
    filters: wp.array(dtype=wp.uint64)
    filter_sizes: wp.array(dtype=wp.int32)  # (filter,) lengths of the tables
    num_filters: wp.int32


@wp.struct
class Crop:
    """The frame that clouds are in, and the box in it beyond which points are left out."""

    positions: wp.array(dtype=wp.vec3)  # (world,) origin of the frame in the world [m]; empty: the world itself
    rotations: wp.array(dtype=wp.mat33)  # (world,) its axes are columns
    low: wp.vec3  # [m]
    high: wp.vec3


@wp.struct
class Candidates:
    """Points of each world that count, in the order of their pixels."""

    mask: wp.array(dtype=wp.uint8)  # (world,) worlds with 0 are left alone
    counts: wp.array(dtype=wp.int32)  # (world,)
    points: wp.array3d(dtype=wp.float32)  # (world, axis, candidate) [m]
    pixels: wp.array2d(dtype=wp.int32)  # (world, candidate) over all sources
    # (world, candidate) entry in the hash table of voxels, then distance, a float; empty where neither is asked for
    work: wp.array2d(dtype=wp.int32)


@wp.struct
class Choice:
    """How points are chosen among the candidates of a world."""

    kind: wp.int32  # FIRST, UNIFORM or PICKED
    repeats: wp.int32  # 1: points fill the rest again, 0: zeros do
    picks: wp.array2d(dtype=wp.int32)  # (world, point) of PICKED, in worlds with more candidates than points
    randomness: Randomness  # of UNIFORM; its frames are reads


@wp.struct
class CloudPoints:
    """Clouds as they are written."""

    counts: wp.array(dtype=wp.int32)  # (world,)
    points: wp.array2d(dtype=wp.vec3)  # (world, point) [m]
    pixels: wp.array2d(dtype=wp.int32)  # (world, point) -1 in the rest that is filled with zeros


pack_points = make_kernel(
    "pack_points",
    "warpcam::pack_points(source, crop, candidates, index);",
    {"source": PointSource, "crop": Crop, "candidates": Candidates},
    native_module("sensors/pack_points.h", THREADS),
    (THREADS, 8),
)
thin_to_voxels = make_kernel(
    "thin_to_voxels",
    "warpcam::thin_to_voxels(candidates, size, table, index);",
    {"candidates": Candidates, "size": wp.float32, "table": wp.array2d(dtype=wp.int32)},
    native_module("sensors/voxel_points.h", THREADS),
    (THREADS, 5),
)
pick_farthest = make_kernel(
    "pick_farthest",
    "warpcam::pick_farthest(candidates, picks, index);",
    {"candidates": Candidates, "picks": wp.array2d(dtype=wp.int32)},
    native_module("sensors/farthest_points.h", THREADS),
    (THREADS, 4),
)


@wp.kernel(enable_backward=False)
def write_body_frames(
    mask: wp.array(dtype=wp.uint8),
    positions: wp.array2d(dtype=wp.vec3),
    rotations: wp.array2d(dtype=wp.mat33),
    column: wp.int32,
    crop: Crop,
    first: wp.int32,
):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        crop.positions[world] = positions[world, column]
        crop.rotations[world] = rotations[world, column]


@wp.kernel(enable_backward=False)
def write_view_frames(mask: wp.array(dtype=wp.uint8), views: wp.array(dtype=View), crop: Crop, first: wp.int32):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        crop.positions[world] = views[world].origin
        crop.rotations[world] = views[world].rotation


@wp.func
def shuffled(place: wp.int32, count: wp.int32, key: wp.int32) -> wp.int32:
    """Return where a random permutation of ``count`` numbers takes ``place``.

    A Feistel network permutes the numbers of an even number of bits; those that leave the range go through it again
    (Black and Rogaway, "Ciphers with Arbitrary Finite Domains", 2002).
    """
    bits = wp.int32(1)
    while (1 << (2 * bits)) < count:
        bits += 1
    lower = (1 << bits) - 1
    at = place
    outside = wp.bool(True)
    while outside:
        left = at >> bits
        right = at & lower
        for turn in range(wp.static(ROUNDS)):
            mixed = wp.rand_init(wp.int32(wp.rand_init(key, turn)), right)
            swapped = right
            right = left ^ (wp.int32(mixed >> wp.uint32(8)) & lower)
            left = swapped
        at = (left << bits) | right
        outside = at >= count
    return at


@wp.kernel(enable_backward=False)
def write_points(candidates: Candidates, choice: Choice, out: CloudPoints, first: wp.int32):
    world, point = row_and_column(first + wp.tid(), out.points.shape[1])
    if candidates.mask[world] == wp.uint8(0):
        return
    found = candidates.counts[world]
    count = wp.min(found, out.points.shape[1])
    if point == 0:
        out.counts[world] = count
    candidate = point
    if point >= count:
        candidate = -1
        if choice.repeats != 0 and count > 0:
            candidate = point % count
    elif found > count:
        if choice.kind == wp.static(UNIFORM):
            key = world_state(choice.randomness, world, choice.randomness.frames[world])
            candidate = shuffled(point, found, key)
        elif choice.kind == wp.static(PICKED):
            candidate = choice.picks[world, point]
    pixel = wp.int32(-1)
    place = wp.vec3(0.0, 0.0, 0.0)
    if candidate >= 0:
        pixel = candidates.pixels[world, candidate]
        place = wp.vec3(
            candidates.points[world, 0, candidate],
            candidates.points[world, 1, candidate],
            candidates.points[world, 2, candidate],
        )
    out.pixels[world, point] = pixel
    out.points[world, point] = place


@wp.kernel(enable_backward=False)
def count_reads(mask: wp.array(dtype=wp.uint8), reads: wp.array(dtype=wp.int32), first: wp.int32):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        reads[world] += 1


@wp.kernel(enable_backward=False)
def forget_reads(mask: wp.array(dtype=wp.uint8), reads: wp.array(dtype=wp.int32), first: wp.int32):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        reads[world] = 0


@wp.func
def source_pixel(mask: wp.array(dtype=wp.uint8), pixel: wp.int32, world: wp.int32, begin: wp.int32, count: wp.int32):
    """Pixel of a point in the images of one source; -1 for a rest of zeros, which the first source writes, -2: none."""
    if mask[world] == wp.uint8(0):
        return -2
    if pixel < 0:
        return wp.where(begin == 0, -1, -2)
    if pixel < begin or pixel >= begin + count:
        return -2
    return pixel - begin


def _gather_kernel(dtype: Any) -> wp.Kernel:
    @wp.kernel(module="unique", enable_backward=False, module_options=compiler_flags())
    def gather(
        mask: wp.array(dtype=wp.uint8),
        pixels: wp.array2d(dtype=wp.int32),
        image: wp.array3d(dtype=dtype),
        begin: wp.int32,
        rest: dtype,
        out: wp.array3d(dtype=dtype),
        first: wp.int32,
    ):
        """Copy what belongs to the points of one source: image (world, pixel, channel) to (world, point, channel)."""
        world, point = row_and_column(first + wp.tid(), pixels.shape[1])
        pixel = source_pixel(mask, pixels[world, point], world, begin, image.shape[1])
        if pixel == -2:
            return
        for channel in range(image.shape[2]):
            value = rest
            if pixel >= 0:
                value = image[world, pixel, channel]
            out[world, point, channel] = value

    return gather


_GATHER = {dtype: _gather_kernel(dtype) for dtype in (wp.uint8, wp.int32, wp.float32)}


@wp.kernel(enable_backward=False)
def turn_directions(mask: wp.array(dtype=wp.uint8), crop: Crop, directions: wp.array2d(dtype=wp.vec3), first: wp.int32):
    """Directions in the world frame to the frame of the clouds."""
    world, point = row_and_column(first + wp.tid(), directions.shape[1])
    if mask[world] != wp.uint8(0):
        directions[world, point] = wp.transpose(crop.rotations[world]) * directions[world, point]


def bind_body_frames(
    mask: wp.array, body: int, poses: tuple[wp.array, wp.array], crop: Any, device: wp.Device
) -> Stage:
    """Bind the stage that writes a body's pose to ``crop``; ``poses`` are (world, body) vec3 and mat33."""
    return bind_launch(write_body_frames, mask.shape[0], [mask, *poses, body, crop], device)


def bind_view_frames(mask: wp.array, views: wp.array, crop: Any, device: wp.Device) -> Stage:
    """Bind the stage that writes a camera's pose to ``crop``."""
    return bind_launch(write_view_frames, mask.shape[0], [mask, views, crop], device)


def bind_pack(source: Any, crop: Any, candidates: Any, device: wp.Device) -> Stage:
    """Bind the stage that writes the candidates of one source; sources are packed one after another."""
    return _bind_blocks(pack_points, [source, crop, candidates], candidates, device)


def bind_voxels(candidates: Any, size: float, table: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that leaves one candidate of each voxel, the first.

    Args:
        candidates: Of ``Candidates``.
        size: Edge of a voxel [m].
        table: int32 (world, entry): for ``table_size`` entries.
        device: Where all of these lie.
    """
    return _bind_blocks(thin_to_voxels, [candidates, size, table], candidates, device)


def table_size(capacity: int) -> int:
    """Entries of a world's hash table of voxels: a power of two, at least twice as many as candidates."""
    return max(2 ** (2 * capacity - 1).bit_length(), THREADS)


def bind_farthest(candidates: Any, picks: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that picks candidates by farthest point sampling; ``picks`` is int32 (world, point)."""
    return _bind_blocks(pick_farthest, [candidates, picks], candidates, device)


def bind_choice(candidates: Any, choice: Any, out: Any, device: wp.Device) -> list[Stage]:
    """Bind the stages that write the chosen points."""
    stages = [bind_launch(write_points, out.points.size, [candidates, choice, out], device)]
    if choice.kind == UNIFORM:
        stages.append(bind_launch(count_reads, out.counts.size, [candidates.mask, choice.randomness.frames], device))
    return stages


def bind_reset(mask: wp.array, reads: wp.array, device: wp.Device) -> Stage:
    """Bind the stage after which random choices begin anew."""
    return bind_launch(forget_reads, reads.size, [mask, reads], device)


def bind_gather(
    mask: wp.array, pixels: wp.array, image: wp.array, begin: int, rest: Any, out: wp.array, device: wp.Device
) -> Stage:
    """Bind the stage that copies an attribute of the points of one source.

    Args:
        mask: uint8 (world,).
        pixels: int32 (world, point), over all sources.
        image: (world, pixel, channel) of uint8, int32 or float32.
        begin: Number of the pixels of all sources before.
        rest: What a rest of zeros has instead.
        out: (world, point, channel) of the same dtype; written.
        device: Where all of these lie.
    """
    return bind_launch(_GATHER[image.dtype], pixels.size, [mask, pixels, image, begin, rest, out], device)


def bind_turn(mask: wp.array, crop: Any, directions: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that turns directions (world, point) vec3 of the world frame into the frame of the clouds."""
    return bind_launch(turn_directions, directions.size, [mask, crop, directions], device)


def _bind_blocks(kernel: wp.Kernel, inputs: list[Any], candidates: Any, device: wp.Device) -> Stage:
    """Bind a stage that has a block for each world on CUDA, and a thread on a CPU."""
    threads = THREADS if device.is_cuda else 1
    return bind_launch(kernel, threads * candidates.counts.size, inputs, device, block_dim=THREADS)
