"""OmniPBR's textures and colours, as far as they go beyond UsdPreviewSurface.

Names and defaults are those of NVIDIA's OmniPBR.mdl.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import Sdf, UsdShade

from warpcam.sources.usd.inputs import InputReader
from warpcam.sources.usd.shader import value_of
from warpcam.sources.usd.texture import TextureInput

# How much of a map is mixed into the constant, by what it says; 0 unless it is given.
INFLUENCES = {
    "roughness": ("reflection_roughness_texture_influence", 0.5),
    "metallic": ("metallic_texture_influence", 0.0),
    "occlusion": ("ao_to_diffuse", 1.0),
}
ORM = {"occlusion": "r", "roughness": "g", "metallic": "b"}
NOT_DRAWN = {"albedo_desaturation": 0.0, "project_uvw": False, "texture_rotate": 0.0, "emissive_mask_texture": None}


class OmniInputs:
    """The inputs of the surface of the material ``name``; what is not drawn is told."""

    def __init__(self, surface: UsdShade.Shader, inputs: InputReader, name: str):
        self._surface, self._inputs, self._name = surface, inputs, name

    def tint(self) -> np.ndarray:
        """Return the factor of the colour, (3,) linear."""
        return self._numbers("diffuse_tint", (1.0, 1.0, 1.0))

    def emission(self, values: Mapping[str, Any]) -> Any:
        """Its colour, or None where it is switched off."""
        return values.get("emission", (1.0, 0.1, 0.1)) if self._inputs.flag(self._surface, "enable_emission") else None

    def textures(self, given: Mapping[str, TextureInput], values: Mapping[str, Any]) -> dict[str, TextureInput]:
        """Its textures by what they say, with all that it does to them."""
        found = dict(given)
        value, packed = self._read("ORM_texture")
        if value is not None and not isinstance(value, Sdf.AssetPath):
            self._inputs.refuse(self._surface.GetInput("ORM_texture"), "that is no asset")
        if packed is not None and self._inputs.flag(self._surface, "enable_ORM_texture"):
            found |= {what: replace(packed, channel=channel) for what, channel in ORM.items()}
        for what, (name, default) in INFLUENCES.items():
            if what in found:
                share = float(np.clip(self._numbers(name, (0.0,))[0], 0.0, 1.0))
                constant = float(values.get(what, default))
                mixed, kept = np.full(4, share), np.full(4, constant)
                found[what] = replace(found[what], scale=mixed, bias=(1.0 - mixed) * kept, fallback=kept)
                if share == 0.0:
                    del found[what]
        if "color" in found:
            bright, add = self._numbers("albedo_brightness", (1.0,))[0], self._numbers("albedo_add", (0.0,))[0]
            found["color"] = replace(found["color"], scale=np.full(4, bright), bias=np.full(4, add))
        scale, shift = self._numbers("texture_scale", (1.0, 1.0)), self._numbers("texture_translate", (0.0, 0.0))
        if found and ((scale != 1.0).any() or (shift != 0.0).any()):
            turn = np.column_stack((np.diag(scale), shift))
            found = {what: replace(texture, uv_turn=turn) for what, texture in found.items()}
        for name, nothing in NOT_DRAWN.items():
            value, texture = self._read(name)
            if texture is not None or (found and value is not None and value != nothing and nothing is not None):
                self._inputs.collector.warn(f"has {name}, which is not drawn", self._name)
        return found

    def _read(self, name: str) -> tuple[Any, TextureInput | None]:
        given = self._surface.GetInput(name)
        return value_of(given, self._inputs)[:2] if given else (None, None)

    def _numbers(self, name: str, default: tuple[float, ...]) -> np.ndarray:
        return self._inputs.numbers(self._surface, name, default)
