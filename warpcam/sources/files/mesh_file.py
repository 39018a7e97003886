"""Files of meshes: glTF, OBJ, STL, PLY, through the `trimesh` package, and COLLADA."""

import io
import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image

from warpcam.core import device as device_rule
from warpcam.core.color import linear_to_srgb
from warpcam.core.errors import WarpcamError
from warpcam.scene.file_scene import DrivenScene
from warpcam.sources.common import materials
from warpcam.sources.common.gaussian_cloud import CloudGeometry, cloud_of_ply
from warpcam.sources.common.geometry import Geometry, MeshGeometry, unit
from warpcam.sources.common.images import (
    ENCODED,
    LINEAR,
    TRANSFER,
    corner_colors,
    named_images,
    packed,
    pixels_of,
    ply_colors,
)
from warpcam.sources.common.opacity import opacity_of
from warpcam.sources.common.optional import import_source
from warpcam.sources.common.scene_graph import FrameNode, Material, SceneGraph, ShapeInstance
from warpcam.sources.common.scene_graph_source import SceneGraphSource
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.files import gltf_plain, gltf_unsupported, mtl, stl
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
) -> DrivenScene:
    images, where = named_images(textures), device_rule.resolve(device)
    collector = WarningCollector(str(path))
    try:
        graph = read_graph(path, collector, meters_per_unit, up_axis)
    finally:
        collector.say()
    for label, image in images.items():
        graph.texture_names.append(label)
        graph.textures.append(image)
    return DrivenScene(SceneGraphSource(graph, num_worlds, where, transparency=transparency))


def read_graph(
    path: Path, collector: WarningCollector, meters_per_unit: float | None = None, up_axis: str | None = "Z"
) -> SceneGraph:
    """Read a file of meshes; ``meters_per_unit`` and ``up_axis`` as ``warpcam.load`` has them.

    Raises:
        WarpcamError: The file cannot be read, or shows nothing.
    """
    kind = path.suffix.lower()
    if path.stat().st_size == 0:
        raise WarpcamError(f"{path}: is empty: it has no bytes at all")
    with _heard(collector) as heard:
        try:
            if kind == ".dae":
                return _collada(path, collector, meters_per_unit, up_axis)
            resolver = Resolver(path, collector)
            source: Any = str(path)
            if kind in (".stl", ".obj"):
                data = stl.triangles_of(path, collector) if kind == ".stl" else resolver.text.encode()
                source = io.BytesIO(data)
            elif kind in GLTF:
                document = Document(path)
                gltf_unsupported.tell(document, collector)
                source, kind = io.BytesIO(gltf_plain.plain(document, collector)), ".glb"
            scene = trimesh.load_scene(source, file_type=kind[1:], process=False, resolver=resolver, **_options(path))
        except WarpcamError:
            raise
        except MemoryError:
            raise WarpcamError(f"{path}: does not fit into memory") from None
        except Exception as error:  # whatever a broken file makes a parser raise
            reader = "pycollada" if kind == ".dae" else "trimesh"
            raise WarpcamError(f"{path}: {reader} cannot read it: {type(error).__name__}: {error}"[:500]) from None
        missing = next((text for text in heard if "didn't decode" in text), None)
        if missing is not None:  # it goes on with zeros
            raise WarpcamError(f"{path}: trimesh cannot decode it, a package may be missing: {missing}")
        root = np.eye(4) * (1.0 if meters_per_unit is None else float(meters_per_unit))
        root[3, 3] = 1.0
        is_gltf = path.suffix.lower() in GLTF
        graph = SceneGraph(str(path), [FrameNode("/", -1, root @ Y_UP if is_gltf and up_axis == "Z" else root)])
        _Reader(scene, graph, is_gltf, collector, resolver).read()
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


def _collada(path: Path, collector: WarningCollector, meters_per_unit: float | None, up_axis: str | None) -> SceneGraph:
    collada_file = import_source("files.collada_file", "meshes")
    graph = SceneGraph(str(path), [FrameNode("/", -1, np.eye(4))])
    graph.nodes[0].local = collada_file.read(path, graph, collector, meters_per_unit, up_axis)
    if not graph.items:
        raise WarpcamError(f"{path}: has no triangles that can be drawn")
    return graph


def _options(path: Path) -> dict[str, Any]:
    """Options of trimesh's reader: vertices of a PLY file are left as they are where no image needs others."""
    if path.suffix.lower() != ".ply":
        return {}
    with path.open("rb") as file:
        head = file.read(1 << 16).split(b"end_header")[0].lower()
    return {"fix_texture": b"texturefile" in head}


class _Reader:
    def __init__(self, scene: Any, graph: SceneGraph, is_gltf: bool, collector: WarningCollector, resolver: Resolver):
        self._scene, self._graph, self._is_gltf, self._collector = scene, graph, is_gltf, collector
        self._library, self._resolver = resolver.library, resolver
        self._obj_looks = mtl.LookReader(resolver.library, resolver.found, self._texture, collector)
        self._obj: dict[str, tuple[int, mtl.ObjLook]] = {}
        self._nodes: dict[Any, int] = {scene.graph.base_frame: 0}
        self._read: dict[Any, tuple[Geometry, int, Any] | None] = {}
        self._looks: dict[int, int] = {}
        self._images: dict[tuple[Any, ...], int] = {}

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
        cloud = cloud_of_ply(name, raw) if isinstance(mesh, trimesh.PointCloud) else None
        if cloud is not None:
            return CloudGeometry(cloud), -1, None
        if not isinstance(mesh, trimesh.Trimesh):
            self._collector.warn(f"is a {type(mesh).__name__}, which is not drawn", name)
            return None
        faces, vertices = np.asarray(mesh.faces, np.int64), np.asarray(mesh.vertices, np.float64)
        if len(faces) == 0:
            self._collector.warn("is a mesh without faces", name)
            return None
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
            if not self._is_gltf:
                look, uvs, color = self._said(name, mesh, faces, uvs)
            else:
                look = self._look(visual.material)
                both = bool(getattr(visual.material, "doubleSided", False))
                tint = _tint(visual.vertex_attributes.get("color"), len(vertices))
                if tint is not None:
                    look, uvs = self._tinted(name, look, tint[faces], uvs)
        elif visual.kind in ("vertex", "face"):
            per_corner = visual.vertex_colors[faces] if visual.kind == "vertex" else visual.face_colors[:, None]
            look, uvs, color = self._colored(name, per_corner, len(faces))
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
            if uvs is not None:
                uvs, pixels = mtl.laid(found, uvs)
                if pixels is not None:
                    self._graph.materials.append(replace(found.material, texture=self._texture(known, pixels)))
                    look = len(self._graph.materials) - 1
            return look, uvs, None
        if raw and self._resolver.gave_image:
            self._graph.materials.append(
                Material(f"{name}/texture", materials.WHITE, texture=self._image(name, "color", image))
            )
            return len(self._graph.materials) - 1, uvs, None
        for element, count in (("vertex", len(mesh.vertices)), ("face", len(faces))):
            colors = ply_colors(raw.get(element, {}).get("data"), count)
            if colors is not None:
                return self._colored(name, colors[faces] if element == "vertex" else colors[:, None], len(faces))
        return -1, uvs, None

    def _colored(self, name: str, per_corner: Any, count: int) -> tuple[int, Any, Any]:
        """Look, texture coordinates and colour of display colours of corners, (face, 3 or 1, 3 or 4) uint8."""
        per_corner = np.broadcast_to(np.asarray(per_corner, np.uint8)[..., :3], (count, 3, 3))
        shown = ENCODED[per_corner] if self._is_gltf else per_corner
        if (shown == shown[0, 0]).all():
            return -1, None, (*map(float, LINEAR[shown[0, 0]]), 1.0)
        image, uvs = corner_colors(np.ascontiguousarray(shown))
        self._graph.materials.append(Material(f"{name}/colors", materials.WHITE, texture=self._texture(name, image)))
        return len(self._graph.materials) - 1, uvs, None

    def _tinted(self, name: str, look: int, tint: np.ndarray, uvs: Any) -> tuple[int, Any]:
        """A look and texture coordinates with colours of corners on top, (face, 3, 3), linear."""
        base = self._graph.materials[look]
        if np.ptp(tint.reshape(-1, 3), axis=0).max() < 1.0 / 255.0:
            red, green, blue = (float(x) for x in tint[0, 0] * base.color)
            self._graph.materials.append(replace(base, name=f"{name}/colors", color=(red, green, blue)))
        elif max(base.texture, *base.maps) >= 0:
            self._collector.warn("has colours of corners beside textures, and is drawn without them", name)
            return look, uvs
        else:
            image, uvs = corner_colors(np.rint(255.0 * linear_to_srgb(tint)).astype(np.uint8))
            self._graph.materials.append(replace(base, name=f"{name}/colors", texture=self._texture(name, image)))
        return len(self._graph.materials) - 1, uvs

    def _look(self, material: Any) -> int:
        if id(material) not in self._looks:
            self._graph.materials.append(self._translated(material))
            self._looks[id(material)] = len(self._graph.materials) - 1
        return self._looks[id(material)]

    def _translated(self, material: Any) -> Material:
        name = str(getattr(material, "name", None) or f"material {len(self._graph.materials)}")
        factor = _factors(material.baseColorFactor)
        metal, rough = material.metallicFactor, material.roughnessFactor
        emission = _factors(material.emissiveFactor, default=0.0)[:3]
        look = Material(
            name,
            color=(factor[0], factor[1], factor[2]),
            roughness=1.0 if rough is None else float(rough),
            metallic=1.0 if metal is None else float(metal),
            emission=(emission[0], emission[1], emission[2]),
            texture=self._image(name, "color", material.baseColorTexture),
            normals=self._image(name, "normals", material.normalTexture),
            packed=self._image(name, "packed", material.metallicRoughnessTexture, material.occlusionTexture),
            emission_texture=self._image(name, "emission", material.emissiveTexture),
        )
        return self._with_opacity(look, material, factor[3])

    def _with_opacity(self, look: Material, material: Any, factor: float) -> Material:
        mode, image, values = material.alphaMode, material.baseColorTexture, None
        if mode not in ("MASK", "BLEND"):
            return look
        if look.texture >= 0 and isinstance(image, Image.Image):
            pixels = pixels_of(image)
            values = TRANSFER[pixels[..., 3]] if pixels.shape[2] == 4 else None
        cutoff = 0.0
        if mode == "MASK":
            cutoff = 0.5 if material.alphaCutoff is None else float(material.alphaCutoff)
        opacity, drawn = opacity_of(values, factor, cutoff)
        index = -1 if drawn is None else self._texture(f"{look.name}/opacity", drawn, color=False)
        return replace(look, opacity=opacity, cutoff=cutoff, opacity_map=index)

    def _image(self, name: str, role: str, *images: Any) -> int:
        """Index of a texture, or -1. A packed one is made of those of roughness and metalness, and of occlusion."""
        given = [image if isinstance(image, Image.Image) else None for image in images]
        if not any(given):
            return -1
        key = (role, *map(id, given))
        if key not in self._images:
            try:
                pixels = [None if image is None else pixels_of(image) for image in given]
            except (OSError, ValueError, SyntaxError) as error:
                self._collector.warn(f"has a texture that cannot be read ({error})", name)
                self._images[key] = -1
            else:
                image = pixels[0]
                if role == "packed":
                    rough = None if pixels[0] is None else _channels(pixels[0])
                    shade = None if pixels[1] is None else _channels(pixels[1])[..., 0]
                    image = packed([shade, *((None, None) if rough is None else (rough[..., 1], rough[..., 2]))])
                self._images[key] = -1 if image is None else self._texture(name, image, role in ("color", "emission"))
        return self._images[key]

    def _texture(self, name: str, pixels: np.ndarray, color: bool = True) -> int:
        self._graph.textures.append(TextureImage("2d", np.ascontiguousarray(pixels), blend_light=color))
        self._graph.texture_names.append(name)
        return len(self._graph.textures) - 1


def _channels(pixels: np.ndarray) -> np.ndarray:
    """(height, width, 3) in [0, 1]."""
    return TRANSFER[np.repeat(pixels, 3, axis=-1) if pixels.shape[2] == 1 else pixels[..., :3]]


def _tint(colors: Any, count: int) -> np.ndarray | None:
    """Colours of glTF's vertices, (count, 3) linear, of what trimesh keeps of them; None if there are none."""
    array: Any = np.asarray(colors) if colors is not None else np.zeros(0)
    if array.ndim != 2 or len(array) != count or array.shape[1] < 3:
        return None
    most = np.iinfo(array.dtype).max if np.issubdtype(array.dtype, np.integer) else 1.0
    tint = np.clip(np.nan_to_num(array[:, :3].astype(np.float64) / most), 0.0, 1.0)
    return None if tint.min(initial=1.0) == 1.0 else tint


def _factors(value: Any, default: float = 1.0) -> list[float]:
    """Linear factors, four, of what trimesh keeps as bytes or as numbers."""
    if value is None:
        return [default] * 3 + [1.0]
    array = np.asarray(value)
    numbers = (array / 255.0 if array.dtype == np.uint8 else array.astype(np.float64)).reshape(-1)
    return [*map(float, numbers), *[1.0] * 4][:4]


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
