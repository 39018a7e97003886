"""Packing images and their mipmaps into the texel array that the kernels read."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import warp as wp

from warpcam.core.color import encoded_beyond, srgb_to_linear
from warpcam.core.errors import WarpcamError
from warpcam.core.lru_cache import LruCache, key_of
from warpcam.kernels.types import TEXTURE_2D, TEXTURE_CUBE, Textures

MAX_TEXELS = 2**31 - 1
CACHE_BYTES = 2**27  # bytes of images with their mipmaps, for the next scene that has them, too

Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class TextureImage:
    """One texture as a source gives it.

    Attributes:
        kind: "2d", or "cube" for cube textures and skyboxes.
        pixels: uint8, rows from the top. (height, width, channels) for "2d"; (6, size, size, channels) for "cube",
            faces +x -x +y -y +z -z, or (size, size, channels) for one image on all six. Channels: 1 (grey),
            3 (RGB) or 4 (RGBA).
        srgb: Whether the texels are sRGB-coded and are to be decoded to linear factors before they are filtered,
            as OpenGL does for a texture of MuJoCo's colour space "sRGB".
        blend_light: Whether the texels are sRGB-coded and stay so, but for the mipmaps, where light is averaged.
    """

    kind: Literal["2d", "cube"]
    pixels: Bytes
    srgb: bool = False
    blend_light: bool = False


Chain = list[npt.NDArray[np.uint32]]

_cache: LruCache[Chain] = LruCache(CACHE_BYTES, lambda chain: sum(level.nbytes for level in chain))


def pack_textures(images: Sequence[TextureImage], device: wp.DeviceLike = None) -> Textures:
    """Build the mipmaps of all images and put them on ``device`` in one array.

    Raises:
        WarpcamError: An image has another shape or dtype than allowed, or the texels are 2^31 or more.
    """
    faces = [_faces(index, image) for index, image in enumerate(images)]
    sizes = [level_sizes(pixels.shape[2], pixels.shape[1]) for pixels in faces]
    counts = [len(pixels) * sum(w * h for w, h in levels) for pixels, levels in zip(faces, sizes, strict=True)]
    total = sum(counts)
    if total > MAX_TEXELS:
        raise WarpcamError(f"textures: {len(faces)} images with mipmaps are {total} texels; at most {MAX_TEXELS} fit")

    texels = np.empty(total, np.uint32)
    starts = np.concatenate(([0], np.cumsum(counts, dtype=np.int64)))[:-1]
    for start, image, pixels, levels in zip(starts, images, faces, sizes, strict=True):
        place = int(start)
        for level in _chain(pixels, image.srgb, len(levels), image.blend_light):
            count = len(pixels) * level.shape[1]
            texels[place : place + count].reshape(len(pixels), -1)[:] = level
            place += count

    def integers(values: Sequence[int]) -> wp.array:
        return wp.array(np.asarray(values, np.int32), dtype=wp.int32, device=device)

    textures = Textures()
    textures.kind = integers([TEXTURE_CUBE if image.kind == "cube" else TEXTURE_2D for image in images])
    textures.width = integers([levels[0][0] for levels in sizes])
    textures.height = integers([levels[0][1] for levels in sizes])
    textures.levels = integers([len(levels) for levels in sizes])
    textures.start = integers([int(start) for start in starts])
    textures.texels = wp.array(texels, dtype=wp.uint32, device=device)
    return textures


def _faces(index: int, image: TextureImage) -> Bytes:
    """The image's pixels as (face, height, width, channels), checked."""
    pixels = np.asarray(image.pixels)
    name = f"textures[{index}]"
    if image.kind not in ("2d", "cube"):
        raise WarpcamError(f'{name}.kind is {image.kind!r}; allowed are "2d" and "cube"')
    if pixels.dtype != np.uint8:
        raise WarpcamError(f"{name}.pixels has dtype {pixels.dtype}; allowed is uint8")
    if image.kind == "cube" and pixels.ndim == 3:
        pixels = np.broadcast_to(pixels, (6, *pixels.shape))
    if image.kind == "2d" and pixels.ndim == 3:
        pixels = pixels[None]
    shape = pixels.shape
    fits = len(shape) == 4 and shape[1] > 0 and shape[2] > 0 and shape[3] in (1, 3, 4)
    if image.kind == "2d":
        if not fits or shape[0] != 1:
            raise WarpcamError(f"{name}.pixels has shape {image.pixels.shape}; allowed is (height, width, 1, 3 or 4)")
    elif not fits or shape[0] != 6 or shape[1] != shape[2]:
        raise WarpcamError(f"{name}.pixels has shape {image.pixels.shape}; allowed is (6, size, size, 1, 3 or 4)")
    return pixels


def level_sizes(width: int, height: int) -> list[tuple[int, int]]:
    """(width, height) of each mipmap level, halving down to 1 x 1."""
    sizes = [(width, height)]
    while sizes[-1] != (1, 1):
        width, height = max(width // 2, 1), max(height // 2, 1)
        sizes.append((width, height))
    return sizes


def _rgba(pixels: Bytes, srgb: bool) -> Bytes:
    """(face, height, width, 4): grey repeated, alpha 255 where there is none."""
    channels = pixels.shape[3]
    full = np.full((*pixels.shape[:3], 4), 255, np.uint8)
    color = _linear_from_srgb()[pixels[..., :3]] if srgb else pixels[..., :3]
    full[..., :3] = color
    if channels == 4:
        full[..., 3] = pixels[..., 3]
    return full


def _linear_from_srgb() -> Bytes:
    """Table of the sRGB transfer function (IEC 61966-2-1), bytes to bytes."""
    return np.rint(255.0 * srgb_to_linear(np.arange(256) / 255.0)).astype(np.uint8)


def _chain(pixels: Bytes, srgb: bool, levels: int, blend_light: bool) -> Chain:
    """An image and its mipmaps, (face, texel) each; one face where all six are the same."""
    if pixels.strides[0] == 0:
        pixels = pixels[:1]

    def build() -> Chain:
        image, chain = _rgba(pixels, srgb), []
        for level in range(levels):
            if level:
                image = _halve_light(image) if blend_light else halved(image)
            chain.append(np.ascontiguousarray(image).view("<u4").reshape(len(image), -1))
        return chain

    return _cache.get(key_of(pixels, srgb, levels, blend_light), build)


def halved(image: Bytes) -> Bytes:
    """The next mipmap level: each texel the mean of what it covers, odd sizes weighted by overlap."""
    if image.shape[1] % 2 == 0 and image.shape[2] % 2 == 0:
        pairs = np.add(image[:, 0::2], image[:, 1::2], dtype=np.uint16)
        sums = pairs[:, :, 0::2] + pairs[:, :, 1::2]
        return ((sums + 1 + ((sums >> 2) & 1)) >> 2).astype(np.uint8)  # to the nearest, halves to the even, as below
    rows = _halve_axis(image.astype(np.float32), 1)
    return np.rint(_halve_axis(rows, 2)).astype(np.uint8)


def _halve_light(image: Bytes) -> Bytes:
    """Halve an image of sRGB-coded texels, which are decoded to average them."""
    linear = srgb_to_linear(image[..., :3] / np.float32(255.0))
    light = _halve_axis(_halve_axis(linear, 1), 2)
    shown = encoded_beyond(light)
    alpha = halved(np.ascontiguousarray(image))[..., 3:]
    return np.ascontiguousarray(np.concatenate((np.rint(255.0 * shown).astype(np.uint8), alpha), axis=-1))


def _halve_axis(image: npt.NDArray[np.float32], axis: int) -> npt.NDArray[np.float32]:
    size = image.shape[axis]
    half = size // 2
    if half == 0:
        return image
    image = np.moveaxis(image, axis, 0)
    first, second = image[0 : 2 * half : 2], image[1 : 2 * half : 2]
    if size % 2 == 0:
        result = 0.5 * (first + second)
    else:
        # OpenGL does not say how; what it does in practice is to look the middle of the new texel up between two.
        place = (np.arange(half, dtype=np.float32) + 0.5) * (size / half) - 0.5
        before = np.floor(place).astype(np.int64)
        weight = (place - before).reshape(-1, *[1] * (image.ndim - 1)).astype(np.float32)
        result = (1.0 - weight) * image[before] + weight * image[before + 1]
    return np.moveaxis(result, 0, axis)
