"""Texture coordinates of glTF's materials: which set a texture has, and how KHR_texture_transform moves it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from warpcam.sources.common.warnings import WarningCollector

TRANSFORM = "KHR_texture_transform"
GLOSS = "KHR_materials_pbrSpecularGlossiness"
UNLIT = "KHR_materials_unlit"
REPEAT, NEAREST = 10497, 9728
WRAPS = {33071: "clamp", 33648: "mirror"}  # all else repeats
COLORS, GLOSSY = ("baseColorTexture", "metallicRoughnessTexture"), ("diffuseTexture", "specularGlossinessTexture")
OTHERS = ("normalTexture", "occlusionTexture", "emissiveTexture")


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
    textures = textures_of(materials[material])
    if not textures:
        return rest | {key: values for key, values in sets.items() if key == "TEXCOORD_0"}
    ways = [_way(texture) for texture in textures]
    place, offset, rotation, scale = ways[0]
    chosen = sets.get(f"TEXCOORD_{place}")
    if chosen is None:
        collector.warn(f"has a texture for texture coordinates {place}, which a mesh has not", name)
        return rest
    c, s = np.cos(rotation), np.sin(rotation)
    turn = np.array(((c, s), (-s, c)))  # counter-clockwise where v runs down
    moved = np.asarray((chosen * np.asarray(scale)) @ turn.T + np.asarray(offset), np.float32)
    beyond = bool(len(moved)) and (moved.min() < -1e-3 or moved.max() > 1.001)
    wraps = {wrap_of(tree, texture) for texture in textures}
    if any(way != ways[0] for way in ways) or (beyond and len(wraps) > 1):
        collector.warn("has textures that lie differently, and is drawn with all as the first", name)
    return rest | {"TEXCOORD_0": moved}


def extension(entry: Any, name: str) -> Mapping[str, Any] | None:
    """Return the content of an extension of an entry, or None."""
    found = entry.get("extensions") if isinstance(entry, Mapping) else None
    said = found.get(name) if isinstance(found, Mapping) else None
    return said if isinstance(said, Mapping) else None


def is_unlit(material: Any) -> bool:
    """Return True if a material shows its base colour whatever the light is."""
    return extension(material, UNLIT) is not None


def textures_of(material: Any) -> list[Mapping[str, Any]]:
    """The texture infos of a material that are drawn, its colour's first."""
    if not isinstance(material, Mapping):
        return []
    gloss, unlit = extension(material, GLOSS), is_unlit(material)
    first = material.get("pbrMetallicRoughness") if gloss is None or unlit else gloss
    keys = COLORS[:1] if unlit else COLORS if gloss is None else GLOSSY
    found = [first.get(key) for key in keys] if isinstance(first, Mapping) else []
    found += [material.get(key) for key in OTHERS if not unlit]
    return [texture for texture in found if isinstance(texture, Mapping)]


def sampler_of(tree: Mapping[str, Any], index: Any) -> Mapping[str, Any]:
    """The sampler of a texture."""
    return _listed(tree, "samplers", _listed(tree, "textures", index).get("sampler"))


def _listed(tree: Mapping[str, Any], name: str, index: Any) -> Mapping[str, Any]:
    entries = tree.get(name)
    if not isinstance(entries, list) or not isinstance(index, int) or not 0 <= index < len(entries):
        return {}
    return entries[index] if isinstance(entries[index], Mapping) else {}


def wrap_of(tree: Mapping[str, Any], texture: Mapping[str, Any]) -> tuple[str, str]:
    """Return the wrap modes of a texture info's image along u and v."""
    sampler = sampler_of(tree, texture.get("index"))
    first, second = (WRAPS.get(sampler.get(key, REPEAT), "repeat") for key in ("wrapS", "wrapT"))
    return first, second


def _way(texture: Mapping[str, Any]) -> tuple[int, tuple[float, ...], float, tuple[float, ...]]:
    """Set of texture coordinates, offset, rotation [radians] and scale of a texture."""
    extensions = texture.get("extensions")
    moved = extensions.get(TRANSFORM) if isinstance(extensions, Mapping) else None
    moved = moved if isinstance(moved, Mapping) else {}
    offset, scale = (tuple(map(float, moved.get(key, usual))) for key, usual in (("offset", (0, 0)), ("scale", (1, 1))))
    return int(moved.get("texCoord", texture.get("texCoord", 0))), offset, float(moved.get("rotation", 0.0)), scale
