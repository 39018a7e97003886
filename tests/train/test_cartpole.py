"""Cart-pole from pixels: the env, and a policy that learns to balance within a minute on a CPU."""

import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")

from gymnasium.vector import AutoresetMode

from warpcam.tools import cli
from warpcam.train import CartPole, SwingUp


def test_worlds_move_as_mujoco_has_it(device: wp.Device) -> None:
    env = CartPole(3, device=device.alias, seed=4)
    state, _ = env.reset(seed=2)
    hosts = []
    for row in state.cpu().numpy():
        data = mujoco.MjData(env.host)
        data.qpos[:], data.qvel[:] = row[:2], row[2:]
        hosts.append(data)
    random = np.random.default_rng(0)
    for _ in range(20):
        force = random.uniform(-1.5, 1.5, (3, 1)).astype(np.float32)
        state, rewards, fallen, late, _ = env.step(force)
        for world, data in enumerate(hosts):
            data.ctrl[:] = np.clip(force[world], -1.0, 1.0)
            mujoco.mj_step(env.host, data)
            np.testing.assert_allclose(state[world].cpu(), (*data.qpos, *data.qvel), atol=2e-3)
            assert fallen[world].item() == (abs(data.qpos[1]) > 0.6)
        assert not late.any()
    assert bool((rewards > 0.0).all() and (rewards < 1.0).all())


def test_reward_is_one_where_all_is_still_and_upright(device: wp.Device) -> None:
    env = CartPole(2, device=device.alias)
    env.reset()
    wp.to_torch(env.data.qpos).zero_()
    wp.to_torch(env.data.qvel).zero_()
    _, rewards, *_ = env.step(torch.zeros(2, 1))
    torch.testing.assert_close(rewards, torch.ones_like(rewards))
    _, rewards, *_ = env.step(torch.tensor([[1.0], [0.5]]))
    assert rewards[0] < 0.85 and rewards[0] < rewards[1] < 0.97


def test_episodes_end_by_time_and_begin_where_they_are_told_to(device: wp.Device) -> None:
    env = CartPole(3, device=device.alias, max_episode_length=4)
    assert env.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    first, _ = env.reset(seed=1)
    again, _ = env.reset(seed=1)
    assert torch.equal(first, again)
    for step in range(1, 5):
        state, _, fallen, late, _ = env.step(np.zeros((3, 1), np.float32))
        assert bool((late == (step == 4)).all()) and not fallen.any()
    mask = torch.tensor([False, True, False])
    begun, _ = env.reset(options={"reset_mask": mask})
    changed = (begun != state).any(dim=1).cpu()
    assert torch.equal(changed, mask)
    assert env.episode_length_buf.tolist() == [4, 0, 4]


def test_swing_up_begins_below_and_is_rewarded_above(device: wp.Device) -> None:
    env = SwingUp(2, device=device.alias)
    state, _ = env.reset(seed=1)
    assert bool((state[:, 1].abs() < 0.2).all() and (state[:, 2] < -0.98).all())
    still = torch.zeros(2, 1)
    _, below, fallen, *_ = env.step(still)
    wp.to_torch(env.data.qpos).zero_()
    wp.to_torch(env.data.qvel).zero_()
    state, above, *_ = env.step(still)
    assert bool((state[:, 2] > 0.99).all() and (below < 0.05).all() and (above > 0.95).all()) and not fallen.any()


@pytest.mark.usefixtures("one_thread")
def test_the_command_swings_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("imageio_ffmpeg")
    assert SwingUp.length == 400
    monkeypatch.setattr(SwingUp, "length", 40)
    command = "train swing-up --worlds 4 --size 16x16 --iterations 1 --device cpu --out"
    assert cli.main([*command.split(), str(tmp_path)]) == 0
    told = json.loads((tmp_path / "returns.json").read_text())
    assert told["most"] == 40.0 and 0.0 < told["random"] < 10.0 and 0.0 < told["trained"] < 40.0
    assert told["success"] is None and (tmp_path / "video.mp4").stat().st_size > 0
    assert ", of 40 at most" in capsys.readouterr().out


@pytest.fixture
def one_thread() -> object:
    """Torch with one thread: others wait for each other longer than they work, with images this small."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.usefixtures("one_thread")
def test_a_policy_learns_from_pixels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A short version of the command: twice the return of random actions, which is far from solved."""
    pytest.importorskip("imageio_ffmpeg")
    cv2 = pytest.importorskip("cv2")
    assert CartPole.length == 250
    monkeypatch.setattr(CartPole, "length", 100)
    command = "train cartpole --worlds 64 --size 32x32 --iterations 15 --encoder small --device cpu --seed 2 --out"
    assert cli.main([*command.split(), str(tmp_path / "run")]) == 0
    told = json.loads((tmp_path / "run" / "returns.json").read_text())
    assert told["trained"] > 2.0 * told["random"]
    assert len(told["curve"]) == 15 and told["curve"][-1]["steps"] == 15 * 16 * 64
    printed = capsys.readouterr().out
    assert f"mean return of the policy: {told['trained']:.1f}, of 100 at most" in printed
    assert (tmp_path / "run" / "model_14.pt").exists() and list((tmp_path / "run").glob("events.out.tfevents.*"))
    film = cv2.VideoCapture(str(tmp_path / "run" / "video.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == 100
    assert (film.get(cv2.CAP_PROP_FRAME_WIDTH), film.get(cv2.CAP_PROP_FRAME_HEIGHT)) == (4 * 130 - 2, 4 * 98 - 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--worlds", "0"), "--worlds: 0 came, at least 1 is needed"),
        (("--iterations", "0"), "--iterations: 0 came, at least 1 is needed"),
        (("--epochs", "0"), "--epochs: 0 came, at least 1 is needed"),
        (("--mini-batches", "0"), "--mini-batches: 0 came, at least 1 is needed"),
        (("--seed", "-1"), "--seed: -1 came, 0 or more is needed"),
        (("--size", "64"), "--size: '64' came, width x height of at least 16x16 pixels is needed"),
        (("--size", "64x8"), "--size: '64x8' came"),
    ],
)
def test_mistakes_are_named(
    arguments: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["train", "cartpole", "--device", "cpu", "--out", str(tmp_path / "run"), *arguments]) == 2
    assert f"warpcam: {message}" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_the_module_is_the_command(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "warpcam.train", "cartpole", "--worlds", "0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.endswith("warpcam: --worlds: 0 came, at least 1 is needed\n")


def test_a_folder_that_cannot_be_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    assert cli.main(["train", "cartpole", "--device", "cpu", "--out", str(tmp_path / "file" / "run")]) == 2
    assert "--out: " in capsys.readouterr().err


def test_a_missing_encoder_is_told_before_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.delitem(sys.modules, "warpcam.train.recorder", raising=False)
    assert cli.main(["train", "cartpole", "--device", "cpu", "--out", str(tmp_path / "run")]) == 2
    told = capsys.readouterr()
    assert "imageio_ffmpeg is not installed" in told.err and "mean return" not in told.out
