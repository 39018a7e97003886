"""The image of a sky as a light that paths draw: how bright its parts are."""

import numpy as np

from warpcam.core.color import srgb_to_linear
from warpcam.kernels.scene_tables import SceneTables
from warpcam.textures.pack import level_sizes

MAX_SIDE = 32  # cells of a face
EVEN = 0.1  # share of draws that are even over the sphere: what an image shows between cells is drawn, too


def sky_sums(tables: SceneTables) -> tuple[np.ndarray, int]:
    """Sums of the shares of cells, (6 * side^2 + 1,) float32, and the side; nothing and 0 without an image.

    Cells are texels of a level of the cube texture, a share is brightness times solid angle.
    """
    sky, textures = int(tables.background.skybox), tables.textures
    if sky < 0:
        return np.zeros(0, np.float32), 0
    start, side, levels = (int(getattr(textures, name).numpy()[sky]) for name in ("start", "width", "levels"))
    for width, _ in level_sizes(side, side)[:levels]:
        side = width
        if side <= MAX_SIDE:
            break
        start += 6 * width * width
    texels = textures.texels[start : start + 6 * side * side].numpy().reshape(6, side, side)
    channels = np.stack([texels >> shift & 255 for shift in (0, 8, 16)], axis=-1)
    at = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    angles = (1.0 + at[:, None] ** 2 + at[None] ** 2) ** -1.5
    shares = srgb_to_linear(channels / 255.0).mean(axis=-1) * angles
    total = shares.sum()
    shares = (1.0 - EVEN) * shares / total if total > 0.0 else shares
    shares += (EVEN if total > 0.0 else 1.0) * angles / (6.0 * angles.sum())
    sums = np.append(0.0, np.cumsum(shares.ravel()))
    return (sums / sums[-1]).astype(np.float32), side
