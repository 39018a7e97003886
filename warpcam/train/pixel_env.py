"""One batched env of images that the adapters of all libraries share."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.envs import PixelObservation, copied
from warpcam.render.renderer import Renderer
from warpcam.sensors.rig import Rig
from warpcam.train.captured import CapturedWork, can_capture
from warpcam.train.images import Frames, ImageTransform

Observations = dict[str, torch.Tensor]


@dataclass(frozen=True)
class Step:
    """Outcome of one step of all worlds. Arrays are on the scene's device.

    Attributes:
        observations: By group; of the new episode where one has ended. They stay as they are until the step after next.
        rewards: (world,) float32. Rewards and ends, too, stay as they are until the step after next.
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

    Episodes begin anew in the step that ends them.

    Args:
        env: Resets the worlds of ``options["reset_mask"]`` when it is told to (``AutoresetMode.DISABLED``). Its worlds
            are those of the renderer's scene, in that order. Its actions are a box, its observations one or several.
        renderer: Its images become groups named ``"{camera}_{output}"``. A ``Rig`` gives what its sensors measure.
        transforms: What becomes of each group; groups that are not named are copied as they are.
        state: Name of the group of the env's own observation (world, number); several have names of their own. None
            leaves them out.
        forward: Have the simulator compute poses before each frame: see ``Renderer.render``. MuJoCo-Warp's ``step``
            leaves them one step behind.
        keep_final: Whether ``final`` has the last observations of episodes. False draws one frame in a step, after the
            resets, in place of one before and one after them.
        capture: Record all device work of a step as a CUDA graph: simulation, images, rewards, resets and what becomes
            of images. The env's ``step`` and ``reset`` must then neither wait for the device nor draw from torch's
            generators, and keep their state in memory that stays where it is. The first two steps run by themselves.
            On a CPU, and where ``can_capture`` is false, all steps do.

    Attributes:
        captures: Whether steps are recorded.
        keeps_final: Whether ``final`` has the last observations of episodes.
    """

    def __init__(
        self,
        env: VectorEnv,
        renderer: Renderer | Rig,
        *,
        transforms: Mapping[str, ImageTransform] | None = None,
        state: str | None = None,
        forward: bool = False,
        keep_final: bool = True,
        capture: bool = False,
    ):
        if isinstance(env, VectorEnv) and env.metadata.get("autoreset_mode") is not AutoresetMode.DISABLED:
            raise WarpcamError(
                f"PixelEnv: env has the mode {env.metadata.get('autoreset_mode')!r}, {AutoresetMode.DISABLED} is "
                "needed: it resets the worlds of options['reset_mask'] when it is told to"
            )
        eyes = renderer.renderer if isinstance(renderer, Rig) else renderer
        self.renderer, self.keeps_final = renderer, keep_final
        self._env = PixelObservation(
            env if keep_final else _ResetInStep(env),
            renderer,
            layout="CHW",
            state=state,
            arrays="torch",
            copy=False,
            autoreset_mode=AutoresetMode.SAME_STEP,
            forward=forward,
            final_images=keep_final,
        )
        spaces = [("action", env.single_action_space)]
        if state is not None:
            own = env.single_observation_space
            spaces += [("observation", one) for one in getattr(own, "spaces", {"": own}).values()]
        for what, space in spaces:
            shape = getattr(space, "shape", None)
            if shape is None or len(shape) != 1:
                raise WarpcamError(f"PixelEnv: the env's {what} must be a box of one dimension, got {shape}")
        self.num_envs: int = env.num_envs
        self.single_action_space = env.single_action_space
        self.num_actions: int = env.single_action_space.shape[0]
        self.device = eyes.faulty.device
        self._transforms = dict(transforms or {})
        self._frames: dict[str, Frames] = {}
        self._final: Observations = {}
        self._scene_device = eyes.scene.device
        self.captures = capture and can_capture(self._scene_device)
        self._captured: dict[int, CapturedWork[Step]] = {}  # by the place of the observations before it
        self._plain_steps = 2  # until steps are recorded
        with torch.inference_mode(False):
            self._actions = torch.zeros((self.num_envs, self.num_actions), device=self.device)
        first, _ = self._env.reset()
        unknown = ", ".join(map(repr, sorted(self._transforms.keys() - first.keys())))
        if unknown:
            raise WarpcamError(f"PixelEnv: transforms has {unknown}, the groups are {', '.join(map(repr, first))}")
        for key, value in first.items():
            if value.ndim == 4:
                self._frames[key] = self._transforms.get(key, ImageTransform()).prepare(value)
            else:
                self._frames[key] = Frames(value, dtype=torch.float32)
            restarted = self._frames[key].restart(value)
            if keep_final:
                self._final[key] = torch.empty_like(restarted)

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

        Memory that later steps overwrite. Rows of other worlds have no meaning. Empty without ``keep_final``.
        """
        return self._final

    def reset(self, seed: int | None = None) -> Observations:
        """Begin new episodes in all worlds."""
        observed, _ = self._env.reset(seed=seed)
        return {key: frames.restart(observed[key]) for key, frames in self._frames.items()}

    def step(self, actions: torch.Tensor) -> Step:
        """Act in all worlds, (world, action), and begin new episodes where one has ended."""
        if not self.captures or torch_interop.is_capturing(self._scene_device):
            return self._step(actions)
        if self._plain_steps > 0:
            self._plain_steps -= 1
            return self._step(actions)
        self._actions.copy_(actions)
        frames = list(self._frames.values())
        place = frames[0].place
        if place in self._captured:
            for one in frames:
                one.turn()
        else:
            work = functools.partial(self._step, self._actions)
            self._captured[place] = CapturedWork(self._scene_device, work)
        return self._captured[place].launch()

    def _step(self, actions: torch.Tensor) -> Step:
        observed, rewards, terminated, truncated, infos = self._env.step(actions)
        last = infos.get("final_obs") if self.keeps_final else None
        begun = None if self.keeps_final else terminated | truncated
        for key, frames in self._frames.items():
            if last is None:
                frames.push(observed[key], begun)
            else:
                self._final[key].copy_(frames.push(last[key]))
                frames.restart(observed[key], infos["_final_obs"])
        return Step(self.observations, rewards.float(), terminated, truncated, infos)

    def close(self) -> None:
        self._env.close()


class _ResetInStep(VectorWrapper):  # type: ignore[misc]
    """Begins new episodes in the step that ends them: observations are those of the new ones."""

    def __init__(self, env: VectorEnv):
        super().__init__(env)
        self.metadata = {**env.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        observations, *told = self.env.step(actions)
        # What the env tells may be memory of its own, which the reset writes.
        rewards, terminated, truncated, infos = map(copied, told)
        ended = terminated | truncated
        on_host = isinstance(ended, np.ndarray) or not ended.is_cuda
        if on_host and not ended.any():
            return observations, rewards, terminated, truncated, infos
        observations, begun = self.env.reset(options={"reset_mask": copied(ended)})
        return observations, rewards, terminated, truncated, {**begun, **infos}
