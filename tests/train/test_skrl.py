"""skrl's PPO learns from images of a batched env."""

from typing import Any

import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("skrl", reason="pip install skrl")

from pixel_sliders import sliders
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.torch import SequentialTrainer, SequentialTrainerCfg
from skrl.utils.spaces.torch import unflatten_tensorized_space
from slider_env import HEIGHT, LONGEST, WIDTH

from warpcam.errors import WarpcamError
from warpcam.train import SkrlEnv


class Policy(GaussianMixin, Model):  # type: ignore[misc]
    def __init__(self, env: SkrlEnv):
        spaces = (env.observation_space, env.state_space, env.action_space)
        Model.__init__(
            self, observation_space=spaces[0], state_space=spaces[1], action_space=spaces[2], device=env.device
        )
        GaussianMixin.__init__(self)
        self.net = torch.nn.Sequential(
            torch.nn.Conv2d(2, 4, 3), torch.nn.Flatten(), torch.nn.Linear(4 * (HEIGHT - 2) * (WIDTH - 2), 1)
        )
        self.spread = torch.nn.Parameter(torch.zeros(1))

    def compute(self, inputs: dict[str, Any], role: str) -> Any:
        images = unflatten_tensorized_space(self.observation_space, inputs["observations"])
        return self.net(images), {"log_std": self.spread}


class Value(DeterministicMixin, Model):  # type: ignore[misc]
    def __init__(self, env: SkrlEnv):
        spaces = (env.observation_space, env.state_space, env.action_space)
        Model.__init__(
            self, observation_space=spaces[0], state_space=spaces[1], action_space=spaces[2], device=env.device
        )
        DeterministicMixin.__init__(self)
        self.net = torch.nn.Linear(1, 1)

    def compute(self, inputs: dict[str, Any], role: str) -> Any:
        return self.net(inputs["states"]), {}


def test_its_agent_learns(device: wp.Device) -> None:
    env = SkrlEnv(sliders(device, stack=2), "top_rgb", "state")
    assert env.observation_space.shape == (2, HEIGHT, WIDTH) and env.state_space.shape == (1,)
    models = {"policy": Policy(env), "value": Value(env)}
    models = {role: model.to(env.device) for role, model in models.items()}
    config = PPO_CFG(rollouts=8, learning_epochs=2, mini_batches=2, time_limit_bootstrap=True)
    config.experiment.write_interval = config.experiment.checkpoint_interval = 0
    agent = PPO(
        models=models,
        memory=RandomMemory(memory_size=8, num_envs=env.num_envs, device=env.device),
        observation_space=env.observation_space,
        state_space=env.state_space,
        action_space=env.action_space,
        device=env.device,
        cfg=config,
    )
    before = [weights.detach().clone() for weights in models["policy"].parameters()]
    trainer = SequentialTrainer(
        env=env,
        agents=agent,
        cfg=SequentialTrainerCfg(
            timesteps=2 * LONGEST + 2, headless=True, disable_progressbar=True, close_environment_at_exit=False
        ),
    )
    trainer.train()
    after = list(models["policy"].parameters())
    assert any(not torch.equal(one, other) for one, other in zip(before, after, strict=True))
    assert all(bool(weights.isfinite().all()) for weights in after)


def test_ends_are_columns(device: wp.Device) -> None:
    env = SkrlEnv(sliders(device), "top_rgb")
    assert env.state() is None and env.state_space is None
    observations, _ = env.reset()
    assert observations.shape == (4, HEIGHT * WIDTH)
    for step in range(1, LONGEST + 1):
        observations, rewards, terminated, truncated, _ = env.step(torch.zeros((4, 1), device=env.device))
        assert rewards.shape == terminated.shape == truncated.shape == (4, 1)
        assert not terminated.any() and bool((truncated == (step == LONGEST)).all())
    with pytest.raises(WarpcamError, match="SkrlEnv: states 'top' came, the groups are 'state', 'top_rgb'"):
        SkrlEnv(sliders(device), "top_rgb", "top")
