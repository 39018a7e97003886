"""The benchmark of physically based looks: its scenes, its renderers and its results."""

import json
from pathlib import Path

import numpy as np
import pytest
import warp as wp

pytest.importorskip("mujoco_warp")
pytest.importorskip("flip_evaluator", reason="needs flip-evaluator: pip install flip-evaluator")
from PIL import Image

import warpcam as wc
from warpcam.benchmarks import look_speed, problem
from warpcam.benchmarks.pbr_scenes import SCENES

PBR = ["mujoco_warp_pbr realtime", "mujoco_warp_pbr optix"]
QUICK = ["--device", "cpu", "--worlds", "1", "--size", "32", "--samples", "4", "--frames", "1", "--scene", "quadruped"]


@pytest.mark.parametrize("name", SCENES)
def test_scenes_open(name: str, device: wp.Device) -> None:
    """Materials have maps of colour, and geoms move with the sets of poses."""
    with wp.ScopedDevice(device):
        scene = problem.build(SCENES[name], 2, 16, 16)
        assert np.isfinite(wc.from_mujoco_warp(scene.mjm, scene.m, scene.d).bounds()).all()
    positions = [pose["geom_xpos"].numpy() for pose in scene.poses]
    assert np.abs(positions[0] - positions[1]).max() > 0.001
    assert scene.faces() > 60_000
    assert scene.mjm.mat_texid[:, 1].min() >= 0


def test_the_command_draws_and_writes_results(tmp_path: Path) -> None:
    out = tmp_path / "speed.json"
    look_speed.main([*QUICK, "--kind", "pbr", "--peer", "--out", str(out), "--pictures", str(tmp_path)])
    report = json.loads(out.read_text())
    assert [(row["renderer"], row["worlds"], row["size"]) for row in report["results"]] == [("warpcam pbr", 1, 32)]
    assert report["results"][0]["frames_per_s"] > 0.0 and "device" in report["machine"]
    picture = np.asarray(Image.open(tmp_path / "quadruped-32x32-1-warpcam_pbr.png"))
    assert picture.shape == (32, 32, 3) and picture.std() > 5.0


def test_the_peer_draws_the_same(tmp_path: Path) -> None:
    pytest.importorskip("mujoco_warp_pbr", reason="needs mujoco-warp-pbr: pip install mujoco-warp-pbr, Python 3.12")
    out = tmp_path / "speed.json"
    look_speed.main([*QUICK, "--kind", "pbr", "--peer", *PBR, "--out", str(out)])
    ours, peer, optix = json.loads(out.read_text())["results"]
    assert "warpcam_over_this" not in ours and peer["warpcam_over_this"] > 0.0
    assert peer["mean_difference"] < 12.0
    assert "CUDA" in optix["error"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--size", "8"], "--worlds, --size: both or none, got None and 8"),
        (["--samples", "0"], "--samples: must be at least 1, got 0"),
    ],
)
def test_options_that_are_wrong(arguments: list[str], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        look_speed.main(arguments)


def test_means_are_geometric_and_of_peers_alone() -> None:
    same = {"renderer": "peer", "worlds": 2, "size": 8}
    rows = [{**same, "warpcam_over_this": 2.0}, {**same, "warpcam_over_this": 8.0}, {**same, "error": "none"}]
    assert look_speed.means(rows) == {"peer, 2 x 8x8": pytest.approx(4.0)}
