"""Images of a folder."""

import io
from pathlib import Path

import numpy as np
from PIL import Image

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess, read_named
from warpcam.sources.common.images import FORMATS, check_pixels

SUFFIXES = (".png", ".jpg", ".jpeg")
LARGEST = 1024  # of a texture's sides [pixels]


def image_files(folder: str, where: str) -> list[Path]:
    """Paths of a folder's images, sorted.

    Raises:
        WarpcamError: There is none.
    """
    found = sorted(path for path in Path(folder).iterdir() if path.suffix.lower() in SUFFIXES)
    if not found:
        raise WarpcamError(f"{where}: {folder!r} has no {', '.join(SUFFIXES)}")
    return found


def read_texture(path: Path) -> np.ndarray:
    """Colours of an image, (height, width, 3) uint8, made smaller if it is larger than a texture needs to be."""
    image = open_image(path)
    image.thumbnail((LARGEST, LARGEST))
    return np.asarray(image)


def read_cover(path: Path, width: int, height: int, left: float, top: float) -> np.ndarray:
    """A part of an image with the wanted shape, as large as it can be, (height, width, 3) uint8.

    Args:
        path: Of the image.
        width: Wanted [pixels].
        height: Wanted [pixels].
        left: Where the part is, from 0, at the left edge, to 1.
        top: Likewise, from the top.
    """
    image = open_image(path)
    scale = min(image.width / width, image.height / height)
    across, down = scale * width, scale * height
    x, y = left * (image.width - across), top * (image.height - down)
    resized = image.resize((width, height), Image.Resampling.BILINEAR, (x, y, x + across, y + down))
    return np.asarray(resized)


def open_image(path: Path) -> Image.Image:
    try:
        with Image.open(io.BytesIO(read_named(path, None, "dataset")), formats=FORMATS) as image:
            check_pixels(image, FileAccess(None, trusted=True), str(path))
            return image.convert("RGB")
    except (OSError, Image.DecompressionBombError) as error:
        raise WarpcamError(f"{path}: it cannot be read as an image: {error}") from None
