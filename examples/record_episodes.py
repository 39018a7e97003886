"""Episodes of sixteen cart-poles at once as a LeRobot dataset: what a camera sees, states, actions, rewards and ends.

It needs ``pip install 'warpcam[mujoco,datasets]'``.
"""

from pathlib import Path

import mujoco
import mujoco_warp as mjw
import torch
import warp as wp

import warpcam as wc
from warpcam.datasets import Writer

WORLDS, STEPS, FPS = 16, 60, 50
OUTPUT = Path("cartpole-episodes")

SCENE = """
<mujoco>
  <option timestep="0.01" integrator="implicitfast"/>
  <worldbody>
    <light pos="0 -1 2"/>
    <camera name="side" pos="0 -2.5 0.6" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <geom type="plane" size="0 0 1" pos="0 0 -0.5" rgba="0.5 0.6 0.5 1"/>
    <body pos="0 0 0.3">
      <joint name="slide" type="slide" axis="1 0 0" range="-1 1" damping="1"/>
      <geom type="box" size="0.2 0.1 0.1" mass="1" rgba="0.3 0.4 0.8 1"/>
      <body>
        <joint name="hinge" axis="0 1 0" damping="0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.05" mass="0.2" rgba="0.8 0.4 0.2 1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="slide" gear="10" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""


def main() -> None:
    """Push against the lean of each pole, badly, and record what happens."""
    host = mujoco.MjModel.from_xml_string(SCENE)
    model, data = mjw.put_model(host), mjw.make_data(host, nworld=WORLDS)
    scene = wc.from_mujoco_warp(host, model, data)
    renderer = wc.Renderer(scene, [wc.Camera("side", width=64, height=64, outputs=("rgb",))])
    # wp.to_torch shares the memory: writing these tensors is writing the simulator's state.
    position, velocity, control = (wp.to_torch(array) for array in (data.qpos, data.qvel, data.ctrl))
    age = torch.zeros(WORLDS, dtype=torch.int32, device=position.device)
    random = torch.Generator(position.device).manual_seed(0)

    def draw(shape: tuple[int, ...]) -> torch.Tensor:
        return 0.2 * torch.rand(shape, generator=random, device=position.device) - 0.1

    position.copy_(draw(position.shape))
    with Writer(OUTPUT, format="lerobot", fps=FPS, task="keep the pole upright") as writer:
        for _ in range(STEPS):
            images = renderer.render(forward=True)["side"]
            state = torch.cat((position, velocity), dim=1)
            # The renderer writes over the images at its next frame, so that they are taken now.
            writer.observe({"side_rgb": images["rgb"], "state": state})
            control.copy_((position[:, 1:] + 5.0 * draw((WORLDS, 1))).clamp(-1.0, 1.0))
            for _ in range(2):
                mjw.step(model, data)
            age += 1
            lean = position[:, 1].abs()
            fallen, old = lean > 0.35, age >= 40
            writer.step(actions=control, rewards=1.0 - lean, terminated=fallen, truncated=old & ~fallen)
            ended = fallen | old
            position.copy_(torch.where(ended[:, None], draw(position.shape), position))
            velocity.masked_fill_(ended[:, None], 0.0)
            age.masked_fill_(ended, 0)
    print(f"{writer.written} episodes of {WORLDS} worlds in {OUTPUT}")


if __name__ == "__main__":
    main()
