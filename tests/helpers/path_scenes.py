"""Scenes for the path tracer, and how their images are compared: pixels are means of random paths."""

from typing import Any

import numpy as np
import warp as wp

import warpcam as wc

BLOCK = 8  # pixels a side of a block, over which noise is averaged


def traced(
    scene: wc.Scene, camera: wc.Camera, samples: int, *, device: wp.Device | None = None, **options: Any
) -> dict[str, np.ndarray]:
    """The images of world 0 by paths of light."""
    renderer = wc.Renderer(scene, [camera], look="path", path=wc.PathOptions(samples=samples, **options))
    return {name: image[0].cpu().numpy() for name, image in renderer.render()[camera.name].items()}


def blocks(image: np.ndarray) -> np.ndarray:
    """Means of blocks of pixels, (height / BLOCK, width / BLOCK, channel)."""
    height, width, channels = image.shape
    return image.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, channels).mean(axis=(1, 3))


def inside(hit: np.ndarray) -> np.ndarray:
    """The pixels all of whose neighbours see what it sees, too."""
    padded = np.pad(hit, 1)
    neighbours = [padded[1 + j : padded.shape[0] - 1 + j, 1 + i : padded.shape[1] - 1 + i] for j in (-1, 0, 1)
                  for i in (-1, 0, 1)]  # fmt: skip
    return np.logical_and.reduce(neighbours)
