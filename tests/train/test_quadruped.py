"""Quadruped: a trot gets more than random actions, falls end episodes, and depth is measured."""

import math

import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")

from warpcam.train import Quadruped, ppo
from warpcam.train.quadruped import JOINTS, RANGE, STANDING

WORLDS = 3


class Slow(Quadruped):
    slowest = fastest = (0.5, 0.0)
    area = 1.0


class Trot:
    """Legs of one diagonal swing ahead while those of the other push, 2.5 times a second."""

    def __init__(self, task: Quadruped) -> None:
        self.step, self.shape = 0, (task.num_envs, 4, 3)

    def __call__(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        actions = torch.zeros(self.shape, device=observations["state"].device)
        for leg in range(4):
            phase = 2.0 * math.pi * 2.5 * 0.02 * self.step + (0.0 if leg in (0, 3) else math.pi)
            lift = max(0.0, math.cos(phase))
            actions[:, leg, 1] = -0.8 * math.sin(phase) + 0.5 * lift
            actions[:, leg, 2] = -lift
        self.step += 1
        return actions.reshape(-1, JOINTS).clamp(-1.0, 1.0)


def test_a_trot_goes_ahead_and_gets_more_than_random_actions(device: wp.Device) -> None:
    """An open loop, without any knowledge of the state: so a policy can learn to follow a speed."""
    task = Slow(WORLDS, device=device.alias)
    pixels, steps = task.pixels(32, 32), 100
    at_random = ppo.evaluate(pixels, ppo.random_policy(pixels), steps, seed=1)
    speeds: list[torch.Tensor] = []
    trot = ppo.evaluate(pixels, Trot(task), steps, seed=1, after=lambda: speeds.append(task._speeds()[:, 0].clone()))
    assert trot.mean_return > 2.0 * at_random.mean_return
    assert bool((torch.stack(speeds).mean(dim=0) > 0.35).all())


def test_worlds_begin_in_the_stance_on_the_hills(device: wp.Device) -> None:
    task = Quadruped(WORLDS, device=device.alias)
    state = task.reset(seed=2)[0]["state"]
    torch.testing.assert_close(state[:, -1], torch.full_like(state[:, -1], STANDING))
    assert len(state[:, 42:44].unique()) == 2 * WORLDS  # commands
    assert len(task._position[:, 2].unique()) == WORLDS  # heights of the hills
    torch.testing.assert_close(state[:, :3], torch.tensor((0.0, 0.0, 1.0), device=state.device).expand(WORLDS, 3))
    terrain = wp.to_torch(task.model.hfield_data).reshape(task._heights.shape) * float(task.host.hfield_size[0, 2])
    torch.testing.assert_close(terrain, task._heights)


def test_falls_end_episodes_alone(device: wp.Device) -> None:
    task = Quadruped(WORLDS, device=device.alias)
    task.reset(seed=2)
    turned = math.radians(80.0)
    task._position[1, 3:7] = torch.tensor((math.cos(0.5 * turned), math.sin(0.5 * turned), 0.0, 0.0))
    task._position[2, 2] -= 0.2
    assert task._ended().tolist() == [False, True, True]
    task._position[0, 2] = math.nan
    assert task._ended().tolist() == [True, True, True]


def test_rewards_are_of_the_commanded_speed_in_the_robots_own_frame(device: wp.Device) -> None:
    task = Quadruped(WORLDS, device=device.alias)
    task.reset(seed=2)
    w, z = task._position[:, 3], task._position[:, 6]
    heading = 2.0 * torch.atan2(z, w)
    command = task._command
    for axis, share in enumerate((torch.cos, torch.sin)):
        task._velocity[:, axis] = command[:, 0] * share(heading)
    task._velocity[:, 5] = command[:, 1]
    still = torch.zeros(WORLDS, JOINTS, device=heading.device)
    torch.testing.assert_close(task._reward(still), torch.ones_like(heading))
    assert bool(task._success().all())
    task._velocity[:, :2].neg_()
    assert bool((task._reward(still) < 0.9).all()) and not task._success().any()


def test_resets_forget_actions_of_their_worlds(device: wp.Device) -> None:
    task = Quadruped(WORLDS, device=device.alias)
    task.reset(seed=2)
    for _ in range(2):
        task._act(torch.ones(WORLDS, JOINTS, device=task._last.device))
    commands = task._command.clone()
    task.reset(options={"reset_mask": torch.tensor([False, True, False])})
    for actions in (task._last, task._before):
        assert actions.abs().amax(dim=1).tolist() == [1.0, 0.0, 1.0]
    assert (task._command != commands).any(dim=1).tolist() == [False, True, False]


def test_depth_is_what_a_camera_measures(device: wp.Device) -> None:
    """Noise and steps where there is ground, and nothing beyond the camera's range."""
    task = Quadruped(WORLDS, device=device.alias)
    pixels = task.pixels(32, 32)
    pixels.reset(seed=2)
    measured = RANGE * pixels.observations["front_depth"][:, 0]
    true = pixels.renderer.renderer.images["front"]["depth"][..., 0]
    assert bool((measured[true > RANGE + 0.1] == 0.0).all())
    seen = (measured > 0.0) & (true < 2.0)
    errors = (measured - true)[seen]
    assert bool(seen.sum() > 0.2 * true.numel()) and 0.001 < errors.std().item() < 0.1
