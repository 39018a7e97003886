"""Command-line options of training. Imports nothing that has to be installed beside warpcam."""

import argparse
from pathlib import Path

ABOUT = "train a policy from pixels with rsl_rl; write TensorBoard logs, checkpoints, returns and a video"
TASKS = ("cartpole",)
CRITICS = ("state", "pixels")


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = ABOUT
    parser.add_argument("task", choices=TASKS, help="cartpole: balance a pole on a cart")
    parser.add_argument("--worlds", type=int, default=1024, metavar="N", help="default: %(default)s")
    parser.add_argument("--size", default="64x64", metavar="WxH", help="of one image (default: %(default)s)")
    parser.add_argument("--iterations", type=int, default=200, metavar="N", help="of PPO (default: %(default)s)")
    parser.add_argument("--device", metavar="D", help="cpu, cuda:0, ... (default: the first GPU, or the CPU)")
    parser.add_argument("--seed", type=int, default=0, help="of states, weights and actions (default: %(default)s)")
    parser.add_argument(
        "--critic",
        choices=CRITICS,
        default="state",
        help="what the critic sees in training; the policy always sees pixels alone (default: %(default)s)",
    )
    parser.add_argument("--out", type=Path, default=Path("warpcam-train"), metavar="DIR", help="default: %(default)s")
