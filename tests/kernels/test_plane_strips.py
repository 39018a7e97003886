"""Floors drawn by strips, four pixels at once: the same images as where each pixel is drawn by itself."""

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.plan import launches, shading

ASSETS = """
  <texture name="checks" type="2d" builtin="checker" width="64" height="64" rgb1=".1 .2 .3" rgb2=".9 .8 .3"/>
  <material name="floor" texture="checks" texrepeat="3 2" rgba="{rgba}"/>
"""
ENDLESS = "0 0 1"
SHAPES = """
  <geom type="plane" size="{size}" material="floor"/>
  <geom type="sphere" size=".2" pos="0 0 .3"/>
  <geom type="box" size=".2 .1 .25" pos=".7 0 .3"/>
"""
LIGHT = '<light pos="1 1 4" dir="-1 -1 -4"/>'
WALLS = """
  <geom type="plane" size="0 0 1" pos="0 2 0" zaxis="0 -1 0" material="floor"/>
  <geom type="plane" size="3 3 1" pos="2 0 0" zaxis="-1 0 0" rgba=".8 .5 .4 1"/>
"""
GLASS = """
  <geom type="sphere" size=".25" pos="-.6 0 .4" rgba=".2 .8 .4 .4"/>
  <geom type="box" size=".1 .3 .2" pos=".2 -.4 .3" rgba=".9 .2 .2 .6"/>
"""
SUNS = "".join(
    f'<light directional="true" dir="{x} {y} -1" diffuse=".25 .25 .25" specular=".1 .1 .1"/>'
    for x, y in ((0.7, 0.0), (0.4, 0.6), (-0.3, 0.6), (-0.7, 0.0), (-0.4, -0.6), (0.4, -0.6))
)
SCENES = {  # lights and more, the colour of the floor's material, its size, and options of the camera
    "grey": (LIGHT, "1 1 1 1", ENDLESS, {}),
    "coloured light": (LIGHT.replace("/>", ' diffuse=".7 .5 .3"/>'), "1 1 1 1", ENDLESS, {}),
    "coloured floor": (LIGHT, "1 .8 .6 1", ENDLESS, {}),
    "six lights": (SUNS, "1 1 1 1", ENDLESS, {}),
    "six coloured lights": (SUNS.replace(".25 .25 .25", ".3 .25 .2"), "1 1 1 1", ENDLESS, {}),
    "shorter cells at its ends": (LIGHT, "1 1 1 1", "1.5 2.3 .5", {}),
    "cells at its ends alone": (LIGHT, "1 1 1 1", ".9 .8 1", {}),
    "three planes": (WALLS + LIGHT, "1 1 1 1", ENDLESS, {}),
    "transparent shapes": (GLASS + LIGHT, "1 1 1 1", ENDLESS, {}),
    "exposure": (LIGHT, "1 1 1 1", ENDLESS, {"exposure": 0.5}),
}
POSITION = (0.3, -2.0, 1.5)
TEXTURE_STEP = 1.0 / 256.0  # in which the texture unit, that strips look up by, weighs texels and levels


def images(name: str, outputs: tuple[str, ...], size: tuple[int, int], shadows: bool) -> dict[str, np.ndarray]:
    lights, rgba, extent, options = SCENES[name]
    mjm = scenes.compile_xml(SHAPES.format(size=extent) + lights, assets=ASSETS.format(rgba=rgba))
    camera = scenes.own_camera(
        width=size[0],
        height=size[1],
        lens=wc.Pinhole(fovy=60.0),
        outputs=outputs,
        shadows=shadows,
        position=POSITION,
        rotation=scenes.looking(POSITION, (0.0, 0.0, 0.2)),
        **options,
    )
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, *scenes.put(mjm, 3)), [camera])
    return scenes.on_host(renderer.render()["eye"])


@pytest.mark.parametrize("shadows", [False, True])
@pytest.mark.parametrize(
    ("scene", "size", "region"),
    [("grey", size, (64, 64)) for size in ((64, 64), (84, 84), (96, 50), (160, 90))]
    + [("grey", size, launches.TALL) for size in ((84, 84), (96, 96), (160, 90))]
    + [(name, (84, 84), (64, 64)) for name in SCENES if name != "grey"],
)
@pytest.mark.parametrize("outputs", [("rgb",), ("rgb", "rgba"), ("hdr",), ("albedo",)])
def test_strips_show_what_single_pixels_show(
    outputs: tuple[str, ...],
    scene: str,
    size: tuple[int, int],
    region: tuple[int, int],
    shadows: bool,
    device: wp.Device,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not device.is_cuda:
        pytest.skip("on a CPU there is one way")
    monkeypatch.setattr(shading, "region_size", lambda *_, **__: region)
    found = images(scene, outputs, size, shadows)
    monkeypatch.setattr(shading, "has_strips", lambda *_: False)
    expected = images(scene, outputs, size, shadows)
    for name, image in expected.items():
        difference = np.abs(found[name].astype(np.float32) - image.astype(np.float32))
        if name == "hdr":
            assert difference.max() <= 3 * TEXTURE_STEP
        else:
            assert difference.max() <= 3 and (difference > 1).mean() <= 0.01
        assert image.std() > 0
