"""Training behind one env: all renderers see the same, runs are kept and not done twice, several processes learn."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")

from warpcam.benchmarks import training, training_table
from warpcam.benchmarks.training_renderers import PEERS, WARPCAM, eyes
from warpcam.errors import WarpcamError
from warpcam.train import CartPole, Reach

WORLDS, SIZE = 4, (32, 32)


@pytest.mark.parametrize("name", PEERS)
def test_peers_see_what_warpcam_does(device: wp.Device, name: str) -> None:
    """In each world, after steps and after the reset of some: the cart and the pole are where warpcam has them."""
    pytest.importorskip(name, reason=f"pip install {name}")
    images = []
    for renderer in (WARPCAM, name):
        task = CartPole(WORLDS, device=device.alias, seed=1, max_episode_length=5)
        seen = eyes(renderer, task, *SIZE)
        pixels = task.pixels(*SIZE, eyes=seen, keep_final=False)
        pixels.reset(seed=3)
        task.episode_length_buf[1] += 2  # so that its episode ends first
        for _ in range(4):
            pixels.step(torch.ones((WORLDS, 1), device=pixels.device))
        images.append(seen.images[task.camera]["rgb"].cpu().numpy().astype(int))
    ours, theirs = (blue(image) for image in images)
    for world in range(WORLDS):
        assert ours[world].sum() > 4
        overlap = (ours[world] & theirs[world]).sum() / (ours[world] | theirs[world]).sum()
        assert overlap > 0.6, world
    assert len({image.tobytes() for image in ours}) == WORLDS


def blue(images: np.ndarray) -> np.ndarray:
    """Where the cart is, (world, row, column)."""
    return images[..., 2] > images[..., 0] + 40


def test_peers_draw_colours_alone(device: wp.Device) -> None:
    with pytest.raises(WarpcamError, match="--renderers: mujoco_warp came, but the task sees depth, only warpcam is"):
        eyes("mujoco_warp", Reach(2, device=device.alias), *SIZE)


def test_runs_are_written_one_by_one_and_not_done_again(
    device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(CartPole, "length", 6)
    path = tmp_path / "training.json"
    numbers = ["--worlds", "4", "--size", "16x16", "--iterations", "2", "--device", device.alias, "--out", str(path)]
    assert training.main([*numbers, "--renderers", "warpcam", "--seeds", "0"]) == 0
    first = json.loads(path.read_text())["results"]
    assert training.main([*numbers, "--renderers", "warpcam", "mujoco_warp", "--seeds", "0", "--seconds", "0"]) == 0
    assert "mujoco_warp, seed 0: not begun" in capsys.readouterr().out
    assert training.main([*numbers, "--renderers", "warpcam", "mujoco_warp", "--seeds", "0"]) == 0
    rows = json.loads(path.read_text())["results"]
    assert rows[0] == first[0] and [row["renderer"] for row in rows] == ["warpcam", "mujoco_warp"]
    for row in rows:
        assert row["most"] == 6.0 and 0.0 < row["trained"] <= 6.0 and row["captured"] == device.is_cuda
        assert [point["steps"] for point in row["curve"]] == [64, 128]
    training_table.main([str(path), "--plot", str(tmp_path / "training.png")])
    assert (tmp_path / "training.png").stat().st_size > 0
    assert training.main([*numbers, "--seeds", "-1"]) == 2
    assert "--seeds: -1 came, 0 or more is needed" in capsys.readouterr().err


def test_speed_is_of_settled_iterations_and_medians_count_what_was_not_reached() -> None:
    times = [10.0, *(11.0 + 0.5 * index for index in range(20))]
    curve = [
        {"steps": 100 * (index + 1), "seconds": seconds, "mean_return": None if index == 0 else float(index)}
        for index, seconds in enumerate(times)
    ]
    found = training.summary(curve, most=10.0)
    assert found["steps_per_second"] == pytest.approx(200.0)
    assert found["steps_to_90"] == 1000 and found["seconds_to_90"] == times[9]
    assert training.summary(curve, most=100.0)["seconds_to_90"] is None
    rows = [{"seconds_to_90": value} for value in (3.0, None, 1.0)]
    assert training_table.median(rows, "seconds_to_90") == 3.0
    assert training_table.median([*rows, {"seconds_to_90": None}, {"seconds_to_90": None}], "seconds_to_90") is None
