"""``mujoco.Renderer``'s calls, encodings and errors, and its pictures, from ``warpcam.compat.mujoco.Renderer``."""

import gc
import inspect
import sys

import mujoco
import numpy as np
import pytest
import warp as wp
from mujoco_reference import reference_renderer

import warpcam as wc
from warpcam.compat.mujoco import Renderer, frame_renderer

WIDTH, HEIGHT = 64, 48
GEOM, SITE, TENDON = (int(getattr(mujoco.mjtObj, f"mjOBJ_{kind}")) for kind in ("GEOM", "SITE", "TENDON"))
XML = """
<mujoco>
  <visual>
    <global offwidth="64" offheight="48" azimuth="110" elevation="-30"/>
    <quality offsamples="0" numslices="120" numstacks="120"/>
  </visual>
  <statistic center="0 0 .3" extent="1.5"/>
  <worldbody>
    <light pos="0 0 3" dir=".2 .1 -1" directional="true"/>
    <geom name="floor" type="plane" size="2 2 .1" rgba=".6 .6 .7 1"/>
    <camera name="fixed" pos="0 -2 1" xyaxes="1 0 0 0 .5 1"/>
    <camera name="flat" pos="0 0 3" xyaxes="1 0 0 0 1 0" projection="orthographic" fovy="1.6"/>
    <camera name="sensor" pos="0 -2 1" xyaxes="1 0 0 0 .5 1" sensorsize=".02 .015" resolution="64 48"
      focal=".02 .018" principal=".002 -.001"/>
    <body name="arm" pos="0 0 .5">
      <joint axis="0 1 0"/>
      <geom name="box" type="box" size=".2 .15 .25" rgba="1 .5 .2 1"/>
      <geom name="hidden" type="box" size=".1 .1 .1" pos=".4 0 0" group="4" rgba="0 1 0 1"/>
      <site name="tip" pos="0 0 .35" size=".08" rgba="0 0 1 1"/>
      <site name="mark" pos="-.4 0 0" size=".08" group="3" rgba="1 0 1 1"/>
      <site name="end" pos=".2 0 .2" size=".02"/>
      <camera name="riding" pos="0 -1.5 .3" xyaxes="1 0 0 0 .2 1" mode="trackcom"/>
    </body>
    <site name="anchor" pos=".6 0 .9" size=".02"/>
  </worldbody>
  <tendon><spatial name="rope" width=".03"><site site="anchor"/><site site="end"/></spatial></tendon>
</mujoco>
"""


def made(xml: str = XML) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:1] = 0.3
    mujoco.mj_forward(model, data)
    return model, data


def ours(model: mujoco.MjModel, device: wp.Device) -> Renderer:
    return Renderer(model, HEIGHT, WIDTH, device=device)


def judge(model: mujoco.MjModel) -> mujoco.Renderer:
    return reference_renderer(model, HEIGHT, WIDTH)


def three(renderer: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colours, depth, ids."""
    color = renderer.render()
    renderer.enable_depth_rendering()
    depth = renderer.render()
    renderer.enable_segmentation_rendering()
    ids = renderer.render()
    renderer.disable_segmentation_rendering()
    return color, depth, ids


def psnr(one: np.ndarray, two: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.square((one.astype(float) - two) / 255.0).mean() + 1e-12))


def tracking() -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.type, camera.trackbodyid = int(mujoco.mjtCamera.mjCAMERA_TRACKING), 1
    camera.distance, camera.azimuth, camera.elevation = 2.0, 30.0, -20.0
    return camera


def free() -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0.1, 0.2, 0.3), 2.5, 200.0, -40.0
    return camera


def option(flags: dict[str, int] | None = None, **groups: int) -> mujoco.MjvOption:
    chosen = mujoco.MjvOption()
    for name, group in groups.items():
        getattr(chosen, name)[group] = 1 - getattr(chosen, name)[group]
    for name, value in (flags or {}).items():
        chosen.flags[getattr(mujoco.mjtVisFlag, f"mjVIS_{name}")] = value
    return chosen


CASES = {
    "free by default": (-1, None),
    "free": (free, None),
    "tracking": (tracking, None),
    "by name": ("fixed", None),
    "by index": (0, None),
    "orthographic": ("flat", None),
    "sensor": ("sensor", None),
    "riding": ("riding", None),
    "geomgroup": ("fixed", lambda: option(geomgroup=4)),
    "no geoms": ("fixed", lambda: option(geomgroup=0)),
    "sitegroup": ("fixed", lambda: option(sitegroup=3)),
    "no tendons": ("fixed", lambda: option(tendongroup=0)),
    "tendon flag": ("fixed", lambda: option({"TENDON": 0})),
}


@pytest.mark.parametrize("name", CASES)
def test_pictures_are_those_of_mujocos_own(device: wp.Device, name: str) -> None:
    if name == "orthographic" and mujoco.mj_version() < 3017000:
        pytest.skip("MuJoCo 3.9 takes depths of orthographic cameras for those of perspective ones")
    camera, chosen = (part() if callable(part) else part for part in CASES[name])
    model, data = made()
    with judge(model) as theirs, ours(model, device) as renderer:
        theirs.update_scene(data, camera, chosen)
        renderer.update_scene(data, camera, chosen)
        expected, seen = three(theirs), three(renderer)
    for one, two in zip(expected, seen, strict=True):
        assert (one.dtype, one.shape) == (two.dtype, two.shape)
    same = (expected[2] == seen[2]).all(axis=-1)
    hit = same & (expected[2][..., 0] >= 0)
    off = np.abs(expected[1] - seen[1])[hit] / expected[1][hit]
    print(f"{name}: ids equal {same.mean():.2%}, depth off {np.quantile(off, 0.97):.1e}, {psnr(expected[0], seen[0])}")
    assert same.mean() > 0.985 and hit.sum() > 30
    assert np.quantile(off, 0.97) < 1e-3
    assert psnr(expected[0], seen[0]) > 27.0  # at this size a tenth of the pixels lie on an edge
    assert np.abs(expected[0].astype(int) - seen[0])[same].mean() < 1.5
    miss = same & (expected[2][..., 0] < 0)
    assert np.allclose(expected[1][miss], seen[1][miss], rtol=2e-3)


def test_a_floor_is_seen_through_from_below(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though nothing is transparent but for that; from above no layer is drawn for it."""
    model, data = made()
    camera = free()
    camera.elevation = 30.0
    with judge(model) as theirs, ours(model, device) as renderer:
        theirs.update_scene(data, camera)
        renderer.update_scene(data, camera)
        expected = theirs.render()
        assert psnr(expected, renderer.render()) > 30.0
        monkeypatch.setattr(frame_renderer.FrameRenderer, "_planes_from_behind", lambda *_: np.zeros(0, np.int64))
        assert psnr(expected, renderer.render()) < 25.0
        monkeypatch.undo()
        renderer.update_scene(data, "fixed")
        renderer.render()
        layers = [made.scene.tables().layers for made in renderer._frame_renderer._scenes.values()]
        assert [each is not None and each.has_transparent for each in layers] == [True, False]


def test_kinds_of_objects(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, "fixed")
        ids = renderer.render()
    found = {tuple(pair) for pair in ids.reshape(-1, 2).tolist()}
    assert {(-1, -1), (0, GEOM), (1, GEOM), (model.site("tip").id, SITE), (0, TENDON)} <= found
    assert ids.dtype == np.int32 and ids.shape == (HEIGHT, WIDTH, 2)


@pytest.mark.parametrize("flag", ["SHADOW", "SKYBOX", "REFLECTION"])
def test_flags_of_the_scene(device: wp.Device, flag: str) -> None:
    sky = '<asset><texture type="skybox" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="32" height="32"/>'
    mirror = sky + '<material name="mirror" reflectance=".6"/></asset>'
    xml = XML.replace("<worldbody>", mirror + "<worldbody>", 1).replace(
        'name="floor"', 'name="floor" material="mirror"'
    )
    model, data = made(xml)
    pictures = []
    with judge(model) as theirs, ours(model, device) as renderer:
        for either in (theirs, renderer):
            for value in (True, False):
                either.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = value
                either.update_scene(data, "fixed")
                pictures.append(either.render())
    assert psnr(pictures[0], pictures[1]) < 30.0, "the flag makes no difference"
    assert psnr(pictures[0], pictures[2]) > 27.0 and psnr(pictures[1], pictures[3]) > 27.0


def test_what_is_not_drawn_is_refused_by_name(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        with pytest.raises(wc.WarpcamError, match=r"scene_option.flags\[mjVIS_ISLAND\] is 1.* allowed is 0"):
            renderer.update_scene(data, scene_option=option({"ISLAND": 1}))
        with pytest.raises(wc.WarpcamError, match=r"flags\[mjVIS_STATIC\] is 0.* allowed is 1"):
            renderer.update_scene(data, scene_option=option({"STATIC": 0}))
        renderer.update_scene(data, scene_option=option({"FLEXVERT": 1, "CONVEXHULL": 1}))  # there is none to be seen
        labelled = mujoco.MjvOption()
        labelled.label = int(mujoco.mjtLabel.mjLABEL_BODY)
        with pytest.raises(wc.WarpcamError, match=r"scene_option\.label is 1"):
            renderer.update_scene(data, scene_option=labelled)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_WIREFRAME] = True
        with pytest.raises(wc.WarpcamError, match=r"scene.flags\[mjRND_WIREFRAME\] is 1"):
            renderer.update_scene(data)


def test_cameras_that_are_not_there(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        for camera, message in (
            ("b", 'camera "b" does not exist'),
            (-2, "-2 is out of range"),
            (model.ncam, rf"{model.ncam} is out of range \[-1, {model.ncam}\)"),
        ):
            with pytest.raises(ValueError, match=message):
                renderer.update_scene(data, camera)
        lost = tracking()
        lost.trackbodyid = 99
        with pytest.raises(ValueError, match="body id 99 is out of range"):
            renderer.update_scene(data, lost)
        with pytest.raises(TypeError, match=r"data must be a mujoco\.MjData"):
            renderer.update_scene(model)
        with pytest.raises(wc.WarpcamError, match="made from another model"):
            renderer.update_scene(made("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")[1])


def test_pictures_follow_the_model(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        renderer.update_scene(data, "fixed")
        pictures = [renderer.render()]
        for color in ((1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 0.4)):
            model.geom("box").rgba[:] = color
            renderer.update_scene(data, "fixed")
            pictures.append(renderer.render())
            assert pictures[-1] is not pictures[-2] and (pictures[-1] != pictures[-2]).any()
        model.site("tip").rgba[:] = (1, 1, 0, 1)
        renderer.update_scene(data, "fixed")
        pictures.append(renderer.render())
        assert (pictures[-1] != pictures[-2]).any()
        for kind in ("geom", "site"):
            one = model.geom("box") if kind == "geom" else model.site("tip")
            getattr(model, f"{kind}_type")[one.id] = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
            renderer.update_scene(data, "fixed")
            pictures.append(renderer.render())
            assert (pictures[-1] != pictures[-2]).any(), kind


def test_colours_of_limits_follow_the_model(device: wp.Device) -> None:
    model, data = made("""
      <mujoco>
        <worldbody><site name="a" pos="-.8 0 0"/>
          <body pos=".8 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1"/><site name="b"/></body></worldbody>
        <tendon><spatial width=".1" limited="true" range="0 1"><site site="a"/><site site="b"/></spatial></tendon>
      </mujoco>""")
    with ours(model, device) as renderer:

        def seen() -> np.ndarray:
            renderer.update_scene(data)
            return renderer.render()

        first = seen()
        model.vis.rgba.constraint[:] = (0, 1, 0, 1)
        second = seen()
        assert (second != first).any()
        for bit in ("CONSTRAINT", "LIMIT"):
            model.opt.disableflags = int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}"))
            assert (seen() != second).any(), bit
        model.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        assert (seen() == second).all()


def test_out(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        renderer.update_scene(data, "fixed")
        for enable, channels, dtype in (("", (3,), np.uint8), ("depth", (), np.float64), ("segmentation", (2,), int)):
            if enable:
                getattr(renderer, f"enable_{enable}_rendering")()
            out = np.zeros((HEIGHT, WIDTH, *channels), dtype)
            expected = renderer.render()
            assert renderer.render(out=out) is out and (out == expected).all() and out.any()
            with pytest.raises(ValueError, match=r"Expected `out.shape == \(48, 64"):
                renderer.render(out=np.zeros((HEIGHT + 1, WIDTH, *channels), dtype))
        spare = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        if mujoco.mj_version() < 4000000:
            assert renderer.render(out=spare).shape == (HEIGHT, WIDTH, 2) and not spare.any()
        else:
            with pytest.raises(ValueError, match=r"Expected `out.shape == \(48, 64, 2\)`"):
                renderer.render(out=spare)


def test_the_state_is_taken_when_it_is_given(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        renderer.update_scene(data, "fixed")
        first = renderer.render()
        data.qpos[0] = 1.5
        mujoco.mj_forward(model, data)
        assert (renderer.render() == first).all()
        renderer.update_scene(data, "fixed")
        assert (renderer.render() != first).any()


def test_depth_and_segmentation_exclude_each_other(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        renderer.update_scene(data)
        renderer.enable_depth_rendering()
        renderer.enable_segmentation_rendering()
        assert renderer.render().dtype == np.int32
        renderer.enable_depth_rendering()
        assert renderer.render().dtype == np.float32
        renderer.disable_depth_rendering()
        assert renderer.render().dtype == np.uint8


def test_what_may_be_asked(device: wp.Device) -> None:
    model, _ = made()
    with ours(model, device) as renderer:
        assert renderer.model is model and isinstance(renderer.scene, mujoco.MjvScene)
        assert (renderer.height, renderer.width) == (HEIGHT, WIDTH)
    for name in ("__init__", "render", "update_scene"):
        theirs = inspect.signature(getattr(mujoco.Renderer, name)).parameters
        mine = inspect.signature(getattr(Renderer, name)).parameters
        assert [n for n in theirs if n not in mine] == []
        assert list(mine)[: len(theirs)] == list(theirs)
        extra = [mine[n] for n in mine if n not in theirs]
        assert all(parameter.kind is parameter.KEYWORD_ONLY for parameter in extra)


def test_before_there_is_a_state(device: wp.Device) -> None:
    model, _ = made()
    with ours(model, device) as renderer:
        color, depth, ids = three(renderer)
    assert not color.any() and (depth == np.float32(model.vis.map.zfar * model.stat.extent)).all() and (ids == -1).all()


@pytest.mark.parametrize("way", ["close", "__del__"])
def test_closed(way: str, device: wp.Device) -> None:
    model, data = made()
    renderer = ours(model, device)
    assert renderer.__enter__() is renderer
    for context in (renderer._gl_context, renderer._mjr_context):
        context.__del__()
    getattr(renderer, way)()
    with pytest.raises(RuntimeError, match="render cannot be called after close"):
        renderer.render()
    renderer.close()
    renderer.update_scene(data)


def test_larger_than_the_framebuffer(monkeypatch: pytest.MonkeyPatch) -> None:
    model, unraisable = made()[0], []
    gc.collect()  # of what others have left
    monkeypatch.setattr(sys, "unraisablehook", unraisable.append)
    for height, width, error in (
        (48, 65, "Image width 65 > framebuffer width 64"),
        (49, 64, "Image height 49 > framebuffer height 48"),
        (0, 64, "height must be at least 1"),
    ):
        with pytest.raises(ValueError, match=error):
            Renderer(model, height, width)
    gc.collect()
    assert unraisable == []


def test_nothing_is_built_per_frame(device: wp.Device, loads: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Many states, cameras and renderers: as many scenes as renderers, and the first one's kernels."""
    model, data = made()
    made_scenes: list[object] = []
    real = frame_renderer.load
    monkeypatch.setattr(frame_renderer, "load", lambda *a, **k: made_scenes.append(real(*a, **k)) or made_scenes[-1])
    with ours(model, device) as renderer:
        renderer.update_scene(data)
        three(renderer)
        assert len(made_scenes) == 1
    loads.clear()
    with ours(model, device) as renderer:
        for step in range(4):
            data.qpos[0] = 0.1 * step
            mujoco.mj_forward(model, data)
            for camera in ("fixed", "riding", "sensor", -1):
                renderer.update_scene(data, camera)
                three(renderer)
    assert len(made_scenes) == 2 and loads == []


def test_ways_to_look_are_let_go(device: wp.Device) -> None:
    """Memory does not grow with the number of options that somebody has tried."""
    model, data = made()
    with ours(model, device) as renderer:
        renderer.enable_depth_rendering()
        for group in range(2 * frame_renderer.MAX_CACHED):
            model.geom_group[0] = group % 6
            model.site_size[0, 0] = 0.01 + group / 100
            renderer.update_scene(data)
            renderer.render()
        assert len(renderer._frame_renderer._scenes) == len(renderer._frame_renderer._eyes) == frame_renderer.MAX_CACHED
