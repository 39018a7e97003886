"""Gymnasium's pictures of MuJoCo environments through ``warpcam.compat.gymnasium``, against its own viewer's."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc

gymnasium = pytest.importorskip("gymnasium", reason="pip install 'gymnasium[mujoco]'")
pytest.importorskip("gymnasium.envs.mujoco.mujoco_rendering", reason="pip install 'gymnasium[mujoco]'")
from warpcam.compat import gymnasium as ours  # noqa: E402 - needs what may not be there
from warpcam.compat import mujoco as front  # noqa: E402 - likewise
from warpcam.compat.mujoco import Renderer  # noqa: E402 - likewise

WIDTH, HEIGHT = 80, 64


@pytest.fixture
def installed(device: wp.Device) -> Iterator[None]:
    ours.install(device)
    yield
    ours.uninstall()


def make(mode: str, name: str = "HalfCheetah-v5", **options: Any) -> Any:
    env = gymnasium.make(name, render_mode=mode, width=WIDTH, height=HEIGHT, **options)
    env.reset(seed=1)
    return env


def has_judge() -> bool:
    try:
        mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 8, 8).close()
    except Exception:
        return False
    return True


def own(env: Any, mode: str, camera: int | None) -> Any:
    """Return the picture of Gymnasium's own viewer, in the same state."""
    if not has_judge():
        pytest.skip("Gymnasium's own viewer needs a library: apt-get install libosmesa6")
    base = env.unwrapped
    viewer = ours._original(base.model, base.data, WIDTH, HEIGHT)
    for name, value in base.mujoco_renderer.default_cam_config.items():
        if isinstance(value, np.ndarray):
            getattr(viewer.cam, name)[:] = value
        else:
            setattr(viewer.cam, name, value)
    image = tuple(part.copy() for part in viewer.render(mode, camera))
    viewer.free()
    return image


def psnr(one: np.ndarray, two: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.square((one.astype(float) - two) / 255.0).mean()))


def test_modes(installed: None) -> None:
    env = make("rgb_array")
    for _ in range(3):
        env.step(env.action_space.sample() * 0.0 + 0.5)
    color = env.render()
    renderer = env.unwrapped.mujoco_renderer
    assert isinstance(renderer.viewer, ours.OffScreenViewer)
    depth, pair = renderer.render("depth_array"), renderer.render("rgbd_tuple")
    assert (color.dtype, color.shape) == (np.uint8, (HEIGHT, WIDTH, 3))
    assert (depth.dtype, depth.shape) == (np.float32, (HEIGHT, WIDTH)) and 0.0 < depth.min() < depth.max() <= 1.0
    assert (pair[0] == color).all() and (pair[1] == depth).all()
    expected = own(env, "rgbd_tuple", renderer.camera_id)
    print(f"{psnr(expected[0], color):.1f} dB, depth {np.quantile(np.abs(expected[1] - depth), 0.95):.1e}")
    assert psnr(expected[0], color) > 28.0 and np.quantile(np.abs(expected[1] - depth), 0.95) < 1e-3
    env.close()


def test_segmentation_and_cameras(installed: None) -> None:
    env = make("rgb_array", camera_id=-1)
    env.render()
    viewer = env.unwrapped.mujoco_renderer.viewer
    for camera in (-1, 0):
        ids = viewer.render("rgb_array", camera, segmentation=True)
        assert (ids.dtype, ids.shape) == (np.int32, (HEIGHT, WIDTH, 2))
        with Renderer(env.unwrapped.model, HEIGHT, WIDTH) as renderer:
            renderer.enable_segmentation_rendering()
            renderer.update_scene(env.unwrapped.data, viewer.cam)
            assert (ids == renderer.render()[..., ::-1]).all() and len(np.unique(ids[..., 1])) > 3
    with pytest.raises(wc.WarpcamError, match="camera_id 9 came; allowed are -1 to 0"):
        viewer.render("rgb_array", 9)
    env.close()


VEILED = """
<mujoco>
  <visual><quality offsamples="0"/><global offwidth="80" offheight="64"/></visual><statistic extent="1"/>
  <asset><material name="glass" rgba="0 1 0 .5"/></asset>
  <worldbody>
    <camera pos="0 0 3" fovy="60"/>
    <geom type="box" size="2 2 .1" pos="0 0 -.1"/>
    <body pos="0 0 .5"><joint type="slide"/><geom name="veil" type="box" size=".3 .3 .3" rgba="1 0 0 .4"/></body>
    <geom type="box" size=".2 .2 .2" pos=".9 0 .3" material="glass"/>
    <geom type="box" size=".2 .2 .2" pos="-.9 0 .3" rgba="0 0 1 1"/>
    <site type="box" size=".2 .2 .2" pos="0 .9 .3" rgba="0 0 1 .3"/>
  </worldbody>
</mujoco>
"""


def test_depth_is_of_what_is_behind_what_is_transparent(installed: None) -> None:
    """Depth is that of the depth buffer where colours are drawn; ids are of all."""
    model = mujoco.MjModel.from_xml_string(VEILED)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    viewer = ours.OffScreenViewer(model, data, WIDTH, HEIGHT)
    near, far = model.vis.map.znear, model.vis.map.zfar

    def metres(mode: str = "depth_array", **options: bool) -> np.ndarray:
        image = viewer.render(mode, 0, **options)
        return near / (1.0 - (image[1] if mode == "rgbd_tuple" else image).astype(float) * (1.0 - near / far))

    floor, middle = 3.0, (HEIGHT // 2, WIDTH // 2)
    for mode in ("depth_array", "rgbd_tuple"):
        depth = metres(mode)
        assert depth[middle] == pytest.approx(floor, rel=1e-4)
        assert (np.abs(depth - 2.5) < 1e-3).sum() > 30  # the blue box
        assert np.isclose(depth, floor, rtol=1e-4).mean() > 0.9
    assert metres(segmentation=True)[middle] == pytest.approx(2.2, rel=1e-4)
    model.geom("veil").rgba[3] = 1.0
    assert metres()[middle] == pytest.approx(2.2, rel=1e-4)
    data.qpos[0] = 0.2
    mujoco.mj_forward(model, data)
    assert metres()[middle] == pytest.approx(2.0, rel=1e-4)
    model.geom("veil").rgba[3] = 0.4
    expected = metres()
    assert expected[middle] == pytest.approx(floor, rel=1e-4)
    viewer.close()
    if has_judge():
        judge = ours._original(model, data, WIDTH, HEIGHT)
        assert (
            np.abs(near / (1.0 - judge.render("depth_array", 0).astype(float) * (1.0 - near / far)) - expected).mean()
            < 0.01
        )
        judge.free()


def test_it_follows_the_simulation(installed: None) -> None:
    env = make("rgb_array")
    first = env.render()
    for _ in range(5):
        env.step(env.action_space.high)
    assert (env.render() != first).any()
    env.reset(seed=1)
    assert (env.render() == first).all()
    env.close()


def test_videos_are_recorded(installed: None, tmp_path: Path) -> None:
    pytest.importorskip("moviepy", reason="Gymnasium writes videos with moviepy: pip install moviepy")
    env = gymnasium.wrappers.RecordVideo(make("rgb_array"), str(tmp_path / "videos"), disable_logger=True)
    env.reset()
    for _ in range(4):
        env.step(env.action_space.sample())
    env.close()
    videos = list((tmp_path / "videos").glob("*.mp4"))
    assert len(videos) == 1 and videos[0].stat().st_size > 1000


def test_markers_are_drawn_once(device: wp.Device) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ours.install(device)
    viewers: list[Any] = [ours.OffScreenViewer(model, data, WIDTH, HEIGHT)]
    ours.uninstall()
    if has_judge():
        viewers.append(ours._original(model, data, WIDTH, HEIGHT))
    pictures = []
    for viewer in viewers:
        plain = viewer.render("rgb_array").copy()
        viewer.add_marker(pos=np.array((0.0, -0.9, 0.2)), size=np.full(3, 0.3), rgba=np.array((1, 0, 0, 1), np.float32))
        viewer.add_marker(type=int(mujoco.mjtGeom.mjGEOM_BOX), size=np.full(3, 0.2), pos=np.array((0.5, -0.8, 0.0)))
        marked = viewer.render("rgb_array").copy()
        assert (marked != plain).any(axis=-1).mean() > 0.02
        assert (viewer.render("rgb_array") == plain).all()
        pictures.append(marked)
        viewer.free()
    if len(pictures) > 1:
        assert psnr(*pictures) > 26.0


def test_what_is_not_drawn_is_refused(device: wp.Device) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    viewer = ours.OffScreenViewer(model, mujoco.MjData(model), 16, 16)
    with pytest.raises(wc.WarpcamError, match="text is not drawn"):
        viewer.add_overlay(0, "a", "b")
    with pytest.raises(wc.WarpcamError, match="render_mode is 'human'; allowed are rgb_array"):
        viewer.render("human")
    viewer.close()


def test_what_was_closed_can_be_rendered(installed: None) -> None:
    """Gymnasium's own does so, and its memory is let go each time."""
    env = make("rgb_array")
    before = env.render()
    viewer = env.unwrapped.mujoco_renderer.viewer
    for _ in range(2):
        env.close()
        assert viewer._frame_renderer is None
        assert (env.render() == before).all()
    env.unwrapped.mujoco_renderer.viewer.__del__()


SKY = """
<mujoco>
  <visual>
    <quality offsamples="0" numslices="{slices}"/><map znear=".1" zfar="10" haze="{haze}"/>
    <global offwidth="80" offheight="64"/>
  </visual>
  <statistic extent="1"/>
  <asset>{texture}</asset>
  <worldbody>
    {plane}
    <geom type="box" size=".3 .3 .3" pos="0 2 1.4"/><geom type="box" size=".5 .5 .5" pos="1 8.4 1.4"/>
    <geom type="box" size=".3 .3 .3" pos="-.8 2 1.4" rgba="1 0 0 .5"/>
    <camera pos="0 0 {height}" xyaxes="{axes}" {lens}/>
  </worldbody>
</mujoco>
"""
GRADIENT = '<texture type="skybox" builtin="gradient" rgb1="0 0 1" rgb2="0 1 0" width="16" height="16"/>'
ENDLESS = '<geom type="plane" size="0 0 1"/>'
SKIES = {
    "level": {},
    "turned": {"axes": ".8 .6 0 0 0 1"},
    "down": {"axes": "1 0 0 0 .6 .8", "lens": 'fovy="90"'},
    "few sides": {"slices": 8},
    "orthographic": {"axes": "1 0 0 0 .6 .8", "lens": 'projection="orthographic" fovy="8"'},
    "haze": {"plane": ENDLESS},
    "wide haze": {"plane": ENDLESS, "haze": 0.7, "height": 2},
    "haze from below": {"plane": ENDLESS, "height": -2},
    "slanted haze": {"plane": '<geom type="plane" size="0 0 1" euler="20 0 0"/>', "height": 2},
    "hidden plane": {"plane": '<geom type="plane" size="0 0 1" group="4"/>'},
    "no sky": {"texture": "", "plane": ENDLESS},
}


@pytest.mark.parametrize("name", SKIES)
def test_depth_of_the_sky(installed: None, name: str) -> None:
    """The skybox and the haze are in the depth buffer, and hide what lies beyond them."""
    parts = {
        "slices": 28,
        "haze": 0.3,
        "texture": GRADIENT,
        "plane": "",
        "height": 1,
        "axes": "1 0 0 0 0 1",
        "lens": "",
    }
    model = mujoco.MjModel.from_xml_string(SKY.format(**{**parts, **SKIES[name]}))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    viewer = ours.OffScreenViewer(model, data, WIDTH, HEIGHT)
    depth, pair = viewer.render("depth_array", 0), viewer.render("rgbd_tuple", 0)
    assert (pair[1] == depth).all()
    assert ((depth < 1.0).mean() == 1.0) == (name != "no sky")
    if not has_judge():
        pytest.skip("Gymnasium's own viewer needs a library: apt-get install libosmesa6")
    judge = ours._original(model, data, WIDTH, HEIGHT)
    expected = judge.render("depth_array", 0)
    judge.free()
    assert (np.abs(expected - depth) < 1e-5).mean() > 0.98


def test_uninstalling() -> None:
    from gymnasium.envs.mujoco import mujoco_rendering

    ours.install("cpu")
    assert mujoco_rendering.OffScreenViewer is ours.OffScreenViewer
    ours.uninstall()
    assert mujoco_rendering.OffScreenViewer is ours._original
    with pytest.raises(wc.WarpcamError, match=r"device: 'cuda:99' came"):
        ours.install("cuda:99")


def test_what_is_uploaded_to_the_viewer_is_read_again(installed: None) -> None:
    """Upload a changed mesh as MyoSuite does."""
    model = mujoco.MjModel.from_xml_string("""
        <mujoco>
          <asset><hfield name="hills" nrow="4" ncol="4" size="2 2 1 .1"/></asset>
          <worldbody><geom type="hfield" hfield="hills"/></worldbody>
        </mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    viewer = ours.OffScreenViewer(model, data, WIDTH, HEIGHT)
    flat = viewer.render("depth_array")
    model.hfield_data[5:7] = 1.0
    assert (viewer.render("depth_array") == flat).all()
    viewer.make_context_current()
    mujoco.mjr_uploadHField(model, viewer.con, 0)
    assert (viewer.render("depth_array") != flat).any()


def test_two_front_ends_share_what_is_uploaded(device: wp.Device) -> None:
    own = mujoco.mjr_uploadMesh
    ours.install(device)
    front.install(device)
    ours.uninstall()
    assert mujoco.mjr_uploadMesh is not own
    front.uninstall()
    assert mujoco.mjr_uploadMesh is own


def test_options_and_cameras_of_an_environment(installed: None) -> None:
    """Those that an environment is made with: flags, the free camera's place, a camera by name."""
    plain = make("rgb_array").render()
    joints = make("rgb_array", visual_options={int(mujoco.mjtVisFlag.mjVIS_JOINT): True})
    near = make("rgb_array", camera_id=-1, default_camera_config={"distance": 1.5, "trackbodyid": 0})
    named = make("rgb_array", camera_name="track")
    assert (joints.render() != plain).any() and (near.render() != plain).any()
    assert joints.unwrapped.mujoco_renderer.viewer.vopt.flags[mujoco.mjtVisFlag.mjVIS_JOINT]
    assert near.unwrapped.mujoco_renderer.viewer.cam.distance == 1.5
    assert (named.render() == make("rgb_array", camera_id=0).render()).all()
