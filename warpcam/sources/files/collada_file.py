"""COLLADA files (.dae), through the `pycollada` package: triangles, materials, units and axes of their scene."""

import io
import warnings
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import collada
import numpy as np

from warpcam.core.errors import RefusedError
from warpcam.core.file_access import FileAccess
from warpcam.sources.common import plain_xml
from warpcam.sources.common.geometry import MeshGeometry, unit
from warpcam.sources.common.images import TRANSFER, UnreadableError, corner_colors, decoded
from warpcam.sources.common.materials import BARE, WHITE
from warpcam.sources.common.opacity import opacity_of
from warpcam.sources.common.scene_graph import FrameNode, Material, SceneGraph, ShapeInstance
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.files.mtl import linear
from warpcam.textures.pack import TextureImage

AXES = {  # the file's axes to axes whose z is up
    "Z_UP": np.eye(4),
    "Y_UP": np.array(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)), np.float64),
    "X_UP": np.array(((0, 1, 0, 0), (0, 0, 1, 0), (1, 0, 0, 0), (0, 0, 0, 1)), np.float64),
}
KINDS = (collada.triangleset.TriangleSet, collada.polylist.Polylist)
SHADED = {"emission": "emission", "bumpmap": "bump map", "specular": "specular colour", "shininess": "shininess"}


def read(
    path: Path,
    graph: SceneGraph,
    collector: WarningCollector,
    access: FileAccess,
    meters_per_unit: float | None,
    up_axis: str | None,
) -> np.ndarray:
    """Add what a file's scene shows below the graph's root.

    Args:
        path: The file.
        graph: Its first node is the root.
        collector: Hears of what is not drawn.
        access: What the file may open.
        meters_per_unit: In place of the file's own unit.
        up_axis: "Z" turns what has another axis up; None keeps the file's own axes.

    Returns:
        The matrix from the file's units and axes to metres, (4, 4).

    Raises:
        RefusedError: A file lies outside of what may be opened, something is too large, or the file is an archive.
        Exception: pycollada cannot read the file.
    """
    data = access.read(path)
    if zipfile.is_zipfile(io.BytesIO(data)):  # which pycollada would unpack
        raise RefusedError(f"{path}: is an archive; unpack it, and give the .dae file in it")
    plain_xml.check(data, path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of numpy, for pycollada's own code
        file = collada.Collada(io.BytesIO(data), ignore=[collada.common.DaeError])
        if any(isinstance(error, collada.common.DaeBrokenRefError) for error in file.errors):
            errors, file = file.errors, _without_broken_materials(data, {str(kept.id) for kept in file.materials})
            file.errors[:] = errors
        _Reader(path, file, graph, collector, access).read()
    info = file.assetInfo
    size = meters_per_unit if meters_per_unit is not None else info.unitmeter
    root = np.eye(4) * (1.0 if size is None or not np.isfinite(size) or size <= 0.0 else float(size))
    root[3, 3] = 1.0
    return root @ AXES.get(str(info.upaxis), np.eye(4)) if up_axis == "Z" else root


def _without_broken_materials(data: bytes, known: set[str]) -> Any:
    """The file again without references to unknown materials, with which pycollada leaves out what has them."""
    tree = ElementTree.fromstring(data)
    for parent in tree.iter():
        for child in list(parent):
            if child.tag.endswith("}instance_material") and child.get("target", "").lstrip("#") not in known:
                parent.remove(child)
    return collada.Collada(io.BytesIO(ElementTree.tostring(tree)), ignore=[collada.common.DaeError])


@dataclass
class _Reader:
    path: Path
    file: Any
    graph: SceneGraph
    collector: WarningCollector
    access: FileAccess
    looks: dict[str, int] = field(default_factory=dict)
    images: dict[str, np.ndarray | None] = field(default_factory=dict)
    textures: dict[tuple[str, bool], int] = field(default_factory=dict)
    parts: dict[tuple[str, int], MeshGeometry | None] = field(default_factory=dict)
    colors: dict[str, tuple[int, Any]] = field(default_factory=dict)

    def read(self) -> None:
        for error in self.file.errors:
            self.collector.warn(f"pycollada says: {' '.join(str(error).split())[:300]}")
        if self.file.scene is None:
            return
        if self.file.controllers:
            self.collector.warn("has skins or morphs, which are not followed")
        for bound in [*self.file.scene.objects("geometry"), *self._skinned()]:
            matrix = np.asarray(bound.matrix, np.float64)
            name = str(bound.original.id)
            if not np.isfinite(matrix).all():
                self.collector.warn("has a transform that is not finite, and is left out", name)
                continue
            node = len(self.graph.nodes)
            self.graph.nodes.append(FrameNode(f"/{name}[{node}]", 0, matrix, body=True))
            for place, primitive in enumerate(bound.original.primitives):
                self._add(bound, name, node, place, primitive)

    def _skinned(self) -> list[Any]:
        found = [getattr(skin, "geometry", None) for skin in self.file.scene.objects("controller")]
        return [geometry for geometry in found if geometry is not None]

    def _add(self, bound: Any, name: str, node: int, place: int, primitive: Any) -> None:
        if not isinstance(primitive, KINDS):
            self.collector.warn(f"is a {type(primitive).__name__}, which is not drawn", name)
            return
        tag = f"{name}/{place}"
        bind = bound.materialnodebysymbol.get(primitive.material)
        target = None if bind is None else bind.target
        if (name, place) not in self.parts:
            self.parts[name, place] = self._surface(tag, primitive, target is not None)
        surface = self.parts[name, place]
        if surface is None:
            return
        look, color = (self._look(target), None) if target is not None else self.colors.get(tag, (-1, None))
        self.graph.items.append(ShapeInstance(f"{self.graph.nodes[node].name}/{place}", node, surface, look, color))

    def _surface(self, tag: str, primitive: Any, has_material: bool) -> MeshGeometry | None:
        if isinstance(primitive, collada.polylist.Polylist):
            primitive = primitive.triangleset()
        if primitive.vertex is None or primitive.vertex_index is None or not len(primitive.vertex_index):
            self.collector.warn("is a mesh without faces", tag)
            return None
        vertices = np.asarray(primitive.vertex, np.float64).reshape(-1, 3)
        faces = np.asarray(primitive.vertex_index, np.int32).reshape(-1, 3)
        if faces.min() < 0 or faces.max() >= len(vertices) or not np.isfinite(vertices[faces]).all():
            self.collector.warn("has indices out of range or vertices that are not finite, and is left out", tag)
            return None
        used, order = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used], np.asarray(order.reshape(-1, 3), np.int32)
        normals = uvs = None
        if primitive.normal is not None and primitive.normal_index is not None:
            given = np.asarray(primitive.normal, np.float64)[primitive.normal_index].reshape(-1, 3, 3)
            known = np.isfinite(given).all(axis=-1) & (np.abs(given).max(axis=-1) > 0.0)
            normals = unit(given) if known.all() else None
        if primitive.texcoordset:
            uvs = np.asarray(primitive.texcoordset[0], np.float64)[primitive.texcoord_indexset[0]].reshape(-1, 3, 2)
            uvs = uvs if np.isfinite(uvs).all() else None
        sources = primitive.sources.get("COLOR") or ()
        if sources and not has_material:
            uvs = self._colored(tag, primitive, sources[0], uvs)
        edges = np.sort(np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2])), axis=1)
        closed = bool((np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all())
        return MeshGeometry(tag, vertices, faces, normals, uvs, two_sided=not closed)

    def _colored(self, tag: str, primitive: Any, source: Any, uvs: Any) -> Any:
        """Take colours of corners, and return texture coordinates for them."""
        values = np.asarray(source[4].data, np.float64)[primitive.index[:, :, source[0]]][..., :3]
        shown = np.rint(255.0 * np.clip(np.nan_to_num(values), 0.0, 1.0)).astype(np.uint8)
        if (shown == shown[0, 0]).all():
            self.colors[tag] = -1, (*(linear(value / 255.0) for value in map(float, shown[0, 0])), 1.0)
            return uvs
        image, uvs = corner_colors(np.ascontiguousarray(shown))
        self.graph.materials.append(Material(f"{tag}/colors", WHITE, texture=self._texture(f"{tag}/colors", image)))
        self.colors[tag] = len(self.graph.materials) - 1, None
        return uvs

    def _look(self, target: Any) -> int:
        if target.id not in self.looks:
            self.graph.materials.append(self._material(str(target.name or target.id), target.effect))
            self.looks[target.id] = len(self.graph.materials) - 1
        return self.looks[target.id]

    def _material(self, name: str, effect: Any) -> Material:
        color, texture = self._color(name, effect.diffuse, "diffuse")
        emission, emitted = self._color(name, effect.emission, "emission")
        for what in ("specular", "shininess", "bumpmap"):
            if isinstance(getattr(effect, what), collada.material.Map):
                self.collector.warn(f"has a map of {SHADED[what]}, which is not drawn", name)
        gloss = effect.shininess if isinstance(effect.shininess, float) and effect.shininess > 1.0 else None
        opacity, opacity_map = self._opacity(name, effect)
        return Material(
            name,
            color or (BARE if texture < 0 else WHITE),
            opacity=opacity,
            roughness=0.5 if gloss is None else float((2.0 / (gloss + 2.0)) ** 0.25),
            emission=emission or ((0.0,) * 3 if emitted < 0 else WHITE),
            texture=texture,
            emission_texture=emitted,
            opacity_map=opacity_map,
        )

    def _color(self, name: str, value: Any, what: str) -> tuple[Any, int]:
        """A linear colour or None, and the index of an image or -1."""
        if isinstance(value, collada.material.Map):
            pixels = self._pixels(name, value)
            return None, -1 if pixels is None else self._texture(f"{name}/{what}", pixels)
        if isinstance(value, tuple | list) and len(value) >= 3 and np.isfinite(value[:3]).all():
            return tuple(linear(float(channel)) for channel in value[:3]), -1
        return None, -1

    def _opacity(self, name: str, effect: Any) -> tuple[float, int]:
        """Opacity by the effect's mode, and the index of its map or -1."""
        clear, factor = effect.transparent, effect.transparency
        factor = float(factor) if isinstance(factor, float | int) and np.isfinite(factor) else 1.0
        by_color = effect.opaque_mode == collada.material.OPAQUE_MODE.RGB_ZERO
        if isinstance(clear, collada.material.Map):
            pixels = self._pixels(name, clear)
            if pixels is None or (pixels.shape[2] < 4 and not by_color):
                return 1.0, -1
            values = TRANSFER[pixels[..., 3]] if not by_color else 1.0 - TRANSFER[pixels[..., :3]].mean(axis=-1)
            opacity, drawn = opacity_of(values, factor if not by_color else 1.0, 0.0)
            return opacity, -1 if drawn is None else self._texture(f"{name}/opacity", drawn, color=False)
        if clear is None and not by_color:
            opacity = factor
        elif by_color:
            opacity = 1.0 - factor * float(np.dot((clear or (0.0,) * 3)[:3], (0.212671, 0.71516, 0.072169)))
        else:
            opacity = factor * float(clear[3])
        if opacity <= 0.0:  # programs that mean the other mode write this
            self.collector.remark("is invisible by its transparency, and is drawn solid", name)
            return 1.0, -1
        return min(opacity, 1.0), -1

    def _pixels(self, name: str, image: Any) -> np.ndarray | None:
        path = str(getattr(getattr(getattr(image.sampler, "surface", None), "image", None), "path", "") or "")
        if path not in self.images:
            self.images[path] = None
            try:
                self.images[path] = decoded(self.access.read(self._found(path)), self.access, path)
            except OSError:
                what = "a file is not found; if it is a texture, its material is drawn in its base colour"
                self.collector.warn(what, path or name)
            except UnreadableError as error:
                what = f"a texture cannot be read ({error}), and its material is drawn in its base colour"
                self.collector.warn(what, path)
        return self.images[path]

    def _found(self, written: str) -> Path:
        here = self.path.resolve().parent
        plain = written.removeprefix("file://").replace("\\", "/")
        names = (written, unquote(plain), unquote(plain).lstrip("/"), Path(unquote(plain)).name)
        return self.access.find(here, *filter(None, names))

    def _texture(self, name: str, pixels: np.ndarray, color: bool = True) -> int:
        self.graph.textures.append(TextureImage("2d", np.ascontiguousarray(pixels), blend_light=color))
        self.graph.texture_names.append(name)
        return len(self.graph.textures) - 1
