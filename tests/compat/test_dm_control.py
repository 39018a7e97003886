"""dm_control's pictures through ``warpcam.compat.dm_control``, against its own renderer's."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc

suite = pytest.importorskip("dm_control.suite", reason="pip install dm_control")
from dm_control.mujoco import engine  # noqa: E402 - needs what may not be there

from warpcam.compat import dm_control as ours  # noqa: E402 - likewise

WIDTH, HEIGHT = 80, 64

try:
    engine.Physics.from_xml_string("<mujoco/>")
except AttributeError as error:
    pytest.skip(f"this dm_control does not know MuJoCo {mujoco.__version__}: {error}", allow_module_level=True)


@pytest.fixture
def installed(device: wp.Device) -> Iterator[None]:
    ours.install(device)
    yield
    ours.uninstall()


def physics(domain: str = "cheetah", task: str = "run") -> Any:
    env = suite.load(domain, task, task_kwargs={"random": 1})
    env.reset()
    return env.physics


def own(of: Any, **options: Any) -> np.ndarray:
    """dm_control's own picture of the same state."""
    ours.uninstall()
    try:
        other = of.copy()
        if options.get("depth"):
            other.model.vis.quality.offsamples = 0  # depth of several samples is of none of them
        return other.render(HEIGHT, WIDTH, **options)
    except Exception as error:
        pytest.skip(f"dm_control's own renderer needs a library: apt-get install libosmesa6 ({type(error).__name__})")


def psnr(one: np.ndarray, two: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.square((one.astype(float) - two) / 255.0).mean()))


@pytest.mark.parametrize("camera", [-1, 0, "back"])
def test_pictures_are_those_of_its_own(installed: None, camera: int | str) -> None:
    one = physics()
    color = one.render(HEIGHT, WIDTH, camera_id=camera)
    depth = one.render(HEIGHT, WIDTH, camera_id=camera, depth=True)
    ids = one.render(HEIGHT, WIDTH, camera_id=camera, segmentation=True)
    assert (color.dtype, color.shape) == (np.uint8, (HEIGHT, WIDTH, 3))
    assert (depth.dtype, depth.shape) == (np.float32, (HEIGHT, WIDTH))
    assert (ids.dtype, ids.shape) == (np.int32, (HEIGHT, WIDTH, 2))
    expected = own(one, camera_id=camera), own(one, camera_id=camera, depth=True)
    same = (own(one, camera_id=camera, segmentation=True) == ids).all(axis=-1)
    off = (np.abs(expected[1] - depth) / depth)[same & (ids[..., 0] >= 0)]  # elsewhere it has the skybox's
    print(f"{psnr(expected[0], color):.1f} dB, depth {np.quantile(off, 0.95):.1e}, ids {same.mean():.2%}")
    assert same.mean() > 0.97 and np.quantile(off, 0.95) < 1e-2
    assert psnr(expected[0], color) > 26.0


def test_flags_and_options(installed: None) -> None:
    one = physics()
    lit = one.render(HEIGHT, WIDTH, camera_id=0)
    assert (one.render(HEIGHT, WIDTH, camera_id=0, render_flag_overrides={"shadow": False}) != lit).any()
    with pytest.raises(wc.WarpcamError, match=r"scene.flags\[mjRND_WIREFRAME\] is 1"):
        one.render(HEIGHT, WIDTH, render_flag_overrides={"wireframe": True})
    option = engine.wrapper.MjvOption()
    option.geomgroup[:] = 0
    assert (one.render(HEIGHT, WIDTH, segmentation=True, scene_option=option)[..., 1] != 5).all()


@pytest.mark.parametrize("alpha", [1.0, 0.5])
def test_what_a_scene_callback_adds(installed: None, alpha: float) -> None:
    """Depth is of what is not seen through, ids are of what has one."""

    def add(_: Any, scene: Any) -> None:
        scene.ptr.ngeom += 1
        ball = scene.ptr.geoms[scene.ptr.ngeom - 1]
        place = np.array((0.0, -0.6, 0.6))
        mujoco.mjv_initGeom(ball, 2, np.full(3, 0.4), place, np.eye(3).ravel(), np.array((1, 0, 0, alpha), np.float32))
        ball.category, ball.segid, ball.objid, ball.objtype = 4, scene.ptr.ngeom - 1, 5, 3

    one = physics()
    given = {"camera_id": 0, "scene_callback": add}
    before, far = one.render(HEIGHT, WIDTH, camera_id=0), one.render(HEIGHT, WIDTH, camera_id=0, depth=True)
    color, depth = one.render(HEIGHT, WIDTH, **given), one.render(HEIGHT, WIDTH, **given, depth=True)
    ids = one.render(HEIGHT, WIDTH, **given, segmentation=True)
    assert (color[..., 0].astype(int) - before[..., 0] > 40).mean() > 0.02
    assert (depth < far - 0.1).mean() > 0.02 if alpha == 1.0 else (depth == far).all()
    assert (ids == (5, 3)).all(axis=-1).mean() > 0.02
    assert psnr(own(one, **given), color) > 26.0
    same = (own(one, **given, segmentation=True) == ids).all(axis=-1)
    seen = same & (ids[..., 0] >= 0) & ((ids != (5, 3)).any(axis=-1) | (alpha == 1.0))
    off = np.abs(own(one, **given, depth=True) / depth - 1.0)[seen]
    assert same.mean() > 0.97 and np.quantile(off, 0.95) < 1e-2


def test_errors(installed: None) -> None:
    one = physics()
    with pytest.raises(ValueError, match="cannot both be"):
        one.render(HEIGHT, WIDTH, depth=True, segmentation=True)
    with pytest.raises(ValueError, match="`render_flag_overrides` are not supported for depth"):
        one.render(HEIGHT, WIDTH, depth=True, render_flag_overrides={"shadow": False})
    with pytest.raises(wc.WarpcamError, match="overlays: text is not drawn here, got 1"):
        one.render(HEIGHT, WIDTH, overlays=[engine.TextOverlay("a", "b")])

    def label(_: Any, scene: Any) -> None:
        scene.ptr.geoms[0].label = "here"

    with pytest.raises(wc.WarpcamError, match=r"scene.geoms\[0\].label is 'here': text is not drawn"):
        one.render(HEIGHT, WIDTH, scene_callback=label)
    assert (one.render(HEIGHT, WIDTH, scene_callback=lambda *_: None) == one.render(HEIGHT, WIDTH)).all()
    camera = engine.Camera(one, HEIGHT, WIDTH)
    camera.scene.ptr.stereo = 1
    with pytest.raises(wc.WarpcamError, match=r"scene.stereo is 1"):
        camera.render()
    with pytest.raises(wc.WarpcamError, match="width and height must be at least 1 pixel, got 8 and 0"):
        one.render(0, 8)
    with pytest.raises(ValueError, match="fixed cameras"):
        one.render(HEIGHT, WIDTH, camera_id=7)


def test_states_and_models(installed: None) -> None:
    """Each Physics has its own; a model that is loaded anew is seen."""
    one = physics()
    first = one.render(HEIGHT, WIDTH, camera_id=0)
    one.data.qpos[2] = 0.8
    one.forward()
    assert (one.render(HEIGHT, WIDTH, camera_id=0) != first).any()
    one.reload_from_xml_string("<mujoco><worldbody><geom size='1' rgba='1 0 0 1'/></worldbody></mujoco>")
    red = one.render(HEIGHT, WIDTH).reshape(-1, 3).max(axis=0)
    assert red[0] > 100 and red[1] < 100
    one.free()


def test_what_was_rendered_here_is_its_own_renderers_afterwards(installed: None) -> None:
    one = physics()
    color = one.render(HEIGHT, WIDTH)
    assert (own(one) == one.render(HEIGHT, WIDTH)).all()  # own() uninstalls
    ours.install()
    assert (one.render(HEIGHT, WIDTH) != color).any()  # it keeps what it has


def test_what_is_uploaded_is_seen(installed: None) -> None:
    """Upload a terrain as the suite's quadruped does for an episode."""
    one = engine.Physics.from_xml_string("""
        <mujoco>
          <asset>
            <hfield name="hills" nrow="4" ncol="4" size="2 2 1 0.1"/>
            <texture name="paint" type="2d" builtin="flat" width="4" height="4" rgb1="1 0 0"/>
            <material name="paint" texture="paint"/>
          </asset>
          <worldbody><light pos="0 0 9"/><geom type="hfield" hfield="hills" material="paint"/></worldbody>
        </mujoco>""")
    flat, red = one.render(HEIGHT, WIDTH, depth=True), one.render(HEIGHT, WIDTH)
    one.model.hfield_data[5:7] = 1.0
    one.model.tex_data[:] = np.tile(np.array((0, 255, 0), np.uint8), 16)
    for upload in (mujoco.mjr_uploadHField, mujoco.mjr_uploadTexture):
        assert (one.render(HEIGHT, WIDTH, depth=True) == flat).all() or upload is mujoco.mjr_uploadTexture
        with one.contexts.gl.make_current() as context:
            context.call(upload, one.model.ptr, one.contexts.mujoco.ptr, 0)
    assert (one.render(HEIGHT, WIDTH, depth=True) != flat).any()
    green = one.render(HEIGHT, WIDTH)
    assert red[..., 0].max() > 60 > red[..., 1].max()
    assert green[..., 1].max() > 60 > green[..., 0].max()


def test_pixels_as_observations(installed: None) -> None:
    """The suite's own wrapper."""
    from dm_control.suite.wrappers import pixels

    env = pixels.Wrapper(
        suite.load("cheetah", "run", task_kwargs={"random": 1}), pixels_only=False,
        render_kwargs={"height": HEIGHT, "width": WIDTH, "camera_id": 0},
    )  # fmt: skip
    assert isinstance(env.physics.contexts.gl, ours._Contexts)
    first = env.reset().observation["pixels"]
    assert env.observation_spec()["pixels"].validate(first) is first
    after = env.step(env.action_spec().maximum).observation["pixels"]
    assert (after != first).any() and (after == env.physics.render(HEIGHT, WIDTH, camera_id=0)).all()


def test_contexts_can_be_made_current_and_called(installed: None) -> None:
    """Tasks call it to upload; there is nothing else of OpenGL in them."""
    one = physics()
    first = one.render(HEIGHT, WIDTH)
    with one.contexts.gl.make_current() as context:
        context.call(mujoco.mjr_uploadTexture, one.model.ptr, one.contexts.mujoco.ptr, 0)
    assert (one.render(HEIGHT, WIDTH) == first).all()
    one.contexts.gl.free()
    one.contexts.mujoco.free()


def test_what_has_rendered_before_keeps_its_renderer() -> None:
    try:
        one = physics()
        theirs = one.render(HEIGHT, WIDTH)
    except Exception:
        pytest.skip("dm_control's own renderer needs a library: apt-get install libosmesa6")
    contexts = one.contexts
    ours.install()
    try:
        assert (one.render(HEIGHT, WIDTH) == theirs).all() and one.contexts is contexts
        other = physics()
        other.render(HEIGHT, WIDTH)
        assert isinstance(other.contexts.gl, ours._Contexts)
    finally:
        ours.uninstall()
