"""Where a LeRobot dataset, version 3.0, has its files, and what ``meta/info.json`` tells of it."""

from collections.abc import Mapping
from typing import Any

VERSION = "v3.0"
CHUNK = 1000  # files of a folder
TABLE_SIZE, VIDEO_SIZE = 100, 200  # of a file at most, if it has more than one episode [MB]
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA, VIDEO, EPISODES = f"data/{FILE}.parquet", f"videos/{{video_key}}/{FILE}.mp4", f"meta/episodes/{FILE}.parquet"
INFO, STATISTICS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"


def new_info(fps: int, features: Mapping[str, Mapping[str, Any]], robot_type: str | None) -> dict[str, Any]:
    """Content of ``meta/info.json`` of a dataset without episodes."""
    return {
        "codebase_version": VERSION, "robot_type": robot_type, "fps": fps, "features": features,
        "total_episodes": 0, "total_frames": 0, "total_tasks": 0, "chunks_size": CHUNK,
        "data_files_size_in_mb": TABLE_SIZE, "video_files_size_in_mb": VIDEO_SIZE, "data_path": DATA,
        "video_path": VIDEO if any(feature["dtype"] == "video" for feature in features.values()) else None,
    }  # fmt: skip


def with_counts(info: Mapping[str, Any], episodes: int, frames: int, tasks: int) -> dict[str, Any]:
    """Content of ``meta/info.json`` with these totals."""
    counts = {"total_episodes": episodes, "total_frames": frames, "total_tasks": tasks}
    return {**info, **counts, "splits": {"train": f"0:{episodes}"}}
