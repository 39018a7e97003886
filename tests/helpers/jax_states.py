"""A small MuJoCo scene in several worlds, and its states as JAX arrays."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc

SCENE = """
<mujoco>
  <asset>
    <texture name="check" type="2d" builtin="checker" rgb1=".8 .3 .2" rgb2=".1 .2 .6" width="32" height="32"/>
    <material name="check" texture="check" texrepeat="3 3"/>
    <material name="shiny" rgba=".2 .7 .3 1" specular=".9" shininess=".8"/>
    <mesh name="tent" vertex="0 0 0 .5 0 0 0 .5 0 0 0 .5"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="0 -1 3" dir="0 .3 -1" castshadow="true"/>
    <light name="sun" type="directional" pos="1 1 3" dir="-1 -1 -3" diffuse=".2 .2 .3"/>
    <camera name="front" pos="0 -2 1.2" xyaxes="1 0 0 0 .5 .85" fovy="55"/>
    <geom name="floor" type="plane" size="3 3 .1" material="check"/>
    <body name="box" pos="0 0 .5"><freejoint/>
      <geom name="box" type="box" size=".2 .15 .1" material="shiny"/>
      <geom name="tent" type="mesh" mesh="tent" pos=".3 0 0" rgba=".9 .8 .1 1"/>
      <site name="mark" pos="0 0 .2" size=".06" rgba="1 0 1 1"/>
      <camera name="wrist" pos="0 0 1" quat="1 0 0 0" fovy="60"/>
    </body>
  </worldbody>
</mujoco>
"""
STATE = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir", "xpos", "xmat", "site_xpos")
STATE += ("site_xmat",)
WORLDS = 3


def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE)


def states(mjm: mujoco.MjModel, count: int = WORLDS) -> list[mujoco.MjData]:
    """Worlds in each of which the free joint is elsewhere."""
    found = []
    for world in range(count):
        mjd = mujoco.MjData(mjm)
        mjd.qpos[:] = (0.15 * world - 0.1, 0.1 * world, 0.5 + 0.05 * world, 1.0, 0.2 * world, 0.1, 0.3 * world)
        mujoco.mj_forward(mjm, mjd)
        found.append(mjd)
    return found


def arrays(mjds: Sequence[mujoco.MjData], names: Sequence[str] = STATE) -> dict[str, jax.Array]:
    """Arrays (world, ...) by MuJoCo's names."""
    return {name: jnp.asarray(np.stack([getattr(mjd, name) for mjd in mjds]), jnp.float32) for name in names}


def cameras(*outputs: str) -> list[wc.Camera]:
    size: dict[str, Any] = {"width": 24, "height": 16, "outputs": outputs or ("rgb", "depth")}
    return [wc.Camera("front", shadows=True, **size), wc.Camera("wrist", **size)]


def on(device: wp.Device) -> Any:
    """A context in which JAX works on that device; skips where JAX has no such."""
    try:
        return jax.default_device(wp.device_to_jax(device))
    except RuntimeError as error:
        pytest.skip(f"{error}: pip install 'jax[cuda]'")
