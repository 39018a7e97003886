"""TorchRL's checker and rollouts of a batched env of images."""

import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("torchrl", reason="pip install torchrl")

from pixel_sliders import sliders
from slider_env import END, LONGEST
from torchrl.envs.utils import check_env_specs

from warpcam.errors import WarpcamError
from warpcam.train import TorchRLEnv


def test_its_checker_agrees(device: wp.Device) -> None:
    check_env_specs(TorchRLEnv(sliders(device, stack=2)), seed=0)


def test_rollouts_have_first_and_last_observations(device: wp.Device) -> None:
    env = TorchRLEnv(sliders(device))
    env.set_seed(5)
    torch.manual_seed(0)
    found = env.rollout(4 * LONGEST, break_when_any_done=False)
    ended, last, state = (found["next"][key][..., 0] for key in ("done", "state", "state"))
    begun = found["state"][..., 0]
    assert bool(ended.any())
    assert bool((last[found["next"]["terminated"][..., 0]].abs() > END).all())
    assert bool((begun.abs() <= END).all())
    same = begun[:, 1:] == state[:, :-1]
    assert torch.equal(same, ~ended[:, :-1])
    images, later = found["top_rgb"][:, 1:], found["next"]["top_rgb"][:, :-1]
    assert torch.equal((images == later).flatten(2).all(2) | ended[:, :-1], torch.ones_like(same))
    again = TorchRLEnv(sliders(device))
    again.set_seed(5)
    torch.manual_seed(0)
    assert torch.equal(again.rollout(4 * LONGEST, break_when_any_done=False)["top_rgb"], found["top_rgb"])


def test_worlds_in_the_middle_are_not_reset_alone(device: wp.Device) -> None:
    env = TorchRLEnv(sliders(device))
    begun = env.reset()
    begun["_reset"] = torch.tensor([[True], [False], [False], [False]], device=begun.device)
    with pytest.raises(WarpcamError, match="TorchRLEnv: worlds in the middle of an episode are to be reset"):
        env.reset(begun)
