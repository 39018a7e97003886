"""OmniPBR: Omniverse's own material, as stages made here have it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Sdf, Usd, UsdShade
from usd_stages import albedo, save_image, textured_square


def omni_look(stage: Usd.Stage, device: wp.Device, **inputs: Any) -> tuple[wc.Scene, Any]:
    """A square with OmniPBR on it, and its look."""
    textured_square(stage, "")
    stage.RemovePrim("/Looks/m/omni")
    shader = UsdShade.Shader.Define(stage, "/Looks/m/omni")
    shader.SetSourceAsset("OmniPBR.mdl", "mdl")
    shader.SetSourceAssetSubIdentifier("OmniPBR", "mdl")
    types = Sdf.ValueTypeNames
    for name, value in inputs.items():
        kinds = {str: types.Asset, bool: types.Bool, float: types.Float}
        kind = kinds.get(type(value)) or (types.Color3f if len(value) == 3 else types.Float2)
        shader.CreateInput(name, kind).Set(value)
    material = UsdShade.Material.Get(stage, "/Looks/m")
    material.GetSurfaceOutput().ClearSources()
    material.CreateSurfaceOutput("mdl").ConnectToSource(shader.ConnectableAPI(), "out")
    scene = wc.from_usd(stage, device=device)
    return scene, scene._graph_source.graph.materials[0]


def test_omnipbr_packs_occlusion_roughness_and_metalness(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """Packed textures count as far as the influences let them; 0 unless they are given."""
    file = str(save_image(tmp_path / "orm.png", np.array([[[51, 102, 255]]], np.uint8)))
    inputs: dict[str, Any] = {"ORM_texture": file, "enable_ORM_texture": True, "reflection_roughness_constant": 0.9}
    scene, look = omni_look(stage, device, **inputs)
    assert (look.packed, look.roughness, look.metallic) == (-1, pytest.approx(0.9), 0.0)
    shares = {"reflection_roughness_texture_influence": 0.5, "metallic_texture_influence": 1.0, "ao_to_diffuse": 0.25}
    scene, look = omni_look(stage, device, **inputs, **shares)
    pixel = scene._parts.textures[look.packed].pixels[0, 0] / 255.0
    assert (look.roughness, look.metallic) == (1.0, 1.0)
    np.testing.assert_allclose(pixel, (0.75 + 0.25 * 0.2, 0.5 * 0.9 + 0.5 * 0.4, 1.0), atol=0.003)


def test_omnipbr_tints_brightens_and_tiles(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    file = str(save_image(tmp_path / "tex.png"))
    tile = {"texture_scale": (2.0, 1.0), "texture_translate": (0.5, 0.5)}
    scene, _ = omni_look(stage, device, diffuse_texture=file, diffuse_tint=(1.0, 0.0, 1.0), **tile)
    columns = [albedo(scene)[8, column].tolist() for column in (4, 12, 20, 28)]  # of the lower half, moved up
    assert columns == [[200, 0, 50], [0, 0, 255]] * 2
    scene, look = omni_look(stage, device, diffuse_color_constant=(0.5, 0.5, 0.5), diffuse_tint=(1.0, 0.0, 0.5))
    assert look.color == pytest.approx((0.5, 0.0, 0.25))
    scene, _ = omni_look(stage, device, diffuse_texture=file, albedo_brightness=0.5, albedo_add=0.1)
    assert albedo(scene)[8, 8].tolist() == pytest.approx([203, 89, 89], abs=1)  # 0.6 and 0.1, encoded


def test_what_omnipbr_has_that_is_not_drawn(
    stage: Usd.Stage, tmp_path: Path, caplog: pytest.LogCaptureFixture, device: wp.Device
) -> None:
    file = str(save_image(tmp_path / "tex.png"))
    others = {"project_uvw": True, "texture_rotate": 30.0, "albedo_desaturation": 0.5, "emissive_mask_texture": file}
    omni_look(stage, device, diffuse_texture=file, **others)
    for name in others:
        assert f"has {name}, which is not drawn: /Looks/m" in caplog.text
