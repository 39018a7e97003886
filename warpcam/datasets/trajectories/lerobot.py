"""LeRobot datasets, version 3.0: tables of parquet, videos, and what is known of each episode."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.datasets.trajectories import statistics, videos
from warpcam.datasets.trajectories.episode import Episode
from warpcam.datasets.trajectories.lerobot_features import COUNTERS, Feature, column, features_of, named
from warpcam.datasets.trajectories.parts import Parts, on_disk, replace

try:
    import pandas as pd
    import pyarrow as pa
    from pyarrow import parquet
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and LeRobot datasets need it: pip install 'warpcam[datasets]'"
    ) from error

VERSION = "v3.0"
CHUNK = 1000  # files of a folder
TABLE_SIZE, VIDEO_SIZE = 100, 200  # of a file at most, if it has more than one episode [MB]
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA, VIDEO = f"data/{FILE}.parquet", f"videos/{{video_key}}/{FILE}.mp4"
EPISODES = f"meta/episodes/{FILE}.parquet"


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
        left = [(number, part) for number, part in left if number >= known]
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
        parts = [_Part(number, path) for number, path in self._parts.all() if number >= known]
        if parts:
            failure = f"{str(self.path)!r} could not be written, its episodes are in {str(self._parts.folder)!r}"
            with on_disk(failure):
                self._assemble(parts, failure)
        self._parts.remove()

    def _read_info(self, append: bool) -> dict[str, Any] | None:
        path = self.path / "meta" / "info.json"
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

    def _assemble(self, parts: Sequence["_Part"], failure: str) -> None:
        info = self._info or {"total_episodes": 0, "total_frames": 0}
        tasks, file = self._tasks(), self._next_file()
        before = json.loads((self.path / "meta/stats.json").read_text()) if self._info else {}
        gathered = {name: [one] for name, one in before.items()}
        keys = [name for name, feature in self._features.items() if feature["dtype"] == "video"]
        frames = int(info["total_frames"])
        for group in _groups(parts, keys):
            place = {"chunk_index": file // CHUNK, "file_index": file % CHUNK}
            rows, tables = [], []
            seconds = 0.0
            for part in group:
                task = tasks.setdefault(part.about["task"], len(tasks))
                table, counted = self._counted(part, frames, task)
                tables.append(table)
                known = {**part.about["statistics"], **counted}
                for name, one in known.items():
                    gathered.setdefault(name, []).append(one)
                length = part.about["length"]
                row = {
                    "episode_index": part.number, "tasks": [part.about["task"]], "length": length,
                    "dataset_from_index": frames, "dataset_to_index": frames + length,
                }  # fmt: skip
                for where in ("data", "meta/episodes", *(f"videos/{key}" for key in keys)):
                    row.update({f"{where}/{name}": index for name, index in place.items()})
                until = seconds + length / self._fps
                for key in keys:
                    row.update({f"videos/{key}/from_timestamp": seconds, f"videos/{key}/to_timestamp": until})
                for name, one in known.items():
                    row.update({f"stats/{name}/{kind}": value for kind, value in one.items()})
                rows.append(row)
                seconds, frames = until, frames + length
            count = sum(part.about["length"] for part in group)
            for key in keys:
                each = [part.path / f"{key}.mp4" for part in group]
                self._put(
                    VIDEO.format(video_key=key, **place), failure,
                    lambda path, each=each, count=count: videos.concatenate(path, each, count),
                )  # fmt: skip
            self._put(DATA.format(**place), failure, lambda path, tables=tables: _write_tables(path, tables))
            self._put(
                EPISODES.format(**place), failure,
                lambda path, rows=rows: parquet.write_table(pa.Table.from_pylist(rows), path),
            )  # fmt: skip
            file += 1
        index = pd.Index(list(tasks), name="task")
        self._put(
            "meta/tasks.parquet", failure, lambda path: pd.DataFrame({"task_index": list(tasks.values())}, index)
            .to_parquet(path),
        )  # fmt: skip
        every = {name: statistics.merged(ones) for name, ones in gathered.items()}
        self._put("meta/stats.json", failure, lambda path: _write_json(path, every))
        total = int(info["total_episodes"]) + len(parts)
        told = {**info, **self._description(bool(keys)), "total_episodes": total, "total_frames": frames}
        told.update(total_tasks=len(tasks), splits={"train": f"0:{total}"})
        self._put("meta/info.json", failure, lambda path: _write_json(path, told))  # what is not told of is not read

    def _put(self, name: str, failure: str, write: Any) -> None:
        path = self.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        replace(path, write, failure)

    def _description(self, video: bool) -> dict[str, Any]:
        if self._info:
            return {}
        return {
            "codebase_version": VERSION, "robot_type": self._robot_type, "fps": self._fps, "features": self._features,
            "chunks_size": CHUNK, "data_files_size_in_mb": TABLE_SIZE, "video_files_size_in_mb": VIDEO_SIZE,
            "data_path": DATA, "video_path": VIDEO if video else None,
        }  # fmt: skip

    def _tasks(self) -> dict[str, int]:
        if not self._info:
            return {}
        table = pd.read_parquet(self.path / "meta/tasks.parquet")
        return {str(task): int(number) for task, number in table["task_index"].items()}

    def _next_file(self) -> int:
        """Return the number of the first file that no episode of the dataset is in."""
        if not self._info:
            return 0
        last = -1
        for path in sorted((self.path / "meta/episodes").glob("*/*.parquet")):
            table = parquet.read_table(path)
            for row in table.select([name for name in table.column_names if not name.startswith("stats/")]).to_pylist():
                if row["episode_index"] < self._info["total_episodes"]:
                    chunks = [name for name in row if name.endswith("/chunk_index")]
                    files = [row[name] * CHUNK + row[name.replace("chunk_index", "file_index")] for name in chunks]
                    last = max([last, *files])
        return last + 1

    def _counted(self, part: "_Part", first: int, task: int) -> tuple[Any, dict[str, Any]]:
        """Return an episode's table with the counters, and their statistics."""
        frames = np.arange(part.about["length"])
        values = {
            "timestamp": frames / self._fps, "frame_index": frames, "episode_index": np.full_like(frames, part.number),
            "index": first + frames, "task_index": np.full_like(frames, task),
        }  # fmt: skip
        table = parquet.read_table(part.path / "data.parquet")
        for name, array in values.items():
            table = table.append_column(name, pa.array(array.astype(COUNTERS[name])))
        return table, {name: statistics.of_values(array) for name, array in values.items()}


class _Part:
    """A finished episode."""

    def __init__(self, number: int, path: Path):
        self.number, self.path = number, path
        self.about = json.loads((path / "episode.json").read_text())

    def sizes(self, keys: Sequence[str]) -> np.ndarray:
        """Sizes of its table and of each video [parts of a file's largest]."""
        sizes = [(self.path / "data.parquet").stat().st_size / TABLE_SIZE]
        sizes += [(self.path / f"{key}.mp4").stat().st_size / VIDEO_SIZE for key in keys]
        return np.array(sizes) / 1e6


def _groups(parts: Sequence[_Part], keys: Sequence[str]) -> list[list[_Part]]:
    """Episodes of one file each."""
    groups: list[list[_Part]] = []
    filled = np.zeros(1 + len(keys))
    for part in parts:
        sizes = part.sizes(keys)
        if not groups or (filled + sizes > 1.0).any():
            groups.append([])
            filled[:] = 0.0
        groups[-1].append(part)
        filled += sizes
    return groups


def _write_tables(path: Path, tables: Sequence[Any]) -> None:
    with parquet.ParquetWriter(path, tables[0].schema) as writer:
        for table in tables:
            writer.write_table(table)  # a row group for each episode


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=4))


def _kind(feature: Feature | None) -> Any:
    return None if feature is None else (feature["dtype"], list(feature["shape"]))


def _told(feature: Feature | None) -> str:
    return "absent" if feature is None else f"{feature['dtype']}{list(feature['shape'])}"
