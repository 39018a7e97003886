"""YOLO: a text file beside each image, boxes or polygons in shares of the image, and data.yaml."""

import json
from typing import ClassVar

import numpy as np

from warpcam.datasets.generate.frames import Frame, Instance
from warpcam.datasets.writers.encode import encode_frame
from warpcam.datasets.writers.polygons import outline
from warpcam.datasets.writers.writer import Merge, ShardLayout, Writer

DIGITS = 6


class YoloWriter(Writer):
    """Images in shards/NNNNNN/images, labels in shards/NNNNNN/labels, where Ultralytics looks for them.

    data.yaml names train.txt and val.txt, which list the images. Without a validation part, both are train.txt. With
    the option ``polygons`` a line has the outline of an instance's largest visible part in place of its box.
    """

    options: ClassVar = {"min_pixels": 1, "polygons": False}

    def __init__(self, layout: ShardLayout):
        super().__init__(layout)
        self._images: list[tuple[int, str]] = []
        for name in ("images", "labels"):
            (layout.folder / name).mkdir()

    def encode(self, frame: Frame) -> tuple[int, str]:
        layout = self.layout
        name = f"{frame.stem}.{layout.image_format}"
        (layout.folder / "images" / name).write_bytes(encode_frame(frame, layout))
        seen = [each for each in frame.instances if each.visible_pixels >= layout.options["min_pixels"]]
        lines = [self._line(frame, each) for each in seen]
        text = "".join(f"{line}\n" for line in lines if line)
        (layout.folder / "labels" / f"{frame.stem}.txt").write_text(text)
        return frame.sample, name

    def append(self, encoded: tuple[int, str]) -> None:
        self._images.append(encoded)

    def close(self) -> None:
        (self.layout.folder / "images.json").write_text(json.dumps(self._images) + "\n")

    @classmethod
    def merge(cls, merge: Merge) -> None:
        lists: dict[str, list[str]] = {split: [] for split in merge.splits()}
        for shard in merge.shards:
            folder = f"./{shard.path.relative_to(merge.out).as_posix()}/images"
            for sample, name in json.loads((shard.path / "images.json").read_text()):
                lists[merge.split_of(sample)].append(f"{folder}/{name}\n")
        for split, lines in lists.items():
            (merge.out / f"{split}.txt").write_text("".join(lines))
        names = "".join(f"  {number}: {json.dumps(name)}\n" for number, name in enumerate(merge.classes))
        last = merge.splits()[-1]
        (merge.out / "data.yaml").write_text(f"train: train.txt\nval: {last}.txt\nnames:\n{names}")

    def _line(self, frame: Frame, instance: Instance) -> str:
        height, width = frame.ids.shape
        if self.layout.options["polygons"]:
            numbers = outline(frame.mask(instance)) / (width, height)
        else:
            left, top, right, bottom = instance.visible_box
            middle = (0.5 * (left + right) / width, 0.5 * (top + bottom) / height)
            numbers = np.array((*middle, (right - left) / width, (bottom - top) / height))
        return " ".join([str(instance.category), *(f"{number:.{DIGITS}f}" for number in numbers.ravel())])
