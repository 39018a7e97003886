"""One batched env of images that the adapters of all libraries share."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from gymnasium.vector import AutoresetMode, VectorEnv

from warpcam.core.errors import WarpcamError
from warpcam.envs import PixelObservation
from warpcam.render.renderer import Renderer
from warpcam.train.images import Frames, ImageTransform

Observations = dict[str, torch.Tensor]


@dataclass(frozen=True)
class Step:
    """Outcome of one step of all worlds. Arrays are on the scene's device.

    Attributes:
        observations: By group; of the new episode where one has ended. They stay as they are until the step after next.
        rewards: (world,) float32.
        terminated: (world,) bool: the task's own end.
        truncated: (world,) bool: the time was up.
        infos: Whatever the env tells.
    """

    observations: Observations
    rewards: torch.Tensor
    terminated: torch.Tensor
    truncated: torch.Tensor
    infos: dict[str, Any]

    @property
    def ended(self) -> torch.Tensor:
        return self.terminated | self.truncated


class PixelEnv:
    """A vector env and a renderer as batched observations for training: tensors on the device, images CHW.

    Episodes begin anew in the step that ends them; ``final`` has the last observations.

    Args:
        env: Resets the worlds of ``options["reset_mask"]`` when it is told to (``AutoresetMode.DISABLED``). Its worlds
            are those of the renderer's scene, in that order. Its observations and actions are single boxes.
        renderer: Its images become groups named ``"{camera}_{output}"``.
        transforms: What becomes of each group; groups that are not named are copied as they are.
        state: Name of the group of the env's own observation (world, number); None leaves it out.
        forward: Have the simulator compute poses before each frame: see ``Renderer.render``. MuJoCo-Warp's ``step``
            leaves them one step behind.
    """

    def __init__(
        self,
        env: VectorEnv,
        renderer: Renderer,
        *,
        transforms: Mapping[str, ImageTransform] | None = None,
        state: str | None = None,
        forward: bool = False,
    ):
        if isinstance(env, VectorEnv) and env.metadata.get("autoreset_mode") is not AutoresetMode.DISABLED:
            raise WarpcamError(
                f"PixelEnv: env has the mode {env.metadata.get('autoreset_mode')!r}, {AutoresetMode.DISABLED} is "
                "needed: it resets the worlds of options['reset_mask'] when it is told to"
            )
        self.renderer = renderer
        self._env = PixelObservation(
            env,
            renderer,
            layout="CHW",
            state=state,
            arrays="torch",
            copy=False,
            autoreset_mode=AutoresetMode.SAME_STEP,
            forward=forward,
        )
        for what in ("observation", "action"):
            shape = getattr(getattr(env, f"single_{what}_space"), "shape", None)
            if shape is None or (len(shape) != 1 and (what == "action" or state is not None)):
                raise WarpcamError(f"PixelEnv: the env's {what} must be a box of one dimension, got {shape}")
        self.num_envs: int = env.num_envs
        self.single_action_space = env.single_action_space
        self.num_actions: int = env.single_action_space.shape[0]
        self.device = renderer.faulty.device
        self._transforms = dict(transforms or {})
        self._frames: dict[str, Frames] = {}
        self._final: Observations = {}
        first, _ = self._env.reset()
        unknown = ", ".join(map(repr, sorted(self._transforms.keys() - first.keys())))
        if unknown:
            raise WarpcamError(f"PixelEnv: transforms has {unknown}, the groups are {', '.join(map(repr, first))}")
        for key, value in first.items():
            if value.ndim == 4:
                self._frames[key] = self._transforms.get(key, ImageTransform()).prepare(value)
            else:
                self._frames[key] = Frames(value, dtype=torch.float32)
            self._final[key] = torch.empty_like(self._frames[key].restart(value))

    @property
    def unwrapped(self) -> VectorEnv:
        """The env itself."""
        return self._env.unwrapped

    @property
    def observations(self) -> Observations:
        """The newest observation of each group."""
        return {key: frames.now for key, frames in self._frames.items()}

    @property
    def final(self) -> Observations:
        """Last observations of the episodes that ended in the last step, in those worlds' rows.

        Memory that later steps overwrite. Rows of other worlds have no meaning.
        """
        return self._final

    def reset(self, seed: int | None = None) -> Observations:
        """Begin new episodes in all worlds."""
        observed, _ = self._env.reset(seed=seed)
        return {key: frames.restart(observed[key]) for key, frames in self._frames.items()}

    def step(self, actions: torch.Tensor) -> Step:
        """Act in all worlds, (world, action), and begin new episodes where one has ended."""
        observed, rewards, terminated, truncated, infos = self._env.step(actions)
        last = infos.get("final_obs")
        for key, frames in self._frames.items():
            if last is None:
                frames.push(observed[key])
            else:
                self._final[key].copy_(frames.push(last[key]))
                frames.restart(observed[key], infos["_final_obs"])
        return Step(self.observations, rewards.float(), terminated, truncated, infos)

    def close(self) -> None:
        self._env.close()
