"""Image files as textures."""

import io
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError

from warpcam.core import torch_interop
from warpcam.core.color import encoded_beyond, srgb_to_linear
from warpcam.core.errors import RefusedError, WarpcamError
from warpcam.core.file_access import FileAccess, Limits
from warpcam.textures.pack import TextureImage

MAX_TILES = 4  # of an image that is repeated in another way than the kernels do, along each side
BORDER, PART = 8, 8  # texels around an image that does not repeat, at least, and its side over that: what filters reach
SHARP_SIDE, SHARP_SCALE = 1024, 16  # of an image that is not smoothed [texels]; times as large as it was, at most
CUBE_SIDE = 512  # of a skybox, at most [pixels]
TRANSFER = np.arange(256) / 255.0
ENCODED = np.rint(255.0 * encoded_beyond(TRANSFER)).astype(np.uint8)
LINEAR = srgb_to_linear(TRANSFER)


# Formats of Pillow that are read; others start programs (EPS) or name other files.
FORMATS = ("AVIF", "BMP", "DDS", "GIF", "JPEG", "JPEG2000", "PCX", "PNG", "PPM", "SGI", "TGA", "TIFF", "WEBP")


class UnreadableError(Exception):
    """An image cannot be read; the text says why."""


def decoded(data: bytes, access: FileAccess, name: str) -> np.ndarray:
    """Pixels of an image file, (height, width, 1, 3 or 4) uint8.

    Args:
        data: Of the file.
        access: Of the scene: limits of sizes, which count before pixels are decoded.
        name: Of the file, for messages.

    Raises:
        RefusedError: It is too large.
        UnreadableError: Nothing here knows the format, or it is broken.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data), formats=FORMATS) as image:
                check_pixels(image, access, name)
                return pixels_of(image)
    except RefusedError:
        raise
    except Image.DecompressionBombError as error:
        most = access.limits.image_pixels
        raise RefusedError(
            f"{name}: {error}: Pillow's own, by PIL.Image.MAX_IMAGE_PIXELS; image_pixels of limits is {most:,}; if "
            "that is meant, give both, the latter by limits=warpcam.Limits(image_pixels=...)"
        ) from None
    except UnidentifiedImageError:
        raise UnreadableError("its format is not known") from None
    except (OSError, ValueError, SyntaxError, MemoryError) as error:
        raise UnreadableError(" ".join(str(error).split())) from None


def check_pixels(image: Image.Image, access: FileAccess, name: str) -> None:
    """Raise ``RefusedError`` if an image, whose header is read, is too large to be decoded."""
    access.check("image_pixels", image.width * image.height, name)
    access.take(4 * image.width * image.height, name)


def pixels_of(image: Image.Image) -> np.ndarray:
    """(height, width, 1, 3 or 4) uint8."""
    if image.mode.startswith("I") or image.mode == "F":
        values = np.asarray(image, np.float64)
        top = 65535.0 if image.mode.startswith("I") else 1.0
        return np.rint(255.0 * np.clip(values / top, 0.0, 1.0)).astype(np.uint8)[..., None]
    if image.mode not in ("L", "RGB", "RGBA"):
        transparent = image.mode in ("LA", "PA", "La", "RGBa") or "transparency" in image.info
        image = image.convert("RGBA" if transparent else "L" if image.mode == "1" else "RGB")
    pixels = np.asarray(image, np.uint8)
    return pixels[..., None] if pixels.ndim == 2 else pixels


def named_images(images: Mapping[str, Any], limits: Limits) -> dict[str, TextureImage]:
    """A user's images, by the names that he gives them: paths, or arrays (height, width, 1, 3 or 4) uint8.

    The paths are the user's own, and may lead anywhere.
    """
    access = FileAccess(None, trusted=True, limits=limits)
    if not isinstance(images, Mapping):
        raise WarpcamError(f"textures must map names to images, got {type(images).__name__}")
    found = {}
    for name, image in images.items():
        if isinstance(image, str | Path):
            try:
                pixels = decoded(access.read(Path(image)), access, f"textures: {name!r}: {str(image)!r}")
            except OSError as error:
                raise WarpcamError(
                    f"textures: {name!r}: {str(image)!r} cannot be read: {error.strerror or error}"
                ) from None
            except UnreadableError as error:
                raise WarpcamError(f"textures: {name!r}: {str(image)!r} cannot be read: {error}") from None
        else:
            pixels = np.asarray(torch_interop.to_numpy(image))
            if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] not in (1, 3, 4):
                raise WarpcamError(
                    f"textures: {name!r} must be a path or (height, width, 1, 3 or 4) uint8, got {pixels.dtype} "
                    f"{pixels.shape}"
                )
        found[str(name)] = TextureImage("2d", pixels, blend_light=True)
    return found


def ply_colors(rows: Any, count: int) -> np.ndarray | None:
    """Colours of a PLY file's vertices or faces, (row, 3 or 4) uint8, by the names of its properties; None if none."""
    names = getattr(getattr(rows, "dtype", None), "names", None) or (rows if isinstance(rows, dict) else ())
    for keys in (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b")):
        if all(key in names for key in keys):
            found = (*keys, *(key for key in ("alpha", "a") if key in names))[:4]
            try:
                columns = [_byte(np.asarray(rows[key]).reshape(-1)) for key in found]
            except (TypeError, ValueError):
                raise WarpcamError(f"{', '.join(found)} of a PLY file must be one number in each row") from None
            return np.stack(columns, axis=1) if all(len(column) == count for column in columns) else None
    return None


def _byte(values: np.ndarray) -> np.ndarray:
    """Numbers of any type as uint8: the greatest of a type of integers, and 1.0, are 255."""
    if values.dtype.kind == "f":
        values = np.rint(255.0 * np.clip(np.nan_to_num(values), 0.0, 1.0))
    elif values.dtype.itemsize == 2:
        values = np.rint(values * (255.0 / np.iinfo(values.dtype).max))
    return np.clip(values, 0, 255).astype(np.uint8)


def wrapped(
    pixels: np.ndarray, wrap: tuple[str, str], low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """An image for texture coordinates from ``low`` to ``high``, (2,), that repeats in another way than the kernels do.

    Args:
        pixels: (height, width, channels).
        wrap: "repeat", "mirror", "clamp" or "black", along u and v.
        low: Of the coordinates, v up.
        high: Of the coordinates.

    Returns:
        The image, and scale and offset, (2,) each, that take the coordinates to its own; None if it is as it was.
    """
    scale, offset = np.ones(2), np.zeros(2)
    for axis in (0, 1):
        if wrap[axis] == "repeat":
            continue
        size = pixels.shape[1 - axis]
        border = max(BORDER, size // PART)
        first, last = 0, 1
        if low[axis] < -1e-3 or high[axis] > 1.0 + 1e-3:
            if wrap[axis] == "mirror":
                first, last, border = 0, 2, 0
            else:
                first = max(int(np.floor(low[axis] + 1e-3)), 1 - MAX_TILES)
                last = min(max(int(np.ceil(high[axis] - 1e-3)), first + 1), first + MAX_TILES)
        place = np.arange(first * size - border, last * size + border)
        row = np.clip(place, 0, size - 1)
        if wrap[axis] == "mirror":
            row = np.abs((place + size) % (2 * size) - size + 0.5).astype(int)
        outside = (place < 0) | (place >= size)
        if axis == 1:  # v runs up, rows down
            row, outside = size - 1 - row[::-1], outside[::-1]
        pixels = np.take(pixels, row, axis=1 - axis)
        if wrap[axis] == "black":
            pixels = pixels.copy()
            pixels[(slice(None), outside) if axis == 0 else outside] = 0
        scale[axis] = size / len(place)
        offset[axis] = -place[0] / len(place)
    return None if (scale == 1.0).all() and (offset == 0.0).all() else (pixels, scale, offset)


def sharp(pixels: np.ndarray) -> np.ndarray:
    """An image that is not to be smoothed, larger: the kernels smooth only between its texels."""
    times = max(min(SHARP_SIDE // max(pixels.shape[:2]), SHARP_SCALE), 1)
    return pixels.repeat(times, axis=0).repeat(times, axis=1)


def corner_colors(colors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colours of triangles' corners, (triangle, 3, channel) uint8, as an image and texture coordinates.

    The latter are (triangle, 3, 2).

    Each different triangle gets 2 x 2 texels, three of them its corners; between their centres the kernels blend just
    as they do between corners, as long as the fourth, which the other three make, is a colour at all.
    """
    wide = colors.astype(np.int16)
    fourth = wide.sum(axis=1, keepdims=True) - 2 * wide  # with each of the corners across from it
    beyond = (np.maximum(-fourth, 0) + np.maximum(fourth - 255, 0)).sum(axis=-1)
    order = (np.argmin(beyond, axis=1)[:, None] + np.arange(3)) % 3
    turned = np.take_along_axis(colors, order[..., None], axis=1)
    blocks, which = np.unique(turned.reshape(len(turned), -1), axis=0, return_inverse=True)
    corners = blocks.reshape(len(blocks), 3, -1).astype(np.int16)
    columns = max(int(np.ceil(np.sqrt(len(blocks)))), 1)
    rows = max(-(-len(blocks) // columns), 1)
    image = np.zeros((rows, 2, columns, 2, colors.shape[2]), np.uint8)
    y, x = np.divmod(np.arange(len(blocks)), columns)
    image[y, 0, x, 0], image[y, 0, x, 1], image[y, 1, x, 0] = corners[:, 0], corners[:, 1], corners[:, 2]
    image[y, 1, x, 1] = np.clip(corners[:, 1] + corners[:, 2] - corners[:, 0], 0, 255)
    left, top = 2 * x[which.reshape(-1)], 2 * y[which.reshape(-1)]
    u = np.stack((left, left + 1, left), axis=1) + 0.5
    v = np.stack((top, top, top + 1), axis=1) + 0.5
    # One colour has one place: from far away nothing of the colours beside it is mixed in.
    plain = (colors == colors[:, :1]).all(axis=(1, 2))
    u[plain], v[plain] = left[plain, None] + 1.0, top[plain, None] + 1.0
    uvs = np.empty((len(colors), 3, 2), np.float32)
    np.put_along_axis(uvs, order[..., None], np.stack((u / (2 * columns), 1.0 - v / (2 * rows)), axis=-1), axis=1)
    return image.reshape(2 * rows, 2 * columns, -1), uvs


def cube_of_panorama(pixels: np.ndarray, turn: np.ndarray) -> TextureImage:
    """A skybox from an image by longitude and latitude, as UsdLux domes have it.

    Args:
        pixels: (height, width, channels); its middle lies along +z, its top is +y, of the dome.
        turn: (3, 3), rotation from the dome's axes to the world's.
    """
    height, width = pixels.shape[:2]
    side = max(min(width // 4, CUBE_SIDE), 1)
    at = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    u, v = np.meshgrid(at, at)  # to the right and down on a face
    one = np.ones_like(u)
    faces = ((one, -v, -u), (-one, -v, u), (u, one, v), (u, -one, -v), (u, -v, one), (-u, -v, -one))
    cube = np.empty((6, side, side, pixels.shape[2]), np.uint8)
    for face, axes in enumerate(faces):
        x, y, z = axes
        direction = np.stack((x, -z, y), axis=-1)  # in the world: the kernels' skybox lies on its side
        direction = (direction / np.linalg.norm(direction, axis=-1, keepdims=True)) @ turn
        longitude = np.arctan2(direction[..., 0], direction[..., 2])
        latitude = np.arcsin(np.clip(direction[..., 1], -1.0, 1.0))
        column = np.clip(((0.5 - longitude / (2.0 * np.pi)) * width).astype(int) % width, 0, width - 1)
        row = np.clip(((0.5 - latitude / np.pi) * height).astype(int), 0, height - 1)
        cube[face] = pixels[row, column]
    return TextureImage("cube", cube, blend_light=True)


def packed(channels: Sequence[np.ndarray | None]) -> np.ndarray | None:
    """Maps of one channel, (height, width) in [0, 1], as the channels of one image, uint8; None is 1, or no image."""
    known = [channel for channel in channels if channel is not None]
    if not known:
        return None
    size = max(channel.shape[0] for channel in known), max(channel.shape[1] for channel in known)
    image = np.full((*size, 3), 255, np.uint8)
    for place, channel in enumerate(channels):
        if channel is not None:
            image[..., place] = resized(np.rint(255.0 * np.clip(channel, 0.0, 1.0)).astype(np.uint8), size)
    return image


def resized(channel: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(height, width) or (height, width, 1, 3 or 4) uint8 of that size."""
    if channel.shape[:2] == size:
        return channel
    if channel.ndim == 3:
        return np.stack([resized(channel[..., place], size) for place in range(channel.shape[2])], axis=2)
    return np.asarray(Image.fromarray(channel).resize((size[1], size[0]), Image.Resampling.BILINEAR))


def map_of_normals(values: np.ndarray) -> np.ndarray:
    """Vectors with components in [-1, 1], (height, width, 3), as the kernels have them."""
    return np.rint(127.5 * (np.clip(values, -1.0, 1.0) + 1.0)).astype(np.uint8)
