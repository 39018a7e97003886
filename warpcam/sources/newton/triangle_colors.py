"""Soft surfaces of Newton whose triangles differ in colour: each has a texel of its own in an image of its own."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.types import ROLE_COLOR, Textures
from warpcam.sources.newton.deformable_part import DeformablePart, image_size
from warpcam.sources.newton.kernels.triangle_colors import bind_triangle_colors
from warpcam.textures.pack import TextureImage


def differ(colors: np.ndarray | None, triangles: Sequence[np.ndarray]) -> bool:
    """Return whether the colours of some of these sets of triangles differ."""
    return colors is not None and any((colors[rows] != colors[rows[0]]).any() for rows in triangles)


class TriangleColors:
    """The images: of each surface whose triangles differ one for each world that has it.

    Args:
        parts: Surfaces, of which those that are not tinted have none.
        first_texture: The first image's place among all textures.
        first_material: The first of the materials, one a surface.
        device: Of the scene.
    """

    def __init__(self, parts: Sequence[DeformablePart], first_texture: int, first_material: int, device: wp.Device):
        self.parts = [part for part in parts if part.tinted]
        self._triangles = [rows for part in self.parts for rows in part.all_triangles]
        self._texture, self._material, self._device = first_texture, first_material, device
        self._texels: wp.array | None = None
        self.images = [_blank(len(rows)) for rows in self._triangles]

    def materials(self, table: np.ndarray, num_worlds: int) -> np.ndarray:
        """Materials of the columns of soft surfaces, (world or 1, column), with those that are tinted."""
        if self.parts:
            table = np.array(np.broadcast_to(table, (num_worlds, table.shape[1])))
        for number, part in enumerate(self.parts):
            for world in part.worlds:
                table[slice(None) if world < 0 else world, part.column] = self._material + number
        return table

    def choose(self, textures: wp.array) -> None:
        """Say which image a material has in which world: ``textures`` is (world, material, role)."""
        if not self.parts:
            return
        table, texture = textures.numpy(), self._texture
        for number, part in enumerate(self.parts):
            for world in part.worlds:
                table[slice(None) if world < 0 else world, self._material + number, ROLE_COLOR] = texture
                texture += 1
        textures.assign(table)

    def lend(self, textures: Textures) -> None:
        """Tell where the images lie."""
        if not self.parts:
            return
        starts = textures.start.numpy()[self._texture : self._texture + len(self._triangles)]
        places = [start + np.arange(len(rows)) for start, rows in zip(starts, self._triangles, strict=True)]
        self._places, self._rows = (
            wp.array(np.concatenate(values).astype(np.int32), dtype=wp.int32, device=self._device)
            for values in (places, self._triangles)
        )
        self._texels = textures.texels

    def record(self, colors: wp.array) -> list[Stage]:
        """Bind the stages that paint them.

        Args:
            colors: (triangle,) vec3, display colours; empty leaves the images white.
        """
        if self._texels is None or not colors.shape[0]:
            return []
        return [bind_triangle_colors(colors, self._rows, self._places, self._texels, self._device)]


def _blank(count: int) -> TextureImage:
    width, height = image_size(count)
    return TextureImage("2d", np.full((height, width, 3), 255, np.uint8), blend_light=True)
