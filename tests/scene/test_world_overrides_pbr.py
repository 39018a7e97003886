"""Per-world overrides in linear light: written in one world, each name shows there alone."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.core.errors import WarpcamError
from warpcam.scene.world_overrides import override_names

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from usd_stages import add_material, add_square

WORLDS = 3
FLOOR, BLOCK, MOSS, SPOT, PANEL, SPHERE = 0, 1, 1, 0, 1, 1  # materials, a texture, lights and a form
# What needs kernels of its own: asked for in every test, so that all share one.
SPECIAL = ("material_texture_offset", "headlight", "background")


def paint(stage: Usd.Stage, prim: Any, path: str, **inputs: Any) -> UsdShade.Shader:
    surface = add_material(stage, path, **inputs)
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(stage, path))
    return surface


def place(light: Any, at: tuple[float, float, float], turn: float) -> None:
    frame = UsdGeom.Xformable(light)
    frame.AddTranslateOp().Set(Gf.Vec3d(*at))
    frame.AddRotateYOp().Set(turn)


def make(stage: Usd.Stage, folder: Path, device: wp.Device) -> wc.Scene:
    """A tiled floor and a block on it, under a spot and a panel."""
    squares = np.kron(np.indices((4, 4)).sum(axis=0) % 2, np.ones((8, 8)))[..., None]
    Image.fromarray((255 * (1 - 0.7 * squares * (1, 0.5, 0.2))).astype(np.uint8)).save(folder / "tiles.png")
    Image.fromarray(np.full((8, 8, 3), (40, 200, 90), np.uint8)).save(folder / "moss.png")
    floor = add_square(stage, "/floor", half=1.5)
    st = UsdGeom.PrimvarsAPI(floor).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    surface = paint(stage, floor, "/Looks/a", diffuseColor=(1.0, 1.0, 1.0), roughness=0.6)
    texture = UsdShade.Shader.Define(stage, "/Looks/a/texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./tiles.png")
    surface.GetInput("diffuseColor").ConnectToSource(texture.ConnectableAPI(), "rgb")
    block = UsdGeom.Cube.Define(stage, "/block")
    UsdGeom.Xformable(block).AddScaleOp().Set(Gf.Vec3f(0.4, 0.4, 0.4))
    paint(stage, block, "/Looks/b", diffuseColor=(0.5, 0.3, 0.2), roughness=0.4, metallic=0.3)
    spot = UsdLux.SphereLight.Define(stage, "/lights/a")
    spot.CreateTreatAsPointAttr(True)
    spot.CreateIntensityAttr(4.0)
    UsdLux.ShapingAPI.Apply(spot.GetPrim()).CreateShapingConeAngleAttr(40.0)
    place(spot, (1.0, 0.0, 2.0), 25.0)
    panel = UsdLux.RectLight.Define(stage, "/lights/b")
    panel.CreateIntensityAttr(1.0)
    place(panel, (-1.0, 0.5, 1.5), -30.0)
    return wc.from_usd(stage, WORLDS, device=device, exposure=0.0, textures={"moss": str(folder / "moss.png")})


CHANGES: dict[str, Callable[[torch.Tensor], Any]] = {
    "shape_colors": lambda t: t[1, 1].copy_(torch.tensor((0.1, 0.9, 0.2, 1.0))),
    "shape_materials": lambda t: t[1, 1].fill_(FLOOR),
    "material_texture": lambda t: t[1, FLOOR, 1].fill_(MOSS),
    "material_texture_repeat": lambda t: t[1, FLOOR].fill_(3.0),
    "material_texture_offset": lambda t: t[1, FLOOR].fill_(0.15),
    "material_texture_uniform": lambda t: t[1, FLOOR].fill_(True),
    "material_roughness": lambda t: t[1, BLOCK].fill_(0.1),
    "material_metallic": lambda t: t[1, BLOCK].fill_(1.0),
    "material_reflectance": lambda t: t[1].fill_(0.5),
    "material_emissive": lambda t: t[1, BLOCK, 0].fill_(0.2),
    "light_types": lambda t: t[1, SPOT].fill_(1),
    "light_active": lambda t: t[1, PANEL].fill_(False),
    "light_casts_shadow": lambda t: t[1].fill_(False),
    "light_positions": lambda t: t[1, SPOT, 0].sub_(0.3),
    "light_directions": lambda t: t[1, SPOT].copy_(torch.tensor((0.0, 0.0, -1.0))),
    "light_attenuation": lambda t: t[1, SPOT, 0].fill_(1.0),
    "light_cutoff": lambda t: t[1, SPOT].fill_(10.0),
    "light_exponent": lambda t: t[1, SPOT].fill_(20.0),
    "light_ambient": lambda t: t[1, SPOT].fill_(0.1),
    "light_diffuse": lambda t: t[1, SPOT, 2].fill_(0.1),
    "light_specular": lambda t: t[1].fill_(0.0),
    "light_intensity": lambda t: t[1, PANEL].fill_(3.0),
    "light_forms": lambda t: t[1, PANEL].fill_(SPHERE),
    "light_sizes": lambda t: t[1, PANEL, 0].fill_(0.1),
    "light_rotations": lambda t: t[1, PANEL].copy_(torch.eye(3)),
    "sky": lambda t: t[1].fill_(0.2),
    "headlight": lambda t: t[1, 0].fill_(0.3),
    "background": lambda t: t[1].fill_(0.5),
}


def test_names(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """All names that may be varied are tried here, and no name may be varied that no image shows."""
    scene = make(stage, tmp_path, device)
    paths = {"material_transmission"}  # which tests/path/test_frames.py tries
    assert set(override_names(scene._parts)) == set(CHANGES) | paths
    for name in ("material_color", "material_emission", "material_specular", "material_shininess"):
        with pytest.raises(WarpcamError, match=f"vary: '{name}' came; in this scene it may be shape_colors, "):
            scene.vary(name)
    with pytest.raises(WarpcamError, match="vary: 'material_color' came"):
        wc.randomize(scene, seed=1, material_color=(0.0, 1.0))


@pytest.mark.parametrize("name", CHANGES)
def test_one_world_differs(name: str, stage: Usd.Stage, tmp_path: Path, device: wp.Device, loads: list[str]) -> None:
    scene = make(stage, tmp_path, device)
    for each in SPECIAL:
        scene.vary(each)
    tensor = scene.vary(name)
    eye = wc.Camera(
        "eye", width=24, height=24, outputs=("rgb", "hdr"), shadows=True, lens=wc.Pinhole(fovy=60.0),
        position=(0.0, -2.2, 2.2), rotation=(0.92388, 0.382683, 0.0, 0.0),
    )  # fmt: skip
    renderer = wc.Renderer(scene, [eye])
    before = renderer.render()["eye"]["rgb"].clone()
    assert (before == before[0]).all()
    loads.clear()
    CHANGES[name](tensor)
    after = renderer.render()["eye"]["rgb"]
    assert [(before[world] != after[world]).any().item() for world in range(WORLDS)] == [False, True, False]
    assert loads == []
