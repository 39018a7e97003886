"""Formats beside COCO, each read back by its own library, or by what its page says where there is none."""

import io
import json
import re
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import webdataset
import yaml
from dataset_plans import RECIPES, files_of, plan_of
from PIL import Image, ImageDraw

import warpcam as wc
from warpcam.core.rotations import rotation_matrices
from warpcam.datasets.generate import Plan, Worlds, generate
from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.writers import WRITERS, find_writer
from warpcam.datasets.writers.polygons import outline

# webdataset leaves the files that it reads open.
LEAVES_OPEN = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


def made(tmp_path: Path, writer: str, **options: object) -> tuple[Path, Plan, list[Frame]]:
    plan = plan_of(tmp_path, writer, writer=writer, **options)
    generate(plan)
    worlds = Worlds(plan)
    return Path(plan.out), plan, [*worlds.draw(range(3)), *worlds.draw(range(3, 6)), *worlds.draw([6])]


@pytest.mark.parametrize("writer", WRITERS)
def test_the_same_whatever_draws_them(writer: str, tmp_path: Path) -> None:
    plans = [plan_of(tmp_path, f"{writer} {n}", writer=writer, worlds=n) for n in (2, 3)]
    for plan in plans:
        generate(plan)
        time.sleep(1.01 if writer in ("hdf5", "webdataset") else 0.0)  # whose files could tell when they were made
    assert files_of(plans[0].out) == files_of(plans[1].out)


def test_yolo(tmp_path: Path) -> None:
    out, _, frames = made(tmp_path, "yolo", validation=0.4)
    data = yaml.safe_load((out / "data.yaml").read_text())
    assert data == {"train": "train.txt", "val": "val.txt", "names": {0: "box", 1: "round"}}
    listed = [(out / data[part]).read_text().split() for part in ("train", "val")]
    assert all(listed) and len(set(listed[0] + listed[1])) == 7
    images = sorted(listed[0] + listed[1])
    for path, frame in zip(images, frames, strict=True):
        np.testing.assert_array_equal(np.asarray(Image.open(out / path)), frame.colors)
        labels = out / path.replace("/images/", "/labels/").replace(".png", ".txt")
        rows = np.loadtxt(labels, ndmin=2)
        seen = [each for each in frame.instances if each.visible_pixels]
        np.testing.assert_array_equal(rows[:, 0], [each.category for each in seen])
        middle, size = rows[:, 1:3] * (64, 48), rows[:, 3:] * (64, 48)
        boxes = np.hstack((middle - 0.5 * size, middle + 0.5 * size))
        np.testing.assert_allclose(boxes, [each.visible_box for each in seen], atol=1e-3)


def test_yolo_polygons(tmp_path: Path) -> None:
    out, _, frames = made(tmp_path, "yolo", options=(("polygons", True),))
    shares = []
    for frame in frames:
        labels = next((out / "shards").glob(f"*/labels/{frame.stem}.txt"))
        seen = [each for each in frame.instances if each.visible_pixels]
        for line, instance in zip(labels.read_text().splitlines(), seen, strict=True):
            corners = np.array(line.split()[1:], float).reshape(-1, 2) * (64, 48)
            canvas = Image.new("1", (640, 480))
            ImageDraw.Draw(canvas).polygon([tuple(10.0 * corner - 0.5) for corner in corners], fill=1)
            filled = np.asarray(canvas)[5::10, 5::10]
            assert not (filled & ~frame.mask(instance)).any()
            shares.append(filled.sum() / instance.visible_pixels)
    assert np.mean(shares) > 0.97  # smaller parts are left out


def test_outlines() -> None:
    mask = np.zeros((6, 8), bool)
    mask[1:5, 2:6] = True
    mask[3, 4] = False  # a hole
    mask[5, 7] = True  # another part
    assert outline(mask).tolist() == [[2, 1], [6, 1], [6, 5], [2, 5]]
    mask[1, 2] = False
    assert outline(mask).tolist() == [[3, 1], [6, 1], [6, 5], [2, 5], [2, 2], [3, 2]]
    assert outline(np.ones((1, 1), bool)).tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_kitti(tmp_path: Path) -> None:
    out, _, frames = made(tmp_path, "kitti")
    assert (out / "ImageSets" / "train.txt").read_text().split() == [f"{number:06d}" for number in range(7)]
    for frame in frames:
        name = f"{frame.number:06d}"
        colors = np.asarray(Image.open(out / "training" / "image_2" / f"{name}.png"))
        np.testing.assert_array_equal(colors, frame.colors)
        calibration = dict(
            line.split(": ") for line in (out / "training" / "calib" / f"{name}.txt").read_text().splitlines()
        )
        projection = np.array(calibration["P2"].split(), float).reshape(3, 4)
        lines = (out / "training" / "label_2" / f"{name}.txt").read_text().splitlines()
        seen = [each for each in frame.instances if each.visible_pixels]
        for line, instance in zip(lines, seen, strict=True):
            kind, *rest = line.split()
            truncated, occluded, alpha, left, top, right, bottom, *box = map(float, rest)
            height, width, length, x, y, z, yaw = box
            assert kind == ("Box", "Round")[instance.category] and truncated == instance.truncated
            assert (left, top, right + 1, bottom + 1) == instance.visible_box
            assert occluded == (0 if instance.visibility >= 0.95 else 1 if instance.visibility >= 0.5 else 2)
            assert abs(np.angle(np.exp(1j * (yaw - np.arctan2(x, z) - alpha)))) < 0.02
            # The upright box holds the tight one, and its centre is where that one's is.
            signs = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)]) * 2.0 - 1.0
            corners = instance.box_center + signs * instance.half_extents
            points = (instance.position + corners @ rotation_matrices(instance.rotation[None])[0].T) * (1, -1, -1)
            local = points - (x, y - 0.5 * height, z)
            np.testing.assert_allclose(local.mean(axis=0), 0.0, atol=0.02)
            along = np.cos(yaw) * local[:, 0] - np.sin(yaw) * local[:, 2]
            across = np.sin(yaw) * local[:, 0] + np.cos(yaw) * local[:, 2]
            for spread, size in ((along, length), (local[:, 1], height), (across, width)):
                assert abs(np.ptp(spread) - size) < 0.03
            pixels = points @ projection[:, :3].T
            pixels = pixels[:, :2] / pixels[:, 2:] + 0.5
            np.testing.assert_allclose(pixels, instance.corners, atol=0.02)


@pytest.mark.parametrize("compress", [True, False])
def test_hdf5(compress: bool, tmp_path: Path) -> None:
    out, _, frames = made(tmp_path, "hdf5", options=(("compress", compress),))
    with h5py.File(out / "dataset.h5") as file:
        assert list(file.attrs["classes"]) == ["box", "round"] and file["sample"][:].tolist() == list(range(7))
        assert file["rgb"].shape == (7, 48, 64, 3) and file["depth"].dtype == np.float32
        for frame in frames:
            for name, image in (("rgb", frame.colors), ("depth", frame.depth), ("ids", frame.ids)):
                np.testing.assert_array_equal(file[name][frame.number], image)
            labels = json.loads(file["labels"][frame.number])
            for found, instance in zip(labels["instances"], frame.instances, strict=True):
                assert found["class"] == frame.classes[instance.category] and found["id"] == instance.id
                assert tuple(found["visible_box"]) == instance.visible_box
                np.testing.assert_allclose(found["position"], instance.position)


@LEAVES_OPEN
def test_webdataset(tmp_path: Path) -> None:
    out, _, frames = made(tmp_path, "webdataset")
    index = json.loads((out / "index.json").read_text())
    assert [shard["frames"] for shard in index["shards"]] == [3, 3, 1]
    urls = [str(out / shard["path"]) for shard in index["shards"]]
    read = list(webdataset.WebDataset(urls, shardshuffle=False).decode("rgb8"))
    for found, frame in zip(read, frames, strict=True):
        assert found["__key__"] == frame.stem
        np.testing.assert_array_equal(found["png"], frame.colors)
        np.testing.assert_array_equal(found["ids.npy"], frame.ids)
        assert found["json"]["sample"] == frame.sample
        assert [each["visible_pixels"] for each in found["json"]["instances"]] == [
            each.visible_pixels for each in frame.instances
        ]


@LEAVES_OPEN
def test_webdataset_depth(tmp_path: Path) -> None:
    for floats in (False, True):
        plan = plan_of(tmp_path, f"depth {floats}", writer="webdataset", options=(("float_depth", floats),))
        generate(plan)
        frame = next(Worlds(plan).draw([0]))
        found = next(iter(webdataset.WebDataset(f"{plan.out}/shards/000000/samples.tar", shardshuffle=False).decode()))
        if floats:
            np.testing.assert_array_equal(found["depth.npy"], frame.depth)
            continue
        raw = next(iter(webdataset.WebDataset(f"{plan.out}/shards/000000/samples.tar", shardshuffle=False)))
        units = np.asarray(Image.open(io.BytesIO(raw["depth.png"])))
        expected = np.where(np.isfinite(frame.depth), np.round(1000.0 * frame.depth), 0.0)
        np.testing.assert_allclose(units, expected, atol=1)


def test_bop(tmp_path: Path) -> None:
    close = RECIPES.replace("radius: [1.6, 2.6]", "radius: [0.9, 1.6]")
    out, _, frames = made(tmp_path, "bop", recipes=close, options=(("depth_scale", 0.5),))
    assert json.loads((out / "objects.json").read_text()) == {"1": "box", "2": "ball", "3": "pill"}
    camera = json.loads((out / "camera.json").read_text())
    assert (camera["width"], camera["height"], camera["depth_scale"]) == (64, 48, 0.5)
    cut = 0
    for frame in frames:
        scene, key = out / "train_pbr" / f"{frame.number // 3:06d}", str(frame.number % 3)
        cameras, poses, infos = (
            json.loads((scene / f"scene_{name}.json").read_text())[key] for name in ("camera", "gt", "gt_info")
        )
        matrix = np.reshape(cameras["cam_K"], (3, 3))
        to_camera, shift = np.reshape(cameras["cam_R_w2c"], (3, 3)), np.array(cameras["cam_t_w2c"])
        np.testing.assert_allclose(to_camera @ (1000.0 * frame.camera_position) + shift, 0.0, atol=1e-3)
        depth = np.asarray(Image.open(scene / "depth" / f"{int(key):06d}.png")).astype(float)
        there = np.isfinite(frame.depth)
        np.testing.assert_allclose(0.5 * depth[there], 1000.0 * frame.depth[there], atol=0.26)
        assert not depth[~there].any()
        np.testing.assert_array_equal(np.asarray(Image.open(scene / "rgb" / f"{int(key):06d}.png")), frame.colors)
        assert len(poses) == len(infos) == len(frame.instances) == 3
        for place, (pose, info, instance) in enumerate(zip(poses, infos, frame.instances, strict=True)):
            assert pose["obj_id"] == 1 + ["crate", "ball", "pill"].index(instance.name)
            rotation = np.reshape(pose["cam_R_m2c"], (3, 3))
            signs = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)]) * 2.0 - 1.0
            corners = 1000.0 * (instance.box_center + signs * instance.half_extents)
            points = (corners @ rotation.T + pose["cam_t_m2c"]) @ matrix.T
            np.testing.assert_allclose(points[:, :2] / points[:, 2:] + 0.5, instance.corners, atol=0.05)
            name = f"{int(key):06d}_{place:06d}.png"
            whole, seen = (np.asarray(Image.open(scene / kind / name)) for kind in ("mask", "mask_visib"))
            assert set(np.unique(whole)) <= {0, 255} and not (seen & ~whole).any()
            np.testing.assert_array_equal(seen > 0, frame.mask(instance))
            count = np.count_nonzero(whole)
            assert count == instance.amodal_pixels and info["px_count_visib"] == np.count_nonzero(seen)
            assert info["px_count_valid"] == np.count_nonzero(depth[whole > 0])
            assert info["px_count_all"] == count or ((instance.truncated or not count) and info["px_count_all"] > count)
            assert info["visib_fract"] == pytest.approx(info["px_count_visib"] / max(info["px_count_all"], 1))
            if not seen.any():
                assert info["bbox_obj"] == info["bbox_visib"] == [-1, -1, -1, -1]
                continue
            rows, columns = np.nonzero(seen)
            left, top, width, height = info["bbox_visib"]
            assert (left, left + width, top, top + height) == (columns.min(), columns.max(), rows.min(), rows.max())
            rows, columns = np.nonzero(whole)
            left, top, width, height = info["bbox_obj"]
            assert left <= columns.min() and left + width >= columns.max()
            assert top <= rows.min() and top + height >= rows.max()
            cut += left < 0 or top < 0 or left + width > 63 or top + height > 47
    assert cut > 2  # silhouettes go on beyond the edges


def test_a_package_that_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycocotools", None)
    with pytest.raises(
        wc.WarpcamError, match=re.escape("pycocotools is not installed, and coco needs it: pip install")
    ):
        find_writer("coco")


@pytest.mark.parametrize("writer", ["bop", "kitti"])
def test_other_lenses_are_refused(writer: str, tmp_path: Path) -> None:
    plan = plan_of(tmp_path, writer=writer, recipes=None)
    camera = '<worldbody><camera name="flat" pos="0 0 3" projection="orthographic" fovy="2"/>'
    Path(plan.scene).write_text(Path(plan.scene).read_text().replace("<worldbody>", camera))
    with pytest.raises(wc.WarpcamError, match=f"{writer} has pinhole cameras alone, and 'flat' has another lens"):
        Worlds(plan)
