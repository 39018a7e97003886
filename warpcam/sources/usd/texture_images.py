"""Images of a stage's textures and domes: read once, and kept in a graph."""

from typing import Any

import numpy as np
from pxr import Ar, Sdf

from warpcam.core.color import linear_to_srgb
from warpcam.core.file_access import FileAccess
from warpcam.sources.common.images import (
    ENCODED,
    LINEAR,
    TRANSFER,
    UnreadableError,
    cube_of_panorama,
    decoded,
    map_of_normals,
)
from warpcam.sources.common.scene_graph import SceneGraph
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.texture import CHANNELS, TextureInput, file_bytes, identity
from warpcam.textures.pack import TextureImage
from warpcam.textures.panorama import sky_of_panorama


class TextureImages:
    """Images of a graph."""

    def __init__(self, graph: SceneGraph, collector: WarningCollector, access: FileAccess):
        self._graph, self._collector, self._access = graph, collector, access
        self._pixels: dict[str, np.ndarray | None] = {}
        self._textures: dict[tuple[Any, ...], int] = {}
        self._skies: dict[tuple[Any, ...], np.ndarray | None] = {}

    def mean_of(self, asset: Sdf.AssetPath, where: str) -> np.ndarray | None:
        """The mean linear colour of an image, (3,); None if it cannot be read."""
        pixels = self.load(asset, "", where)
        return None if pixels is None else LINEAR[_rgb(pixels)].mean(axis=(0, 1))

    def sky_of(self, asset: Sdf.AssetPath, where: str, turn: np.ndarray) -> np.ndarray | None:
        """Terms of a dome's image, see ``native/shading/environment.h``; None if it cannot be read."""
        key = (asset.resolvedPath or asset.path, turn.tobytes())
        if key not in self._skies:
            pixels = self.load(asset, "", where)
            self._skies[key] = None if pixels is None else sky_of_panorama(_rgb(pixels), turn)
        return self._skies[key]

    def add_skybox(self, asset: Sdf.AssetPath | None, where: str, turn: np.ndarray) -> None:
        """Show a dome's image behind everything; ``turn`` (3, 3) is from the dome's axes to the world's."""
        if asset is None or not asset.path or self._graph.skybox >= 0:
            return
        pixels = self.load(asset, "", where)
        if pixels is not None:
            self._graph.skybox = len(self._graph.textures)
            self._graph.textures.append(cube_of_panorama(_rgb(pixels), turn))
            self._graph.texture_names.append(asset.path)

    def channel(self, reader: TextureInput, where: str) -> np.ndarray | None:
        """The values of a reader of one channel, (height, width)."""
        pixels = self.load(reader.asset, reader.layer, where)
        if pixels is None:
            return None
        place = CHANNELS.get(reader.channel, 0)
        values = pixels[..., min(place, pixels.shape[2] - 1)]
        if place == 3 and pixels.shape[2] < 4:
            values = np.full_like(values, 255)
        srgb = reader.color_space == "sRGB" and place < 3
        linear: np.ndarray = (LINEAR if srgb else TRANSFER)[values]
        return linear * reader.scale[place] + reader.bias[place]

    def normals(self, reader: TextureInput, where: str) -> int:
        key = ("normals", *identity(reader))
        if key not in self._textures:
            pixels = self.load(reader.asset, reader.layer, where)
            if pixels is None:
                return -1
            scale, bias = reader.scale[:3], reader.bias[:3]
            if (scale == 1.0).all() and (bias == 0.0).all():  # not said: as all such images are
                scale, bias = np.full(3, 2.0), np.full(3, -1.0)
            image = map_of_normals(TRANSFER[_rgb(pixels)] * scale + bias)
            self._textures[key] = self.add(reader.asset.path, image, color=False)
        return self._textures[key]

    def colors(self, reader: TextureInput, where: str) -> int:
        """Index of the reader's image in display values, or -1."""
        key = identity(reader)
        if key not in self._textures:
            pixels = self.load(reader.asset, reader.layer, where)
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
            self._textures[key] = self.add(reader.asset.path, shown)
        return self._textures[key]

    def add(self, name: str, pixels: np.ndarray, color: bool = True) -> int:
        self._graph.textures.append(TextureImage("2d", np.ascontiguousarray(pixels), blend_light=color))
        self._graph.texture_names.append(name)
        return len(self._graph.textures) - 1

    def load(self, asset: Sdf.AssetPath, layer: str, where: str) -> np.ndarray | None:
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
                self._pixels[key] = decoded(file_bytes(path, self._access), self._access, path)
            except UnreadableError as error:
                self._collector.warn(
                    f"a texture cannot be read ({error}), and its material is drawn in its base colour",
                    f"{asset.path} of {where}",
                )
        return self._pixels[key]


def _rgb(pixels: np.ndarray) -> np.ndarray:
    return np.repeat(pixels, 3, axis=-1) if pixels.shape[2] == 1 else pixels[..., :3]
