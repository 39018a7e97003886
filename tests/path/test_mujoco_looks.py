"""Scenes of MuJoCo in the looks that are not their own: materials and lights as docs/path_tracing.md maps them."""

from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from path_scenes import traced

import warpcam as wc
from warpcam.core.color import srgb_to_linear

COLOR = np.array((0.8, 0.4, 0.1))
MODEL = """
<mujoco>
  <visual><headlight ambient="{ambient} {ambient} {ambient}" diffuse="0 0 0" specular="0 0 0"/></visual>
  <asset>
    <material name="m" rgba="0.8 0.4 0.1 1" specular="0" {material}/>
    {sky}
  </asset>
  <worldbody>
    {light}
    <geom type="plane" size="2 2 0.1" material="m"/>
    <camera name="c" pos="0 0 3"/>
  </worldbody>
</mujoco>
"""
SUN = '<light type="directional" pos="0 0 4" dir="0 0.6 -0.8" diffuse="0.9 0.8 0.7" specular="0 0 0"/>'
CAMERA = wc.Camera("c", width=16, height=16, outputs=("hdr",))


def scene_of(device: wp.Device, material: str = "", light: str = SUN, ambient: float = 0.0, sky: str = "") -> wc.Scene:
    mjm = mujoco.MjModel.from_xml_string(MODEL.format(material=material, light=light, ambient=ambient, sky=sky))
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    return wc.from_mujoco(mjm, mjd, device=device)


def seen(scene: wc.Scene, look: Any) -> np.ndarray:
    if look == "path":
        return traced(scene, CAMERA, 64)["hdr"]
    return wc.Renderer(scene, [CAMERA], look=look).render()["c"]["hdr"][0].cpu().numpy()


@pytest.mark.parametrize("look", ["pbr", "path"])
def test_a_matt_floor_in_the_sun(look: str, device: wp.Device) -> None:
    """Colours are decoded, and light is linear: albedo times light times cosine."""
    wanted = srgb_to_linear(COLOR) * np.array((0.9, 0.8, 0.7)) * 0.8
    np.testing.assert_allclose(seen(scene_of(device), look), np.broadcast_to(wanted, (16, 16, 3)), rtol=0.01)


@pytest.mark.parametrize("look", ["pbr", "path"])
def test_ambient_light_comes_from_all_around(look: str, device: wp.Device) -> None:
    wanted = srgb_to_linear(COLOR) * 0.5
    image = seen(scene_of(device, light="", ambient=0.5), look)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), wanted, rtol=0.01)


def test_what_shines(device: wp.Device) -> None:
    image = seen(scene_of(device, 'emission="0.5"', light="", ambient=0.0), "path")
    np.testing.assert_allclose(image, np.broadcast_to(0.5 * srgb_to_linear(COLOR), (16, 16, 3)), rtol=1e-3)


def test_metal_and_roughness_are_the_material_s(device: wp.Device) -> None:
    """A rough metal that faces an even sky reflects its colour, with what its facets reflect to each other."""
    image = seen(scene_of(device, 'metallic="1" roughness="0.2"', light="", ambient=0.5), "path")
    straight = srgb_to_linear(COLOR)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), 0.5 * straight, rtol=0.03)


def test_the_skybox_is_the_sky(device: wp.Device) -> None:
    """It lights the floor as bright as it looks: one of one colour, by albedo times colour."""
    sky = '<texture type="skybox" builtin="flat" rgb1="0.6 0.7 0.8" rgb2="0.6 0.7 0.8" width="8" height="48"/>'
    wanted = srgb_to_linear(COLOR) * srgb_to_linear(np.array((0.6, 0.7, 0.8)))
    for look in ("pbr", "path"):
        image = seen(scene_of(device, light="", sky=sky), look)
        np.testing.assert_allclose(image.mean(axis=(0, 1)), wanted, rtol=0.02)


@pytest.mark.parametrize("look", ["pbr", "path"])
@pytest.mark.parametrize("size", ["0 0 1", "5 5 1"])
def test_mirrors_and_haze_are_none(look: str, size: str, device: wp.Device) -> None:
    """What they would reflect or fade to is not drawn; what is transparent is."""
    model = """<mujoco><visual><headlight ambient="0.5 0.5 0.5" diffuse="0 0 0"/></visual>
      <asset><material name="m" reflectance="1" specular="0" rgba="1 1 1 1"/>
        <texture type="skybox" builtin="flat" rgb1="0 0 0" rgb2="0 0 0" width="8" height="48"/></asset>
      <worldbody><geom type="plane" size="{}" material="m"/><geom size="0.5" pos="0 0 1" rgba="0 0 0 0.5"/>
        <camera name="c" pos="0 0 4"/></worldbody></mujoco>"""
    mjm = mujoco.MjModel.from_xml_string(model.format(size))
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    image = seen(wc.from_mujoco(mjm, mjd, device=device), look)
    floor, through = image[0, 0].mean(), image[7:9, 7:9].mean()
    assert floor == pytest.approx(0.5, rel=0.1)
    assert 0.2 * floor < through < 0.75 * floor


def test_a_scene_of_usd_has_not_the_look_of_mujoco(stage: Any, device: wp.Device) -> None:
    from pxr import UsdGeom

    UsdGeom.Sphere.Define(stage, "/ball")
    camera = wc.Camera("c", width=4, height=4, lens=wc.Pinhole(fovy=45.0), position=(0.0, 0.0, 0.0))
    with pytest.raises(wc.WarpcamError, match="look='mujoco' is of scenes of MuJoCo alone"):
        wc.Renderer(wc.from_usd(stage, device=device), [camera], look="mujoco")
