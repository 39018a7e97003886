"""Cart-poles from pixels: a vector env of Gymnasium over MuJoCo-Warp, with what a camera sees among its observations.

The env itself knows nothing of images. It resets the worlds it is told to; the wrapper does so where an episode has
ended, and keeps the image of its last state. Everything stays on the simulation's device.
"""

from typing import Any

import gymnasium
import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

import warpcam as wc
from warpcam.envs import PixelObservation

WORLDS, STEPS, SIZE = 16, 40, 32

SCENE = """
<mujoco>
  <option timestep="0.01" integrator="implicitfast"/>
  <worldbody>
    <camera name="side" pos="0 -2.5 0.6" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <geom type="plane" size="0 0 1" pos="0 0 -0.5"/>
    <body pos="0 0 0.3">
      <joint name="slide" type="slide" axis="1 0 0" range="-1 1" damping="1"/>
      <geom type="box" size="0.2 0.1 0.1" mass="1"/>
      <body>
        <joint name="hinge" axis="0 1 0" damping="0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.05" mass="0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="slide" gear="10" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""


class CartPoles(VectorEnv):
    """A pole on a cart in each world. An episode ends where the pole leans too far, at the latest after 50 steps.

    Observations are positions and velocities, (world, 4) float32; actions push the cart, (world, 1).
    """

    metadata = {"autoreset_mode": AutoresetMode.DISABLED}  # noqa: RUF012
    lean, longest, substeps = 0.35, 50, 2  # [rad], steps, of the simulation for each step

    def __init__(self, num_envs: int) -> None:
        self.num_envs = num_envs
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.host = mujoco.MjModel.from_xml_string(SCENE)
        self.model = mjw.put_model(self.host)
        self.data = mjw.make_data(self.host, nworld=num_envs)
        # wp.to_torch shares the memory: writing these tensors is writing the simulator's state.
        self._position, self._velocity = wp.to_torch(self.data.qpos), wp.to_torch(self.data.qvel)
        self._control = wp.to_torch(self.data.ctrl)
        self._age = torch.zeros(num_envs, dtype=torch.int32, device=self._position.device)
        self._random = torch.Generator(self._position.device)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes in all worlds, or in those of ``options["reset_mask"]``."""
        if seed is not None:
            self._random.manual_seed(seed)
        device = self._age.device
        mask = torch.as_tensor((options or {}).get("reset_mask", torch.ones(self.num_envs, dtype=torch.bool)))
        mask = mask.to(device)
        start = 0.4 * torch.rand(self._position.shape, generator=self._random, device=device) - 0.2
        self._position.copy_(torch.where(mask[:, None], start, self._position))
        self._velocity.masked_fill_(mask[:, None], 0.0)
        self._age.masked_fill_(mask, 0)
        return self._observe(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Push the carts."""
        self._control.copy_(torch.as_tensor(actions))
        for _ in range(self.substeps):
            mjw.step(self.model, self.data)
        self._age += 1
        leaning = self._position[:, 1].abs()
        return self._observe(), 1.0 - leaning, leaning > self.lean, self._age >= self.longest, {}

    def _observe(self) -> torch.Tensor:
        return torch.cat((self._position, self._velocity), dim=1)


def main() -> None:
    """Act at random, and say what was seen."""
    poles = CartPoles(WORLDS)
    scene = wc.from_mujoco_warp(poles.host, poles.model, poles.data)
    # Where nothing is hit, "max" gives the far distance instead of infinity.
    camera = wc.Camera("side", width=SIZE, height=SIZE, outputs=("depth",), far=4.0, depth_clipping="max")
    env = PixelObservation(
        poles,
        wc.Renderer(scene, [camera]),
        arrays="torch",
        layout="CHW",
        autoreset_mode=AutoresetMode.SAME_STEP,
        forward=True,  # mjw.step leaves positions of geoms one step behind
    )
    env.action_space.seed(0)
    observation, _ = env.reset(seed=0)
    ended, leans = 0, []
    for _ in range(STEPS):
        observation, _, terminations, truncations, infos = env.step(env.action_space.sample())
        done = terminations | truncations
        if "final_obs" in infos and done.any():
            ended += int(done.sum())
            leans.append(infos["final_obs"]["state"][done, 1].abs().mean().item())
    image = observation["side_depth"]
    print(f"{env.single_observation_space}")
    print(f"{STEPS} steps of {WORLDS} worlds on {image.device}: images {tuple(image.shape)}, {ended} episodes ended")
    print(f"mean lean in their last images: {np.mean(leans):.2f} rad")


if __name__ == "__main__":
    main()
