"""Materials of a stage: UsdPreviewSurface, and Omniverse's OmniPBR by the inputs that say the same."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdShade

from warpcam.core.file_access import FileAccess
from warpcam.sources.common import materials
from warpcam.sources.common.images import packed
from warpcam.sources.common.opacity import opacity_of
from warpcam.sources.common.scene_graph import Material, SceneGraph
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.common.wrapped_looks import WrappedLooks
from warpcam.sources.usd.attributes import FIRST, AttributeReader
from warpcam.sources.usd.inputs import InputReader
from warpcam.sources.usd.omnipbr import OmniInputs
from warpcam.sources.usd.shader import OMNI, PREVIEW, color_or, number_or, surface_of, value_of
from warpcam.sources.usd.texture import CHANNELS, TextureInput, alike, identity
from warpcam.sources.usd.texture_images import TextureImages

COMPONENTS = {"color": 3, "emission": 3, "normal": 3}  # of inputs; of others 1
BINDING = str(UsdShade.Tokens.materialBinding)
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

    def __init__(self, graph: SceneGraph, attributes: AttributeReader, collector: WarningCollector, access: FileAccess):
        self._graph, self._attributes, self._collector = graph, attributes, collector
        self._inputs = InputReader(attributes, collector)
        self.images = TextureImages(graph, collector, access)
        self._bound: dict[Sdf.Path, BoundMaterial] = {}
        self._maps: dict[tuple[Any, ...], int] = {}
        self.wrapped = WrappedLooks(graph)
        self.inherited: dict[str, np.ndarray] = {}  # of the point instance that is read: displayColor, displayOpacity

    def bound_to(self, prim: Usd.Prim) -> BoundMaterial:
        """The material of a prim or a subset of one."""
        material = self._bound_material(prim)
        if not material:
            return BoundMaterial()
        prim = material.GetPrim()
        path = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
        if path not in self._bound:
            self._bound[path] = self._read(material)
        return self._bound[path]

    def _bound_material(self, prim: Usd.Prim) -> UsdShade.Material | None:
        api = UsdShade.MaterialBindingAPI(prim)
        try:
            for purpose in (UsdShade.Tokens.preview, UsdShade.Tokens.full):
                material = api.ComputeBoundMaterial(purpose)[0]
                if material:
                    return material
        except Tf.ErrorException:
            self._collector.warn(
                f"has {BINDING} that is no relationship, and shows display colours", str(prim.GetPath())
            )
            return None
        while prim and not prim.IsPseudoRoot():
            targets = self._attributes.targets(prim, BINDING)
            if targets:
                target = f"{targets[0]}, which is no material" if len(targets) == 1 else "several prims"
                self._collector.warn(f"has {BINDING} to {target}, and shows display colours", str(prim.GetPath()))
                return None
            prim = prim.GetParent()
        return None

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
            values = self.inherited.get(name)
            if primvar and primvar.HasValue():
                values = self._attributes.primvar(primvar, time, len(default), indexed=False)
            if primvar and primvar.ValueMightBeTimeVarying():
                self._collector.warn(
                    f"has {name} that changes with time, and keeps what it has at first", str(prim.GetPath())
                )
            if values is not None and not np.isfinite(values).all():
                self._collector.warn(f"has {name} that is not finite, which is left out", str(prim.GetPath()))
                values = None
            found += [float(x) for x in (default if values is None else values.reshape(-1, len(default)).mean(axis=0))]
        return found[0], found[1], found[2], found[3]

    def painted(self, look: int, pixels: np.ndarray, name: str) -> int:
        """A look like that one, with colours of its own, (height, width, 3) uint8 display values."""
        texture = self.images.add(name, pixels)
        base = self._graph.materials[look] if look >= 0 else Material(name)
        own = replace(base, name=f"{name}/displayColor", color=materials.WHITE, texture=texture)
        own = replace(own, normals=-1, packed=-1, emission_texture=-1, opacity_map=-1)  # they lie by other coordinates
        self._graph.materials.append(own)
        return len(self._graph.materials) - 1

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
                value, reader, primvar = value_of(given, self._inputs)
                if reader is not None:
                    textures[what] = reader
                    if what == "color" and source == constant:  # the base colour, where its texture is missing
                        value = self._attributes.value(given.GetAttr(), FIRST)
                        values[what] = self._inputs.checked_numbers(given, value, 3)
                elif primvar:
                    by_color |= what == "color" and primvar == "displayColor"
                    by_opacity |= what == "opacity" and primvar == "displayOpacity"
                elif value is not None and not isinstance(value, Sdf.AssetPath):
                    if source == texture:
                        self._inputs.refuse(given, "that is no asset")
                        continue
                    value = self._inputs.checked_numbers(given, value, COMPONENTS.get(what, 1))
                    if value is not None:
                        values[what] = value
        omni = OmniInputs(surface, self._inputs, name) if inputs is OMNI else None
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
            index = self.images.colors(shown, name)
            if index >= 0:
                look = replace(look, texture=index, color=materials.WHITE)
            else:
                look = replace(
                    look, color=color_or(shown.fallback[:3] if shown.fallback[:3].any() else None, look.color)
                )
        glowing = textures.get("emission")
        if glowing is not None:
            index = self.images.colors(glowing, name)
            if index >= 0:
                look = replace(look, emission_texture=index)
            else:
                look = replace(look, emission=color_or(glowing.fallback[:3], (0.0, 0.0, 0.0)))
        if "normal" in textures:
            look = replace(look, normals=self.images.normals(textures["normal"], name))
        channels = {what: self.images.channel(textures[what], name) for what in PACKED if what in textures}
        for what, values in channels.items():
            if what != "occlusion":
                fallback = float(np.clip(textures[what].fallback[CHANNELS.get(textures[what].channel, 0)], 0.0, 1.0))
                look = replace(look, **{what: fallback if values is None else 1.0})  # type: ignore[arg-type]
        image = packed([channels.get(what) for what in PACKED])
        if image is not None:
            key = tuple(identity(textures[what]) if what in textures else None for what in PACKED)
            if key not in self._maps:
                self._maps[key] = self.images.add(f"{name}/occlusion, roughness, metallic", image, color=False)
            look = replace(look, packed=self._maps[key])
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
        reader = textures.get("opacity")
        if inputs is OMNI:
            if not self._inputs.flag(surface, "enable_opacity"):
                textures.pop("opacity", None)
                return look
            if reader is not None:
                mode = self._inputs.number(surface, "opacity_mode", 1.0)
                reader = replace(reader, channel="a" if mode == 0.0 else "r")
            textured = self._inputs.flag(surface, "enable_opacity_texture")
            if reader is None or not textured:
                textures.pop("opacity", None)
                reader = None
        threshold = "opacity_threshold" if inputs is OMNI else "opacityThreshold"
        cutoff = max(self._inputs.number(surface, threshold, 0.0), 0.0)
        factor = number_or(values.get("opacity"), 1.0) if reader is None or inputs is OMNI else 1.0
        opacity, image = opacity_of(None if reader is None else self.images.channel(reader, name), factor, cutoff)
        look = replace(look, opacity=opacity, cutoff=cutoff)
        if image is not None and reader is not None:
            key = ("opacity", factor, *identity(reader))
            if key not in self._maps:
                self._maps[key] = self.images.add(f"{name}/opacity", image, color=False)
            look = replace(look, opacity_map=self._maps[key])
        return look
