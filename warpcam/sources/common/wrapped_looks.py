"""Materials whose images do not simply repeat, made anew for the texture coordinates of each mesh."""

from dataclasses import replace
from typing import Any

import numpy as np

from warpcam.sources.common.images import resized, wrapped
from warpcam.sources.common.scene_graph import SceneGraph
from warpcam.textures.pack import TextureImage

REPEAT = ("repeat", "repeat")
COLORS = ("texture", "emission_texture")
ROLES = (*COLORS, "normals", "packed", "opacity_map")


class WrappedLooks:
    """Maker of such materials, each once for meshes that need the same part of the plane."""

    def __init__(self, graph: SceneGraph):
        self._graph = graph
        self._made: dict[tuple[Any, ...], tuple[int, np.ndarray, np.ndarray]] = {}
        self._textures: dict[tuple[Any, ...], int] = {}

    def laid_on(self, look: int, uvs: np.ndarray) -> tuple[int, np.ndarray]:
        """Material and texture coordinates, (face, 3, 2), that show what ``Material.wrap`` asks for."""
        base = self._graph.materials[look]
        images = {role: getattr(base, role) for role in ROLES if getattr(base, role) >= 0}
        if not images or base.wrap == REPEAT or not len(uvs):
            return look, uvs
        flat = uvs.reshape(-1, 2)
        low, high = flat.min(axis=0), flat.max(axis=0)
        key = (look, *np.floor(low + 1e-3), *np.ceil(high - 1e-3))
        if key not in self._made:
            self._made[key] = self._wrapped(look, images, low, high, key[1:])
        index, scale, offset = self._made[key]
        if index == look:
            return look, uvs
        moved = uvs * scale + offset
        for axis in (0, 1):
            if base.wrap[axis] in ("clamp", "black"):
                moved[..., axis] = np.clip(moved[..., axis], 0.5e-3 * scale[axis], 1.0 - 0.5e-3 * scale[axis])
        return index, moved

    def _wrapped(
        self, look: int, images: dict[str, int], low: np.ndarray, high: np.ndarray, part: Any
    ) -> tuple[int, np.ndarray, np.ndarray]:
        """A material with images for a part of the plane, and scale and offset of texture coordinates to them."""
        base = self._graph.materials[look]
        sizes = [self._graph.textures[index].pixels.shape[:2] for index in images.values()]
        size = max(rows for rows, _ in sizes), max(columns for _, columns in sizes)  # one border for all
        scale, offset, own = np.ones(2), np.zeros(2), dict[str, Any]()
        for role, index in images.items():
            done = wrapped(resized(self._graph.textures[index].pixels, size), base.wrap, low, high)
            if done is None:
                return look, scale, offset
            pixels, scale, offset = done
            color = role in COLORS
            key = index, base.wrap, size, color, part
            if key not in self._textures:
                self._graph.textures.append(TextureImage("2d", np.ascontiguousarray(pixels), blend_light=color))
                self._graph.texture_names.append(f"{self._graph.texture_names[index]} {base.wrap}")
                self._textures[key] = len(self._graph.textures) - 1
            own[role] = self._textures[key]
        self._graph.materials.append(replace(base, wrap=REPEAT, **own))
        return len(self._graph.materials) - 1, scale, offset
