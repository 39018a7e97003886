"""Options of the path tracer, and what a camera keeps of its paths from frame to frame."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.core.seeds import seeds_of
from warpcam.kernels.build.facet_albedo import facet_albedo
from warpcam.kernels.passes.paths import HEAD, SHAPE_ROWS, PathArrays, PathFrame
from warpcam.kernels.scene_tables import SceneTables

MOST = 2**30  # of samples and bounces


@dataclass(frozen=True, kw_only=True, eq=False)
class PathOptions:
    """How ``Renderer(look="path")`` traces paths of light.

    Attributes:
        samples: Paths of each pixel in a frame, at least 1; ``Renderer.accumulate`` adds more.
        bounces: Surfaces that reflect a path at most: 0 shows what shines by itself, 1 light that comes straight from
            lights, too. None is no limit: paths end by chance, so that the mean is that of endless ones.
        seed: A whole number of 32 bits, or one for each world, (world,). The same seed gives the same numbers to a
            world, so the same image.
    """

    samples: int = 64
    bounces: int | None = None
    seed: Any = 0

    def __post_init__(self) -> None:
        check_whole("PathOptions: samples", self.samples, 1)
        if self.bounces is not None:
            check_whole("PathOptions: bounces", self.bounces, 0)


def check_whole(what: str, value: Any, least: int) -> int:
    """The whole number that came, or the error that it is none or too small."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= MOST:
        raise WarpcamError(f"{what} must be a whole number from {least} to {MOST}, got {value!r}")
    return int(value)


def _shape_rows(tables: SceneTables) -> int:
    """Rows of a world's list of shapes: those that the camera sees, and those that cast shadows."""
    casters = 0 if tables.casters is None else tables.casters.drawn.size
    return SHAPE_ROWS * max(tables.num_drawn, casters, 1)


def path_bytes(tables: SceneTables, pixels: int) -> int:
    """Bytes of what a camera of so many pixels keeps of its paths in all worlds."""
    vectors, numbers = _shape_rows(tables) + pixels, HEAD + tables.num_lights + 3
    each = vectors * wp.types.type_size_in_bytes(wp.vec4) + numbers * wp.types.type_size_in_bytes(wp.int32)
    return tables.num_worlds * each + facet_albedo().nbytes


def make_paths(tables: SceneTables, pixels: int, options: PathOptions, more: wp.array, device: wp.Device) -> PathArrays:
    """Allocate what a camera of so many pixels keeps of its paths.

    Args:
        tables: The scene.
        pixels: Of an image.
        options: How paths are traced.
        more: int32, (1,): paths that ``accumulate`` adds.
        device: Where it lies.
    """
    worlds = tables.num_worlds
    frame: Any = PathFrame()
    frame.most_bounces = MOST if options.bounces is None else options.bounces
    frame.albedo = wp.array(facet_albedo().ravel(), dtype=wp.float32, device=device)
    frame.rows = wp.zeros((worlds, _shape_rows(tables)), dtype=wp.vec4, device=device)
    frame.heads = wp.zeros((worlds, HEAD + tables.num_lights), dtype=wp.int32, device=device)
    frame.seeds = seeds_of(options.seed, "PathOptions", worlds, device)
    frame.begun, frame.wanted = (wp.zeros(worlds, dtype=wp.int32, device=device) for _ in range(2))
    frame.sums = wp.zeros(worlds * pixels, dtype=wp.vec4, device=device)
    return PathArrays(frame, int(options.samples), more)
