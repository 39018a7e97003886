"""COCO: images and one JSON file of instances, with masks as RLE and, if there are keypoints, keypoints."""

import json
from collections.abc import Iterator
from typing import Any, ClassVar, TextIO

import numpy as np
from pycocotools import mask as rle

from warpcam.datasets.generate.frames import Frame, Instance
from warpcam.datasets.generate.shards import write_json
from warpcam.datasets.writers.encode import encode_frame
from warpcam.datasets.writers.run_lengths import run_lengths
from warpcam.datasets.writers.writer import Merge, ShardLayout, Writer

ID_STEP = 10_000  # annotations' ids: room for so many instances of an image


class CocoWriter(Writer):
    """Images in shards/NNNNNN/images, coco_annotations.json beside them; with a validation part, two such files."""

    options: ClassVar = {"min_pixels": 1}

    def __init__(self, layout: ShardLayout):
        super().__init__(layout)
        self._images: list[Any] = []
        self._annotations: list[Any] = []
        (layout.folder / "images").mkdir()

    def encode(self, frame: Frame) -> Any:
        layout = self.layout
        name = f"images/{frame.stem}.{layout.image_format}"
        (layout.folder / name).write_bytes(encode_frame(frame, layout))
        height, width = frame.ids.shape
        image = {"id": frame.number, "file_name": name, "width": width, "height": height}
        image |= {"sample": frame.sample, "camera": frame.camera}
        seen = [each for each in frame.instances if each.visible_pixels >= layout.options["min_pixels"]]
        by_column = np.asfortranarray(frame.ids)  # as masks are encoded
        return image, [_annotation(frame, by_column, place, each) for place, each in enumerate(seen)]

    def append(self, encoded: Any) -> None:
        image, annotations = encoded
        self._images.append(image)
        self._annotations += annotations

    def close(self) -> None:
        write_json(self.layout.folder / "annotations.json", {"images": self._images, "annotations": self._annotations})

    @classmethod
    def merge(cls, merge: Merge) -> None:
        for split in merge.splits():
            name = "coco_annotations.json" if len(merge.splits()) == 1 else f"coco_annotations_{split}.json"
            temporary = merge.out / f"{name}.tmp"
            with temporary.open("w") as file:
                _write(file, merge, split)
            temporary.replace(merge.out / name)


def _annotation(frame: Frame, by_column: np.ndarray, place: int, instance: Instance) -> dict[str, Any]:
    left, top, right, bottom = instance.visible_box
    size = list(by_column.shape)
    mask = rle.frPyObjects({"size": size, "counts": run_lengths(by_column, instance)}, *size)
    found = {
        "id": frame.number * ID_STEP + place + 1,
        "image_id": frame.number,
        "category_id": instance.category + 1,
        "iscrowd": 0,
        "area": instance.visible_pixels,
        "bbox": [left, top, right - left, bottom - top],
        "segmentation": {"size": mask["size"], "counts": mask["counts"].decode("ascii")},
        "instance": instance.name,
        "visibility": round(instance.visibility, 6),
        "truncated": instance.truncated,
    }
    left, top, right, bottom = instance.amodal_box
    found["amodal_bbox"] = [left, top, right - left, bottom - top]
    if names := frame.keypoint_names[instance.category]:
        points = _keypoints(instance, len(names))
        found["keypoints"] = points
        found["num_keypoints"] = sum(visible > 0 for visible in points[2::3])
    return found


def _keypoints(instance: Instance, count: int) -> list[float]:
    """x, y, v of each keypoint; zeros where COCO wants them, outside the image."""
    numbers: list[float] = []
    for x, y, visible in instance.keypoints[:count]:
        numbers += [round(float(x), 3), round(float(y), 3), int(visible)] if visible > 0 else [0, 0, 0]
    return numbers + [0] * (3 * count - len(numbers))


def _write(file: TextIO, merge: Merge, split: str) -> None:
    """Write one part shard by shard, so that only one is in memory at a time."""
    categories = [
        {
            "id": number,
            "name": name,
            "supercategory": "",
            **({"keypoints": list(points), "skeleton": []} if points else {}),
        }
        for number, (name, points) in enumerate(zip(merge.classes, merge.keypoint_names, strict=True), 1)
    ]
    file.write(f'{{"info": {{"description": "made by warpcam"}}, "categories": {json.dumps(categories)}')
    for kind in ("images", "annotations"):
        file.write(f',\n"{kind}": [')
        for place, entry in enumerate(_entries(merge, split, kind)):
            file.write((",\n" if place else "\n") + json.dumps(entry))
        file.write("]")
    file.write("}\n")


def _entries(merge: Merge, split: str, kind: str) -> Iterator[dict[str, Any]]:
    for shard in merge.shards:
        found = json.loads((shard.path / "annotations.json").read_text())
        samples = {image["id"]: image["sample"] for image in found["images"]}
        for entry in found[kind]:
            if merge.split_of(samples[entry["id" if kind == "images" else "image_id"]]) == split:
                if kind == "images":
                    entry["file_name"] = f"{shard.path.relative_to(merge.out).as_posix()}/{entry['file_name']}"
                yield entry
