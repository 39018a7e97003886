"""Texture readers of a stage's materials, and the files behind them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Ar, Sdf, Usd, UsdShade

from warpcam.core.file_access import FileAccess
from warpcam.sources.common.images import UnreadableError
from warpcam.sources.usd.attributes import FIRST
from warpcam.sources.usd.inputs import InputReader
from warpcam.sources.usd.layer_files import outer_file

WRAPS = {"clamp": "clamp", "mirror": "mirror", "black": "black", "repeat": "repeat", "useMetadata": "repeat"}
CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3}
SPACES = ("auto", "raw", "sRGB")


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


def texture_input(shader: UsdShade.Shader, channel: str, inputs: InputReader) -> TextureInput:
    file = shader.GetInput("file")
    attribute = next(iter(inputs.producing(file)), None) if file else None
    asset = inputs.attributes.value(attribute, FIRST) if attribute else None
    if asset is not None and not isinstance(asset, Sdf.AssetPath):
        inputs.refuse(file, "that is no asset")
    uv, turn = "", None
    st = shader.GetInput("st")
    for source in inputs.producing(st) if st else ():
        reader = UsdShade.Shader(source.GetPrim())
        if reader and reader.GetShaderId() == "UsdTransform2d":
            turn = _uv_turn(reader, inputs)
            inner = reader.GetInput("in")
            producing = inputs.producing(inner) if inner else []
            reader = UsdShade.Shader(producing[0].GetPrim()) if producing else None
        if reader and str(reader.GetShaderId() or "").startswith("UsdPrimvarReader"):
            uv = inputs.text(reader, "varname")
    wrap = [WRAPS[inputs.text(shader, name, "repeat", tuple(WRAPS))] for name in ("wrapS", "wrapT")]
    return TextureInput(
        asset=asset if isinstance(asset, Sdf.AssetPath) else Sdf.AssetPath(""),
        layer=_layer_of(attribute),
        channel=channel,
        color_space=inputs.text(shader, "sourceColorSpace", "auto", SPACES),
        wrap=(wrap[0], wrap[1]),
        uv=uv,
        uv_turn=turn,
        scale=inputs.numbers(shader, "scale", (1.0, 1.0, 1.0, 1.0)),
        bias=inputs.numbers(shader, "bias", (0.0, 0.0, 0.0, 0.0)),
        fallback=inputs.numbers(shader, "fallback", (0.0, 0.0, 0.0, 1.0)),
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


def file_bytes(path: str, access: FileAccess) -> bytes:
    """Return the bytes of a resolved path, also inside of a package.

    Raises:
        RefusedError: The file lies outside of what may be opened, or is too large.
        UnreadableError: It cannot be opened.
    """
    if not Ar.IsPackageRelativePath(path):
        try:
            return access.read(Path(path))
        except OSError as error:
            raise UnreadableError(error.strerror or str(error)) from None
    access.check_path(outer_file(path))
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not asset:
        raise UnreadableError("it cannot be opened")
    access.check("file_bytes", asset.GetSize(), path)
    access.take(asset.GetSize(), path)
    buffer = asset.GetBuffer()
    if buffer is None:
        raise UnreadableError("it cannot be opened")
    return bytes(buffer)


def _layer_of(attribute: Usd.Attribute | None) -> str:
    specs = attribute.GetPropertyStack(Usd.TimeCode.Default()) if attribute else []
    return specs[0].layer.identifier if specs else ""


def _uv_turn(shader: UsdShade.Shader, inputs: InputReader) -> np.ndarray:
    """UsdTransform2d: scale, then turn, then shift; (2, 3)."""
    angle = np.radians(inputs.number(shader, "rotation", 0.0))
    scale, shift = (inputs.numbers(shader, n, d) for n, d in (("scale", (1.0, 1.0)), ("translation", (0.0, 0.0))))
    c, s = np.cos(angle), np.sin(angle)
    return np.array(((c * scale[0], -s * scale[1], shift[0]), (s * scale[0], c * scale[1], shift[1])))
