"""Pick: an arm is to grasp a cube and lift it, seen by a colour camera in worlds that look different."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import mujoco
import torch

import warpcam
from warpcam.core import torch_interop
from warpcam.render.camera_binding import CameraArrays
from warpcam.train.arm import BASE, LINKS, compile_arm
from warpcam.train.images import Normalize
from warpcam.train.mujoco_task import MujocoTask
from warpcam.train.options import ENCODERS

CAMERA, VIEW = "front", "overview"
PLACE, ROTATION, FOVY = (1.0, 0.0, 0.5), (0.638, 0.3048, 0.3048, 0.638), 38.0  # of the camera: [m], wxyz, [degrees]
HALF = 0.025  # of the cube's edge [m]
OPEN = 0.045  # of a finger, from the middle [m]
TOOL = 0.08  # from the hand's origin to the middle between the fingers [m]
SHOULDER = BASE + LINKS[0][2]  # height [m]
UPPER, LOWER = LINKS[1][2] + LINKS[2][2], LINKS[3][2] + LINKS[4][2]  # from shoulder to elbow, from elbow to wrist [m]
WRIST = LINKS[5][2] + LINKS[6][2] + TOOL  # from wrist to tool [m]
OPTIONS = (
    '<option timestep="0.01" integrator="implicitfast" cone="elliptic" impratio="10" iterations="50" '
    'ls_iterations="50">'
    '<flag nativeccd="disable"/></option>'  # boxes by a test of their own
)
FINGER = """
<body name="finger{side}" pos="0 0 0.035" gravcomp="1">
  <joint name="finger{side}" type="slide" axis="0 {sign} 0" range="0 0.045" armature="0.05" damping="2"/>
  <geom type="box" size="0.01 0.006 0.03" pos="0 {place} 0.03" mass="0.05" contype="2" conaffinity="0" condim="4"
        friction="1.5 0.02 0.001" rgba="0.25 0.25 0.28 1"/>
</body>
"""
HAND = (
    '<geom type="box" size="0.03 0.06 0.015" pos="0 0 0.02" mass="0.2" rgba="0.3 0.32 0.36 1" class="link"/>'
    + FINGER.format(side=0, sign=1, place=0.006)
    + FINGER.format(side=1, sign=-1, place=-0.006)
    + f'<site name="tool" pos="0 0 {TOOL}" size="0.005"/>'
)
SERVOS = "".join(
    f'<position name="grip{side}" joint="finger{side}" kp="400" kv="20" ctrlrange="0 {OPEN}" forcerange="-15 15"/>'
    for side in range(2)
)
WORLD = f"""
<light name="lamp" pos="0.6 -0.5 1.6" dir="-0.1 0.3 -1" diffuse="0.6 0.6 0.6" specular="0.1 0.1 0.1"/>
<geom name="table" type="box" size="0.5 0.6 0.02" pos="0.4 0 -0.02" rgba="0.45 0.44 0.42 1"/>
<body name="cube" pos="0.5 0 {HALF}">
  <freejoint name="cube"/>
  <geom name="cube" type="box" size="{HALF} {HALF} {HALF}" mass="0.1" condim="4" contype="1" conaffinity="3"
        friction="1 0.02 0.001" rgba="0.8 0.2 0.15 1"/>
</body>
"""


class Pick(MujocoTask):
    """A cube with an edge of 0.05 m lies on a table; an arm is to grasp it and to hold it 0.1 m above the table.

    The policy sees colours from a camera in front of the table, and ``proprioception``, (world, 8): the tool's place
    less the middle of where it may be [m], the way from it to its target [m], and the openings of the fingers [0.045
    m]. ``state``, (world, 15), which critics see, has beside that the way from the tool to the cube [m], its height
    above the table [m], and its velocity [m/s].

    Each episode has another look: colours of the cube, table and arm, direction and strength of the lamp, the light
    from all around, and the place and direction of the camera.

    Reward: from 0 to 1, of the distance d between tool and cube, g for a cube that is between closed fingers, and the
    cube's height h [m]: (1 - tanh(d / 0.1)) (0.25 + 0.25 g + 0.5 min(h / 0.1, 1)), times 0.9 to 1 for slow actions.
    Success is a cube 0.1 m above the table and at the tool. Episodes last 100 steps of 0.04 s, and end earlier where
    the cube has fallen from the table.

    Actions are changes of the tool's target along x, y and z, of 0.02 m at most in a step, and of the opening of each
    finger, of 0.01 m at most, (world, 4). The tool points down; the joints follow in closed form.

    Args:
        num_envs: Worlds.
        device: "cpu", "cuda:0", ...; None is the first GPU, or the CPU.
        seed: Of the states that episodes begin with, and of looks.
        max_episode_length: Steps of an episode; None is the task's own.
        looks: Whether each episode has another look.
    """

    length, substeps, num_actions, num_starts = 100, 4, 4, 7
    num_states, num_proprioception = 15, 8
    max_contacts, max_constraints = 24, 120
    camera, view = CAMERA, VIEW
    operations = (Normalize(),)
    stack, iterations = 1, 500
    ppo: ClassVar[Mapping[str, Any]] = {
        "encoder": ENCODERS["places"],
        "hidden": (256, 128),
        "gamma": 0.97,
        "entropy_coef": 0.001,
        "num_learning_epochs": 5,
        "num_mini_batches": 8,
    }
    speed, closing = 0.02, 0.01  # greatest changes in a step [m]
    lowest, highest = (0.38, -0.2, 0.02), (0.6, 0.2, 0.3)  # corners of where the tool may be [m]
    first, last = (0.42, -0.15), (0.56, 0.15)  # corners of where cubes are [m]
    lifted = 0.1  # height of a cube that is lifted [m]

    def __init__(
        self,
        num_envs: int,
        *,
        device: str | None = None,
        seed: int = 0,
        max_episode_length: int | None = None,
        looks: bool = True,
    ) -> None:
        self._looks = looks
        self._eye: CameraArrays | None = None
        super().__init__(num_envs, device=device, seed=seed, max_episode_length=max_episode_length)
        if looks:  # before a renderer is made, which is made for what is drawn
            self._place()  # of the lamp, from which its directions are turned
            self._draw_looks(self._all, torch.zeros(num_envs, device=self._torch_device))

    def eyes(self, width: int, height: int) -> warpcam.Renderer:
        """What the policy sees. Episodes move the camera of the renderer that was made last."""
        camera = warpcam.Camera(
            CAMERA,
            width=width,
            height=height,
            outputs=(self.output,),
            lens=warpcam.Pinhole(fovy=FOVY),
            position=PLACE,
            rotation=ROTATION,
            antialiasing=4,
        )
        renderer = warpcam.Renderer(self.scene, [camera])
        self._eye = renderer.camera(CAMERA)
        return renderer

    def _compile(self) -> mujoco.MjModel:
        return compile_arm(HAND, WORLD, actuators=SERVOS, options=OPTIONS)

    def _prepare(self) -> None:
        device, host = self._torch_device, self.host
        self._lowest, self._highest, self._first, self._last = (
            torch.tensor(numbers, device=device) for numbers in (self.lowest, self.highest, self.first, self.last)
        )
        place, turn = host.joint("cube").qposadr[0], host.joint("cube").dofadr[0]
        finger = host.joint("finger0").qposadr[0]
        self._fingers = self._position[:, finger : finger + 2]
        self._cube, self._speed = self._position[:, place : place + 3], self._velocity[:, turn : turn + 3]
        self._tool = torch_interop.to_torch(self.data.site_xpos)[:, host.site("tool").id]
        self._target = torch.zeros((self.num_envs, 3), device=device)
        self._opening = torch.zeros((self.num_envs, 1), device=device)
        cube = host.geom("cube").id
        self._shapes = [cube], [shape for shape in range(host.ngeom) if shape != cube]

    def _begin(self, mask: torch.Tensor, numbers: torch.Tensor) -> None:
        here, signed = mask[:, None], 2.0 * numbers - 1.0
        middle = 0.5 * (self._lowest + self._highest)
        start = middle + 0.25 * (self._highest - self._lowest) * signed[:, :3]
        self._target.copy_(torch.where(here, start, self._target))
        self._opening.masked_fill_(here, OPEN)
        place = self._first + (self._last - self._first) * numbers[:, 3:5]
        half_turn = 0.12 * signed[:, 5:6]  # [rad]
        level = torch.zeros_like(half_turn)
        cube = (place, level + HALF, torch.cos(half_turn), level, level, torch.sin(half_turn))
        self._set(mask, torch.cat((*cube, joints_of(start), level + OPEN, level + OPEN), dim=1))
        self._command(here)
        if self._looks:
            self._draw_looks(mask, numbers[:, 6])

    def _command(self, here: torch.Tensor) -> None:
        control = torch.cat((joints_of(self._target), self._opening, self._opening), dim=1)
        self._control.copy_(torch.where(here, control, self._control))

    def _draw_looks(self, mask: torch.Tensor, numbers: torch.Tensor) -> None:
        """Draw other looks in the worlds of the mask; a number from 0 to 1 of each is its seed."""
        seeds = (numbers * 2.0**24).to(torch.int32)
        bounds = ((0.5, 0.0, 0.0, 1.0), (1.0, 0.3, 0.3, 1.0)), ((0.25, 0.25, 0.25, 1.0), (0.9, 0.9, 0.9, 1.0))
        for shapes, (low, high) in zip(self._shapes, bounds, strict=True):
            colors = warpcam.Uniform(low, high, rows=shapes)
            warpcam.randomize(self.scene, seed=seeds, worlds=mask, shape_colors=colors)
        warpcam.randomize(
            self.scene,
            seed=seeds,
            worlds=mask,
            light_directions=warpcam.Uniform(0.0, 30.0, of="turn"),
            light_diffuse=warpcam.Uniform(0.6, 1.4, of="factor", linked=True),
            headlight=warpcam.Uniform(0.7, 1.4, of="factor", linked=True),
        )
        if self._eye is not None:
            warpcam.randomize(
                self._eye,
                seed=seeds,
                worlds=mask,
                position=warpcam.Uniform(-0.03, 0.03, of="offset"),
                rotation=warpcam.Uniform(0.0, 3.0, of="turn"),
            )

    def _act(self, actions: torch.Tensor) -> None:
        self._target.add_(actions[:, :3], alpha=self.speed)
        self._target.copy_(self._target.clamp(self._lowest, self._highest))
        self._opening.add_(actions[:, 3:], alpha=self.closing).clamp_(0.0, OPEN)
        self._command(self._all[:, None])

    def _height(self) -> torch.Tensor:
        """Of the cube above the table where it lay [m], (world,)."""
        return self._cube[:, 2] - HALF

    def _distance(self) -> torch.Tensor:
        """From the tool to the cube's centre [m], (world,)."""
        return (self._cube - self._tool).norm(dim=1)

    def _success(self) -> torch.Tensor:
        return (self._height() > self.lifted) & (self._distance() < 2.0 * HALF)

    def _ended(self) -> torch.Tensor:
        return ~(self._height() > -0.05)  # also where it is no number

    def _reward(self, actions: torch.Tensor) -> torch.Tensor:
        distance = self._distance()
        grasped = (distance < HALF) & (self._fingers.sum(dim=1) < 2.5 * HALF)
        stages = 0.25 + 0.25 * grasped + 0.5 * (self._height() / self.lifted).clamp(0.0, 1.0)
        return (1.0 - torch.tanh(distance / 0.1)) * stages * (1.0 - 0.1 * actions.square().mean(dim=1))

    def _proprioception(self) -> torch.Tensor:
        middle = 0.5 * (self._lowest + self._highest)
        return torch.cat((self._tool - middle, self._target - self._tool, self._fingers / OPEN), dim=1)

    def _observe(self) -> torch.Tensor:
        cube = (self._cube - self._tool, self._height()[:, None], self._speed)
        return torch.cat((self._proprioception(), *cube), dim=1)


def joints_of(place: torch.Tensor) -> torch.Tensor:
    """Return the arm's angles [rad], (world, 7), for a tool at a place (world, 3) [m].

    The tool points down, and its fingers lie along y. Shoulder, elbow and wrist are a triangle in a vertical
    plane, whose sides are known.
    """
    x, y, z = place.unbind(dim=1)
    turn = torch.atan2(y, x)
    ahead, up = torch.hypot(x, y), z + (WRIST - SHOULDER)
    far = torch.hypot(ahead, up)
    # Law of cosines at the elbow and at the shoulder.
    bend = math.pi - torch.acos(((UPPER**2 + LOWER**2 - far * far) / (2.0 * UPPER * LOWER)).clamp(-1.0, 1.0))
    raised = torch.acos(((UPPER**2 + far * far - LOWER**2) / (2.0 * UPPER * far)).clamp(-1.0, 1.0))
    shoulder = torch.atan2(ahead, up) - raised
    none = torch.zeros_like(x)
    return torch.stack((turn, shoulder, none, bend, none, math.pi - shoulder - bend, turn), dim=1)
