"""Images inside programs of JAX: those of the plain renderer, of the state that is given and of nothing else."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import warp as wp

jax = pytest.importorskip("jax", reason="pip install 'warpcam[jax]'")

import jax.numpy as jnp
import jax_states
import mujoco
from jax_states import WORLDS, arrays, cameras, model, states

import warpcam as wc
from warpcam.errors import WarpcamError
from warpcam.jax import Renderer
from warpcam.kernels.outputs import OUTPUTS

OF_ONE_STATE = tuple(name for name in OUTPUTS if name not in ("flow", "flow_valid", "instances", "semantics"))


@pytest.fixture(autouse=True)
def on_device(device: wp.Device) -> Iterator[None]:
    with jax_states.on(device):
        yield


def plain(mjm: mujoco.MjModel, mjds: Any, looks: Any) -> Any:
    """What ``warpcam.Renderer`` draws, as numpy arrays."""
    images = wc.Renderer(wc.from_mujoco(mjm, mjds), looks).render()
    return {key: {name: image.cpu().numpy() for name, image in outputs.items()} for key, outputs in images.items()}


def same(images: Any, expected: Any) -> None:
    assert images.keys() == expected.keys()
    for key, outputs in expected.items():
        assert images[key].keys() == outputs.keys()
        for name, image in outputs.items():
            np.testing.assert_array_equal(np.asarray(images[key][name]), image, err_msg=f"{key} {name}")
            assert images[key][name].dtype == image.dtype


def test_images_are_those_of_the_plain_renderer_bit_for_bit() -> None:
    mjm, looks = model(), cameras(*OF_ONE_STATE)
    mjds = states(mjm)
    render, expected = Renderer(mjm, looks), plain(mjm, mjds, looks)
    state = arrays(mjds)
    same(jax.jit(jax.vmap(render))(state), expected)
    same(jax.vmap(render)(state), expected)
    same(jax.jit(render)(state), expected)  # leading dimensions are worlds, too
    assert len(np.unique(np.asarray(render(state)["front"]["segmentation"]))) >= 4


def test_one_world_has_no_leading_dimension() -> None:
    mjm, looks = model(), cameras()
    mjds = states(mjm, 1)
    state = {name: array[0] for name, array in arrays(mjds).items()}
    images = jax.jit(Renderer(mjm, looks))(state)
    assert images["front"]["rgb"].shape == (16, 24, 3) and images["front"]["depth"].shape == (16, 24, 1)
    expected = plain(mjm, mjds, looks)
    same(images, {key: {name: image[0] for name, image in one.items()} for key, one in expected.items()})


def test_vmap_within_vmap_and_other_axes() -> None:
    mjm, looks = model(), cameras()
    mjds = states(mjm, 6)
    render, state = Renderer(mjm, looks, worlds=6), arrays(mjds)
    expected = plain(mjm, mjds, looks)
    grid = {name: array.reshape(2, 3, *array.shape[1:]) for name, array in state.items()}
    images = jax.jit(jax.vmap(jax.vmap(render)))(grid)
    same(
        {key: {name: image.reshape(6, *image.shape[2:]) for name, image in one.items()} for key, one in images.items()},
        expected,
    )
    last = {name: jnp.moveaxis(array, 0, -1) for name, array in state.items()}
    same(jax.jit(jax.vmap(render, in_axes=-1))(last), expected)
    half = jax.vmap(lambda one: render(one))(grid)  # three worlds of each instance in leading dimensions
    assert half["front"]["rgb"].shape == (2, 3, 16, 24, 3)


def test_what_vmap_does_not_map_is_drawn_in_all_worlds() -> None:
    mjm, looks = model(), cameras()
    mjds = states(mjm)
    render, state = Renderer(mjm, looks), arrays(mjds)
    moved, still = state.pop("geom_xpos"), {name: array[1] for name, array in state.items()}
    images = jax.jit(jax.vmap(lambda place, rest: render({**rest, "geom_xpos": place}), in_axes=(0, None)))(
        moved, still
    )
    everywhere = {name: jnp.stack([array] * WORLDS) for name, array in still.items()}
    expected = jax.jit(jax.vmap(render))({**everywhere, "geom_xpos": moved})
    same(images, jax.device_get(expected))
    outer = jax.jit(
        jax.vmap(
            jax.vmap(lambda place, rest: render({**rest, "geom_xpos": place}), in_axes=(None, 0)), in_axes=(0, None)
        )
    )
    grid = outer(moved, state)
    for first in range(WORLDS):
        for second in range(WORLDS):
            alone = {name: array[second] for name, array in state.items()}
            one = render({**alone, "geom_xpos": moved[first]})
            np.testing.assert_array_equal(grid["front"]["depth"][first, second], one["front"]["depth"])


def test_a_changing_state_is_drawn_within_one_program() -> None:
    mjm, looks = model(), cameras("depth")
    mjds = states(mjm)
    render, state = Renderer(mjm, looks), arrays(mjds)

    def step(places: jax.Array, rise: jax.Array) -> Any:
        return places + rise, render({**state, "geom_xpos": places})["front"]["depth"]

    _, frames = jax.jit(lambda: jax.lax.scan(step, state["geom_xpos"], jnp.array([0.1, 0.2, 0.0])))()
    for frame, rise in enumerate((0.0, 0.1, 0.3)):
        alone = render({**state, "geom_xpos": state["geom_xpos"] + rise})["front"]["depth"]
        np.testing.assert_allclose(frames[frame], alone, rtol=1e-5)
    assert not np.array_equal(frames[0], frames[1])
    again = render(state)["front"]["depth"]  # nothing is left of the frames before
    np.testing.assert_array_equal(again, plain(mjm, mjds, looks)["front"]["depth"])


def test_two_renderers_in_one_program() -> None:
    mjm, other = (
        model(),
        mujoco.MjModel.from_xml_string(jax_states.SCENE.replace('rgba=".9 .8 .1 1"', 'rgba="0 0 1 1"')),
    )
    one, two = Renderer(mjm, cameras("rgb")), Renderer(other, cameras("rgb", "depth"))
    mjds = states(mjm)
    state = arrays(mjds)
    first, second = jax.jit(lambda state: (jax.vmap(one)(state), jax.vmap(two)(state)))(state)
    same(first, plain(mjm, mjds, cameras("rgb")))
    same(second, plain(other, states(other), cameras("rgb", "depth")))


def test_fields_of_the_model_in_each_world() -> None:
    mjm, looks = model(), cameras("rgb")
    mjds = states(mjm)
    render, state, random = Renderer(mjm, looks), arrays(mjds), np.random.default_rng(0)
    fields = {
        "geom_rgba": jnp.asarray(random.uniform(0.1, 1.0, (WORLDS, mjm.ngeom, 4)), jnp.float32).at[..., 3].set(1.0),
        "geom_matid": jnp.array([[-1, 1, -1], [0, -1, 1], [-1, -1, -1]]),
        "geom_size": jnp.asarray(np.stack([mjm.geom_size * scale for scale in (1.0, 0.7, 1.2)])),
        "mat_rgba": jnp.asarray(random.uniform(0.2, 1.0, (WORLDS, mjm.nmat, 4)), jnp.float32).at[..., 3].set(1.0),
        "light_diffuse": jnp.array([[[1.0, 0.5, 0.2]] * 2, [[0.1] * 3] * 2, [[0.7] * 3] * 2]),
        "light_active": jnp.array([[True, True], [False, True], [True, False]]),
        "light_castshadow": jnp.array([[True, True], [False, False], [True, False]]),
        "light_type": jnp.array([[0, 1], [1, 1], [0, 0]]),
        "cam_fovy": jnp.array([[55.0, 60.0], [40.0, 50.0], [70.0, 30.0]]),
    }
    images = jax.jit(jax.vmap(render))(state, fields)
    for world, mjd in enumerate(mjds):
        varied = model()
        for name, values in fields.items():
            getattr(varied, name)[:] = np.asarray(values[world])
        expected = plain(varied, [mjd], looks)
        for key in ("front", "wrist"):
            np.testing.assert_array_equal(images[key]["rgb"][world], expected[key]["rgb"][0], err_msg=f"{key} {world}")
    # Fields that all worlds share, and that are known or unknown before the program runs.
    shared = {"geom_rgba": fields["geom_rgba"][1]}
    varied = model()
    varied.geom_rgba[:] = np.asarray(shared["geom_rgba"])
    expected = plain(varied, mjds, looks)
    same(jax.jit(lambda state: jax.vmap(lambda one: render(one, shared))(state))(state), expected)
    same(jax.jit(jax.vmap(render, in_axes=(0, None)))(state, shared), expected)
    same(jax.jit(jax.vmap(render))(state), plain(mjm, mjds, looks))  # the renderer's model is as it was


def test_cameras_are_moved_in_each_world() -> None:
    mjm = model()
    mjds = states(mjm)
    lens: dict[str, Any] = {"width": 16, "height": 12, "outputs": ("depth",), "lens": wc.Pinhole(fovy=60.0)}
    riding = wc.Camera("riding", position=(0.0, 0.0, 1.0), parent="box", **lens)
    hanging = wc.Camera("hanging", position=(0.0, 0.0, 2.0), **lens)
    render, state = Renderer(mjm, [riding, hanging]), arrays(mjds)
    places = np.array([(0.0, 0.0, 1.0), (0.1, 0.0, 1.5), (0.0, 0.2, 2.0)], np.float32)
    turns = np.array([(1.0, 0.0, 0.0, 0.0), (0.9, 0.1, 0.0, 0.0), (0.8, 0.0, 0.0, 0.6)], np.float32)
    poses = {"riding": {"position": places, "rotation": turns}, "hanging": {"position": places + 1.0}}
    images = jax.jit(jax.vmap(lambda state, poses: render(state, cameras=poses)))(state, poses)
    own = {"riding": wc.Camera("riding", position=places, rotation=turns, parent="box", **lens)}
    own["hanging"] = wc.Camera("hanging", position=places + 1.0, **lens)
    same(images, plain(mjm, mjds, list(own.values())))


def test_any_number_of_worlds_or_the_one_that_was_told() -> None:
    mjm, looks = model(), cameras("depth")
    render = Renderer(mjm, looks)
    for count in (1, 2, 4):
        mjds = states(mjm, count)
        same(jax.jit(jax.vmap(render))(arrays(mjds)), plain(mjm, mjds, looks))
    told = Renderer(mjm, looks, worlds=4)
    with pytest.raises(WarpcamError, match="worlds is 4 in this Renderer, and a call has 3; give as many, or"):
        jax.jit(jax.vmap(told))(arrays(states(mjm)))


def test_images_have_no_gradients_and_say_so() -> None:
    mjm = model()
    render, state = Renderer(mjm, cameras("depth")), arrays(states(mjm))

    def total(state: Any) -> jax.Array:
        return jnp.where(jnp.isfinite(depth := render(state)["front"]["depth"]), depth, 0.0).sum()

    for function in (jax.grad(total), jax.jit(jax.grad(total)), jax.vmap(jax.grad(total))):
        with pytest.raises(WarpcamError, match=r"images have no gradients; give it jax.lax.stop_gradient"):
            function(state)
    stopped = jax.grad(lambda state: total(jax.lax.stop_gradient(state)) + state["geom_xpos"].sum())(state)
    np.testing.assert_array_equal(stopped["geom_xpos"], 1.0)
    weight = jax.grad(lambda weight: weight * total(state))(1.0)  # what does not depend on the state
    assert float(weight) == pytest.approx(float(total(state)))


def test_a_state_that_is_no_number_costs_its_own_world_its_image() -> None:
    mjm, looks = model(), cameras("depth")
    mjds = states(mjm)
    render, state = Renderer(mjm, looks), arrays(mjds)
    expected = plain(mjm, mjds, looks)["front"]["depth"]
    depth = jax.jit(jax.vmap(render))({**state, "geom_xpos": state["geom_xpos"].at[1, 1, 0].set(jnp.nan)})["front"][
        "depth"
    ]
    np.testing.assert_array_equal(depth[jnp.array([0, 2])], expected[[0, 2]])
    assert np.isinf(depth[1]).all()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"geom_xpos": None}, "data has no geom_xpos, which is drawn with"),
        ({"qpos": jnp.zeros((3, 7))}, "data has 'qpos'; known are cam_xmat"),
        ({"geom_xmat": jnp.zeros((3, 3, 2))}, r"geom_xmat must be \(..., 3, 3, 3\), got \(3, 3, 2\)"),
        ({"cam_xpos": jnp.zeros((2, 2, 3))}, r"different numbers of worlds: .*geom_xpos \(3,\).*cam_xpos \(2,\)"),
    ],
)
def test_states_that_do_not_fit_are_told_by_name(change: Any, told: str) -> None:
    mjm = model()
    state = {name: array for name, array in {**arrays(states(mjm)), **change}.items() if array is not None}
    state = {name: array for name, array in state.items() if name not in ("xpos", "xmat")}
    with pytest.raises(WarpcamError, match=told):
        Renderer(mjm, cameras())(state)


def test_bad_arguments_are_told_by_name() -> None:
    mjm = model()
    state = arrays(states(mjm))
    render = Renderer(mjm, cameras())
    with pytest.raises(WarpcamError, match=r"data must be an mjx.Data or a mapping of arrays .* got int"):
        render(5)
    with pytest.raises(WarpcamError, match="model has 'geom_color'; known are"):
        render(state, {"geom_color": 0})
    with pytest.raises(WarpcamError, match="geom_matid must be int32, got float32"):
        render(state, {"geom_matid": jnp.zeros(3)})
    with pytest.raises(WarpcamError, match="cameras has 'front'; cameras of your own are none"):
        render(state, cameras={"front": {}})
    with pytest.raises(WarpcamError, match="at least one world"):
        render({name: array[:0] for name, array in state.items()})
    with pytest.raises(WarpcamError, match="worlds must be a whole number from 1 on or None, got 0"):
        Renderer(mjm, cameras(), worlds=0)
    with pytest.raises(WarpcamError, match="outputs has 'flow', which needs the frame before"):
        Renderer(mjm, cameras("flow"))
    with pytest.raises(WarpcamError, match=r"model must be a mujoco.MjModel"):
        Renderer("scene.xml", cameras())
    with pytest.raises(WarpcamError, match="the scene has no camera 'back'; it has: 'front', 'wrist'"):
        Renderer(mjm, [wc.Camera("back", width=8, height=8)])
    with pytest.raises(WarpcamError, match="parent: the scene has no body 'arm'"):
        Renderer(mjm, [wc.Camera("own", width=8, height=8, lens=wc.Pinhole(fovy=45.0), parent="arm")])
    with pytest.raises(WarpcamError, match="cameras has two called 'front'"):
        Renderer(mjm, cameras()[:1] * 2)


def test_a_program_allocates_and_compiles_when_it_is_compiled(loads: list[str]) -> None:
    mjm = model()
    state = arrays(states(mjm))
    program = jax.jit(jax.vmap(Renderer(mjm, cameras()))).lower(state).compile()
    loads.clear()
    jax.block_until_ready(program(state))
    assert loads == []
