"""mjlab's own vision tasks, learned by mjlab's own runner, with warpcam's cameras in place of mjlab's.

Needs mjlab (docs/compat/mjlab.md). Its defaults show on a CPU that all runs; on a GPU, for example:

    python examples/mjlab_vision.py --worlds 2048 --iterations 1000 --device cuda:0

With several renderers and seeds each pair is a run, written to returns.json when it ends; runs that the file has are
not done again:

    python examples/mjlab_vision.py --renderers warpcam mjlab --seeds 0 1 2 --worlds 1024 --device cuda:0

Tasks are Mjlab-Lift-Cube-Yam-Rgb, -Depth and Mjlab-Multi-Cube-Seg-Yam.
"""

import argparse
import gc
import json
import statistics
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mjlab.tasks  # noqa: F401 # registers them
import torch
from mjlab.envs import ManagerBasedRlEnv
from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
from mjlab.tasks.registry import load_env_cfg, load_rl_cfg

from warpcam.compat import mjlab as ours

RENDERERS = ("warpcam", "mjlab")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="Mjlab-Lift-Cube-Yam-Rgb")
    parser.add_argument("--worlds", type=int, default=4)
    parser.add_argument("--iterations", type=int, default=2)
    parser.add_argument("--steps", type=int, help="of each world in an iteration (default: the task's own)")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--renderers", nargs="+", choices=RENDERERS, default=["warpcam"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--seconds", type=float, default=float("inf"), help="in which all runs are to end")
    parser.add_argument("--out", type=Path, default=Path("mjlab-vision"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    path, begun, longest = options.out / "returns.json", time.perf_counter(), 0.0
    runs = json.loads(path.read_text()) if path.exists() else []
    for seed in options.seeds:
        for renderer in options.renderers:
            facts = {"task": options.task, "renderer": renderer, "seed": seed}
            facts |= {name: getattr(options, name) for name in ("worlds", "iterations", "device")}
            if any(facts.items() <= run.items() for run in runs):
                continue
            start = time.perf_counter()
            if start - begun + longest > options.seconds:
                print(f"{renderer}, seed {seed}: not begun")
                continue
            runs.append(facts | train(renderer, seed, options))
            gc.collect()
            longest = max(longest, time.perf_counter() - start)
            path.write_text(json.dumps(runs) + "\n")
            speed, last = runs[-1]["steps_per_second"], runs[-1]["curve"][-1]["mean_return"]
            print(f"{options.task}, {renderer}, seed {seed}: {speed:,.0f} steps/s, last mean return {last}", flush=True)
    for renderer in options.renderers:
        speeds = [run["steps_per_second"] for run in runs if run["renderer"] == renderer]
        if speeds:
            print(f"{renderer}: median {statistics.median(speeds):,.0f} steps/s of {len(speeds)} runs")


def train(renderer: str, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """Learn with one renderer; returns the speed and the curve."""
    task, learning = load_env_cfg(options.task), load_rl_cfg(options.task)
    task.scene.num_envs, task.seed = options.worlds, seed
    learning.seed = seed
    learning.num_steps_per_env = options.steps or learning.num_steps_per_env
    learning.logger = "tensorboard"  # not an account in the web
    if renderer == "warpcam":
        task = ours.use(task)  # the only line that a task needs
    torch.manual_seed(seed)
    env = RslRlVecEnvWrapper(ManagerBasedRlEnv(cfg=task, device=options.device), clip_actions=learning.clip_actions)
    folder = options.out / f"{renderer}-{seed}"
    runner = MjlabOnPolicyRunner(env, asdict(learning), str(folder), options.device)
    curve: list[dict[str, Any]] = []
    logger = runner.logger
    log, begun = logger.log, time.perf_counter()

    def follow(**values: Any) -> None:
        """Keep the mean return of the last 100 episodes and the time."""
        log(**values)
        returns = logger.rewbuffer
        mean = statistics.mean(returns) if returns else None
        curve.append({"seconds": round(time.perf_counter() - begun, 2), "mean_return": mean})

    logger.log = follow
    runner.learn(options.iterations, init_at_random_ep_len=True)
    env.close()
    # Of all iterations but the first, in which kernels are compiled.
    first, last = curve[0]["seconds"], curve[-1]["seconds"]
    steps = options.worlds * learning.num_steps_per_env
    count, seconds = (len(curve) - 1, last - first) if len(curve) > 1 else (1, first)
    return {"steps_per_second": round(steps * count / seconds, 1), "seconds": last, "curve": curve}


main()
