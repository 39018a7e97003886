"""A small scene with a mesh, in worlds whose ball is each at another place, and cameras that look at it."""

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

import warpcam as wc

MODEL = """
<mujoco>
  <asset>
    <material name="mirror" reflectance=".5"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1  1 1 0"/>
  </asset>
  <worldbody>
    <light pos="1 1 4" dir="-1 -1 -4"/>
    <camera name="top" pos="0 0 5" fovy="60"/>
    <camera name="side" pos="0 -4 1" xyaxes="1 0 0 0 0 1"/>
    <body pos="0 0 1"><freejoint/><geom size=".6" rgba="1 0 0 1"/></body>
    <body pos="-1 1 1"><freejoint/><geom type="mesh" mesh="wedge"/></body>
    <geom type="box" size="3 3 .1" pos="0 0 -.5"/>
  </worldbody>
</mujoco>
"""
MIRROR = '<geom type="plane" size="9 9 .1" pos="0 0 -1" material="mirror"/>'
GLASS = '<geom size=".2" pos="1 -1 1" rgba="1 1 1 .5"/>'


def scene_of(device: Any, num_worlds: int, more: str = "", worlds: range | None = None) -> wc.Scene:
    """The model in worlds whose ball is each at another place, or in some of these worlds alone."""
    worlds = range(num_worlds) if worlds is None else worlds
    mjm = mujoco.MjModel.from_xml_string(MODEL.replace("</worldbody>", more + "</worldbody>"))
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=len(worlds))
    positions = d.geom_xpos.numpy()
    positions[:, mjm.geom_bodyid.tolist().index(1), 0] += np.linspace(-1.0, 1.0, num_worlds)[worlds]
    d.geom_xpos.assign(positions)
    return wc.from_mujoco_warp(mjm, m, d)


def camera(name: str = "top", width: int = 24, height: int = 20, **options: Any) -> wc.Camera:
    return wc.Camera(name, width=width, height=height, **options)
