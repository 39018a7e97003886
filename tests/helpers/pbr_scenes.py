"""Stages with one thing to be lit, and what their images hold."""

from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from usd_stages import add_material, add_mesh

FOVY, SIZE = 30.0, 48
UPRIGHT = np.array((0.0, 0.0, 1.0))

SPHERE_AT = np.array((0.0, 0.0, -4.0))  # of radius 1, seen from the origin along -z


def bind(prim: Any, stage: Usd.Stage, **inputs: Any) -> UsdShade.Shader:
    surface = add_material(stage, "/Looks/m", **inputs)
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(stage, "/Looks/m"))
    return surface


def add_ball(stage: Usd.Stage, **inputs: Any) -> None:
    ball = UsdGeom.Sphere.Define(stage, "/ball")
    ball.CreateRadiusAttr(1.0)
    UsdGeom.Xformable(ball).AddTranslateOp().Set(Gf.Vec3d(*SPHERE_AT))
    bind(ball, stage, **inputs)


def add_sun(stage: Usd.Stage, toward: Any, color: Any = (1.0, 1.0, 1.0), angle: float = 0.0) -> None:
    """Shines from ``toward``; a white surface that faces it shows ``color``."""
    sun = UsdLux.DistantLight.Define(stage, "/sun")
    sun.CreateNormalizeAttr(True)
    sun.CreateAngleAttr(angle)
    sun.CreateIntensityAttr(np.pi)
    sun.CreateColorAttr(color)
    turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(*map(float, toward))).GetQuat()
    UsdGeom.Xformable(sun).AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(turn)


def see(stage: Usd.Stage, device: wp.Device, *outputs: str, exposure: float = 0.0, **more: Any) -> dict[str, Any]:
    camera = wc.Camera(
        "c", width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=FOVY), position=(0.0, 0.0, 0.0), outputs=outputs, **more
    )
    images = wc.Renderer(wc.from_usd(stage, device=device, exposure=exposure), [camera]).render()["c"]
    return {name: tensor[0].cpu().numpy() for name, tensor in images.items()}


def ball_normals() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pixels that see the ball, (row, column) bool, with normals and directions to the eye, (pixel, 3)."""
    half = np.tan(np.radians(0.5 * FOVY))
    at = ((np.arange(SIZE) + 0.5) / SIZE * 2.0 - 1.0) * half
    x, y = np.meshgrid(at, -at)
    ray = np.stack((x, y, -np.ones_like(x)), axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = ray @ SPHERE_AT
    rest = along**2 - (SPHERE_AT @ SPHERE_AT - 1.0)
    hit = rest > 1e-3
    place = (along[hit] - np.sqrt(rest[hit]))[:, None] * ray[hit]
    return hit, place - SPHERE_AT, -ray[hit]


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=-1, keepdims=True)


def unit(a: Any) -> np.ndarray:
    a = np.asarray(a, np.float64)
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def textured_floor(stage: Usd.Stage, mirrored: bool = False, **files: tuple[str, str, str]) -> None:
    """A white matt floor of 2 m below the camera; input=(file, output, colour space)."""
    square = add_mesh(stage, "/floor", [(-1, -1, -2), (1, -1, -2), (1, 1, -2), (-1, 1, -2)], [(0, 1, 2, 3)])
    uvs = [(1, 0), (0, 0), (0, 1), (1, 1)] if mirrored else [(0, 0), (1, 0), (1, 1), (0, 1)]
    UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(uvs)
    surface = bind(square, stage, diffuseColor=(1.0, 1.0, 1.0), ior=1.0)
    for name, (file, output, space) in files.items():
        texture = UsdShade.Shader.Define(stage, f"/Looks/m/{name}")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        if name == "normal":
            texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set((2, 2, 2, 1))
            texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set((-1, -1, -1, 0))
        kind = Sdf.ValueTypeNames.Float if len(output) == 1 else Sdf.ValueTypeNames.Color3f
        given = surface.GetInput(name) or surface.CreateInput(name, kind)
        given.ConnectToSource(texture.ConnectableAPI(), output)
