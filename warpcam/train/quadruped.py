"""Quadruped: a robot of four legs follows a commanded velocity over hills that its depth camera sees."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import mujoco
import numpy as np
import torch

import warpcam
from warpcam.sensors.depth_cameras import realsense_d435
from warpcam.sensors.rig import Rig
from warpcam.train.images import Normalize
from warpcam.train.mujoco_task import MujocoTask

CAMERA, VIEW = "front", "overview"
JOINTS = 12
STANCE = (0.0, 0.7, -1.4) * 4  # angles of abduction, hip and knee of each leg [rad]
STANDING = 0.33  # height of the torso above level ground in the stance [m]
HALF_SIZE, SAMPLES = 10.0, 101  # of the terrain [m]; rows and columns of its heights
HIGHEST = 0.2  # of the hills [m]
RANGE = 3.0  # greatest depth that the policy sees [m]


def compile_quadruped() -> mujoco.MjModel:
    """Compile a robot of no product: a torso, and four legs of three joints each, on a height field of hills.

    Only feet touch the ground. The joints of each leg are abduction, hip and knee, each with a servo of position.
    """
    legs, servos = "", ""
    for name, x, y in (("fl", 0.19, 0.1), ("fr", 0.19, -0.1), ("rl", -0.19, 0.1), ("rr", -0.19, -0.1)):
        side = math.copysign(0.04, y)
        legs += f"""
<body pos="{x} {y} 0">
  <joint name="{name}_abduction" axis="1 0 0" range="-0.8 0.8"/>
  <geom type="sphere" size="0.045" mass="0.4"/>
  <body pos="0 {side} 0">
    <joint name="{name}_hip" axis="0 1 0" range="-0.8 2.2"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.025" mass="0.5"/>
    <body pos="0 0 -0.2">
      <joint name="{name}_knee" axis="0 1 0" range="-2.5 -0.3"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.016" mass="0.15"/>
      <geom name="{name}_foot" pos="0 0 -0.2" size="0.025" mass="0.05" class="foot"/>
    </body>
  </body>
</body>"""
        for joint in ("abduction", "hip", "knee"):
            servos += f'<position name="{name}_{joint}" joint="{name}_{joint}" kp="80" kv="2" ctrlrange="-2.5 2.5"/>'
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco model="quadruped">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.005" integrator="implicitfast" iterations="20" ls_iterations="20"/>
  <visual><headlight ambient="0.4 0.4 0.4" diffuse="0.5 0.5 0.5" specular="0 0 0"/></visual>
  <default>
    <joint damping="0.5" armature="0.01"/>
    <geom contype="0" conaffinity="0" rgba="0.75 0.77 0.8 1"/>
    <default class="foot"><geom contype="1" conaffinity="1" friction="1" rgba="0.2 0.2 0.2 1"/></default>
    <default class="ground"><geom contype="1" conaffinity="1" rgba="0.45 0.5 0.4 1"/></default>
  </default>
  <asset>
    <hfield name="hills" nrow="{SAMPLES}" ncol="{SAMPLES}" size="{HALF_SIZE} {HALF_SIZE} {HIGHEST} 0.1"/>
  </asset>
  <worldbody>
    <geom type="hfield" hfield="hills" class="ground"/>
    <body name="torso" pos="0 0 1">
      <freejoint/>
      <camera name="{CAMERA}" pos="0.22 0 0.05" xyaxes="0 -1 0 0.5 0 0.866"/>
      <camera name="{VIEW}" mode="trackcom" pos="1 -1.6 0.9" xyaxes="0.85 0.53 0 -0.23 0.37 0.9"/>
      <geom type="box" size="0.22 0.08 0.05" mass="6" rgba="0.2 0.4 0.8 1"/>
      {legs}
    </body>
  </worldbody>
  <actuator>{servos}</actuator>
</mujoco>""")
    model.hfield_data[:] = hills().ravel()
    return model


def hills() -> np.ndarray:
    """Heights of the terrain from 0 to 1, (row, column) float32; rows follow y, columns x."""
    across = np.linspace(-HALF_SIZE, HALF_SIZE, SAMPLES)
    x, y = np.meshgrid(across, across)
    waves = ((1.0, 1.3, 0.4, 0.0), (1.0, -0.7, 1.5, 1.0), (0.6, 2.4, 2.1, 2.0), (0.4, -3.1, 2.6, 3.0))
    heights = np.sum([size * np.sin(along * x + over * y + phase) for size, along, over, phase in waves], axis=0)
    return ((heights - heights.min()) / np.ptp(heights)).astype(np.float32)


class Quadruped(MujocoTask):
    """Four legs carry a torso over hills at a commanded speed ahead and turning rate, which are random.

    The policy sees depth as a RealSense D435 measures it, with holes, noise and steps, and ``proprioception``,
    (world, 44): the vertical in the torso's frame, its angular velocity [rad/s], the joints' angles less those of the
    stance [rad], their velocities [10 rad/s], the last actions, and the command: speed [m/s] and rate [rad/s].
    ``state``, (world, 48), has beside that the torso's velocity ahead, to the left and up [m/s], and its height above
    the ground [m].

    Reward: from 0 to 1, of the errors e of speed [m/s] and r of the rate [rad/s]: 0.6 exp(-e² / 0.25) +
    0.2 exp(-r² / 0.2) + 0.2, times the share of the vertical along the torso's own, times 0.8 to 1 for actions that
    change slowly. Success is e below 0.2 m/s. Episodes last 250 steps of 0.02 s and end earlier where the torso leans
    more than 60 degrees or is less than 0.15 m above the ground.

    Actions are targets of the servos beside the stance, (world, 12), of 0.4 rad at most.
    """

    length, substeps, num_actions, num_starts = 250, 4, JOINTS, 5 + JOINTS
    num_states, num_proprioception = 48, 44
    max_contacts, max_constraints = 32, 160
    camera, view, output = CAMERA, VIEW, "depth"
    operations = (Normalize(0.0, RANGE),)
    stack, iterations = 1, 800
    ppo: ClassVar[Mapping[str, Any]] = {
        "encoder": {"output_channels": [8, 16], "kernel_size": [5, 3], "stride": [2, 2], "activation": "elu"},
        "hidden": (256, 128),
        "gamma": 0.98,
        "entropy_coef": 0.001,
        "num_steps_per_env": 24,
    }
    reach = 0.4  # of an action [rad]
    area = 4.0  # half the side of the square in which episodes begin [m]
    slowest, fastest = (0.2, -0.5), (0.8, 0.5)  # commands [m/s, rad/s]

    def _compile(self) -> mujoco.MjModel:
        return compile_quadruped()

    def eyes(self, width: int, height: int) -> Rig:
        """What a RealSense D435 measures on the torso."""
        model = realsense_d435()
        camera = model.camera(self.camera, width=width, height=height)
        return Rig(warpcam.Renderer(self.scene, [camera]), {self.camera: model}, seed=self.seed)

    def _prepare(self) -> None:
        device, worlds = self._torch_device, self.num_envs
        self._stance, self._slowest, self._fastest = (
            torch.tensor(numbers, device=device) for numbers in (STANCE, self.slowest, self.fastest)
        )
        self._heights = torch.tensor(HIGHEST * hills(), device=device)
        self._command = torch.zeros((worlds, 2), device=device)
        self._last, self._before = (torch.zeros((worlds, JOINTS), device=device) for _ in range(2))

    def _begin(self, mask: torch.Tensor, numbers: torch.Tensor) -> None:
        here, signed = mask[:, None], 2.0 * numbers - 1.0
        place, half_turn = self.area * signed[:, :2], 0.5 * math.pi * signed[:, 2:3]
        height = self._ground(place) + STANDING
        level = torch.zeros_like(place)
        rotation = torch.cat((torch.cos(half_turn), level, torch.sin(half_turn)), dim=1)  # wxyz
        angles = self._stance + 0.1 * signed[:, 5:]
        self._set(mask, torch.cat((place, height[:, None], rotation, angles), dim=1))
        command = self._slowest + (self._fastest - self._slowest) * numbers[:, 3:5]
        self._command.copy_(torch.where(here, command, self._command))
        for actions in (self._last, self._before):
            actions.masked_fill_(here, 0.0)

    def _act(self, actions: torch.Tensor) -> None:
        self._before.copy_(self._last)
        self._last.copy_(actions)
        self._control.copy_(self._stance + self.reach * actions)

    def _ground(self, place: torch.Tensor) -> torch.Tensor:
        """Height of the terrain's sample nearest to each place (world, 2) [m], (world,)."""
        cells = ((place / HALF_SIZE + 1.0) * (0.5 * (SAMPLES - 1))).nan_to_num(0.0)
        cells = cells.round().clamp(0, SAMPLES - 1).long()
        return self._heights[cells[:, 1], cells[:, 0]]

    def _above_ground(self) -> torch.Tensor:
        return self._position[:, 2] - self._ground(self._position[:, :2])

    def _up(self) -> torch.Tensor:
        """Vertical in the torso's frame, (world, 3)."""
        w, x, y, z = self._position[:, 3:7].unbind(dim=1)
        return torch.stack((2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)), dim=1)

    def _speeds(self) -> torch.Tensor:
        """Velocity ahead, to the left and up [m/s], (world, 3): along the torso's heading, which is level."""
        w, x, y, z = self._position[:, 3:7].unbind(dim=1)
        heading = torch.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
        cos, sin = torch.cos(heading), torch.sin(heading)
        along_x, along_y, up = self._velocity[:, :3].unbind(dim=1)
        return torch.stack((cos * along_x + sin * along_y, cos * along_y - sin * along_x, up), dim=1)

    def _error(self) -> torch.Tensor:
        """Of the speed [m/s], (world,)."""
        speeds = self._speeds()
        return torch.hypot(speeds[:, 0] - self._command[:, 0], speeds[:, 1])

    def _success(self) -> torch.Tensor:
        return self._error() < 0.2

    def _ended(self) -> torch.Tensor:
        return ~((self._up()[:, 2] >= 0.5) & (self._above_ground() >= 0.15))  # also where these are no numbers

    def _reward(self, actions: torch.Tensor) -> torch.Tensor:
        turning = self._velocity[:, 5] - self._command[:, 1]
        follows = 0.6 * torch.exp(-self._error().square() / 0.25) + 0.2 * torch.exp(-turning.square() / 0.2) + 0.2
        calm = 1.0 - 0.05 * (actions - self._before).square().mean(dim=1)
        return follows * self._up()[:, 2].clamp(min=0.0) * calm

    def _proprioception(self) -> torch.Tensor:
        joints, rates = self._position[:, 7:] - self._stance, self._velocity[:, 3:6]
        return torch.cat((self._up(), rates, joints, 0.1 * self._velocity[:, 6:], self._last, self._command), dim=1)

    def _observe(self) -> torch.Tensor:
        return torch.cat((self._proprioception(), self._speeds(), self._above_ground()[:, None]), dim=1)
