"""``warpcam.compat.mujoco.install()``: renderers that packages make by themselves."""

import mujoco
import pytest
import warp as wp

import warpcam as wc
from warpcam.compat import mujoco as front
from warpcam.compat.mujoco import Renderer, frame_renderer
from warpcam.compat.mujoco import renderer as front_renderer

WIDTH, HEIGHT = 64, 48
XML = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 .1" rgba=".6 .6 .7 1"/>
    <camera name="fixed" pos="0 -2 1" xyaxes="1 0 0 0 .5 1"/>
    <body pos="0 0 .5"><joint axis="0 1 0"/><geom type="box" size=".2 .15 .25" rgba="1 .5 .2 1"/></body>
  </worldbody>
</mujoco>
"""


def made(xml: str = XML) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_installed_it_is_what_packages_make(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """``mujoco.Renderer`` and what modules of MuJoCo call so, with the device that was said; names from before stay."""
    own, chosen = mujoco.Renderer, []
    model, data = made()
    monkeypatch.setattr(
        front_renderer,
        "FrameRenderer",
        lambda model, device: chosen.append(device) or frame_renderer.FrameRenderer(model, device),
    )
    front.install(device)
    try:
        from mujoco import renderer as module

        assert mujoco.Renderer is module.Renderer is Renderer is not own
        with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
            renderer.update_scene(data, "fixed")
            picture = renderer.render()
        with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
            renderer.update_scene(data, "fixed")
            assert (renderer.render() == picture).all() and picture.std() > 5.0
        Renderer(model, HEIGHT, WIDTH, device="cpu")
        front.install(device)  # again
    finally:
        front.uninstall()
    assert chosen == [device, device, "cpu"]
    assert mujoco.Renderer is module.Renderer is own
    with pytest.raises(wc.WarpcamError, match="device: 'cuda:99' came"):
        front.install("cuda:99")
    assert mujoco.Renderer is own


def test_installed_it_reads_again_what_is_uploaded(device: wp.Device) -> None:
    """Upload as MuJoCo Playground does with a height field of its own, in ``render_array``."""
    model, data = made("""
        <mujoco>
          <asset><hfield name="hills" nrow="4" ncol="4" size="2 2 1 .1"/></asset>
          <worldbody><geom type="hfield" hfield="hills"/></worldbody>
        </mujoco>""")
    own = mujoco.mjr_uploadHField
    front.install(device)
    try:
        renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
        renderer.enable_depth_rendering()
        renderer.update_scene(data)
        flat = renderer.render()
        model.hfield_data[5:7] = 1.0
        assert (renderer.render() == flat).all()
        renderer._gl_context.make_current()
        mujoco.mjr_uploadHField(model, renderer._mjr_context, 0)
        assert (renderer.render() != flat).any()
        with pytest.raises(TypeError, match="mjr_uploadHField"):
            mujoco.mjr_uploadHField(model, None, "hills")
    finally:
        front.uninstall()
    assert mujoco.mjr_uploadHField is own


def test_options_of_its_own_are_where_none_are_given(device: wp.Device) -> None:
    """Programs write to MuJoCo's ``_scene_option``, to leave sites or lines of rangefinders out of all pictures."""
    model, data = made()
    given, flag = mujoco.MjvOption(), int(mujoco.mjtVisFlag.mjVIS_TRANSPARENT)
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        renderer.update_scene(data, "fixed")
        before = renderer.render()
        renderer._scene_option.flags[flag] = True
        renderer.update_scene(data, "fixed")
        written = renderer.render()
        renderer.update_scene(data, "fixed", given)
        assert (renderer.render() == before).all()
        given.flags[flag] = True
        renderer.update_scene(data, "fixed", given)
        assert (renderer.render() == written).all() and (written != before).any()
