"""Terrains: what programs describe by triangles or by heights, as Newton's shapes."""

from dataclasses import dataclass
from typing import Any

import newton
import numpy as np
import warp as wp

from warpcam.compat.common.scalars import real, whole
from warpcam.compat.isaacgym.api.math_types import Transform, Vec3
from warpcam.compat.isaacgym.api.params import HeightFieldParams, PlaneParams, TriangleMeshParams
from warpcam.compat.isaacgym.terrain.heightfield_from_mesh import heights_of, is_convex, seen_from_above
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError


@dataclass(frozen=True)
class TerrainShape:
    """What a terrain is made of.

    Attributes:
        source: Newton's.
        local: Where that is in the terrain's frame.
    """

    source: newton.Mesh | newton.Heightfield
    local: Transform


@dataclass(frozen=True)
class Terrain:
    """A shape that stands in no environment.

    Attributes:
        seen: What is drawn.
        felt: What is collided with.
        params: As the program gave them.
        told: How what is collided with is another surface than what is drawn, or nothing.
    """

    seen: TerrainShape
    felt: TerrainShape
    params: TriangleMeshParams | HeightFieldParams
    told: str = ""

    def add(self, builder: newton.ModelBuilder, origin: Vec3, color: tuple[float, float, float], drawn: bool) -> None:
        """Put it into a world whose frame has its origin there, one that is drawn or one that is simulated."""
        solid = self.seen if drawn else self.felt
        place = Transform(self.params.transform.p - origin, self.params.transform.r) * solid.local
        common = {"xform": wp.transform(*place.numbers()), "cfg": surface_of(self.params), "color": color}
        if isinstance(solid.source, newton.Heightfield):
            builder.add_shape_heightfield(heightfield=solid.source, label="terrain", **common)
        else:
            builder.add_shape_mesh(-1, mesh=solid.source, label="terrain", **common)


def surface_of(params: PlaneParams | TriangleMeshParams | HeightFieldParams) -> newton.ModelBuilder.ShapeConfig:
    return newton.ModelBuilder.ShapeConfig(mu=float(params.dynamic_friction), restitution=float(params.restitution))


def of_triangles(vertices: Any, triangles: Any, params: TriangleMeshParams, upright: bool) -> Terrain:
    """Drawn as they are; where z is up, they are collided with as heights, but for what is convex.

    MuJoCo knows no triangles, but their convex hull.
    """
    points = np.asarray(vertices, np.float32)
    if points.size % 3 or not np.isfinite(points).all():
        raise WarpcamError(f"add_triangle_mesh: vertices must be three finite numbers each, got shape {points.shape}")
    points = points.reshape(-1, 3)
    corners = np.asarray(triangles).astype(np.int64).reshape(-1)
    if corners.size == 0 or corners.min() < 0 or corners.max() >= len(points) or corners.size % 3:
        raise WarpcamError(f"add_triangle_mesh: triangles must be three of 0 to {len(points) - 1} each")
    mesh = TerrainShape(newton.Mesh(points, corners.astype(np.int32), compute_inertia=False), Transform())
    faces = corners.reshape(-1, 3)
    grid = heights_of(points, faces) if upright else None
    if grid is not None:
        return Terrain(mesh, _field(*grid), params)
    if is_convex(points, faces):
        return Terrain(mesh, mesh, params)
    if not upright or not np.ptp(points[:, :2], axis=0).all():
        reason = "the triangles are all upright" if upright else "z is not up"
        return Terrain(mesh, mesh, params, f"{reason}, so that MuJoCo collides with the convex hull")
    heights, first, steps = seen_from_above(points, faces)
    told = (
        "the vertices are no grid along x and y, so that MuJoCo collides with heights as they are seen from above, "
        f"{steps[0]:.3g} by {steps[1]:.3g} m apart"
    )
    return Terrain(mesh, _field(heights, first, steps), params, told)


def of_heights(samples: Any, params: HeightFieldParams) -> Terrain:
    where = "add_heightfield"
    counts = {name: whole(getattr(params, name)) for name in ("nbColumns", "nbRows")}
    for name, count in counts.items():
        if count is None or count < 2:
            raise WarpcamError(f"{where}: {name} must be a whole number, at least 2, got {getattr(params, name)!r}")
    scales = {name: real(getattr(params, name)) for name in ("column_scale", "row_scale", "vertical_scale")}
    for name, scale in scales.items():
        if not 0.0 < scale < np.inf:
            raise WarpcamError(f"{where}: {name} must be positive and finite, got {getattr(params, name)!r}")
    shape, steps = tuple(counts.values()), (scales["column_scale"], scales["row_scale"])
    grid = _grid(torch_interop.to_numpy(samples), shape, where)
    if grid.shape != shape:
        steps = steps[::-1]
    heights = grid.astype(np.float32) * np.float32(scales["vertical_scale"])
    field = _field(heights, np.zeros(2), np.array(steps))
    return Terrain(field, field, params)


def _field(heights: np.ndarray, first: np.ndarray, steps: np.ndarray) -> TerrainShape:
    """Of heights by x and y, the first of which is there [m]."""
    count_x, count_y = heights.shape
    half = 0.5 * steps * (count_x - 1, count_y - 1)
    # Newton's rows are along y, and its frame is in the middle.
    source = newton.Heightfield(heights.T, count_y, count_x, hx=float(half[0]), hy=float(half[1]))
    middle = first + half
    return TerrainShape(source, Transform(Vec3(middle[0], middle[1], 0.0)))


def _grid(samples: np.ndarray, shape: tuple[Any, ...], where: str) -> np.ndarray:
    """Along x and along y, as they follow one another in memory."""
    if samples.dtype.kind not in "iu":
        raise WarpcamError(f"{where}: samples must be whole numbers, int16, got {samples.dtype}")
    if samples.ndim == 2:
        grid = samples.T if samples.flags.f_contiguous and not samples.flags.c_contiguous else samples
        if grid.shape in (shape, shape[::-1]):
            return grid
    elif samples.ndim == 1 and samples.size == shape[0] * shape[1]:
        return samples.reshape(shape)
    raise WarpcamError(
        f"{where}: {shape[0]} columns of {shape[1]} rows are needed, as nbColumns and nbRows say, got samples of shape "
        f"{samples.shape}"
    )
