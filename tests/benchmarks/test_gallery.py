"""The page of the pictures beside ``mujoco.Renderer``'s, and how likeness is measured."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
import scenes
from mujoco_reference import reference_renderer
from PIL import Image

pytest.importorskip("mujoco_warp")
from warpcam.benchmarks import crowded_scenes, fidelity, fidelity_scenes, gallery, image_metrics

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


def test_crowded_scenes_are_as_near_as_the_judges_own_finer_pictures() -> None:
    crowded = json.loads(RESULTS.read_text())["crowded"]
    ours, finer = crowded[fidelity.OURS], crowded[fidelity.JUDGE_FINER]
    assert ours["shots"] == finer["shots"] == len(crowded_scenes.SCENES)
    assert ours["least_psnr"] > 30.0 and ours["least_psnr"] > finer["least_psnr"]
    assert ours["mean_flip"] < 0.035


def test_sample_for_sample_the_pictures_are_nearer() -> None:
    """With 64 samples each, where the judge's four are no noise."""
    report = json.loads(RESULTS.read_text())
    finer = report["summary"][fidelity.OURS_FINER]
    assert finer["shots"] >= 30 and finer["median_finer_psnr"] >= 44.0 and finer["least_finer_psnr"] >= 35.0
    assert finer["mean_finer_flip"] <= 0.012
    assert report["crowded"][fidelity.OURS_FINER]["least_finer_psnr"] >= 40.0


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


@pytest.mark.parametrize("name", crowded_scenes.SCENES)
def test_scenes_made_here_are_crowded_with_thin_things(name: str) -> None:
    """The camera sees most of them, and most of these are less than five pixels thick."""
    (shot,) = [shot for shot in fidelity_scenes.SHOTS if shot.name == name]
    mjm, mjd, camera = fidelity_scenes.load(shot)
    things = mjm.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    assert things.sum() > 50
    local = (mjd.geom_xpos[things] - mjd.cam_xpos[camera]) @ mjd.cam_xmat[camera].reshape(3, 3)
    depth = -local[:, 2]
    pixel = 2.0 * np.tan(np.radians(mjm.cam_fovy[camera]) / 2.0) / fidelity.SIZE * depth
    inside = (depth > 0.0) & (np.abs(local[:, :2]).max(axis=1) < fidelity.SIZE / 2 * pixel)
    assert inside.mean() > 0.9
    sizes = np.where(mjm.geom_size[things] > 0.0, mjm.geom_size[things], np.inf)
    assert np.median(2.0 * sizes.min(axis=1) / pixel) < (12.0 if name == "bricks" else 5.0)


def test_the_judges_finer_picture_has_finer_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    """An edge that leaves three tenths of a pixel covered, by a camera whose image is a metre wide on the box."""
    reference_renderer(scenes.compile_xml(""), 8, 8).close()
    monkeypatch.setattr(fidelity, "SIZE", 16)
    mjm = mujoco.MjModel.from_xml_string(
        """<mujoco>
          <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
          <worldbody>
            <geom type="box" size="1 2 .1" pos="-.98125 0 -.1" rgba="1 1 1 1"/>
            <camera pos="0 0 1" fovy="53.130102"/>
          </worldbody>
        </mujoco>"""
    )
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    judge, finer = (draw(mjm, mjd, 0, fidelity.SAMPLES) for draw in (fidelity.draw_judge, fidelity.draw_finer))
    for picture in (judge, finer):
        assert (picture[:, :8] == 255).all() and (picture[:, 9:] == 0).all()
    assert set(np.unique(judge[:, 8])) == {64}
    np.testing.assert_allclose(finer[:, 8] / 255.0, 0.3, atol=0.04)
