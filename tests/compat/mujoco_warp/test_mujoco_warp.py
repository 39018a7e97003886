"""The calls of MuJoCo-Warp's renderer, beside that renderer itself, on the same worlds."""

import re
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc
from warpcam.compat import mujoco_warp as ours

NUM_WORLDS = 2
WORLD = """
  <light pos="0 0 3" dir="0.2 0.1 -1" diffuse=".6 .6 .6" specular=".3 .3 .3" ambient=".1 .05 0"/>
  <geom name="floor" type="plane" size="2 2 .1" material="checker"/>
  <body name="ball" pos="0 0 .4"><freejoint/><geom name="ball" type="sphere" size=".3" material="shiny"/></body>
  <body pos=".7 0 .3"><freejoint/><geom name="box" type="box" size=".2 .2 .2" rgba=".2 .4 .9 1"/></body>
  <geom name="hidden" type="sphere" size=".2" pos="-.7 0 .3" group="3"/>
  <site name="mark" size=".3" pos="0 .9 .5"/>
  <camera name="top" pos="0 0 3" fovy="50" resolution="24 16"/>
  <camera name="side" pos="0 -2.4 .7" xyaxes="1 0 0 0 .2 1" fovy="55" resolution="40 30" output="rgb depth"/>
  <camera name="flat" pos="0 0 2" projection="orthographic" fovy="2.5" resolution="20 20" output="segmentation"/>
"""
ASSETS = """
  <texture name="checker" type="2d" builtin="checker" width="64" height="64" rgb1=".9 .9 .9" rgb2=".1 .1 .1"/>
  <material name="checker" texture="checker" texrepeat="3 3"/>
  <material name="shiny" rgba=".8 .3 .1 1" specular=".9" shininess=".4" emission=".3"/>
"""
ALL = {"render_rgb": True, "render_depth": True, "render_seg": True, "cam_res": (40, 30)}


@pytest.fixture(scope="module")
def mjm() -> mujoco.MjModel:
    return scenes.compile_xml(WORLD, assets=ASSETS)


@pytest.fixture
def worlds(mjm: mujoco.MjModel, device: wp.Device) -> tuple[mjw.Model, mjw.Data]:
    """The second world has its ball elsewhere."""
    m, d = scenes.put(mjm, NUM_WORLDS)
    scenes.write(d.qpos, (1, slice(0, 3)), (-0.5, 0.3, 0.6))
    mjw.kinematics(m, d)
    mjw.com_pos(m, d)
    mjw.camlight(m, d)
    return m, d


def frame(system: Any, worlds: tuple[mjw.Model, mjw.Data], mjm: mujoco.MjModel, **options: Any) -> Any:
    m, d = worlds
    rc = system.create_render_context(mjm, nworld=NUM_WORLDS, **options)
    system.refit_bvh(m, d, rc)
    system.render(m, d, rc)
    return rc


def data(rc: Any) -> dict[str, np.ndarray]:
    return {name: getattr(rc, name).numpy().copy() for name in ("rgb_data", "depth_data", "seg_data")}


def bytes_of(packed: np.ndarray) -> np.ndarray:
    """B, G, R, A."""
    return np.ascontiguousarray(packed).view(np.uint8).reshape(*packed.shape, 4)


def test_a_program_changes_its_import_alone() -> None:
    for name in ("put_model", "put_data", "step", "Model", "BiasType"):
        assert getattr(ours, name) is getattr(mjw, name)
    for name in ours.__all__:
        assert getattr(ours, name) is not getattr(mjw, name)
    drawing = {name for name in dir(mjw) if any(word in name for word in ("render", "Render", "bvh", "get_rgb"))}
    assert drawing <= set(ours.__all__)
    with pytest.raises(AttributeError, match="nor mujoco_warp has 'put_modle'"):
        ours.put_modle  # noqa: B018, it is asked for


def test_images_are_packed_as_its_own(mjm: mujoco.MjModel, worlds: Any) -> None:
    theirs, mine = (frame(system, worlds, mjm, **ALL) for system in (mjw, ours))
    for name in ("nrender", "total_rays", "znear", "zfar", "bvh_ngeom", "render_skybox", "headlight_active"):
        assert getattr(mine, name) == getattr(theirs, name), name
    assert int(mine.background_color) == int(theirs.background_color)
    for name in ("cam_res", "cam_id_map", "enabled_geom_ids"):
        np.testing.assert_array_equal(getattr(mine, name).numpy(), getattr(theirs, name).numpy(), name)
    for kind in ("rgb", "depth", "seg"):
        for name in (f"render_{kind}", f"{kind}_adr"):
            np.testing.assert_array_equal(getattr(mine, name).numpy(), getattr(theirs, name).numpy(), name)
        mine_data, their_data = getattr(mine, f"{kind}_data"), getattr(theirs, f"{kind}_data")
        assert mine_data.shape == their_data.shape and mine_data.dtype == their_data.dtype
    expected, found = data(theirs), data(mine)
    same = (found["seg_data"] == expected["seg_data"]).all(axis=-1)
    assert same.mean() > 0.99 and len(np.unique(expected["seg_data"])) > 4
    np.testing.assert_allclose(found["depth_data"][same], expected["depth_data"][same], rtol=2e-3, atol=1e-4)
    # It lights things otherwise than MuJoCo does, but the order of the bytes shows.
    mine_bytes, their_bytes = (bytes_of(images["rgb_data"])[same].astype(float) for images in (found, expected))
    box = found["seg_data"][same][:, 0] == mjm.geom("box").id
    assert (mine_bytes[:, 3] == their_bytes[:, 3]).all()
    for pixels in (mine_bytes, their_bytes):
        assert pixels[box][:, 0].mean() > pixels[box][:, 1].mean() > pixels[box][:, 2].mean()
    assert all(np.corrcoef(mine_bytes[:, channel], their_bytes[:, channel])[0, 1] > 0.8 for channel in range(3))


def test_cameras_say_themselves_what_they_render(mjm: mujoco.MjModel, worlds: Any) -> None:
    theirs, mine = (frame(system, worlds, mjm) for system in (mjw, ours))
    for name in ("cam_res", "rgb_adr", "depth_adr", "seg_adr"):
        np.testing.assert_array_equal(getattr(mine, name).numpy(), getattr(theirs, name).numpy(), name)
    for name, image in data(mine).items():
        assert image.shape == data(theirs)[name].shape, name
    same = (data(mine)["seg_data"] == data(theirs)["seg_data"]).all(axis=-1)
    assert same.mean() > 0.98


@pytest.mark.parametrize(
    ("cam_active", "expected"),
    [([True, False, True], [0, 2]), (["side"], [1]), ([2, 0], [2, 0]), ([], []), (None, [0, 1, 2])],
)
def test_active_cameras(mjm: mujoco.MjModel, worlds: Any, cam_active: Any, expected: list[int]) -> None:
    rc = ours.create_render_context(mjm, NUM_WORLDS, cam_res=[(8, 8)], render_depth=[True], cam_active=cam_active)
    assert rc.cam_id_map.numpy().tolist() == expected
    assert rc.depth_data.shape == (NUM_WORLDS, 64 * len(expected))
    if not expected:
        ours.refit_bvh(*worlds, rc)
        ours.render(*worlds, rc)


def test_readers(mjm: mujoco.MjModel, worlds: Any) -> None:
    options = {"cam_active": ["side", "top"], "cam_res": [(40, 30), (24, 16)]}
    flags = {"render_rgb": [False, True], "render_depth": True, "render_seg": [True, True]}
    rc = frame(ours, worlds, mjm, **options, **flags)
    rgb = wp.zeros((NUM_WORLDS, 16, 24), dtype=wp.vec3)
    depth = wp.zeros((NUM_WORLDS, 16, 24), dtype=float)
    pairs = wp.zeros((NUM_WORLDS, 16, 24), dtype=wp.vec2i)
    ours.get_rgb(rc, 1, rgb)
    ours.get_depth(rc, 1, 4.0, depth)
    ours.get_segmentation(rc, 1, pairs)
    start = 40 * 30
    packed = bytes_of(rc.rgb_data.numpy()).reshape(NUM_WORLDS, 16, 24, 4)
    np.testing.assert_allclose(rgb.numpy(), packed[..., 2::-1] / 255.0, atol=1e-6)
    raw = rc.depth_data.numpy()[:, start:].reshape(NUM_WORLDS, 16, 24)
    np.testing.assert_allclose(depth.numpy(), np.clip(raw / 4.0, 0.0, 1.0), atol=1e-6)
    np.testing.assert_array_equal(pairs.numpy(), rc.seg_data.numpy()[:, start:].reshape(NUM_WORLDS, 16, 24, 2))
    with pytest.raises(wc.WarpcamError, match="camera_index 0 renders depth, segmentation, not rgb"):
        ours.get_rgb(rc, 0, rgb)
    with pytest.raises(wc.WarpcamError, match="the context's cameras are 0 to 1"):
        ours.get_rgb(rc, 2, rgb)
    with pytest.raises(wc.WarpcamError, match=r"float32 \(2, 16, 24\), got vec3"):
        ours.get_depth(rc, 1, 4.0, rgb)


def test_images_follow_the_worlds_in_place(mjm: mujoco.MjModel, worlds: Any) -> None:
    m, d = worlds
    rc = frame(ours, worlds, mjm, cam_active=["side"], **ALL)
    arrays = [rc.rgb_data.ptr, rc.depth_data.ptr, rc.seg_data.ptr]
    before = data(rc)
    scenes.write(d.geom_xpos, (0, mjm.geom("ball").id), (0.0, 5.0, -3.0))
    m.geom_rgba = wp.clone(m.geom_rgba)  # replaced, as simulators do that expand a field
    scenes.write(m.geom_rgba, (0, mjm.geom("box").id), (0.0, 1.0, 0.0, 1.0))
    ours.render(m, d, rc)
    after = data(rc)
    assert arrays == [rc.rgb_data.ptr, rc.depth_data.ptr, rc.seg_data.ptr]
    ball = mjm.geom("ball").id
    assert (before["seg_data"][0, :, 0] == ball).any() and not (after["seg_data"][0, :, 0] == ball).any()
    box = before["seg_data"][1, :, 0] == mjm.geom("box").id
    assert (bytes_of(after["rgb_data"])[1, box, 1] > bytes_of(before["rgb_data"])[1, box, 1]).mean() > 0.9


@pytest.mark.parametrize(
    ("option", "where"),
    [
        ({"use_textures": False}, "floor"),
        ({"enable_emission": False}, "ball"),
        ({"enable_specular": False}, "ball"),
        ({"enable_per_light_ambient": False}, "floor"),
        ({"use_ambient_lighting": False}, "ball"),
        ({"use_shadows": True}, "floor"),
        ({"samples_per_pixel": 2}, "ball"),
    ],
)
def test_options_change_what_they_name(mjm: mujoco.MjModel, worlds: Any, option: dict[str, Any], where: str) -> None:
    options = {"cam_active": ["side"], "cam_res": (40, 30), "render_rgb": True, "render_seg": True}
    plain, changed = (frame(ours, worlds, mjm, **options, **more) for more in ({}, option))
    assert getattr(changed, next(iter(option))) == next(iter(option.values()))
    there = plain.seg_data.numpy()[..., 0] == mjm.geom(where).id
    before, after = (bytes_of(rc.rgb_data.numpy())[there][:, :3].astype(int) for rc in (plain, changed))
    assert (before != after).any()
    if "use_textures" not in option and "samples_per_pixel" not in option:
        assert (after <= before + 1).all()
    np.testing.assert_array_equal(plain.seg_data.numpy(), changed.seg_data.numpy())


def test_groups_background_and_skybox(mjm: mujoco.MjModel, worlds: Any) -> None:
    options = {"cam_active": ["side"], "cam_res": (40, 30), "render_rgb": True, "render_seg": True}
    rc = frame(ours, worlds, mjm, enabled_geom_groups=[0, 3], background_color=(1.0, 0.5, 0.0, 0.25), **options)
    pairs = rc.seg_data.numpy()
    assert (pairs[..., 0] == mjm.geom("hidden").id).any()
    assert (pairs[..., 1] != int(mujoco.mjtObj.mjOBJ_SITE)).all()
    miss = pairs[..., 0] < 0
    pixels = bytes_of(rc.rgb_data.numpy())
    assert miss.any() and (np.abs(pixels[miss].astype(int) - (0, 127, 255, 63)) <= 1).all()
    assert (pixels[~miss][:, 3] == 255).all()
    drawn = frame(ours, worlds, mjm, draw=("geoms", "sites"), **options).seg_data.numpy()
    assert (drawn[..., 1] == int(mujoco.mjtObj.mjOBJ_SITE)).any()


def test_pixels_of_the_background_are_those_of_the_context(mjm: mujoco.MjModel, worlds: Any) -> None:
    """So that ``rgb_data == background_color`` finds them; levels are cut, not rounded, as MuJoCo-Warp's are."""
    options = {"cam_active": ["side"], "cam_res": (40, 30), "render_rgb": True}
    for color in ((0.1, 0.3, 0.7, 1.0), (0.1, 0.3, 0.7, 0.5)):
        theirs = frame(mjw, worlds, mjm, background_color=color, **options)
        level = theirs.rgb_data.numpy()[0, 0]
        assert level == theirs.background_color
        for samples in (1, 2):
            rc = frame(ours, worlds, mjm, background_color=color, samples_per_pixel=samples, **options)
            assert rc.background_color == level and (rc.rgb_data.numpy() == level).mean() > 0.1, (color, samples)


def test_groups_of_any_number_in_anything_that_can_be_gone_through(device: wp.Device) -> None:
    """A number is that group alone, as in MuJoCo-Warp; MuJoCo's renderer takes those beyond for 0 or 5."""
    balls = "".join(
        f'<geom size=".2" pos="{0.5 * index - 1.0} 0 0" group="{group}"/>'
        for index, group in enumerate((0, 2, 5, 7, -1))
    )
    mjm = scenes.compile_xml(balls + '<camera name="eye" pos="0 0 3" fovy="60"/>')
    m, d = scenes.put(mjm, 1)
    options = {"render_seg": True, "cam_res": (40, 20)}
    for make in (lambda: [7], lambda: [0, 7, 9], lambda: [5], lambda: {0, -1}, lambda: np.array([2, 0])):
        seen = []
        for system in (ours, mjw):
            rc = system.create_render_context(mjm, nworld=1, enabled_geom_groups=make(), **options)
            system.refit_bvh(m, d, rc)
            system.render(m, d, rc)
            seen.append(set(np.unique(rc.seg_data.numpy()[..., 0])))
        assert seen[0] == seen[1] and len(seen[0]) > 1, (make(), seen)
    rc = ours.create_render_context(mjm, nworld=1, enabled_geom_groups=(group for group in (0, 7)), **options)
    for _ in range(2):  # gone through once, it is remembered
        ours.render(m, d, rc)
        assert set(np.unique(rc.seg_data.numpy()[..., 0])) == {-1, 0, 3}
    assert rc.enabled_geom_ids.numpy().tolist() == [0, 3]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"enable_backface_culling": False}, "enable_backface_culling=False is not offered"),
        ({"enable_vertex_normals": False}, "enable_vertex_normals=False is not offered"),
        ({"flex_render_smooth": False}, "flex_render_smooth=False is not offered"),
        ({"splat_position": np.zeros((1, 3))}, "splat_position came without splat_rotation, splat_scale, splat_rgba"),
        ({"samples_per_pixel": 3}, "samples_per_pixel is 3; allowed are 1, 2, 4 and 8, along a side"),
        ({"shadow_light_fraction": 0.7}, "shadow_light_fraction is 0.7"),
        ({"nworld": 0}, "nworld must be a whole number, at least 1, got 0"),
        ({"background_color": (1, 2, 3)}, "background_color must be"),
        ({"background_color": "red"}, "background_color must be"),
        ({"cam_active": ["nose"]}, "cam_active has 'nose'; the model's cameras are 'top', 'side', 'flat'"),
        ({"cam_active": 1}, "cam_active must be None, or a list of flags, names or ids, got 1"),
        ({"render_rgb": 1}, "render_rgb must be None, True, False or a list of these, got 1"),
        ({"cam_active": [True]}, "cam_active has 1 flags, the model 3 cameras"),
        ({"cam_active": [0, 0]}, "names a camera twice"),
        ({"cam_res": [(8, 8), (9, 9)]}, "cam_res has 2 sizes for 3 active cameras"),
        ({"cam_res": (0, 8)}, "at least 1 pixel each"),
        ({"enabled_geom_groups": None}, "enabled_geom_groups must be whole numbers, got None"),
        ({"enabled_geom_groups": [True, 1]}, "enabled_geom_groups must be whole numbers, got [True, 1]"),
        ({"enabled_geom_groups": [0, 1.5]}, "enabled_geom_groups must be whole numbers, got [0, 1.5]"),
        ({"draw": ("legs",)}, "draw: 'legs' came; allowed are geoms, sites, "),
        ({"draw": None}, "draw must be some of geoms, sites, tendons, flexes, skins, actuators, got None"),
        ({"render_rgb": [True, False]}, "render_rgb has 2 flags for 3 active cameras"),
    ],
)
def test_what_is_not_offered_is_refused_by_name(mjm: mujoco.MjModel, options: dict[str, Any], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match="create_render_context: ") as caught:
        ours.create_render_context(mjm, **options)
    assert message in str(caught.value)


def test_wrong_worlds_and_missing_attributes(mjm: mujoco.MjModel, worlds: Any) -> None:
    rc = ours.create_render_context(mjm, nworld=NUM_WORLDS + 1, **ALL)
    with pytest.raises(wc.WarpcamError, match="d has 2 worlds, the context was made for 3"):
        ours.render(*worlds, rc)
    with pytest.raises(AttributeError, match="no 'bvh_id'"):
        _ = rc.bvh_id


def test_the_renderer_is_that_of_the_worlds_seen_last(mjm: mujoco.MjModel, worlds: Any) -> None:
    m, d = worlds
    rc = ours.create_render_context(mjm, nworld=NUM_WORLDS, **ALL)
    other = mjw.put_data(mjm, mujoco.MjData(mjm), nworld=NUM_WORLDS)
    seen = []
    for data in (d, other, d):
        ours.render(m, data, rc)
        seen.append(rc.renderer)
    assert seen[0] is seen[2] and seen[0] is not seen[1]


def test_wrong_arguments_of_calls_are_named(mjm: mujoco.MjModel, worlds: Any) -> None:
    m, d = worlds
    rc = ours.create_render_context(mjm, nworld=NUM_WORLDS, **ALL)
    depth = wp.zeros((NUM_WORLDS, rc.views[0].size[1], rc.views[0].size[0]), dtype=wp.float32)
    mistakes: dict[str, Any] = {
        "render: d must be a mujoco_warp.Data, got MjData": lambda: ours.render(m, mujoco.MjData(mjm), rc),
        "render: rc must be what create_render_context gives, got NoneType": lambda: ours.render(m, d, None),
        "refit_bvh: rc must be what create_render_context gives, got Data": lambda: ours.refit_bvh(m, d, d),
        "camera_index is 'top'; the context's cameras are 0 to 2": lambda: ours.get_depth(rc, "top", 1.0, depth),
        "camera_index is 0.5; the context's cameras are 0 to 2": lambda: ours.get_depth(rc, 0.5, 1.0, depth),
        "get_depth: depth_scale must be a number other than 0, got 0": lambda: ours.get_depth(rc, 0, 0, depth),
        "get_depth: depth_scale must be a number other than 0, got '5'": lambda: ours.get_depth(rc, 0, "5", depth),
    }
    for message, call in mistakes.items():
        with pytest.raises(wc.WarpcamError, match=re.escape(message)):
            call()


def test_scalars_of_all_kinds_are_numbers(mjm: mujoco.MjModel, worlds: Any) -> None:
    rc = ours.create_render_context(mjm, nworld=NUM_WORLDS, **ALL)
    ours.render(*worlds, rc)
    depth = wp.zeros((NUM_WORLDS, rc.views[0].size[1], rc.views[0].size[0]), dtype=wp.float32)
    ours.get_depth(rc, 0, 5.0, depth)
    usual = depth.numpy()
    assert usual.any()
    for scale in (np.array(5.0), torch.tensor(5.0), wp.float32(5.0), np.float32(5.0), 5):
        for camera in (wp.int32(0), torch.tensor(0), np.array(0), False):
            depth.zero_()
            ours.get_depth(rc, camera, scale, depth)
            np.testing.assert_array_equal(depth.numpy(), usual)
    for scale in (True, -1.0):
        ours.get_depth(rc, 0, scale, depth)


def test_settings_are_not_ignored_in_silence(mjm: mujoco.MjModel) -> None:
    """MuJoCo-Warp reads some of its context's attributes in each frame."""
    rc = ours.create_render_context(mjm, NUM_WORLDS, **ALL)
    for name in ("background_color", "skybox_tex_id", "use_shadows"):
        with pytest.raises(wc.WarpcamError, match=rf"RenderContext\.{name} cannot be set"):
            setattr(rc, name, 0)
    with pytest.raises(wc.WarpcamError, match="refit_splat_bvh: rc must be what create_render_context gives"):
        ours.refit_splat_bvh(None)


def test_the_signature_is_its_own() -> None:
    import inspect

    mine, theirs = (inspect.signature(system.create_render_context).parameters for system in (ours, mjw))
    extra = [name for name in mine if name not in theirs]
    assert extra == ["draw", "reflections", "transparency"]
    for name, parameter in theirs.items():
        if name in mine:
            default = mine[name].default
            assert (list(default) if isinstance(default, tuple | list) else default) == (
                list(parameter.default) if isinstance(parameter.default, tuple | list) else parameter.default
            ), name
    missing = [name for name in theirs if name not in mine]
    assert not missing, f"this version of MuJoCo-Warp has more arguments: {missing}"


@pytest.mark.skipif(not wp.is_cuda_available(), reason="a capture needs a CUDA device")
def test_captured_frames_follow_the_worlds(mjm: mujoco.MjModel) -> None:
    with wp.ScopedDevice("cuda:0"):
        m, d = scenes.put(mjm, NUM_WORLDS)
        rc = ours.create_render_context(mjm, nworld=NUM_WORLDS, **ALL)
        with pytest.raises(wc.WarpcamError, match="call refit_bvh"), wp.ScopedCapture():
            ours.render(m, d, rc)
        ours.refit_bvh(m, d, rc)
        with wp.ScopedCapture() as capture:
            ours.refit_bvh(m, d, rc)
            ours.render(m, d, rc)
        wp.capture_launch(capture.graph)
        before = data(rc)
        scenes.write(d.geom_xpos, (0, mjm.geom("ball").id), (0.5, 0.5, 1.0))
        wp.capture_launch(capture.graph)
        after = data(rc)
        assert (before["depth_data"][0] != after["depth_data"][0]).any()
        np.testing.assert_array_equal(before["depth_data"][1], after["depth_data"][1])
        ours.render(m, d, rc)
        for name, image in data(rc).items():
            np.testing.assert_array_equal(image, after[name], name)
