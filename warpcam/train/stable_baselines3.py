"""Stable-Baselines3: a ``PixelEnv`` as its ``VecEnv``, with numpy arrays on the host."""

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
import torch

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.train.pixel_env import Observations, PixelEnv

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and warpcam.train.stable_baselines3 needs it: pip install stable-baselines3"
    ) from error


class StableBaselines3VecEnv(VecEnv):  # type: ignore[misc]
    """A vector env with images as Stable-Baselines3 takes it: numpy arrays, images HWC uint8.

    Observations are copied to the host in every step, as the library needs them there. Infos of a world whose episode
    has ended have ``terminal_observation`` and ``TimeLimit.truncated``.

    Args:
        env: Gives the observations. Images must be uint8: transforms without ``Normalize``, which the library does.
        groups: Of the observations; one alone is the observation, several are a dictionary. None takes all.
    """

    def __init__(self, env: PixelEnv, groups: Sequence[str] | None = None):
        if not isinstance(env, PixelEnv):
            raise WarpcamError(f"StableBaselines3VecEnv: env must be a PixelEnv, got {type(env).__name__}")
        if not env.keeps_final:
            raise WarpcamError(
                "StableBaselines3VecEnv: env must be a PixelEnv with keep_final=True, it came with False"
            )
        self.env, self._groups = env, list(env.observations if groups is None else groups)
        for group in self._groups:
            if group not in env.observations:
                raise WarpcamError(
                    f"StableBaselines3VecEnv: groups has {group!r}, there are {', '.join(map(repr, env.observations))}"
                )
            one = env.observations[group]
            if one.ndim == 4 and one.dtype is not torch.uint8:
                raise WarpcamError(
                    f"StableBaselines3VecEnv: images must be uint8, {group!r} is {one.dtype}; leave Normalize to the "
                    "library, or leave the group out"
                )
        spaces = {group: _space(env.observations[group]) for group in self._groups}
        self._single = len(spaces) == 1
        space = spaces[self._groups[0]] if self._single else gymnasium.spaces.Dict(spaces)
        self.render_mode = None
        self._actions = torch.zeros((env.num_envs, env.num_actions), device=env.device)
        super().__init__(env.num_envs, space, env.single_action_space)

    def reset(self) -> Any:
        seed = next((seed for seed in self._seeds if seed is not None), None)
        self._reset_seeds()
        self._reset_options()
        return self._host(self.env.reset(seed=seed))

    def step_async(self, actions: np.ndarray) -> None:
        self._actions.copy_(torch.as_tensor(np.asarray(actions)))

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        step = self.env.step(self._actions)
        rewards, ended, late = map(
            torch_interop.to_numpy, (step.rewards, step.ended, step.truncated & ~step.terminated)
        )
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if ended.any():
            final = self._host(self.env.final)
            for world in np.flatnonzero(ended):
                last = final[world] if self._single else {group: values[world] for group, values in final.items()}
                infos[world] = {"terminal_observation": last, "TimeLimit.truncated": bool(late[world])}
        return self._host(step.observations), rewards.copy(), ended, infos

    def close(self) -> None:
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        value = getattr(self if attr_name == "render_mode" else self.env.unwrapped, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the env, which all worlds share."""
        self._require_all(indices, "set_attr")
        setattr(self.env.unwrapped, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of the env, which all worlds share, once."""
        self._require_all(indices, "env_method")
        result = getattr(self.env.unwrapped, method_name)(*method_args, **method_kwargs)
        return [result for _ in range(self.num_envs)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]

    def _require_all(self, indices: Any, what: str) -> None:
        chosen: Iterable[int] = self._get_indices(indices)
        if sorted(chosen) != list(range(self.num_envs)):
            raise WarpcamError(f"StableBaselines3VecEnv.{what}: indices {indices!r} came, all worlds share one env")

    def _host(self, observations: Observations) -> Any:
        arrays = {group: _array(observations[group]) for group in self._groups}
        return arrays[self._groups[0]] if self._single else arrays


def _array(group: torch.Tensor) -> np.ndarray:
    """A copy on the host, images HWC."""
    return torch_interop.to_numpy(torch_interop.copied(group.permute(0, 2, 3, 1) if group.ndim == 4 else group))


def _space(group: torch.Tensor) -> gymnasium.spaces.Box:
    if group.ndim == 4:
        _, channels, height, width = group.shape
        return gymnasium.spaces.Box(0, 255, (height, width, channels), np.uint8)
    return gymnasium.spaces.Box(-np.inf, np.inf, tuple(group.shape[1:]), np.float32)
