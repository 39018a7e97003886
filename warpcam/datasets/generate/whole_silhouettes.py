"""Silhouettes of instances beyond the edges of the image, as BOP counts them."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

import warpcam

MARGIN = 1  # widths and heights of the image around it


class WholeSilhouettes:
    """Labels of a canvas that is larger than the image on all sides, drawn with the same pinhole.

    Args:
        renderer: Draws the images.
        cameras: Of the renderer.
        by: What an instance is.
        ids: Of the instances.
        output: Image of their ids.
    """

    def __init__(
        self, renderer: warpcam.Renderer, cameras: Sequence[warpcam.Camera], by: Any, ids: Sequence[int], output: str
    ):
        scene = renderer.scene
        numbers = np.ones(scene.num_worlds)
        lens = warpcam.Pinhole(fx=numbers, fy=numbers, cx=numbers, cy=numbers)
        self._drawn = renderer
        self._sizes = {camera.name: (camera.width, camera.height) for camera in cameras}
        self._moved = [camera.name for camera in cameras if camera.is_own]
        wide = [
            dataclasses.replace(
                camera,
                width=(2 * MARGIN + 1) * camera.width,
                height=(2 * MARGIN + 1) * camera.height,
                outputs=(output,),
                lens=lens,
                shadows=False,
                antialiasing=1,
                background=None,
                exposure=None,
                gain=None,
                tone_mapping="clip",
                auto_exposure=None,
                bloom=None,
            )
            for camera in cameras
        ]
        self._renderer = warpcam.Renderer(scene, wide)
        self._labels = warpcam.labels(self._renderer, by=by, ids=ids)

    def read(self) -> Mapping[str | int, tuple[torch.Tensor, torch.Tensor]]:
        """Boxes, (world, instance, 4) int32, and pixels, (world, instance) int32, for the poses of now, by camera.

        Boxes are half-open, in the image's pixels, and may begin below 0.
        """
        for key, (width, height) in self._sizes.items():
            views, arrays = self._drawn.views(key).numpy(), self._renderer.camera(key)
            focal, center = 1.0 / views["scale"], views["center"] + MARGIN * np.array((width, height))
            arrays.intrinsics.copy_(torch.from_numpy(np.hstack((focal, center)).astype(np.float32)))
            if key in self._moved:
                arrays.position.copy_(self._drawn.camera(key).position)
                arrays.rotation.copy_(self._drawn.camera(key).rotation)
        self._renderer.render()
        found = self._labels.read()
        silhouettes: dict[str | int, tuple[torch.Tensor, torch.Tensor]] = {}
        for key, (width, height) in self._sizes.items():
            corner = torch.tensor((width, height) * 2, dtype=torch.int32, device=found[key].amodal_boxes.device)
            silhouettes[key] = found[key].amodal_boxes - MARGIN * corner, found[key].amodal_pixels
        return silhouettes
