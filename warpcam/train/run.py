"""The command ``warpcam train``, which is ``python -m warpcam.train``, too."""

import argparse
import importlib
import json
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

import warpcam
from warpcam.core.errors import WarpcamError
from warpcam.train.options import ENCODERS, PROFILED
from warpcam.train.ranks import Rank

if TYPE_CHECKING:
    from warpcam.train.mujoco_task import MujocoTask
    from warpcam.train.pixel_env import PixelEnv
    from warpcam.train.ppo import Evaluation, Policy

SHOWN = 16  # worlds of the video
PICTURE = 128, 96  # of each of them [pixels]


def run(options: argparse.Namespace) -> int:
    """Train, evaluate before and after, and save logs, checkpoints, ``returns.json`` and ``video.mp4``.

    With ``--profile`` a few iterations are timed instead, for ``profile.json``. Of several processes the first alone
    evaluates, prints and writes.
    """
    from warpcam.train import ppo
    from warpcam.train.mujoco_task import STATE
    from warpcam.train.tasks import TASKS

    width, height = _checked(options)
    if not options.profile:
        importlib.import_module("warpcam.train.recorder")  # if its encoder is missing, that is told before all work
    rank, kind = Rank.here(), TASKS[options.task]
    task = kind(options.worlds, device=rank.device(options.device), seed=rank.seed(options.seed))
    from_pixels = options.critic == "pixels"
    config = ppo.settings(
        task.groups,
        task.groups if from_pixels else [STATE],
        images=from_pixels,
        seed=options.seed,
        **{**kind.ppo, **chosen(options, on_gpu=task.scene.device.is_cuda)},
    )
    told_of: dict[str, Any] = {
        "task": options.task,
        "device": f"{task.scene.device.alias} ({task.scene.device.name})",
        "processes": rank.count,
        "worlds": options.worlds,
        "size": [width, height],
        "seed": options.seed,
        "critic": options.critic,
        "colors": options.colors,
        "graphs": options.graphs,
        "precision": config["precision"],
        "encoder": options.encoder,
        "channels_last": config["actor"]["channels_last"],
        "epochs": config["algorithm"]["num_learning_epochs"],
        "mini_batches": config["algorithm"]["num_mini_batches"],
    }
    if options.profile:
        return _profile(task, (width, height), config, options, told_of)
    iterations = options.iterations or kind.iterations
    # rsl_rl asks for no last observations.
    pixels = task.pixels(width, height, capture=options.graphs, colors=options.colors, keep_final=False)
    steps = rank.count * options.worlds * config["num_steps_per_env"]
    longest = task.max_episode_length
    if rank.writes:
        at_random = ppo.evaluate(pixels, ppo.random_policy(pixels, options.seed), longest, options.seed)
        print(f"mean return of random actions: {_told(at_random)}", flush=True)
    curve, seconds, policy = _learn(pixels, config, iterations, steps, options, rank)
    if rank.writes:
        trained = _evaluate(task, pixels, policy, options)
        told_of |= {
            "random": at_random.mean_return,
            "trained": trained.mean_return,
            "success": trained.success,
            "most": task.best,
            "seconds": round(seconds, 2),
            "steps_per_second": round(iterations * steps / seconds, 1),
            "curve": curve,
        }
        (options.out / "returns.json").write_text(json.dumps(told_of, indent=1) + "\n")
        print(f"mean return of the policy: {_told(trained)}, of {task.best:g} at most")
        print(f"{iterations * steps:,} steps in {seconds:.1f} s: {iterations * steps / seconds:,.0f} steps/s")
        for name in ("returns.json", "video.mp4"):
            print(options.out / name)
    rank.close()
    return 0


def chosen(options: argparse.Namespace, on_gpu: bool) -> dict[str, Any]:
    """Settings of ``ppo.settings`` that the command line chooses, or the device."""
    chosen = {
        "precision": options.precision or ("bfloat16" if on_gpu else "float32"),
        "channels_last": on_gpu if options.channels_last is None else options.channels_last,
        "graphs": options.graphs,
        "num_learning_epochs": options.epochs,
        "num_mini_batches": options.mini_batches,
        "encoder": ENCODERS[options.encoder],
    }
    return {name: value for name, value in chosen.items() if value is not None}


def _learn(
    pixels: "PixelEnv", config: dict[str, Any], iterations: int, steps: int, options: argparse.Namespace, rank: Rank
) -> tuple[list[dict[str, float | int | None]], float, "Policy"]:
    """Train; returns the curve, the seconds that it took, and the policy."""
    from warpcam.train import ppo
    from warpcam.train.rsl_rl import RslRlVecEnv

    curve: list[dict[str, float | int | None]] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    screen = Console(stderr=True, quiet=not rank.writes)
    begun = time.perf_counter()
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=screen) as progress:
        bar = progress.add_task("learning", total=iterations)

        def told(iteration: int, mean: float | None, success: float | None) -> None:
            seconds = time.perf_counter() - begun
            point = {"steps": (iteration + 1) * steps, "seconds": round(seconds, 2), "mean_return": mean}
            curve.append(point if success is None else {**point, "success": success})
            shown = "learning" if mean is None else f"mean return {mean:.1f}"
            progress.update(bar, advance=1, description=shown)

        training = ppo.Training(RslRlVecEnv(pixels), config, options.out if rank.writes else None, told)
        training.learn(iterations)
    return curve, time.perf_counter() - begun, training.policy()


def _evaluate(task: "MujocoTask", pixels: "PixelEnv", policy: "Policy", options: argparse.Namespace) -> "Evaluation":
    """Evaluate the policy, and record its first worlds."""
    from warpcam.train import ppo
    from warpcam.train.recorder import Recorder

    width, height = PICTURE
    camera = warpcam.Camera(task.view, width=width, height=height, outputs=("rgb",), antialiasing=4)
    large = warpcam.Renderer(task.scene, [camera])
    shown, longest = tuple(range(min(SHOWN, options.worlds))), task.max_episode_length
    with Recorder(options.out / "video.mp4", worlds=shown, fps=1.0 / task.period, pending=longest) as recorder:

        def look() -> None:
            recorder.add(large.render(worlds=list(shown))[task.view]["rgb"])

        return ppo.evaluate(pixels, policy, longest, options.seed + 1, after=look)


def _told(found: "Evaluation") -> str:
    success = "" if found.success is None else f" (success in {100.0 * found.success:.0f} % of worlds)"
    return f"{found.mean_return:.1f}{success}"


def _profile(
    task: "MujocoTask",
    size: tuple[int, int],
    config: dict[str, Any],
    options: argparse.Namespace,
    told_of: dict[str, Any],
) -> int:
    from warpcam.train import profile

    told_of |= profile.profile(
        task, size, config, options.iterations or PROFILED, graphs=options.graphs, colors=options.colors
    )
    profile.show(told_of, Console())
    path = options.out / "profile.json"
    path.write_text(json.dumps(told_of, indent=1) + "\n")
    print(path)
    return 0


def _checked(options: argparse.Namespace) -> tuple[int, int]:
    """Width and height of an image."""
    for name in ("worlds", "iterations", "epochs", "mini_batches"):
        value = getattr(options, name)
        if value is not None and value < 1:
            raise WarpcamError(f"--{name.replace('_', '-')}: {value} came, at least 1 is needed")
    if options.profile and Rank.here().count > 1:
        raise WarpcamError("--profile: several processes came, it measures one alone")
    if options.seed < 0:
        raise WarpcamError(f"--seed: {options.seed} came, 0 or more is needed")
    size = size_of(options.size)
    path: Path = options.out
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WarpcamError(f"--out: {str(path)!r} cannot be made: {error.strerror}") from None
    return size


def size_of(text: str) -> tuple[int, int]:
    """Width and height of an image [pixels], from "64x64"."""
    match = re.fullmatch(r"([1-9]\d{1,3})x([1-9]\d{1,3})", text)
    if match is None or min(int(match[1]), int(match[2])) < 16:
        raise WarpcamError(f"--size: {text!r} came, width x height of at least 16x16 pixels is needed")
    return int(match[1]), int(match[2])
