"""Batched envs of images: what an observation is of, and what is left of an episode that has ended."""

import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[gymnasium]'")

from gymnasium.vector import AutoresetMode
from pixel_sliders import sliders
from slider_env import END, HEIGHT, LONGEST, WIDTH, Sliders, renderer_of

from warpcam.errors import WarpcamError
from warpcam.train import Crop, ImageTransform, PixelEnv


def place_in(image: torch.Tensor) -> torch.Tensor:
    """Place of the ball [m], (world,), by the depth of its upper side."""
    near = image[:, -1] < image[:, -1].amin((1, 2), keepdim=True) + 0.1
    columns = torch.arange(WIDTH, device=image.device) + 0.5 - 0.5 * WIDTH
    mean = (near * columns).sum((1, 2)) / near.sum((1, 2))
    return mean / HEIGHT * 2.0 * torch.tan(torch.deg2rad(torch.tensor(30.0))).item() * 3.6


@pytest.mark.parametrize("live", [True, False])
def test_images_and_states_are_of_one_moment(device: wp.Device, live: bool) -> None:
    """Also in the last observation of an episode, whatever the end, and if states are the env's own memory."""
    env, ends = sliders(device, live=live), {"terminated": 0, "truncated": 0}
    observations = env.reset(seed=3)
    assert observations["top_rgb"].shape == (4, 1, HEIGHT, WIDTH)
    random = torch.Generator().manual_seed(0)
    for _ in range(30):
        torch.testing.assert_close(
            place_in(observations["top_depth"]), observations["state"][:, 0], atol=0.35, rtol=0.0
        )
        step = env.step((2.0 * torch.rand((4, 1), generator=random) - 1.0).to(env.device))
        torch.testing.assert_close(
            place_in(env.final["top_depth"])[step.ended], env.final["state"][step.ended, 0], atol=0.35, rtol=0.0
        )
        assert bool((env.final["state"][step.terminated].abs() > END).all())
        assert bool((step.observations["state"].abs() <= END).all())
        ends["terminated"] += int(step.terminated.sum())
        ends["truncated"] += int(step.truncated.sum())
        observations = step.observations
    assert min(ends.values()) > 0


def test_stacks_of_new_episodes_have_no_frame_of_the_last(device: wp.Device) -> None:
    env = sliders(device, stack=3)
    env.reset(seed=1)
    for _ in range(LONGEST):
        before = env.observations["top_rgb"].clone()
        step = env.step(torch.ones((4, 1), device=env.device))
        now = step.observations["top_rgb"]
        for world in range(4):
            if step.ended[world]:
                assert torch.equal(env.final["top_rgb"][world, :2], before[world, 1:])
                assert torch.equal(now[world, 0], now[world, 2]) and torch.equal(now[world, 1], now[world, 2])
            else:
                assert torch.equal(now[world, :2], before[world, 1:])


@pytest.mark.parametrize("stack", [1, 3])
def test_without_last_observations_a_step_draws_once(device: wp.Device, stack: int) -> None:
    """What is observed is the same, over ends of episodes."""
    envs = [sliders(device, stack=stack, keep_final=keeps) for keeps in (True, False)]
    for env in envs:
        env.reset(seed=1)
    plain, once = envs
    assert once.final == {}
    actions, ended = torch.ones((4, 1), device=plain.device), 0
    for _ in range(2 * LONGEST):
        drawn = once.renderer.frames.clone()
        expected, step = plain.step(actions), once.step(actions)
        assert bool((once.renderer.frames == drawn + 1).all())
        for key, value in expected.observations.items():
            assert torch.equal(value, step.observations[key]), key
        for name in ("rewards", "terminated", "truncated"):
            assert torch.equal(getattr(expected, name), getattr(step, name)), name
        ended += int(step.ended.sum())
    assert ended > 4


def test_an_observation_stays_until_the_step_after_next(device: wp.Device) -> None:
    env = sliders(device)
    env.reset(seed=1)
    for _ in range(2 * LONGEST):
        held = env.observations
        copies = {key: value.clone() for key, value in held.items()}
        env.step(torch.ones((4, 1), device=env.device))
        assert all(torch.equal(value, copies[key]) for key, value in held.items())


def test_mistakes_are_named(device: wp.Device) -> None:
    env = Sliders(2, AutoresetMode.NEXT_STEP, device)
    with pytest.raises(WarpcamError, match=r"PixelEnv: env has the mode .*NEXT_STEP.*, .*DISABLED.* is needed"):
        PixelEnv(env, renderer_of(env))
    env = Sliders(2, AutoresetMode.DISABLED, device)
    transforms = {"top": ImageTransform((Crop(0, 0, 2, 2),))}
    with pytest.raises(WarpcamError, match="PixelEnv: transforms has 'top', the groups are 'top_rgb', 'top_depth'"):
        PixelEnv(env, renderer_of(env), transforms=transforms)
    with pytest.raises(WarpcamError, match=r"PixelObservation: env must be a gymnasium.vector.VectorEnv, got int"):
        PixelEnv(3, renderer_of(env))  # type: ignore[arg-type]
