"""Points and curves of a stage: balls and round tubes, cut into triangles."""

from collections.abc import Sequence

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from warpcam.core.color import linear_to_srgb
from warpcam.core.errors import WarpcamError
from warpcam.sources.common.geometry import MeshGeometry, unit
from warpcam.sources.common.images import corner_colors
from warpcam.sources.common.scene_graph import ShapeInstance
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.attributes import AttributeReader
from warpcam.sources.usd.material import MaterialReader

POINT_PRIMS = ("Points", "BasisCurves")
MOST_FACES = 2**20  # of one prim; more are cut more coarsely
DETAIL = (3, 2, 1, 0)  # how often an icosahedron's faces are quartered for a ball
COARSE = ((12, 8), (8, 4), (6, 2), (4, 1), (3, 1))  # sides of a tube, rings for each segment of a cubic curve
# Rows are powers of t, t^3 first; columns control points.
BASES = {
    "bezier": np.array(((-1, 3, -3, 1), (3, -6, 3, 0), (-3, 3, 0, 0), (1, 0, 0, 0)), np.float64),
    "bspline": np.array(((-1, 3, -3, 1), (3, -6, 3, 0), (-3, 0, 3, 0), (1, 4, 1, 0)), np.float64) / 6.0,
    "catmullRom": np.array(((-1, 3, -3, 1), (2, -5, 4, -1), (-1, 0, 1, 0), (0, 2, 0, 0)), np.float64) / 2.0,
}

Cut = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # vertices, faces, their normals, values of the vertices


class PointsAndCurvesReader:
    """Reads each prim once."""

    def __init__(self, materials: MaterialReader, attributes: AttributeReader, collector: WarningCollector):
        self._materials, self._attributes, self._collector = materials, attributes, collector
        self._known: dict[Sdf.Path, tuple[MeshGeometry, np.ndarray | None] | None] = {}
        self._painted: dict[tuple[Sdf.Path, int], int] = {}

    def read(self, prim: Usd.Prim, node: int, name: str, time: Usd.TimeCode) -> list[ShapeInstance]:
        path = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
        if path not in self._known:
            self._known[path] = self._cut(prim, str(path), time)
            if UsdGeom.PointBased(prim).GetPointsAttr().ValueMightBeTimeVarying():
                self._collector.warn("changes its points with time, which stay as they were at first", str(path))
        known = self._known[path]
        if known is None:
            return []
        surface, image = known
        color, look = self._materials.of_solid(prim, time)
        if color is not None and image is not None:
            if (path, look) not in self._painted:
                self._painted[path, look] = self._materials.painted(look, image, str(path))
            look, color = self._painted[path, look], (1.0, 1.0, 1.0, color[3])
        return [ShapeInstance(name, node, surface, look, color)]

    def _cut(self, prim: Usd.Prim, name: str, time: Usd.TimeCode) -> tuple[MeshGeometry, np.ndarray | None] | None:
        points = self._attributes.get(prim, "points", time)
        points = np.zeros((0, 3)) if points is None else points
        if not np.isfinite(points).all():
            raise WarpcamError(f"'{name}': points must be finite, got {points[~np.isfinite(points).all(1)][0]}")
        if len(points) == 0:
            if not self._attributes.refused(prim, "points"):
                self._collector.warn("has no points", name)
            return None
        given = UsdGeom.PrimvarsAPI(prim).GetPrimvar("widths")
        if not (given and given.HasValue()) and not prim.GetAttribute("widths").HasValue():
            self._collector.warn("has no widths, and is not drawn", name)
            return None
        cut = (self._balls if prim.IsA(UsdGeom.Points) else self._tubes)(prim, name, points, time)
        if cut is None or len(cut[1]) == 0:
            return None
        vertices, faces, normals, values = cut
        colors = np.clip(values[:, 1:], 0.0, None)
        image = uvs = None
        if len(colors) and np.ptp(colors, axis=0).max() > 0.0:
            image, uvs = corner_colors(np.rint(255.0 * linear_to_srgb(colors[faces])).astype(np.uint8))
        return MeshGeometry(name, vertices, faces, normals, uvs), image

    def _balls(self, prim: Usd.Prim, name: str, points: np.ndarray, time: Usd.TimeCode) -> Cut:
        tokens, one = UsdGeom.Tokens, {UsdGeom.Tokens.constant: 1}
        counts = {**one, tokens.uniform: 1, tokens.vertex: len(points), tokens.varying: len(points)}
        values, _ = self._values(prim, name, counts, time)
        values = np.broadcast_to(values, (len(points), 4))
        seen = values[:, 0] > 0.0
        points, values = points[seen], values[seen]
        level = next((level for level in DETAIL if 20 * 4**level * len(points) <= MOST_FACES), 0)
        ball, faces = icosphere(level)
        vertices = points[:, None] + 0.5 * values[:, None, :1] * ball
        faces = (len(ball) * np.arange(len(points))[:, None, None] + faces).reshape(-1, 3).astype(np.int32)
        normals = np.tile(ball, (len(points), 1))[faces]
        return vertices.reshape(-1, 3), faces, normals, np.repeat(values, len(ball), axis=0)

    def _tubes(self, prim: Usd.Prim, name: str, points: np.ndarray, time: Usd.TimeCode) -> Cut | None:
        tokens = UsdGeom.Tokens
        numbers = self._attributes.get(prim, "curveVertexCounts", time)
        if self._attributes.refused(prim, "curveVertexCounts"):
            return None
        numbers = np.zeros(0, np.int64) if numbers is None else numbers
        if len(numbers) == 0 or numbers.min() < 0 or numbers.sum() != len(points):
            raise WarpcamError(
                f"'{name}': curveVertexCounts sum up to {numbers.sum()}, but there are {len(points)} points"
            )
        kind, wrap, basis = (self._attributes.get(prim, what, time) for what in ("type", "wrap", "basis"))
        basis = basis if kind == tokens.cubic else tokens.linear
        lines = [Curve(int(number), basis, wrap) for number in numbers]
        starts = np.concatenate(([0], np.cumsum(numbers)[:-1]))
        ends = np.array([line.segments + (wrap != "periodic") for line in lines])
        counts = {
            tokens.constant: 1,
            tokens.uniform: len(numbers),
            tokens.vertex: len(points),
            tokens.varying: int(ends.sum()),
        }
        values, how = self._values(prim, name, counts, time)
        firsts = np.concatenate(([0], np.cumsum(ends)[:-1]))
        segments = sum(line.segments for line in lines)
        steps = (1,) * len(COARSE) if basis == "linear" else [step for _, step in COARSE]
        cuts = [(around, n) for (around, _), n in zip(COARSE, steps, strict=True)]
        faces = [2 * around * (segments * n + len(lines)) for around, n in cuts]
        sides, step = next((cut for cut, count in zip(cuts, faces, strict=True) if count <= MOST_FACES), cuts[-1])
        tubes: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
        for place, line in enumerate(lines):
            if line.segments < 1:
                self._collector.warn("has curves of too few points, which are left out", name)
                continue
            own = slice(starts[place], starts[place] + numbers[place])
            path = line.at(points[own], step)
            if how == tokens.vertex:
                along = line.at(values[own], step)
            elif how == tokens.varying:
                along = line.between(values[firsts[place] : firsts[place] + ends[place]], step)
            else:
                along = np.broadcast_to(values[place if how == tokens.uniform else 0], (len(path), 4))
            moved = np.append(True, np.abs(np.diff(path, axis=0)).max(axis=1) > 0.0)
            path, along = path[moved], along[moved]
            if len(path) > 1 and along[:, 0].max() > 0.0:
                tubes.setdefault(len(path), []).append((path, along))
        parts, count = [], 0
        for group in tubes.values():
            part = tube(np.array([path for path, _ in group]), np.array([along for _, along in group]), sides)
            parts.append((part[0], part[1] + count, part[2], part[3]))
            count += len(part[0])
        if not parts:
            return None
        joined = [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]
        return joined[0], joined[1].astype(np.int32), joined[2], joined[3]

    def _values(self, prim: Usd.Prim, name: str, counts: dict[str, int], time: Usd.TimeCode) -> tuple[np.ndarray, str]:
        """Widths and display colours, (n, 4), and how both are interpolated: as the finer of the two."""
        api = UsdGeom.PrimvarsAPI(prim)
        based = UsdGeom.Points(prim) if prim.IsA(UsdGeom.Points) else UsdGeom.Curves(prim)
        widths = self._attributes.get(prim, "widths", time)
        widths = np.ones((1, 1)) if widths is None or len(widths) == 0 else widths.reshape(-1, 1)
        how = based.GetWidthsInterpolation()
        own, colors = api.GetPrimvar("widths"), api.FindPrimvarWithInheritance("displayColor")
        shades, second = np.ones((1, 3)), UsdGeom.Tokens.constant
        if own and own.HasValue():
            found = self._attributes.primvar(own, time, 1)
            widths, how = widths if found is None else found, own.GetInterpolation()
        if colors and colors.HasValue() and colors.GetInterpolation() != UsdGeom.Tokens.constant:
            found = self._attributes.primvar(colors, time, 3)
            shades, second = shades if found is None else found, colors.GetInterpolation()
        if (widths < 0.0).any():
            self._collector.warn("has widths that are negative, which are not drawn", name)
        both = [(widths, str(how)), (shades, second)]
        for place, (values, how) in enumerate(both):
            if len(values) == 1 and np.isfinite(values).all():
                both[place] = values, UsdGeom.Tokens.constant
            elif counts.get(how) != len(values) or not np.isfinite(values).all():
                fault = "that are not finite"
                if np.isfinite(values).all():
                    fault = "of another number than its interpolation needs"
                what = ("widths", "displayColor")[place]
                self._collector.warn(f"has {what} {fault}, which are left out", name)
                both[place] = np.ones((1, values.shape[1])), UsdGeom.Tokens.constant
        (widths, first), (shades, second) = both
        if counts[first] == counts[second] or 1 in (len(widths), len(shades)):
            how = first if len(widths) > 1 else second
        else:
            self._collector.warn("has widths and colours of two interpolations, of which the widths are drawn", name)
            shades, how = np.ones((1, 3)), first
        rows = max(len(widths), len(shades))
        return np.hstack((np.broadcast_to(widths, (rows, 1)), np.broadcast_to(shades, (rows, 3)))), str(how)


class Curve:
    """Interpolation of one curve between its points."""

    def __init__(self, count: int, basis: str, wrap: str):
        self._basis, self._count = BASES.get(basis), count
        closed = wrap == "periodic"
        if self._basis is None:
            self.segments = count if closed and count > 2 else count - 1
            stride, width = 1, 2
        else:
            stride, width = (3 if basis == "bezier" else 1), 4
            self._pinned = wrap == "pinned" and basis != "bezier"
            have = count + 2 if self._pinned else count
            self.segments = count // stride if closed else (have - 4) // stride + 1
        closed_points = max(count, 1) if closed else 2**62
        segments = np.arange(max(self.segments, 0))
        self._points = (stride * segments[:, None] + np.arange(width)) % closed_points

    def at(self, values: np.ndarray, step: int) -> np.ndarray:
        """Along the curve, with both its ends, of what its points have, (point, n)."""
        if self._basis is None:
            return np.concatenate((values[self._points[:, 0]], values[self._points[-1:, 1]]))
        if self._pinned:
            values = np.concatenate((2 * values[:1] - values[1:2], values, 2 * values[-1:] - values[-2:-1]))
        t = np.arange(step + 1)[:, None] / step
        weights = np.hstack((t**3, t**2, t, np.ones_like(t))) @ self._basis
        found = np.einsum("tk,ska->sta", weights, values[self._points])
        return np.concatenate((found[:, :-1].reshape(-1, values.shape[1]), found[-1, -1:]))

    def between(self, values: np.ndarray, step: int) -> np.ndarray:
        """Interpolate values that the ends of the curve's segments have."""
        places = np.arange(self.segments * step + 1) / step
        first = np.floor(places).astype(np.int64)
        share = (places - first)[:, None]
        return (1.0 - share) * values[first % len(values)] + share * values[(first + 1) % len(values)]


def tube(paths: np.ndarray, values: np.ndarray, sides: int) -> Cut:
    """Round tubes with flat ends.

    Args:
        paths: (curve, ring, 3), their middles.
        values: (curve, ring, 4), their widths and colours.
        sides: Around each.
    """
    curves, rings = paths.shape[:2]
    along = unit(np.gradient(paths, axis=1))
    first = np.cross(along[:, 0], np.eye(3)[np.abs(along[:, 0]).argmin(axis=1)])
    across = np.empty_like(paths)
    across[:, 0] = unit(first)
    for ring in range(1, rings):  # carried along without turning about the path
        before, way = across[:, ring - 1], along[:, ring]
        across[:, ring] = unit(before - (before * way).sum(axis=1, keepdims=True) * way)
    angles = 2.0 * np.pi * np.arange(sides) / sides
    outward = (
        np.cos(angles)[:, None] * across[:, :, None] + np.sin(angles)[:, None] * np.cross(along, across)[:, :, None]
    )
    around = paths[:, :, None] + 0.5 * values[:, :, None, :1] * outward
    number = (np.arange(curves * rings * sides)).reshape(curves, rings, sides)
    a, b = number[:, :-1], np.roll(number, -1, axis=2)[:, :-1]
    c, d = np.roll(number, -1, axis=2)[:, 1:], number[:, 1:]
    side = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])
    fan = np.stack((np.zeros(sides - 2, np.int64), np.arange(1, sides - 1), np.arange(2, sides)), axis=1)
    low, high = number[:, 0][:, fan[:, ::-1]].reshape(-1, 3), number[:, -1][:, fan].reshape(-1, 3)
    smooth = outward.reshape(-1, 3)
    ends = [np.repeat(sign * along[:, ring], sides - 2, axis=0)[:, None] for ring, sign in ((0, -1.0), (-1, 1.0))]
    normals = [smooth[side], *(np.broadcast_to(end, (len(end), 3, 3)) for end in ends)]
    shown = np.repeat(values.reshape(-1, 4), sides, axis=0)
    return around.reshape(-1, 3), np.concatenate((side, low, high)), np.concatenate(normals), shown


def icosphere(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of length 1 and faces, each of an icosahedron's quartered so often."""
    g = 0.5 * (1.0 + np.sqrt(5.0))
    vertices = unit(np.array([v for a in (-1.0, 1.0) for b in (-g, g) for v in ((0, a, b), (a, b, 0), (b, 0, a))]))
    near = np.linalg.norm(vertices[:, None] - vertices, axis=-1) < 1.1
    corners: Sequence[tuple[int, int, int]] = [
        (i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]
    ]
    faces = np.array(corners)
    inward = np.linalg.det(vertices[faces]) < 0.0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    for _ in range(level):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        pairs, which = np.unique(edges, axis=0, return_inverse=True)
        middle = len(vertices) + which.reshape(-1, 3)
        vertices = np.concatenate((vertices, unit(vertices[pairs].sum(axis=1))))
        (a, b, c), (ab, bc, ca) = faces.T, middle.T
        quarters = ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))
        faces = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return vertices, faces
