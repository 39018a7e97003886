"""PPO of rsl_rl for policies that see images: settings, training, evaluation."""

import contextlib
import math
import os
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from warpcam.core.errors import WarpcamError
from warpcam.train.options import PRECISIONS
from warpcam.train.pixel_env import PixelEnv
from warpcam.train.ranks import Rank
from warpcam.train.rsl_rl import RslRlVecEnv

try:
    from rsl_rl.runners import OnPolicyRunner
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and warpcam.train.ppo needs it: pip install 'warpcam[train]'"
    ) from error

ENCODER: Mapping[str, Any] = {
    "output_channels": [16, 32],
    "kernel_size": [5, 3],
    "stride": [2, 2],
    "activation": "elu",
}
Policy = Callable[[dict[str, torch.Tensor]], torch.Tensor]


def settings(
    actor: Sequence[str],
    critic: Sequence[str],
    *,
    images: bool = False,
    seed: int = 0,
    encoder: Mapping[str, Any] = ENCODER,
    hidden: Sequence[int] = (128, 64),
    precision: str = "float32",
    channels_last: bool = False,
    graphs: bool = True,
    **ppo: Any,
) -> dict[str, Any]:
    """Settings of a runner of rsl_rl, of a size for images of 32 to 96 pixels.

    Args:
        actor: Groups of observations that the policy sees, among them images.
        critic: Groups that the critic sees.
        images: Whether images are among those of the critic.
        seed: Of weights and actions.
        encoder: Convolutions of each image: ``cnn_cfg`` of rsl_rl.
        hidden: Widths of the layers behind them.
        precision: Of the arithmetic; weights and losses are float32. "float32" leaves torch as it is, "tf32" allows it
            for matrices, and "bfloat16" is "tf32" with convolutions in bfloat16.
        channels_last: Have the channel be the fastest index of what convolutions read and write.
        graphs: Act and learn by ``GraphedPPO``, on a GPU as CUDA graphs; False is rsl_rl's own ``PPO``.
        ppo: Settings of PPO other than these, and ``num_steps_per_env``.
    """
    if precision not in PRECISIONS:
        raise WarpcamError(f"settings: precision {precision!r} came, one of {', '.join(PRECISIONS)} is needed")
    layers = {"hidden_dims": list(hidden), "activation": "elu"}
    model = {
        "class_name": "warpcam.train.image_model:ImageModel",
        **layers,
        "cnn_cfg": dict(encoder),
        "half": precision == "bfloat16",
        "channels_last": channels_last,
    }
    drawn = {"class_name": "warpcam.train.image_model:Gaussian", "init_std": 0.6}
    plain = {"class_name": "MLPModel", **layers, "obs_normalization": True}
    return {
        "seed": seed,
        "num_steps_per_env": ppo.pop("num_steps_per_env", 16),
        "save_interval": 50,
        "precision": precision,
        "check_for_nan": not graphs,  # else once in an iteration, by the losses
        "obs_groups": {"actor": list(actor), "critic": list(critic)},
        "actor": {**model, "distribution_cfg": drawn},
        "critic": dict(model) if images else plain,
        "algorithm": {
            "class_name": "warpcam.train.graphed_ppo:GraphedPPO" if graphs else "PPO",
            "learning_rate": 1e-3,
            "schedule": "adaptive",
            "desired_kl": 0.02,
            "gamma": 0.98,
            "lam": 0.95,
            "entropy_coef": 0.002,
            "clip_param": 0.2,
            "num_learning_epochs": 3,
            "num_mini_batches": 4,
            "value_loss_coef": 1.0,
            "use_clipped_value_loss": True,
            "max_grad_norm": 1.0,
            **ppo,
        },
    }


class _Runner(OnPolicyRunner):  # type: ignore[misc]
    """A runner whose processes may learn together on CPUs, too; rsl_rl's own do on GPUs alone."""

    def _configure_multi_gpu(self) -> None:
        rank = Rank.here()
        if rank.count == 1 or not str(self.device).startswith("cpu"):
            super()._configure_multi_gpu()
            return
        self.is_distributed, self.gpu_world_size = True, rank.count
        self.gpu_global_rank, self.gpu_local_rank = rank.number, rank.local
        self.cfg["multi_gpu"] = {"global_rank": rank.number, "local_rank": rank.local, "world_size": rank.count}
        torch.distributed.init_process_group(backend="gloo", rank=rank.number, world_size=rank.count)


class Training:
    """A runner of rsl_rl that tells how it goes. Processes of ``torchrun`` learn together.

    Args:
        env: What is learned in.
        config: See ``settings``.
        folder: Of TensorBoard logs and checkpoints ``model_*.pt``; None writes nothing.
        told: Called after each iteration with its number, the mean return of the last 100 episodes, None before the
            first episode has ended, and the share of worlds in which the task was done, None where the env does not
            tell it in ``infos["log"]["success"]``.
    """

    def __init__(
        self,
        env: RslRlVecEnv,
        config: dict[str, Any],
        folder: Path | None = None,
        told: Callable[[int, float | None, float | None], None] | None = None,
    ):
        torch.manual_seed(Rank.here().seed(config["seed"]))
        self._env, self._log = env, None if folder is None else folder / "rsl_rl.log"
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
        with self._quiet():
            self.runner = _Runner(env, config, log_dir=None if folder is None else str(folder), device=str(env.device))
        self._fast = config.get("precision", "float32") != "float32"
        logger, log, episodes = self.runner.logger, self.runner.logger.log, _Episodes(self.runner.logger)

        def followed(**values: Any) -> None:
            episodes.tell()
            success = episodes.success() if told is not None else None
            log(**values)
            if told is not None:
                told(values["it"], statistics.mean(logger.rewbuffer) if logger.rewbuffer else None, success)

        logger.log, logger.process_env_step = followed, episodes.add

    def learn(self, iterations: int, spread: bool = True) -> None:
        """Learn.

        Args:
            iterations: Each is a stretch of steps in all worlds, and what is learned of it.
            spread: Begin with episodes of all ages, so that not all worlds end at one time. The env needs
                ``episode_length_buf`` for it.
        """
        self._env.reset()
        with self._quiet(), _arithmetic(self._fast):
            self.runner.learn(iterations, init_at_random_ep_len=spread)

    def policy(self) -> Policy:
        """Return the policy without its noise: from observations of a ``PixelEnv`` to actions."""
        model = self.runner.get_inference_policy(device=str(self._env.device))

        def act(observations: dict[str, torch.Tensor]) -> torch.Tensor:
            with torch.inference_mode():
                return model(observations)

        return act

    @contextlib.contextmanager
    def _quiet(self) -> Any:
        """Send what rsl_rl prints to its log, or nowhere."""
        with contextlib.ExitStack() as stack:
            # Not to None, which Warp cannot tell of the kernels that it loads.
            log = Path(os.devnull) if self._log is None else self._log
            stack.enter_context(contextlib.redirect_stdout(stack.enter_context(log.open("a"))))
            yield


class _Episodes:
    """What rsl_rl's logger is told of episodes, read from the device once in an iteration instead of in each step.

    Args:
        logger: Of rsl_rl.
    """

    def __init__(self, logger: Any):
        self._logger = logger
        self._ended: list[torch.Tensor] = []

    def add(self, rewards: torch.Tensor, dones: torch.Tensor, extras: dict[str, Any], intrinsic: None = None) -> None:
        """Count a step of all worlds."""
        logger = self._logger
        if logger.writer is None:
            return
        logger.ep_extras.append(extras["log"])
        logger.cur_reward_sum += rewards
        logger.cur_episode_length += 1
        ended = dones > 0
        sums = torch.stack((logger.cur_reward_sum, logger.cur_episode_length))
        self._ended.append(torch.where(ended, sums, math.nan))
        logger.cur_reward_sum.masked_fill_(ended, 0.0)
        logger.cur_episode_length.masked_fill_(ended, 0.0)

    def success(self) -> float | None:
        """Return the share of worlds and steps of this iteration in which the task was done."""
        shares = [told["success"] for told in self._logger.ep_extras if "success" in told]
        return torch.stack(shares).mean().item() if shares else None

    def tell(self) -> None:
        """Give the logger the returns and the lengths of the episodes that have ended."""
        if not self._ended:
            return
        returns, lengths = torch.stack(self._ended, dim=1).flatten(1).cpu()
        self._ended.clear()
        some = ~lengths.isnan()
        self._logger.rewbuffer.extend(returns[some].tolist())
        self._logger.lenbuffer.extend(lengths[some].tolist())


@contextlib.contextmanager
def _arithmetic(fast: bool) -> Any:
    """Allow TF32 for matrices, and let cuDNN measure which of its convolutions is fastest."""
    before = torch.get_float32_matmul_precision(), torch.backends.cudnn.benchmark
    if fast:
        torch.set_float32_matmul_precision("high")
    torch.backends.cudnn.benchmark = True
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before[0])
        torch.backends.cudnn.benchmark = before[1]


def random_policy(env: PixelEnv, seed: int = 0) -> Policy:
    """Return a policy that draws every action from all that are allowed, each as likely as any other."""
    random = torch.Generator(env.device).manual_seed(seed)
    low, high = (
        torch.as_tensor(bound, dtype=torch.float32, device=env.device)
        for bound in (env.single_action_space.low, env.single_action_space.high)
    )

    def act(observations: dict[str, torch.Tensor]) -> torch.Tensor:
        share = torch.rand((env.num_envs, env.num_actions), generator=random, device=env.device)
        return low + (high - low) * share

    return act


@dataclass(frozen=True)
class Evaluation:
    """What a policy came to.

    Attributes:
        mean_return: Mean over the worlds of the rewards of their first episode, or of its first steps.
        success: Share of the worlds in which the task was done in the last of these steps; None where the env does not
            tell it in ``infos["success"]``.
    """

    mean_return: float
    success: float | None


def evaluate(
    env: PixelEnv, policy: Policy, steps: int, seed: int = 0, after: Callable[[], None] | None = None
) -> Evaluation:
    """Act in the first episode of each world.

    Args:
        env: Where to act.
        policy: Acts.
        steps: At most.
        seed: Of the first states.
        after: Called after the reset and after each step.
    """
    observations = env.reset(seed=seed)
    returns = torch.zeros(env.num_envs, device=env.device)
    running = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
    done = None
    for _ in range(steps):
        if after is not None:
            after()
        step = env.step(policy(observations))
        returns += step.rewards * running
        if "success" in step.infos:
            now = step.infos["success"]
            done = now.clone() if done is None else torch.where(running, now, done)
        running &= ~step.ended
        observations = step.observations
    return Evaluation(returns.mean().item(), None if done is None else done.float().mean().item())
