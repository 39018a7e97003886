"""COCO data sets, as pycocotools reads them."""

import dataclasses
import io
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from dataset_plans import RECIPES, plan_of
from PIL import Image, ImageDraw
from pycocotools.coco import COCO

import warpcam as wc
from warpcam.datasets.generate import Plan, Worlds, generate
from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.generate.statistics import DEPTHS

# pycocotools with numpy 2.
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")

GOLDEN = Path(__file__).parent / "goldens" / "coco.png"


def test_read_by_pycocotools(device: wp.Device, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = plan_of(tmp_path, device=device.alias)
    generate(plan)
    coco = COCO(str(Path(plan.out) / "coco_annotations.json"))
    capsys.readouterr()
    assert [each["name"] for each in coco.loadCats(coco.getCatIds())] == ["box", "round"]
    assert coco.loadCats(1)[0]["keypoints"] == ["near corner", "far corner"]
    frames = list(Worlds(plan).draw(range(3)))
    assert len(coco.imgs) == 7 and len({each["id"] for each in coco.dataset["annotations"]}) == len(coco.anns)
    for frame in frames:
        image = coco.loadImgs(frame.number)[0]
        colors = np.asarray(Image.open(Path(plan.out) / image["file_name"]))
        np.testing.assert_array_equal(colors, frame.colors)
        assert (image["height"], image["width"]) == colors.shape[:2] == (48, 64)
        annotations = {each["instance"]: each for each in coco.loadAnns(coco.getAnnIds(frame.number))}
        seen = {each.name: each for each in frame.instances if each.visible_pixels}
        assert annotations.keys() == seen.keys() and seen
        for name, found in annotations.items():
            mask = coco.annToMask(found).astype(bool)
            np.testing.assert_array_equal(mask, frame.ids == seen[name].id)
            rows, columns = np.nonzero(mask)
            left, top, width, height = found["bbox"]
            assert (left, top) == (columns.min(), rows.min())
            assert (left + width, top + height) == (columns.max() + 1, rows.max() + 1)
            assert found["area"] == mask.sum() and found["category_id"] == 1 + (name != "crate")
            assert ("keypoints" in found) == (name == "crate")


def test_annotations_over_an_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """WARPCAM_WRITE_GOLDENS=1 keeps the picture of today."""
    plan = plan_of(tmp_path, count=4, shard_size=2, width=160, height=120)
    generate(plan)
    coco = COCO(str(Path(plan.out) / "coco_annotations.json"))
    capsys.readouterr()
    pictures = []
    for number in range(4):
        image = np.array(Image.open(Path(plan.out) / coco.loadImgs(number)[0]["file_name"]))
        annotations = coco.loadAnns(coco.getAnnIds(number))
        for found in annotations:
            mask = coco.annToMask(found).astype(bool)
            image[mask] = image[mask] // 2 + np.array(((127, 0, 0), (0, 0, 127))[found["category_id"] - 1], np.uint8)
        picture = Image.fromarray(image)
        draw = ImageDraw.Draw(picture)
        for found in annotations:
            left, top, width, height = found["bbox"]
            draw.rectangle((left, top, left + width - 1, top + height - 1), outline="lime")
            for x, y, visible in np.reshape(found.get("keypoints", []), (-1, 3)):
                draw.ellipse((x - 2, y - 2, x + 2, y + 2), outline="yellow", fill="yellow" if visible == 2 else None)
        pictures.append(np.asarray(picture))
    sheet = np.concatenate(pictures, axis=1)
    if os.environ.get("WARPCAM_WRITE_GOLDENS"):
        Image.fromarray(sheet).save(GOLDEN, optimize=True)
    kept = np.asarray(Image.open(GOLDEN)).astype(int)
    assert (np.abs(kept - sheet).max(axis=-1) > 40).mean() < 0.01


def test_parts_for_training_and_validation(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, recipes=None, count=30, shard_size=10, validation=0.3)
    generate(plan)
    parts = [json.loads((Path(plan.out) / f"coco_annotations_{name}.json").read_text()) for name in ("train", "val")]
    train, val = ({image["id"] for image in part["images"]} for part in parts)
    assert train | val == set(range(30)) and not train & val and 3 < len(val) < 16
    for part, own in zip(parts, (train, val), strict=True):
        assert {each["image_id"] for each in part["annotations"]} <= own


def drawn(plan: Plan, first: int, end: int) -> list[Frame]:
    return list(Worlds(plan).draw(range(first, min(first + plan.worlds, end))))


def test_files_of_the_device(device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of JPEG files that the device encodes every one is its image's."""
    pytest.importorskip("torchcodec.encoders", reason="pip install 'warpcam[jpeg]'")
    recipes = RECIPES.replace("backgrounds:", "# backgrounds:")
    plan = plan_of(tmp_path, recipes=recipes, image_format="jpg", jpeg="torchcodec", device=device.alias, quality=95)
    generate(plan)
    for frame in drawn(plan, 0, 3):
        assert frame.jpeg == (Path(plan.out) / f"shards/000000/images/{frame.stem}.jpg").read_bytes()
        found, shown = Image.open(io.BytesIO(frame.jpeg)).convert("L"), Image.fromarray(frame.colors).convert("L")
        assert np.abs(np.asarray(found, int) - np.asarray(shown, int)).mean() < 3.0  # chroma has fewer pixels on CPUs
    with pytest.raises(wc.WarpcamError, match="made with other jpeg;"):
        generate(dataclasses.replace(plan, jpeg="pillow"))
    with pytest.raises(wc.WarpcamError, match=r"'torchcodec' is for \.jpg, and for recipes without backgrounds"):
        plan_of(tmp_path, image_format="jpg", jpeg="torchcodec")
    monkeypatch.setitem(sys.modules, "torchcodec.encoders", None)
    with pytest.raises(
        wc.WarpcamError, match=r"jpeg 'torchcodec' cannot be used \(.*\); pip install 'warpcam\[jpeg\]'"
    ):
        Worlds(plan)


def test_contact_sheet_and_statistics(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, count=5)
    generate(plan)
    total = json.loads((Path(plan.out) / "statistics.json").read_text())
    annotations = json.loads((Path(plan.out) / "coco_annotations.json").read_text())["annotations"]
    counts = [sum(each["category_id"] == number for each in annotations) for number in (1, 2)]
    assert total["instances"] == counts and total["classes"] == ["box", "round"] and total["frames"] == 5
    assert sum(total["sizes"]) == sum(total["visibility"]) == len(annotations)
    assert sum(total["depth"]) + total["depth_missing"] == 5 * 64 * 48
    depths = np.concatenate([frame.depth.ravel() for first in (0, 3) for frame in drawn(plan, first, 5)])
    seen = np.isfinite(depths) & (depths > 0.0)
    expected, _ = np.histogram(np.clip(depths[seen], DEPTHS[0], DEPTHS[-1] * 0.999), DEPTHS.astype(np.float32))
    assert np.abs(expected - total["depth"]).sum() <= 4 and total["depth_missing"] == (~seen).sum()  # at edges of bins
    page = (Path(plan.out) / "statistics.html").read_text()
    assert f"{len(annotations)} visible instances" in page and "<th>round</th>" in page
    assert np.asarray(Image.open(Path(plan.out) / "contact_sheet.png")).shape == (240, 5 * 324 - 4, 3)
