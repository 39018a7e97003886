"""Meshes of robots: files of every format that is read here, cut into parts of one look each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess, is_file
from warpcam.sources.common.formats import MESHES, USD
from warpcam.sources.common.geometry import Primitive
from warpcam.sources.common.images import resized
from warpcam.sources.common.materials import color_of
from warpcam.sources.common.optional import import_source
from warpcam.sources.common.scene_graph import Material, SceneGraph
from warpcam.sources.common.warnings import WarningCollector

FORMATS = (*sorted(MESHES), *USD)
LEAST_AREA = 1e-14  # [m^2]


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one look, in metres.

    Attributes:
        vertices: (vertex, 3) float64.
        faces: (face, 3) int32.
        normals: (face, 3, 3) float64, unit.
        uvs: (face, 3, 2) float64, v up, or None.
        rgba: Display colour, or None if the file says none.
        image: (height, width, 3 or 4) uint8, or None.
        look: The material, or None.
        front: Number of faces that come first; all others are the same seen from behind.
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    uvs: np.ndarray | None
    rgba: tuple[float, float, float, float] | None
    image: np.ndarray | None
    look: Material | None
    front: int


def read_parts(path: Path, scale: Sequence[float], collector: WarningCollector, access: FileAccess) -> list[Part]:
    """Read a file of meshes in its own axes, as programs of ROS do, and in its own unit.

    Raises:
        RefusedError: A file lies outside of what may be opened, or is too large.
        WarpcamError: The file is not there, cannot be read, or shows nothing.
    """
    if path.suffix.lower() not in FORMATS:
        raise WarpcamError(f"{path}: is no file of meshes that can be read; known are {', '.join(FORMATS)}")
    if not is_file(path):
        raise WarpcamError(f"{path}: there is no such file")
    if path.suffix.lower() in USD:
        graph: SceneGraph = import_source("usd.source", "usd").read_file(path, collector, access)
    else:
        graph = import_source("files.mesh_file", "meshes").read_graph(path, collector, access, None, None)
    stretch, worlds, seen = np.diag(np.asarray(scale, np.float64)), graph.worlds(), graph.seen()
    parts = []
    for item in graph.items:
        if not seen[item.node]:
            continue
        matrix = worlds[item.node]
        geometry = item.geometry.surface() if isinstance(item.geometry, Primitive) else item.geometry
        fit = geometry.transformed(stretch @ matrix[:3, :3]) if np.isfinite(matrix).all() else None
        if fit is None or fit.mesh is None:
            collector.warn("has a part that is not drawn in a robot", str(path))
            continue
        mesh = fit.mesh
        vertices = np.asarray(mesh.vertices, np.float64) @ fit.rotation.T + stretch @ matrix[:3, 3]
        front = len(mesh.faces) // 2 if mesh.two_sided else len(mesh.faces)
        vertices, faces = _merged(vertices, np.asarray(mesh.faces, np.int32))
        sides = vertices[faces]
        areas = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
        if not np.isfinite(areas).all() or 0.5 * np.linalg.norm(areas[:front], axis=1).sum() < LEAST_AREA:
            collector.warn("has a part without any area, which is left out", str(path))
            continue
        if mesh.normals is None:
            normals = _smooth(faces, areas, front, len(vertices))
        else:
            normals = np.asarray(mesh.normals, np.float64) @ fit.rotation.T
        look = graph.materials[item.material] if item.material >= 0 else None
        known = look is not None or item.color is not None
        parts.append(
            Part(
                vertices,
                faces,
                normals=normals,
                uvs=None if mesh.uvs is None else np.asarray(mesh.uvs, np.float64),
                rgba=color_of(look, item.color) if known else None,
                image=None if look is None else _image(graph, look),
                look=look,
                front=front,
            )
        )
    if not parts:
        raise WarpcamError(f"{path}: has no triangles that can be drawn in a robot")
    return [_front(part) for part in parts] if _is_closed(whole(parts)) else parts


def whole(parts: Sequence[Part]) -> Part:
    """All parts as one, without looks, each face once."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    fronts = [part.faces[: part.front] + start for part, start in zip(parts, starts, strict=False)]
    normals = np.concatenate([part.normals[: part.front] for part in parts])
    faces = np.concatenate(fronts).astype(np.int32)
    return replace(
        parts[0], vertices=np.concatenate([part.vertices for part in parts]), faces=faces, normals=normals,
        uvs=None, rgba=None, image=None, look=None, front=len(faces),
    )  # fmt: skip


def _front(part: Part) -> Part:
    """A part without what is only seen from behind."""
    count = part.front
    uvs = None if part.uvs is None else part.uvs[:count]
    return replace(part, faces=part.faces[:count], normals=part.normals[:count], uvs=uvs)


def _is_closed(part: Part) -> bool:
    """Return True if each edge lies between two faces, or an even number of them."""
    _, faces = _merged(part.vertices, part.faces)
    edges = np.sort(np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2])), axis=1).astype(np.int64)
    counts = np.unique(edges[:, 0] << 32 | edges[:, 1], return_counts=True)[1]
    return bool((counts % 2 == 0).all())


def _merged(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make vertices in the same place one."""
    unique, which = unique_rows(vertices)
    return unique, which[faces].astype(np.int32)


def unique_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the different rows of a table of numbers, and which of them each row is; compared by their bytes."""
    rows = np.ascontiguousarray(rows + 0.0)  # -0.0 is 0.0
    keys = rows.view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).reshape(-1)
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    return rows[first], which.reshape(-1)


def _smooth(faces: np.ndarray, areas: np.ndarray, front: int, count: int) -> np.ndarray:
    """Normals of corners, (face, 3, 3): those of vertices, by area, and the face's own where it bends away."""
    sums = np.zeros((count, 3))
    for corner in range(3):
        np.add.at(sums, faces[:front, corner], areas[:front])
    flat = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    round_ = (sums / np.maximum(length, 1e-300))[faces]
    round_[front:] *= -1.0
    along = np.sum(round_ * flat[:, None], axis=-1, keepdims=True) >= 0.8
    return np.where(along, round_, np.where(np.abs(flat).max(axis=1) > 0.0, flat.T, np.eye(3)[:, 2:]).T[:, None])


def _image(graph: SceneGraph, look: Material) -> np.ndarray | None:
    """Image of a material's colour, with its opacity as a fourth channel."""
    pixels = graph.textures[look.texture].pixels if look.texture >= 0 else None
    if pixels is not None:
        pixels = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels[..., :3]
    if look.opacity_map >= 0:
        alpha = graph.textures[look.opacity_map].pixels[..., 0]
        if look.cutoff > 0.0:
            alpha = np.where(alpha >= 255.0 * look.cutoff, 255, 0).astype(np.uint8)
        pixels = np.full((*alpha.shape, 3), 255, np.uint8) if pixels is None else pixels
        pixels = np.concatenate((pixels, resized(alpha, pixels.shape[:2])[..., None]), axis=2)
    return pixels
