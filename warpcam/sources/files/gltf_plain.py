"""glTF files made plain for trimesh, which uses stored numbers as they are: accessors decoded by glTF 2.0, 3.6.2."""

import base64
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from urllib.parse import unquote

import numpy as np

from warpcam.core.errors import WarpcamError

TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
FLOAT = 5126
MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", b"JSON", b"BIN\0"
DATA = "data:"
STRIP, FAN = 5, 6
MORPHED = {"POSITION", "NORMAL"}
INSTANCES = "EXT_mesh_gpu_instancing"
MOVES = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
DRACO = "KHR_draco_mesh_compression"


def plain(data: bytes, get: Callable[[str], bytes]) -> bytes:
    """GLB file with the content of a glTF file of either kind: one buffer, decoded numbers, lists of triangles.

    Args:
        data: The file.
        get: Bytes of a file beside it, by a name without percent signs.
    """
    tree, binary = _parts(data)
    blob, starts = bytearray(), []
    for place, buffer in enumerate(tree.get("buffers", [])):
        blob.extend(b"\0" * (-len(blob) % 4))
        starts.append(len(blob))
        uri = buffer.get("uri")
        blob.extend(bytes_of(uri, get) if uri is not None else binary if place == 0 else b"")
    for view in tree.get("bufferViews", []):
        view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
        view["buffer"] = 0
    for image in tree.get("images", []):
        if "uri" in image and not image["uri"].startswith(DATA):
            image["uri"] = unquote(image["uri"])
    file = _File(tree, blob)
    packed = DRACO in tree.get("extensionsUsed", [])  # its accessors have no numbers of their own
    for place, accessor in enumerate(tree.get("accessors", [])):
        scaled = accessor.get("normalized") and accessor["componentType"] != FLOAT
        if accessor.get("type") in SIZES and (
            scaled or "sparse" in accessor or ("bufferView" not in accessor and not packed)
        ):
            file.replace(place, file.values(accessor))
    file.deform()
    file.instance()
    for mesh in tree.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            if primitive.get("mode") in (STRIP, FAN):
                file.list_triangles(primitive)
    if blob:
        tree["buffers"] = [{"byteLength": len(blob)}]
    return _glb(tree, bytes(blob))


def bytes_of(uri: str, get: Callable[[str], bytes]) -> bytes:
    if not uri.startswith(DATA):
        return get(unquote(uri))
    head, _, body = uri.partition(",")
    return base64.b64decode(unquote(body)) if head.endswith(";base64") else unquote(body).encode("latin-1")


class _File:
    def __init__(self, tree: dict[str, Any], blob: bytearray):
        self._tree, self._blob = tree, blob

    def values(self, accessor: Mapping[str, Any]) -> np.ndarray:
        """Numbers of an accessor, (count, components): floats where they are normalized."""
        dtype, size, count = np.dtype(TYPES[accessor["componentType"]]), SIZES[accessor["type"]], accessor["count"]
        array = np.zeros((count, size), dtype)
        if "bufferView" in accessor:
            array = self._stored(accessor["bufferView"], accessor.get("byteOffset", 0), dtype, count, size)
        sparse = accessor.get("sparse")
        if sparse:
            where, given = sparse["indices"], sparse["values"]
            kind = np.dtype(TYPES[where["componentType"]])
            rows = self._stored(where["bufferView"], where.get("byteOffset", 0), kind, sparse["count"], 1)[:, 0]
            if len(rows) and rows.max() >= count:
                raise WarpcamError(f"sparse accessor: indices must be below {count}, got {rows.max()}")
            array[rows] = self._stored(given["bufferView"], given.get("byteOffset", 0), dtype, sparse["count"], size)
        if accessor.get("normalized") and dtype.kind in "iu":
            return np.maximum(array / np.float64(np.iinfo(dtype.str).max), -1.0).astype(np.float32)
        return array

    def _stored(self, place: int, offset: int, dtype: np.dtype[Any], count: int, size: int) -> np.ndarray:
        view = self._tree["bufferViews"][place]
        step, first = view.get("byteStride", dtype.itemsize * size), view["byteOffset"] + offset
        if count and first + step * (count - 1) + dtype.itemsize * size > len(self._blob):
            raise WarpcamError(
                f"bufferView {place}: {count} elements go past the {len(self._blob)} bytes of its buffer"
            )
        stored = np.ndarray((count, size), dtype.newbyteorder("<"), self._blob, first, (step, dtype.itemsize))
        return stored.astype(dtype)

    def replace(self, place: int, array: np.ndarray) -> None:
        accessor = self._tree["accessors"][place]
        for key in ("sparse", "normalized", "byteOffset", "min", "max"):
            accessor.pop(key, None)
        self._blob.extend(b"\0" * (-len(self._blob) % 4))
        view = {"buffer": 0, "byteOffset": len(self._blob), "byteLength": array.nbytes}
        self._blob.extend(array.tobytes())
        self._tree["bufferViews"] = [*self._tree.get("bufferViews", []), view]
        accessor["bufferView"] = len(self._tree["bufferViews"]) - 1
        accessor["componentType"] = next(code for code, kind in TYPES.items() if np.dtype(kind) == array.dtype)

    def append(self, array: np.ndarray) -> int:
        """Index of a new accessor, of (count, components) numbers."""
        kind = next(name for name, size in SIZES.items() if size == array.shape[1])
        self._tree.setdefault("accessors", []).append({"type": kind, "count": len(array)})
        self.replace(len(self._tree["accessors"]) - 1, array)
        return len(self._tree["accessors"]) - 1

    def deform(self) -> None:
        """Add morph targets by their weights at rest: those of a node, else those of its mesh."""
        meshes = self._tree.get("meshes", [])
        for node in self._tree.get("nodes", []):
            if "mesh" not in node or not any(part.get("targets") for part in meshes[node["mesh"]]["primitives"]):
                continue
            mesh = meshes[node["mesh"]]
            weights = node.get("weights", mesh.get("weights", []))
            meshes.append({**mesh, "primitives": [self._deformed(part, weights) for part in mesh["primitives"]]})
            node["mesh"] = len(meshes) - 1

    def _deformed(self, primitive: Mapping[str, Any], weights: Sequence[float]) -> dict[str, Any]:
        attributes, accessors = dict(primitive["attributes"]), self._tree["accessors"]
        for name in MORPHED & set(attributes):
            moves = [
                weight * self.values(accessors[target[name]])
                for weight, target in zip(weights, primitive.get("targets", []), strict=False)
                if weight and name in target
            ]
            if moves:
                attributes[name] = self.append(
                    (self.values(accessors[attributes[name]]) + sum(moves)).astype(np.float32)
                )
        return {**primitive, "attributes": attributes}

    def instance(self) -> None:
        """Put a node below each with EXT_mesh_gpu_instancing for each of its instances."""
        nodes = self._tree.get("nodes", [])
        for node in list(nodes):
            given = node.get("extensions", {}).get(INSTANCES, {}).get("attributes", {})
            places = {MOVES[name]: self.values(self._tree["accessors"][given[name]]) for name in MOVES if name in given}
            if not places or "mesh" not in node:
                continue
            mesh, first = node.pop("mesh"), len(nodes)
            nodes.extend(
                {"mesh": mesh, **{name: [float(x) for x in rows[at]] for name, rows in places.items()}}
                for at in range(min(map(len, places.values())))
            )
            node["children"] = [*node.get("children", []), *range(first, len(nodes))]

    def list_triangles(self, primitive: dict[str, Any]) -> None:
        accessors = self._tree["accessors"]
        if "indices" in primitive:
            line = self.values(accessors[primitive["indices"]])[:, 0].astype(np.uint32)
        else:
            line = np.arange(accessors[primitive["attributes"]["POSITION"]]["count"], dtype=np.uint32)
        at = np.arange(max(len(line) - 2, 0))
        if primitive["mode"] == FAN:
            corners = np.stack((at + 1, at + 2, 0 * at), axis=1)
        else:
            corners = np.stack((at, at + 1 + at % 2, at + 2 - at % 2), axis=1)
        indices = line[corners].reshape(-1, 1)
        primitive["indices"], primitive["mode"] = self.append(indices), 4


def _parts(data: bytes) -> tuple[dict[str, Any], bytes]:
    if data[:4] != MAGIC:
        return dict(json.loads(data)), b""
    parts: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length = int.from_bytes(data[at : at + 4], "little")
        parts.setdefault(data[at + 4 : at + 8], data[at + 8 : at + 8 + length])
        at += 8 + length
    return dict(json.loads(parts[JSON_CHUNK])), parts.get(BINARY_CHUNK, b"")


def _glb(tree: Mapping[str, Any], blob: bytes) -> bytes:
    text = json.dumps(tree).encode()
    text, blob = text + b" " * (-len(text) % 4), blob + b"\0" * (-len(blob) % 4)
    parts = len(text).to_bytes(4, "little") + JSON_CHUNK + text
    if blob:
        parts += len(blob).to_bytes(4, "little") + BINARY_CHUNK + blob
    return MAGIC + (2).to_bytes(4, "little") + (12 + len(parts)).to_bytes(4, "little") + parts
