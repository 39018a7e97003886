"""What shines in scenes of MuJoCo in the looks "pbr" and "path": so much of the colour that the surface has now."""

from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from path_scenes import traced

import warpcam as wc
from warpcam.core.color import srgb_to_linear

# From left to right: a texture, a texture and a colour, a geom's colour, and a geom without material.
MODEL = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset>
    <texture name="t" type="cube" builtin="flat" rgb1="0.2 0.4 1" rgb2="0.2 0.4 1" width="8" height="8"/>
    <material name="white" texture="t" rgba="1 1 1 1" emission="0.5"/>
    <material name="tinted" texture="t" rgba="0.8 0.6 0.4 1" emission="0.25"/>
    <material name="plain" rgba="1 0.5 0.2 1" emission="0.5"/>
  </asset>
  <worldbody>
    <geom type="box" size="0.5 2 0.5" pos="-1.5 0 0" material="white"/>
    <geom type="box" size="0.5 2 0.5" pos="-0.5 0 0" material="tinted"/>
    <geom type="box" size="0.5 2 0.5" pos="0.5 0 0" material="plain" rgba="0.1 0.9 0.3 1"/>
    <geom type="box" size="0.5 2 0.5" pos="1.5 0 0" rgba="0.9 0.9 0.9 1"/>
  </worldbody>
</mujoco>
"""
TEXTURE, TINT, OWN, PLAIN = (
    srgb_to_linear(np.array(color)) for color in ((0.2, 0.4, 1.0), (0.8, 0.6, 0.4), (0.1, 0.9, 0.3), (1.0, 0.5, 0.2))
)
CAMERA = wc.Camera("c", width=32, height=8, lens=wc.Orthographic(height=1.0), position=(0.0, 0.0, 2.0),
                   outputs=("hdr",))  # fmt: skip
LOOKS = pytest.mark.parametrize("look", ["pbr", "path"])


def loaded(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm = mujoco.MjModel.from_xml_string(text)
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    return mjm, mjd


def shown(renderer: wc.Renderer, world: int = 0) -> np.ndarray:
    """Light of the four boxes' middles."""
    return renderer.render()["c"]["hdr"][world, 4, 4::8].cpu().numpy()


def renderer_of(scene: wc.Scene, look: Any) -> wc.Renderer:
    return wc.Renderer(scene, [CAMERA], look=look, path=wc.PathOptions(samples=2) if look == "path" else None)


@LOOKS
def test_it_has_the_surface_s_colour(look: str, device: wp.Device) -> None:
    """Textures and a geom's own colour are in it, and what has no material does not shine."""
    image = shown(renderer_of(wc.from_mujoco(*loaded(MODEL), device=device), look))
    wanted = [0.5 * TEXTURE, 0.25 * TINT * TEXTURE, 0.5 * OWN, np.zeros(3)]
    np.testing.assert_allclose(image, wanted, rtol=0.01)


@LOOKS
def test_it_follows_what_is_written(look: str, device: wp.Device) -> None:
    mjm, mjd = loaded(MODEL)
    renderer = renderer_of(wc.from_mujoco(mjm, mjd, device=device), look)
    shown(renderer)
    mjm.mat_rgba[0], mjm.mat_emission[1], mjm.geom_rgba[2] = (0.8, 0.6, 0.4, 1.0), 1.0, (0.5, 0.5, 0.5, 1.0)
    wanted = [0.5 * TINT * TEXTURE, TINT * TEXTURE, 0.5 * PLAIN, np.zeros(3)]
    np.testing.assert_allclose(shown(renderer), wanted, rtol=0.01)


@LOOKS
def test_worlds_differ_in_it(look: str, device: wp.Device) -> None:
    mjm, mjd = loaded(MODEL)
    scene = wc.from_mujoco(mjm, [mjd, mjd], device=device)
    colors, own_colors = scene.vary("material_color"), scene.vary("shape_colors")
    colors[1, 0] = own_colors[1, 2] = colors.new_tensor((0.8, 0.6, 0.4, 1.0))
    scene.vary("material_emission")[1, 1] = 1.0
    renderer = renderer_of(scene, look)
    own = [0.5 * TINT * TEXTURE, TINT * TEXTURE, 0.5 * TINT, np.zeros(3)]
    np.testing.assert_allclose(shown(renderer, 1), own, rtol=0.01)
    np.testing.assert_allclose(shown(renderer, 0)[:2], [0.5 * TEXTURE, 0.25 * TINT * TEXTURE], rtol=0.01)


LAMP = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset>
    <texture name="t" type="cube" builtin="flat" rgb1="0.2 0.4 1" rgb2="0.2 0.4 1" width="8" height="8"/>
    <material name="lamp" texture="t" rgba="1 1 1 1" emission="0"/>
    <material name="matt" rgba="0.9 0.9 0.9 1" specular="0" roughness="1"/>
    <mesh name="cube" vertex="-1 -1 -1 1 -1 -1 1 1 -1 -1 1 -1 -1 -1 1 1 -1 1 1 1 1 -1 1 1" scale="0.05 0.05 0.05"/>
  </asset>
  <worldbody>
    <geom type="plane" size="4 4 0.1" material="matt"/>
    <geom {lamp} pos="0 0 1" material="lamp"/>
  </worldbody>
</mujoco>
"""
BELOW = wc.Camera("c", width=8, height=8, lens=wc.Orthographic(height=0.02), position=(0.0, 0.0, 0.3), outputs=("hdr",))


@pytest.mark.parametrize(
    ("lamp", "seen"),
    [
        ('type="sphere" size="0.05"', np.pi * 0.05**2),
        ('type="box" size="0.05 0.05 0.05"', 0.1**2 / 0.95**2),
        ('type="mesh" mesh="cube"', 0.1**2 / 0.95**2),
    ],
)
def test_it_is_drawn_as_a_light(lamp: str, seen: float, device: wp.Device) -> None:
    """A small lamp above a matt floor: few paths find it by chance. ``seen``: its solid angle from below [sr]."""
    mjm, mjd = loaded(LAMP.format(lamp=lamp))
    mjm.mat_emission[0] = 10.0
    scene = wc.from_mujoco(mjm, mjd, device=device)
    image = traced(scene, BELOW, 512)["hdr"]
    wanted = srgb_to_linear(np.full(3, 0.9)) * 10.0 * TEXTURE * seen / np.pi
    np.testing.assert_allclose(image.mean(axis=(0, 1)), wanted, rtol=0.05)
    assert (image.std(axis=(0, 1)) < 0.2 * wanted).all()
    real_time = wc.Renderer(scene, [BELOW], look="pbr", indirect_light=True).render()["c"]["hdr"][0].cpu().numpy()
    np.testing.assert_allclose(real_time.mean(axis=(0, 1)), wanted, rtol=0.1)
