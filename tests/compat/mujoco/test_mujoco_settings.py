"""Options and arguments of ``mujoco.Renderer``: honoured, without an effect, or refused by name, as its page says."""

import logging

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc
from warpcam.compat.mujoco import Renderer, options

WIDTH, HEIGHT = 64, 48
FLEX, SKIN = int(mujoco.mjtObj.mjOBJ_FLEX), int(mujoco.mjtObj.mjOBJ_SKIN)
XML = """
<mujoco>
  <visual><global offwidth="64" offheight="48"/><quality offsamples="{samples}"/></visual>
  <asset>
    <texture name="checks" type="2d" builtin="checker" width="8" height="8" rgb1="1 0 0" rgb2="0 0 1"/>
    <material name="checked" texture="checks"/>
    <mesh name="wedge" vertex="0 0 0 .3 0 0 0 .3 0 0 0 .4"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <camera name="fixed" pos="0 -3 1.5" xyaxes="1 0 0 0 .5 1"/>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <geom type="mesh" mesh="wedge" pos=".8 0 .3" material="checked"/>
    <geom name="tilted" type="box" size=".2 .2 .2" pos="-.8 0 .4" euler="20 30 0" rgba="1 1 0 1"/>
    <body name="turning" pos="0 0 .2"><joint/><geom size=".1"/></body>
    <flexcomp name="cloth" type="grid" dim="2" count="3 3 1" spacing=".3 .3 .3" pos="0 0 1" radius=".02"/>
  </worldbody>
  <deformable><skin name="skin" vertex="0 0 1 .5 0 1 0 .5 1" face="0 1 2"><bone body="turning"
    bindpos="0 0 0" bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/></skin></deformable>
</mujoco>
"""


def made(samples: int = 0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(XML.format(samples=samples))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def picture(
    made: tuple[mujoco.MjModel, mujoco.MjData],
    device: wp.Device,
    mode: str = "",
    option: mujoco.MjvOption | None = None,
    **given: object,
) -> np.ndarray:
    model, data = made
    with Renderer(model, HEIGHT, WIDTH, device=device, **given) as renderer:
        if mode:
            getattr(renderer, f"enable_{mode}_rendering")()
        renderer.update_scene(data, "fixed", option)
        return renderer.render()


def test_every_other_flag_is_refused_by_name(device: wp.Device) -> None:
    """Those of options where they would change this model's picture; those of the scene always."""
    model, data = made()
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        for name, number in options.OPTION_FLAGS.items():
            option = mujoco.MjvOption()
            option.flags[number] = 1 - option.flags[number]
            with pytest.raises(wc.WarpcamError, match=rf"scene_option\.flags\[mjVIS_{name}\] is \d, .* allowed is \d"):
                renderer.update_scene(data, "fixed", option)
        known = {"SHADOW", "REFLECTION", "SKYBOX", "POST_PROCESSING", *options.RENDERING_FLAGS}
        assert {name.removeprefix("mjRND_") for name in mujoco.mjtRndFlag.__members__} - {"mjNRNDFLAG"} <= known
        for name, number in options.RENDERING_FLAGS.items():
            renderer.scene.flags[number] = 1 - renderer.scene.flags[number]
            with pytest.raises(wc.WarpcamError, match=rf"scene\.flags\[mjRND_{name}\] is \d"):
                renderer.update_scene(data, "fixed")
            renderer.scene.flags[number] = 1 - renderer.scene.flags[number]
    bare = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
    with Renderer(bare, 24, 32, device=device) as renderer:
        option = mujoco.MjvOption()
        for name in ("CONVEXHULL", "TEXTURE", "FLEXVERT", "FLEXEDGE", "FLEXFACE", "FLEXSKIN"):
            number = options.OPTION_FLAGS.get(name)
            if number is not None:
                option.flags[number] = 1 - option.flags[number]
        renderer.update_scene(mujoco.MjData(bare), scene_option=option)


@pytest.mark.parametrize(("group", "kind"), [("flexgroup", FLEX), ("skingroup", SKIN), ("mjVIS_SKIN", SKIN)])
def test_soft_things_are_shown_by_group_and_flag(device: wp.Device, group: str, kind: int) -> None:
    option = mujoco.MjvOption()
    if group == "mjVIS_SKIN":
        option.flags[mujoco.mjtVisFlag.mjVIS_SKIN] = 0
    else:
        getattr(option, group)[0] = 0
    seen, without = picture(made(), device, "segmentation"), picture(made(), device, "segmentation", option)
    assert (seen[..., 1] == kind).any() and not (without[..., 1] == kind).any()
    others = (seen[..., 1] != kind) & (seen[..., 1] >= 0)
    assert others.any() and (seen[others] == without[others]).all()


def test_arguments_without_an_effect_on_pictures(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    """A ``max_geom`` that suffices for less than the model, and the size of text."""
    with caplog.at_level(logging.CRITICAL):  # MuJoCo itself says that its scene is full
        expected = picture(made(), device)
        assert (picture(made(), device, max_geom=20) == expected).all()
        assert (picture(made(), device, font_scale=mujoco.mjtFontScale.mjFONTSCALE_50) == expected).all()


def test_samples_smooth_edges_of_colours_alone(device: wp.Device) -> None:
    one, four = (picture(made(samples), device).astype(int) for samples in (0, 4))
    changed = (one != four).any(axis=-1)
    assert 0.01 < changed.mean() < 0.3
    for mode in ("depth", "segmentation"):
        assert (picture(made(0), device, mode) == picture(made(4), device, mode)).all()


def test_what_lies_between_the_skybox_and_the_far_plane_is_seen(device: wp.Device) -> None:
    """MuJoCo's skybox, at 0.7 of the far plane, hides it."""
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><visual><map zfar="10"/></visual><statistic extent="1"/>
        <asset><texture type="skybox" builtin="flat" rgb1="0 0 1" width="8" height="8"/></asset>
        <worldbody><camera name="fixed" pos="0 0 0"/><geom size="1" pos="0 0 -9" rgba="1 0 0 1"/></worldbody>
      </mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    middle = picture((model, data), device)[HEIGHT // 2, WIDTH // 2]
    assert middle[0] > 50 > middle[2]


def test_beyond_256_transparent_objects_are_solid(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    panes = "".join(f'<geom type="box" size=".5 .5 .001" pos="0 0 {-k / 100}" rgba="1 1 1 .5"/>' for k in range(260))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><camera name="fixed" pos="0 0 2"/>{panes}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    picture((model, data), device)
    assert "256" in caplog.text and "transparent" in caplog.text
