"""What tasks simulated by MuJoCo-Warp have in common: worlds, episodes, cameras."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
import torch
import warp as wp
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

import warpcam
from warpcam.core import torch_interop
from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError
from warpcam.sensors.rig import Rig
from warpcam.train.images import ImageOperation, ImageTransform, Normalize
from warpcam.train.options import COLORS
from warpcam.train.pixel_env import PixelEnv
from warpcam.train.starts import Starts

try:
    import mujoco
    import mujoco_warp as mjw
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and tasks of warpcam.train need it: pip install 'warpcam[train]'"
    ) from error

STATE, PROPRIOCEPTION = "state", "proprioception"  # groups of observations that are no images


class MujocoTask(VectorEnv):  # type: ignore[misc]
    """A task in each world. Its step waits for nothing, and can be part of a CUDA graph.

    A subclass says what the scene is, how episodes begin, what actions do, what is rewarded and what ends an episode:
    the attributes of the class, and the methods that begin with one underscore. All numbers are tensors on the device,
    (world, ...).

    Observations are states, (world, number), for critics and checks. A task whose policy has numbers beside the image
    has two groups of them, ``state`` and ``proprioception``. Actions are from -1 to 1. Where a task tells success,
    ``infos["success"]`` has it, (world,) bool, and ``infos["log"]`` the share of worlds.

    Args:
        num_envs: Worlds.
        device: "cpu", "cuda:0", ...; None is the first GPU, or the CPU.
        seed: Of the states that episodes begin with: they follow from it, the world and the number of its episode.
        max_episode_length: Steps of an episode; None is the task's own.

    Attributes:
        scene: What a renderer sees.
        host: MuJoCo's model.
        model: MuJoCo-Warp's.
        data: State of all worlds.
        episode_length_buf: int64, (world,), steps of each episode so far.
    """

    metadata = {"autoreset_mode": AutoresetMode.DISABLED}  # noqa: RUF012
    length: ClassVar[int]  # steps of an episode
    substeps: ClassVar[int] = 1  # of the simulation in a step
    num_actions: ClassVar[int]
    num_starts: ClassVar[int]  # random numbers with which an episode begins
    num_states: ClassVar[int]
    num_proprioception: ClassVar[int] = 0  # numbers that the policy sees beside the image
    max_contacts: ClassVar[int | None] = None  # of a world; None is MuJoCo-Warp's guess
    max_constraints: ClassVar[int | None] = None  # likewise, rows of constraints
    most: ClassVar[float] = 1.0  # reward of a step
    camera: ClassVar[str]  # sees what the policy sees
    view: ClassVar[str]  # sees what is shown in videos
    output: ClassVar[str] = "rgb"
    operations: ClassVar[Sequence[ImageOperation]]
    stack: ClassVar[int] = 2
    iterations: ClassVar[int]  # of PPO until it is learned
    ppo: ClassVar[Mapping[str, Any]] = {}  # settings other than those of ``warpcam.train.ppo.settings``

    def __init__(
        self, num_envs: int, *, device: str | None = None, seed: int = 0, max_episode_length: int | None = None
    ) -> None:
        self.num_envs, self.seed = num_envs, seed
        self.max_episode_length = self.length if max_episode_length is None else max_episode_length
        self.single_observation_space = _numbers(self.num_states)
        if self.num_proprioception:
            own = {STATE: self.single_observation_space, PROPRIOCEPTION: _numbers(self.num_proprioception)}
            self.single_observation_space = gymnasium.spaces.Dict(own)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (self.num_actions,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.host = self._compile()
        self._device = resolve(device)
        with wp.ScopedDevice(self._device):
            self.model = mjw.put_model(self.host)
            self.data = mjw.make_data(self.host, nworld=num_envs, nconmax=self.max_contacts, njmax=self.max_constraints)
        data = self.data
        # These tensors are the simulator's memory: writing them is writing its state.
        self._position, self._velocity, self._control, self._warmstart, self._time = map(
            torch_interop.to_torch, (data.qpos, data.qvel, data.ctrl, data.qacc_warmstart, data.time)
        )
        self._torch_device = self._position.device
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long, device=self._torch_device)
        self._all = torch.ones(num_envs, dtype=torch.bool, device=self._torch_device)
        self._none = ~self._all
        self._starts = Starts(num_envs, self.num_starts, seed, self._device)
        self._prepare()
        self.scene = warpcam.from_mujoco_warp(self.host, self.model, self.data)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes in all worlds, or in those of ``options["reset_mask"]``."""
        if seed is not None:
            self._starts.seed(seed)
        given = (options or {}).get("reset_mask")
        mask = self._all if given is None else torch.as_tensor(given, device=self._torch_device)
        self._begin(mask, self._starts.draw(mask))
        self.episode_length_buf.masked_fill_(mask, 0)
        self._place()
        return self._observations(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Act in all worlds, (world, action)."""
        actions = torch.as_tensor(actions, dtype=torch.float32, device=self._torch_device).clamp(-1.0, 1.0)
        self._act(actions)
        self.simulate()
        self.episode_length_buf += 1
        late = self.episode_length_buf >= self.max_episode_length
        success, infos = self._success(), {}
        if success is not None:
            infos = {"success": success, "log": {"success": success.float().mean()}}
        return self._observations(), self._reward(actions), self._ended(), late, infos

    def eyes(self, width: int, height: int) -> warpcam.Renderer | Rig:
        """What the policy sees: a renderer of ``output`` of ``camera``, or a rig that measures it."""
        samples = 4 if self.output == "rgb" else 1
        camera = warpcam.Camera(
            self.camera, width=width, height=height, outputs=(self.output,), antialiasing=samples, far=20.0
        )
        return warpcam.Renderer(self.scene, [camera])

    @property
    def period(self) -> float:
        """Time between two steps [s]."""
        return float(self.substeps * self.host.opt.timestep)

    @property
    def best(self) -> float:
        """Bound that no return is above."""
        return self.most * self.max_episode_length

    @property
    def image(self) -> str:
        """Group of observations that has what the policy sees."""
        return f"{self.camera}_{self.output}"

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of observations that the policy sees."""
        return (self.image, PROPRIOCEPTION) if self.num_proprioception else (self.image,)

    def transforms(self, colors: str = "float32") -> Mapping[str, ImageTransform]:
        """What becomes of images; ``colors`` as ``pixels`` has it."""
        if colors not in COLORS:
            raise WarpcamError(f"{type(self).__name__}: colors {colors!r} came, one of {', '.join(COLORS)} is needed")
        operations = tuple(self.operations)
        if self.output == "rgb" and colors == "uint8":
            operations = tuple(operation for operation in operations if operation != Normalize())
        return {self.image: ImageTransform(operations, stack=self.stack)}

    def pixels(
        self,
        width: int,
        height: int,
        *,
        capture: bool = True,
        colors: str = "float32",
        keep_final: bool = True,
        eyes: warpcam.Renderer | Rig | None = None,
    ) -> PixelEnv:
        """Make the batched env of images of which policies learn.

        Args:
            width: Of an image [pixels].
            height: Likewise.
            capture: As ``PixelEnv`` has it.
            colors: "float32" from 0 to 1, or "uint8" from 0 to 255: a quarter of the memory, for models that divide by
                255 themselves, as those of ``warpcam.train.ppo`` do. Depth is float32.
            keep_final: As ``PixelEnv`` has it.
            eyes: What sees, in place of ``self.eyes(width, height)``.
        """
        return PixelEnv(
            self,
            eyes or self.eyes(width, height),
            transforms=self.transforms(colors),
            state=STATE,
            keep_final=keep_final,
            capture=capture,
        )

    def _compile(self) -> mujoco.MjModel:
        """Return the model."""
        raise NotImplementedError

    def _prepare(self) -> None:
        """Allocate what the task needs beside the simulation."""

    def _begin(self, mask: torch.Tensor, numbers: torch.Tensor) -> None:
        """Set states of the worlds of the mask, from ``num_starts`` numbers from 0 to 1 each: see ``_set``."""
        raise NotImplementedError

    def _act(self, actions: torch.Tensor) -> None:
        """Turn actions into controls."""
        self._control.copy_(actions)

    def _reward(self, actions: torch.Tensor) -> torch.Tensor:
        raise NotImplementedError

    def _ended(self) -> torch.Tensor:
        """Worlds whose episodes end before their time is up."""
        return self._none

    def _success(self) -> torch.Tensor | None:
        """Worlds in which the task is done at this moment, (world,) bool; None where it has no such moment."""
        return None

    def _observe(self) -> torch.Tensor:
        """State of the task, (world, ``num_states``)."""
        raise NotImplementedError

    def _proprioception(self) -> torch.Tensor:
        """Numbers that the policy sees beside the image, (world, ``num_proprioception``)."""
        raise NotImplementedError

    def _observations(self) -> Any:
        if self.num_proprioception:
            return {STATE: self._observe(), PROPRIOCEPTION: self._proprioception()}
        return self._observe()

    def _set(self, mask: torch.Tensor, position: torch.Tensor, velocity: torch.Tensor | None = None) -> None:
        """Write states of the worlds of the mask, at time 0. Without velocities, worlds are at rest."""
        here = mask[:, None]
        torch.where(here, position, self._position, out=self._position)
        if velocity is None:
            self._velocity.masked_fill_(here, 0.0)
        else:
            torch.where(here, velocity, self._velocity, out=self._velocity)
        self._warmstart.masked_fill_(here, 0.0)
        self._time.masked_fill_(mask, 0.0)

    def simulate(self) -> None:
        """Step the simulation, and compute the poses of what it has come to."""
        with wp.ScopedDevice(self._device), torch_interop.in_order(self._device):
            for _ in range(self.substeps):
                mjw.step(self.model, self.data)
        self._place()

    def _place(self) -> None:
        with wp.ScopedDevice(self._device), torch_interop.in_order(self._device):
            mjw.kinematics(self.model, self.data)
            mjw.com_pos(self.model, self.data)
            mjw.camlight(self.model, self.data)


def _numbers(count: int) -> gymnasium.spaces.Box:
    return gymnasium.spaces.Box(-np.inf, np.inf, (count,), np.float32)
