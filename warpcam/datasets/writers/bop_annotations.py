"""scene_gt_coco.json of a BOP scene: boxes and masks in COCO's format, as BOP's detection tasks read them.

Boxes are those of whole silhouettes within the image, masks those of what is seen, uncompressed. What is seen by less
than a tenth is marked to be ignored, as in the benchmark.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from warpcam.datasets.generate.frames import Instance
from warpcam.datasets.writers.run_lengths import run_lengths
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


def annotation(by_column: np.ndarray, instance: Instance) -> dict[str, Any]:
    """Annotation of a visible instance, without its own number and its image's; ids are as ``run_lengths`` has them."""
    left, top, right, bottom = instance.amodal_box
    return {
        "category_id": instance.model + 1,
        "iscrowd": 0,
        "area": instance.visible_pixels,
        "bbox": [left, top, right - left, bottom - top],
        "segmentation": {"size": list(by_column.shape), "counts": run_lengths(by_column, instance)},
        "ignore": instance.visible_pixels < IGNORED * instance.whole_pixels,
    }
