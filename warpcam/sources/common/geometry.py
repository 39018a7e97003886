"""Shapes in frames of their own, and what becomes of them under a linear map: an exact shape where there is one.

The kernels know rigid shapes with sizes. A map is split into a rotation and a stretch; a stretch along a solid's own
axes becomes its size, any other is baked into vertices. A mesh is baked once for each stretch.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from warpcam.accel.gaussians import GaussianCloud
from warpcam.accel.meshes import Mesh
from warpcam.kernels.types import BOX, CAPSULE, CONE, CYLINDER, ELLIPSOID, MESH, PLANE, SPHERE
from warpcam.sources.common import tessellate

SAME = 1e-6  # stretches that differ by less, relatively, are one


@dataclass(frozen=True, eq=False)
class RenderShape:
    """A shape for the kernels.

    Attributes:
        type: Of ``kernels/types.py``.
        rotation: (3, 3), proper.
        size: (3,) [m].
        mesh: For type MESH.
        cloud: For type SPLATS.
    """

    type: int
    rotation: np.ndarray
    size: np.ndarray
    mesh: Mesh | None = None
    cloud: GaussianCloud | None = None


class Geometry(Protocol):
    """Geometry in its own frame."""

    name: str

    def transformed(self, linear: np.ndarray) -> RenderShape | None:
        """The shape under a linear map, (3, 3); None if nothing is left of it."""


def polar(linear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A proper rotation and a symmetric stretch whose product is ``linear``; a mirrored one has det(stretch) < 0."""
    u, sizes, vt = np.linalg.svd(linear)
    rotation, stretch = u @ vt, (vt.T * sizes) @ vt
    if np.linalg.det(rotation) < 0.0:
        rotation, stretch = -rotation, -stretch
    return rotation, stretch


class MeshGeometry:
    """A triangle mesh.

    Attributes:
        vertices: (vertex, 3) float64.
        faces: (face, 3) int32.
        normals: (face, 3, 3), unit, or None.
        uvs: (face, 3, 2) float32, v up, or None.
        two_sided: Whether the second half of the faces is the first seen from behind.
        moves: Whether ``vertices`` may be others later: then faces are shaded as they lie.
    """

    def __init__(
        self,
        name: str,
        vertices: np.ndarray,
        faces: np.ndarray,
        normals: np.ndarray | None = None,
        uvs: np.ndarray | None = None,
        two_sided: bool = False,
        moves: bool = False,
    ):
        self.moves, self.two_sided = moves, two_sided
        self.name, self.vertices, self.faces, self.normals, self.uvs = name, vertices, faces, normals, uvs
        if two_sided:
            back = [0, 2, 1]
            self.faces = np.concatenate((faces, faces[:, back]))
            self.normals = None if normals is None else np.concatenate((normals, -normals[:, back]))
            self.uvs = None if uvs is None else np.concatenate((uvs, uvs[:, back]))
        self._baked: dict[bytes, tuple[Mesh, np.ndarray]] = {}

    def transformed(self, linear: np.ndarray) -> RenderShape | None:
        if np.linalg.matrix_rank(linear) < 2:
            return None
        rotation, stretch = polar(linear)
        return RenderShape(MESH, rotation, np.zeros(3), self._bake(stretch))

    def now(self) -> Iterator[tuple[Mesh, np.ndarray]]:
        """Yield each baked mesh with the present positions of its vertices, (vertex, 3) float32."""
        for mesh, stretch in self._baked.values():
            yield mesh, np.ascontiguousarray(self.vertices @ stretch.T, np.float32)

    def _bake(self, stretch: np.ndarray) -> Mesh:
        scale = np.abs(stretch).max()
        # Rounded, so that what differs by rounding is one; + 0.0, so that -0.0 is 0.0.
        key = (np.rint(np.append(stretch / scale, np.log(scale)) / SAME) + 0.0).tobytes()
        if key not in self._baked:
            vertices, faces, normals, uvs = self.vertices @ stretch.T, self.faces, self.normals, self.uvs
            if normals is not None and not np.allclose(stretch, stretch[0, 0] * np.eye(3), rtol=SAME, atol=0.0):
                normals = unit(normals @ np.linalg.pinv(stretch))
            elif normals is not None and stretch[0, 0] < 0.0:
                normals = -normals
            if np.linalg.det(stretch) < 0.0:
                order = [0, 2, 1]
                faces = faces[:, order]
                normals = None if normals is None else normals[:, order]
                uvs = None if uvs is None else uvs[:, order]
            mesh = Mesh(
                self.name,
                np.ascontiguousarray(vertices, np.float32),
                np.ascontiguousarray(faces, np.int32),
                None if normals is None or self.moves else np.ascontiguousarray(normals, np.float32),
                None if uvs is None else np.ascontiguousarray(uvs, np.float32),
                moves=self.moves,
                two_sided=self.two_sided,
            )
            self._baked[key] = mesh, stretch
        return self._baked[key][0]


class Primitive:
    """A shape that the kernels have, as long as the map lets it be one.

    Attributes:
        type: SPHERE, CAPSULE, CYLINDER, CONE, BOX or PLANE.
        size: (3,) as in ``kernels/types.py``.
        turn: (3, 3), the solid's axes in its own frame, where its axis is not z.
    """

    def __init__(self, name: str, kind: int, size: tuple[float, ...], turn: np.ndarray | None = None):
        self.name, self.type = name, kind
        self.size = np.array((*size, 0.0, 0.0, 0.0)[:3], np.float64)
        self.turn = np.eye(3) if turn is None else turn
        self._mesh: tuple[bytes, MeshGeometry] | None = None

    def transformed(self, linear: np.ndarray) -> RenderShape | None:
        if np.linalg.matrix_rank(linear) < 3 or not (self.size[: NEEDED.get(self.type, 0)] > 0.0).all():
            return None
        linear = linear @ self.turn
        if self.type == SPHERE:
            u, sizes, vt = np.linalg.svd(linear)
            if np.ptp(sizes) <= SAME * sizes[0]:
                return RenderShape(SPHERE, _proper(u @ vt), self.size * sizes[0])
            # The axes in the order and sense in which they were, as far as that can be told.
            rotation, stretch = polar(linear)
            if _is_diagonal(stretch):
                return RenderShape(ELLIPSOID, rotation, self.size[0] * np.abs(np.diag(stretch)))
            return RenderShape(ELLIPSOID, _proper(u), self.size[0] * sizes)
        rotation, stretch = polar(linear)
        if _is_diagonal(stretch):
            along = np.abs(np.diag(stretch))
            round_ = abs(along[0] - along[1]) <= SAME * along[0]
            if self.type == BOX:
                return RenderShape(BOX, rotation, self.size * along)
            # What is not its own mirror image looks along the other way.
            turn = rotation if np.linalg.det(stretch) > 0.0 else rotation @ np.diag((-1.0, 1.0, -1.0))
            if self.type == PLANE:
                return RenderShape(PLANE, turn, self.size * (along[0], along[1], 0.0))
            if self.type in (CYLINDER, CONE) and round_:
                return RenderShape(self.type, turn, self.size * (along[0], along[2], 0.0))
            if self.type == CAPSULE and round_ and abs(along[0] - along[2]) <= SAME * along[0]:
                return RenderShape(CAPSULE, rotation, self.size * along[0])
        return self._as_surface().transformed(linear)

    def surface(self) -> MeshGeometry:
        """The solid in its own frame, cut into triangles."""
        cut = self._as_surface()
        normals = None if cut.normals is None else cut.normals @ self.turn.T
        return MeshGeometry(self.name, cut.vertices @ self.turn.T, cut.faces, normals)

    def _as_surface(self) -> MeshGeometry:
        key = self.size.tobytes()
        if self._mesh is None or self._mesh[0] != key:
            self._mesh = key, _tessellated(self.name, self.type, self.size)
        return self._mesh[1]


NEEDED = {SPHERE: 1, CAPSULE: 1, CYLINDER: 2, CONE: 2, BOX: 3}  # sizes that must not be zero


def unit(vectors: np.ndarray) -> np.ndarray:
    """Normalise vectors to length 1; z for vectors without a direction."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    usable = np.isfinite(length) & (length > 0.0)
    return np.where(usable, vectors / np.where(usable, length, 1.0), (0.0, 0.0, 1.0))


def _tessellated(name: str, kind: int, size: np.ndarray) -> MeshGeometry:
    if kind == BOX:
        return MeshGeometry(name, *tessellate.box(size))
    if kind == CYLINDER:
        return MeshGeometry(name, *tessellate.cylinder(size[0], size[0], size[1]))
    if kind == CONE:
        return MeshGeometry(name, *tessellate.cone(size[0], size[1]))
    if kind in (CAPSULE, SPHERE):
        return MeshGeometry(name, *tessellate.capsule(size[0], size[0], size[1]))
    far = np.where(size[:2] > 0.0, size[:2], tessellate.FAR)
    return MeshGeometry(name, *tessellate.rectangle(far[0], far[1]))


def _is_diagonal(stretch: np.ndarray) -> bool:
    return bool(np.abs(stretch - np.diag(np.diag(stretch))).max() <= SAME * np.abs(stretch).max())


def _proper(rotation: np.ndarray) -> np.ndarray:
    """Mirrored axes turned round: of a shape that is its own mirror image."""
    return rotation if np.linalg.det(rotation) > 0.0 else -rotation
