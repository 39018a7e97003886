"""Sheets: an image and its mipmaps beside each other in one texture of the GPU's own, whose hardware filters it.

Floors are looked up there (native/floor.h): two fetches a pixel instead of eight texels and their weights.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import warp as wp

from warpcam.accel.textures import TextureImage, level_sizes
from warpcam.kernels.types import Textures

ROOM = 2**28  # bytes of all sheets; images beyond it have none
LARGEST = 2**14  # texels along a side of an image that has one

Bytes = npt.NDArray[np.uint8]


def pack_sheets(images: Sequence[TextureImage], textures: Textures, device: wp.Device) -> list[wp.Texture2D]:
    """Put images of kind "2d" on sheets and write these into ``textures``.

    Images that are painted later have none, nor has anything on a CPU.

    Args:
        images: As they were packed.
        textures: What ``pack_textures`` made of them.
        device: Where they lie.

    Returns:
        The sheets. They go when these go, and ``textures`` must not be used after that.
    """
    sheets, places = [], np.zeros(len(images), np.uint64)
    if device.is_cuda:
        starts, widths, heights = (array.numpy() for array in (textures.start, textures.width, textures.height))
        left = ROOM
        for index, image in enumerate(images):
            width, height = int(widths[index]), int(heights[index])
            left -= 6 * width * height
            if image.kind != "2d" or image.painted or max(width, height) > LARGEST or left < 0:
                continue
            count = sum(w * h for w, h in level_sizes(width, height))
            texels = textures.texels[int(starts[index]) : int(starts[index]) + count].numpy()
            sheets.append(wp.Texture2D(sheet_of(texels, width, height), normalized_coords=False, device=device))
            places[index] = sheets[-1].id
    textures.sheets = wp.array(places, dtype=wp.uint64, device=device)
    return sheets


def sheet_of(texels: npt.NDArray[np.uint32], width: int, height: int) -> Bytes:
    """An image and its mipmaps, as ``Textures.texels`` has them, on one sheet: (row, column, 4).

    Level 0 stands on the left, the others below each other beside it. Each has a border of one texel, which repeats
    what is on the other side.
    """
    sizes = level_sizes(width, height)
    rows = max(height + 2, sum(h + 2 for _, h in sizes[1:]))
    columns = width + 2 + (sizes[1][0] + 2 if len(sizes) > 1 else 0)
    sheet = np.zeros((rows, columns, 4), np.uint8)
    start = left = top = 0
    for number, (w, h) in enumerate(sizes):
        level = texels[start : start + w * h].view(np.uint8).reshape(h, w, 4)
        sheet[top : top + h + 2, left : left + w + 2] = np.pad(level, ((1, 1), (1, 1), (0, 0)), "wrap")
        start, left, top = start + w * h, width + 2, top + h + 2 if number else 0
    return sheet
