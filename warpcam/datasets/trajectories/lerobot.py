"""LeRobot datasets, version 3.0: tables of parquet, videos, and what is known of each episode."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.datasets.trajectories import statistics, videos
from warpcam.datasets.trajectories.episode import Episode
from warpcam.datasets.trajectories.lerobot_features import Feature, column, features_of, named
from warpcam.datasets.trajectories.lerobot_layout import INFO, VERSION, new_info
from warpcam.datasets.trajectories.parts import Parts, on_disk

try:
    import pyarrow as pa
    from pyarrow import parquet

    from warpcam.datasets.trajectories.lerobot_assembly import Part, assemble
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and LeRobot datasets need it: pip install 'warpcam[datasets]'"
    ) from error


class LeRobotFolder:
    """A folder that ``LeRobotDataset`` reads.

    Each finished episode is a folder of its own in ``{path}.parts`` until ``close`` makes the dataset of them.

    Args:
        path: Of the folder.
        append: Whether to add to a dataset that is there, and to take up finished episodes of a recording that was not
            closed.
        fps: Steps of a second.
        task: Its type is checked; each episode has its own.
        robot_type: Name of the robot.
        video: Whether images become videos; None is True.
        codec: None is libx264.
        crf: None is 18.
    """

    def __init__(
        self,
        path: Path,
        *,
        append: bool,
        fps: int | None,
        task: str | Sequence[str] | None,
        robot_type: str | None,
        video: bool | None,
        codec: str | None,
        crf: int | None,
    ):
        if isinstance(fps, bool) or not isinstance(fps, int) or fps < 1:
            raise WarpcamError(f"Writer: fps {fps!r} came, the format 'lerobot' needs a whole number of at least 1")
        if task is not None and not isinstance(task, str) and not all(isinstance(one, str) for one in task):
            raise WarpcamError(f"Writer: task {task!r} came, one sentence or one for each world is needed")
        self.path, self._fps, self._robot_type = path, fps, robot_type
        self._video = video is not False
        self._codec, self._crf = codec or "libx264", 18 if crf is None else crf
        self._info = self._read_info(append)
        self._features: dict[str, Feature] = self._info["features"] if self._info else {}
        self._parts = Parts(path)
        left = self._parts.all()
        if left and not append:
            raise WarpcamError(
                f"Writer: {str(self._parts.folder)!r} has {len(left)} finished episodes of a recording that was not "
                "closed; append=True takes them up"
            )
        known = self._info["total_episodes"] if self._info else 0
        if left and not self._features:
            self._features = json.loads((left[0][1] / "episode.json").read_text())["features"]
        self.count = max([known, *(number + 1 for number, _ in left)])

    def check(self, columns: Mapping[str, np.ndarray]) -> None:
        """Raise for what the format lacks, and for what differs from the episodes that are there."""
        features = features_of(named(columns), self._video)
        if not self._features:
            self._features = features
        for name in sorted({*features, *self._features}):
            here, there = features.get(name), self._features.get(name)
            if _kind(here) != _kind(there):
                raise WarpcamError(
                    f"Writer: {name} is {_told(here)} here, {_told(there)} in the episodes of {str(self.path)!r}; "
                    "episodes of one dataset must be alike"
                )

    def write(self, number: int, episode: Episode) -> None:
        """Write a finished episode to the disk."""
        self._parts.add(number, lambda folder: self._write(folder, episode))

    def close(self) -> None:
        """Make the dataset of all finished episodes."""
        known = self._info["total_episodes"] if self._info else 0
        parts = [Part(number, path) for number, path in self._parts.all() if number >= known]
        if parts:
            failure = f"{str(self.path)!r} could not be written, its episodes are in {str(self._parts.folder)!r}"
            with on_disk(failure):
                assemble(self.path, parts, self._info or new_info(self._fps, self._features, self._robot_type), failure)
        self._parts.remove()

    def _read_info(self, append: bool) -> dict[str, Any] | None:
        path = self.path / INFO
        if self.path.exists() and not self.path.is_dir():
            raise WarpcamError(f"Writer: {str(self.path)!r} is a file, the format 'lerobot' needs a folder")
        if not path.exists():
            if self.path.exists() and not append and any(self.path.iterdir()):
                raise WarpcamError(f"Writer: {str(self.path)!r} is not empty, and no LeRobot dataset")
            return None
        if not append:
            raise WarpcamError(f"Writer: {str(self.path)!r} exists; append=True adds episodes to it")
        info: dict[str, Any] = json.loads(path.read_text())
        if info["codebase_version"] != VERSION:
            version = info["codebase_version"]
            raise WarpcamError(f"Writer: {str(self.path)!r} has version {version}, {VERSION} is written; convert it")
        if info["fps"] != self._fps:
            raise WarpcamError(f"Writer: fps {self._fps} came, {str(self.path)!r} has {info['fps']}")
        return info

    def _write(self, folder: Path, episode: Episode) -> None:
        folder.mkdir()
        columns, table, known = named(episode.columns), {}, {}
        for name, array in columns.items():
            feature = self._features[name]
            image = feature["dtype"] in ("image", "video")
            known[name] = statistics.of_images(array) if image else statistics.of_values(array)
            if feature["dtype"] == "video":
                videos.encode(folder / f"{name}.mp4", array, self._fps, self._codec, self._crf)
            else:
                table[name] = column(array, feature)
        parquet.write_table(pa.table(table), folder / "data.parquet")
        about = {"length": len(episode), "task": episode.task, "statistics": known, "features": self._features}
        (folder / "episode.json").write_text(json.dumps(about))


def _kind(feature: Feature | None) -> Any:
    return None if feature is None else (feature["dtype"], list(feature["shape"]))


def _told(feature: Feature | None) -> str:
    return "absent" if feature is None else f"{feature['dtype']}{list(feature['shape'])}"
