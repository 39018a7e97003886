"""glTF files in plain words: what trimesh, which reads them, passes over is applied before.

The document is written again, as a binary file: every primitive has float32 attributes and indexed triangles, morph
targets and skins are as they are at rest, instances are nodes, and texture coordinates are those of the material's
textures, moved as KHR_texture_transform says. The name of a material is its index; images are left out, as
``gltf_materials.py`` reads both. The index after the last one is the default material.
"""

import copy
import json
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.core.rotations import rotation_matrices
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.files.gltf_document import BINARY_CHUNK, JSON_CHUNK, MAGIC, Document
from warpcam.sources.files.gltf_textures import extension, laid

POINTS, TRIANGLES, STRIP, FAN = 0, 4, 5, 6
COMPRESSED = "KHR_draco_mesh_compression"
INSTANCES = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


def plain(document: Document, collector: WarningCollector) -> bytes:
    """The file again as trimesh reads it whole."""
    return _Writer(document, collector).write()


class _Writer:
    def __init__(self, document: Document, collector: WarningCollector):
        self._document, self._collector = document, collector
        self._tree: dict[str, Any] = copy.deepcopy(document.tree)
        self._data = bytearray()
        self._own: dict[Any, int] = {}  # meshes as a node has them
        self._world = _world_matrices(self._tree.get("nodes") or [])

    def write(self) -> bytes:
        self._adopt_buffers()
        for key in ("images", "textures", "samplers"):
            self._tree.pop(key, None)
        count = len(self._document.listed("materials"))
        self._tree["materials"] = [{"name": str(place)} for place in range(count + 1)]
        if not self._tree.get("scenes"):  # a library of things: all of them
            nodes = self._tree.get("nodes") or []
            below = {child for node in nodes for child in node.get("children") or []}
            self._tree |= {
                "scene": 0,
                "scenes": [{"nodes": [place for place in range(len(nodes)) if place not in below]}],
            }
        meshes = self._tree.get("meshes") or []
        self._given = copy.deepcopy(meshes)
        for mesh, given in zip(meshes, self._given, strict=True):
            self._write_mesh(mesh, given, given.get("weights"), None)
        self._hide()
        for index, node in enumerate(list(self._tree.get("nodes") or [])):
            if "mesh" in node:
                self._rest(index, node)
                self._spread(node)
        self._tree["buffers"] = [{"byteLength": len(self._data)}]
        text = json.dumps(self._tree).encode()
        text += b" " * (-len(text) % 4)
        body = bytes(self._data) + b"\0" * (-len(self._data) % 4)
        chunks = b"".join(
            len(part).to_bytes(4, "little") + kind.to_bytes(4, "little") + part
            for part, kind in ((text, JSON_CHUNK), (body, BINARY_CHUNK))
        )
        return MAGIC + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks

    def _adopt_buffers(self) -> None:
        starts = []
        for index in range(len(self._document.listed("buffers"))):
            self._data += b"\0" * (-len(self._data) % 4)
            starts.append(len(self._data))
            self._data += self._document.buffer(index)
        for view in self._tree.get("bufferViews") or []:
            view["byteOffset"] = view.get("byteOffset", 0) + starts[view.get("buffer", 0)]
            view["buffer"] = 0

    def _view(self, data: bytes) -> int:
        self._data += b"\0" * (-len(self._data) % 4)
        views = self._tree.setdefault("bufferViews", [])
        views.append({"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data)})
        self._document.access.take(len(data), f"{self._document.path}: a copy of a buffer")
        self._data += data
        return len(views) - 1

    def _accessor(self, values: np.ndarray) -> int:
        code = 5125 if values.dtype.kind == "u" else 5126
        values = np.ascontiguousarray(values, "<u4" if code == 5125 else "<f4")
        entry: dict[str, Any] = {
            "bufferView": self._view(values.tobytes()),
            "componentType": code,
            "count": len(values),
        }
        entry["type"] = SHAPES[values.shape[1]]
        if values.shape[1] == 3 and len(values):
            entry["min"], entry["max"] = values.min(axis=0).tolist(), values.max(axis=0).tolist()
        self._tree.setdefault("accessors", []).append(entry)
        return len(self._tree["accessors"]) - 1

    def _write_mesh(self, mesh: dict[str, Any], given: dict[str, Any], weights: Any, matrices: Any) -> None:
        name = str(mesh.get("name") or "a mesh")
        primitives, mesh["primitives"] = mesh.get("primitives") or [], []
        for primitive, source in zip(primitives, given.get("primitives") or [], strict=True):
            mode = source.get("mode", TRIANGLES)
            if mode not in (POINTS, TRIANGLES, STRIP, FAN):
                self._collector.warn("has lines, which are not drawn", name)
                continue
            if "POSITION" not in (source.get("attributes") or {}):
                self._collector.warn("has a primitive without positions, which is not drawn", name)
                continue
            mesh["primitives"].append(primitive)
            primitive.setdefault("material", len(self._tree["materials"]) - 1)
            if COMPRESSED in (source.get("extensions") or {}):
                continue
            arrays = {
                key: self._document.accessor(index).astype(np.float32)
                for key, index in (source.get("attributes") or {}).items()
                if not key.startswith(("JOINTS_", "WEIGHTS_", "_"))
            }
            for weight, target in zip(weights or [], source.get("targets") or [], strict=False):
                for key, index in target.items():
                    if key in arrays and weight:
                        moved = self._document.accessor(index).astype(np.float32)
                        arrays[key][:, : moved.shape[1]] += np.float32(weight) * moved
            if matrices is not None:
                _skin(arrays, matrices(source))
            count = len(arrays.get("POSITION", ()))
            triangles = self._triangles(source, count, name)
            if triangles is not None:
                primitive["mode"] = TRIANGLES
                primitive["indices"] = self._accessor(triangles.reshape(-1, 1))
            elif "indices" in source:
                primitive["indices"] = self._accessor(self._document.accessor(source["indices"]).astype(np.uint32))
            arrays = laid(self._document.tree, source.get("material"), arrays, self._collector)
            primitive["attributes"] = {key: self._accessor(values) for key, values in arrays.items()}
            primitive.pop("targets", None)
        mesh.pop("weights", None)

    def _triangles(self, primitive: dict[str, Any], count: int, name: str) -> np.ndarray | None:
        """Corners of the primitive's triangles, (triangle, 3) uint32; None if it has none."""
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN):
            return None
        if "indices" in primitive:
            corners = self._document.accessor(primitive["indices"]).reshape(-1).astype(np.int64)
        else:
            corners = np.arange(count)
        if len(corners) and corners.max() >= count:
            raise WarpcamError(
                f"{self._document.path}: mesh '{name}': faces must be indices from 0 to {count - 1}, "
                f"got {corners.max()}"
            )
        if mode == TRIANGLES:
            return corners[: len(corners) // 3 * 3].reshape(-1, 3).astype(np.uint32)
        steps = np.arange(max(len(corners) - 2, 0))
        if mode == STRIP:
            places = np.stack((steps, steps + 1 + steps % 2, steps + 2 - steps % 2), axis=1)
        else:
            places = np.stack((steps + 1, steps + 2, np.zeros_like(steps)), axis=1)
        return corners[places].astype(np.uint32)

    def _rest(self, index: int, node: dict[str, Any]) -> None:
        """Give a node a mesh of its own where its weights or its skin make one."""
        weights, skin, place = node.get("weights"), node.pop("skin", None), node["mesh"]
        if (weights is None and skin is None) or not 0 <= place < len(self._given):
            return
        key = (place, None if weights is None else tuple(weights), skin, index if skin is not None else None)
        if key not in self._own:
            mesh = copy.deepcopy(self._given[place])
            chosen = weights if weights is not None else mesh.get("weights")
            joints = None if skin is None else self._joints(skin, index)
            matrices = None if joints is None else lambda source: self._blended(source, joints)
            self._write_mesh(mesh, self._given[place], chosen, matrices)
            self._tree["meshes"].append(mesh)
            self._own[key] = len(self._tree["meshes"]) - 1
        node["mesh"] = self._own[key]

    def _joints(self, skin: int, index: int) -> np.ndarray:
        """Matrices of a skin's joints at rest, (joint, 4, 4), to the frame of the node that has the mesh."""
        entry = self._document.listed("skins")[skin]
        joints = np.stack([self._world[joint] for joint in entry["joints"]])
        if "inverseBindMatrices" in entry:
            columns = self._document.accessor(entry["inverseBindMatrices"]).reshape(-1, 4, 4).astype(np.float64)
            joints = joints @ columns[: len(joints)].transpose(0, 2, 1)
        return np.linalg.pinv(self._world[index]) @ joints

    def _blended(self, primitive: dict[str, Any], joints: np.ndarray) -> np.ndarray:
        """A matrix for each vertex, (vertex, 4, 4)."""
        attributes = primitive.get("attributes") or {}
        total, matrices = np.zeros(1), np.zeros((1, 4, 4))
        for number in range(len(attributes)):
            if f"JOINTS_{number}" not in attributes or f"WEIGHTS_{number}" not in attributes:
                break
            which = self._document.accessor(attributes[f"JOINTS_{number}"]).astype(np.int64)
            weights = self._document.accessor(attributes[f"WEIGHTS_{number}"]).astype(np.float64)
            which = np.clip(which, 0, len(joints) - 1)
            matrices = matrices + np.einsum("vk,vkij->vij", weights, joints[which])
            total = total + weights.sum(axis=1)
        return np.where((total > 0.0)[:, None, None], matrices / np.maximum(total, 1e-12)[:, None, None], np.eye(4))

    def _hide(self) -> None:
        """Take meshes away from nodes that are not visible, and from all below those."""
        nodes = self._tree.get("nodes") or []
        hidden = [node for node in nodes if (extension(node, VISIBILITY) or {}).get("visible") is False]
        for node in hidden:  # grows
            node.pop("mesh", None)
            below = [nodes[child] for child in node.get("children") or [] if 0 <= child < len(nodes)]
            hidden += [child for child in below if not any(child is other for other in hidden)]

    def _spread(self, node: dict[str, Any]) -> None:
        """Make nodes of a node's instances."""
        found = (node.get("extensions") or {}).get(INSTANCES)
        if not isinstance(found, dict):
            return
        arrays = {key: self._document.accessor(index) for key, index in (found.get("attributes") or {}).items()}
        nodes, mesh = self._tree["nodes"], node.pop("mesh")
        count = max((len(values) for values in arrays.values()), default=0)
        self._document.access.check("copies", count, f"{self._document.path}: {INSTANCES}")
        for place in range(count):
            instance: dict[str, Any] = {"mesh": mesh, "name": f"{node.get('name') or 'instance'} {place}"}
            for key, word in (("TRANSLATION", "translation"), ("ROTATION", "rotation"), ("SCALE", "scale")):
                if key in arrays:
                    instance[word] = arrays[key][place].astype(float).tolist()
            nodes.append(instance)
            node.setdefault("children", []).append(len(nodes) - 1)


def _skin(arrays: dict[str, np.ndarray], matrices: np.ndarray) -> None:
    """Move positions and normals by a matrix for each vertex, in place."""
    linear = matrices[:, :3, :3]
    if "POSITION" in arrays:
        places = arrays["POSITION"].astype(np.float64)
        arrays["POSITION"] = np.asarray((linear @ places[..., None])[..., 0] + matrices[:, :3, 3], np.float32)
    if "NORMAL" in arrays:
        normals = (np.linalg.pinv(linear).transpose(0, 2, 1) @ arrays["NORMAL"].astype(np.float64)[..., None])[..., 0]
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        arrays["NORMAL"] = np.asarray(normals / np.maximum(length, 1e-12), np.float32)


def _world_matrices(nodes: list[dict[str, Any]]) -> list[np.ndarray]:
    """Matrices of all nodes at rest to the scene's frame."""
    parents = {child: place for place, node in enumerate(nodes) for child in node.get("children") or []}
    found: dict[int, np.ndarray] = {}

    def world(place: int, depth: int = 0) -> np.ndarray:
        if place not in found:
            local, parent = _local(nodes[place]), parents.get(place)
            above = np.eye(4) if parent is None or depth > len(nodes) else world(parent, depth + 1)
            found[place] = above @ local
        return found[place]

    return [world(place) for place in range(len(nodes))]


def _local(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.asarray(node["matrix"], np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    matrix[:3, :3] = rotation_matrices(np.array([[w, x, y, z]], np.float64))[0] * np.asarray(
        node.get("scale", (1, 1, 1))
    )
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix
