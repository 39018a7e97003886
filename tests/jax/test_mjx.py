"""Data and Model of MJX, of both implementations, as the state that is drawn."""

from typing import Any

import numpy as np
import pytest
import warp as wp

jax = pytest.importorskip("jax", reason="pip install 'warpcam[jax]'")
mjx = pytest.importorskip("mujoco.mjx", reason="pip install mujoco-mjx", exc_type=ImportError)

import jax.numpy as jnp
import jax_states
from jax_states import WORLDS, cameras, model, states

import warpcam as wc
from warpcam.errors import WarpcamError
from warpcam.jax import Renderer

POSES = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "xpos", "xmat", "site_xpos", "site_xmat")


@pytest.fixture(autouse=True)
def on_device(device: wp.Device) -> Any:
    with jax_states.on(device):
        yield


def forwarded(mjm: Any, impl: str) -> tuple[Any, Any]:
    """MJX's Model, and its Data of several worlds with poses that it has computed."""
    positions = jnp.asarray(np.stack([mjd.qpos for mjd in states(mjm)]), jnp.float32)
    mx = mjx.put_model(mjm, impl=impl)
    start = mjx.make_data(mjm, impl=impl)
    return mx, jax.jit(jax.vmap(lambda qpos: mjx.forward(mx, start.replace(qpos=qpos))))(positions)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("impl", ["jax", "warp"])
def test_data_of_mjx_is_drawn_as_the_plain_renderer_draws_these_poses(impl: str) -> None:
    mjm, looks = model(), cameras("rgb", "depth", "segmentation")
    _, data = forwarded(mjm, impl)
    images = jax.jit(jax.vmap(Renderer(mjm, looks)))(data)
    mjds = states(mjm)
    for world, mjd in enumerate(mjds):
        for name in POSES:
            np.testing.assert_allclose(getattr(data, name)[world].ravel(), getattr(mjd, name).ravel(), atol=1e-5)
            getattr(mjd, name)[:] = np.asarray(getattr(data, name)[world]).reshape(getattr(mjd, name).shape)
        if impl == "warp":  # which has poses of lights, too
            mjd.light_xpos[:], mjd.light_xdir[:] = data._impl.light_xpos[world], data._impl.light_xdir[world]
    expected = wc.Renderer(wc.from_mujoco(mjm, mjds), looks).render()
    for key, outputs in expected.items():
        for name, image in outputs.items():
            np.testing.assert_array_equal(images[key][name], image.cpu().numpy(), err_msg=f"{key} {name}")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("impl", ["jax", "warp"])
def test_a_model_that_domain_randomisation_has_varied(impl: str) -> None:
    mjm, looks = model(), cameras("rgb")
    mx, data = forwarded(mjm, impl)
    colors = jnp.asarray(np.random.default_rng(3).uniform(0.2, 1.0, (WORLDS, mjm.ngeom, 4)), jnp.float32)
    colors = colors.at[..., 3].set(1.0)
    axes = jax.tree.map(lambda _: None, mx).tree_replace({"geom_rgba": 0, "light_diffuse": 0})
    light = jnp.asarray(np.random.default_rng(4).uniform(0.1, 0.9, (WORLDS, mjm.nlight, 3)), jnp.float32)
    varied = mx.tree_replace({"geom_rgba": colors, "light_diffuse": light})
    render = Renderer(mjm, looks)
    images = jax.jit(lambda data: jax.vmap(render, in_axes=(0, axes))(data, varied))(data)
    fields = {"geom_rgba": colors, "light_diffuse": light}
    expected = jax.jit(jax.vmap(render))(data, fields)
    for key in ("front", "wrist"):
        np.testing.assert_array_equal(images[key]["rgb"], expected[key]["rgb"])
    assert not np.array_equal(images["front"]["rgb"][0], images["front"]["rgb"][1])
    unchanged = jax.jit(jax.vmap(lambda data: render(data, mx)))(data)
    plain = jax.jit(jax.vmap(render))(data)
    np.testing.assert_array_equal(unchanged["front"]["rgb"], plain["front"]["rgb"])


def test_what_is_no_model_is_told() -> None:
    mjm = model()
    with pytest.raises(WarpcamError, match=r"model must be an mjx.Model or a mapping of arrays .* got float"):
        Renderer(mjm, cameras())(jax_states.arrays(states(mjm)), 1.0)
