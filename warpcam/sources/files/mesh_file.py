"""Files of meshes: glTF, OBJ, STL, PLY, through the `trimesh` package, COLLADA, and MuJoCo's .msh."""

import io
import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image

from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.scene.file_scene import DrivenScene
from warpcam.sources.common import materials
from warpcam.sources.common.gaussian_cloud import CloudGeometry, cloud_of_ply
from warpcam.sources.common.geometry import Geometry, MeshGeometry, unit
from warpcam.sources.common.images import LINEAR, TRANSFER, corner_colors, named_images, pixels_of, ply_colors
from warpcam.sources.common.opacity import opacity_of
from warpcam.sources.common.optional import import_source
from warpcam.sources.common.scene_graph import FrameNode, Material, SceneGraph, ShapeInstance
from warpcam.sources.common.scene_graph_source import SceneGraphSource
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.common.wrapped_looks import WrappedLooks
from warpcam.sources.files import gltf_materials, gltf_plain, gltf_unsupported, msh, mtl, ply, stl
from warpcam.sources.files.gltf_document import Document
from warpcam.sources.files.resolver import Resolver
from warpcam.textures.pack import TextureImage

Y_UP = np.array(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)), np.float64)
GLTF = (".glb", ".gltf")


def load(
    path: Path,
    num_worlds: int,
    *,
    device: Any,
    meters_per_unit: float | None,
    up_axis: str | None,
    textures: Mapping[str, Any],
    transparency: bool | None,
    access: FileAccess,
    add: Callable[[SceneGraph], None] | None = None,
) -> DrivenScene:
    images, where = named_images(textures, access.limits), device_rule.resolve(device)
    collector = WarningCollector(str(path))
    try:
        graph = read_graph(path, collector, access, meters_per_unit, up_axis)
    finally:
        collector.say()
    if add is not None:
        add(graph)
    for label, image in images.items():
        graph.texture_names.append(label)
        graph.textures.append(image)
    return DrivenScene(SceneGraphSource(graph, num_worlds, where, transparency=transparency))


def read_graph(
    path: Path,
    collector: WarningCollector,
    access: FileAccess,
    meters_per_unit: float | None = None,
    up_axis: str | None = "Z",
) -> SceneGraph:
    """Read a file of meshes; ``meters_per_unit`` and ``up_axis`` as ``warpcam.load`` has them.

    Raises:
        RefusedError: A file lies outside of what may be opened, or something is too large.
        WarpcamError: The file cannot be read, or shows nothing.
    """
    kind = path.suffix.lower()
    if path.stat().st_size == 0:
        raise WarpcamError(f"{path}: is empty: it has no bytes at all")
    with _heard(collector) as heard:
        try:
            if kind == ".dae":
                return _collada(path, collector, access, meters_per_unit, up_axis)
            root = np.eye(4) * (1.0 if meters_per_unit is None else float(meters_per_unit))
            root[3, 3] = 1.0
            if kind == ".msh":
                shape = ShapeInstance(f"/{path.stem}", 0, msh.read(path, access))
                return SceneGraph(str(path), [FrameNode("/", -1, root)], [shape])
            document: Document | None = None
            painted: np.ndarray | None = None
            data = access.read(path) if kind in (".obj", ".ply") else b""
            resolver = Resolver(path, access, data, collector)
            options = {"fix_texture": _has_texture(data)} if kind == ".ply" else {}
            if kind == ".stl":
                data = stl.triangles_of(path, access, collector)
                painted = stl.colors_of(data)
            elif kind in (".obj", ".ply"):
                data = resolver.text.encode() if kind == ".obj" else ply.readable(path, data, access)
            else:
                document = Document(path, access)
                gltf_unsupported.tell(document, collector)
                data, kind = gltf_plain.plain(document, collector), ".glb"
            source = io.BytesIO(data)
            scene = trimesh.load_scene(source, file_type=kind[1:], process=False, resolver=resolver, **options)
        except WarpcamError:
            raise
        except MemoryError:
            raise WarpcamError(f"{path}: does not fit into memory") from None
        except Exception as error:  # whatever a broken file makes a parser raise
            reader = "pycollada" if kind == ".dae" else "trimesh"
            raise WarpcamError(f"{path}: {reader} cannot read it: {type(error).__name__}: {error}"[:500]) from None
        if resolver.refused is not None:
            raise resolver.refused
        missing = next((text for text in heard if "didn't decode" in text), None)
        if missing is not None:  # it goes on with zeros
            raise WarpcamError(f"{path}: trimesh cannot decode it, a package may be missing: {missing}")
        graph = SceneGraph(str(path), [FrameNode("/", -1, root @ Y_UP if document and up_axis == "Z" else root)])
        _Reader(scene, graph, document, collector, access, resolver, painted).read()
    clouds = [mesh for mesh in scene.geometry.values() if isinstance(mesh, trimesh.PointCloud)]
    if not graph.items and clouds:
        count = sum(len(cloud.vertices) for cloud in clouds)
        raise WarpcamError(
            f"{path}: is a cloud of {count} points without faces, which has no surface to draw; make a mesh of it, or "
            "Gaussian splats"
        )
    if not graph.items:
        raise WarpcamError(f"{path}: has no triangles that can be drawn")
    return graph


def _collada(
    path: Path, collector: WarningCollector, access: FileAccess, meters_per_unit: float | None, up_axis: str | None
) -> SceneGraph:
    collada_file = import_source("files.collada_file", "meshes")
    graph = SceneGraph(str(path), [FrameNode("/", -1, np.eye(4))])
    graph.nodes[0].local = collada_file.read(path, graph, collector, access, meters_per_unit, up_axis)
    if not graph.items:
        raise WarpcamError(f"{path}: has no triangles that can be drawn")
    return graph


def _has_texture(data: bytes) -> bool:
    """Return True if a PLY file names an image: without one, trimesh is to leave its vertices as they are."""
    return b"texturefile" in data[: 1 << 16].split(b"end_header")[0].lower()


class _Reader:
    def __init__(
        self,
        scene: Any,
        graph: SceneGraph,
        document: Document | None,
        collector: WarningCollector,
        access: FileAccess,
        resolver: Resolver,
        painted: np.ndarray | None,
    ):
        self._painted = painted  # of faces
        self._scene, self._graph, self._collector = scene, graph, collector
        self._gltf = None if document is None else gltf_materials.MaterialReader(document, graph, collector)
        self._wrapped = WrappedLooks(graph)
        self._library, self._resolver = resolver.library, resolver
        self._obj_looks = mtl.LookReader(resolver.library, resolver.found, access, self._texture, collector)
        self._obj: dict[str, tuple[int, mtl.ObjLook]] = {}
        self._nodes: dict[Any, int] = {scene.graph.base_frame: 0}
        self._read: dict[Any, tuple[Geometry, int, Any] | None] = {}

    def read(self) -> None:
        for name in self._scene.graph.nodes_geometry:
            node = self._node(name)
            geometry = self._scene.graph[name][1]
            if geometry not in self._read:
                self._read[geometry] = self._geometry(str(geometry), self._scene.geometry[geometry])
            found = self._read[geometry]
            if found is not None:
                self._graph.items.append(ShapeInstance(self._graph.nodes[node].name, node, *found))

    def _node(self, name: Any) -> int:
        line = []
        while name not in self._nodes:
            line.append(name)
            parent = self._scene.graph.transforms.parents.get(name)
            if parent is None or len(line) > len(self._scene.graph.nodes):
                break
            name = parent
        above = self._nodes.get(name, 0)
        for child in reversed(line):
            parent = self._scene.graph.transforms.parents.get(child)
            matrix = self._scene.graph.get(child, parent)[0] if parent is not None else np.eye(4)
            path = f"{self._graph.nodes[above].name.rstrip('/')}/{child}"
            if not np.isfinite(matrix).all():
                self._collector.warn("has a transform that is not finite, and is left out", path)
            self._graph.nodes.append(FrameNode(path, above, np.asarray(matrix, np.float64), body=True))
            above = self._nodes[child] = len(self._graph.nodes) - 1
        return above

    def _geometry(self, name: str, mesh: Any) -> tuple[Geometry, int, Any] | None:
        raw = mesh.metadata.get("_ply_raw", {}).get("vertex", {}).get("data")
        is_cloud = isinstance(mesh, trimesh.PointCloud)
        cloud = cloud_of_ply(f"{self._graph.source}: {name}", raw) if is_cloud else None
        if cloud is not None:
            return CloudGeometry(cloud), -1, None
        if not isinstance(mesh, trimesh.Trimesh):
            self._collector.warn(f"is a {type(mesh).__name__}, which is not drawn", name)
            return None
        faces, vertices = np.asarray(mesh.faces, np.int64), np.asarray(mesh.vertices, np.float64)
        if len(faces) == 0:
            self._collector.warn("is a mesh without faces", name)
            return None
        if vertices.shape[1:] != (3,):
            raise WarpcamError(f"mesh '{name}': vertices must have three coordinates, got {vertices.shape[1:]}")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise WarpcamError(
                f"mesh '{name}': faces must be indices from 0 to {len(vertices) - 1}, got "
                f"{faces.min() if faces.min() < 0 else faces.max()}"
            )
        if not np.isfinite(vertices[faces]).all():
            raise WarpcamError(f"mesh '{name}': vertices must be finite")
        normals = None
        if "vertex_normals" in mesh._cache.cache and len(mesh.vertex_normals) == len(vertices):
            given = np.asarray(mesh.vertex_normals, np.float64)[faces]
            normals = np.where(np.isfinite(given), unit(given), 0.0)
            flat = mesh.face_normals[:, None, :] if len(mesh.face_normals) == len(faces) else None
            if flat is not None:
                normals = np.where(np.abs(normals).max(axis=-1, keepdims=True) > 0.0, normals, flat)
            elif not np.abs(normals).max(axis=-1).all():
                normals = None
        visual, uvs, look, color, both = mesh.visual, None, -1, None, not mesh.is_watertight
        if visual.kind == "texture":
            if visual.uv is not None and len(visual.uv) == len(vertices) and np.isfinite(visual.uv).all():
                uvs = np.asarray(visual.uv, np.float64)[faces]
            if self._gltf is None:
                look, uvs, color = self._said(name, mesh, faces, uvs)
            else:
                tint = gltf_materials.tint_of(visual.vertex_attributes.get("color"), len(vertices))
                look, uvs, both = self._gltf.look(
                    int(visual.material.name), name, None if tint is None else tint[faces], uvs
                )
            if look >= 0 and uvs is not None:
                look, uvs = self._wrapped.laid_on(look, uvs)
        elif (colors := self._display_colors(mesh, faces)) is not None:
            look, uvs, color = self._colored(name, colors, len(faces))
        surface = MeshGeometry(name, vertices, faces.astype(np.int32), normals, uvs, both)
        return surface, look, color

    def _said(self, name: str, mesh: Any, faces: np.ndarray, uvs: Any) -> tuple[int, Any, Any]:
        """Look, texture coordinates and colour as an OBJ or PLY file says them: trimesh's own material is grey."""
        material = mesh.visual.material
        known, image = str(getattr(material, "name", None)), getattr(material, "image", None)
        raw = mesh.metadata.get("_ply_raw", {})
        if known in self._library:
            if known not in self._obj:
                self._obj[known] = len(self._graph.materials), self._obj_looks.look(known)
                self._graph.materials.append(self._obj[known][1].material)
            look, found = self._obj[known]
            return look, uvs if uvs is None else uvs * found.scale + found.offset, None
        if raw and self._resolver.gave_image and isinstance(image, Image.Image):
            texture = self._texture(name, pixels_of(image))
            self._graph.materials.append(Material(f"{name}/texture", materials.WHITE, texture=texture))
            return len(self._graph.materials) - 1, uvs, None
        colors = self._display_colors(mesh, faces)
        return (-1, uvs, None) if colors is None else self._colored(name, colors, len(faces))

    def _display_colors(self, mesh: Any, faces: np.ndarray) -> np.ndarray | None:
        """Colours of corners, (face, 3 or 1, 3 or 4) uint8, or None."""
        raw = mesh.metadata.get("_ply_raw", {})
        for element, count in (("vertex", len(mesh.vertices)), ("face", len(faces))):
            colors = ply_colors(raw.get(element, {}).get("data"), count)
            if colors is not None:
                return colors[faces] if element == "vertex" else colors[:, None]
        if mesh.visual.kind in ("vertex", "face"):
            by_vertex = mesh.visual.kind == "vertex"
            return np.asarray(mesh.visual.vertex_colors[faces] if by_vertex else mesh.visual.face_colors[:, None])
        if self._painted is None or len(self._painted) != len(faces):
            return None
        return self._painted[:, None]

    def _colored(self, name: str, per_corner: Any, count: int) -> tuple[int, Any, Any]:
        """Look, texture coordinates and colour of display colours of corners, (face, 3 or 1, 3 or 4) uint8."""
        per_corner = np.broadcast_to(per_corner, (count, 3, per_corner.shape[2]))
        alphas = per_corner[..., 3:]
        if (per_corner == per_corner[0, 0]).all():
            return (
                -1,
                None,
                (*map(float, LINEAR[per_corner[0, 0, :3]]), float(per_corner[0, 0, 3]) / 255.0 if alphas.size else 1.0),
            )
        solid = alphas.min(initial=255) == 255
        image, uvs = corner_colors(np.ascontiguousarray(per_corner[..., :3] if solid else per_corner))
        opacity, drawn = opacity_of(None if solid else TRANSFER[image[..., 3]], 1.0, 0.0)
        look = Material(
            f"{name}/colors",
            materials.WHITE,
            opacity=opacity,
            texture=self._texture(name, image[..., :3]),
            opacity_map=-1 if drawn is None else self._texture(f"{name}/opacity", drawn, False),
        )
        self._graph.materials.append(look)
        return len(self._graph.materials) - 1, uvs, None

    def _texture(self, name: str, pixels: np.ndarray, color: bool = True) -> int:
        self._graph.textures.append(TextureImage("2d", np.ascontiguousarray(pixels), blend_light=color))
        self._graph.texture_names.append(name)
        return len(self._graph.textures) - 1


@contextmanager
def _heard(collector: WarningCollector) -> Iterator[list[str]]:
    """Collect trimesh's logged warnings for the user: files that are not found, for example."""
    texts: list[str] = []

    class Ear(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            reason = f" ({record.exc_info[1]})" if record.exc_info and record.exc_info[1] else ""
            texts.append(" ".join(record.getMessage().split())[:300] + reason)
            collector.warn(f"trimesh says: {texts[-1]}")

    log, ear = logging.getLogger("trimesh"), Ear(logging.WARNING)
    log.addHandler(ear)
    try:
        yield texts
    finally:
        log.removeHandler(ear)
