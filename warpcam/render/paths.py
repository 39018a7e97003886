"""Options of the path tracer, and what a camera keeps of its paths from frame to frame."""

import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.core.seeds import seeds_of
from warpcam.kernels.build.facet_albedo import facet_albedo
from warpcam.kernels.passes.paths import HEAD, SHAPE_ROWS, PathArrays, PathFrame
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import MESH
from warpcam.render.path_sky import sky_sums

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


def _num_shapes(tables: SceneTables) -> int:
    """Shapes that a world's list has room for: those that the camera sees, and those that cast shadows."""
    casters = 0 if tables.casters is None else tables.casters.drawn.size
    return max(tables.num_drawn, casters, 1)


class _EmittingFaces(NamedTuple):
    """Faces of all meshes, each once, and how often they are drawn as lights: arrays of PathFrame."""

    starts: np.ndarray
    faces: np.ndarray
    sums: np.ndarray
    shares: np.ndarray


def _emitting_faces(tables: SceneTables) -> _EmittingFaces:
    """Faces of all meshes if some material shines, drawn as often as they are large when the scene is loaded."""
    meshes = tables.meshes
    emissions = (tables.physical.emissive, tables.materials.emission)
    if MESH not in tables.shape_types or not any(array.size and array.numpy().any() for array in emissions):
        none, no_shares = np.zeros(0, np.int32), np.zeros(0, np.float32)
        return _EmittingFaces(none, none, no_shares, no_shares)
    corners = meshes.faces.numpy().reshape(-1, 3, 4)
    numbers = corners[:, 0, 3].view(np.int32)
    rows, sums, shares = [], [], []
    for start, end in itertools.pairwise([*(meshes.face_start.numpy() // 3).tolist(), len(corners)]):
        _, first, again = np.unique(numbers[start:end], return_index=True, return_inverse=True)
        rows.append(first)
        sums.append(_sums_of_areas(corners[start:end][first, :, :3].astype(np.float64)))
        shares.append(np.diff(sums[-1])[again])
    starts = np.cumsum([0, *map(len, rows)]).astype(np.int32)
    return _EmittingFaces(starts, np.concatenate(rows).astype(np.int32), np.concatenate(sums), np.concatenate(shares))


def _sums_of_areas(corners: np.ndarray) -> np.ndarray:
    """Sums of the shares of triangles, (triangle, 3, 3), in their area, from 0 to 1; alike if they have none."""
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if not 0.0 < areas.sum() < np.inf:
        areas = np.ones(len(areas))
    sums = np.cumsum([0.0, *areas])
    return (sums / (sums[-1] or 1.0)).astype(np.float32)


def list_bytes(tables: SceneTables) -> int:
    """Bytes of the lists that rays in any direction need of all worlds."""
    shapes = _num_shapes(tables)
    vectors, numbers = SHAPE_ROWS * shapes, HEAD + tables.num_lights + shapes + 2
    each = vectors * wp.types.type_size_in_bytes(wp.vec4) + numbers * wp.types.type_size_in_bytes(wp.int32)
    return tables.num_worlds * each + sum(rows.nbytes for rows in _emitting_faces(tables))


def path_bytes(tables: SceneTables, pixels: int) -> int:
    """Bytes of what a camera of so many pixels keeps of its paths in all worlds."""
    each = pixels * wp.types.type_size_in_bytes(wp.vec4) + wp.types.type_size_in_bytes(wp.int32)
    shared = (facet_albedo(), sky_sums(tables)[0])
    return list_bytes(tables) + tables.num_worlds * each + sum(table.nbytes for table in shared)


def make_lists(tables: SceneTables, device: wp.Device) -> PathArrays:
    """Allocate the lists of shapes and lights alone, for rays of the real-time look."""
    frame = _lists(tables, device)
    return PathArrays(frame, 0, wp.empty(0, dtype=wp.int32, device=device))


def _lists(tables: SceneTables, device: wp.Device) -> Any:
    worlds = tables.num_worlds
    frame: Any = PathFrame()
    frame.rows = wp.zeros((worlds, SHAPE_ROWS * _num_shapes(tables)), dtype=wp.vec4, device=device)
    frame.heads = wp.zeros((worlds, HEAD + tables.num_lights + _num_shapes(tables)), dtype=wp.int32, device=device)
    emitting = _emitting_faces(tables)
    frame.face_starts, frame.faces, frame.face_sums, frame.face_shares = (
        wp.array(rows, device=device) for rows in emitting
    )
    frame.begun, frame.wanted = (wp.zeros(worlds, dtype=wp.int32, device=device) for _ in range(2))
    return frame


def make_paths(tables: SceneTables, pixels: int, options: PathOptions, more: wp.array, device: wp.Device) -> PathArrays:
    """Allocate what a camera of so many pixels keeps of its paths.

    Args:
        tables: The scene.
        pixels: Of an image.
        options: How paths are traced.
        more: int32, (1,): paths that ``accumulate`` adds.
        device: Where it lies.
    """
    worlds, frame = tables.num_worlds, _lists(tables, device)
    frame.most_bounces = MOST if options.bounces is None else options.bounces
    frame.albedo = wp.array(facet_albedo().ravel(), dtype=wp.float32, device=device)
    sums, frame.sky_side = sky_sums(tables)
    frame.sky_sums = wp.array(sums, dtype=wp.float32, device=device)
    frame.seeds = seeds_of(options.seed, "PathOptions", worlds, device)
    frame.sums = wp.zeros(worlds * pixels, dtype=wp.vec4, device=device)
    return PathArrays(frame, int(options.samples), more)
