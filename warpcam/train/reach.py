"""Reach: an arm of seven joints is to bring its tool to a sphere, which the camera on its wrist sees."""

from collections.abc import Mapping
from typing import Any, ClassVar

import mujoco
import torch

from warpcam.core import torch_interop
from warpcam.train.arm import HOME_FORWARD, JOINTS, compile_arm
from warpcam.train.images import Normalize
from warpcam.train.mujoco_task import MujocoTask

CAMERA, VIEW = "wrist", "overview"
NEAR, FAR = 0.05, 1.2  # range of depth that the policy sees [m]
OPTIONS = '<option timestep="0.02" integrator="implicitfast"><flag contact="disable"/></option>'
HAND = f"""
<camera name="{CAMERA}" pos="-0.07 0 0" xyaxes="0 -1 0 -1 0 0" fovy="100"/>
<geom type="capsule" fromto="0 0 0.02 0 0 0.1" size="0.015" mass="0.1" rgba="0.95 0.75 0.2 1" class="link"/>
<site name="tool" pos="0 0 0.12" size="0.005"/>
"""
WORLD = """
<geom type="plane" size="2 2 1" rgba="0.25 0.3 0.35 1"/>
<body name="target" mocap="true"><geom size="0.05" rgba="0.85 0.2 0.2 1" class="link"/></body>
"""


class Reach(MujocoTask):
    """An arm's tool is to be brought to a sphere of radius 0.05 m and kept in it; the sphere's place is random.

    The policy sees depth from the wrist, and ``proprioception``, (world, 17): angles of the joints less those of the
    first pose [rad], their velocities [0.2 rad/s], and the tool's place [m]. ``state``, (world, 23), which critics see,
    has beside that the sphere's place and the way to it from the tool [m].

    Reward: from 0 to 1, of the distance d between tool and sphere: 0.4 (1 - tanh(d / 0.3)) + 0.3 (1 - tanh(d / 0.1)),
    and 0.3 within the sphere; times 0.8 to 1 for slow targets of the joints. Success is a tool within the sphere.
    Episodes end when their time is up: 100 steps of 0.04 s.

    Actions are changes of the targets of the servos, (world, 7), of 0.08 rad at most in a step.
    """

    length, substeps, num_actions, num_starts = 100, 2, JOINTS, JOINTS + 3
    num_states, num_proprioception = 2 * JOINTS + 9, 2 * JOINTS + 3
    camera, view, output = CAMERA, VIEW, "depth"
    operations = (Normalize(NEAR, FAR),)
    stack, iterations = 1, 300
    ppo: ClassVar[Mapping[str, Any]] = {
        "encoder": {"output_channels": [16, 32], "kernel_size": [5, 3], "stride": [2, 2], "activation": "elu"},
        "hidden": (256, 128),
        "gamma": 0.97,
        "entropy_coef": 0.0005,
    }
    speed = 0.08  # greatest change of a servo's target in a step [rad]
    radius = 0.05  # of the sphere [m]
    lowest, highest = (0.4, -0.25, 0.1), (0.7, 0.25, 0.35)  # corners of where spheres are [m]
    spread = 0.1  # of the first angles [rad]

    def _compile(self) -> mujoco.MjModel:
        return compile_arm(HAND, WORLD, options=OPTIONS)

    def _prepare(self) -> None:
        device, site = self._torch_device, self.host.site("tool").id
        self._home, self._lowest, self._highest = (
            torch.tensor(numbers, device=device) for numbers in (HOME_FORWARD, self.lowest, self.highest)
        )
        self._limits = torch.tensor(self.host.actuator_ctrlrange, dtype=torch.float32, device=device)
        self._tool = torch_interop.to_torch(self.data.site_xpos)[:, site]
        self._target = torch_interop.to_torch(self.data.mocap_pos)[:, 0]

    def _begin(self, mask: torch.Tensor, numbers: torch.Tensor) -> None:
        angles = self._home + self.spread * (2.0 * numbers[:, :JOINTS] - 1.0)
        self._set(mask, angles)
        here = mask[:, None]
        self._control.copy_(torch.where(here, angles, self._control))
        place = self._lowest + (self._highest - self._lowest) * numbers[:, JOINTS:]
        self._target.copy_(torch.where(here, place, self._target))

    def _act(self, actions: torch.Tensor) -> None:
        self._control.add_(actions, alpha=self.speed).clamp_(self._limits[:, 0], self._limits[:, 1])

    def _distance(self) -> torch.Tensor:
        """From the tool to the sphere's centre [m], (world,)."""
        return (self._target - self._tool).norm(dim=1)

    def _success(self) -> torch.Tensor:
        return self._distance() < self.radius

    def _reward(self, actions: torch.Tensor) -> torch.Tensor:
        distance = self._distance()
        coarse, fine = (1.0 - torch.tanh(distance / scale) for scale in (0.3, 0.1))
        calm = 1.0 - 0.2 * actions.square().mean(dim=1)
        return (0.4 * coarse + 0.3 * fine + 0.3 * self._success()) * calm

    def _proprioception(self) -> torch.Tensor:
        return torch.cat((self._position - self._home, 0.2 * self._velocity, self._tool), dim=1)

    def _observe(self) -> torch.Tensor:
        return torch.cat((self._proprioception(), self._target, self._target - self._tool), dim=1)
