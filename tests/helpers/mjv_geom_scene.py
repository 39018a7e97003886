"""A MuJoCo scene, what programs put into its abstract one, and the renderer that judges."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

DECOR = int(mujoco.mjtCatBit.mjCAT_DECOR)
GEOM = mujoco.mjtGeom
XML = """
<mujoco>
  <visual>
    <global offwidth="96" offheight="72"/><quality offsamples="0" numslices="100" numstacks="100" shadowsize="2048"/>
    <map force=".02"/><scale contactwidth=".4" contactheight=".1" forcewidth=".2" jointlength="1.5" com=".8"/>
  </visual>
  <asset>
    <texture name="checks" type="2d" builtin="checker" width="32" height="32" rgb1=".9 .2 .1" rgb2=".1 .3 .9"/>
    <material name="checked" texture="checks"/>
    <mesh name="wedge" vertex="0 0 0 .3 0 0 0 .3 0 0 0 .4"/>
    <hfield name="hills" nrow="4" ncol="4" size=".3 .3 .3 .05"
      elevation="0 .5 .2 0 .1 1 .4 .3 .2 .1 .6 .9 0 0 .4 .2"/>
  </asset>
  <worldbody>
    <light pos="0 0 3" dir=".2 .1 -1" directional="true"/>
    <geom name="floor" type="plane" size="2 2 .1" rgba=".6 .6 .7 1"/>
    <geom name="box" type="box" size=".15 .15 .25" pos="-.9 .6 .3" rgba="1 .5 .2 1"/>
    <geom name="ball" size=".15" pos="-.5 .8 .2" rgba="0 .5 1 1"/>
    <geom name="pill" type="capsule" size=".1 .1" pos="-.1 .9 .3" rgba="0 1 .5 1"/>
    <geom name="can" type="cylinder" size=".1 .1" pos=".3 .9 .3" rgba=".5 1 0 1"/>
    <geom name="egg" type="ellipsoid" size=".1 .15 .2" pos=".7 .8 .3" rgba="1 0 .5 .6"/>
    <geom name="wedge" type="mesh" mesh="wedge" pos="1.1 .6 .1" rgba=".2 .7 .3 1"/>
    <geom name="hills" type="hfield" hfield="hills" pos="1.2 -.4 .1" rgba=".7 .6 .3 1"/>
    <site name="mark" pos=".9 .2 .3" size=".08" rgba="1 0 1 1"/>
    <site name="away" pos="-.3 -.2 .5" zaxis=".6 -.3 -.4"/>
    <body pos=".4 -.3 .199"><freejoint/><geom name="load" type="box" size=".2 .2 .2" rgba=".8 .8 .2 .5"/></body>
    <body pos="-.4 -.4 .6"><joint name="hinge" axis="0 1 0"/><geom name="arm" size=".05" pos="0 0 .2"/></body>
    <camera name="fixed" pos="0 -2.6 2" xyaxes="1 0 0 0 .6 1"/>
  </worldbody>
  <actuator><motor joint="hinge" ctrlrange="-1 1"/></actuator>
</mujoco>
"""


def made() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.8
    mujoco.mj_forward(model, data)
    return model, data


def add(scene: mujoco.MjvScene, kind: Any, size: Any, pos: Any, rgba: Any = (1, 0, 0, 1), **more: Any) -> Any:
    """Add a geom as programs do; ``shown``: in images of ids, too."""
    geom = scene.geoms[scene.ngeom]
    if more.pop("shown", False):
        more["segid"] = scene.ngeom
    mat = np.array(more.pop("mat", np.eye(3)), np.float64)
    mujoco.mjv_initGeom(geom, int(kind), *(np.array(v, float) for v in (size, pos)), mat.ravel(), np.float32(rgba))
    for name, value in {"category": DECOR, "segid": -1, "objid": -1, "objtype": 0, **more}.items():
        setattr(geom, name, value)
    scene.ngeom += 1
    return geom


def connect(scene: mujoco.MjvScene, kind: Any, width: float, start: Any, end: Any, **more: Any) -> None:
    geom = add(scene, kind, (0, 0, 0), (0, 0, 0), **more)
    mujoco.mjv_connector(geom, int(kind), width, np.array(start, float), np.array(end, float))


def tilted() -> np.ndarray:
    mat = np.zeros(9)
    mujoco.mju_quat2Mat(mat, np.array((0.8, 0.3, -0.4, 0.33)))
    return mat


def judging(model: mujoco.MjModel, height: int, width: int) -> Iterator[Any]:
    """MuJoCo's own renderer, closed afterwards, or None where there is no library for it; what a fixture yields."""
    try:
        renderer = mujoco.Renderer(model, height, width)
    except Exception:
        yield None
    else:
        yield renderer
        renderer.close()
