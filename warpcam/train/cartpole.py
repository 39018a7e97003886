"""Cart-pole: a pole on a cart is to stay upright, or to be swung up, and the policy sees an image alone."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import mujoco
import torch

from warpcam.train.images import Grey, Normalize
from warpcam.train.mujoco_task import MujocoTask

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


class CartPole(MujocoTask):
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

    length, num_actions, num_starts, num_states = 250, 1, 4, 4
    camera = view = CAMERA
    operations = (Grey(), Normalize())
    iterations = 200
    hangs: ClassVar[bool] = False  # whether the pole hangs down when an episode begins

    def __init__(
        self,
        num_envs: int,
        *,
        device: str | None = None,
        seed: int = 0,
        max_episode_length: int | None = None,
        max_lean: float = 0.6,
    ) -> None:
        self._max_lean = max_lean
        super().__init__(num_envs, device=device, seed=seed, max_episode_length=max_episode_length)

    def _compile(self) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(SCENE)

    def _prepare(self) -> None:
        spread = (0.1, 0.034, 0.01, 0.01)  # of places [m], angles [rad] and their velocities
        self._spread = torch.tensor(spread, device=self._torch_device)
        self._middle = torch.tensor((0.0, math.pi if self.hangs else 0.0, 0.0, 0.0), device=self._torch_device)

    def _begin(self, mask: torch.Tensor, numbers: torch.Tensor) -> None:
        start = self._middle + self._spread * _normal(numbers)
        self._set(mask, start[:, :2], start[:, 2:])

    def _ended(self) -> torch.Tensor:
        return self._position[:, 1].abs() > self._max_lean

    def _reward(self, actions: torch.Tensor) -> torch.Tensor:
        position, velocity = self._position, self._velocity
        upright = 0.5 * (1.0 + torch.cos(position[:, 1]))
        centered = 0.5 * (1.0 + _bell(position[:, 0] / 2.0))
        gentle = 0.2 * (4.0 + (1.0 - actions[:, 0].square()).clamp(min=0.0))
        slow = 0.5 * (1.0 + _bell(velocity[:, 1] / 5.0))
        return upright * centered * gentle * slow

    def _observe(self) -> torch.Tensor:
        return torch.cat((self._position, self._velocity), dim=1)


class SwingUp(CartPole):
    """A pole that hangs down from a cart, and is to be swung up and balanced: else as ``CartPole``.

    Episodes end when their time is up. Observations are the cart's place and velocity, sine and cosine of the pole's
    angle, and its velocity, (world, 5).
    """

    length, num_states, iterations = 400, 5, 500
    hangs = True
    ppo: ClassVar[Mapping[str, Any]] = {"gamma": 0.99}

    def _ended(self) -> torch.Tensor:
        return self._none

    def _observe(self) -> torch.Tensor:
        angle = self._position[:, 1:]
        return torch.cat((self._position[:, :1], torch.sin(angle), torch.cos(angle), self._velocity), dim=1)


def _normal(numbers: torch.Tensor) -> torch.Tensor:
    """Turn numbers from 0 to 1, all as likely, into normal ones of mean 0 and deviation 1, none beyond 5."""
    return math.sqrt(2.0) * torch.erfinv((2.0 * numbers - 1.0).clamp(-0.9999994, 0.9999994))


def _bell(ratio: torch.Tensor) -> torch.Tensor:
    """Bell curve that is 1 at 0 and 0.1 at 1, as in dm_control's rewards."""
    return torch.pow(0.1, ratio.square())
