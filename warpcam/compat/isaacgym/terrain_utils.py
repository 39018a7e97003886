"""Isaac Gym's ``terrain_utils``: pieces of rough ground as samples of heights, and triangles of them.

Each function changes a ``SubTerrain`` and returns it; what is random is numpy's. x goes with the first index of the
samples, over ``width``, and y with the second, over ``length``.
"""
# ruff: noqa: NPY002, programs seed numpy's own

import numpy as np

from warpcam.core.errors import WarpcamError

# With numpy, which programs that import all of it count on.
__all__ = [
    "SubTerrain",
    "convert_heightfield_to_trimesh",
    "discrete_obstacles_terrain",
    "np",
    "pyramid_sloped_terrain",
    "pyramid_stairs_terrain",
    "random_uniform_terrain",
    "sloped_terrain",
    "stairs_terrain",
    "stepping_stones_terrain",
    "wave_terrain",
]  # fmt: skip


class SubTerrain:
    """A piece of ground.

    Attributes:
        terrain_name: Held.
        width: How many samples there are along x.
        length: How many there are along y.
        vertical_scale: What a height of 1 is [m].
        horizontal_scale: From one sample to the next [m].
        height_field_raw: (width, length) int16.
    """

    def __init__(
        self,
        terrain_name: str = "terrain",
        width: int = 256,
        length: int = 256,
        vertical_scale: float = 1.0,
        horizontal_scale: float = 1.0,
    ):
        self.terrain_name, self.width, self.length = terrain_name, width, length
        self.vertical_scale, self.horizontal_scale = vertical_scale, horizontal_scale
        self.height_field_raw = np.zeros((width, length), np.int16)

    def units(self, height: float) -> int:
        """A height [m], in whole units."""
        return int(height / self.vertical_scale)

    def steps(self, distance: float) -> int:
        """A distance [m], in whole steps from sample to sample."""
        return int(distance / self.horizontal_scale)

    def stride(self, distance: float, name: str) -> int:
        """Return the stride of what is to be repeated."""
        if self.steps(distance) < 1:
            raise WarpcamError(
                f"{name} must be at least the {self.horizontal_scale} m from one sample to the next, got {distance}"
            )
        return self.steps(distance)

    def middle(self, size: int) -> tuple[slice, slice]:
        """A square of samples."""
        first = (self.width - size) // 2, (self.length - size) // 2
        last = (self.width + size) // 2, (self.length + size) // 2
        return slice(first[0], last[0]), slice(first[1], last[1])


def random_uniform_terrain(
    terrain: SubTerrain,
    min_height: float,
    max_height: float,
    step: float = 1,
    downsampled_scale: float | None = None,
) -> SubTerrain:
    """Add heights at random.

    Args:
        terrain: To be changed.
        min_height: The least [m].
        max_height: The most [m].
        step: From one height that may be to the next [m].
        downsampled_scale: From one random height to the next along x and y [m], with straight lines between them;
            None is each sample.
    """
    coarse = terrain.horizontal_scale if downsampled_scale is None else downsampled_scale
    least, most, rise = terrain.units(min_height), terrain.units(max_height), terrain.units(step)
    if rise < 1:
        raise WarpcamError(f"step must be at least vertical_scale, {terrain.vertical_scale} m, got {step}")
    sizes = [max(int(count * terrain.horizontal_scale / coarse), 2) for count in (terrain.width, terrain.length)]
    heights = np.random.choice(np.arange(least, most + rise, rise), sizes).astype(np.float64)
    for axis, count in enumerate((terrain.width, terrain.length)):
        heights = _stretched(heights, axis, count)
    terrain.height_field_raw += np.rint(heights).astype(np.int16)
    return terrain


def sloped_terrain(terrain: SubTerrain, slope: float = 1) -> SubTerrain:
    """Add a slope that rises along x."""
    top = int(slope * (terrain.horizontal_scale / terrain.vertical_scale) * terrain.width)
    rise = top * np.arange(terrain.width) / terrain.width
    terrain.height_field_raw += rise[:, None].astype(np.int16)
    return terrain


def pyramid_sloped_terrain(terrain: SubTerrain, slope: float = 1, platform_size: float = 1.0) -> SubTerrain:
    """Add a hill, or with a negative slope a hole, with a level square in the middle.

    Args:
        terrain: To be changed.
        slope: Of its sides.
        platform_size: Of the square [m].
    """
    shares = []
    for count in (terrain.width, terrain.length):
        half = count // 2
        shares.append((half - np.abs(half - np.arange(count))) / half)
    top = int(slope * (terrain.horizontal_scale / terrain.vertical_scale) * (terrain.width / 2))
    terrain.height_field_raw += (top * np.outer(*shares)).astype(np.int16)

    half = int(platform_size / terrain.horizontal_scale / 2)
    level = int(terrain.height_field_raw[terrain.width // 2 - half, terrain.length // 2 - half])
    terrain.height_field_raw = np.clip(terrain.height_field_raw, min(level, 0), max(level, 0))
    return terrain


def discrete_obstacles_terrain(
    terrain: SubTerrain,
    max_height: float,
    min_size: float,
    max_size: float,
    num_rects: int,
    platform_size: float = 1.0,
) -> SubTerrain:
    """Set rectangles at random, as high or as deep as ``max_height`` or half of it.

    Args:
        terrain: To be changed.
        max_height: [m].
        min_size: Of a side [m].
        max_size: Of a side, which is less [m].
        num_rects: How many.
        platform_size: Of a square in the middle that is level [m].
    """
    high = terrain.units(max_height)
    heights = (-high, -high // 2, high // 2, high)
    sides = range(terrain.steps(min_size), terrain.steps(max_size), 4)
    if not sides or sides[-1] >= min(terrain.width, terrain.length):
        raise WarpcamError(
            f"min_size must be less than max_size and both than the terrain, got {min_size} and {max_size}"
        )
    for _ in range(num_rects):
        across, along = np.random.choice(sides), np.random.choice(sides)
        x = np.random.choice(range(0, terrain.width - across, 4))
        y = np.random.choice(range(0, terrain.length - along, 4))
        terrain.height_field_raw[x : x + across, y : y + along] = np.random.choice(heights)
    terrain.height_field_raw[terrain.middle(terrain.steps(platform_size))] = 0
    return terrain


def wave_terrain(terrain: SubTerrain, num_waves: float = 1, amplitude: float = 1.0) -> SubTerrain:
    """Add waves along x and along y.

    Args:
        terrain: To be changed.
        num_waves: Over the terrain's length; none if it is 0.
        amplitude: From trough to crest [m].
    """
    if num_waves > 0:
        high = int(0.5 * amplitude / terrain.vertical_scale)
        turn = num_waves * 2.0 * np.pi / terrain.length
        along_x, along_y = np.sin(turn * np.arange(terrain.width)), np.cos(turn * np.arange(terrain.length))
        terrain.height_field_raw += (high * (along_x[:, None] + along_y[None])).astype(np.int16)
    return terrain


def stairs_terrain(terrain: SubTerrain, step_width: float, step_height: float) -> SubTerrain:
    """Add stairs that rise along x, by ``step_height`` each ``step_width`` [m]."""
    wide, high = terrain.stride(step_width, "step_width"), terrain.units(step_height)
    for step in range(terrain.width // wide):
        terrain.height_field_raw[step * wide : (step + 1) * wide] += (step + 1) * high
    return terrain


def pyramid_stairs_terrain(
    terrain: SubTerrain, step_width: float, step_height: float, platform_size: float = 1.0
) -> SubTerrain:
    """Set stairs that rise, or with a negative height fall, from all sides to a square in the middle.

    Args:
        terrain: To be changed.
        step_width: [m].
        step_height: [m].
        platform_size: Of the square, at least [m].
    """
    wide, high = terrain.stride(step_width, "step_width"), terrain.units(step_height)
    least = terrain.steps(platform_size)
    step = 0
    while min(terrain.width, terrain.length) - 2 * step * wide > least:
        step += 1
        inner = slice(step * wide, max(terrain.width - step * wide, 0))
        terrain.height_field_raw[inner, step * wide : max(terrain.length - step * wide, 0)] = step * high
    return terrain


def stepping_stones_terrain(
    terrain: SubTerrain,
    stone_size: float,
    stone_distance: float,
    max_height: float,
    platform_size: float = 1.0,
    depth: float = -10,
) -> SubTerrain:
    """Set stones in rows, which begin at random, over a deep hole.

    Args:
        terrain: To be changed.
        stone_size: Of a side [m].
        stone_distance: From one to the next [m].
        max_height: Stones are as high or as deep, at most [m].
        platform_size: Of a square in the middle that is level [m].
        depth: Of the hole [m].
    """
    size, gap = terrain.stride(stone_size, "stone_size"), terrain.steps(stone_distance)
    high = terrain.units(max_height)
    heights = np.arange(-high - 1, high)
    field = terrain.height_field_raw
    field[:] = terrain.units(depth)
    # Rows of stones lie along the shorter side.
    rows = field.T if terrain.length >= terrain.width else field
    for begin in range(0, len(rows), size + gap):
        row = rows[begin : begin + size]
        place = np.random.randint(0, size)
        row[:, : max(place - gap, 0)] = np.random.choice(heights)
        for stone in range(place, rows.shape[1], size + gap):
            row[:, stone : stone + size] = np.random.choice(heights)
    field[terrain.middle(terrain.steps(platform_size))] = 0
    return terrain


def convert_heightfield_to_trimesh(
    height_field_raw: np.ndarray, horizontal_scale: float, vertical_scale: float, slope_threshold: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Two triangles between each four samples.

    Args:
        height_field_raw: (x, y).
        horizontal_scale: From one sample to the next [m].
        vertical_scale: What a height of 1 is [m].
        slope_threshold: Steeper slopes are made upright: the lower sample is moved below the higher one. None moves
            none.

    Returns:
        Vertices (x y, 3) float32 [m], the first at the origin, and triangles (n, 3) uint32.
    """
    heights = np.asarray(height_field_raw)
    count_x, count_y = heights.shape
    moves = np.zeros((2, count_x, count_y))
    if slope_threshold is not None:
        limit = slope_threshold * horizontal_scale / vertical_scale
        tall = heights.astype(np.int64) if heights.dtype.kind in "iu" else heights
        for axis, move in enumerate(moves):
            rise = np.diff(tall, axis=axis)
            _shift(move, (axis,), rise > limit, rise < -limit)
        rise = tall[1:, 1:] - tall[:-1, :-1]
        corners = np.zeros((count_x, count_y))
        _shift(corners, (0, 1), rise > limit, rise < -limit)
        moves += corners * (moves == 0.0)

    places = np.stack(np.meshgrid(np.arange(count_x), np.arange(count_y), indexing="ij")) + moves
    vertices = np.stack([*(places * horizontal_scale), heights * vertical_scale], axis=-1)
    first = np.arange(count_x * count_y, dtype=np.uint32).reshape(count_x, count_y)
    a, b, c, d = first[:-1, :-1], first[:-1, 1:], first[1:, :-1], first[1:, 1:]
    triangles = np.stack([a, d, b, a, c, d], axis=-1)
    return vertices.reshape(-1, 3).astype(np.float32), triangles.reshape(-1, 3)


def _shift(move: np.ndarray, axes: tuple[int, ...], up: np.ndarray, down: np.ndarray) -> None:
    """Move the lower of two samples towards the higher: forward where heights go up along the axes, else back."""
    before = tuple(slice(None, -1) if axis in axes else slice(None) for axis in range(2))
    after = tuple(slice(1, None) if axis in axes else slice(None) for axis in range(2))
    move[before] += up
    move[after] -= down


def _stretched(heights: np.ndarray, axis: int, count: int) -> np.ndarray:
    """Resample heights along an axis by linear interpolation."""
    places = np.linspace(0.0, heights.shape[axis] - 1.0, count)
    low = np.minimum(places.astype(np.int64), heights.shape[axis] - 2)
    share = np.expand_dims(places - low, 1 - axis)
    return (1.0 - share) * heights.take(low, axis) + share * heights.take(low + 1, axis)
