"""Tasks of the command line: what policies see, rewards, episodes, and settings that fit."""

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")

from warpcam.train import MujocoTask, RslRlVecEnv, ppo
from warpcam.train.options import TASKS as TOLD
from warpcam.train.tasks import TASKS

WORLDS, LENGTH, SIZE = 3, 6, (32, 32)
# Threads of a GPU append contacts in the order in which they come. Sums over the rows of constraints differ in their
# last digits then, and after a first step accelerations differ by up to 3e-4, velocities by 1e-6.
ORDER = 5e-3


def test_the_command_line_tells_of_each_task() -> None:
    assert tuple(TASKS) == tuple(TOLD)


@pytest.mark.parametrize("name", TASKS)
def test_random_policies_run_over_ends_of_episodes(device: wp.Device, name: str) -> None:
    """Each world begins anew when its time is up, with another state, and images and numbers are of that state."""
    kind = TASKS[name]
    task = kind(WORLDS, device=device.alias, seed=1, max_episode_length=LENGTH)
    pixels = task.pixels(*SIZE)
    config = ppo.settings(task.groups, ["state"], **kind.ppo)
    model = ppo.Training(RslRlVecEnv(pixels), config).policy()
    act, begun = ppo.random_policy(pixels, seed=2), []
    observations = pixels.reset(seed=3)
    for number in range(1, 2 * LENGTH + 1):
        if number % LENGTH == 1:
            begun.append({key: value.clone() for key, value in observations.items()})
        _require_sound(task, observations)
        assert model(observations).shape == (WORLDS, kind.num_actions)
        step = pixels.step(act(observations))
        assert bool((step.rewards >= 0.0).all() and (step.rewards <= kind.most).all())
        late = number % LENGTH == 0
        assert bool((step.truncated == late).all()) and not step.terminated.any()
        observations = step.observations
    for key, first in begun[0].items():
        for world in range(WORLDS):
            assert not torch.equal(first[world], begun[1][key][world]), (key, world)
            assert not torch.equal(first[world], first[world - 1]), (key, world)


def _require_sound(task: MujocoTask, observations: dict[str, torch.Tensor]) -> None:
    assert set(observations) == {*task.groups, "state"}
    assert observations["state"].shape == (WORLDS, task.num_states)
    assert observations[task.image].shape[2:] == SIZE
    assert all(bool(values.isfinite().all()) for values in observations.values())
    assert bool((observations[task.image] >= 0.0).all() and (observations[task.image] <= 1.0).all())


@pytest.mark.parametrize("name", TASKS)
def test_a_mask_resets_its_worlds_alone(device: wp.Device, name: str) -> None:
    task = TASKS[name](WORLDS, device=device.alias, seed=1)
    first = _first_step(task)
    task.step(torch.ones(WORLDS, task.num_actions))
    before = [_own(task, world) for world in range(WORLDS)]
    task.reset(options={"reset_mask": torch.tensor([False, True, False])})
    after = [_own(task, world) for world in range(WORLDS)]
    assert torch.equal(after[0], before[0]) and torch.equal(after[2], before[2])
    assert not torch.equal(after[1], before[1]) and task.episode_length_buf.tolist() == [2, 0, 2]
    for again, expected in zip(_first_step(task), first, strict=True):
        if device.is_cuda:
            torch.testing.assert_close(again, expected, rtol=0.0, atol=ORDER)
        else:
            assert torch.equal(again, expected)


@pytest.mark.parametrize("name", ["pick", "quadruped"])
def test_the_order_of_contacts_changes_last_digits_alone(name: str) -> None:
    """What a GPU does from one run to the next: the first step from the same state, with its contacts shuffled."""
    task, random = TASKS[name](WORLDS, device="cpu", seed=1), np.random.default_rng(0)
    first = _first_step(task)
    if not hasattr(task.model, "callback"):
        pytest.skip("this MuJoCo-Warp calls nothing after the search for contacts")

    def shuffle(model: Any, data: Any) -> None:
        count = int(data.nacon.numpy()[0])
        order = random.permutation(count)
        for array in vars(data.contact).values():
            if isinstance(array, wp.array) and array.size:
                rows = array.numpy()
                rows[:count] = rows[order]
                array.assign(rows)

    task.model.callback.contactfilter = shuffle
    shuffled = _first_step(task)
    assert not all(map(torch.equal, shuffled, first))
    for again, expected in zip(shuffled, first, strict=True):
        torch.testing.assert_close(again, expected, rtol=0.0, atol=ORDER)


def _first_step(task: MujocoTask) -> list[torch.Tensor]:
    task.reset(seed=5)
    task.step(torch.zeros(WORLDS, task.num_actions))
    return [_own(task, world) for world in range(WORLDS)]


def _own(task: MujocoTask, world: int) -> torch.Tensor:
    """What a world has that an episode changes."""
    data = task.data
    arrays = (data.qpos, data.qvel, data.ctrl, data.qacc_warmstart, data.mocap_pos, data.xpos, data.time)
    return torch.cat([wp.to_torch(array)[world].flatten() for array in arrays])
