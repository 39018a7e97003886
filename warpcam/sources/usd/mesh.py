"""Meshes of a stage: polygons of any number of corners, with what lies on them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from warpcam.accel.meshes import face_normals
from warpcam.accel.triangulation import triangulate
from warpcam.core.color import linear_to_srgb
from warpcam.core.errors import WarpcamError
from warpcam.sources.common.geometry import MeshGeometry, unit
from warpcam.sources.common.images import corner_colors
from warpcam.sources.common.scene_graph import ShapeInstance
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.attributes import AttributeReader
from warpcam.sources.usd.material import BoundMaterial, MaterialReader

SKINNING = ("primvars:skel:jointIndices", "skel:blendShapes")  # of what UsdSkel moves
FACES = ("faceVertexCounts", "faceVertexIndices", "surfaceFaceVertexIndices", "tetVertexIndices")
SMOOTH_BELOW = 0.8  # cosine to the face's normal under which a control cage is not smoothed


@dataclass(frozen=True, eq=False)
class Triangles:
    """A mesh that has been cut into triangles.

    Attributes:
        name: Its path.
        points: (vertex, 3) float64.
        vertices: (triangle, 3), indices of points, counterclockwise seen from the front.
        corners: (triangle, 3), places among the corners of all faces.
        faces: (triangle,), the faces that they were cut from.
        counts: Faces, points and corners: what values by interpolation count.
        smooth: Faces are a control cage.
        two_sided: It is seen from behind, too.
        moves: Its points change with time, and nothing else.
    """

    name: str
    points: np.ndarray
    vertices: np.ndarray
    corners: np.ndarray
    faces: np.ndarray
    counts: tuple[int, int, int]
    smooth: bool
    two_sided: bool
    moves: bool


class MeshReader:
    """Reads each mesh once for each material that it has."""

    def __init__(
        self,
        materials: MaterialReader,
        double_sided: bool | None,
        attributes: AttributeReader,
        collector: WarningCollector,
    ):
        self.double_sided = double_sided
        self._materials, self._attributes, self._collector = materials, attributes, collector
        self._cut: dict[Sdf.Path, Triangles | None] = {}
        self._parts: dict[tuple[Any, ...], tuple[MeshGeometry, int, bool]] = {}
        self.updates: list[Callable[[Usd.TimeCode], None]] = []

    def read(self, prim: Usd.Prim, node: int, name: str, time: Usd.TimeCode) -> list[ShapeInstance]:
        """The shapes that a mesh makes: one, or one for each material of its subsets."""
        path = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
        if path not in self._cut:
            self._cut[path] = self._triangles(prim, path, time)
        triangles = self._cut[path]
        if triangles is None:
            return []
        items = []
        rest = np.ones(len(triangles.faces), bool)
        subsets = self._subsets(prim) if prim.IsA(UsdGeom.Mesh) else []
        for subset in subsets:
            if self._attributes.get(subset.GetPrim(), "elementType") != UsdGeom.Tokens.face:
                self._collector.warn("is a subset of other things than faces, and is left out", str(subset.GetPath()))
                continue
            indices = self._attributes.get(subset.GetPrim(), "indices", time)
            chosen = np.zeros(triangles.counts[0], bool)
            inside = (indices >= 0) & (indices < len(chosen))
            if not inside.all():
                self._collector.warn(
                    "names faces that the mesh does not have, which are left out", str(subset.GetPath())
                )
            chosen[indices[inside]] = True
            mine = chosen[triangles.faces] & rest
            rest &= ~mine
            if mine.any():
                own = f"{name}/{subset.GetPrim().GetName()}"
                bound = self._materials.bound_to(subset.GetPrim())
                items.append(
                    self._item(
                        prim,
                        path,
                        node,
                        name=own,
                        bound=bound,
                        triangles=triangles,
                        mine=mine,
                        part=str(subset.GetPath()),
                        time=time,
                    )
                )
        if rest.any():
            bound = self._materials.bound_to(prim)
            items.append(
                self._item(prim, path, node, name=name, bound=bound, triangles=triangles, mine=rest, part="", time=time)
            )
        return items

    def _subsets(self, prim: Usd.Prim) -> list[UsdGeom.Subset]:
        """Return the subsets with materials."""
        return [
            subset
            for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim))
            if self._attributes.get(subset.GetPrim(), "familyName") == UsdShade.Tokens.materialBind
        ]

    def _item(
        self,
        prim: Usd.Prim,
        path: Sdf.Path,
        node: int,
        name: str,
        bound: BoundMaterial,
        triangles: Triangles,
        mine: np.ndarray,
        part: str,
        time: Usd.TimeCode,
    ) -> ShapeInstance:
        # Of an instance the same unless what is inherited from outside differs: that is colours and bindings.
        color = self._materials.own_color(bound, prim, time)
        key = (path, part.rsplit("/", 1)[-1], bound.look, bound.uv)
        if key not in self._parts:
            self._parts[key] = self._part(prim, str(path), bound, triangles, mine, time)
        surface, look, painted = self._parts[key]
        return ShapeInstance(
            name, node, surface, look, (1.0, 1.0, 1.0, color[3]) if painted and color is not None else color
        )

    def _part(
        self,
        prim: Usd.Prim,
        name: str,
        bound: BoundMaterial,
        triangles: Triangles,
        mine: np.ndarray,
        time: Usd.TimeCode,
    ) -> tuple[MeshGeometry, int, bool]:
        """Its surface and look, and whether that has the colours of its corners."""
        look = bound.look
        uvs = self._uvs(prim, bound, triangles, time)
        if look >= 0 and uvs is not None:
            look, uvs = self._materials.images.laid_on(look, uvs)
        painted = self._corner_colors(prim, triangles, time) if bound.by_color else None
        if painted is not None:
            image, uvs = corner_colors(np.rint(255.0 * linear_to_srgb(painted[mine])).astype(np.uint8))
            look = self._materials.painted(look, image, name)
        elif uvs is not None:
            uvs = uvs[mine]
        normals = self._normals(prim, triangles, time)
        vertices, back = np.unique(triangles.vertices[mine], return_inverse=True)
        surface = MeshGeometry(
            name,
            triangles.points[vertices],
            back.reshape(-1, 3).astype(np.int32),
            normals=None if normals is None else normals[mine],
            uvs=uvs,
            two_sided=triangles.two_sided,
            moves=triangles.moves,
        )
        if triangles.moves:
            self.updates.append(lambda time: self._move(surface, prim, vertices, len(triangles.points), time))
        return surface, look, painted is not None

    def _move(
        self, surface: MeshGeometry, prim: Usd.Prim, vertices: np.ndarray, count: int, time: Usd.TimeCode
    ) -> None:
        points = self._attributes.get(prim, "points", time)
        if points is not None and len(points) == count and np.isfinite(points).all():
            surface.vertices = points[vertices]
        else:
            self._collector.warn(
                "has other points than at first, or none, at some times, and stays as it was", surface.name
            )

    def _triangles(self, prim: Usd.Prim, path: Sdf.Path, time: Usd.TimeCode) -> Triangles | None:
        name, get = str(path), self._attributes.get
        points = get(prim, "points", time)
        points = np.zeros((0, 3)) if points is None else points
        if not np.isfinite(points).all():
            raise WarpcamError(f"mesh '{name}': points must be finite, got {points[~np.isfinite(points).all(1)][0]}")
        smooth = False
        holes = np.zeros(0, np.int64)
        if prim.IsA(UsdGeom.Mesh):
            counts, indices = (_or_empty(get(prim, what, time)) for what in ("faceVertexCounts", "faceVertexIndices"))
            holes = get(prim, "holeIndices", time)
            if get(prim, "subdivisionScheme", time) != UsdGeom.Tokens.none:
                smooth = True
                self._collector.remark("is a subdivision surface, drawn as its control cage", name)
        else:
            indices = self._surface_of(prim, time)
            counts = np.full(len(indices) // 3, 3, np.int64)
        if not counts.any() or len(points) == 0 or self._attributes.refused(prim, "faceVertexIndices"):
            if not self._attributes.refused(prim, "points", *FACES):
                self._collector.warn("is a mesh without faces", name)
            return None
        if counts.min() < 0 or counts.sum() != len(indices):
            raise WarpcamError(
                f"mesh '{name}': faceVertexCounts sum up to {counts.sum()}, but there are {len(indices)} "
                "faceVertexIndices"
            )
        if indices.min() < 0 or indices.max() >= len(points):
            worst = indices.min() if indices.min() < 0 else indices.max()
            raise WarpcamError(f"mesh '{name}': faceVertexIndices has {worst}; allowed are 0 to {len(points) - 1}")
        if counts.min() < 3:
            self._collector.warn("has faces of less than three corners, which are left out", name)
        corners, faces = triangulate(counts, indices, points)
        if len(holes):
            there = ~np.isin(faces, holes)
            corners, faces = corners[there], faces[there]
        if get(prim, "orientation", time) == UsdGeom.Tokens.leftHanded:
            corners = corners[:, [0, 2, 1]]
        if len(faces) == 0:
            self._collector.warn("is a mesh without faces", name)
            return None
        sides = get(prim, "doubleSided", time)
        two_sided = sides if self.double_sided is None else self.double_sided
        totals = (len(counts), len(points), len(indices))
        moves = UsdGeom.PointBased(prim).GetPointsAttr().ValueMightBeTimeVarying()
        if prim.IsA(UsdGeom.Mesh):
            fixed = ("faceVertexCounts", "faceVertexIndices", "holeIndices")
            if any(prim.GetAttribute(what).ValueMightBeTimeVarying() for what in fixed):
                self._collector.warn("changes its faces with time, and is drawn as it was at first", name)
                moves = False
        if any(self._attributes.has_elements(prim, name) for name in SKINNING):
            self._collector.warn(
                "is moved by a skeleton, which is not followed: its points are drawn as they stand", name
            )
        return Triangles(
            name=name,
            points=points,
            vertices=indices[corners],
            corners=corners,
            faces=faces,
            counts=totals,
            smooth=smooth,
            two_sided=two_sided,
            moves=moves,
        )

    def _surface_of(self, prim: Usd.Prim, time: Usd.TimeCode) -> np.ndarray:
        """Return the corners of the faces of a mesh of tetrahedra, (3 * face,)."""
        flat = Sdf.ValueTypeNames.IntArray
        surface = self._attributes.get(prim, "surfaceFaceVertexIndices", time, also=flat)
        if surface is None or len(surface) == 0:
            inside = self._attributes.get(prim, "tetVertexIndices", time)
            if inside is None or len(inside) == 0:
                return np.zeros(0, np.int64)
            surface = UsdGeom.TetMesh.ComputeSurfaceFaces(UsdGeom.TetMesh(prim), time)
        return np.array(surface, np.int64).reshape(-1)

    def _uvs(self, prim: Usd.Prim, bound: BoundMaterial, triangles: Triangles, time: Usd.TimeCode) -> np.ndarray | None:
        """(triangle, 3, 2), v up."""
        api = UsdGeom.PrimvarsAPI(prim)
        primvar = api.FindPrimvarWithInheritance(bound.uv) if bound.uv else None
        if not primvar or not primvar.HasValue():
            kinds = (Sdf.ValueTypeNames.TexCoord2fArray, Sdf.ValueTypeNames.TexCoord2hArray)
            every = [p for p in api.FindPrimvarsWithInheritance() if p.HasValue()]
            named = {p.GetPrimvarName(): p for p in every}
            typed = [p for p in every if p.GetTypeName() in kinds]
            primvar = named.get("st") or named.get("UVMap") or named.get("uv") or (typed[0] if typed else None)
        values = self._values(primvar, triangles, 2, time) if primvar else None
        if values is None:
            return None
        if bound.uv_turn is not None:
            values = values @ bound.uv_turn[:, :2].T + bound.uv_turn[:, 2]
        return values

    def _corner_colors(self, prim: Usd.Prim, triangles: Triangles, time: Usd.TimeCode) -> np.ndarray | None:
        """Display colours that differ over the mesh, (triangle, 3, 3) linear."""
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
        if not primvar or not primvar.HasValue() or primvar.GetInterpolation() == UsdGeom.Tokens.constant:
            return None
        return self._values(primvar, triangles, 3, time)

    def _normals(self, prim: Usd.Prim, triangles: Triangles, time: Usd.TimeCode) -> np.ndarray | None:
        """(triangle, 3, 3), unit; None for flat faces."""
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
        values = None
        if primvar and primvar.HasValue():
            values = self._values(primvar, triangles, 3, time)
        else:
            based = UsdGeom.PointBased(prim)
            normals = self._attributes.get(prim, "normals", time)
            if normals is not None and len(normals):
                values = self._spread(normals, based.GetNormalsInterpolation(), triangles, "normals")
        flat = face_normals(triangles.points, triangles.vertices)[:, None, :]
        if values is not None:
            usable = np.isfinite(values).all(axis=-1, keepdims=True) & (np.abs(values).max(-1, keepdims=True) > 0.0)
            return np.where(usable, unit(values), flat)
        if not triangles.smooth:
            return None
        corners = triangles.points[triangles.vertices]
        sums = np.zeros_like(triangles.points)
        for k in range(3):  # by their angles: how faces were cut does not matter
            one, other = unit(corners[:, k - 1] - corners[:, k]), unit(corners[:, k - 2] - corners[:, k])
            angle = np.arccos(np.clip((one * other).sum(axis=-1), -1.0, 1.0))
            np.add.at(sums, triangles.vertices[:, k], angle[:, None] * flat[:, 0])
        normals = unit(sums)[triangles.vertices]
        return np.where((normals * flat).sum(-1, keepdims=True) >= SMOOTH_BELOW, normals, flat)

    def _values(
        self, primvar: UsdGeom.Primvar, triangles: Triangles, width: int, time: Usd.TimeCode
    ) -> np.ndarray | None:
        values = self._attributes.primvar(primvar, time, width, wider=width == 2)
        if values is None:
            return None
        return self._spread(values, primvar.GetInterpolation(), triangles, primvar.GetPrimvarName())

    def _spread(self, values: np.ndarray, how: str, triangles: Triangles, what: str) -> np.ndarray | None:
        """Values by their interpolation, (triangle, 3, width)."""
        tokens = UsdGeom.Tokens
        faces, points, corners = triangles.counts
        needed = {
            tokens.constant: 1,
            tokens.uniform: faces,
            tokens.vertex: points,
            tokens.varying: points,
            tokens.faceVarying: corners,
        }.get(how, -1)
        if len(values) < needed or needed < 0 or (how != tokens.constant and len(values) != needed):
            self._collector.warn(
                f"has {what} of another number than its interpolation needs, which are left out", triangles.name
            )
            return None
        if not np.isfinite(values).all() and what != "normals":
            self._collector.warn(f"has {what} that are not finite, which are left out", triangles.name)
            return None
        if how == tokens.constant:
            return np.broadcast_to(values[0], (*triangles.vertices.shape, values.shape[1]))
        if how == tokens.uniform:
            return np.repeat(values[triangles.faces][:, None], 3, axis=1)
        return values[triangles.vertices if how in (tokens.vertex, tokens.varying) else triangles.corners]


def _or_empty(array: np.ndarray | None) -> np.ndarray:
    return np.zeros(0, np.int64) if array is None else array
