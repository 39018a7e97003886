"""Materials of a stage: UsdPreviewSurface, and Omniverse's OmniPBR by the inputs that say the same."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Ar, Sdf, Usd, UsdGeom, UsdShade

from warpcam.core.color import linear_to_srgb
from warpcam.sources.common import materials
from warpcam.sources.common.images import (
    ENCODED,
    LINEAR,
    TRANSFER,
    UnreadableError,
    cube_of_panorama,
    decoded,
    map_of_normals,
    packed,
)
from warpcam.sources.common.opacity import opacity_of
from warpcam.sources.common.scene_graph import Material, SceneGraph
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.common.wrapped_looks import WrappedLooks
from warpcam.sources.usd.omnipbr import OmniInputs
from warpcam.sources.usd.shader import OMNI, PREVIEW, color_or, number_or, surface_of, value_of
from warpcam.sources.usd.texture import TextureInput, alike, count_of, file_bytes, identity, is_numbers
from warpcam.textures.pack import TextureImage

CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3}
COMPONENTS = {"color": 3, "emission": 3, "normal": 3}  # of inputs; of others 1
PACKED = ("occlusion", "roughness", "metallic")  # in the order of their channels


@dataclass(frozen=True, eq=False)
class BoundMaterial:
    """A material as a prim has it.

    Attributes:
        look: Index of its look, or -1.
        uv: Name of the primvar that its texture is laid on by; "" if any will do.
        uv_turn: (2, 3), what is done to texture coordinates.
        by_color: The shape's display colour is the material's.
        by_opacity: Its display opacity is.
    """

    look: int = -1
    uv: str = ""
    uv_turn: np.ndarray | None = None
    by_color: bool = True
    by_opacity: bool = True


class MaterialReader:
    """Reads each material once, and keeps what they show in a graph."""

    def __init__(self, graph: SceneGraph, collector: WarningCollector):
        self._graph, self._collector = graph, collector
        self._bound: dict[Sdf.Path, BoundMaterial] = {}
        self._pixels: dict[str, np.ndarray | None] = {}
        self._textures: dict[tuple[Any, ...], int] = {}
        self._packed: dict[tuple[Any, ...], int] = {}
        self.wrapped = WrappedLooks(graph)
        self._skies: dict[tuple[Any, ...], np.ndarray | None] = {}
        self.inherited: dict[str, np.ndarray] = {}  # of the point instance that is read: displayColor, displayOpacity

    def bound_to(self, prim: Usd.Prim) -> BoundMaterial:
        """The material of a prim or a subset of one."""
        api = UsdShade.MaterialBindingAPI(prim)
        material = api.ComputeBoundMaterial(UsdShade.Tokens.preview)[0]
        if not material:
            material = api.ComputeBoundMaterial(UsdShade.Tokens.full)[0]
        if not material:
            return BoundMaterial()
        prim = material.GetPrim()
        path = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
        if path not in self._bound:
            self._bound[path] = self._read(material)
        return self._bound[path]

    def of_solid(self, prim: Usd.Prim, time: Usd.TimeCode) -> tuple[tuple[float, float, float, float] | None, int]:
        """Colour and look of a shape of one colour."""
        bound = self.bound_to(prim)
        return self.own_color(bound, prim, time), bound.look

    def own_color(
        self, bound: BoundMaterial, prim: Usd.Prim, time: Usd.TimeCode
    ) -> tuple[float, float, float, float] | None:
        """Return a prim's own colour and opacity, linear, with its material's where the prim has none.

        None: all from the material.
        """
        if not bound.by_color and not bound.by_opacity:
            return None
        red, green, blue, opacity = self._display_color(prim, time)
        if bound.look < 0:
            return red, green, blue, opacity
        look = self._graph.materials[bound.look]
        opacity = opacity_of(None, opacity, look.cutoff)[0] if bound.by_opacity else look.opacity
        return (red, green, blue, opacity) if bound.by_color else (*look.color, opacity)

    def _display_color(self, prim: Usd.Prim, time: Usd.TimeCode) -> tuple[float, float, float, float]:
        """The one display colour and opacity of a prim, the mean if it has several, linear."""
        found = []
        for name, default in (("displayColor", materials.BARE), ("displayOpacity", (1.0,))):
            primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
            values = primvar.Get(time) if primvar and primvar.HasValue() else self.inherited.get(name)
            if primvar and primvar.ValueMightBeTimeVarying():
                self._collector.warn(
                    f"has {name} that changes with time, and keeps what it has at first", str(prim.GetPath())
                )
            values = (
                np.asarray(values, np.float64).reshape(-1, len(default)) if values is not None else np.zeros((0, 1))
            )
            found += [float(x) for x in (values.mean(axis=0) if len(values) else default)]
        return found[0], found[1], found[2], found[3]

    def painted(self, look: int, pixels: np.ndarray, name: str) -> int:
        """A look like that one, with colours of its own, (height, width, 3) uint8 display values."""
        texture = self._add_texture(name, pixels)
        base = self._graph.materials[look] if look >= 0 else Material(name)
        own = replace(base, name=f"{name}/displayColor", color=materials.WHITE, texture=texture)
        own = replace(own, normals=-1, packed=-1, emission_texture=-1, opacity_map=-1)  # they lie by other coordinates
        self._graph.materials.append(own)
        return len(self._graph.materials) - 1

    def mean_of(self, asset: Sdf.AssetPath, where: str) -> np.ndarray | None:
        """The mean linear colour of an image, (3,); None if it cannot be read."""
        pixels = self._load(asset, "", where)
        return None if pixels is None else LINEAR[_rgb(pixels)].mean(axis=(0, 1))

    def sky_of(self, asset: Sdf.AssetPath, where: str, turn: np.ndarray) -> np.ndarray | None:
        """Terms of a dome's image, see ``native/shading/environment.h``; None if it cannot be read."""
        key = (asset.resolvedPath or asset.path, turn.tobytes())
        if key not in self._skies:
            pixels = self._load(asset, "", where)
            self._skies[key] = None if pixels is None else materials.sky_of_panorama(_rgb(pixels), turn)
        return self._skies[key]

    def add_skybox(self, prim: Usd.Prim, time: Usd.TimeCode, turn: np.ndarray) -> None:
        """Show a dome's image behind everything; ``turn`` (3, 3) is from the dome's axes to the world's."""
        asset = prim.GetAttribute("inputs:texture:file").Get(time)
        if asset is None or not asset.path or self._graph.skybox >= 0:
            return
        pixels = self._load(asset, "", str(prim.GetPath()))
        if pixels is not None:
            self._graph.skybox = len(self._graph.textures)
            self._graph.textures.append(cube_of_panorama(_rgb(pixels), turn))
            self._graph.texture_names.append(asset.path)

    def _read(self, material: UsdShade.Material) -> BoundMaterial:
        name = str(material.GetPath())
        surface, inputs = surface_of(material)
        if surface is None:
            self._collector.warn("has no surface that is known here, and shows the shapes' display colours", name)
            return BoundMaterial()
        values: dict[str, Any] = {}
        textures: dict[str, TextureInput] = {}
        by_color = by_opacity = False
        for what, (constant, texture) in inputs.items():
            for source in (constant, texture):
                given = surface.GetInput(source) if source else None
                if not given:
                    continue
                value, reader, primvar = value_of(given, self._collector)
                if reader is not None:
                    textures[what] = reader
                    if what == "color" and source == constant:  # the base colour, where its texture is missing
                        values[what] = given.GetAttr().Get()
                elif primvar:
                    by_color |= what == "color" and primvar == "displayColor"
                    by_opacity |= what == "opacity" and primvar == "displayOpacity"
                elif value is not None and not isinstance(value, Sdf.AssetPath):
                    count = COMPONENTS.get(what, 1)
                    if is_numbers(value, count):
                        values[what] = value
                    else:
                        self._collector.warn(f"has {source} that is not {count_of(count)}, and is left out", name)
        omni = OmniInputs(surface, self._collector, name) if inputs is OMNI else None
        if omni is not None:
            textures = omni.textures(textures, values)
        ior = max(number_or(values.get("ior"), 1.5), 0.0)
        look = Material(
            name,
            color=color_or(values.get("color"), (0.18, 0.18, 0.18) if inputs is PREVIEW else (0.2, 0.2, 0.2)),
            roughness=number_or(values.get("roughness"), 0.5),
            metallic=number_or(values.get("metallic"), 0.0),
            reflectance=((1.0 - ior) / (1.0 + ior)) ** 2,
            emission=color_or(values.get("emission") if omni is None else omni.emission(values), (0.0, 0.0, 0.0)),
        )
        if inputs is PREVIEW and "emission" in textures:  # which takes the constant's place
            look = replace(look, emission=materials.WHITE)
        look = self._with_maps(look, textures, name)
        if omni is not None:
            red, green, blue = (float(channel) for channel in look.color * omni.tint())
            look = replace(look, color=(red, green, blue))
        look = self._with_opacity(look, surface, inputs, values, textures, name)
        uv, turn = "", None
        laid = next((textures[what] for what in ("color", "normal", "roughness", *textures) if what in textures), None)
        if laid is not None:
            look = replace(look, wrap=laid.wrap)
            uv, turn = laid.uv, laid.uv_turn
            if any(not alike(laid, other) for other in textures.values()):
                self._collector.remark("has textures that lie in different ways, which are all laid as the first", name)
        self._graph.materials.append(look)
        return BoundMaterial(len(self._graph.materials) - 1, uv, turn, by_color, by_opacity)

    def _with_maps(self, look: Material, textures: Mapping[str, TextureInput], name: str) -> Material:
        """The look with its textures, each a factor of the look's own value, which it replaces."""
        shown = textures.get("color")
        if shown is not None:
            index = self._texture(shown, name)
            if index >= 0:
                look = replace(look, texture=index, color=materials.WHITE)
            else:
                look = replace(
                    look, color=color_or(shown.fallback[:3] if shown.fallback[:3].any() else None, look.color)
                )
        glowing = textures.get("emission")
        if glowing is not None:
            index = self._texture(glowing, name)
            if index >= 0:
                look = replace(look, emission_texture=index)
            else:
                look = replace(look, emission=color_or(glowing.fallback[:3], (0.0, 0.0, 0.0)))
        if "normal" in textures:
            look = replace(look, normals=self._normals(textures["normal"], name))
        channels = {what: self._channel(textures[what], name) for what in PACKED if what in textures}
        for what, values in channels.items():
            if what != "occlusion":
                fallback = float(np.clip(textures[what].fallback[CHANNELS.get(textures[what].channel, 0)], 0.0, 1.0))
                look = replace(look, **{what: fallback if values is None else 1.0})  # type: ignore[arg-type]
        image = packed([channels.get(what) for what in PACKED])
        if image is not None:
            key = tuple(identity(textures[what]) if what in textures else None for what in PACKED)
            if key not in self._packed:
                self._packed[key] = self._add_texture(f"{name}/occlusion, roughness, metallic", image, color=False)
            look = replace(look, packed=self._packed[key])
        return look

    def _with_opacity(
        self,
        look: Material,
        surface: Any,
        inputs: Mapping[str, Any],
        values: Mapping[str, Any],
        textures: dict[str, TextureInput],
        name: str,
    ) -> Material:
        """The look with its opacity: a number, a map or a cut-out."""

        def says(switch: str) -> Any:
            given = surface.GetInput(switch)
            return given.Get() if given else None

        reader = textures.get("opacity")
        if inputs is OMNI:
            if not says("enable_opacity"):
                textures.pop("opacity", None)
                return look
            if reader is not None:
                reader = replace(reader, channel="a" if says("opacity_mode") == 0 else "r")
            if reader is None or not says("enable_opacity_texture"):
                textures.pop("opacity", None)
                reader = None
        cutoff = max(number_or(says("opacity_threshold" if inputs is OMNI else "opacityThreshold"), 0.0), 0.0)
        factor = number_or(values.get("opacity"), 1.0) if reader is None or inputs is OMNI else 1.0
        opacity, image = opacity_of(None if reader is None else self._channel(reader, name), factor, cutoff)
        look = replace(look, opacity=opacity, cutoff=cutoff)
        if image is not None and reader is not None:
            key = ("opacity", factor, *identity(reader))
            if key not in self._textures:
                self._textures[key] = self._add_texture(f"{name}/opacity", image, color=False)
            look = replace(look, opacity_map=self._textures[key])
        return look

    def _channel(self, reader: TextureInput, where: str) -> np.ndarray | None:
        """The values of a reader of one channel, (height, width)."""
        pixels = self._load(reader.asset, reader.layer, where)
        if pixels is None:
            return None
        place = CHANNELS.get(reader.channel, 0)
        values = pixels[..., min(place, pixels.shape[2] - 1)]
        if place == 3 and pixels.shape[2] < 4:
            values = np.full_like(values, 255)
        srgb = reader.color_space == "sRGB" and place < 3
        linear: np.ndarray = (LINEAR if srgb else TRANSFER)[values]
        return linear * reader.scale[place] + reader.bias[place]

    def _normals(self, reader: TextureInput, where: str) -> int:
        key = ("normals", *identity(reader))
        if key not in self._textures:
            pixels = self._load(reader.asset, reader.layer, where)
            if pixels is None:
                return -1
            scale, bias = reader.scale[:3], reader.bias[:3]
            if (scale == 1.0).all() and (bias == 0.0).all():  # not said: as all such images are
                scale, bias = np.full(3, 2.0), np.full(3, -1.0)
            image = map_of_normals(TRANSFER[_rgb(pixels)] * scale + bias)
            self._textures[key] = self._add_texture(reader.asset.path, image, color=False)
        return self._textures[key]

    def _texture(self, reader: TextureInput, where: str) -> int:
        """Index of the reader's image in display values, or -1."""
        key = identity(reader)
        if key not in self._textures:
            pixels = self._load(reader.asset, reader.layer, where)
            if pixels is None:
                return -1
            shown = _rgb(pixels)
            if reader.channel in ("r", "g", "b", "a"):
                channel = min("rgba".index(reader.channel), pixels.shape[2] - 1)
                shown = np.repeat(pixels[..., channel : channel + 1], 3, axis=-1)
            raw = reader.color_space == "raw" or (reader.color_space == "auto" and pixels.shape[2] == 1)
            if (reader.scale[:3] != 1.0).any() or (reader.bias[:3] != 0.0).any():
                linear = shown / 255.0 if raw else LINEAR[shown]
                shown = np.rint(255.0 * linear_to_srgb(linear * reader.scale[:3] + reader.bias[:3])).astype(np.uint8)
            elif raw:
                shown = ENCODED[shown]
            self._textures[key] = self._add_texture(reader.asset.path, shown)
        return self._textures[key]

    def _add_texture(self, name: str, pixels: np.ndarray, color: bool = True) -> int:
        self._graph.textures.append(TextureImage("2d", np.ascontiguousarray(pixels), blend_light=color))
        self._graph.texture_names.append(name)
        return len(self._graph.textures) - 1

    def _load(self, asset: Sdf.AssetPath, layer: str, where: str) -> np.ndarray | None:
        """Pixels of an image by the stage's own resolver, also from inside .usdz; None if there are none."""
        path = asset.resolvedPath
        if not path and "<UDIM>" in asset.path:
            first = asset.path.replace("<UDIM>", "1001")
            path = (
                str(Ar.GetResolver().Resolve(Sdf.ComputeAssetPathRelativeToLayer(Sdf.Layer.Find(layer), first)))
                if layer and Sdf.Layer.Find(layer)
                else str(Ar.GetResolver().Resolve(first))
            )
            self._collector.remark("is a texture in tiles, of which only the first is drawn", asset.path)
        key = path or asset.path
        if key not in self._pixels:
            self._pixels[key] = None
            if not path:
                self._collector.warn(
                    "a texture is not found, and its material is drawn in its base colour", f"{asset.path} of {where}"
                )
                return None
            try:
                self._pixels[key] = decoded(file_bytes(path))
            except UnreadableError as error:
                self._collector.warn(
                    f"a texture cannot be read ({error}), and its material is drawn in its base colour",
                    f"{asset.path} of {where}",
                )
        return self._pixels[key]


def _rgb(pixels: np.ndarray) -> np.ndarray:
    return np.repeat(pixels, 3, axis=-1) if pixels.shape[2] == 1 else pixels[..., :3]
