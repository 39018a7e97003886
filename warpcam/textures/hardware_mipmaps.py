"""Mipmapped textures of the GPU's own: one fetch a pixel where an atlas takes two. Where Warp makes them."""

import inspect
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import warp as wp

from warpcam.kernels.types import Textures
from warpcam.textures.mip_atlas import LARGEST, ROOM
from warpcam.textures.pack import TextureImage, halved, level_sizes

CAN_MAKE = "num_mip_levels" in inspect.signature(wp.Texture2D.__init__).parameters


def pack_mips(images: Sequence[TextureImage], textures: Textures, device: wp.Device) -> list[wp.Texture2D]:
    """Make a mipmapped texture of each image but cubes and write it into ``textures``; none if one of them cannot be.

    Warp makes the levels by itself, so that only images whose own levels are the same can be: sides are powers of two.
    On a CPU there are none. What writes ``textures.texels`` later does not change them.

    Args:
        images: As they were packed.
        textures: What ``pack_textures`` made of them.
        device: Where they lie.

    Returns:
        The textures. They go when these go, and ``textures`` must not be used after that.
    """
    made: list[wp.Texture2D] = []
    places = np.zeros(len(images), np.uint64)
    flat = [index for index, image in enumerate(images) if image.kind == "2d"]
    if device.is_cuda and CAN_MAKE:
        starts, widths, heights = (array.numpy() for array in (textures.start, textures.width, textures.height))
        sides = [(int(widths[index]), int(heights[index])) for index in flat]
        small = all(max(size) <= LARGEST for size in sides) and sum(6 * w * h for w, h in sides) <= ROOM
        for index, (width, height) in zip(flat, sides, strict=True):
            count = sum(w * h for w, h in level_sizes(width, height))
            texels = textures.texels[int(starts[index]) : int(starts[index]) + count].numpy()
            if not (small and are_halved(texels, width, height)):
                made, places[:] = [], 0
                break
            made.append(
                wp.Texture2D(
                    texels[: width * height].view(np.uint8).reshape(height, width, 4),
                    num_mip_levels=0,
                    address_mode=wp.TextureAddressMode.WRAP,
                    device=device,
                )
            )
            places[index] = made[-1].id
    textures.mips = wp.array(places, dtype=wp.uint64, device=device)
    return made


def are_halved(texels: npt.NDArray[np.uint32], width: int, height: int) -> bool:
    """Return whether the sides are powers of two and each level holds the means of four texels of the level before."""
    if width & (width - 1) or height & (height - 1):
        return False
    levels, start = [], 0
    for w, h in level_sizes(width, height):
        levels.append(texels[start : start + w * h].view(np.uint8).reshape(1, h, w, 4))
        start += w * h
    return all(np.array_equal(halved(one), other) for one, other in pairwise(levels))
