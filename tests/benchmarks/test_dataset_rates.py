"""The benchmark of data sets runs, tells all of its parts, and its loop with mujoco.Renderer labels the same things."""

import json
import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fast_compile
import numpy as np
import pytest
import warp as wp

from warpcam.benchmarks import datasets
from warpcam.datasets.generate import Plan, Worlds, read_recipes
from warpcam.sources.mujoco import batch_file

SMALL = ["--size", "32x24", "--count", "4", "--worlds", "2", "--workers", "1", "--batches", "1", "--mujoco-count", "2"]
SMALL += ["--shard-size", "2"]


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have programs that are started compile kernels as this one does."""

    def quickly(command: list[str], **options: Any) -> Any:
        return subprocess.run([command[0], fast_compile.__file__, *command[1:]], **options)

    monkeypatch.setattr(datasets, "subprocess", SimpleNamespace(run=quickly))


def test_parts(device: wp.Device, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rates.json"
    datasets.main(["--device", device.alias, "--png", "--out", str(out), *SMALL])
    report = json.loads(out.read_text())
    assert capsys.readouterr().out.count("\n") >= len(report["results"])
    rows: dict[str, list] = {}
    for row in report["results"]:
        rows.setdefault(row["part"], []).append(row)
    assert {row["image_format"] for row in rows["total"]} == {"jpg", "png"} and len(rows["stages"]) >= 2
    for row in rows["total"]:
        assert row["count"] == 4 and row["images_per_s"] > 0.0 and row["steady_images_per_s"] > 0.0
    names = {"randomise", "render", "labels", "masks, boxes and file (a thread)", "statistics (a thread)"}
    assert all(names <= row["ms"].keys() for row in rows["stages"])
    (mujoco,) = rows["mujoco"]
    assert "does not run" in mujoco["skipped"] if "skipped" in mujoco else mujoco["images_per_s"] > 0.0


def test_without_a_context(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    plan = Plan(str(batch_file.DEMO), "none", "coco", 1, width=32, height=24, device="cpu")
    assert "mujoco.Renderer by disable does not run" in datasets.mujoco_rates(plan, 1)["skipped"]


def test_the_loop_of_mujoco_s_renderer(tmp_path: Path) -> None:
    """Its masks are those of our frames of the same samples, but for the field of view, which is fixed here."""
    recipes = tmp_path / "recipes.yaml"
    recipes.write_text(datasets.RECIPES.replace("fovy: [38, 52]", "fovy: 45"))
    plan = Plan(
        str(batch_file.DEMO), str(tmp_path / "out"), "coco", 2, width=96, height=72, device="cpu", worlds=2,
        recipes=read_recipes(recipes), antialiasing=1,
    )  # fmt: skip
    ours = list(Worlds(plan).draw([0, 1]))
    program = (
        "import sys, pickle, pathlib, dataclasses\nfrom warpcam.benchmarks.datasets_mujoco import Loop\n"
        "plan, folder = pickle.loads(pathlib.Path(sys.argv[1]).read_bytes())\n"
        "loop = Loop(dataclasses.replace(plan, worlds=1), pathlib.Path(folder))\n"
        "frames = [{each.name: loop_frame.mask(each) for each in loop_frame.instances} "
        "for loop_frame in map(loop.frame, range(2))]\n"
        "pathlib.Path(sys.argv[1]).write_bytes(pickle.dumps(frames))\n"
    )
    task = tmp_path / "task"
    task.write_bytes(pickle.dumps((plan, str(tmp_path / "loop"))))
    command = [sys.executable, "-c", program, str(task)]
    done = datasets.subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode and "GL" in done.stderr:
        pytest.skip(f"mujoco.Renderer does not run: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    compared = 0
    for theirs, frame in zip(pickle.loads(task.read_bytes()), ours, strict=True):
        for each in frame.instances:
            mask, other = frame.mask(each), theirs[each.name]
            if mask.sum() > 40:
                compared += 1
                assert np.logical_and(mask, other).sum() / np.logical_or(mask, other).sum() > 0.8
    assert compared > 2
