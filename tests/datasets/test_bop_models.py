"""Models of BOP data sets, and scene_gt_coco.json: what is drawn, told by other means."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import warp as wp
from dataset_plans import RECIPES, plan_of
from PIL import Image
from pycocotools.coco import COCO

import warpcam as wc
from warpcam.datasets.generate import Worlds, generate
from warpcam.datasets.generate.object_models import diameter

cv2 = pytest.importorskip("cv2", reason="pip install opencv-python-headless")

# pycocotools with numpy 2.
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")


def read(path: Path) -> Any:
    return json.loads(path.read_text())


def test_models_cover_their_silhouettes(device: wp.Device, tmp_path: Path) -> None:
    """All three are convex: a model's hull in the image is the amodal mask."""
    plan = plan_of(tmp_path, writer="bop", width=160, height=120, device=device.alias)
    generate(plan)
    out = Path(plan.out)
    info = read(out / "models" / "models_info.json")
    diameters = [400.0 * 3**0.5 + 2.0, 360.0, 500.0]  # the crate has sites at two corners, 1 mm in radius
    assert [info[str(k)]["diameter"] for k in (1, 2, 3)] == pytest.approx(diameters, rel=1e-4)
    assert [info["3"][f"size_{axis}"] for axis in "xyz"] == pytest.approx([200.0, 200.0, 500.0], rel=1e-4)
    assert [info["1"][f"min_{axis}"] for axis in "xyz"] == pytest.approx([-201.0] * 3, rel=1e-4)
    compared = 0
    for shard in sorted((out / "train_pbr").iterdir()):
        cameras, poses = (read(shard / f"scene_{name}.json") for name in ("camera", "gt"))
        for image, entries in poses.items():
            for place, pose in enumerate(entries):
                model = trimesh.load(out / "models" / f"obj_{pose['obj_id']:06d}.ply", process=False)
                assert model.volume > 0.0  # faces look outwards
                points = model.vertices @ np.reshape(pose["cam_R_m2c"], (3, 3)).T + pose["cam_t_m2c"]
                points = points @ np.reshape(cameras[image]["cam_K"], (3, 3)).T
                hull = cv2.convexHull((points[:, :2] / points[:, 2:]).astype(np.float32))
                canvas = np.zeros((120, 160), np.uint8)
                cv2.fillConvexPoly(canvas, np.rint(256 * hull).astype(np.int32), 1, shift=8)
                mask = np.asarray(Image.open(shard / "mask" / f"{int(image):06d}_{place:06d}.png")) > 0
                if mask.sum() > 200:
                    compared += 1
                    assert (canvas[mask] == 1).mean() > 0.97 and mask[canvas == 1].mean() > 0.85  # its edge is filled
    assert compared > 10


def test_annotations_of_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = plan_of(tmp_path, writer="bop", recipes=RECIPES.replace("radius: [1.6, 2.6]", "radius: [0.9, 1.6]"))
    generate(plan)
    ignored = []
    for shard in sorted((Path(plan.out) / "train_pbr").iterdir()):
        coco, infos, poses = (
            COCO(str(shard / "scene_gt_coco.json")),
            *(read(shard / f"scene_{name}.json") for name in ("gt_info", "gt")),
        )
        capsys.readouterr()
        assert [each["name"] for each in coco.loadCats([1, 2, 3])] == ["box", "ball", "pill"]
        for image, entries in poses.items():
            info = coco.loadImgs(int(image))[0]
            pixels = np.asarray(Image.open(shard / info["file_name"]))
            assert pixels.shape[:2] == (info["height"], info["width"]) == (48, 64)
            annotations = coco.loadAnns(coco.getAnnIds(int(image)))
            seen = [place for place, each in enumerate(infos[image]) if each["px_count_visib"]]
            for found, place in zip(annotations, seen, strict=True):
                name = f"{int(image):06d}_{place:06d}.png"
                whole, visible = (np.asarray(Image.open(shard / kind / name)) > 0 for kind in ("mask", "mask_visib"))
                np.testing.assert_array_equal(coco.annToMask(found) > 0, visible)
                assert found["category_id"] == entries[place]["obj_id"] and found["area"] == visible.sum()
                rows, columns = np.nonzero(whole)
                left, top, width, height = found["bbox"]
                assert (left, top) == (columns.min(), rows.min())
                assert (left + width, top + height) == (columns.max() + 1, rows.max() + 1)
                assert found["ignore"] == (infos[image][place]["visib_fract"] < 0.1)
                ignored.append(found["ignore"])
    assert len(ignored) > 10


def test_objects_are_surfaces(tmp_path: Path) -> None:
    """Bodies of a class that are alike are one object, whatever their poses; meshes and several shapes are models."""
    (tmp_path / "wedge.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    geoms = '<geom type="ellipsoid" size=".1 .2 .3"/><geom type="mesh" mesh="wedge" pos="0 0 .5"/>'
    bodies = "".join(f'<body name="nut{k}" pos="{k} 0 {k}" euler="{40 * k} 0 0">{geoms}</body>' for k in range(2))
    bodies += '<body name="bolt"><geom type="cylinder" size=".1 .2"/></body>'
    asset = '<asset><mesh name="wedge" file="wedge.obj" scale="2 1 1"/></asset>'
    plan = plan_of(tmp_path, writer="bop", recipes="labels: {classes: {part: [nut*, bolt], spare: bolt}}")
    Path(plan.scene).write_text(f"<mujoco>{asset}<worldbody><light/>{bodies}</worldbody></mujoco>")
    with pytest.raises(wc.WarpcamError, match="spare"):
        Worlds(plan)  # the first class has taken it
    recipes = dataclasses.replace(plan.recipes.labels, classes=(("part", ("nut*", "bolt")),))
    worlds = Worlds(dataclasses.replace(plan, recipes=dataclasses.replace(plan.recipes, labels=recipes)))
    assert [model.name for model in worlds.models] == ["nut0", "bolt"]
    frame = next(worlds.draw([0]))
    assert {each.name: each.model for each in frame.instances} == {"nut0": 0, "nut1": 0, "bolt": 1}
    whole = trimesh.Trimesh(worlds.models[0].vertices, worlds.models[0].faces)
    parts = sorted(whole.split(only_watertight=False), key=lambda part: part.bounds[0, 2])
    np.testing.assert_allclose(parts[0].bounds, [[-0.1, -0.2, -0.3], [0.1, 0.2, 0.3]], atol=1e-4)
    np.testing.assert_allclose(parts[1].bounds, [[0, 0, 0.5], [2, 1, 1.5]], atol=1e-4)
    assert parts[1].volume == pytest.approx(2.0 / 6.0, rel=1e-4)


def test_surfaces_without_a_model(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, writer="bop", recipes=None)
    floor = '<body name="floor"><geom type="plane" size="1 1 1"/></body>'
    Path(plan.scene).write_text(f"<mujoco><worldbody><light/>{floor}</worldbody></mujoco>")
    with pytest.raises(wc.WarpcamError, match=re.escape("labels: 'floor' has a plane, a height field or another")):
        Worlds(plan)


def test_diameters() -> None:
    random = np.random.default_rng(0)
    clouds = [random.normal(size=(500, 3)) * scale for scale in (1.0, (1.0, 5.0, 0.1), (0.0, 0.0, 1.0))]
    for points in (*clouds, np.zeros((3, 3)), trimesh.creation.icosphere().vertices):
        expected = np.linalg.norm(points[:, None] - points[None], axis=-1).max()
        assert diameter(points) == pytest.approx(expected)
