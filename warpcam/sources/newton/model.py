"""Constant parts of a Newton model."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import newton
import numpy as np

from warpcam.accel.gaussians import GaussianCloud
from warpcam.accel.heightfields import HeightField
from warpcam.accel.meshes import Mesh, face_normals
from warpcam.core.errors import WarpcamError
from warpcam.kernels import types
from warpcam.sources.common.world_columns import columns_of, places_of
from warpcam.sources.newton.body_variants import read_entries
from warpcam.sources.newton.gaussians import read_cloud
from warpcam.sources.newton.options import NewtonOptions
from warpcam.textures.pack import TextureImage

GEO = newton.GeoType
# Newton's shapes in our words.
KINDS = {
    GEO.PLANE: types.PLANE,
    GEO.HFIELD: types.HEIGHT_FIELD,
    GEO.SPHERE: types.SPHERE,
    GEO.CAPSULE: types.CAPSULE,
    GEO.ELLIPSOID: types.ELLIPSOID,
    GEO.CYLINDER: types.CYLINDER,
    GEO.BOX: types.BOX,
    GEO.MESH: types.MESH,
    GEO.CONE: types.CONE,
    GEO.CONVEX_MESH: types.MESH,
    GEO.GAUSSIAN: types.SPLATS,
}
PLAIN = (0.5, 0.0, -1)  # roughness, metalness and texture of what says nothing of them
CAP_GAP = 1e-3  # how far the base of a height field is below its lowest place, of its size: Newton's own renderer's


@dataclass(frozen=True, eq=False)
class Layout:
    """Columns of the model's shapes and bodies in the worlds' tables, and their appearance.

    Attributes:
        ids: (world, column) int32, shapes; -1 where a world has none.
        kinds: (column,) int32.
        shape_bodies: (world, column) int32, the shapes' bodies.
        assets: (world or 1, column) int32, index of the mesh, height field or cloud, or -1.
        materials: (world or 1, column) int32, places in ``finishes``; 0 is plain.
        finishes: Roughness, metalness and texture, -1 for none, of each material.
        bodies: (world, place) int32, bodies; -1 where a world has none.
        body_names: Of the places.
        body_places: (body,) int32.
        variants: Type and source, (world, column) int32 and uint64, that a shape must have to be seen in this column;
            a type of -1 where it always is. None where no shape may become another.
    """

    ids: np.ndarray
    kinds: np.ndarray
    shape_bodies: np.ndarray
    assets: np.ndarray
    materials: np.ndarray
    meshes: Sequence[Mesh]
    height_fields: Sequence[HeightField]
    textures: Sequence[TextureImage]
    finishes: Sequence[tuple[float, float, int]]
    clouds: Sequence[GaussianCloud]
    bodies: np.ndarray
    body_names: Sequence[str]
    body_places: np.ndarray
    variants: tuple[np.ndarray, np.ndarray] | None


def read_layout(model: newton.Model, choice: NewtonOptions) -> Layout:
    """Read what never changes."""
    num_worlds, count = model.world_count, model.shape_count
    entries = read_entries(model)
    kinds = np.full(len(entries.shapes), -1, np.int32)
    worlds = np.zeros(len(entries.shapes), np.int32)
    if count:
        worlds = model.shape_world.numpy()[entries.shapes]
        for theirs, ours in KINDS.items():
            kinds[entries.types == int(theirs)] = ours
        bent = entries.chosen | (model.shape_scale.numpy()[entries.shapes, 2] > 0.0)
        kinds[(kinds == types.CYLINDER) & bent & ~_is_display(model)[entries.shapes]] = types.BARREL
        if not choice.shared:
            kinds[worlds < 0] = -1
    table, of_column = columns_of(worlds, kinds, num_worlds)
    ids = np.append(entries.shapes, -1)[table].astype(np.int32)

    assets, materials = np.full(len(kinds) + 1, -1, np.int32), np.zeros(len(kinds) + 1, np.int32)
    sources = AssetTables(bool(choice.backs), choice.textures)
    for entry in map(int, np.flatnonzero(np.isin(kinds, (types.MESH, types.HEIGHT_FIELD, types.SPLATS)))):
        source = entries.sources[entry]
        if source is not None:
            convex = entries.types[entry] == int(GEO.CONVEX_MESH)
            assets[entry], materials[entry] = sources.add(source, convex, model.shape_label[entries.shapes[entry]])
    variants = None
    if entries.chosen.any():
        wanted = np.append(np.where(entries.chosen, entries.types, -1), -1)
        variants = wanted[table].astype(np.int32), np.append(entries.pointers, np.uint64(0))[table]
    bodies = np.concatenate((model.shape_body.numpy() if count else np.zeros(0, np.int32), [-1])).astype(np.int32)
    body_worlds = model.body_world.numpy() if model.body_count else np.zeros(0, np.int32)
    places, names, place_of_body = places_of(body_worlds, model.body_label, num_worlds)
    return Layout(
        ids=ids,
        kinds=of_column,
        shape_bodies=bodies[ids],
        assets=_rows(assets[table]),
        materials=_rows(materials[table]),
        meshes=sources.meshes,
        height_fields=sources.height_fields,
        textures=sources.textures,
        finishes=list(sources.finishes),
        clouds=sources.clouds,
        bodies=places,
        body_names=names,
        body_places=place_of_body,
        variants=variants,
    )


def _is_display(model: newton.Model) -> np.ndarray:
    """(shape,) bool, cylinders of MJCF's sites: their third size is no barrel's."""
    marks = getattr(getattr(model, "mujoco", None), "site_size_is_display", None)
    return np.zeros(model.shape_count, bool) if marks is None else marks.numpy().astype(bool)


class AssetTables:
    """Meshes, height fields, clouds and textures, each kept once.

    Args:
        backs: Whether meshes are seen from behind, too.
        textured: Whether textures are read.
    """

    def __init__(self, backs: bool, textured: bool):
        self._backs, self._textured = backs, textured
        self.meshes: list[Mesh] = []
        self.height_fields: list[HeightField] = []
        self.textures: list[TextureImage] = []
        self.clouds: list[GaussianCloud] = []
        self._known: dict[Any, tuple[int, int]] = {}
        self._meshes: dict[tuple[bytes, ...], int] = {}
        self._images: dict[Any, int] = {}
        self.finishes: dict[tuple[float, float, int], int] = {PLAIN: 0}

    def add(self, source: Any, convex: bool, label: str) -> tuple[int, int]:
        """Index of a mesh, a height field or a cloud among its kind, and its material.

        Args:
            source: What the shape has.
            convex: Whether it is its hull.
            label: The shape's.
        """
        key = (id(source), convex)
        if key not in self._known:
            if isinstance(source, newton.Heightfield):
                self.height_fields.append(_height_field(source, label))
                self._known[key] = len(self.height_fields) - 1, 0
            elif isinstance(source, newton.Gaussian):
                self.clouds.append(read_cloud(source, label))
                self._known[key] = len(self.clouds) - 1, 0
            elif isinstance(source, newton.Mesh):
                self._known[key] = self._mesh(source, convex, label), self._material(source, label)
            else:
                raise WarpcamError(
                    f"model: the source of shape '{label}' must be a newton.Mesh, Heightfield or Gaussian, got "
                    f"{type(source).__name__}"
                )
        return self._known[key]

    def _mesh(self, source: newton.Mesh, convex: bool, label: str) -> int:
        mesh = _mesh(source, convex, label)
        if self._backs:
            mesh = _with_backs(mesh)
        arrays = (mesh.vertices, mesh.faces, mesh.normals, mesh.uvs)
        key = tuple(b"" if array is None else array.tobytes() for array in arrays)
        if key not in self._meshes:
            self._meshes[key] = len(self.meshes)
            self.meshes.append(mesh)
        return self._meshes[key]

    def _material(self, source: newton.Mesh, label: str) -> int:
        rough, metal = source.roughness, source.metallic
        finish = (
            PLAIN[0] if rough is None else float(np.clip(rough, 0.0, 1.0)),
            PLAIN[1] if metal is None else float(np.clip(metal, 0.0, 1.0)),
            self._texture(source, label),
        )
        return self.finishes.setdefault(finish, len(self.finishes))

    def _texture(self, source: newton.Mesh, label: str) -> int:
        texture = source.texture
        if texture is None or not self._textured:
            return -1
        key = str(texture) if isinstance(texture, str | Path) else id(texture)
        if key not in self._images:
            pixels = None
            try:
                image = newton.utils.load_texture(texture)
                if image is not None and image.ndim == 3 and image.shape[2] == 1:
                    image = image[..., 0]
                pixels = newton.utils.normalize_texture(image, require_channels=True)
            except (OSError, ValueError, IndexError) as error:
                _warn("shape '%s': %s", label, error)
            if pixels is None:
                what = texture if isinstance(texture, str | Path) else "image"
                _warn("shape '%s': its texture %s cannot be read; its colour is drawn", label, what)
                self._images[key] = -1
            else:
                self._images[key] = len(self.textures)
                self.textures.append(TextureImage("2d", pixels, blend_light=True))
        return self._images[key]


def _mesh(source: newton.Mesh, convex: bool, label: str) -> Mesh:
    vertices = np.ascontiguousarray(source.vertices, np.float32)
    faces = np.ascontiguousarray(np.asarray(source.indices).reshape(-1, 3), np.int32)
    if faces.size and not (0 <= faces.min() and faces.max() < len(vertices)):
        face = int(np.argmax(((faces < 0) | (faces >= len(vertices))).any(axis=1)))
        raise WarpcamError(
            f"model: the mesh of shape '{label}': indices must be from 0 to {len(vertices) - 1}, got "
            f"{faces[face].tolist()} at face {face}"
        )
    normals = uvs = None
    if source.normals is not None and not convex:
        given = np.asarray(source.normals, np.float32)
        _require_rows(given, len(vertices), "normals", label)
        length = np.linalg.norm(given, axis=1, keepdims=True)
        normals = (given / np.where(length > 0.0, length, 1.0))[faces]
        flat = face_normals(vertices, faces)[:, None, :]
        usable = np.isfinite(normals).all(-1, keepdims=True) & (np.abs(normals).sum(-1, keepdims=True) > 0.0)
        normals = np.where(usable, normals, flat).astype(np.float32)
    if source.uvs is not None and not convex:
        given = np.asarray(source.uvs, np.float32)
        _require_rows(given, len(vertices), "uvs", label)
        transform = np.asarray(source.texture_transform, np.float32)
        uvs = np.ascontiguousarray((given @ transform[:, :2].T + transform[:, 2])[faces], np.float32)
    return Mesh(label, vertices, faces, normals, uvs)


def _with_backs(mesh: Mesh) -> Mesh:
    """Return the mesh with faces visible from both sides."""
    back = np.array((0, 2, 1))
    faces = np.concatenate((mesh.faces, mesh.faces[:, back]))
    normals = None if mesh.normals is None else np.concatenate((mesh.normals, -mesh.normals[:, back]))
    uvs = None if mesh.uvs is None else np.concatenate((mesh.uvs, mesh.uvs[:, back]))
    return replace(mesh, faces=faces, normals=normals, uvs=uvs, two_sided=True)


def _require_rows(values: np.ndarray, rows: int, what: str, label: str) -> None:
    if len(values) != rows:
        raise WarpcamError(
            f"model: the mesh of shape '{label}': {what} must be {rows}, one a vertex, got {len(values)}"
        )


def _height_field(source: newton.Heightfield, label: str) -> HeightField:
    rise = source.max_z - source.min_z
    heights = np.asarray(source.min_z + np.asarray(source.data, np.float32) * rise, np.float32)
    gap = CAP_GAP * max(1.0, source.hx, source.hy, abs(rise))
    lowest = min(source.min_z, source.max_z) - gap
    return HeightField(label, heights, (float(source.hx), float(source.hy)), float(source.max_z), float(-lowest))


def _rows(table: np.ndarray) -> np.ndarray:
    """One row where all worlds are alike."""
    return table[:1] if (table == table[:1]).all() else table


def _warn(message: str, *values: Any) -> None:
    logging.getLogger("warpcam").warning("from_newton: " + message, *values)
