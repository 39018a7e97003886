"""What a scene's planes need to be drawn fast."""

from collections.abc import Container, Mapping

import numpy as np
import warp as wp

from warpcam.kernels.types import PLANE
from warpcam.scene.source import SceneDescription

LIGHT_COLORS = ("light_ambient", "light_diffuse", "light_specular", "headlight")
COLORS = ("shape_colors", "shape_materials", "material_color", *LIGHT_COLORS)


class Planes:
    """The planes of a scene that are drawn, and whether they are more than an endless grey one in grey light.

    CUDA kernels of floors by strips are compiled for what the scene holds when it is made. Others of its values than
    those make images slower, never wrong.
    """

    def __init__(self, parts: SceneDescription):
        self.ids = tuple(int(shape) for shape in parts.drawn if parts.shape_types[shape] == PLANE)
        self._columns = np.asarray(self.ids, np.int64)
        self._general = len(self.ids) > 1

    def look_at(self, arrays: Mapping[str, wp.array]) -> None:
        """Read the live arrays as they are now. Waits for the device."""
        if not self.ids:
            return
        colors = [arrays["shape_colors"].numpy()[:, self._columns], arrays["material_color"].numpy()]
        used = np.unique(arrays["shape_materials"].numpy()[:, self._columns])
        colors[1] = colors[1][:, used[(used >= 0) & (used < colors[1].shape[1])]]
        colors += [arrays[name].numpy() for name in LIGHT_COLORS if name in arrays]
        sizes = arrays["shape_sizes"].numpy()[:, self._columns]
        self._general |= any(map(_has_hue, colors)) or _has_shorter_cells(sizes)

    def general(self, varied: Container[str]) -> bool:
        """Return whether kernels are to be for any planes, where worlds have arrays of these names for themselves."""
        return bool(self.ids) and (self._general or any(name in varied for name in COLORS))


def _has_hue(colors: np.ndarray) -> bool:
    return bool(np.any(colors[..., :1] != colors[..., 1:3]))


def _has_shorter_cells(sizes: np.ndarray) -> bool:
    """Whether the last cells of planes that end are shorter: cells_between() of native/shading/plane_grid.h."""
    half, step = sizes[..., :2], np.maximum(sizes[..., 2:], sizes[..., :2] / np.float32(198.0))
    cells = np.divide(half, step, out=np.zeros_like(half), where=step > 0.0)
    rest = half - 2.0 * step * np.floor(0.5 * np.floor(cells))
    return bool(np.any((half > 0.0) & (rest > 2.0e-5 * step)))
