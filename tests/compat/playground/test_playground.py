"""MuJoCo Playground's vision environments with their pictures drawn here, beside those that MJX draws."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

jax = pytest.importorskip("jax", reason="pip install 'warpcam[jax]'")
mjx = pytest.importorskip("mujoco.mjx", reason="pip install mujoco-mjx", exc_type=ImportError)

import jax.numpy as jnp
import mujoco
from jax_states import cameras, model, states

from warpcam.compat import playground as ours
from warpcam.errors import WarpcamError
from warpcam.jax import Renderer

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of MJX and its own libraries
HOW = "pip install playground brax"
WORLDS = 3
ROBOT = """
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <default><default class="panda"><material specular="0.5"/></default></default>
  <asset>
    <material class="panda" name="off_white" rgba=".9 .9 .9 1"/><material class="panda" name="black" rgba=".2 .2 .2 1"/>
    <mesh name="finger_1" vertex="0 0 0 .02 0 0 0 .02 0 0 0 .05"/>
  </asset>
  <worldbody>
    <light name="top" pos="0 0 2" mode="trackcom"/>
    <body name="link0"><geom size=".05" mass="1"/>{arm}</body>
  </worldbody>
  <actuator>{motors}<position joint="finger_joint1" ctrlrange="0 .04"/></actuator>
</mujoco>
"""
HAND = """
<body name="hand" pos="0 0 .1"><geom name="hand_capsule" type="capsule" size=".04 .06" group="3" mass=".5"/>
  <site name="gripper" pos="0 0 .1"/>
  <body name="left_finger"><joint name="finger_joint1" type="slide" axis="0 1 0" range="0 .04"/>
    <geom type="mesh" mesh="finger_1" material="black" mass=".1"/>
    <geom name="left_finger_pad" type="box" size=".01 .01 .01"/></body>
  <body name="right_finger"><joint name="finger_joint2" type="slide" axis="0 -1 0" range="0 .04"/>
    <geom type="mesh" mesh="finger_1" material="black" mass=".1"/>
    <geom name="right_finger_pad" type="box" size=".01 .01 .01"/></body>
</body>
"""


@pytest.fixture
def installed() -> Iterator[None]:
    ours.install()
    yield
    ours.uninstall()


def cartpole(impl: str = "warp") -> Any:
    package = pytest.importorskip("mujoco_playground", reason=HOW, exc_type=ImportError)
    changes = {"impl": impl, "vision": True, "vision_config.nworld": WORLDS, "vision_config.cam_res": (32, 32)}
    return package.registry.load("CartpoleBalance", config_overrides=changes)


def panda(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The environment over an arm of our own, whose names are the real one's; that one's files are a download."""
    package = pytest.importorskip("mujoco_playground", reason=HOW, exc_type=ImportError)
    arm, motors = HAND, ""
    for number in range(7, 0, -1):
        joint = f'<joint name="joint{number}" axis="{"0 1 0" if number % 2 == 0 else "0 0 1"}" damping="5"/>'
        arm = f'<body pos=".05 0 .1">{joint}<geom type="capsule" size=".04 .05" material="off_white"/>{arm}</body>'
        motors = f'<position joint="joint{number}" kp="100" ctrlrange="-3 3"/>' + motors
    assets = folder / "franka_emika_panda" / "assets"
    assets.mkdir(parents=True)
    (assets.parent / "mjx_panda.xml").write_text(ROBOT.format(arm=arm, motors=motors))
    monkeypatch.setattr(sys.modules[package.MjxEnv.__module__], "MENAGERIE_PATH", folder)
    changes = {"vision_config.nworld": WORLDS, "naconmax": 64, "naccdmax": 64}
    config = package.registry.get_default_config("PandaPickCubeCartesian")
    config.vision = True
    return package.registry.load("PandaPickCubeCartesian", config=config, config_overrides=changes)


def rolled(env: Any, steps: int = 2) -> list[Any]:
    """Observations of all worlds after a reset and some steps."""
    keys = jax.random.split(jax.random.key(0), WORLDS)
    state = jax.jit(jax.vmap(env.reset))(keys)
    step, seen = jax.jit(jax.vmap(env.step)), [state.obs]
    for number in range(steps):
        state = step(state, jnp.full((WORLDS, env.action_size), 0.5 - number))
        seen.append(state.obs)
    return jax.block_until_ready(seen)  # else MJX draws on after the environment and its context are gone


def test_cartpole_sees_what_it_sees_with_mjx() -> None:
    theirs = rolled(cartpole())
    ours.install()
    try:
        mine, other = rolled(cartpole()), rolled(cartpole("jax"))  # MJX has no pictures of its JAX implementation
    finally:
        ours.uninstall()
    for one, two, three in zip(theirs, mine, other, strict=True):
        assert one.keys() == two.keys() == three.keys() == {"pixels/view_0"}
        one, two, three = (observation["pixels/view_0"] for observation in (one, two, three))
        assert one.shape == two.shape == three.shape == (WORLDS, 32, 32, 3)
        assert one.dtype == two.dtype == three.dtype == jnp.float32
        assert (np.abs(one - two) > 0.03).mean() < 0.01 and np.abs(one - two).mean() < 0.003
        assert (np.abs(two - three) > 0.03).mean() < 0.01
    assert np.abs(mine[0]["pixels/view_0"][0] - mine[0]["pixels/view_0"][1]).max() > 0.1  # worlds differ


@pytest.mark.usefixtures("installed")
def test_panda_picks_with_pictures_and_domain_randomisation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    env = panda(tmp_path, monkeypatch)
    assert isinstance(env._rc, ours.RenderContext)
    seen = rolled(env, 1)
    for observation in seen:
        image = observation["pixels/view_0"]
        assert image.shape == (WORLDS, 64, 64, 3) and image.dtype == jnp.float32
        assert 0.0 <= float(image.min()) < float(image.max()) <= 1.0
    red = np.asarray(seen[0]["pixels/view_0"])
    assert ((red[..., 0] > 0.4) & (red[..., 1] < 0.2)).any()  # its box
    mx = env.mjx_model
    floor = env.mj_model.geom("floor").id
    axes = jax.tree.map(lambda _: None, mx).tree_replace({"geom_rgba": 0, "geom_matid": 0})
    colors = jnp.stack([mx.geom_rgba.at[floor].set(jnp.array([grey, grey, grey, 1.0])) for grey in (0.1, 0.5, 0.9)])
    varied = mx.tree_replace({"geom_rgba": colors, "geom_matid": jnp.stack([mx.geom_matid.at[floor].set(-1)] * WORLDS)})

    def reset(mx: Any, key: Any) -> Any:  # as Playground's wrapper for domain randomisation does
        kept, env._mjx_model = env._mjx_model, mx
        try:
            return env.reset(key)
        finally:
            env._mjx_model = kept

    keys = jnp.stack([jax.random.key(0)] * WORLDS)
    image = jax.jit(jax.vmap(reset, in_axes=(axes, 0)))(varied, keys).obs["pixels/view_0"]
    means = image.mean(axis=(1, 2, 3))
    assert means[0] < means[1] < means[2]


def forwarded(mjm: mujoco.MjModel, impl: str = "warp") -> tuple[Any, Any]:
    positions = jnp.asarray(np.stack([mjd.qpos for mjd in states(mjm)]), jnp.float32)
    mx = mjx.put_model(mjm, impl=impl)
    start = mjx.make_data(mjm, impl=impl)
    return mx, jax.jit(jax.vmap(lambda qpos: mjx.forward(mx, start.replace(qpos=qpos))))(positions)


SETTINGS: dict[str, Any] = {"render_rgb": True, "render_depth": True, "render_seg": True}


def pictures(module: Any, mx: Any, data: Any, mjm: mujoco.MjModel, **more: Any) -> list[Any]:
    """Colours, depth and ids of both cameras, by a module's calls."""
    rc = module.create_render_context(mjm, nworld=WORLDS, cam_res=[(32, 24), (16, 16)], **SETTINGS, **more)
    handle = rc.pytree()

    def draw(data: Any) -> Any:
        data = module.refit_bvh(mx, data, handle)
        return module.render_with_segmentation(mx, data, handle)[:3]

    rgb, depth, pairs = jax.jit(jax.vmap(draw))(data)
    return [
        (
            np.asarray(module.get_rgb(handle, camera, rgb)),
            np.asarray(module.get_depth(handle, camera, depth, 5.0)),
            np.asarray(module.get_segmentation(handle, camera, pairs)),
        )
        for camera in range(2)
    ]


@pytest.mark.parametrize("more", [{}, {"use_textures": False, "use_ambient_lighting": False}], ids=["all", "less"])
def test_calls_return_what_mjxs_calls_return(more: Any) -> None:
    mjm = model()
    mx, data = forwarded(mjm)
    theirs, mine = (pictures(module, mx, data, mjm, **more) for module in (mjx, ours))
    for one, two in zip(theirs, mine, strict=True):
        for theirs_of, mine_of in zip(one, two, strict=True):
            assert theirs_of.shape == mine_of.shape and theirs_of.dtype == mine_of.dtype
        if more:  # textures are drawn as mujoco.Renderer draws them
            assert (np.abs(one[0] - two[0]).max(axis=-1) > 0.1).mean() < 0.05
        assert (np.abs(one[1] - two[1]) > 1e-3).mean() < 0.02
        assert (one[2] != two[2]).mean() < 0.02


def test_textures_may_be_left_out() -> None:
    mjm = model()
    mx, data = forwarded(mjm, "jax")
    with_textures, without = (pictures(ours, mx, data, mjm, use_textures=flag)[0][0] for flag in (True, False))
    assert (np.abs(with_textures - without).max(axis=-1) > 0.1).mean() > 0.1


def test_a_background_that_is_not_opaque_keeps_its_alpha() -> None:
    mjm = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><camera pos="0 0 2"/><geom size=".3"/></worldbody></mujoco>'
    )
    rc = ours.create_render_context(mjm, cam_res=(8, 8), render_rgb=True, background_color=(1.0, 0.0, 0.0, 0.5))
    data = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, data)
    state = {"xpos": jnp.asarray(data.xpos), "xquat": jnp.asarray(data.xquat)}
    rgb, depth, same = ours.render({}, state, rc.pytree())
    assert same is state and depth.shape == (0,)
    corner, middle = int(rgb[0]), int(rgb[8 * 4 + 4])
    assert corner == 127 << 24 | 255 << 16 and middle >> 24 == 255


def test_install_and_uninstall() -> None:
    kept = mjx.render, mjx.get_rgb
    ours.install()
    ours.install()
    try:
        assert mjx.render is ours.render and mjx.create_render_context is ours.create_render_context
    finally:
        ours.uninstall()
    assert (mjx.render, mjx.get_rgb) == kept
    ours.uninstall()


def test_contexts_of_mjx_stay_with_mjx() -> None:
    mjm = model()
    mx, data = forwarded(mjm)
    handle = (rc := mjx.create_render_context(mjm, nworld=WORLDS, cam_res=(8, 8), render_rgb=True)).pytree()
    ours.install()
    try:
        rgb, *_ = jax.jit(jax.vmap(lambda data: mjx.render(mx, mjx.refit_bvh(mx, data, handle), handle)))(data)
        image = mjx.get_rgb(handle, 0, rgb)
    finally:
        ours.uninstall()
    assert image.shape == (WORLDS, 8, 8, 3) and rc.nworld == WORLDS


def test_bad_arguments_are_told_by_name() -> None:
    mjm = model()
    rc = ours.create_render_context(mjm, cam_res=(8, 8), render_rgb=True, render_depth=False, render_seg=False)
    handle = rc.pytree()
    row = jnp.zeros(64)
    for call, told in {
        lambda: ours.create_render_context("x"): "mjm must be a mujoco.MjModel, got str",
        lambda: ours.create_render_context(mjm, resolution=3): "'resolution' is no setting; allowed are nworld",
        lambda: ours.create_render_context(mjm, nworld=0): "nworld must be a whole number, at least 1, got 0",
        lambda: ours.create_render_context(mjm, enabled_geom_groups=[7]): "groups must be from 0 to 5, got 7",
        lambda: ours.render(None, None, rc): "got RenderContext; RenderContext",
        lambda: ours.render_with_segmentation({}, {}, handle): "no camera of this context renders it",
        lambda: ours.get_rgb(handle, 2, row): "cam_id must be from 0 to 1, got 2",
        lambda: ours.get_depth(handle, 0, row, 1.0): "camera 0 of this context renders rgb",
        lambda: ours.get_depth(handle, 0, row, "far"): "depth_scale must be a number",
        lambda: ours.get_rgb(handle, 0, row): r"rgb_data must be \(..., 128\), got \(64,\)",
    }.items():
        with pytest.raises(WarpcamError, match=told):
            call()


def test_any_number_of_worlds_is_drawn() -> None:
    mjm = model()
    rc = ours.create_render_context(mjm, nworld=1024, cam_res=(8, 8), render_rgb=True)
    mx, data = forwarded(mjm, "jax")
    rgb, *_ = jax.jit(jax.vmap(lambda data: ours.render(mx, data, rc.pytree())))(data)
    assert rgb.shape == (WORLDS, 128)
    assert isinstance(rc.renderer, Renderer) and rc.nworld == 1024 and cameras()
