"""Where the time of training goes: simulation, images, rewards and resets, policy, learning, and the host's gaps."""

import copy
import time
from typing import Any

from rich.console import Console
from rich.table import Table

from warpcam.sensors.rig import Rig
from warpcam.train import ppo
from warpcam.train.captured import can_capture
from warpcam.train.mujoco_task import MujocoTask
from warpcam.train.rsl_rl import RslRlVecEnv
from warpcam.train.sections import OUTSIDE, Sections

WARM = 3  # iterations before those that are timed
PARTS = ("simulation", "render", "rewards, resets, observations", "whole step", "policy", "learning", OUTSIDE)


def profile(
    task: MujocoTask,
    size: tuple[int, int],
    config: dict[str, Any],
    iterations: int,
    *,
    graphs: bool = True,
    colors: str = "float32",
) -> dict[str, Any]:
    """Learn for some iterations with every part timed, and once more with steps as CUDA graphs where they can be.

    Args:
        task: What is learned.
        size: Width and height of an image [pixels].
        config: Of ``ppo.settings``.
        iterations: That are timed.
        graphs: False times steps part by part alone.
        colors: As ``MujocoTask.pixels`` has it.

    Returns:
        ``runs``, one or two: ``captured``, ``steps_per_second``, and by part the milliseconds of one step of all
        worlds on the device and on the host, and the share. A step that is one graph has no parts of its own.
    """
    hows = (False, True) if graphs and can_capture(task.scene.device) else (False,)
    runs = [_run(task, size, config, iterations, captured, colors) for captured in hows]
    return {"iterations": iterations, "steps_per_iteration": config["num_steps_per_env"], "runs": runs}


def show(told: dict[str, Any], screen: Console) -> None:
    """Print what ``profile`` returned."""
    for run in told["runs"]:
        how = "steps as CUDA graphs" if run["captured"] else "steps part by part"
        table = Table(title=f"{how}: {run['steps_per_second']:,.0f} steps/s")
        for column in ("part", "device, ms", "host, ms", "share"):
            table.add_column(column, justify="left" if column == "part" else "right")
        for name, part in run["parts"].items():
            numbers = f"{part['device_ms']:.3f}", f"{part['host_ms']:.3f}", f"{100.0 * part['share']:.1f} %"
            table.add_row(name, *numbers)
        screen.print(table)


def _run(
    task: MujocoTask, size: tuple[int, int], config: dict[str, Any], iterations: int, captured: bool, colors: str
) -> dict[str, Any]:
    pixels = task.pixels(*size, capture=captured, colors=colors, keep_final=False)
    training = ppo.Training(RslRlVecEnv(pixels), copy.deepcopy(config))
    training.learn(WARM)
    sections, algorithm = Sections(pixels.device), training.runner.alg
    if not captured:
        sections.watch(task, "simulate", "simulation")
        sections.watch(pixels.renderer, "read" if isinstance(pixels.renderer, Rig) else "render", "render")
    sections.watch(pixels, "step", "whole step" if captured else "rewards, resets, observations")
    sections.watch(algorithm, "act", "policy")
    for method in ("process_env_step", "compute_returns", "update"):
        sections.watch(algorithm, method, "learning")
    begun = time.perf_counter()
    sections.begin()
    training.learn(iterations)
    spent = sections.end()
    seconds = time.perf_counter() - begun
    sections.release()
    steps = iterations * config["num_steps_per_env"]
    whole = sum(device for device, _ in spent.values())
    parts = {
        name: {
            "device_ms": round(1e3 * spent[name][0] / steps, 4),
            "host_ms": round(1e3 * spent[name][1] / steps, 4),
            "share": round(spent[name][0] / whole, 4),
        }
        for name in PARTS
        if name in spent
    }
    return {"captured": captured, "steps_per_second": round(steps * task.num_envs / seconds, 1), "parts": parts}
