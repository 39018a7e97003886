"""rsl_rl's runner learns from images of a batched env, and is told what it asks for."""

from pathlib import Path

import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")

from pixel_sliders import sliders
from slider_env import HEIGHT, LONGEST, WIDTH

from warpcam.errors import WarpcamError
from warpcam.train import RslRlVecEnv, ppo


@pytest.mark.parametrize("critic", ["state", "top_depth"])
def test_the_runner_learns(device: wp.Device, tmp_path: Path, critic: str) -> None:
    env = sliders(device, stack=2)
    config = ppo.settings(["top_rgb", "top_depth"], [critic], images=critic != "state", num_steps_per_env=4)
    convolutions = {"output_channels": [4], "kernel_size": [3], "stride": [2]}
    for model in ("actor", "critic") if critic != "state" else ("actor",):
        config[model] = {**config[model], "cnn_cfg": convolutions}
    told = []
    training = ppo.Training(
        RslRlVecEnv(env, LONGEST), config, tmp_path, lambda iteration, *found: told.append(iteration)
    )
    model = training.runner.alg.get_policy()
    assert dict(zip(model.obs_groups_2d, model.obs_channels_2d, strict=True)) == {"top_rgb": 2, "top_depth": 1}
    before = [weights.detach().clone() for weights in model.parameters()]
    with pytest.raises(WarpcamError, match="the env has no episode_length_buf to set"):
        training.learn(2)
    training.learn(2, spread=False)
    assert told == [0, 1]
    after = list(model.parameters())
    assert any(not torch.equal(one, other) for one, other in zip(before, after, strict=True))
    assert all(bool(weights.isfinite().all()) for weights in after)
    assert (tmp_path / "model_1.pt").exists() and list(tmp_path.glob("events.out.tfevents.*"))
    assert "Learning iteration 1/2" in (tmp_path / "rsl_rl.log").read_text()


def test_the_runner_stores_each_observation_with_its_action(device: wp.Device) -> None:
    """rsl_rl keeps an observation by reference while the env steps."""
    env = sliders(device)
    config = ppo.settings(["top_rgb"], ["state"], num_steps_per_env=6)
    config["actor"]["cnn_cfg"] = {"output_channels": [4], "kernel_size": [3]}
    algorithm = ppo.Training(RslRlVecEnv(env, LONGEST), config).runner.alg
    adapted, seen = RslRlVecEnv(env, LONGEST), []
    with torch.inference_mode():
        observations = adapted.get_observations()
        for _ in range(6):
            seen.append(observations.clone())
            observations, rewards, dones, extras = adapted.step(algorithm.act(observations))
            algorithm.process_env_step(observations, rewards, dones, extras)
    for step, observation in enumerate(seen):
        for group in ("top_rgb", "state"):
            assert torch.equal(algorithm.storage.observations[step][group], observation[group])


def test_limits_of_time_are_told_from_other_ends(device: wp.Device) -> None:
    adapted = RslRlVecEnv(sliders(device), LONGEST)
    assert (adapted.num_envs, adapted.num_actions, adapted.max_episode_length) == (4, 1, LONGEST)
    observations, _ = adapted.reset()
    assert observations["top_rgb"].shape == (4, 1, HEIGHT, WIDTH) and observations.batch_size == (4,)
    still = torch.zeros((4, 1), device=adapted.device)
    for step in range(1, LONGEST + 1):
        _, rewards, dones, extras = adapted.step(still)
        late = step == LONGEST
        assert rewards.dtype is torch.float32 and dones.dtype is torch.long
        assert bool((dones == late).all()) and bool((extras["time_outs"] == late).all())
        assert bool((adapted.episode_length_buf == step % LONGEST).all())
    seen = torch.zeros(4, dtype=torch.bool, device=adapted.device)
    for _ in range(LONGEST - 1):
        _, _, dones, extras = adapted.step(still + 1.0)
        seen |= dones.bool()
        assert not bool(extras["time_outs"].any())
    assert bool(seen.all())


def test_mistakes_are_named(device: wp.Device) -> None:
    env = sliders(device)
    with pytest.raises(WarpcamError, match="RslRlVecEnv: max_episode_length is needed, the env has none of its own"):
        RslRlVecEnv(env)
    with pytest.raises(WarpcamError, match="RslRlVecEnv: env must be a PixelEnv, got Sliders"):
        RslRlVecEnv(env.unwrapped)  # type: ignore[arg-type]
