"""Cart-pole: a pole on a cart is to stay upright, and the policy sees an image alone."""

from typing import Any

import gymnasium
import numpy as np
import torch
import warp as wp
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from warpcam.core import torch_interop
from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError

try:
    import mujoco
    import mujoco_warp as mjw
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and warpcam.train.cartpole needs it: pip install 'warpcam[train]'"
    ) from error

CAMERA = "side"
SCENE = f"""
<mujoco model="cart-pole">
  <option timestep="0.02"><flag contact="disable"/></option>
  <visual><headlight ambient="0.5 0.5 0.5" diffuse="0.5 0.5 0.5" specular="0 0 0"/></visual>
  <worldbody>
    <camera name="{CAMERA}" pos="0 -4 1.1" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <geom type="plane" size="0 0 1" pos="0 0 -0.05" rgba="0.25 0.3 0.35 1"/>
    <geom type="capsule" fromto="-2 0 1 2 0 1" size="0.02" rgba="0.5 0.5 0.5 1"/>
    <body pos="0 0 1">
      <joint name="slide" type="slide" axis="1 0 0" limited="true" range="-1.8 1.8" damping="0.0005"/>
      <geom type="box" size="0.2 0.15 0.1" mass="1" rgba="0.2 0.4 0.8 1"/>
      <body>
        <joint name="hinge" axis="0 1 0" damping="0.000002"/>
        <geom type="capsule" fromto="0 0 0 0 0 1" size="0.08" mass="0.1" rgba="0.95 0.75 0.2 1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="slide" gear="10" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""


class CartPole(VectorEnv):  # type: ignore[misc]
    """A pole on a cart in each world, simulated by MuJoCo-Warp.

    Reward: from 0 to 1, the product of four shares, those of dm_control's cart-pole: upright, near the middle, little
    force, slow pole. Episodes last ``max_episode_length`` steps of 0.02 s, and end earlier where the pole leans more
    than ``max_lean``.

    Observations are positions and velocities, (world, 4) float32: for critics and checks, a policy from pixels does
    without. Actions are forces on the cart, (world, 1), from -1 to 1.

    Args:
        num_envs: Worlds.
        device: "cpu", "cuda:0", ...; None is the first GPU, or the CPU.
        seed: Of the states that episodes begin with.
        max_episode_length: Steps of an episode.
        max_lean: Angle between the pole and the vertical at which an episode ends [rad].
    """

    metadata = {"autoreset_mode": AutoresetMode.DISABLED}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int,
        *,
        device: str | None = None,
        seed: int = 0,
        max_episode_length: int = 250,
        max_lean: float = 0.6,
    ) -> None:
        self.num_envs, self.max_episode_length, self._max_lean = num_envs, max_episode_length, max_lean
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.host = mujoco.MjModel.from_xml_string(SCENE)
        self._device = resolve(device)
        with wp.ScopedDevice(self._device):
            self.model = mjw.put_model(self.host)
            self.data = mjw.make_data(self.host, nworld=num_envs)
            # These tensors are the simulator's memory: writing them is writing its state.
            self._position, self._velocity = wp.to_torch(self.data.qpos), wp.to_torch(self.data.qvel)
            self._control = wp.to_torch(self.data.ctrl)
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long, device=self._position.device)
        self._spread = torch.tensor((0.1, 0.034), device=self._position.device)  # of places [m] and angles [rad]
        self._random = torch.Generator(self._position.device).manual_seed(seed)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes in all worlds, or in those of ``options["reset_mask"]``."""
        if seed is not None:
            self._random.manual_seed(seed)
        device = self._position.device
        mask = torch.as_tensor((options or {}).get("reset_mask", torch.ones(self.num_envs, dtype=torch.bool)))
        mask = mask.to(device)
        start = torch.randn((2, *self._position.shape), generator=self._random, device=device)
        place, speed = self._spread * start[0], 0.01 * start[1]
        self._position.copy_(torch.where(mask[:, None], place, self._position))
        self._velocity.copy_(torch.where(mask[:, None], speed, self._velocity))
        self.episode_length_buf.masked_fill_(mask, 0)
        return self._observe(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Push the carts."""
        force = torch.as_tensor(actions, device=self._control.device).clamp(-1.0, 1.0)
        self._control.copy_(force)
        with wp.ScopedDevice(self._device), torch_interop.in_order(self._device):
            mjw.step(self.model, self.data)
        self.episode_length_buf += 1
        fallen, late = self._position[:, 1].abs() > self._max_lean, self.episode_length_buf >= self.max_episode_length
        return self._observe(), self._reward(force), fallen, late, {}

    def _reward(self, force: torch.Tensor) -> torch.Tensor:
        position, velocity = self._position, self._velocity
        upright = 0.5 * (1.0 + torch.cos(position[:, 1]))
        centered = 0.5 * (1.0 + _bell(position[:, 0] / 2.0))
        gentle = 0.2 * (4.0 + (1.0 - force[:, 0].square()).clamp(min=0.0))
        slow = 0.5 * (1.0 + _bell(velocity[:, 1] / 5.0))
        return upright * centered * gentle * slow

    def _observe(self) -> torch.Tensor:
        return torch.cat((self._position, self._velocity), dim=1)


def _bell(ratio: torch.Tensor) -> torch.Tensor:
    """Bell curve that is 1 at 0 and 0.1 at 1, as in dm_control's rewards."""
    return torch.pow(0.1, ratio.square())
