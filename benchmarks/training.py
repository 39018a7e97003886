"""Training with several renderers behind one env, and several seeds: ``python -m warpcam.benchmarks.training``.

    python -m warpcam.benchmarks.training --worlds 2048 --iterations 150 --out training.json
    python -m warpcam.benchmarks.training --task reach --renderers warpcam --out reach.json

Each run trains one policy from the same first states and weights, and evaluates it in episodes that it has not seen.
The file is written after each run, and runs that it has are not done again. A run before the first of each renderer
has kernels compiled. ``--seconds 540`` begins no run that would not end before, by the length of the last one.
"""

import argparse
import gc
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import torch
import warp as wp

from warpcam.benchmarks import machine, training_table
from warpcam.benchmarks.training_renderers import RENDERERS, eyes
from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError
from warpcam.train import RslRlVecEnv, ppo
from warpcam.train.mujoco_task import STATE
from warpcam.train.options import TASKS as NAMES
from warpcam.train.options import add_learning
from warpcam.train.run import chosen, size_of
from warpcam.train.tasks import TASKS

WARM = 4  # iterations of the run before the first of a renderer
LEARNING = ("epochs", "mini_batches", "precision", "colors", "graphs")
SETTLED = 10  # iterations after which the speed is that of ``steps_per_second``
KEY = ("task", "renderer", "seed", "worlds", "size", "iterations", *LEARNING)
Row = dict[str, Any]


def main(arguments: list[str] | None = None) -> int:
    try:
        return measure(parsed(arguments))
    except WarpcamError as error:
        print(f"warpcam: {error}", file=sys.stderr)
        return 2


def parsed(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=tuple(NAMES), default="cartpole", help="default: %(default)s")
    parser.add_argument("--renderers", nargs="+", choices=RENDERERS, default=list(RENDERERS), metavar="NAME")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="default: 0 1 2")
    parser.add_argument("--worlds", type=int, default=2048, metavar="N", help="default: %(default)s")
    parser.add_argument("--size", default="64x64", metavar="WxH", help="default: %(default)s")
    parser.add_argument("--iterations", type=int, metavar="N", help="default: the task's own")
    add_learning(parser)
    parser.add_argument("--device", metavar="D", help="default: the first GPU, or the CPU")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="in which all runs are to end")
    parser.add_argument("--warm-up", action="store_true", help="have kernels compiled, and do no run")
    parser.add_argument("--out", type=Path, default=Path("training.json"), help="default: %(default)s")
    options = parser.parse_args(arguments)
    for name in ("worlds", "iterations", "epochs", "mini_batches"):
        value = getattr(options, name)
        if value is not None and value < 1:
            raise WarpcamError(f"--{name.replace('_', '-')}: {value} came, at least 1 is needed")
    if min(options.seeds) < 0:
        raise WarpcamError(f"--seeds: {min(options.seeds)} came, 0 or more is needed")
    options.size = size_of(options.size)
    options.iterations = options.iterations or TASKS[options.task].iterations
    return options


def measure(options: argparse.Namespace) -> int:
    """Do the runs that the file does not have, one seed of all renderers after another."""
    device, begun, lengths = resolve(options.device), time.perf_counter(), {}
    report = opened(options.out)
    known = {key_of(row) for row in report["results"]}
    warm: set[str] = set()
    for seed in options.seeds:
        for renderer in options.renderers:
            if key_of(described(renderer, seed, options, settings(seed, options, device))) in known:
                continue
            spent = time.perf_counter() - begun
            if spent + lengths.get(renderer, max(lengths.values(), default=0.0)) > options.seconds:
                print(f"{renderer}, seed {seed}: not begun, {spent:.0f} s are over", flush=True)
                continue
            if renderer not in warm:
                start = time.perf_counter()
                Run(renderer, seed, options, device).learn(WARM)
                print(f"{renderer}: ready after {time.perf_counter() - start:.1f} s", flush=True)
                warm.add(renderer)
                release(device)
            if options.warm_up:
                continue
            start = time.perf_counter()
            row = Run(renderer, seed, options, device).whole()
            release(device)
            lengths[renderer] = time.perf_counter() - start
            report["results"].append(row | {"machine": machine.describe(device)})
            write(report, options.out)
            print(training_table.line(row), flush=True)
    if report["results"]:
        training_table.show(report["results"])
    return 0


def described(renderer: str, seed: int, options: argparse.Namespace, config: dict[str, Any]) -> Row:
    """Settings of a run."""
    return {
        "task": options.task,
        "renderer": renderer,
        "seed": seed,
        "worlds": options.worlds,
        "size": list(options.size),
        "iterations": options.iterations,
        "epochs": config["algorithm"]["num_learning_epochs"],
        "mini_batches": config["algorithm"]["num_mini_batches"],
        "precision": config["precision"],
        "colors": options.colors,
        "graphs": options.graphs,
    }


def settings(seed: int, options: argparse.Namespace, device: wp.Device) -> dict[str, Any]:
    """Settings of learning, but for the groups of observations."""
    return ppo.settings([], [STATE], seed=seed, **{**TASKS[options.task].ppo, **chosen(options, device.is_cuda)})


def key_of(row: Row) -> str:
    return json.dumps([row[name] for name in KEY])


class Run:
    """One policy, which is trained and evaluated."""

    def __init__(self, renderer: str, seed: int, options: argparse.Namespace, device: wp.Device):
        self._begun = time.perf_counter()
        self._seed, self._options = seed, options
        self._task = task = TASKS[options.task](options.worlds, device=device.alias, seed=seed)
        self._pixels = task.pixels(
            *options.size,
            capture=options.graphs,
            colors=options.colors,
            keep_final=False,
            eyes=eyes(renderer, task, *options.size),
        )
        self._config = settings(seed, options, device)
        self._row = described(renderer, seed, options, self._config)
        self._config["obs_groups"]["actor"] = list(task.groups)
        self._steps = options.worlds * self._config["num_steps_per_env"]

    def whole(self) -> Row:
        """Train and evaluate; returns all that is known of it."""
        longest, seed = self._task.max_episode_length, self._seed
        at_random = ppo.evaluate(self._pixels, ppo.random_policy(self._pixels, seed), longest, seed)
        prepared = time.perf_counter() - self._begun
        curve, policy, seconds = self.learn(self._options.iterations)
        trained = ppo.evaluate(self._pixels, policy, longest, seed + 1)
        on_gpu = self._pixels.device.type == "cuda"
        return self._row | {
            "captured": self._pixels.captures,
            "random": at_random.mean_return,
            "trained": trained.mean_return,
            "success": trained.success,
            "most": self._task.best,
            "prepare_seconds": round(prepared, 2),
            "seconds": round(seconds, 3),
            "peak_torch_mib": torch.cuda.max_memory_allocated(self._pixels.device) // 2**20 if on_gpu else None,
            **summary(curve, self._task.best),
            "curve": curve,
        }

    def learn(self, iterations: int) -> tuple[list[dict[str, Any]], ppo.Policy, float]:
        """Train; returns the curve, the policy and the time [s]."""
        curve: list[dict[str, Any]] = []

        def told(iteration: int, mean: float | None, success: float | None) -> None:
            point = {"steps": (iteration + 1) * self._steps, "seconds": round(time.perf_counter() - start, 3)}
            curve.append({**point, "mean_return": mean, "success": success})

        with tempfile.TemporaryDirectory() as folder:
            training = ppo.Training(RslRlVecEnv(self._pixels), self._config, Path(folder), told)
            start = time.perf_counter()
            training.learn(iterations)
            seconds = time.perf_counter() - start
            training.runner.logger.writer.close()  # before its folder is removed
        return curve, training.policy(), seconds


def release(device: wp.Device) -> None:
    """Have memory of runs that are over be free."""
    gc.collect()
    if device.is_cuda:
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats(wp.device_to_torch(device))


def summary(curve: list[dict[str, Any]], most: float) -> Row:
    """Speed after the first iterations, and steps and time to a mean return of 90 % of the most."""
    first, last = curve[min(SETTLED, len(curve) - 1) - 1 if len(curve) > 1 else 0], curve[-1]
    between = last["seconds"] - first["seconds"]
    reached = next((point for point in curve if (point["mean_return"] or 0.0) >= 0.9 * most), None)
    return {
        "steps_per_second": round((last["steps"] - first["steps"]) / between, 1) if between > 0.0 else None,
        "seconds_to_90": None if reached is None else reached["seconds"],
        "steps_to_90": None if reached is None else reached["steps"],
    }


def opened(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {"about": f"python -m warpcam.benchmarks.training {' '.join(sys.argv[1:])}", "results": []}
    report: dict[str, Any] = json.loads(path.read_text())
    return report


def write(report: dict[str, Any], path: Path) -> None:
    """Write the file in one piece: whoever ends the run meanwhile finds the one before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f"{path.name}.new")
    new.write_text(json.dumps(report) + "\n")
    new.replace(path)


if __name__ == "__main__":
    sys.exit(main())
