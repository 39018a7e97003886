"""Steps as CUDA graphs where there is a GPU: they do what steps part by part do."""

import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")

from warpcam.train import CartPole
from warpcam.train.captured import can_capture
from warpcam.train.starts import Starts


def test_captured_steps_are_the_same_steps(device: wp.Device) -> None:
    """Over several episodes of each world, with a reset of all worlds between two steps."""
    envs = [
        CartPole(3, device=device.alias, seed=4, max_episode_length=6).pixels(24, 16, capture=capture)
        for capture in (False, True)
    ]
    assert [env.captures for env in envs] == [False, can_capture(device)]
    actions = torch.rand((24, 3, 1), generator=torch.Generator().manual_seed(0)).mul_(2.0).sub_(1.0)
    for number, action in enumerate(actions.to(envs[0].device)):
        if number == 9:
            for env in envs:
                env.reset(seed=5)
        plain, captured = (env.step(action) for env in envs)
        assert torch.equal(plain.ended, captured.ended)
        torch.testing.assert_close(plain.rewards, captured.rewards, rtol=1e-4, atol=1e-4)
        for group, values in plain.observations.items():
            torch.testing.assert_close(values, captured.observations[group], rtol=1e-3, atol=2e-2)
            torch.testing.assert_close(
                envs[0].final[group][plain.ended], envs[1].final[group][plain.ended], rtol=1e-3, atol=2e-2
            )


def test_starts_follow_from_seed_world_and_episode_alone(device: wp.Device) -> None:
    few, many = Starts(2, 3, 7, device), Starts(5, 3, 7, device)
    all_of = {one: torch.ones(len(one.episodes), dtype=torch.bool, device=one.numbers.device) for one in (few, many)}
    first = many.draw(all_of[many]).clone()
    assert torch.equal(few.draw(all_of[few]), first[:2])
    assert bool((first >= 0.0).all() and (first < 1.0).all()) and len(first.unique()) == first.numel()
    second = many.draw(torch.tensor([True, False, True, False, False], device=first.device)).clone()
    assert torch.equal(second[1], first[1]) and torch.equal(second[3:], first[3:])
    assert not (second[0] == first[0]).any() and not (second[2] == first[2]).any()
    assert many.episodes.tolist() == [2, 1, 2, 1, 1]
    many.seed(7)
    assert torch.equal(many.draw(all_of[many]), first)
    many.seed(8)
    assert not (many.draw(all_of[many]) == first).any()
