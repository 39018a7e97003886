"""Files of a LeRobot dataset, made of finished episodes; those that were there before stay as they are.

What ``meta/info.json``, which is written last, does not count is no part of the dataset: a crash before leaves files
that the next attempt writes over.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from warpcam.datasets.trajectories import statistics, videos
from warpcam.datasets.trajectories.lerobot_features import COUNTERS
from warpcam.datasets.trajectories.lerobot_layout import EPISODES, INFO, STATISTICS, TASKS, with_counts
from warpcam.datasets.trajectories.parts import replace

Row = dict[str, Any]


class Part:
    """A finished episode, in a folder of its own."""

    def __init__(self, number: int, path: Path):
        self.number, self.path = number, path
        about = json.loads((path / "episode.json").read_text())
        self.length: int = about["length"]
        self.task: str = about["task"]
        self.statistics: dict[str, Any] = about["statistics"]

    def sizes(self, keys: Sequence[str]) -> np.ndarray:
        """Sizes of its table and of each video [MB]."""
        files = [self.path / "data.parquet", *(self.path / f"{key}.mp4" for key in keys)]
        return np.array([file.stat().st_size for file in files]) / 1e6


def assemble(path: Path, parts: Sequence[Part], info: Mapping[str, Any], failure: str) -> None:
    """Add episodes to the dataset.

    Args:
        path: Of its folder.
        parts: Episodes, whose numbers follow those that are there.
        info: Content of ``meta/info.json`` without them.
        failure: Beginning of the error if the disk refuses.
    """
    keys = [name for name, feature in info["features"].items() if feature["dtype"] == "video"]
    dataset = _Dataset(path, info, keys, failure)
    limits = [info["data_files_size_in_mb"], *[info["video_files_size_in_mb"]] * len(keys)]
    for group in _groups(parts, keys, np.array(limits)):
        dataset.add(group)
    dataset.finish(len(parts))


class _Dataset:
    """A dataset that grows by files of several episodes."""

    def __init__(self, path: Path, info: Mapping[str, Any], keys: Sequence[str], failure: str):
        self._path, self._info, self._keys, self._failure = path, info, keys, failure
        self._frames = int(info["total_frames"])
        known = _known_episodes(path, info["total_episodes"])
        self._file = _next_file(known, info["chunks_size"])
        self._statistics = [_statistics_of(row) for row in known]
        self._tasks: dict[str, int] = {}
        if known:
            tasks = pd.read_parquet(path / TASKS)["task_index"]
            self._tasks = {str(task): int(number) for task, number in tasks.items()}

    def add(self, parts: Sequence[Part]) -> None:
        """Write files with these episodes."""
        chunk, file = divmod(self._file, self._info["chunks_size"])
        place = {"chunk_index": chunk, "file_index": file}
        self._file += 1
        rows, tables, seconds = [], [], 0.0
        for part in parts:
            table, counted = self._counted(part)
            tables.append(table)
            self._statistics.append({**part.statistics, **counted})
            rows.append(self._row(part, place, seconds))
            seconds += part.length / self._info["fps"]
            self._frames += part.length
        for key in self._keys:
            self._video(self._info["video_path"].format(video_key=key, **place), key, parts)
        self._put(self._info["data_path"].format(**place), lambda path: _write_tables(path, tables))
        self._put(EPISODES.format(**place), lambda path: parquet.write_table(pa.Table.from_pylist(rows), path))

    def finish(self, count: int) -> None:
        """Write what is known of all episodes, to which ``count`` were added."""
        self._put(TASKS, partial(write_tasks, self._tasks))
        gathered: dict[str, list[Any]] = {}
        for one in self._statistics:
            for name, values in one.items():
                gathered.setdefault(name, []).append(values)
        every = {name: statistics.merged(ones) for name, ones in gathered.items()}
        self._put(STATISTICS, lambda path: _write_json(path, every))
        total = self._info["total_episodes"] + count
        told = with_counts(self._info, total, self._frames, len(self._tasks))
        self._put(INFO, lambda path: _write_json(path, told))

    def _video(self, name: str, key: str, parts: Sequence[Part]) -> None:
        each, count = [part.path / f"{key}.mp4" for part in parts], sum(part.length for part in parts)
        self._put(name, lambda path: videos.concatenate(path, each, count))

    def _row(self, part: Part, place: Mapping[str, int], seconds: float) -> Row:
        """Return what is known of an episode that begins after so many seconds of its videos."""
        row: Row = {
            "episode_index": part.number, "tasks": [part.task], "length": part.length,
            "dataset_from_index": self._frames, "dataset_to_index": self._frames + part.length,
        }  # fmt: skip
        for where in ("data", "meta/episodes", *(f"videos/{key}" for key in self._keys)):
            row.update({f"{where}/{name}": index for name, index in place.items()})
        until = seconds + part.length / self._info["fps"]
        for key in self._keys:
            row.update({f"videos/{key}/from_timestamp": seconds, f"videos/{key}/to_timestamp": until})
        for name, one in self._statistics[-1].items():
            row.update({f"stats/{name}/{kind}": value for kind, value in one.items()})
        return row

    def _counted(self, part: Part) -> tuple[Any, dict[str, Any]]:
        """Return an episode's table with the counters, and their statistics."""
        frames = np.arange(part.length)
        task = self._tasks.setdefault(part.task, len(self._tasks))
        values = {
            "timestamp": frames / self._info["fps"], "frame_index": frames, "index": self._frames + frames,
            "episode_index": np.full_like(frames, part.number), "task_index": np.full_like(frames, task),
        }  # fmt: skip
        table = parquet.read_table(part.path / "data.parquet")
        for name, dtype in COUNTERS.items():
            table = table.append_column(name, pa.array(values[name].astype(dtype)))
        return table, {name: statistics.of_values(array) for name, array in values.items()}

    def _put(self, name: str, write: Callable[[Path], Any]) -> None:
        path = self._path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        replace(path, write, self._failure)


def write_tasks(tasks: Mapping[str, int], path: Path) -> None:
    """Write sentences and their numbers."""
    pd.DataFrame({"task_index": list(tasks.values())}, pd.Index(list(tasks), name="task")).to_parquet(path)


def _known_episodes(path: Path, count: int) -> list[Row]:
    """Return what is known of the first ``count`` episodes."""
    files = sorted((path / "meta/episodes").glob("*/*.parquet")) if count else []
    return [row for file in files for row in parquet.read_table(file).to_pylist() if row["episode_index"] < count]


def _next_file(known: Sequence[Row], chunks_size: int) -> int:
    """Return the number of the first file that no episode is in."""
    last = -1
    for row in known:
        chunks = [name for name in row if name.endswith("/chunk_index")]
        last = max(last, *(row[name] * chunks_size + row[name.replace("chunk_index", "file_index")] for name in chunks))
    return last + 1


def _statistics_of(row: Row) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in row.items():
        if name.startswith("stats/") and value is not None:
            feature, kind = name.removeprefix("stats/").rsplit("/", 1)
            found.setdefault(feature, {})[kind] = value
    return found


def _groups(parts: Sequence[Part], keys: Sequence[str], limits: np.ndarray) -> list[list[Part]]:
    """Episodes of one file each, whose sizes are within the limits [MB], or a single one."""
    groups: list[list[Part]] = []
    filled = np.zeros(1 + len(keys))
    for part in parts:
        sizes = part.sizes(keys)
        if not groups or (filled + sizes > limits).any():
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
