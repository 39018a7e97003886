"""scene_gt_coco.json of a BOP scene: boxes and masks in COCO's format, as BOP's detection tasks read them.

Boxes are those of whole silhouettes within the image, masks those of what is seen, uncompressed. What is seen by less
than a tenth is marked to be ignored, as in the benchmark.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from warpcam.datasets.generate.frames import Frame, Instance
from warpcam.datasets.writers.writer import ShardLayout

IGNORED = 0.1  # visible share below which an annotation does not count


class SceneAnnotations:
    """Images and annotations of one scene, whose numbers are those of its images."""

    def __init__(self, layout: ShardLayout):
        self._layout = layout
        self._images: list[dict[str, Any]] = []
        self._annotations: list[dict[str, Any]] = []

    def add(self, number: int, annotations: Sequence[dict[str, Any]]) -> None:
        """Add an image, and what ``annotation`` made of its instances."""
        size = {"width": self._layout.width, "height": self._layout.height}
        name = f"rgb/{number:06d}.{self._layout.image_format}"
        self._images.append({"id": number, "file_name": name, **size})
        for each in annotations:
            self._annotations.append({"id": len(self._annotations) + 1, "image_id": number, **each, **size})

    def whole(self) -> dict[str, Any]:
        """Content of the file."""
        named = enumerate(self._layout.models, 1)
        categories = [{"id": number, "name": model.name, "supercategory": ""} for number, model in named]
        about: dict[str, Any] = {"info": {"description": "made by warpcam"}, "licenses": [], "categories": categories}
        return about | {"images": self._images, "annotations": self._annotations}


def annotation(frame: Frame, instance: Instance) -> dict[str, Any]:
    """Annotation of a visible instance, without numbers of its own and of its image."""
    left, top, right, bottom = instance.amodal_box
    mask = frame.mask(instance)
    return {
        "category_id": instance.model + 1,
        "iscrowd": 0,
        "area": instance.visible_pixels,
        "bbox": [left, top, right - left, bottom - top],
        "segmentation": {"size": list(mask.shape), "counts": run_lengths(mask)},
        "ignore": instance.visible_pixels < IGNORED * instance.whole_pixels,
    }


def run_lengths(mask: np.ndarray) -> list[int]:
    """Lengths of runs of a mask (height, width) bool, column after column, first of pixels that it lacks."""
    flat = np.concatenate(([False], mask.ravel(order="F")))
    starts = np.flatnonzero(np.diff(flat)).tolist()
    return np.diff([0, *starts, mask.size]).tolist()
