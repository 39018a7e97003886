"""Poses of geoms, sites, cameras and lights from those of bodies, against MuJoCo's own."""

from typing import Any

import numpy as np
import pytest

jax = pytest.importorskip("jax", reason="pip install 'warpcam[jax]'")

import jax.numpy as jnp
import mujoco
from jax_states import arrays, cameras, model, states

from warpcam.errors import WarpcamError
from warpcam.jax import Renderer
from warpcam.jax.poses import pose_of

MODES = ("fixed", "track", "trackcom", "targetbody", "targetbodycom")


def scene() -> mujoco.MjModel:
    """Cameras and lights of every mode on a body that moves, and some that look at another."""
    things = "".join(
        f'<camera name="c{i}" mode="{mode}" {"target=" + chr(34) + "aim" + chr(34) if "target" in mode else ""} '
        f'pos="{0.1 * i} .2 .3" quat="1 .1 .2 {0.1 * i}"/>'
        f'<light name="l{i}" mode="{mode}" {"target=" + chr(34) + "aim" + chr(34) if "target" in mode else ""} '
        f'pos=".1 {0.1 * i} 1" dir=".1 .2 -1"/>'
        for i, mode in enumerate(MODES)
    )
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco><worldbody>
      <geom type="plane" size="1 1 .1" pos="0 0 -.2" euler="5 0 0"/>
      <body name="mover" pos="0 0 .5"><freejoint/>{things}
        <geom type="box" size=".1 .2 .1" pos=".1 .2 0" euler="10 20 30"/><site pos=".1 0 .2" euler="0 30 10"/>
        <body pos=".4 0 0"><joint axis="0 1 0"/><geom size=".1" pos="0 0 .2"/></body>
      </body>
      <body name="aim" pos="1 1 0"><joint type="slide" axis="0 0 1"/><geom size=".1" pos=".1 .1 .1"/></body>
    </worldbody></mujoco>""")


def moved(mjm: mujoco.MjModel) -> mujoco.MjData:
    mjd = mujoco.MjData(mjm)
    mjd.qpos[:] = (0.3, -0.2, 0.7, 0.8, 0.3, -0.2, 0.1, 0.5, 0.4)
    mujoco.mj_forward(mjm, mjd)
    return mjd


@pytest.mark.parametrize("rotations", ["xquat", "xmat"])
def test_poses_are_mujocos(rotations: str) -> None:
    mjm = scene()
    mjd = moved(mjm)
    state = {name: jnp.asarray(getattr(mjd, name), jnp.float32) for name in ("xpos", "subtree_com", rotations)}
    state = {name: array.reshape(-1, 3, 3) if name == "xmat" else array for name, array in state.items()}
    names = [f"{kind}_{pose}" for kind in ("geom", "site", "cam") for pose in ("xpos", "xmat")]
    for name in (*names, "light_xpos", "light_xdir", "xmat"):
        expected = getattr(mjd, name)
        found = np.asarray(pose_of(name, mjm, state, {})).reshape(expected.shape)
        np.testing.assert_allclose(found, expected, atol=2e-6, err_msg=name)
    assert pose_of("flexvert_xpos", mjm, state, {}) is None


def test_places_of_the_model_count() -> None:
    mjm = scene()
    fields = {
        "cam_pos": mjm.cam_pos + 0.1,
        "light_dir": mjm.light_dir + np.array((0.3, 0.0, 0.0)),
        "geom_pos": mjm.geom_pos - 0.1,
    }
    mjd, varied = moved(mjm), scene()
    for name, values in fields.items():
        getattr(varied, name)[:] = values
    expected = moved(varied)
    state = {name: jnp.asarray(getattr(mjd, name), jnp.float32) for name in ("xpos", "xquat", "subtree_com")}
    fixed = {name: jnp.asarray(values, jnp.float32) for name, values in fields.items()}
    for name in ("cam_xpos", "light_xdir", "geom_xpos"):
        found = np.asarray(pose_of(name, mjm, state, fixed))
        np.testing.assert_allclose(found[0], getattr(expected, name)[0], atol=2e-6, err_msg=name)


def test_bodies_alone_are_drawn() -> None:
    mjm = model()
    mjds = states(mjm)
    render = Renderer(mjm, cameras("depth"))
    whole = jax.jit(jax.vmap(render))(arrays(mjds))
    bodies = jax.jit(jax.vmap(render))(arrays(mjds, ("xpos", "xquat")))
    for key in ("front", "wrist"):
        one, other = np.asarray(whole[key]["depth"]), np.asarray(bodies[key]["depth"])
        assert (~np.isclose(one, other, rtol=1e-4)).mean() < 0.01


def test_a_centre_of_mass_that_is_needed_is_asked_for() -> None:
    mjm = scene()
    mjd: Any = moved(mjm)
    state = {name: jnp.asarray(getattr(mjd, name), jnp.float32) for name in ("xpos", "xquat")}
    with pytest.raises(WarpcamError, match="a camera follows a centre of mass, and data has no subtree_com"):
        pose_of("cam_xpos", mjm, state, {})
