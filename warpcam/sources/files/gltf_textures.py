"""Texture coordinates of glTF's materials: which set a texture has, and how KHR_texture_transform moves it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from warpcam.sources.common.warnings import WarningCollector

TRANSFORM = "KHR_texture_transform"
REPEAT = 10497
NEAREST = (9728, 9984, 9986)
WAYS = ("baseColorTexture", "metallicRoughnessTexture", "normalTexture", "occlusionTexture", "emissiveTexture")


def laid(
    tree: Mapping[str, Any], material: Any, arrays: dict[str, np.ndarray], collector: WarningCollector
) -> dict[str, np.ndarray]:
    """Attributes with one set of texture coordinates, TEXCOORD_0: that of the material's textures, moved as they are.

    A material whose textures lie differently has all as its first, and is told.
    """
    sets = {key: values for key, values in arrays.items() if key.startswith("TEXCOORD_")}
    rest = {key: values for key, values in arrays.items() if key not in sets}
    materials = tree.get("materials") or []
    if not sets or isinstance(material, bool) or not isinstance(material, int) or not 0 <= material < len(materials):
        return rest | {key: values for key, values in sets.items() if key == "TEXCOORD_0"}
    name = str(materials[material].get("name") or f"material {material}")
    ways = [_way(texture) for texture in textures_of(materials[material])]
    if not ways:
        return rest | {key: values for key, values in sets.items() if key == "TEXCOORD_0"}
    if any(way != ways[0] for way in ways):
        collector.warn("has textures that lie differently, and is drawn with all as the first", name)
    place, offset, rotation, scale = ways[0]
    chosen = sets.get(f"TEXCOORD_{place}")
    if chosen is None:
        collector.warn(f"has a texture for texture coordinates {place}, which a mesh has not", name)
        return rest
    c, s = np.cos(rotation), np.sin(rotation)
    turn = np.array(((c, s), (-s, c)))  # counter-clockwise where v runs down
    moved = np.asarray((chosen * np.asarray(scale)) @ turn.T + np.asarray(offset), np.float32)
    _tell_sampler(tree, materials[material], moved, name, collector)
    return rest | {"TEXCOORD_0": moved}


def textures_of(material: Any) -> list[Mapping[str, Any]]:
    """The texture infos of a material, its base colour's first."""
    parts = [material.get("pbrMetallicRoughness"), material] if isinstance(material, Mapping) else []
    found = [part.get(way) for way in WAYS for part in parts if isinstance(part, Mapping)]
    return [texture for texture in found if isinstance(texture, Mapping)]


def _way(texture: Mapping[str, Any]) -> tuple[int, tuple[float, ...], float, tuple[float, ...]]:
    """Set of texture coordinates, offset, rotation [radians] and scale of a texture."""
    extensions = texture.get("extensions")
    moved = extensions.get(TRANSFORM) if isinstance(extensions, Mapping) else None
    moved = moved if isinstance(moved, Mapping) else {}
    offset, scale = (tuple(map(float, moved.get(key, usual))) for key, usual in (("offset", (0, 0)), ("scale", (1, 1))))
    return int(moved.get("texCoord", texture.get("texCoord", 0))), offset, float(moved.get("rotation", 0.0)), scale


def _tell_sampler(
    tree: Mapping[str, Any], material: Any, uvs: np.ndarray, name: str, collector: WarningCollector
) -> None:
    """Warn of textures that do not repeat where their images end, and of those that are not smoothed."""
    textures, samplers = tree.get("textures") or [], tree.get("samplers") or []
    for info in textures_of(material):
        index = info.get("index")
        entry = textures[index] if isinstance(index, int) and 0 <= index < len(textures) else {}
        place = entry.get("sampler")
        sampler = samplers[place] if isinstance(place, int) and 0 <= place < len(samplers) else {}
        beyond = bool(len(uvs)) and (uvs.min() < -1e-3 or uvs.max() > 1.001)
        if beyond and {sampler.get("wrapS", REPEAT), sampler.get("wrapT", REPEAT)} != {REPEAT}:
            collector.warn("has a texture that does not repeat, and is drawn repeated", name)
        if sampler.get("magFilter") in NEAREST:
            collector.warn("has a texture that is not to be smoothed, and is", name)
