"""TorchRL: a ``PixelEnv`` as an ``EnvBase`` with a batch of worlds."""

from typing import Any

import torch

from warpcam.core.errors import WarpcamError
from warpcam.train.pixel_env import PixelEnv

try:
    from tensordict import TensorDict
    from torchrl.data import Bounded, Categorical, Composite, Unbounded
    from torchrl.envs import EnvBase
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and warpcam.train.torchrl needs it: pip install torchrl"
    ) from error

ENDS = ("done", "terminated", "truncated")


class TorchRLEnv(EnvBase):  # type: ignore[misc]
    """A vector env with images as TorchRL takes it: groups are keys of its ``TensorDict``s.

    The observation after a step is the last one where an episode has ended; the reset that follows gives the first one
    of the next episode, which the env has begun already. Observations are copies, as rollouts keep them.

    Args:
        env: Gives the observations.
    """

    batch_locked = True

    def __init__(self, env: PixelEnv):
        if not isinstance(env, PixelEnv):
            raise WarpcamError(f"TorchRLEnv: env must be a PixelEnv, got {type(env).__name__}")
        if not env.keeps_final:
            raise WarpcamError("TorchRLEnv: env must be a PixelEnv with keep_final=True, it came with False")
        super().__init__(device=env.device, batch_size=[env.num_envs])
        self._env = env
        self._next_seed: int | None = None
        self._begun = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
        worlds, device = (env.num_envs,), env.device
        groups = {group: _spec(value) for group, value in env.observations.items()}
        self.observation_spec = Composite(groups, shape=worlds, device=device)
        low, high = (
            torch.as_tensor(bound, device=device).expand(env.num_envs, env.num_actions).clone()
            for bound in (env.single_action_space.low, env.single_action_space.high)
        )
        self.action_spec = Bounded(low, high, shape=low.shape, dtype=torch.float32, device=device)
        self.reward_spec = Unbounded(shape=(*worlds, 1), dtype=torch.float32, device=device)
        ends = {name: Categorical(2, shape=(*worlds, 1), dtype=torch.bool, device=device) for name in ENDS}
        self.done_spec = Composite(ends, shape=worlds, device=device)

    def _reset(self, tensordict: Any = None, **kwargs: Any) -> Any:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        mask = torch.ones_like(self._begun) if mask is None else mask.reshape(self.num_envs)
        if bool((mask & ~self._begun).any()):
            if not bool(mask.all()):
                raise WarpcamError(
                    "TorchRLEnv: worlds in the middle of an episode are to be reset; only all worlds can be, and those "
                    "whose episodes have ended"
                )
            self._env.reset(seed=self._next_seed)
            self._next_seed = None
        self._begun &= ~mask
        observations = {group: value.clone() for group, value in self._env.observations.items()}
        never = torch.zeros((self.num_envs, 1), dtype=torch.bool, device=self.device)
        return self._packed({**observations, **{name: never.clone() for name in ENDS}})

    def _step(self, tensordict: Any) -> Any:
        step = self._env.step(tensordict["action"])
        self._begun = step.ended.clone()
        observations = {}
        for group, value in step.observations.items():
            mask = self._begun.reshape(-1, *[1] * (value.ndim - 1))
            observations[group] = torch.where(mask, self._env.final[group], value)
        ends = dict(zip(ENDS, (step.ended, step.terminated, step.truncated), strict=True))
        columns = {name: value.reshape(-1, 1).clone() for name, value in {"reward": step.rewards, **ends}.items()}
        return self._packed({**observations, **columns})

    def _set_seed(self, seed: int | None) -> None:
        self._next_seed = seed

    @property
    def num_envs(self) -> int:
        return self._env.num_envs

    def _packed(self, values: dict[str, torch.Tensor]) -> TensorDict:
        return TensorDict(values, batch_size=self.batch_size, device=self.device)


def _spec(group: torch.Tensor) -> Any:
    if group.dtype is torch.uint8:
        return Bounded(0, 255, shape=group.shape, dtype=torch.uint8, device=group.device)
    return Unbounded(shape=group.shape, dtype=group.dtype, device=group.device)
