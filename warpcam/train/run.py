"""The command ``warpcam train``, which is ``python -m warpcam.train``, too."""

import argparse
import json
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

import warpcam
from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError
from warpcam.train.images import Grey, ImageTransform, Normalize

if TYPE_CHECKING:
    from warpcam.train.pixel_env import PixelEnv
    from warpcam.train.ppo import Policy

SHOWN = 16  # worlds of the video
PICTURE = 128, 96  # of each of them [pixels]
STACK = 2  # frames that the policy sees: their difference is the velocity


def run(options: argparse.Namespace) -> int:
    """Train, evaluate before and after, and save logs, checkpoints, ``returns.json`` and ``video.mp4``."""
    from warpcam.train import ppo
    from warpcam.train.cartpole import CAMERA, CartPole
    from warpcam.train.pixel_env import PixelEnv
    from warpcam.train.rsl_rl import RslRlVecEnv

    width, height = _checked(options)
    device = resolve(options.device)
    env = CartPole(options.worlds, device=device.alias, seed=options.seed)
    scene = warpcam.from_mujoco_warp(env.host, env.model, env.data)
    camera = warpcam.Camera(CAMERA, width=width, height=height, outputs=("rgb",), antialiasing=4)
    image = f"{CAMERA}_rgb"
    transforms = {image: ImageTransform((Grey(), Normalize()), stack=STACK)}
    pixels = PixelEnv(env, warpcam.Renderer(scene, [camera]), transforms=transforms, state="state", forward=True)
    at_random = ppo.mean_return(pixels, ppo.random_policy(pixels, options.seed), env.max_episode_length, options.seed)
    print(f"mean return of random actions: {at_random:.1f}", flush=True)
    groups = [image] if options.critic == "pixels" else ["state"]
    config = ppo.settings([image], groups, images=options.critic == "pixels", seed=options.seed)
    steps = options.worlds * config["num_steps_per_env"]
    curve: list[dict[str, float | int | None]] = []
    begun = time.perf_counter()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    screen = Console(stderr=True)
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=screen) as progress:
        task = progress.add_task("learning", total=options.iterations)

        def told(iteration: int, mean: float | None) -> None:
            seconds = time.perf_counter() - begun
            curve.append({"steps": (iteration + 1) * steps, "seconds": round(seconds, 2), "mean_return": mean})
            shown = "learning" if mean is None else f"mean return {mean:.1f}"
            progress.update(task, advance=1, description=shown)

        training = ppo.Training(RslRlVecEnv(pixels), config, options.out, told)
        training.learn(options.iterations)
    seconds = time.perf_counter() - begun
    trained = _evaluate(pixels, training.policy(), scene, options)
    told_of = {
        "device": f"{device.alias} ({device.name})",
        "worlds": options.worlds,
        "size": [width, height],
        "seed": options.seed,
        "critic": options.critic,
        "random": at_random,
        "trained": trained,
        "seconds": round(seconds, 2),
        "steps_per_second": round(options.iterations * steps / seconds, 1),
        "curve": curve,
    }
    (options.out / "returns.json").write_text(json.dumps(told_of, indent=1) + "\n")
    print(f"mean return of the policy: {trained:.1f}, of {env.max_episode_length} at most")
    print(
        f"{options.iterations * steps:,} steps in {seconds:.1f} s: {options.iterations * steps / seconds:,.0f} steps/s"
    )
    for name in ("returns.json", "video.mp4"):
        print(options.out / name)
    return 0


def _evaluate(pixels: "PixelEnv", policy: "Policy", scene: warpcam.Scene, options: argparse.Namespace) -> float:
    """Mean return of the policy, whose first worlds are recorded."""
    from warpcam.train import ppo
    from warpcam.train.cartpole import CAMERA
    from warpcam.train.recorder import Recorder

    width, height = PICTURE
    large = warpcam.Renderer(
        scene, [warpcam.Camera(CAMERA, width=width, height=height, outputs=("rgb",), antialiasing=4)]
    )
    shown = tuple(range(min(SHOWN, options.worlds)))
    longest = pixels.unwrapped.max_episode_length
    with Recorder(options.out / "video.mp4", worlds=shown, fps=50.0, pending=longest) as recorder:

        def look() -> None:
            recorder.add(large.render(worlds=list(shown), forward=True)[CAMERA]["rgb"])

        return ppo.mean_return(pixels, policy, longest, options.seed + 1, after=look)


def _checked(options: argparse.Namespace) -> tuple[int, int]:
    """Width and height of an image."""
    for name in ("worlds", "iterations"):
        if getattr(options, name) < 1:
            raise WarpcamError(f"--{name}: {getattr(options, name)} came, at least 1 is needed")
    if options.seed < 0:
        raise WarpcamError(f"--seed: {options.seed} came, 0 or more is needed")
    match = re.fullmatch(r"([1-9]\d{1,3})x([1-9]\d{1,3})", options.size)
    if match is None or min(int(match[1]), int(match[2])) < 16:
        raise WarpcamError(f"--size: {options.size!r} came, width x height of at least 16x16 pixels is needed")
    path: Path = options.out
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WarpcamError(f"--out: {str(path)!r} cannot be made: {error.strerror}") from None
    return int(match[1]), int(match[2])
