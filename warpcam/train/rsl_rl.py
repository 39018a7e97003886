"""rsl_rl: a ``PixelEnv`` as its ``VecEnv``."""

from typing import Any

import torch

from warpcam.core.errors import WarpcamError
from warpcam.train.pixel_env import PixelEnv

try:
    from rsl_rl.env import VecEnv
    from tensordict import TensorDict
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and warpcam.train.rsl_rl needs it: pip install 'warpcam[train]'"
    ) from error


class RslRlVecEnv(VecEnv):  # type: ignore[misc]
    """A vector env with images as rsl_rl's runners take it: groups in a ``TensorDict``, images CHW for its CNN models.

    An episode that ends because its time is up is told in ``extras["time_outs"]``; rsl_rl adds the value of the last
    observation before it to the reward.

    Args:
        env: Gives the observations.
        max_episode_length: Steps of the longest episode; None is the env's own ``max_episode_length``.
        cfg: Settings of the env that rsl_rl's loggers store.

    If the env has a tensor ``episode_length_buf``, (world,), the steps of each episode so far, rsl_rl may set it, as
    ``learn(init_at_random_ep_len=True)`` does.
    """

    def __init__(self, env: PixelEnv, max_episode_length: int | None = None, cfg: dict[str, Any] | None = None):
        if not isinstance(env, PixelEnv):
            raise WarpcamError(f"RslRlVecEnv: env must be a PixelEnv, got {type(env).__name__}")
        longest = (
            getattr(env.unwrapped, "max_episode_length", None) if max_episode_length is None else max_episode_length
        )
        if longest is None:
            raise WarpcamError("RslRlVecEnv: max_episode_length is needed, the env has none of its own")
        self.env, self.cfg = env, cfg or {}
        self.num_envs, self.num_actions, self.device = env.num_envs, env.num_actions, env.device
        self.max_episode_length = longest
        own = getattr(env.unwrapped, "episode_length_buf", None)
        self._told = own is None
        self._ages = torch.zeros(self.num_envs, dtype=torch.long, device=self.device) if own is None else own

    @property
    def episode_length_buf(self) -> torch.Tensor:
        """Steps of each world's episode so far, (world,)."""
        return self._ages

    @episode_length_buf.setter
    def episode_length_buf(self, ages: torch.Tensor) -> None:
        if self._told:
            raise WarpcamError(
                "RslRlVecEnv: the env has no episode_length_buf to set; learn with init_at_random_ep_len=False"
            )
        self._ages.copy_(ages)

    def get_observations(self) -> TensorDict:
        return self._grouped(self.env.observations)

    def reset(self) -> tuple[TensorDict, dict[str, Any]]:
        """Begin new episodes in all worlds."""
        observations = self.env.reset()
        if self._told:
            self._ages.zero_()
        return self._grouped(observations), {}

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        step = self.env.step(actions)
        if self._told:
            self._ages.add_(1).mul_(~step.ended)
        # Loggers keep what later steps overwrite.
        log = {key: torch.as_tensor(value).clone() for key, value in step.infos.get("log", {}).items()}
        extras = {"time_outs": step.truncated & ~step.terminated, "log": log}
        return self._grouped(step.observations), step.rewards, step.ended.long(), extras

    def _grouped(self, observations: dict[str, torch.Tensor]) -> TensorDict:
        return TensorDict(dict(observations), batch_size=[self.num_envs], device=self.device)
