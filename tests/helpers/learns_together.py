"""One process of ``torchrun``: learns a little with the others, and saves what it has come to in a folder."""

import sys
from pathlib import Path

import torch

from warpcam.train import CartPole, RslRlVecEnv, ppo
from warpcam.train.ranks import Rank


def main(folder: Path) -> None:
    rank = Rank.here()
    torch.set_num_threads(1)
    task = CartPole(4, device=rank.device("cpu"), seed=rank.seed(3))
    pixels = task.pixels(16, 16)
    states = pixels.reset()["state"].clone()
    # As on a GPU: gradients of convolutions have the channel as their fastest index.
    config = ppo.settings(task.groups, ["state"], num_steps_per_env=4, seed=3, channels_last=True)
    training = ppo.Training(RslRlVecEnv(pixels), config)
    algorithm = training.runner.alg
    models = {"actor": algorithm.actor, "critic": algorithm.critic}
    before = {name: [one.clone() for one in model.parameters()] for name, model in models.items()}
    training.learn(2)
    after = {name: [one.detach() for one in model.parameters()] for name, model in models.items()}
    told = {"local": rank.local, "states": states, "before": before, "after": after}
    torch.save(told, folder / f"{rank.number}.pt")
    rank.close()


main(Path(sys.argv[1]))
