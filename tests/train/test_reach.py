"""Reach: an expert that knows the sphere's place comes to it, and random actions do not."""

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")

from warpcam.train import Reach, ppo
from warpcam.train.arm import JOINTS
from warpcam.train.reach import FAR, NEAR

WORLDS, STEPS = 4, 40


class Expert:
    """Steps of damped least squares towards the sphere, with MuJoCo's Jacobian of the tool."""

    def __init__(self, task: Reach) -> None:
        self.task, self.data = task, mujoco.MjData(task.host)

    def __call__(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        states = observations["state"].cpu().numpy().astype(float)
        host, data, jacobian = self.task.host, self.data, np.zeros((3, self.task.host.nv))
        actions = []
        for state in states:
            data.qpos[:] = state[:JOINTS] + self.task._home.cpu().numpy()
            mujoco.mj_kinematics(host, data)
            mujoco.mj_comPos(host, data)
            tool = host.site("tool").id
            np.testing.assert_allclose(data.site_xpos[tool], state[2 * JOINTS : 2 * JOINTS + 3], atol=1e-4)
            mujoco.mj_jacSite(host, data, jacobian, None, tool)
            damped = jacobian @ jacobian.T + 1e-3 * np.eye(3)
            actions.append(jacobian.T @ np.linalg.solve(damped, 0.5 * state[-3:]) / self.task.speed)
        return torch.tensor(np.array(actions), dtype=torch.float32, device=observations["state"].device).clamp(-1, 1)


def test_an_expert_gets_more_than_random_actions(device: wp.Device) -> None:
    task = Reach(WORLDS, device=device.alias)
    pixels = task.pixels(32, 32)
    at_random = ppo.evaluate(pixels, ppo.random_policy(pixels), STEPS, seed=1)
    expert = ppo.evaluate(pixels, Expert(task), STEPS, seed=1)
    assert expert.success == 1.0 and at_random.success is not None and at_random.success < 0.5
    assert expert.mean_return > 0.7 * STEPS > 0.2 * STEPS > at_random.mean_return


def test_the_wrist_sees_the_sphere_where_it_is(device: wp.Device) -> None:
    """The sphere comes nearer in the image as it is put nearer to the camera, along the tool."""
    task = Reach(WORLDS, device=device.alias)
    task.spread = 0.0
    pixels = task.pixels(32, 32)
    task.reset(seed=1)
    camera = wp.to_torch(task.data.cam_xpos)[:, task.host.camera("wrist").id]
    forward = -wp.to_torch(task.data.cam_xmat)[:, task.host.camera("wrist").id, :, 2]
    far = torch.tensor((0.2, 0.3, 0.4, 0.5), device=camera.device)[:, None]
    task._target.copy_(camera + far * forward)
    step = pixels.step(torch.zeros(WORLDS, JOINTS, device=camera.device))
    seen = NEAR + (FAR - NEAR) * step.observations["wrist_depth"][:, 0, 15:17, 15:17].amin((1, 2))
    torch.testing.assert_close(seen, far[:, 0] - task.radius, atol=0.01, rtol=0.0)


def test_rewards_grow_towards_the_sphere(device: wp.Device) -> None:
    task = Reach(WORLDS, device=device.alias)
    task.reset(seed=1)
    _, still, *_ = task.step(torch.zeros(WORLDS, JOINTS))
    shift = torch.tensor((0.0, 0.02, 0.1, 0.4), device=still.device)
    task._target.copy_(task._tool)
    task._target[:, 2].add_(shift)
    rewards = task._reward(torch.zeros(WORLDS, JOINTS, device=still.device))
    assert rewards[0].item() == pytest.approx(1.0, abs=1e-3) and bool((rewards[1:] < rewards[:-1]).all())
    assert task._success().tolist() == [True, True, False, False]
    hasty = task._reward(torch.ones(WORLDS, JOINTS, device=still.device))
    torch.testing.assert_close(hasty, 0.8 * rewards)
