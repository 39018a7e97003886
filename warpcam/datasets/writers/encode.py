"""Images as bytes."""

import io

import numpy as np
from PIL import Image

from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.writers.writer import ShardLayout

FAST = 1  # of zlib's levels: on renderings higher ones take several times as long for a tenth less


def encode_frame(frame: Frame, layout: ShardLayout) -> bytes:
    """Colours of a frame as the file that the layout wants."""
    return frame.jpeg or encode_colors(frame.colors, layout.image_format, layout.quality)


def encode_colors(colors: np.ndarray, image_format: str, quality: int) -> bytes:
    """Display colours (height, width, 3) uint8 as .png or .jpg."""
    if image_format == "png":
        return encode_png(colors)
    buffer = io.BytesIO()
    Image.fromarray(colors).save(buffer, "JPEG", quality=quality, subsampling=0)
    return buffer.getvalue()


def encode_png(image: np.ndarray) -> bytes:
    """An image of uint8, with 1 or 3 channels, or of uint16 with 1, as .png."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", compress_level=FAST)
    return buffer.getvalue()


def millimeters(depth: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Depth [m] in units of ``scale`` mm, uint16; 0 where nothing is hit or the number does not fit."""
    units = np.where(np.isfinite(depth), depth, 0.0) * (1000.0 / scale)
    return np.where((units > 0.0) & (units < 65535.5), np.round(units), 0.0).astype(np.uint16)
