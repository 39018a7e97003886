"""Features of glTF files that are not drawn: trimesh, which reads the files, ignores them silently."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.sources.common.warnings import WarningCollector

MAGIC = b"glTF"
HEADER = 12  # bytes before the first chunk, and 8 before what that holds
# Extensions that are read, or told of by what they change.
READ = (
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "EXT_texture_webp",
    "EXT_mesh_gpu_instancing",
    "KHR_texture_transform",  # told of by the materials that it moves
    "KHR_lights_punctual",  # told of if there are any
)
# Extensions that a file may need: read, or without change to shapes and base colours.
KNOWN = (
    "EXT_mesh_gpu_instancing",
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "EXT_texture_webp",
    "KHR_materials_",
    "KHR_lights_",
)
MOVES = "KHR_texture_transform"
UNREAD = ("cameras", "lights", "animations", "skins")
TELLING = ("baseColorTexture", "metallicRoughnessTexture", "normalTexture", "occlusionTexture", "emissiveTexture")


def tell(path: Path, collector: WarningCollector) -> None:
    """Warn of it, by the names of the materials.

    Raises:
        WarpcamError: The file needs an extension that is not known.
    """
    tree = _tree(path)
    needed = [str(name) for name in _listed(tree, "extensionsRequired")]
    unknown = [name for name in needed if name != MOVES and not name.startswith(KNOWN)]
    if unknown:
        raise WarpcamError(f"{path}: needs extensions of glTF that are not read here: {', '.join(unknown)}")
    unused = [name for name in _listed(tree, "extensionsUsed") if str(name) not in READ]
    unused = [str(name) for name in unused if name not in _listed(tree, "extensionsRequired")]
    if unused:
        collector.warn("uses extensions of glTF that are not drawn", ", ".join(unused))
    for place, material in enumerate(_listed(tree, "materials")):
        where = str(material.get("name") or f"material {place}") if isinstance(material, Mapping) else ""
        for texture in _textures(material):
            extensions = texture.get("extensions")
            moved = extensions.get(MOVES) if isinstance(extensions, Mapping) else None
            moved = moved if isinstance(moved, Mapping) else {}
            if {"offset", "rotation", "scale"} & set(moved):
                collector.warn("has a texture that KHR_texture_transform moves, and is laid on as if it did not", where)
            if moved.get("texCoord", texture.get("texCoord", 0)):
                collector.warn(
                    "has a texture for other texture coordinates than its first, and is laid on by these", where
                )

    extensions = tree.get("extensions")
    lit = extensions.get("KHR_lights_punctual") if isinstance(extensions, Mapping) else None
    for kind in UNREAD:
        if _listed(lit if kind == "lights" else tree, kind):
            collector.warn("has things of glTF that are not read", kind)


def _listed(tree: Any, name: str) -> list[Any]:
    found = tree.get(name) if isinstance(tree, Mapping) else None
    return found if isinstance(found, list) else []


def _textures(material: Any) -> Iterator[Mapping[str, Any]]:
    parts: list[Any] = [material, material.get("pbrMetallicRoughness")] if isinstance(material, Mapping) else []
    for part in parts:
        for name in TELLING:
            texture = part.get(name) if isinstance(part, Mapping) else None
            if isinstance(texture, Mapping):
                yield texture


def _tree(path: Path) -> Mapping[str, Any]:
    """The file's description; empty if there is none that can be read."""
    data = path.read_bytes()
    if data[:4] == MAGIC:
        length = int.from_bytes(data[HEADER : HEADER + 4], "little")
        data = data[HEADER + 8 : HEADER + 8 + length]
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return tree if isinstance(tree, Mapping) else {}
