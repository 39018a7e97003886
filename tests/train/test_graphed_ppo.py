"""PPO without waiting: it learns what rsl_rl's learns, from bytes as from numbers, and tells what is no number."""

from pathlib import Path
from typing import Any

import pytest
import torch
import warp as wp

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")
pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")

from warpcam.errors import WarpcamError
from warpcam.train import CartPole, RslRlVecEnv, ppo
from warpcam.train.image_model import Encoder

WORLDS, STEPS, LENGTH, SIZE = 4, 8, 6, (24, 16)
ENCODER = {"output_channels": [4], "kernel_size": [3], "stride": [2], "activation": "elu"}


def training(device: wp.Device, folder: Path | None = None, colors: str = "float32", **settings: Any) -> ppo.Training:
    task = CartPole(WORLDS, device=device.alias, seed=4, max_episode_length=LENGTH)
    settings = {"num_steps_per_env": STEPS, "encoder": ENCODER, "seed": 5, **settings}
    config = ppo.settings(task.groups, ["state"], **settings)
    return ppo.Training(RslRlVecEnv(task.pixels(*SIZE, colors=colors)), config, folder)


def both(made: ppo.Training) -> torch.Tensor:
    algorithm = made.runner.alg
    models = algorithm.actor, algorithm.critic
    return torch.cat([one.detach().flatten() for model in models for one in model.state_dict().values()])


@pytest.mark.parametrize("schedule", ["adaptive", "fixed"])
def test_it_learns_what_rsl_rls_own_does(device: wp.Device, tmp_path: Path, schedule: str) -> None:
    """From the same steps: weights, means of observations, learning rate, losses and what the logger is told."""
    found = []
    strong = {"entropy_coef": 0.2, "clip_param": 0.05, "value_loss_coef": 0.5, "num_steps_per_env": 2 * LENGTH}
    for graphs in (False, True):
        made = training(device, tmp_path / str(graphs), graphs=graphs, schedule=schedule, **strong)
        algorithm, logger, losses = made.runner.alg, made.runner.logger, []
        if not graphs:
            del logger.process_env_step  # which is rsl_rl's then
        update = algorithm.update
        algorithm.update = lambda update=update, losses=losses: losses.append(update()) or losses[-1]
        made.learn(1, spread=False)
        told = [*logger.rewbuffer, *logger.lenbuffer, *losses[0].values(), algorithm.learning_rate]
        found.append((both(made), torch.tensor(told)))
    assert len(found[0][1]) == 2 * 2 * WORLDS + 4  # two episodes of each world
    for ours, theirs in zip(found[1], found[0], strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-3, atol=1e-4)


def test_a_checkpoint_goes_on_where_it_was(device: wp.Device, tmp_path: Path) -> None:
    first, second = training(device, tmp_path), training(device)
    first.learn(6, spread=False)
    assert not torch.equal(both(first), both(second))
    second.runner.load(str(tmp_path / "model_5.pt"))
    assert torch.equal(both(first), both(second))
    algorithm = second.runner.alg
    assert algorithm.learning_rate == pytest.approx(first.runner.alg.learning_rate) != 1e-3
    before = both(second)
    second.learn(6, spread=False)
    assert not torch.equal(both(second), before)
    assert algorithm.optimizer.param_groups[0]["lr"] is algorithm._rate


def test_a_spatial_softmax_tells_where_a_channel_is_bright(device: wp.Device) -> None:
    """One convolution that gives its image back: the mean place is that of the one bright pixel."""
    place = wp.device_to_torch(device)
    plain = {"output_channels": [1], "kernel_size": [1], "stride": [1], "activation": "identity"}
    encoder = Encoder(input_dim=(5, 9), input_channels=1, spatial_softmax=True, **plain).to(place)
    assert encoder.output_dim == 2 and encoder.output_channels is None
    with torch.no_grad():
        encoder[0].weight.fill_(1.0)
        encoder[0].bias.zero_()
    images = torch.zeros((3, 1, 5, 9), device=place)
    images[0, 0, 1, 6] = images[1, 0, 4, 0] = 50.0  # of the third none is
    expected = torch.tensor(((0.5, -0.5), (-1.0, 1.0), (0.0, 0.0)), device=place)
    torch.testing.assert_close(encoder(images), expected, atol=1e-5, rtol=0.0)


@pytest.mark.parametrize("channels_last", [False, True])
@pytest.mark.parametrize(("half", "error"), [(False, 1e-5), (True, 2e-2)])
def test_bytes_are_encoded_as_numbers_are(device: wp.Device, half: bool, error: float, channels_last: bool) -> None:
    place = wp.device_to_torch(device)
    images = torch.randint(0, 256, (5, 3, 16, 24), dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
    images = images.to(place)
    torch.manual_seed(1)
    plain = Encoder(input_dim=(16, 24), input_channels=3, **ENCODER).to(place)
    other = Encoder(half=half, channels_last=channels_last, input_dim=(16, 24), input_channels=3, **ENCODER).to(place)
    other.load_state_dict(plain.state_dict())
    encoded = other(images)
    assert encoded.dtype is torch.float32
    torch.testing.assert_close(encoded, plain(images / 255.0), rtol=error, atol=error)


def test_colours_are_stored_as_bytes(device: wp.Device) -> None:
    made = training(device, colors="uint8", precision="bfloat16", channels_last=True)
    made.learn(1, spread=False)
    stored = made.runner.alg.storage.observations["side_rgb"]
    assert stored.dtype is torch.uint8 and len(stored.unique()) > 3
    task = CartPole(WORLDS, device=device.alias)
    numbers, colors = (task.pixels(*SIZE, colors=colors).reset(seed=1)["side_rgb"] for colors in ("float32", "uint8"))
    torch.testing.assert_close(255.0 * numbers, colors.float(), rtol=0.0, atol=0.51)
    with pytest.raises(WarpcamError, match="CartPole: colors 'int8' came, one of uint8, float32 is needed"):
        task.pixels(*SIZE, colors="int8")


def test_what_is_no_number_is_told(device: wp.Device) -> None:
    made = training(device)
    reward = made._env.env.unwrapped._reward
    made._env.env.unwrapped._reward = lambda actions: reward(actions) + float("nan")
    with pytest.raises(WarpcamError, match=r"the losses are no finite numbers \(value nan, .*: look for such in"):
        made.learn(1, spread=False)


def test_what_it_does_not_do_is_told(device: wp.Device) -> None:
    for options, message in (
        ({"optimizer": "sgd"}, "GraphedPPO: optimizer 'sgd' came, only 'adam' is possible; use PPO"),
        ({"use_mixed_precision": True}, "GraphedPPO: use_mixed_precision came, give the models half=True instead"),
    ):
        with pytest.raises(WarpcamError, match=message):
            training(device, **options)
    with pytest.raises(WarpcamError, match="settings: precision 'half' came, one of float32, tf32, bfloat16 is needed"):
        ppo.settings(["side_rgb"], ["state"], precision="half")
