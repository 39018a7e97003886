"""The benchmark runner runs, compares images and writes what it found. Times are not judged."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

RUNNER = Path(__file__).resolve().parents[1] / "benchmarks" / "run.py"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": ""}
    return subprocess.run([sys.executable, str(RUNNER), *arguments], env=environment, capture_output=True, text=True)


def test_tiny_case_writes_its_json(tmp_path: Path) -> None:
    pytest.importorskip("mujoco_warp")
    out = tmp_path / "tiny.json"
    tiny = ("--case", "humanoid", "--worlds", "2", "--size", "12x8", "--replays", "2", "--device", "cpu")
    done = run(*tiny, "--peer", "mujoco_warp", "warpcam", "--threads", "1", "--out", str(out))
    assert done.returncode == 0, done.stderr

    report = json.loads(out.read_text())
    case = report["cases"]["humanoid"]
    assert case["rays"] == 2 * 12 * 8
    assert case["reference"] == "mujoco_warp"
    ours, peer = (case["renderers"][name] for name in ("warpcam", "mujoco_warp"))
    assert "error" not in ours, ours["error"]
    assert ours["ms"]["frames"] == peer["ms"]["frames"] == 2
    assert ours["times_warpcam"] == 1.0
    assert len(ours["difference"]) == 2
    for pose in ours["difference"]:
        assert pose["hit_fraction"] > 0.5
        assert pose["ids_mismatch"] <= 0.02
        assert pose["depth_mismatch"] <= 0.02
    assert {"cpu", "python", "mujoco", "mujoco-warp"} <= report["machine"].keys()
    assert "warpcam" in done.stdout


def test_unknown_case_is_named() -> None:
    pytest.importorskip("mujoco_warp")
    done = run("--case", "teapot")
    assert done.returncode != 0
    assert "teapot" in done.stderr and "primitives" in done.stderr
