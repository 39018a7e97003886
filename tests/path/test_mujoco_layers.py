"""Layers of MuJoCo's materials in the looks "pbr" and "path": as docs/looks.md maps them."""

import logging
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from path_scenes import traced

import warpcam as wc
from warpcam.core.color import srgb_to_linear

MODEL = """
<mujoco>
  <visual><headlight ambient="{ambient} {ambient} {ambient}" diffuse="0 0 0" specular="0 0 0"/></visual>
  <asset>
    <texture name="t" type="2d" builtin="flat" rgb1="{color}" width="8" height="8"/>
    <material name="m" rgba="0.8 0.4 0.1 1" specular="0.5" {numbers}>{layer}</material>
  </asset>
  <worldbody>
    <light type="directional" pos="0 0 4" dir="0 0.6 -0.8" diffuse="{sun} {sun} {sun}" castshadow="false"/>
    <geom type="box" size="2 2 0.1" material="m"/>
    <camera name="c" pos="0 0 1"/>
  </worldbody>
</mujoco>
"""
CAMERA = wc.Camera("c", width=8, height=8, outputs=("hdr",))
LOOKS = pytest.mark.parametrize("look", ["pbr", "path"])


def seen(device: wp.Device, look: Any, role: str = "", color: str = "1 1 1", numbers: str = "", sun: float = 0.8,
         ambient: float = 0.0) -> np.ndarray:  # fmt: skip
    layer = f'<layer role="{role}" texture="t"/>' if role else ""
    text = MODEL.format(layer=layer, color=color, numbers=numbers, sun=sun, ambient=ambient)
    mjm = mujoco.MjModel.from_xml_string(text)
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    scene = wc.from_mujoco(mjm, mjd, device=device)
    if look == "path":
        return traced(scene, CAMERA, 16)["hdr"]
    return wc.Renderer(scene, [CAMERA], look=look).render()["c"]["hdr"][0].cpu().numpy()


@LOOKS
@pytest.mark.parametrize(
    ("color", "with_layer", "plain"),
    [
        ("1 0.4 0", 'roughness="1" metallic="1"', 'roughness="0.4" metallic="0"'),
        ("1 0.8 1", 'roughness="0.5" metallic="1"', 'roughness="0.4" metallic="1"'),
        ("1 0.8 1", 'roughness="0.5"', 'roughness="0.4"'),  # no metal, whatever the map
    ],
)
def test_a_packed_map_is_a_factor(look: str, color: str, with_layer: str, plain: str, device: wp.Device) -> None:
    expected = seen(device, look, numbers=plain)
    np.testing.assert_allclose(seen(device, look, "orm", color, with_layer), expected, rtol=1e-3, atol=1e-4)
    assert np.abs(seen(device, look, numbers=with_layer) - expected).max() > 0.003


@LOOKS
def test_a_map_of_emission_is_a_factor(look: str, device: wp.Device) -> None:
    wanted = 0.5 * srgb_to_linear(np.array((0.8, 0.4, 0.1))) * srgb_to_linear(np.array((0.2, 0.6, 1.0)))
    image = seen(device, look, "emissive", "0.2 0.6 1", 'emission="0.5"', sun=0.0)
    np.testing.assert_allclose(image, np.broadcast_to(wanted, image.shape), rtol=0.01)
    assert not seen(device, look, "emissive", "0.2 0.6 1", sun=0.0).any()


@LOOKS
def test_a_map_of_normals_tilts(look: str, device: wp.Device) -> None:
    """A matt surface that turns to or from the sun; 128 of 255 is no tilt."""
    matt = 'roughness="1" metallic="0"'
    flat = seen(device, look, numbers=matt)
    np.testing.assert_allclose(seen(device, look, "normal", "0.502 0.502 1", matt), flat, rtol=0.02)
    tilted = (
        seen(device, look, "normal", "0.502 0.8 0.9", matt).mean(),
        seen(device, look, "normal", "0.502 0.2 0.9", matt).mean(),
    )
    assert min(tilted) < 0.9 * flat.mean() and max(tilted) > 1.05 * flat.mean()


def test_red_of_a_packed_map_is_the_light_from_all_around(device: wp.Device) -> None:
    matt = 'roughness="1" metallic="0"'
    dim, whole = (seen(device, "pbr", "orm", f"{red} 1 1", matt, sun=0.0, ambient=0.5) for red in (0.4, 1.0))
    np.testing.assert_allclose(dim, 0.4 * whole, rtol=0.01)


@pytest.mark.parametrize("role", ["occlusion", "roughness", "metallic", "opacity"])
def test_other_layers_are_told(role: str, device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "warpcam"):
        image = seen(device, "pbr", role, "0.2 0.2 0.2")
    assert f"a material has a layer of the role {role}, which is not read" in caplog.text
    np.testing.assert_array_equal(image, seen(device, "pbr"))
