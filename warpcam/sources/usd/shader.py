"""Surface shaders of a stage: UsdPreviewSurface, and OmniPBR by the inputs that say the same."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pxr import Sdf, UsdShade

from warpcam.sources.usd.attributes import FIRST
from warpcam.sources.usd.inputs import InputReader
from warpcam.sources.usd.texture import TextureInput, plain_texture, texture_input

# Inputs by what they say. A texture of its own stands in an input beside the constant in OmniPBR.
PREVIEW: Mapping[str, tuple[str, str]] = {
    "color": ("diffuseColor", ""),
    "opacity": ("opacity", ""),
    "roughness": ("roughness", ""),
    "metallic": ("metallic", ""),
    "emission": ("emissiveColor", ""),
    "normal": ("normal", ""),
    "occlusion": ("occlusion", ""),
    "ior": ("ior", ""),
}
OMNI: Mapping[str, tuple[str, str]] = {
    "color": ("diffuse_color_constant", "diffuse_texture"),
    "opacity": ("opacity_constant", "opacity_texture"),
    "roughness": ("reflection_roughness_constant", "reflectionroughness_texture"),
    "metallic": ("metallic_constant", "metallic_texture"),
    "emission": ("emissive_color", "emissive_color_texture"),
    "normal": ("", "normalmap_texture"),
    "occlusion": ("", "ao_texture"),
    "ior": ("", ""),
}


def surface_of(material: UsdShade.Material) -> tuple[UsdShade.Shader | None, Mapping[str, tuple[str, str]]]:
    """The surface shader of a material, and its inputs by what they say; None if it is not known here."""
    for context in (UsdShade.Tokens.universalRenderContext, "mtlx", "mdl"):
        shader = material.ComputeSurfaceSource(context)[0]
        if not shader:
            continue
        identifier = str(shader.GetShaderId() or "")
        if identifier in ("UsdPreviewSurface", "ND_UsdPreviewSurface_surfaceshader"):
            return shader, PREVIEW
        module = shader.GetSourceAsset("mdl")
        if module and "OmniPBR" in module.path:
            return shader, OMNI
    return None, PREVIEW


def value_of(given: UsdShade.Input, inputs: InputReader) -> tuple[Any, TextureInput | None, str]:
    """Resolve an input: to its constant, to the texture reader it is connected to, or to the primvar."""
    for attribute in inputs.producing(given):
        prim = attribute.GetPrim()
        shader = UsdShade.Shader(prim)
        identifier = str(shader.GetShaderId() or "") if shader else ""
        output = attribute.GetName().removeprefix("outputs:")
        if attribute.GetName().startswith("outputs:"):
            if identifier == "UsdUVTexture":
                return None, texture_input(shader, output, inputs), ""
            if identifier.startswith("UsdPrimvarReader"):
                return None, None, inputs.text(shader, "varname")
            inputs.collector.remark(f"uses {identifier or 'a shader'}, which is not known here", str(prim.GetPath()))
            continue
        value = inputs.attributes.value(attribute, FIRST)
        if attribute.ValueMightBeTimeVarying():
            inputs.collector.warn("has a value that changes with time, and keeps its first", str(attribute.GetPath()))
        if isinstance(value, Sdf.AssetPath) and value.path:
            return None, plain_texture(value, attribute), ""
        return value, None, ""
    return None, None, ""


def color_or(value: Any, default: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the constant of an input as a colour, or ``default`` for anything else."""
    try:
        red, green, blue = (float(channel) for channel in value)
    except (TypeError, ValueError):
        return default
    return red, green, blue


def number_or(value: Any, default: float) -> float:
    """Return the constant of an input as a number, or ``default`` for anything else."""
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else default
