"""Newton's deformable visual meshes: on particles, on triangles or tetrahedra of them, or on bodies."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import newton
import numpy as np
import warp as wp

from warpcam.accel.meshes import Mesh
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.update.refit import FaceShading
from warpcam.kernels.update.skinning import Shell, bind_attached_vertices, bind_offset_vertices
from warpcam.sources.newton.deformable_part import DeformablePart
from warpcam.sources.newton.deformables import Deformables, is_closed
from warpcam.sources.newton.kernels.visual_points import bind_visual_points
from warpcam.sources.newton.options import NewtonOptions
from warpcam.textures.pack import TextureImage

VISUAL = -2  # stands for a triangle that nothing has: the surface is white
# Newton has had them since 1.8; Isaac Lab comes with an older one.
KIND: Any = getattr(getattr(newton.geometry, "DeformableVisualMesh", None), "Kind", None)


@dataclass(frozen=True, eq=False)
class VisualMesh(DeformablePart):
    """Meshes of the same triangles, at most one in each world, or one in all.

    Attributes:
        hull: How its points are made of its vertices.
        uvs: (face, 3, 2) float32, or None.
        texture: Index among those of all visuals, or -1.
        smooth: Whether it is; else its faces are flat.
        drivers: For each mesh (vertex, 4) int32 and (vertex, 4) float32: see ``attach_vertices`` of
            ``kernels.update.skinning``.
        starts: For each mesh the number of its first vertex among those of all visual meshes of the model.
    """

    hull: Shell = field(kw_only=True)
    uvs: np.ndarray | None = field(kw_only=True)
    texture: int = field(kw_only=True)
    smooth: bool = field(kw_only=True)
    drivers: list[tuple[np.ndarray, np.ndarray]] = field(kw_only=True, default_factory=list)
    starts: list[int] = field(kw_only=True, default_factory=list)

    @property
    def shading(self) -> FaceShading:
        return FaceShading(num_smooth=len(self.faces) if self.smooth else 0)

    @property
    def num_points(self) -> int:
        return len(self.vertices)

    def mesh(self) -> Mesh:
        return Mesh(f"visual mesh {self.column}", self.vertices, self.faces, uvs=self.uvs, moves=True)


@dataclass(frozen=True, eq=False)
class VisualMeshes:
    """All of them.

    Attributes:
        parts: Their columns count from 0.
        textures: Each once.
        particles: (particle,) bool, those that they hang on.
    """

    parts: Sequence[VisualMesh]
    textures: Sequence[TextureImage]
    particles: np.ndarray


def read_visuals(model: newton.Model, choice: NewtonOptions) -> VisualMeshes:
    reader = _Reader(model, choice)
    start = 0
    for mesh in getattr(model, "deformable_visual_meshes", ()) if choice.visual else ():
        if choice.shared or mesh.world >= 0:
            reader.add(mesh, start)
        start += int(mesh.vertex_count)
    return VisualMeshes(list(reader.parts.values()), reader.textures, reader.particles)


def with_visuals(soft: Deformables, visuals: VisualMeshes) -> Deformables:
    """Surfaces of both kinds; the columns of visual meshes follow on those of soft parts."""
    parts = [replace(part, column=soft.num_columns + part.column) for part in visuals.parts]
    columns = soft.num_columns + len(parts)
    return replace(soft, parts=[*soft.parts, *parts], num_columns=columns)


class AttachedVertices:
    """Present points of one visual, in all worlds that have it."""

    def __init__(self, part: VisualMesh, device: wp.Device):
        bonds, weights = (np.stack(rows) for rows in zip(*part.drivers, strict=True))
        count, num_vertices = bonds.shape[:2]
        self._device, self._surface = device, part.hull.upload(device)
        self._bonds = wp.array(bonds, dtype=wp.vec4i, ndim=2, device=device)
        self._weights = wp.array(weights, dtype=wp.vec4, ndim=2, device=device)
        self._starts = wp.array(np.array(part.starts, np.int32), dtype=wp.int32, device=device)
        self._vertices = wp.zeros((count, num_vertices), dtype=wp.vec3, device=device)
        self._points, self._normals = (
            wp.zeros((count, part.num_points), dtype=wp.vec3, device=device) for _ in range(2)
        )
        self.points, self.normals = self._points.flatten(), self._normals.flatten()

    def record(self, particles: wp.array, bodies: wp.array, given: wp.array | None) -> list[Stage]:
        """Bind the stages that write ``points`` and ``normals``.

        Args:
            particles: (particle,) vec3 [m].
            bodies: (body,) transform.
            given: (point,) vec3, vertices of all visual meshes of the model, which are drawn as they are [m]; None
                makes them of particles and bodies.
        """
        device = self._device
        if given is None:
            placed = bind_attached_vertices(self._bonds, self._weights, particles, bodies, self._vertices, device)
        else:
            placed = bind_visual_points(given, self._starts, self._vertices, device)
        return [placed, bind_offset_vertices(self._surface, self._vertices, self._points, self._normals, device)]


class _Reader:
    def __init__(self, model: newton.Model, choice: NewtonOptions):
        self._choice = choice
        self._triangles = _table(model.tri_indices, 3)
        self._tetrahedra = _table(model.tet_indices, 4)
        self.parts: dict[Any, VisualMesh] = {}
        self.textures: list[TextureImage] = []
        self.particles = np.zeros(model.particle_count, bool)
        self._known: dict[Any, int] = {}
        self._seen: dict[Any, int] = {}

    def add(self, mesh: "newton.geometry.DeformableVisualMesh", start: int) -> None:
        faces = np.ascontiguousarray(mesh.indices.numpy().reshape(-1, 3), np.int32)
        uvs = None if mesh.uvs is None else mesh.uvs.numpy().astype(np.float32)
        texture = self._texture(mesh, uvs)
        world = int(mesh.world)
        same = (faces.tobytes(), mesh.vertex_count, b"" if uvs is None else uvs.tobytes(), texture)
        number = self._seen[(world, same)] = self._seen.get((world, same), -1) + 1
        key = (same, number, world < 0)
        if key not in self.parts:
            self.parts[key] = self._part(faces, mesh.rest_vertices.numpy(), uvs, texture)
        part = self.parts[key]
        part.bases.append(part.num_points * len(part.worlds))
        part.worlds.append(world)
        part.triangles.append(VISUAL)
        part.drivers.append(self._drivers(mesh))
        part.starts.append(start)

    def _part(self, faces: np.ndarray, vertices: np.ndarray, uvs: np.ndarray | None, texture: int) -> VisualMesh:
        count, backs = len(vertices), self._choice.backs
        both = not is_closed(faces) if backs is None else backs
        hull = Shell(faces, count, 0.0, by_area=True, first_vertex=0, first_point=0, both=both)
        corners = None if uvs is None else uvs[faces]
        if both:  # seen from both sides
            back = np.array((0, 2, 1))
            faces = np.concatenate((faces, faces[:, back] + count))
            vertices = np.concatenate((vertices, vertices))
            corners = None if corners is None else np.concatenate((corners, corners[:, back]))
        vertices = np.ascontiguousarray(vertices, np.float32)
        smooth = self._choice.smooth
        return VisualMesh(
            faces, vertices, len(self.parts), both, hull=hull, uvs=corners, texture=texture, smooth=smooth
        )

    def _drivers(self, mesh: "newton.geometry.DeformableVisualMesh") -> tuple[np.ndarray, np.ndarray]:
        parent = mesh.parent.numpy().reshape(-1)
        bonds, weights = np.full((len(parent), 4), -1, np.int32), np.zeros((len(parent), 4), np.float32)
        if mesh.kind == KIND.BODY:
            bonds[:, 1], weights[:, :3] = parent, mesh.local_offsets.numpy()
            return bonds, weights
        if mesh.kind == KIND.PARTICLE:
            bonds[:, 0], weights[:, 0] = parent, 1.0
        else:
            elements = self._triangles if mesh.kind == KIND.TRIANGLE else self._tetrahedra
            width = elements.shape[1]
            bonds[:, :width], weights[:, :width] = elements[parent], mesh.weights.numpy()
        self.particles[bonds[bonds >= 0]] = True
        return bonds, weights

    def _texture(self, mesh: "newton.geometry.DeformableVisualMesh", uvs: np.ndarray | None) -> int:
        texture = mesh.texture
        if texture is None or uvs is None or not self._choice.textures:
            return -1
        key = str(texture) if isinstance(texture, str | Path) else id(texture)
        if key not in self._known:
            try:
                pixels = newton.utils.normalize_texture(newton.utils.load_texture(texture), require_channels=True)
            except (OSError, ValueError, IndexError) as error:
                _warn("visual mesh '%s': %s", mesh.label, error)
                pixels = None
            if pixels is None:
                what = texture if isinstance(texture, str | Path) else "image"
                _warn("visual mesh '%s': its texture %s cannot be read; it is drawn white", mesh.label, what)
            self._known[key] = -1 if pixels is None else len(self.textures)
            if pixels is not None:
                self.textures.append(TextureImage("2d", pixels, blend_light=True))
        return self._known[key]


def _table(indices: Any, width: int) -> np.ndarray:
    return np.zeros((0, width), np.int32) if indices is None else indices.numpy().reshape(-1, width)


def _warn(message: str, *values: Any) -> None:
    logging.getLogger("warpcam").warning("from_newton: " + message, *values)
