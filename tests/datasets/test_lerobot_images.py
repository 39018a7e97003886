"""Data sets of images in LeRobot's format: its own loader gives back what was drawn, and files are as it has them."""

import dataclasses
import io
import json
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from dataset_plans import RECIPES, files_of, plan_of
from PIL import Image

from warpcam.core.rotations import rotation_matrices
from warpcam.datasets.generate import Plan, Worlds, generate
from warpcam.datasets.generate.frames import Frame

parquet = pytest.importorskip("pyarrow.parquet", reason="pip install 'warpcam[datasets]'")

TWO_CAMERAS = RECIPES.replace("scene:", "  top:\n    shell: {target: [0, 0, 0], radius: 2, elevation: 85}\nscene:", 1)
CAMERAS = ("orbit", "top")


def made(folder: Path, device: wp.Device, **options: object) -> tuple[Plan, list[list[Frame]]]:
    """A data set, and the frames of each of its samples."""
    plan = plan_of(folder, writer="lerobot", recipes=TWO_CAMERAS, device=device.alias, **options)
    generate(plan)
    worlds = Worlds(plan)
    frames = [frame for first in (0, 3, 6) for frame in worlds.draw(range(first, min(first + 3, 7)))]
    return plan, [frames[2 * sample : 2 * sample + 2] for sample in range(7)]


def check_values(item: dict, frames: list[Frame], depth: bool) -> None:
    """Compare what a frame has beside images."""
    poses = np.asarray(item["observation.environment_state"]).reshape(3, 7)
    for frame in frames:
        boxes = np.asarray(item[f"observation.boxes.{frame.camera}"])
        for box, pose, instance in zip(boxes, poses, frame.instances, strict=True):
            assert tuple(map(int, box)) == instance.visible_box
            place = frame.camera_position + frame.camera_rotation @ instance.position
            np.testing.assert_allclose(pose[:3], place, atol=1e-5)
            turn = frame.camera_rotation @ rotation_matrices(instance.rotation[None])[0]
            np.testing.assert_allclose(rotation_matrices(pose[None, 3:].astype(float))[0], turn, atol=1e-5)
        camera = np.asarray(item[f"observation.camera_pose.{frame.camera}"]).astype(float)
        np.testing.assert_allclose(camera[:3], frame.camera_position, atol=1e-5)
        np.testing.assert_allclose(rotation_matrices(camera[None, 3:])[0], frame.camera_rotation, atol=1e-5)
        np.testing.assert_allclose(item[f"observation.intrinsics.{frame.camera}"], frame.intrinsics, rtol=1e-6)
        assert (f"observation.depth.{frame.camera}" in item) == depth
        if depth:
            shown = np.asarray(item[f"observation.depth.{frame.camera}"]).reshape(48, 64)
            np.testing.assert_array_equal(shown, frame.depth)


def test_tables(device: wp.Device, tmp_path: Path) -> None:
    plan, samples = made(tmp_path, device, options=(("depth", True), ("fps", 5)), validation=0.4)
    out = Path(plan.out)
    info = json.loads((out / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["splits"]) == ("v3.0", 5, {"train": "0:7"})
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (7, 7, 1)
    features = {name: (feature["dtype"], feature["shape"]) for name, feature in info["features"].items()}
    assert features["observation.images.orbit"] == ("image", [48, 64, 3])
    assert features["observation.boxes.top"] == ("int32", [3, 4])
    assert info["features"]["observation.environment_state"]["names"][:8:7] == ["crate.x", "ball.x"]
    for shard, (first, end) in enumerate(((0, 3), (3, 6), (6, 7))):
        file = f"chunk-000/file-{shard:03d}.parquet"
        rows = parquet.read_table(out / "data" / file).to_pylist()
        episodes = parquet.read_table(out / "meta/episodes" / file).to_pylist()
        assert len(rows) == len(episodes) == end - first
        for number, row, episode in zip(range(first, end), rows, episodes, strict=True):
            assert row["index"] == row["episode_index"] == number
            assert row["frame_index"] == row["timestamp"] == row["task_index"] == 0
            assert (episode["episode_index"], episode["length"], episode["tasks"]) == (number, 1, [""])
            assert (episode["dataset_from_index"], episode["dataset_to_index"]) == (number, number + 1)
            assert episode["data/file_index"] == episode["meta/episodes/file_index"] == shard
            for frame in samples[number]:
                image = Image.open(io.BytesIO(row[f"observation.images.{frame.camera}"]["bytes"]))
                np.testing.assert_array_equal(np.asarray(image), frame.colors)
            check_values(row, samples[number], depth=True)
    stats = json.loads((out / "meta/stats.json").read_text())
    colors = np.stack([frames[0].colors for frames in samples]) / 255.0
    np.testing.assert_allclose(np.ravel(stats["observation.images.orbit"]["mean"]), colors.mean((0, 1, 2)), atol=1e-9)
    np.testing.assert_allclose(np.ravel(stats["observation.images.orbit"]["std"]), colors.std((0, 1, 2)), atol=1e-9)
    assert stats["index"]["count"] == [7] and stats["index"]["max"] == [6.0]
    parts = [json.loads((out / f"{name}_episodes.json").read_text()) for name in ("train", "val")]
    assert sorted(parts[0] + parts[1]) == list(range(7)) and all(parts)
    classes = json.loads((out / "classes.json").read_text())
    assert classes == {"classes": ["box", "round"], "instances": {"crate": "box", "ball": "round", "pill": "round"}}


def test_grown(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, "grown", writer="lerobot", recipes=None, count=4)
    generate(plan)
    generate(dataclasses.replace(plan, count=7))
    at_once = plan_of(tmp_path, "at once", writer="lerobot", recipes=None, count=7)
    generate(at_once)
    assert files_of(plan.out) == files_of(at_once.out)


@pytest.mark.filterwarnings("ignore")  # of what lerobot imports
def test_lerobot_reads_it(device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    reason = "lerobot[dataset] needs Python 3.12 and a torch before 2.12"
    loader = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason=reason, exc_type=ImportError)
    plan, samples = made(tmp_path, device, options=(("depth", True),))
    read = loader.LeRobotDataset("none/objects", root=plan.out)
    assert len(read) == read.num_episodes == 7
    for number, frames in enumerate(samples):
        item = read[number]
        assert (item["index"], item["episode_index"], item["frame_index"], item["task"]) == (number, number, 0, "")
        for frame in frames:
            image = item[f"observation.images.{frame.camera}"].numpy().transpose(1, 2, 0) * 255.0
            np.testing.assert_allclose(image, frame.colors, atol=1e-3)
        check_values(item, frames, depth=True)
    times = {"observation.images.orbit": [-1.0 / 30, 0.0, 1.0 / 30]}
    around = loader.LeRobotDataset("none/objects", root=plan.out, delta_timestamps=times)[3]
    assert around["observation.images.orbit_is_pad"].tolist() == [True, False, True]  # no other sample's image
    chosen = loader.LeRobotDataset("none/objects", root=plan.out, episodes=[2, 5])
    assert [int(chosen[k]["episode_index"]) for k in range(len(chosen))] == [2, 5]
