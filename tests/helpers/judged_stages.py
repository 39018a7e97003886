"""The scenes of judged_scenes.py as stages of USD."""

from pathlib import Path
from typing import Any

import judged_scenes as judged
import numpy as np
import warp as wp
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from usd_stages import add_material, add_mesh

import warpcam as wc

CAMERA = wc.Camera(
    "c",
    width=judged.SIZE,
    height=judged.SIZE,
    lens=wc.Pinhole(fovy=judged.FOVY),
    position=(0.0, 0.0, 0.0),
    outputs=("hdr", "rgba", "segmentation"),
)


def scene_of(stage: Usd.Stage, scene: judged.Judged, device: wp.Device) -> wc.Scene:
    """Fill an empty stage, and open it."""
    glass = []
    for number, one in enumerate(scene.shapes):
        path = f"/shape{number}"
        prim = _shape(stage, path, one)
        look = one.look
        reflectance = ((look.index - 1.0) / (look.index + 1.0)) ** 2 if look.kind == "glass" else 0.0
        surface = add_material(
            stage,
            f"/Looks/m{number}",
            diffuseColor=(1.0, 1.0, 1.0) if look.kind == "metal" else look.color,
            roughness=look.roughness,
            metallic=1.0 if look.kind == "metal" else 0.0,
            ior=look.index if reflectance else 1.0,
            emissiveColor=look.emission,
        )
        if look.texture:
            _add_texture(stage, surface, number)
        UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(stage, f"/Looks/m{number}"))
        glass.append(float(look.kind == "glass"))
    for number, one in enumerate(scene.lights):
        _light(stage, f"/light{number}", one)
    if scene.sky is not None:
        sky = UsdLux.DomeLight.Define(stage, "/sky")
        sky.CreateColorAttr(scene.sky)
    elif not scene.lights:  # or a headlight would shine
        UsdLux.DomeLight.Define(stage, "/sky").CreateIntensityAttr(0.0)
    opened = wc.from_usd(stage, device=device, exposure=0.0)
    names = [opened.array("shape_materials").numpy()[0, shape] for shape in range(len(scene.shapes))]
    transmission = opened.array("material_transmission").numpy()
    transmission[0, names] = glass
    opened.array("material_transmission").assign(transmission)
    return opened


def _shape(stage: Usd.Stage, path: str, one: Any) -> Any:
    if isinstance(one, judged.Faces):
        mesh = add_mesh(stage, path, one.points, one.faces)
        if one.uvs is not None:
            uvs = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
            uvs.Set([tuple(uv) for uv in one.uvs])
        return mesh
    if isinstance(one, judged.Ball):
        prim = UsdGeom.Sphere.Define(stage, path)
        prim.CreateRadiusAttr(one.radius)
        UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(*one.middle))
        return prim
    prim = UsdGeom.Cube.Define(stage, path)
    prim.CreateSizeAttr(2.0)
    place = UsdGeom.Xformable(prim)
    place.AddTranslateOp().Set(Gf.Vec3d(*one.middle))
    place.AddRotateYOp().Set(one.turn)
    place.AddScaleOp().Set(Gf.Vec3f(*one.half))
    return prim


def _add_texture(stage: Usd.Stage, surface: UsdShade.Shader, number: int) -> None:
    folder = Path(stage.GetRootLayer().realPath).parent
    Image.fromarray(judged.texture()).save(folder / "texture.png")
    reader = UsdShade.Shader.Define(stage, f"/Looks/m{number}/texture")
    reader.CreateIdAttr("UsdUVTexture")
    reader.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./texture.png")
    reader.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    for axis in ("wrapS", "wrapT"):
        reader.CreateInput(axis, Sdf.ValueTypeNames.Token).Set("repeat")
    place = UsdShade.Shader.Define(stage, f"/Looks/m{number}/place")
    place.CreateIdAttr("UsdPrimvarReader_float2")
    place.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    output = place.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    reader.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(output)
    color = reader.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    surface.GetInput("diffuseColor").ConnectToSource(color)


def _light(stage: Usd.Stage, path: str, one: Any) -> None:
    if isinstance(one, judged.Sun):
        sun = UsdLux.DistantLight.Define(stage, path)
        sun.CreateAngleAttr(0.0)
        sun.CreateIntensityAttr(one.irradiance)
        turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(*map(float, one.toward))).GetQuat()
        UsdGeom.Xformable(sun).AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(turn)
        return
    if isinstance(one, judged.Point):
        lamp = UsdLux.SphereLight.Define(stage, path)
        lamp.CreateRadiusAttr(0.1)
        lamp.CreateTreatAsPointAttr(True)
        lamp.CreateNormalizeAttr(True)
        lamp.CreateColorAttr(one.intensity)
        lamp.CreateIntensityAttr(4.0)  # a quarter of what it sends in all is what arrives at 1 m
        UsdGeom.Xformable(lamp).AddTranslateOp().Set(Gf.Vec3d(*one.middle))
        return
    lamp = UsdLux.RectLight.Define(stage, path)
    lamp.CreateWidthAttr(2.0 * one.half[0])
    lamp.CreateHeightAttr(2.0 * one.half[1])
    lamp.CreateColorAttr(one.radiance)
    place = UsdGeom.Xformable(lamp)
    place.AddTranslateOp().Set(Gf.Vec3d(*one.middle))
    place.AddRotateXYZOp().Set(Gf.Vec3f(*one.turn))


def judged_pixels(images: dict[str, np.ndarray]) -> np.ndarray:
    """The pixels that are compared, (row, column) bool: those that one shape covers, as their neighbours do."""
    shape, whole = images["segmentation"][..., 0], images["rgba"][..., 3] == 255
    padded = np.pad(shape, 1, constant_values=-2)
    size = shape.shape[0]
    alike = [padded[1 + j : 1 + j + size, 1 + i : 1 + i + size] == shape for j in (-1, 0, 1) for i in (-1, 0, 1)]
    inner = np.zeros_like(whole)
    inner[1:-1, 1:-1] = np.logical_and.reduce(alike)[1:-1, 1:-1]
    return whole & inner
