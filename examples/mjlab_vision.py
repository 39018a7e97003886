"""mjlab's own vision tasks, learned by mjlab's own runner, with warpcam's cameras in place of mjlab's.

Needs mjlab (docs/compat/mjlab.md). Its defaults show on a CPU that all runs; on a GPU, for example:

    python examples/mjlab_vision.py --worlds 2048 --iterations 1000 --device cuda:0

``--renderer mjlab`` draws by mjlab's cameras, for a comparison. Tasks are Mjlab-Lift-Cube-Yam-Rgb, -Depth and
Mjlab-Multi-Cube-Seg-Yam.
"""

import argparse
import json
import statistics
import time
from dataclasses import asdict
from pathlib import Path

import mjlab.tasks  # noqa: F401 # registers them
from mjlab.envs import ManagerBasedRlEnv
from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
from mjlab.tasks.registry import load_env_cfg, load_rl_cfg

from warpcam.compat import mjlab as ours

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--task", default="Mjlab-Lift-Cube-Yam-Rgb")
parser.add_argument("--worlds", type=int, default=4)
parser.add_argument("--iterations", type=int, default=2)
parser.add_argument("--steps", type=int, help="of each world in an iteration (default: the task's own)")
parser.add_argument("--device", default="cpu")
parser.add_argument("--renderer", choices=("warpcam", "mjlab"), default="warpcam")
parser.add_argument("--out", type=Path, default=Path("mjlab-vision"))
options = parser.parse_args()

task, learning = load_env_cfg(options.task), load_rl_cfg(options.task)
task.scene.num_envs = options.worlds
learning.num_steps_per_env = options.steps or learning.num_steps_per_env
learning.logger = "tensorboard"  # not an account in the web
if options.renderer == "warpcam":
    task = ours.use(task)  # the only line that a task needs
env = RslRlVecEnvWrapper(ManagerBasedRlEnv(cfg=task, device=options.device), clip_actions=learning.clip_actions)
runner = MjlabOnPolicyRunner(env, asdict(learning), str(options.out), options.device)

curve, log = [], runner.logger.log
begun = time.perf_counter()


def follow(**values: object) -> None:
    """Keep the mean return of the last 100 episodes and the time."""
    log(**values)
    returns = runner.logger.rewbuffer
    curve.append((round(time.perf_counter() - begun, 2), statistics.mean(returns) if returns else None))


runner.logger.log = follow
options.out.mkdir(parents=True, exist_ok=True)
runner.learn(options.iterations, init_at_random_ep_len=True)
seconds = time.perf_counter() - begun
speed = options.worlds * learning.num_steps_per_env * options.iterations / seconds
told = {"renderer": options.renderer, "task": options.task, "steps_per_second": round(speed, 1), "curve": curve}
(options.out / "returns.json").write_text(json.dumps(told) + "\n")
print(f"{options.task}, drawn by {options.renderer}: {speed:,.0f} steps/s, last mean return {curve[-1][1]}")
env.close()
