"""Materials of glTF files (glTF 2.0, section 3.9), with the extensions that change what is seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from warpcam.core.color import linear_to_srgb
from warpcam.core.numbers import is_finite_number
from warpcam.sources.common.images import (
    LINEAR,
    TRANSFER,
    UnreadableError,
    corner_colors,
    decoded,
    map_of_normals,
    packed,
    sharp,
)
from warpcam.sources.common.opacity import opacity_of
from warpcam.sources.common.scene_graph import Material, SceneGraph
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.files.gltf_document import Document
from warpcam.sources.files.gltf_textures import GLOSS, NEAREST, extension, is_unlit, sampler_of, textures_of, wrap_of
from warpcam.textures.pack import TextureImage

SOURCES = ("EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds", "KHR_texture_basisu")  # the better image first


@dataclass(frozen=True, eq=False)
class _Maps:
    """Pixels of a material's textures, (height, width, 1, 3 or 4) uint8, or None."""

    color: np.ndarray | None = None
    normals: np.ndarray | None = None
    rough: np.ndarray | None = None  # green: roughness, blue: metalness
    shade: np.ndarray | None = None
    glow: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class _Said:
    """A material without its opacity, and what that is made of."""

    look: Material
    maps: _Maps
    alpha: float
    mode: str
    cutoff: float
    two_sided: bool


class MaterialReader:
    """Reader of each material once, into a graph."""

    def __init__(self, document: Document, graph: SceneGraph, collector: WarningCollector):
        self._document, self._graph, self._collector = document, graph, collector
        self._said: dict[int, _Said] = {}
        self._looks: dict[int, int] = {}
        self._pixels: dict[tuple[int, bool], np.ndarray | None] = {}
        self._textures: dict[tuple[Any, ...], int] = {}

    def look(self, index: int, name: str, tint: np.ndarray | None, uvs: Any) -> tuple[int, Any, bool]:
        """Look, texture coordinates and whether both sides are seen, of a mesh with a material.

        Args:
            index: Of the material; one that the file has not is the default material.
            name: Of the mesh.
            tint: Colours of its corners, (face, 3, 4) linear, or None.
            uvs: Texture coordinates, (face, 3, 2), or None.
        """
        if index not in self._said:
            self._said[index] = self._read(index)
        said = self._said[index]
        base, blends = said.look, said.mode in ("MASK", "BLEND")
        even = tint is None or np.ptp(tint.reshape(-1, 4)[:, : 4 if blends else 3], axis=0).max() < 1.0 / 255.0
        if tint is not None and not even and max(base.texture, *base.maps) >= 0:
            self._collector.warn("has colours of corners beside textures, and is drawn without them", name)
            tint, even = None, True
        if tint is None:
            if index not in self._looks:
                self._looks[index] = self._kept(self._with_opacity(said, 1.0))
            return self._looks[index], uvs, said.two_sided
        if even:
            red, green, blue = (float(x) for x in tint[0, 0, :3] * base.color)
            look = replace(base, name=f"{name}/colors", color=(red, green, blue))
            return self._kept(self._with_opacity(replace(said, look=look), float(tint[0, 0, 3]))), uvs, said.two_sided
        shown = np.concatenate((linear_to_srgb(tint[..., :3]), tint[..., 3:] if blends else tint[..., :0]), axis=-1)
        image, uvs = corner_colors(np.rint(255.0 * shown).astype(np.uint8))
        look = replace(base, name=f"{name}/colors", texture=self._added(name, image[..., :3]))
        return self._kept(self._with_opacity(replace(said, look=look, maps=_Maps(image)), 1.0)), uvs, said.two_sided

    def _read(self, index: int) -> _Said:
        listed = self._document.listed("materials")
        said = _mapping(listed[index] if 0 <= index < len(listed) else None)
        name = str(said.get("name") or f"material {index}")
        plain, gloss = _mapping(said.get("pbrMetallicRoughness")), extension(said, GLOSS)
        normals, shade = _mapping(said.get("normalTexture")), _mapping(said.get("occlusionTexture"))
        factor, glow = _numbers(plain.get("baseColorFactor"), (1.0,) * 4), [0.0] * 3
        ior = _number(_mapping(extension(said, "KHR_materials_ior")).get("ior"), 1.5)
        numbers = {
            "roughness": _number(plain.get("roughnessFactor"), 1.0),
            "metallic": _number(plain.get("metallicFactor"), 1.0),
            "reflectance": ((1.0 - ior) / (1.0 + ior)) ** 2 if ior >= 0.0 else 0.04,
        }
        if is_unlit(said):
            maps = _Maps(color=self._shown(plain.get("baseColorTexture"), name))
        else:
            if gloss is None:
                maps = _Maps(
                    color=self._shown(plain.get("baseColorTexture"), name),
                    rough=self._shown(plain.get("metallicRoughnessTexture"), name),
                )
            else:
                maps, factor, numbers = self._glossy(gloss, name)
            maps = replace(
                maps,
                normals=self._shown(normals, name),
                shade=self._shown(shade, name),
                glow=self._shown(said.get("emissiveTexture"), name),
            )
            strong = _mapping(extension(said, "KHR_materials_emissive_strength")).get("emissiveStrength")
            glow = [_number(strong, 1.0) * value for value in _numbers(said.get("emissiveFactor"), (0.0,) * 3)]
        first = next(iter(textures_of(said)), None)
        look = Material(
            name,
            color=(factor[0], factor[1], factor[2]),
            roughness=numbers["roughness"],
            metallic=numbers["metallic"],
            reflectance=numbers["reflectance"],
            transmission=0.0 if is_unlit(said) else self._transmission(said, numbers["metallic"], maps, name),
            emission=(glow[0], glow[1], glow[2]),
            texture=self._texture(name, "color", maps.color),
            normals=self._normals(name, maps.normals, _number(normals.get("scale"), 1.0)),
            packed=self._packed(name, maps, _number(shade.get("strength"), 1.0)),
            emission_texture=self._texture(name, "glow", maps.glow),
            wrap=("repeat", "repeat") if first is None else wrap_of(self._document.tree, first),
            unlit=is_unlit(said),
        )
        mode, cutoff = str(said.get("alphaMode")), _number(said.get("alphaCutoff"), 0.5)
        return _Said(look, maps, factor[3], mode, cutoff, said.get("doubleSided") is True)

    def _transmission(self, said: Mapping[str, Any], metallic: float, maps: _Maps, name: str) -> float:
        """KHR_materials_transmission: the factor, of the share that is no metal, which lets no light through."""
        given = _mapping(extension(said, "KHR_materials_transmission"))
        factor = float(np.clip(_number(given.get("transmissionFactor"), 0.0), 0.0, 1.0))
        if factor > 0.0 and "transmissionTexture" in given:
            self._collector.warn("has a map of transmission, which is not read: its factor counts everywhere", name)
        if factor > 0.0 and maps.rough is not None:
            metal = _channels(maps.rough)[..., 2]
            metallic *= float(metal.mean())
            if np.ptp(metal) > 0.02:
                self._collector.warn("has transmission and a map of metalness, whose mean counts for it", name)
        if factor > 0.0 and not _number(_mapping(extension(said, "KHR_materials_volume")).get("thicknessFactor"), 0.0):
            self._collector.remark("has transmission without a thickness, and is drawn as a body that refracts", name)
        return factor * (1.0 - float(np.clip(metallic, 0.0, 1.0)))

    def _with_opacity(self, said: _Said, alpha: float) -> Material:
        """The look with its opacity, times that of a mesh."""
        if said.mode not in ("MASK", "BLEND"):
            return said.look
        cutoff = said.cutoff if said.mode == "MASK" else 0.0
        pixels = said.maps.color
        values = TRANSFER[pixels[..., 3]] if pixels is not None and pixels.shape[2] == 4 else None
        opacity, drawn = opacity_of(values, said.alpha * alpha, cutoff)
        index = -1 if drawn is None else self._added(f"{said.look.name}/opacity", drawn, color=False)
        return replace(said.look, opacity=opacity, cutoff=cutoff, opacity_map=index)

    def _glossy(self, gloss: Mapping[str, Any], name: str) -> tuple[_Maps, list[float], dict[str, float]]:
        """Maps, colour and numbers of KHR_materials_pbrSpecularGlossiness; reflections have no colour here."""
        smooth, rough = _number(gloss.get("glossinessFactor"), 1.0), None
        specular = np.array(_numbers(gloss.get("specularFactor"), (1.0,) * 3))
        pixels = self._shown(_mapping(gloss.get("specularGlossinessTexture")), name)
        if pixels is not None:
            rgb = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels[..., :3]
            specular = specular * LINEAR[rgb].mean(axis=(0, 1))
            rough = np.full((*pixels.shape[:2], 3), 255, np.uint8)
            alpha = pixels[..., 3] if pixels.shape[2] == 4 else 255
            rough[..., 1] = np.rint(255.0 - np.clip(smooth, 0.0, 1.0) * alpha)
        if pixels is not None or np.ptp(specular) > 0.02:
            self._collector.warn("has reflections with a colour or a map, and is drawn with the mean of both", name)
        maps = _Maps(color=self._shown(_mapping(gloss.get("diffuseTexture")), name), rough=rough)
        numbers = {"roughness": 1.0 - smooth if rough is None else 1.0, "metallic": 0.0}
        return maps, _numbers(gloss.get("diffuseFactor"), (1.0,) * 4), numbers | {"reflectance": float(specular.mean())}

    def _kept(self, look: Material) -> int:
        self._graph.materials.append(look)
        return len(self._graph.materials) - 1

    def _added(self, name: str, pixels: np.ndarray, color: bool = True) -> int:
        self._graph.textures.append(TextureImage("2d", np.ascontiguousarray(pixels), blend_light=color))
        self._graph.texture_names.append(name)
        return len(self._graph.textures) - 1

    def _texture(self, name: str, role: str, pixels: np.ndarray | None) -> int:
        key = (role, id(pixels))
        if pixels is not None and key not in self._textures:
            self._textures[key] = self._added(name, pixels)
        return -1 if pixels is None else self._textures[key]

    def _normals(self, name: str, pixels: np.ndarray | None, scale: float) -> int:
        key = ("normals", id(pixels), scale)
        if pixels is not None and key not in self._textures:
            rgb = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels[..., :3]
            if scale != 1.0:
                rgb = map_of_normals((rgb / 127.5 - 1.0) * (scale, scale, 1.0))
            self._textures[key] = self._added(name, rgb, color=False)
        return -1 if pixels is None else self._textures[key]

    def _packed(self, name: str, maps: _Maps, strength: float) -> int:
        """Index of the map of occlusion, roughness and metalness, or -1."""
        key = ("packed", id(maps.rough), id(maps.shade), strength)
        if key not in self._textures:
            rough = None if maps.rough is None else _channels(maps.rough)
            shade = None if maps.shade is None else 1.0 + strength * (_channels(maps.shade)[..., 0] - 1.0)
            image = packed([shade, *((None, None) if rough is None else (rough[..., 1], rough[..., 2]))])
            self._textures[key] = -1 if image is None else self._added(name, image, color=False)
        return self._textures[key]

    def _shown(self, info: Any, name: str) -> np.ndarray | None:
        """Pixels of a texture, as its sampler shows them; None if there are none, which is told."""
        index = _mapping(info).get("index")
        if isinstance(index, bool) or not isinstance(index, int):
            return None
        is_sharp = sampler_of(self._document.tree, index).get("magFilter") == NEAREST
        key = index, is_sharp
        if key not in self._pixels:
            pixels = self._image(index, name)
            self._pixels[key] = sharp(pixels) if pixels is not None and is_sharp else pixels
        return self._pixels[key]

    def _image(self, index: int, name: str) -> np.ndarray | None:
        """Pixels of a texture's first image that can be read."""
        textures, images = self._document.listed("textures"), self._document.listed("images")
        texture = _mapping(textures[index] if 0 <= index < len(textures) else None)
        faults = []
        for place in (*(_mapping(extension(texture, key)).get("source") for key in SOURCES), texture.get("source")):
            image = _mapping(images[place] if isinstance(place, int) and 0 <= place < len(images) else None)
            if not image:
                continue
            uri = image.get("uri")
            data = self._document.bytes_of(uri) if uri is not None else self._document.view(image.get("bufferView"))
            try:
                if data is None:
                    raise UnreadableError(f"{str(uri)[:200]}: no such file")
                named = f"{self._document.path}: image {place}" if uri is None or uri.startswith("data:") else uri
                return decoded(data, self._document.access, named)
            except UnreadableError as error:
                faults.append(str(error))
        reason = "; ".join(dict.fromkeys(faults)) or "it names no image"
        what = f"has a texture that cannot be read ({reason}), and is drawn in its base colour"
        self._collector.warn(what, name)
        return None


def tint_of(colors: Any, count: int) -> np.ndarray | None:
    """Colours of vertices, (count, 4) linear with alpha; None if there are none, or all are white and solid."""
    array: Any = np.asarray(colors) if colors is not None else np.zeros(0)
    if array.ndim != 2 or len(array) != count or array.shape[1] < 3:
        return None
    most = np.iinfo(array.dtype).max if np.issubdtype(array.dtype, np.integer) else 1.0
    tint = np.ones((count, 4))
    tint[:, : array.shape[1]] = np.clip(np.nan_to_num(array[:, :4].astype(np.float64) / most), 0.0, 1.0)
    return None if tint.min(initial=1.0) == 1.0 else tint


def _channels(pixels: np.ndarray) -> np.ndarray:
    """(height, width, 3) in [0, 1]."""
    return TRANSFER[np.repeat(pixels, 3, axis=-1) if pixels.shape[2] == 1 else pixels[..., :3]]


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _number(value: Any, default: float) -> float:
    return float(value) if is_finite_number(value) else default


def _numbers(value: Any, default: Sequence[float]) -> list[float]:
    """Numbers of a list of that length at least, or the default."""
    if not isinstance(value, list | tuple | np.ndarray) or len(value) < len(default):
        return list(default)
    return [_number(value[place], usual) for place, usual in enumerate(default)]
