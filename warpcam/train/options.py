"""Command-line options of training. Imports nothing that has to be installed beside warpcam."""

import argparse
from pathlib import Path

ABOUT = "train a policy from pixels with rsl_rl; write TensorBoard logs, checkpoints, returns and a video"
TASKS = {
    "cartpole": "balance a pole on a cart",
    "swing-up": "swing it up first",
    "reach": "bring an arm's tool to a sphere that its wrist camera sees",
    "pick": "grasp a cube and lift it, in worlds that look different",
    "quadruped": "follow a speed over hills on four legs",
}
CRITICS = ("state", "pixels")
COLORS = ("uint8", "float32")
PRECISIONS = ("float32", "tf32", "bfloat16")
ENCODERS = {  # of ``ppo.settings``; None is the task's own
    "task": None,
    "small": {"output_channels": [16, 32], "kernel_size": [8, 4], "stride": [4, 2], "activation": "elu"},
    "places": {
        "output_channels": [16, 32],
        "kernel_size": [5, 3],
        "stride": [2, 2],
        "activation": "elu",
        "spatial_softmax": True,
    },
}
PROFILED = 10  # iterations of a profile


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = ABOUT
    about = "; ".join(f"{name}: {text}" for name, text in TASKS.items())
    parser.add_argument("task", choices=tuple(TASKS), metavar="TASK", help=about)
    parser.add_argument(
        "--worlds", type=int, default=1024, metavar="N", help="of each process of torchrun (default: %(default)s)"
    )
    parser.add_argument("--size", default="64x64", metavar="WxH", help="of one image (default: %(default)s)")
    parser.add_argument(
        "--iterations", type=int, metavar="N", help=f"of PPO (default: the task's own; {PROFILED} with --profile)"
    )
    parser.add_argument("--device", metavar="D", help="cpu, cuda:0, ... (default: the first GPU, or the CPU)")
    parser.add_argument("--seed", type=int, default=0, help="of states, weights and actions (default: %(default)s)")
    parser.add_argument(
        "--critic",
        choices=CRITICS,
        default="state",
        help="what the critic sees in training; the policy always sees pixels (default: %(default)s)",
    )
    parser.add_argument(
        "--profile", action="store_true", help="measure where the time of training goes, and write profile.json alone"
    )
    add_learning(parser)
    parser.add_argument("--out", type=Path, default=Path("warpcam-train"), metavar="DIR", help="default: %(default)s")


def add_learning(parser: argparse.ArgumentParser) -> None:
    """Add options of how images are stored and learned from."""
    parser.add_argument(
        "--colors",
        choices=COLORS,
        default="uint8",
        help="how colours are stored; depth is float32 (default: %(default)s)",
    )
    parser.add_argument(
        "--precision",
        choices=PRECISIONS,
        help="of learning's arithmetic (default: bfloat16 for convolutions on a GPU, float32 on the CPU)",
    )
    parser.add_argument(
        "--channels-last",
        action=argparse.BooleanOptionalAction,
        help="order of convolutions in memory (default: on with a GPU)",
    )
    parser.add_argument(
        "--graphs",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="step, act and learn as CUDA graphs on a GPU (default: on)",
    )
    parser.add_argument(
        "--encoder",
        choices=tuple(ENCODERS),
        default="task",
        help="convolutions of images: the task's own, small with strides of 4 and 2, or places by spatial softmax "
        "(default: %(default)s)",
    )
    parser.add_argument("--epochs", type=int, metavar="N", help="of learning from a stretch (default: the task's own)")
    parser.add_argument("--mini-batches", type=int, metavar="N", help="of each epoch (default: the task's own)")
