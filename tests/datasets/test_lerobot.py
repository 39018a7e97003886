"""LeRobot datasets: files are as version 3.0 has them, and its own loader gives back what was recorded."""

import io
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recorded_steps as steps
import warp as wp
from PIL import Image

imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="pip install 'warpcam[datasets]'")
cv2 = pytest.importorskip("cv2", reason="pip install opencv-python-headless")
pd = pytest.importorskip("pandas", reason="pip install 'warpcam[datasets]'")
parquet = pytest.importorskip("pyarrow.parquet", reason="pip install 'warpcam[datasets]'")

from warpcam.datasets import Writer  # noqa: E402
from warpcam.datasets.trajectories import lerobot_assembly, lerobot_layout, statistics, videos  # noqa: E402
from warpcam.datasets.trajectories.parts import Parts  # noqa: E402
from warpcam.errors import WarpcamError  # noqa: E402

LENGTHS, COUNT, FPS = (4, 3, 9), 12, 20
CAMERA = "observation.images.front"
TASKS = ("lift", "push", "lift")


def record(path: Path, device: wp.Device, **options: Any) -> list[tuple[int, int]]:
    """Record some steps of the worlds; returns world and episode of each episode that was written."""
    worlds = steps.Worlds(LENGTHS, device)
    with Writer(path, format="lerobot", **{"fps": FPS, "task": TASKS, "robot_type": "panda", **options}) as writer:
        for _ in range(COUNT):
            writer.observe(worlds.observations())
            writer.step(**worlds.ends())
    return list(steps.finished(LENGTHS, COUNT))


def places(order: list[tuple[int, int]]) -> list[tuple[int, int, int]]:
    return [(world, episode, row) for world, episode in order for row in range(LENGTHS[world])]


def table(path: Path, pattern: str) -> list[dict[str, Any]]:
    return [row for file in sorted(path.glob(pattern)) for row in parquet.read_table(file).to_pylist()]


def frames(path: Path) -> np.ndarray:
    """All frames of a video, (frame, height, width, 3)."""
    film, images = cv2.VideoCapture(str(path)), []
    while True:
        there, image = film.read()
        if not there:
            return np.stack(images)[..., ::-1]
        images.append(image)


def times(path: Path) -> np.ndarray:
    """When each frame is shown [s]."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-c", "copy", "-f", "framecrc", "-"]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    base = next(line for line in lines if line.startswith("#tb 0:")).split()[-1].split("/")
    return np.sort([int(line.split(",")[2]) for line in lines if line[0] != "#"]) * int(base[0]) / int(base[1])


def test_tables_and_videos(device: wp.Device, tmp_path: Path) -> None:
    """Two recordings: their episodes follow each other, the second's in files of their own."""
    path = tmp_path / "lift"
    once = record(path, device)
    order = [*once, *record(path, device, append=True)]
    made = places(order)
    info = json.loads((path / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", FPS, "panda")
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (len(order), len(made), 2)
    assert info["splits"] == {"train": f"0:{len(order)}"}
    kinds = {name: (feature["dtype"], feature["shape"]) for name, feature in info["features"].items()}
    assert kinds[CAMERA] == ("video", [steps.HEIGHT, steps.WIDTH, 3])
    assert kinds["observation.front_depth"] == ("float32", [steps.HEIGHT, steps.WIDTH, 1])
    assert kinds["observation.state"] == ("float32", [3]) and kinds["action"] == ("float32", [2])
    assert kinds["next.reward"] == ("float32", [1]) and kinds["next.done"] == ("bool", [1])

    rows = table(path, "data/*/*.parquet")
    assert len(rows) == len(made)
    for index, (row, place) in enumerate(zip(rows, made, strict=True)):
        assert row["index"] == index and row["frame_index"] == place[2]
        assert row["timestamp"] == np.float32(place[2] / FPS)
        np.testing.assert_array_equal(row["observation.state"], steps.state(*place))
        np.testing.assert_array_equal(row["action"], steps.action(*place))
        np.testing.assert_array_equal(np.float32(row["observation.front_depth"]), steps.depth(*place))
        assert row["next.done"] == (place[2] + 1 == LENGTHS[place[0]])

    tasks = pd.read_parquet(path / "meta/tasks.parquet")["task_index"].to_dict()
    assert set(tasks) == {"lift", "push"}
    seen = {file: frames(path / f"videos/{CAMERA}/chunk-000/file-{file:03d}.mp4") for file in (0, 1)}
    for file in seen:
        shown = times(path / f"videos/{CAMERA}/chunk-000/file-{file:03d}.mp4")
        np.testing.assert_allclose(shown, np.arange(len(made) // 2) / FPS, atol=1e-4)
    episodes = table(path, "meta/episodes/*/*.parquet")
    assert [row["episode_index"] for row in episodes] == list(range(len(order)))
    for number, (row, (world, episode)) in enumerate(zip(episodes, order, strict=True)):
        assert (row["length"], row["tasks"]) == (LENGTHS[world], [TASKS[world]])
        own = rows[row["dataset_from_index"] : row["dataset_to_index"]]
        assert {one["episode_index"] for one in own} == {number} and len(own) == LENGTHS[world]
        assert {one["task_index"] for one in own} == {tasks[TASKS[world]]}
        file = row[f"videos/{CAMERA}/file_index"]
        assert file == row["data/file_index"] == row["meta/episodes/file_index"] == number // len(once)
        first = round(row[f"videos/{CAMERA}/from_timestamp"] * FPS)
        assert round(row[f"videos/{CAMERA}/to_timestamp"] * FPS) == first + LENGTHS[world]
        for step in range(LENGTHS[world]):
            difference = seen[file][first + step].astype(int) - steps.image(world, episode, step)
            assert abs(difference).max() <= 4
    assert not (tmp_path / "lift.parts").exists()


def test_statistics_are_those_of_all_frames(device: wp.Device, tmp_path: Path) -> None:
    path = tmp_path / "lift"
    made = places([*record(path, device), *record(path, device, append=True)])
    stats = json.loads((path / "meta/stats.json").read_text())
    for name, values in (
        ("action", np.stack([steps.action(*place) for place in made])),
        (CAMERA, np.stack([steps.image(*place)[0, 0] / 255.0 for place in made])[..., None, None]),
    ):
        found = stats[name]
        assert found["count"] == [len(made)]
        for kind, value in (
            ("min", values.min(0)),
            ("max", values.max(0)),
            ("mean", values.mean(0)),
            ("std", values.std(0)),
        ):
            np.testing.assert_allclose(found[kind], value, atol=1e-6)
        assert all(np.shape(found[quantile]) == values.shape[1:] for quantile in statistics.QUANTILES)
    assert stats["next.reward"]["mean"] == pytest.approx([np.mean([place[2] for place in made])])
    assert stats["index"]["max"] == [len(made) - 1]
    assert np.shape(stats["observation.front_depth"]["mean"]) == (1, 1, 1)


def test_quantiles_of_one_episode() -> None:
    values = np.random.default_rng(7).normal(size=(500, 3))
    found = statistics.of_values(values)
    np.testing.assert_allclose(found["q10"], np.quantile(values, 0.1, axis=0))
    np.testing.assert_allclose(statistics.merged([found])["q99"], np.quantile(values, 0.99, axis=0))


def test_lossless_images(device: wp.Device, tmp_path: Path) -> None:
    path = tmp_path / "lift"
    made = places(record(path, device, video=False))
    info = json.loads((path / "meta/info.json").read_text())
    assert info["features"][CAMERA]["dtype"] == "image" and info["video_path"] is None
    for row, place in zip(table(path, "data/*/*.parquet"), made, strict=True):
        image = np.asarray(Image.open(io.BytesIO(row[CAMERA]["bytes"])))
        np.testing.assert_array_equal(image, steps.image(*place))
    assert not (path / "videos").exists()


def test_large_recordings_have_several_files(
    device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lerobot_layout, "TABLE_SIZE", 0.005)
    monkeypatch.setattr(lerobot_layout, "CHUNK", 2)
    order = record(tmp_path / "lift", device)
    files = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.glob("lift/data/*/*"))
    assert files[:3] == [f"lift/data/chunk-00{chunk}/file-00{file}.parquet" for chunk, file in ((0, 0), (0, 1), (1, 0))]
    rows = table(tmp_path / "lift", "meta/episodes/*/*.parquet")
    for row in rows:
        name = f"chunk-{row['data/chunk_index']:03d}/file-{row['data/file_index']:03d}"
        own = parquet.read_table(tmp_path / "lift/data" / f"{name}.parquet")["index"].to_pylist()
        assert set(range(row["dataset_from_index"], row["dataset_to_index"])) <= set(own)
        count, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / f"lift/videos/{CAMERA}/{name}.mp4"))
        assert count == len(own) and row[f"videos/{CAMERA}/to_timestamp"] <= seconds + 1e-3
    assert len(rows) == len(order)


@pytest.mark.filterwarnings("ignore")  # of what lerobot imports
@pytest.mark.parametrize("video", [True, False])
def test_lerobot_reads_it(device: wp.Device, tmp_path: Path, video: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    reason = "lerobot[dataset] needs Python 3.12 and a torch before 2.12"
    loader = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason=reason, exc_type=ImportError)
    order = [
        *record(tmp_path / "lift", device, video=video),
        *record(tmp_path / "lift", device, video=video, append=True),
    ]
    read = loader.LeRobotDataset("none/lift", root=tmp_path / "lift", video_backend="pyav")
    made = places(order)
    assert len(read) == len(made) and read.num_episodes == len(order)
    for index, place in enumerate(made):
        item = read[index]
        assert (item["index"], item["frame_index"], item["task"]) == (index, place[2], TASKS[place[0]])
        np.testing.assert_array_equal(item["observation.state"], steps.state(*place))
        np.testing.assert_array_equal(item["observation.front_depth"], steps.depth(*place))
        np.testing.assert_array_equal(item["action"], steps.action(*place))
        image = item[CAMERA].numpy().transpose(1, 2, 0) * 255.0
        assert abs(image - steps.image(*place)).max() <= (4.0 if video else 1e-3)


def test_ffmpeg_that_fails(device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An encoder that is none is told of; so is a file in which frames are missing, and what was whole stays whole."""
    with pytest.raises(WarpcamError, match="episode 0 could not be written"):
        record(tmp_path / "none", device, codec="libnone")
    monkeypatch.setattr(videos, "SEEKABLE", (*videos.SEEKABLE, "-frames:v", "3"))
    with pytest.raises(WarpcamError, match=r"episode 1 could not be written .* ffmpeg wrote 3 of 4 frames"):
        record(tmp_path / "lift", device)
    assert len(table(tmp_path / "lift", "meta/episodes/*/*.parquet")) == 1  # that of three frames


def test_a_disk_that_is_full_at_the_end(device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The dataset is as it was before, and a second attempt completes it."""
    path = tmp_path / "lift"
    order = record(path, device)

    write = lerobot_assembly._write_json

    def full(file: Path, content: Any) -> None:
        """Write the statistics, and not what counts."""
        if "codebase_version" in content:
            raise OSError(28, "No space left on device")
        write(file, content)

    with monkeypatch.context() as fault:
        fault.setattr(lerobot_assembly, "_write_json", full)
        with pytest.raises(WarpcamError, match=r"its episodes are in '.*lift\.parts': No space left on device"):
            record(path, device, append=True)
    assert json.loads((path / "meta/info.json").read_text())["total_episodes"] == len(order)
    with pytest.raises(WarpcamError, match="exists; append=True adds"):
        Writer(path, format="lerobot", fps=FPS)
    with Writer(path, format="lerobot", fps=FPS, append=True) as writer:
        assert writer.episodes == 2 * len(order)
    assert json.loads((path / "meta/info.json").read_text())["total_episodes"] == 2 * len(order)
    assert len(table(path, "data/*/*.parquet")) == 2 * len(places(order))
    stats = json.loads((path / "meta/stats.json").read_text())
    assert stats["action"]["count"] == [2 * len(places(order))]


def test_a_crash_when_the_dataset_is_made(device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts that were left over are in the dataset already: they are not added again."""
    path = tmp_path / "lift"
    with monkeypatch.context() as crash:
        crash.setattr(Parts, "remove", lambda parts: None)
        order = record(path, device)
    assert len(Parts(path).all()) == len(order)
    Writer(path, format="lerobot", fps=FPS, append=True).close()
    assert json.loads((path / "meta/info.json").read_text())["total_episodes"] == len(order)
    assert len(table(path, "data/*/*.parquet")) == len(places(order))


def test_what_cannot_be_written(device: wp.Device, tmp_path: Path) -> None:
    path = tmp_path / "lift"
    record(path, device)
    for options, message in (
        ({}, "fps None came, the format 'lerobot' needs a whole number"),
        ({"fps": 2.5}, "fps 2.5 came"),
        ({"fps": 30, "append": True}, "fps 30 came, .* has 20"),
        ({"fps": 20, "task": ["a", 1]}, "task .* came, one sentence or one for each world"),
        ({"fps": 20, "compression": 2}, "compression 2 came, the format 'lerobot' has fps, task, "),
    ):
        with pytest.raises(WarpcamError, match=message):
            Writer(path, format="lerobot", **options)  # type: ignore[arg-type]
    actions, image = np.zeros((3, 2), np.float32), np.zeros((3, 15, 24, 3), np.uint8)
    for step, message in (
        ({"observations": {"state": actions}}, r"next\.done is absent here, bool\[1\] in the episodes of"),
        ({"observations": {"front_rgb": image}}, "observation.images.front is 24x15, videos need even sides"),
        ({"observations": {"a_rgb": image, "a": image}}, "two columns would be 'observation.images.a'"),
        ({"observations": actions, "states": actions}, "the format 'lerobot' has no place for states"),
    ):
        with Writer(path, format="lerobot", fps=FPS, append=True) as writer:
            with pytest.raises(WarpcamError, match=message):
                writer.step(actions=actions, **step)
    with (
        Writer(tmp_path / "new", format="lerobot", fps=FPS, task=["a"]) as writer,
        pytest.raises(WarpcamError, match="task has 1 sentences, actions have 3 worlds"),
    ):
        writer.step(actions=actions, observations=actions)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_bytes(b"")
    with pytest.raises(WarpcamError, match="full' is not empty, and no LeRobot dataset"):
        Writer(tmp_path / "full", format="lerobot", fps=FPS)
