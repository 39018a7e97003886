"""Mip atlases: an image and its mipmaps beside each other in one texture of the GPU's own, whose hardware filters it.

Two fetches a pixel take the place of eight texels and their weights; see native/texture/sampler.h.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import warp as wp

from warpcam.kernels.types import Textures
from warpcam.textures.pack import TextureImage, level_sizes

ROOM = 2**28  # bytes of all atlases; images beyond it have none
FLOOR_ROOM = 2**24  # the same where only floors are drawn from them
LARGEST = 2**14  # texels along a side of an image that has one

Bytes = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]

# (face, 3, 3): from a face's own axes, right and down in its image and outwards, to the cube's. OpenGL's faces.
_FROM_FACE = np.array(
    [
        [[0, 0, turn], [0, -1, 0], [-turn, 0, 0]]
        if axis == 0
        else [[1, 0, 0], [0, 0, turn], [0, turn, 0]]
        if axis == 1
        else [[turn, 0, 0], [0, -1, 0], [0, 0, turn]]
        for axis in range(3)
        for turn in (1, -1)
    ],
    np.float32,
)


def pack_mip_atlases(
    images: Sequence[TextureImage], textures: Textures, device: wp.Device, floors: bool = False
) -> list[wp.Texture2D]:
    """Put images in atlases and write these into ``textures``.

    On a CPU there are none. What writes ``textures.texels`` later does not change them.

    Args:
        images: As they were packed.
        textures: What ``pack_textures`` made of them.
        device: Where they lie.
        floors: Only floors are drawn from atlases: no cubes, and no more than ``FLOOR_ROOM``.

    Returns:
        The atlases. They go when these go, and ``textures`` must not be used after that.
    """
    atlases, places = [], np.zeros(len(images), np.uint64)
    if device.is_cuda:
        starts, widths, heights = (array.numpy() for array in (textures.start, textures.width, textures.height))
        left = FLOOR_ROOM if floors else ROOM
        for index, image in enumerate(images):
            width, height = int(widths[index]), int(heights[index])
            faces = 6 if image.kind == "cube" else 1
            size = (6 if faces == 1 else 48) * (width + 2) * (height + 2)
            if faces * max(width, height) > LARGEST or size > left or (faces == 6 and floors):
                continue
            left -= size
            count = faces * sum(w * h for w, h in level_sizes(width, height))
            texels = textures.texels[int(starts[index]) : int(starts[index]) + count].numpy()
            atlas = mip_atlas_of(texels, width, height) if faces == 1 else cube_mip_atlas_of(texels, width)
            atlases.append(wp.Texture2D(atlas, normalized_coords=False, device=device))
            places[index] = atlases[-1].id
    textures.atlases = wp.array(places, dtype=wp.uint64, device=device)
    return atlases


def mip_atlas_of(texels: npt.NDArray[np.uint32], width: int, height: int) -> Bytes:
    """An image and its mipmaps, as ``Textures.texels`` has them, in one atlas: (row, column, 4).

    Level 0 stands on the left, the others below each other beside it. Each has a border of one texel, which repeats
    what is on the other side.
    """
    sizes = level_sizes(width, height)
    rows = max(height + 2, sum(h + 2 for _, h in sizes[1:]))
    columns = width + 2 + (sizes[1][0] + 2 if len(sizes) > 1 else 0)
    atlas = np.zeros((rows, columns, 4), np.uint8)
    start = left = top = 0
    for number, (w, h) in enumerate(sizes):
        level = texels[start : start + w * h].view(np.uint8).reshape(h, w, 4)
        atlas[top : top + h + 2, left : left + w + 2] = np.pad(level, ((1, 1), (1, 1), (0, 0)), "wrap")
        start, left, top = start + w * h, width + 2, top + h + 2 if number else 0
    return atlas


def cube_mip_atlas_of(texels: npt.NDArray[np.uint32], size: int) -> Bytes:
    """A cube and its mipmaps, as ``Textures.texels`` has them, in one atlas: (row, column, 4).

    A level's six faces stand in a row, the levels below each other. Each has a border of one texel: those of the faces
    that it meets there.
    """
    sizes = [side for side, _ in level_sizes(size, size)]
    atlas = np.zeros((sum(side + 2 for side in sizes), 6 * (size + 2), 4), np.uint8)
    start = top = 0
    for side in sizes:
        level = texels[start : start + 6 * side * side].view(np.uint8).reshape(6, side, side, 4)
        rows, columns = _border(side)
        for face in range(6):
            left = face * (side + 2) + 1
            atlas[top + 1 : top + 1 + side, left : left + side] = level[face]
            atlas[top + 1 + rows, left + columns] = level[_beyond(side, face, rows, columns)]
        start, top = start + 6 * side * side, top + side + 2
    return atlas


def _border(side: int) -> tuple[Integers, Integers]:
    """Row and column of the texels around a face, -1 to ``side``."""
    rows, columns = np.mgrid[-1 : side + 1, -1 : side + 1]
    around = (rows < 0) | (columns < 0) | (rows == side) | (columns == side)
    return rows[around], columns[around]


def _beyond(side: int, face: int, rows: Integers, columns: Integers) -> tuple[Integers, Integers, Integers]:
    """Face, row and column of texels one beyond a face's edge: as cube_texel() of native/texture/sampler.h."""
    half = np.float32(0.5 * side)
    right, down = ((places.astype(np.float32) + np.float32(0.5)) / half - 1 for places in (columns, rows))
    direction = _FROM_FACE[face] @ np.stack((right, down, np.ones_like(right)))
    size = np.abs(direction)
    axis = np.where((size[0] >= size[1]) & (size[0] >= size[2]), 0, np.where(size[1] >= size[2], 1, 2))
    faces = 2 * axis + (np.take_along_axis(direction, axis[None], 0)[0] < 0)
    place = np.einsum("nji,jn->in", _FROM_FACE[faces], direction)
    column, row = (np.clip(((p / place[2] + 1) * half).astype(np.int64), 0, side - 1) for p in place[:2])
    return faces, row, column
