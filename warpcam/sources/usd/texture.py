"""Texture readers of a stage's materials, and the files behind them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Ar, Sdf, Usd, UsdShade

from warpcam.sources.common.images import UnreadableError
from warpcam.sources.common.warnings import WarningCollector

WRAPS = {"clamp": "clamp", "mirror": "mirror", "black": "black"}  # all else repeats


@dataclass(frozen=True, eq=False)
class TextureInput:
    """A texture reader that an input is connected to."""

    asset: Sdf.AssetPath
    layer: str
    channel: str
    color_space: str
    wrap: tuple[str, str]
    uv: str
    uv_turn: np.ndarray | None
    scale: np.ndarray
    bias: np.ndarray
    fallback: np.ndarray


def texture_input(shader: UsdShade.Shader, channel: str, collector: WarningCollector) -> TextureInput:
    file = shader.GetInput("file")
    attribute = next(iter(UsdShade.Utils.GetValueProducingAttributes(file)), None) if file else None
    asset = attribute.Get(Usd.TimeCode.EarliestTime()) if attribute else None
    uv, turn = "", None
    st = shader.GetInput("st")
    for source in UsdShade.Utils.GetValueProducingAttributes(st) if st else ():
        reader = UsdShade.Shader(source.GetPrim())
        if reader and reader.GetShaderId() == "UsdTransform2d":
            turn = _uv_turn(reader, collector)
            inner = reader.GetInput("in")
            producing = UsdShade.Utils.GetValueProducingAttributes(inner) if inner else []
            reader = UsdShade.Shader(producing[0].GetPrim()) if producing else None
        if reader and str(reader.GetShaderId() or "").startswith("UsdPrimvarReader"):
            uv = str(input_value(reader, "varname", ""))
    return TextureInput(
        asset=asset if isinstance(asset, Sdf.AssetPath) else Sdf.AssetPath(""),
        layer=_layer_of(attribute),
        channel=channel,
        color_space=str(input_value(shader, "sourceColorSpace", "auto")),
        wrap=(
            WRAPS.get(str(input_value(shader, "wrapS", "")), "repeat"),
            WRAPS.get(str(input_value(shader, "wrapT", "")), "repeat"),
        ),
        uv=uv,
        uv_turn=turn,
        scale=_numbers(shader, "scale", (1.0, 1.0, 1.0, 1.0), collector),
        bias=_numbers(shader, "bias", (0.0, 0.0, 0.0, 0.0), collector),
        fallback=_numbers(shader, "fallback", (0.0, 0.0, 0.0, 1.0), collector),
    )


def identity(reader: TextureInput) -> tuple[Any, ...]:
    """Equal for readers that give the same."""
    return (
        reader.asset.resolvedPath or reader.asset.path,
        reader.layer,
        reader.channel,
        reader.color_space,
        reader.scale.tobytes(),
        reader.bias.tobytes(),
    )


def alike(one: TextureInput, other: TextureInput) -> bool:
    """Return whether two textures have the same mapping."""
    first, second = (np.eye(2, 3) if turn is None else turn for turn in (one.uv_turn, other.uv_turn))
    return one.uv == other.uv and one.wrap == other.wrap and bool(np.allclose(first, second))


def plain_texture(asset: Sdf.AssetPath, attribute: Usd.Attribute) -> TextureInput:
    space = attribute.GetColorSpace() if hasattr(attribute, "GetColorSpace") else ""
    return TextureInput(
        asset=asset,
        layer=_layer_of(attribute),
        channel="rgb",
        color_space="raw" if str(space) == "raw" else "auto",
        wrap=("repeat", "repeat"),
        uv="",
        uv_turn=None,
        scale=np.ones(4),
        bias=np.zeros(4),
        fallback=np.zeros(4),
    )


def file_bytes(path: str) -> bytes:
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not asset:
        raise UnreadableError("it cannot be opened")
    buffer = asset.GetBuffer()
    if buffer is None:
        raise UnreadableError("it cannot be opened")
    return bytes(buffer)


def input_value(shader: UsdShade.Shader, name: str, default: Any) -> Any:
    given = shader.GetInput(name)
    attributes = UsdShade.Utils.GetValueProducingAttributes(given) if given else []
    value = attributes[0].Get(Usd.TimeCode.EarliestTime()) if attributes else None
    return default if value is None else value


def is_numbers(value: Any, count: int) -> bool:
    """Return whether the value is a sequence of ``count`` finite numbers."""
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError):
        return False
    return array.size == count and bool(np.isfinite(array).all())


def count_of(count: int) -> str:
    return f"{count} finite numbers" if count > 1 else "a finite number"


def _numbers(shader: UsdShade.Shader, name: str, default: tuple[float, ...], collector: WarningCollector) -> np.ndarray:
    value = input_value(shader, name, default)
    if not is_numbers(value, len(default)):
        collector.warn(f"has {name} that is not {count_of(len(default))}, and is left out", str(shader.GetPath()))
        value = default
    return np.array(value, np.float64).reshape(len(default))


def _layer_of(attribute: Usd.Attribute | None) -> str:
    specs = attribute.GetPropertyStack(Usd.TimeCode.Default()) if attribute else []
    return specs[0].layer.identifier if specs else ""


def _uv_turn(shader: UsdShade.Shader, collector: WarningCollector) -> np.ndarray:
    """UsdTransform2d: scale, then turn, then shift; (2, 3)."""
    angle = np.radians(_numbers(shader, "rotation", (0.0,), collector)[0])
    scale, shift = (_numbers(shader, n, d, collector) for n, d in (("scale", (1.0, 1.0)), ("translation", (0.0, 0.0))))
    c, s = np.cos(angle), np.sin(angle)
    return np.array(((c * scale[0], -s * scale[1], shift[0]), (s * scale[0], c * scale[1], shift[1])))
