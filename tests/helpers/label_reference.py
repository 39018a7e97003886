"""Labels as they follow from images of each instance alone: all other shapes are made invisible."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

import warpcam as wc


class AloneImages:
    """Images of a renderer's scene in which one instance alone can be seen.

    To be made before the renderer, as the scene then has colours of its own in each world.
    """

    def __init__(self, scene: wc.Scene):
        self._colors = scene.vary("shape_colors")
        self._all = self._colors.clone()

    def masks(self, renderer: wc.Renderer, shapes: Sequence[Any], output: str) -> Mapping[Any, np.ndarray]:
        """Where each instance is seen, (instance, world, height, width) bool, by camera.

        Args:
            renderer: Its cameras draw ``output``, an image of ids that is not negative where something is hit.
            shapes: Columns of each instance's shapes.
            output: The image.
        """
        found: dict[Any, list[np.ndarray]] = {}
        for columns in shapes:
            alone = self._all.clone()
            alone[:, :, 3] = 0.0
            alone[:, list(columns)] = self._all[:, list(columns)]
            self._colors.copy_(alone)
            for key, images in renderer.render().items():
                found.setdefault(key, []).append(images[output][..., 0].cpu().numpy() >= 0)
        self._colors.copy_(self._all)
        return {key: np.stack(masks) for key, masks in found.items()}


def extents(masks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (instance, world, 4), zeros for empty masks, and pixels (instance, world) of masks."""
    boxes = np.zeros((*masks.shape[:2], 4), np.int64)
    for at in np.ndindex(*masks.shape[:2]):
        rows, columns = masks[at].any(axis=1).nonzero()[0], masks[at].any(axis=0).nonzero()[0]
        if len(rows):
            boxes[at] = columns[0], rows[0], columns[-1] + 1, rows[-1] + 1
    return boxes, masks.sum(axis=(2, 3))


def on_host(labels: wc.CameraLabels) -> dict[str, np.ndarray]:
    return {name: value.cpu().numpy().copy() for name, value in vars(labels).items() if isinstance(value, torch.Tensor)}


def turned(quaternion: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned by quaternions w x y z (..., 4)."""
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    across = np.cross(axis, vectors)
    return vectors + 2.0 * (w * across + np.cross(axis, across))


def box_points(labels: Mapping[str, np.ndarray]) -> np.ndarray:
    """Corners of boxes in the camera's frame, (world, instance, 8, 3)."""
    signs = np.array([[1.0 if corner >> axis & 1 else -1.0 for axis in range(3)] for corner in range(8)])
    local = labels["box_centers"][..., None, :] + signs * labels["half_extents"][..., None, :]
    return labels["positions"][..., None, :] + turned(labels["rotations"][..., None, :], local)
