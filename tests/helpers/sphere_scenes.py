"""A ball over a slab in each of a few worlds: what tests of the renderer look at."""

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

import warpcam as wc

every_device = pytest.mark.parametrize("device", [device.alias for device in wp.get_devices()])
on_cuda = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")

MODEL = """
<mujoco>
  <worldbody>
    <camera name="top" pos="0 0 5" fovy="60"/>
    <camera name="side" pos="0 -4 1" xyaxes="1 0 0 0 0 1"/>
    <light pos="1 -1 4" dir="-1 1 -4"/>
    <body name="ball" pos="0 0 1"><freejoint/><geom size=".6" rgba="1 0 0 1"/></body>
    <geom type="box" size="3 3 .1" pos="0 0 -.5"/>
  </worldbody>
</mujoco>
"""
NUM_WORLDS = 4
BALL = 1  # its geom: those of the world come first


class Simulation:
    """A ball over a slab, in each world at another place."""

    def __init__(self, device: str, num_worlds: int = NUM_WORLDS):
        self.mjm = mujoco.MjModel.from_xml_string(MODEL)
        self.mjd = mujoco.MjData(self.mjm)
        mujoco.mj_forward(self.mjm, self.mjd)
        with wp.ScopedDevice(device):
            self.m = mjw.put_model(self.mjm)
            self.d = mjw.put_data(self.mjm, self.mjd, nworld=num_worlds)
        self.scene = wc.from_mujoco_warp(self.mjm, self.m, self.d)
        self.place(0.2 * np.arange(num_worlds))

    def place(self, x: np.ndarray) -> None:
        """Move the balls, each to its world's x."""
        positions = self.d.geom_xpos.numpy()
        positions[:, BALL, 0] = x
        self.d.geom_xpos.assign(positions)

    def renderer(self, outputs: tuple[str, ...] = ("depth", "segmentation"), **options: Any) -> wc.Renderer:
        return wc.Renderer(self.scene, [wc.Camera("top", width=16, height=12, outputs=outputs)], **options)


def host(images: Any, camera: str = "top") -> dict[str, np.ndarray]:
    return {name: tensor.cpu().numpy().copy() for name, tensor in images[camera].items()}
