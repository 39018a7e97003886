"""Stable-Baselines3's PPO learns from images of a batched env, and is told how episodes ended."""

import numpy as np
import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("stable_baselines3", reason="pip install stable-baselines3")

from gymnasium.vector import AutoresetMode
from pixel_sliders import sliders
from slider_env import END, LONGEST, Sliders, renderer_of
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecFrameStack, VecMonitor

from warpcam.errors import WarpcamError
from warpcam.train import ImageTransform, PixelEnv, Resize, StableBaselines3VecEnv


def uint8_env(device: wp.Device) -> PixelEnv:
    env = Sliders(4, AutoresetMode.DISABLED, device, tensors=True)
    transforms = {"top_rgb": ImageTransform((Resize(36, 40),))}
    return PixelEnv(env, renderer_of(env, ("rgb",)), transforms=transforms, state="state", forward=True)


@pytest.mark.parametrize("groups", [("top_rgb",), ("top_rgb", "state")])
def test_its_agent_learns(device: wp.Device, groups: tuple[str, ...]) -> None:
    env = StableBaselines3VecEnv(uint8_env(device), groups)
    single = len(groups) == 1
    space = env.observation_space if single else env.observation_space["top_rgb"]
    assert space.shape == (36, 40, 3) and space.dtype == np.uint8
    wrapped = VecMonitor(VecFrameStack(env, 2) if single else env)
    kinds = ("CnnPolicy", {"features_extractor_kwargs": {"features_dim": 8}}) if single else ("MultiInputPolicy", None)
    agent = PPO(
        kinds[0], wrapped, n_steps=LONGEST + 1, batch_size=16, n_epochs=1, device="cpu", policy_kwargs=kinds[1], seed=0
    )
    agent.learn(2 * 4 * (LONGEST + 1))
    assert agent.num_timesteps == 2 * 4 * (LONGEST + 1) and len(agent.ep_info_buffer) >= 8
    assert all(bool(torch.isfinite(weights).all()) for weights in agent.policy.parameters())


def test_last_observations_and_limits_of_time(device: wp.Device) -> None:
    env = StableBaselines3VecEnv(uint8_env(device), ("state", "top_rgb"))
    env.seed(3)
    first = env.reset()
    assert first["top_rgb"].dtype == np.uint8 and first["top_rgb"].shape == (4, 36, 40, 3)
    for step in range(1, LONGEST + 1):
        _, rewards, ended, infos = env.step(np.zeros((4, 1), np.float32))
        assert rewards.dtype == np.float32 and ended.dtype == bool
        assert ended.all() == (step == LONGEST)
    for world, info in enumerate(infos):
        assert info["TimeLimit.truncated"]
        np.testing.assert_array_equal(info["terminal_observation"]["state"], first["state"][world])
        np.testing.assert_array_equal(info["terminal_observation"]["top_rgb"], first["top_rgb"][world])
    for _ in range(LONGEST - 1):
        now, _, ended, infos = env.step(np.ones((4, 1), np.float32))
        for world in np.flatnonzero(ended):
            assert not infos[world]["TimeLimit.truncated"]
            assert infos[world]["terminal_observation"]["state"][0] > END >= now["state"][world, 0]
    env.seed(3)
    np.testing.assert_array_equal(env.reset()["top_rgb"], first["top_rgb"])


def test_what_was_given_stays(device: wp.Device) -> None:
    """Buffers of the library keep arrays of earlier steps."""
    env = StableBaselines3VecEnv(uint8_env(device), ("top_rgb",))
    held = env.reset()
    before = held.copy()
    for _ in range(4):
        env.step(np.ones((4, 1), np.float32))
    np.testing.assert_array_equal(held, before)


def test_attributes_and_mistakes(device: wp.Device) -> None:
    env = StableBaselines3VecEnv(uint8_env(device), ("top_rgb",))
    assert env.get_attr("live", [0, 2]) == [False, False]
    env.set_attr("live", True)
    assert env.get_attr("live") == [True] * 4
    assert env.env_is_wrapped(VecMonitor) == [False] * 4
    with pytest.raises(WarpcamError, match=r"set_attr: indices \[1\] came, all worlds share one env"):
        env.set_attr("live", False, [1])
    with pytest.raises(WarpcamError, match=r"images must be uint8, 'top_rgb' is torch\.float32"):
        StableBaselines3VecEnv(sliders(device))
    with pytest.raises(WarpcamError, match="groups has 'top', there are 'state', 'top_rgb'"):
        StableBaselines3VecEnv(uint8_env(device), ("top",))
