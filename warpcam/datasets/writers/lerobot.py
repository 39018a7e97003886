"""LeRobot: a dataset of version 3.0 in which each sample is an episode of one frame.

Samples have nothing to do with each other in time, and what reads LeRobot datasets takes frames around a frame from its
episode alone. Images are kept as files in tables, as videos have little to gain from frames that are all different.
"""

import json
import os
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from warpcam.core.rotations import rotation_matrices, rotation_quaternions
from warpcam.datasets.generate.cameras import file_name
from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.generate.shards import write_json
from warpcam.datasets.trajectories import statistics
from warpcam.datasets.trajectories.lerobot_assembly import write_tasks
from warpcam.datasets.trajectories.lerobot_features import COUNTERS, Feature, column, image_column
from warpcam.datasets.trajectories.lerobot_layout import (
    CHUNK,
    DATA,
    EPISODES,
    INFO,
    STATISTICS,
    TASKS,
    new_info,
    with_counts,
)
from warpcam.datasets.writers.encode import encode_frame
from warpcam.datasets.writers.writer import Merge, ShardLayout, Writer

FRAMES, ROWS, TOTALS, ABOUT = "frames.parquet", "episodes.parquet", "statistics.json", "features.json"
TASK = ""  # of all episodes: nobody does anything
LARGE = 300  # sides from which statistics are of every second, third, ... pixel [pixels]
STATE = "observation.environment_state"
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
BOX = ("left", "top", "right", "bottom")


class LeRobotWriter(Writer):
    """data, meta and shards: files of data and of episodes are links to those of the shards.

    Features of a frame: ``observation.images.{camera}``; ``observation.environment_state``, the poses of all instances
    in the world, position [m] and quaternion w x y z, zeros for those that have none; for each camera
    ``observation.boxes.{camera}`` int32 (instance, 4), visible boxes [pixels], half-open, zeros for what is not seen,
    ``observation.camera_pose.{camera}`` in the world, ``observation.intrinsics.{camera}``, fx, fy, cx, cy [pixels],
    zeros if the lens is no pinhole, and, with the option ``depth``, ``observation.depth.{camera}`` float32 [m].
    """

    options: ClassVar = {"fps": 30, "depth": False}

    def __init__(self, layout: ShardLayout):
        super().__init__(layout)
        self._features: dict[str, Feature] = {}
        self._episodes: list[dict[str, Any]] = []
        self._statistics: list[dict[str, Any]] = []
        self._frame: dict[str, Any] = {}
        self._parts: list[Any] = []
        self._instances: dict[str, str] = {}

    def encode(self, frame: Frame) -> tuple[Frame, dict[str, np.ndarray], bytes, dict[str, Any]]:
        """One camera's features, its image as a file, and statistics of all of these."""
        layout, camera = self.layout, file_name(frame.camera)
        values = {
            f"observation.boxes.{camera}": np.array([each.visible_box for each in frame.instances], np.int32),
            f"observation.camera_pose.{camera}": _pose(frame.camera_position, frame.camera_rotation),
            f"observation.intrinsics.{camera}": np.array(frame.intrinsics or (0.0,) * 4, np.float32),
        }
        if frame.camera == layout.cameras[0]:
            values[STATE] = np.concatenate([_pose_in_world(frame, each) for each in frame.instances])
        if layout.options["depth"]:
            values[f"observation.depth.{camera}"] = frame.depth[..., None].astype(np.float32)
        found = {name: statistics.of_values(_finite(value)[None]) for name, value in values.items()}
        step = max(1, max(frame.colors.shape[:2]) * 2 // LARGE)
        found[f"observation.images.{camera}"] = statistics.of_images(frame.colors[None, ::step, ::step])
        return frame, values, encode_frame(frame, layout), found

    def append(self, encoded: tuple[Frame, dict[str, np.ndarray], bytes, dict[str, Any]]) -> None:
        frame, values, image, found = encoded
        if frame.camera == self.layout.cameras[0]:
            self._frame = {"values": {}, "images": {}, "statistics": {}}
        self._frame["values"] |= values
        self._frame["images"][f"observation.images.{file_name(frame.camera)}"] = image
        self._frame["statistics"] |= found
        if frame.camera == self.layout.cameras[-1]:
            self._add(frame)

    def close(self) -> None:
        folder = self.layout.folder
        parquet.write_table(pa.concat_tables(self._parts), folder / FRAMES)
        parquet.write_table(pa.Table.from_pylist(self._episodes), folder / ROWS)
        write_json(folder / TOTALS, _merged(self._statistics))
        write_json(folder / ABOUT, {"features": self._features, "instances": self._instances}, indent=1)

    @classmethod
    def merge(cls, merge: Merge) -> None:
        first = merge.shards[0].path
        for pattern, name in ((DATA, FRAMES), (EPISODES, ROWS)):
            for shard in merge.shards:
                target = merge.out / pattern.format(**_place(shard.index))
                target.parent.mkdir(parents=True, exist_ok=True)
                _link(shard.path / name, target)
        about = json.loads((first / ABOUT).read_text())
        count = merge.shards[-1].record["end"]
        info = with_counts(new_info(int(merge.options["fps"]), about["features"], None), count, count, 1)
        totals = _merged([json.loads((shard.path / TOTALS).read_text()) for shard in merge.shards])
        _replace(merge.out / TASKS, partial(write_tasks, {TASK: 0}))
        cls._put(merge.out / STATISTICS, totals)
        cls._put(merge.out / "classes.json", {"classes": merge.classes, "instances": about["instances"]})
        if merge.validation:
            for split in merge.splits():
                chosen = [sample for sample in range(count) if merge.split_of(sample) == split]
                cls._put(merge.out / f"{split}_episodes.json", chosen)
        cls._put(merge.out / INFO, info)

    @staticmethod
    def _put(path: Path, value: Any) -> None:
        _replace(path, lambda temporary: write_json(temporary, value, indent=4))

    def _add(self, frame: Frame) -> None:
        """Add a sample, whose last camera's frame this is."""
        values, images, number = self._frame["values"], self._frame["images"], frame.sample
        if not self._features:
            self._features = self._features_of(frame, values, images)
            self._instances = {each.name: frame.classes[each.category] for each in frame.instances}
        counters = {name: np.zeros(1, dtype) for name, dtype in COUNTERS.items()}
        counters["episode_index"][:] = counters["index"][:] = number
        columns = {name: image_column([image]) for name, image in images.items()}
        columns |= {name: column(value[None], self._features[name]) for name, value in values.items()}
        columns |= {name: pa.array(value) for name, value in counters.items()}
        self._parts.append(pa.table({name: columns[name] for name in self._features}))
        found = self._frame["statistics"]
        found |= {name: statistics.of_values(value) for name, value in counters.items()}
        self._statistics.append(found)
        self._episodes.append(self._row(number, found))

    def _row(self, number: int, found: dict[str, Any]) -> dict[str, Any]:
        """What is known of an episode."""
        shard = _place(self.layout.index)
        row: dict[str, Any] = {"episode_index": number, "tasks": [TASK], "length": 1}
        row |= {"dataset_from_index": number, "dataset_to_index": number + 1}
        for where in ("data", "meta/episodes"):
            row |= {f"{where}/{name}": index for name, index in shard.items()}
        for name, one in found.items():
            row |= {f"stats/{name}/{kind}": value for kind, value in one.items()}
        return row

    def _features_of(self, frame: Frame, values: dict[str, np.ndarray], images: dict[str, bytes]) -> dict[str, Feature]:
        shape = [self.layout.height, self.layout.width, 3]
        found = {name: {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]} for name in images}
        instances = [each.name for each in frame.instances]
        for name, value in values.items():
            names: Any = None
            if name == STATE:
                names = [f"{instance}.{part}" for instance in instances for part in POSE]
            elif name.startswith("observation.boxes."):
                names = {"instance": instances, "edge": list(BOX)}
            elif name.startswith("observation.camera_pose."):
                names = list(POSE)
            elif name.startswith("observation.intrinsics."):
                names = ["fx", "fy", "cx", "cy"]
            found[name] = {"dtype": str(value.dtype), "shape": list(value.shape), "names": names}
        return found | {name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in COUNTERS.items()}


def _place(shard: int) -> dict[str, int]:
    """Where a shard's files are."""
    return {"chunk_index": shard // CHUNK, "file_index": shard % CHUNK}


def _pose(position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Position and quaternion w x y z of a rotation (3, 3), (7,) float32."""
    quaternion = rotation_quaternions(rotation[None])[0]
    return np.concatenate((position, quaternion / np.linalg.norm(quaternion))).astype(np.float32)


def _pose_in_world(frame: Frame, instance: Any) -> np.ndarray:
    if not np.isfinite(instance.position).all():
        return np.zeros(7, np.float32)
    turn = frame.camera_rotation @ rotation_matrices(instance.rotation[None])[0]
    return _pose(frame.camera_position + frame.camera_rotation @ instance.position, turn)


def _finite(values: np.ndarray) -> np.ndarray:
    """For statistics: depth of nothing is not counted as infinite."""
    return np.where(np.isfinite(values), values, 0)


def _merged(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {name: statistics.merged([part[name] for part in parts]) for name in parts[0]}


def _link(source: Path, target: Path) -> None:
    """Give a file a second name, or copy it where the file system has none."""

    def write(path: Path) -> None:
        try:
            os.link(source, path)
        except OSError:
            shutil.copyfile(source, path)

    if not (target.exists() and target.samefile(source)):  # a name in place of another of the same file stays there
        _replace(target, write)


def _replace(target: Path, write: Callable[[Path], None]) -> None:
    temporary = target.with_name(f".{target.name}.tmp")
    temporary.unlink(missing_ok=True)
    write(temporary)
    temporary.replace(target)
