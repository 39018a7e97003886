"""Pick: an expert that knows the cube's place lifts it, random actions do not, and each episode has another look."""

import numpy as np
import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")

from warpcam.train import Pick, ppo
from warpcam.train.arm import JOINTS
from warpcam.train.pick import HALF, OPEN

WORLDS, STEPS = 3, 45


def expert(observations: dict[str, torch.Tensor]) -> torch.Tensor:
    """Move above the cube, then down, close the fingers, and lift."""
    state = observations["state"]
    opening, away, height = state[:, 6:8].sum(dim=1) * OPEN, state[:, 8:11], state[:, 11]
    here, closed = away.norm(dim=1) < 0.5 * HALF, opening < 2.3 * HALF
    way = away.clone()
    way[:, 2] += 0.1 * (away[:, :2].norm(dim=1) > 0.01)
    way -= state[:, 3:6]  # that the arm has still before it
    lifts = (here & closed) | (height > 0.5 * HALF)
    way[lifts] = torch.tensor((0.0, 0.0, 0.5 * Pick.speed), device=way.device)
    grip = torch.where(here | closed, -1.0, 1.0)
    return torch.cat((way / Pick.speed, grip[:, None]), dim=1).clamp(-1.0, 1.0)


def test_an_expert_lifts_the_cube(device: wp.Device) -> None:
    task = Pick(WORLDS, device=device.alias)
    pixels = task.pixels(32, 32)
    at_random = ppo.evaluate(pixels, ppo.random_policy(pixels), STEPS, seed=1)
    found = ppo.evaluate(pixels, expert, STEPS, seed=1)
    assert found.success == 1.0 and at_random.success == 0.0
    assert found.mean_return > 0.4 * STEPS > 0.15 * STEPS > at_random.mean_return


def test_joints_follow_the_tools_target_in_closed_form(device: wp.Device) -> None:
    """At the corners of where the tool may be it is there, points down, and has its fingers along y."""
    task = Pick(8, device=device.alias, looks=False)
    task.reset(seed=1)
    bounds = torch.stack((task._lowest, task._highest), dim=1)
    corners = torch.cartesian_prod(*bounds)
    task._target.copy_(corners)
    task._command(task._all[:, None])
    task._position[:, -JOINTS - 2 : -2] = task._control[:, :JOINTS]
    task._place()
    torch.testing.assert_close(task._tool, corners, atol=1e-4, rtol=0.0)
    axes = wp.to_torch(task.data.site_xmat)[:, task.host.site("tool").id]
    down = torch.tensor((-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0), device=axes.device).reshape(3, 3)
    torch.testing.assert_close(axes, down.expand(8, 3, 3), atol=1e-4, rtol=0.0)


def test_rewards_grow_by_stages(device: wp.Device) -> None:
    task = Pick(5, device=device.alias)
    task.reset(seed=1)
    away = torch.tensor((0.2, 0.01, 0.0, 0.0, 0.0), device=task._tool.device)
    height = torch.tensor((0.0, 0.0, 0.0, 0.06, 0.12), device=away.device)
    task._cube.copy_(task._tool)
    task._cube[:, 2] = HALF + height
    task._tool.copy_(task._cube)
    task._tool[:, 0] += away
    task._fingers[2:] = HALF
    still = torch.zeros(5, 4, device=away.device)
    rewards = task._reward(still)
    assert bool((rewards[1:] > rewards[:-1] + 0.05).all())
    assert rewards[4].item() == pytest.approx(1.0, abs=1e-4)
    assert task._success().tolist() == [False] * 4 + [True] and not task._ended().any()
    torch.testing.assert_close(task._reward(still + 1.0), 0.9 * rewards)
    task._cube[0, 2] = -0.1
    task._cube[1, 2] = float("nan")
    assert task._ended().tolist() == [True, True, False, False, False]


def test_each_episode_has_another_look(device: wp.Device) -> None:
    """Colours, lights and the camera follow from the seed, and change where an episode begins alone."""
    task = Pick(WORLDS, device=device.alias)
    pixels = task.pixels(32, 32)
    names = ("shape_colors", "light_directions", "light_diffuse", "headlight")

    def looks() -> list[np.ndarray]:
        drawn = [task.scene.vary(name) for name in names] + [task._eye.position, task._eye.rotation]
        return [one.reshape(WORLDS, -1).cpu().numpy().copy() for one in drawn]

    pixels.reset(seed=3)
    first = looks()
    for one in first:
        assert len(np.unique(one, axis=0)) == WORLDS
    task.reset(options={"reset_mask": torch.tensor([False, True, False])})
    for one, other in zip(first, looks(), strict=True):
        assert ((one != other).any(axis=1) == [False, True, False]).all()
    image = pixels.reset(seed=3)["front_rgb"].clone()
    for one, other in zip(first, looks(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert torch.equal(image, Pick(WORLDS, device=device.alias).pixels(32, 32).reset(seed=3)["front_rgb"])
    cube = task.scene.vary("shape_colors")[:, task.host.geom("cube").id]
    assert bool((cube[:, 0] > cube[:, 1:3].amax(dim=1) + 0.15).all())


def test_looks_may_stay(device: wp.Device) -> None:
    task = Pick(WORLDS, device=device.alias, looks=False)
    task.pixels(32, 32).reset(seed=3)
    assert len(task.scene.vary("shape_colors").unique(dim=0)) == 1


def test_looks_are_drawn_within_captured_steps(device: wp.Device) -> None:
    """Over ends of episodes, as they are without a graph."""
    drawn = []
    for capture in (False, True):
        task = Pick(WORLDS, device=device.alias, max_episode_length=4)
        pixels = task.pixels(32, 32, capture=capture)
        pixels.reset(seed=3)
        first = task.scene.vary("shape_colors").clone()
        for _ in range(10):
            pixels.step(torch.zeros(WORLDS, 4, device=first.device))
        colors = task.scene.vary("shape_colors").clone()
        assert bool((colors != first).flatten(1).any(dim=1).all())
        drawn.append((colors, task.scene.vary("light_directions").clone(), task._eye.position.clone()))
    assert all(map(torch.equal, *drawn))
