"""KITTI's object detection: image_2, label_2 and calib, as the benchmark's development kit describes them."""

import json
import math
import os
import shutil
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from warpcam.core.rotations import rotation_matrices
from warpcam.datasets.generate.frames import Frame, Instance
from warpcam.datasets.writers.encode import encode_frame
from warpcam.datasets.writers.writer import Merge, ShardLayout, Writer

FOLDERS = ("image_2", "label_2", "calib")
# Shares of visible pixels from which an object counts as fully visible and as partly occluded.
FULLY, PARTLY = 0.95, 0.5
TO_OPENCV = np.diag((1.0, -1.0, -1.0))


class KittiWriter(Writer):
    """training/image_2, label_2 and calib, whose files are links to those of the shards.

    A box stands upright: its height is along the image's y axis, which is KITTI's assumption. Length, width and yaw are
    those of the instance's box about that axis, so boxes of tilted things enclose them. ImageSets/train.txt and val.txt
    list the frames of the parts.
    """

    pinhole = True
    options: ClassVar = {"min_pixels": 1}

    def __init__(self, layout: ShardLayout):
        super().__init__(layout)
        self._frames: list[tuple[int, str]] = []
        for name in FOLDERS:
            (layout.folder / name).mkdir()

    def encode(self, frame: Frame) -> tuple[int, str]:
        layout, number = self.layout, f"{frame.number:06d}"
        colors = encode_frame(frame, layout)
        (layout.folder / "image_2" / f"{number}.{layout.image_format}").write_bytes(colors)
        seen = [each for each in frame.instances if each.visible_pixels >= layout.options["min_pixels"]]
        lines = [_line(frame.classes[each.category], each) for each in seen]
        (layout.folder / "label_2" / f"{number}.txt").write_text("".join(f"{line}\n" for line in lines))
        (layout.folder / "calib" / f"{number}.txt").write_text(_calibration(frame))
        return frame.sample, number

    def append(self, encoded: tuple[int, str]) -> None:
        self._frames.append(encoded)

    def close(self) -> None:
        (self.layout.folder / "frames.json").write_text(json.dumps(self._frames) + "\n")

    @classmethod
    def merge(cls, merge: Merge) -> None:
        lists: dict[str, list[str]] = {split: [] for split in merge.splits()}
        for name in FOLDERS:
            (merge.out / "training" / name).mkdir(parents=True, exist_ok=True)
        for shard in merge.shards:
            for sample, number in json.loads((shard.path / "frames.json").read_text()):
                lists[merge.split_of(sample)].append(f"{number}\n")
            for name in FOLDERS:
                for path in (shard.path / name).iterdir():
                    _link(path, merge.out / "training" / name / path.name)
        (merge.out / "ImageSets").mkdir(exist_ok=True)
        for split, lines in lists.items():
            (merge.out / "ImageSets" / f"{split}.txt").write_text("".join(lines))


def _link(path: Path, target: Path) -> None:
    """Give a file a second name; a copy where the file system has no such names."""
    target.unlink(missing_ok=True)
    try:
        os.link(path, target)
    except PermissionError:
        shutil.copyfile(path, target)


def _line(name: str, instance: Instance) -> str:
    """Type, truncated, occluded, alpha, box, height, width, length, location, rotation_y."""
    left, top, right, bottom = instance.visible_box
    occluded = 0 if instance.visibility >= FULLY else 1 if instance.visibility >= PARTLY else 2
    rotation = TO_OPENCV @ rotation_matrices(instance.rotation[None])[0]
    center = TO_OPENCV @ instance.position + rotation @ instance.box_center
    yaw = _yaw(rotation)
    cosine, sine = math.cos(yaw), math.sin(yaw)
    # Axes of the upright box in the camera's frame: length, height, width.
    axes = np.array(((cosine, 0.0, -sine), (0.0, 1.0, 0.0), (sine, 0.0, cosine)))
    length, height, width = 2.0 * np.abs(axes @ rotation) @ instance.half_extents
    alpha = _wrapped(yaw - math.atan2(center[0], center[2]))
    location = center + np.array((0.0, 0.5 * height, 0.0))  # the middle of its bottom
    plain = "".join(part for part in name.title() if not part.isspace())
    numbers = (alpha, left, top, right - 1, bottom - 1, height, width, length, *location, yaw)
    return f"{plain} {float(instance.truncated):.2f} {occluded} " + " ".join(f"{number:.2f}" for number in numbers)


def _yaw(rotation: np.ndarray) -> float:
    """Angle about the camera's y axis of that axis of the instance, x or y, that is nearer to level."""
    axis = min((0, 1), key=lambda column: abs(rotation[1, column]))
    return math.atan2(-rotation[2, axis], rotation[0, axis])


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def _calibration(frame: Frame) -> str:
    """P0 to P3, all of this camera; the lidar's and the inertial unit's frames are the camera's."""
    assert frame.intrinsics is not None  # the writer is for pinholes
    fx, fy, cx, cy = frame.intrinsics
    projection: tuple[Any, ...] = (fx, 0.0, cx - 0.5, 0.0, 0.0, fy, cy - 0.5, 0.0, 0.0, 0.0, 1.0, 0.0)
    identity = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    rigid = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    rows: dict[str, tuple[Any, ...]] = {f"P{number}": projection for number in range(4)}
    rows |= {"R0_rect": identity, "Tr_velo_to_cam": rigid, "Tr_imu_to_velo": rigid}
    return "".join(f"{name}: {' '.join(f'{number:.12e}' for number in numbers)}\n" for name, numbers in rows.items())
