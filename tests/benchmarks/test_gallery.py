"""The page of the pictures beside ``mujoco.Renderer``'s, and how likeness is measured."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("mujoco_warp")
from warpcam.benchmarks import gallery, image_metrics

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results" / "fidelity.json"


def test_the_page_says_what_the_results_say(tmp_path: Path) -> None:
    """And why a renderer has not drawn a scene."""
    report = json.loads(RESULTS.read_text())
    report["results"][3]["other"] = {"error": "NotImplementedError: no such solver"}
    report["results"][0]["other"] = {"psnr": 21.37, "flip": 0.1234}
    figures = {"shots": 1, "median_psnr": 21.4, "least_psnr": 21.4, "mean_flip": 0.123, "largest_flip": 0.123}
    report["summary"]["other"] = figures
    gallery.write_page(tmp_path / "gallery.md", report, {"median_psnr": 38.0, "least_psnr": 32.0, "mean_flip": 0.03})
    page = (tmp_path / "gallery.md").read_text()
    assert f"{len(report['results'])} scenes" in page
    assert f"Not drawn: `{report['results'][3]['shot']}` by other: NotImplementedError: no such solver" in page
    assert "| 21.4 | 0.123 |" in page
    for row in report["results"]:
        assert f"](#{row['shot']}) |" in page and f"images/gallery/{row['shot']}.png" in page


def test_what_is_kept_keeps_to_what_is_wanted() -> None:
    """The table is of at least 30 scenes, and of mujoco_warp's renderer beside ours."""
    summary = json.loads(RESULTS.read_text())["summary"]
    ours = summary["warpcam"]
    assert ours["shots"] >= 30 and ours["median_psnr"] >= 38.0 and ours["least_psnr"] >= 32.0
    assert ours["mean_flip"] < 0.03
    assert summary["mujoco_warp"]["shots"] >= 30


def test_likeness() -> None:
    black, grey = np.zeros((32, 32, 3), np.uint8), np.full((32, 32, 3), 51, np.uint8)
    assert image_metrics.psnr(black, black) == image_metrics.BEST
    assert image_metrics.psnr(black, grey) == pytest.approx(20.0 * np.log10(5.0))
    assert image_metrics.largest(black, grey) == 51
    pytest.importorskip("flip_evaluator", reason="needs flip-evaluator: pip install flip-evaluator")
    assert image_metrics.flip(grey, grey)[0] == 0.0 and image_metrics.flip(black, grey)[0] > 0.1


def test_pictures_lie_side_by_side(tmp_path: Path) -> None:
    judge, ours = np.full((8, 8, 3), 100, np.uint8), np.full((8, 8, 3), 110, np.uint8)
    gallery.save(tmp_path / "one.png", judge, ours)
    seen = np.asarray(Image.open(tmp_path / "one.png").convert("RGB"))
    assert seen.shape == (8, 3 * 8 + 2 * gallery.GAP, 3)
    assert (seen[4, 4] == 100).all() and (seen[4, 14] == 110).all() and (seen[4, 24] == 10 * gallery.STRETCH).all()
