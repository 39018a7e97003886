"""From images to pictures that people look at: every output as colours, all worlds in one sheet."""

from collections.abc import Callable, Mapping

import numpy as np
from cmap import Colormap

from warpcam.outputs import OUTPUTS

GAP = 2  # between the worlds of a sheet [pixels]
PAPER = 255  # grey of the sheet behind them
NOTHING = 0  # grey of a pixel that hit nothing


def from_colors(images: np.ndarray) -> np.ndarray:
    """Display colours as they are."""
    return images


def from_radiance(images: np.ndarray) -> np.ndarray:
    """Radiance clipped to what a display shows."""
    return np.round(255.0 * np.clip(np.nan_to_num(images), 0.0, 1.0)).astype(np.uint8)


def from_lengths(images: np.ndarray) -> np.ndarray:
    """Lengths [m] by their inverse, as eyes judge them, through the colour map viridis: near bright, far dark."""
    lengths = images[..., 0]
    seen = np.isfinite(lengths) & (lengths > 0.0)
    if not seen.any():
        return np.full((*lengths.shape, 3), NOTHING, dtype=np.uint8)
    nearness = 1.0 / np.where(seen, lengths, 1.0)
    low, high = np.percentile(nearness[seen], (2.0, 99.5))
    shade = np.clip((nearness - low) / max(high - low, 1e-6), 0.0, 1.0)
    return _where(seen, _mapped("viridis", 0.04 + 0.96 * shade))


def from_ids(images: np.ndarray) -> np.ndarray:
    """Ids through the colour map turbo, in two strengths; the same id always has the same colour."""
    ids = np.maximum(images[..., 0], 0)
    # The golden ratio's counterpart in the plane: ids in a row are far apart, and repeats are late.
    hue, strength = np.modf(0.15 + 0.7548776662 * ids)[0], np.modf(0.9 + 0.5698402910 * ids)[0]
    colors = _mapped("turbo", 0.05 + 0.9 * hue) * (0.55 + 0.45 * strength[..., None])
    return _where(images[..., 0] >= 0, np.round(colors).astype(np.uint8))


def from_labels(images: np.ndarray) -> np.ndarray:
    """Numbers of labels as ids are; 0 is none of them."""
    return from_ids(np.where(images == 0, -1, images))


def from_directions(images: np.ndarray) -> np.ndarray:
    """Unit vectors, each axis from [-1, 1] to [0, 255]; zero vectors are nothing."""
    seen = np.abs(images).sum(axis=-1) > 0.0
    return _where(seen, np.round(127.5 * (np.clip(np.nan_to_num(images), -1.0, 1.0) + 1.0)).astype(np.uint8))


def from_points(images: np.ndarray) -> np.ndarray:
    """Positions: x, y and z as red, green and blue, evenly around where most of them are, and ever slower beyond."""
    seen = np.isfinite(images).all(axis=-1)
    if not seen.any():
        return np.full(images.shape, NOTHING, dtype=np.uint8)
    low, middle, high = np.percentile(images[seen], (20.0, 50.0, 80.0), axis=0)
    reach = np.maximum(high - low, 0.1 * (high - low).max() + 1e-6)
    offset = (np.where(seen[..., None], images, 0.0) - middle) / reach
    return _where(seen, np.round(127.5 * (1.0 + offset / (1.0 + np.abs(offset)))).astype(np.uint8))


def from_flow(images: np.ndarray) -> np.ndarray:
    """Motion on the usual wheel: right is red, down yellow-green, left cyan, up violet; what rests is white."""
    length = np.linalg.norm(images, axis=-1, keepdims=True)
    moving = length[length > 0.0]
    longest = float(np.percentile(moving, 99.0)) if moving.size else 1.0
    strength = np.clip(length / max(longest, 1e-6), 0.0, 1.0)
    hue = np.arctan2(images[..., 1], images[..., 0]) / (2.0 * np.pi) % 1.0
    return np.round(strength * _mapped("hsv", hue) + (1.0 - strength) * 255.0).astype(np.uint8)


def from_flags(images: np.ndarray) -> np.ndarray:
    """White where set."""
    return np.repeat(np.where(images > 0, 255, 0).astype(np.uint8), 3, axis=-1)


def from_weights(images: np.ndarray) -> np.ndarray:
    """Barycentric weights of a triangle's first, second and third corner as red, green and blue."""
    first = 1.0 - images.sum(axis=-1, keepdims=True)
    seen = np.abs(images).sum(axis=-1) > 0.0
    return _where(seen, np.round(255.0 * np.clip(np.concatenate((first, images), axis=-1), 0.0, 1.0)).astype(np.uint8))


# By the names that rows of OUTPUTS have for them.
PICTURES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "colors": from_colors,
    "radiance": from_radiance,
    "lengths": from_lengths,
    "directions": from_directions,
    "points": from_points,
    "ids": from_ids,
    "labels": from_labels,
    "flow": from_flow,
    "flags": from_flags,
    "weights": from_weights,
}


def picture(output: str, images: np.ndarray) -> np.ndarray:
    """Images of one output, (world, height, width, channels), as display colours, uint8 with 3 or 4 channels.

    Colour scales are shared by all worlds of the call.
    """
    return PICTURES[OUTPUTS[output].picture](images)


def sheet(pictures: np.ndarray) -> np.ndarray:
    """Pictures (world, height, width, channels) side by side, row after row, as near to a square as they go."""
    worlds, height, width, channels = pictures.shape
    columns = max(1, min(worlds, round(np.sqrt(worlds * height / width))))
    rows = -(-worlds // columns)
    paper = np.full((rows * (height + GAP) - GAP, columns * (width + GAP) - GAP, channels), PAPER, dtype=np.uint8)
    for world, image in enumerate(pictures):
        top, left = world // columns * (height + GAP), world % columns * (width + GAP)
        paper[top : top + height, left : left + width] = image
    return paper


def _mapped(name: str, shade: np.ndarray) -> np.ndarray:
    table = np.round(255.0 * Colormap(name).lut(256)[:, :3]).astype(np.uint8)
    colors: np.ndarray = table[np.round(255.0 * shade).astype(np.uint8)]
    return colors


def _where(seen: np.ndarray, colors: np.ndarray) -> np.ndarray:
    return np.where(seen[..., None], colors, np.uint8(NOTHING))
