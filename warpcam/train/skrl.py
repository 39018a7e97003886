"""skrl: a ``PixelEnv`` as an env that its trainers and agents take."""

from typing import Any

import gymnasium
import numpy as np
import torch

from warpcam.core.errors import WarpcamError
from warpcam.train.pixel_env import PixelEnv

try:
    from skrl.envs.wrappers.torch import Wrapper
except ImportError as error:
    raise WarpcamError(f"{error.name} is not installed, and warpcam.train.skrl needs it: pip install skrl") from error


class SkrlEnv(Wrapper):  # type: ignore[misc]
    """A vector env with images as skrl takes it: observations and states are flat, as its spaces unflatten them.

    In a model, ``unflatten_tensorized_space(self.observation_space, inputs["observations"])`` gives the images CHW.

    Args:
        env: Gives the observations.
        observations: Group that the policy sees.
        states: Group that the critic sees; None has it see the same.

    The env begins new episodes by itself, in the step that ends one. skrl's ``time_limit_bootstrap`` adds values at
    limits of time.
    """

    def __init__(self, env: PixelEnv, observations: str, states: str | None = None):
        if not isinstance(env, PixelEnv):
            raise WarpcamError(f"SkrlEnv: env must be a PixelEnv, got {type(env).__name__}")
        for name, group in (("observations", observations), ("states", states)):
            if group is not None and group not in env.observations:
                raise WarpcamError(
                    f"SkrlEnv: {name} {group!r} came, the groups are {', '.join(map(repr, env.observations))}"
                )
        super().__init__(env)
        self._device, self._begun = env.device, False
        self._names = observations, states
        self._spaces = _space(env.observations[observations]), states and _space(env.observations[states])

    @property
    def num_envs(self) -> int:
        return self._env.num_envs

    @property
    def observation_space(self) -> gymnasium.Space:
        return self._spaces[0]

    @property
    def state_space(self) -> gymnasium.Space | None:
        return self._spaces[1]

    @property
    def action_space(self) -> gymnasium.Space:
        return self._env.single_action_space

    def reset(self) -> tuple[torch.Tensor, dict[str, Any]]:
        """Begin new episodes in all worlds when called first; return the newest observation later.

        Trainers call this again after an episode, when the env has begun the next one already.
        """
        if not self._begun:
            self._begun = True
            self._env.reset()
        return self._flat(self._names[0]), {}

    def step(
        self, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]:
        step = self._env.step(actions)
        columns = (one.reshape(-1, 1) for one in (step.rewards, step.terminated, step.truncated))
        return self._flat(self._names[0]), *columns, step.infos.get("log", {})

    def state(self) -> torch.Tensor | None:
        return None if self._names[1] is None else self._flat(self._names[1])

    def render(self, *args: Any, **kwargs: Any) -> None:
        """Nothing: videos are the work of ``Recorder``."""

    def close(self) -> None:
        self._env.close()

    def _flat(self, group: str) -> torch.Tensor:
        return self._env.observations[group].flatten(1)


def _space(group: torch.Tensor) -> gymnasium.spaces.Box:
    shape = tuple(group.shape[1:])
    if group.dtype is torch.uint8:
        return gymnasium.spaces.Box(0, 255, shape, np.uint8)
    return gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
