"""A policy that acts on what 64 worlds see: MuJoCo-Warp steps, warpcam renders, a small network chooses the torques.

Nothing is copied on the way: the network reads the memory that the kernels wrote.
"""

import mujoco
import mujoco_warp as mjw
import torch
import warp as wp

import warpcam as wc

WORLDS, SIZE, STEPS, EVERY = 64, 32, 20, 5

SCENE = """
<mujoco>
  <option timestep="0.01" integrator="implicitfast"/>
  <worldbody>
    <camera name="side" pos="0 -2.5 0.6" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <geom type="plane" size="0 0 1" pos="0 0 -0.5"/>
    <body pos="0 0 0.6">
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


class Policy(torch.nn.Module):
    """Two convolutions and a linear layer, from depth (world, 1, SIZE, SIZE) to controls (world, 1)."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = torch.nn.Sequential(
            torch.nn.Conv2d(1, 8, 5, stride=2),
            torch.nn.ReLU(),
            torch.nn.Conv2d(8, 16, 3, stride=2),
            torch.nn.ReLU(),
            torch.nn.Flatten(),
            torch.nn.LazyLinear(1),
            torch.nn.Tanh(),
        )

    def forward(self, depth: torch.Tensor) -> torch.Tensor:
        """Controls in [-1, 1], (world, 1)."""
        return self.layers(depth)


def main() -> None:
    """Run the loop, and say what was seen."""
    torch.manual_seed(0)
    host = mujoco.MjModel.from_xml_string(SCENE)
    model = mjw.put_model(host)
    data = mjw.make_data(host, nworld=WORLDS)
    # wp.to_torch shares the memory too: writing `position` and `control` is writing the simulator's state.
    position, control = wp.to_torch(data.qpos), wp.to_torch(data.ctrl)
    position[:, 1] = torch.linspace(-0.5, 0.5, WORLDS)

    # Where nothing is hit, "max" gives the far distance instead of infinity, which no network likes.
    camera = wc.Camera("side", width=SIZE, height=SIZE, outputs=("depth",), far=4.0, depth_clipping="max")
    renderer = wc.Renderer(wc.from_mujoco_warp(host, model, data), [camera])
    # Channels first is a view, and the memory stays the same for every frame: it is taken once.
    depth = renderer.render(forward=True)["side"]["depth"].permute(0, 3, 1, 2)
    assert depth.data_ptr() == renderer.array("side", "depth").ptr

    policy = Policy().to(depth.device)
    with torch.no_grad():
        for _ in range(STEPS):
            renderer.render(forward=True)  # mjw.step leaves positions of geoms one step behind; forward catches up
            control.copy_(policy(depth))
            for _ in range(EVERY):
                mjw.step(model, data)
    tilt = position[:, 1].abs().mean().item()
    print(f"{STEPS} frames of {WORLDS} worlds on {depth.device}; mean tilt at the end: {tilt:.2f} rad")


if __name__ == "__main__":
    main()
