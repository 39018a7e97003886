"""Stages for tests, and images of them."""

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
from views import Around

import warpcam as wc

QUARTERS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [200, 100, 50]]], np.uint8)  # from the top


def metric(stage: Usd.Stage, unit: float = 1.0, up: str = "Z") -> Usd.Stage:
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    UsdGeom.SetStageUpAxis(stage, up)
    return stage


def add_mesh(stage: Usd.Stage, path: str, points: Any, faces: list, **attributes: Any) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([tuple(map(float, point)) for point in points])
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([int(index) for face in faces for index in face])
    mesh.CreateSubdivisionSchemeAttr(attributes.pop("scheme", "none"))
    for name, value in attributes.items():
        mesh.GetPrim().GetAttribute(name).Set(value)
    return mesh


def add_square(stage: Usd.Stage, path: str, z: float = 0.0, half: float = 1.0, **attributes: Any) -> UsdGeom.Mesh:
    """Add a square that faces up."""
    points = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    return add_mesh(stage, path, points, [(0, 1, 2, 3)], **attributes)


def above(height: float = 3.0, size: int = 32, span: float = 4.0, *outputs: str, **more: Any) -> wc.Camera:
    """Looks down; its image is ``span`` wide, columns along x, rows against y."""
    return wc.Camera(
        "above",
        width=size,
        height=size,
        lens=wc.Orthographic(height=span),
        position=(0.0, 0.0, height),
        outputs=outputs or ("depth",),
        **more,
    )


def image(scene: wc.Scene, output: str = "depth", camera: wc.Camera | None = None, world: int = 0) -> np.ndarray:
    camera = camera or above(3.0, 32, 4.0, output)
    return wc.Renderer(scene, [camera]).render()[camera.name][output][world].cpu().numpy().squeeze()


def add_material(stage: Usd.Stage, path: str, **inputs: Any) -> UsdShade.Shader:
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        kind = Sdf.ValueTypeNames.Color3f if isinstance(value, tuple) else Sdf.ValueTypeNames.Float
        shader.CreateInput(name, kind).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return shader


def pose(prim: Any, scale: tuple = (1.0, 1.0, 1.0)) -> np.ndarray:
    """Turn, shift and stretch a prim; returns the frame."""
    matrix = Gf.Matrix4d().SetScale(Gf.Vec3d(*scale)) * Gf.Matrix4d().SetRotate(Gf.Rotation((1, 2, 3), 40.0))
    matrix.SetTranslateOnly((0.3, -0.2, 0.5))
    UsdGeom.Xformable(prim).AddTransformOp().Set(matrix)
    return np.array(matrix).T


def expected(entry: Any, frame: np.ndarray, around: Around) -> np.ndarray:
    """Depth of a solid of ``closed_form`` in a frame, (4, 4)."""
    back = np.linalg.inv(frame)
    rays = around.rays()
    t, _ = entry(np.broadcast_to(back[:3, :3] @ around.eye + back[:3, 3], rays.shape), rays @ back[:3, :3].T)
    return t.reshape(around.size, around.size)


def save_image(path: Path, pixels: np.ndarray = QUARTERS, times: int = 16) -> Path:
    Image.fromarray(pixels.repeat(times, axis=0).repeat(times, axis=1)).save(path)
    return path


def bind(prim: Any, stage: Usd.Stage, path: str) -> None:
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(stage, path))


def textured_square(stage: Usd.Stage, file: str, *, uvs: Any = None, how: str = "vertex", **inputs: Any) -> Any:
    """A square 2 m wide, seen from above, with an image on it; returns its surface and the texture's reader."""
    square = add_square(stage, "/it")
    uvs = [(0, 0), (1, 0), (1, 1), (0, 1)] if uvs is None else uvs
    primvar = UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, how)
    primvar.Set([tuple(map(float, uv)) for uv in uvs])
    surface = add_material(stage, "/Looks/m", diffuseColor=(0.5, 0.5, 0.5))
    reader = UsdShade.Shader.Define(stage, "/Looks/m/uv")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture = UsdShade.Shader.Define(stage, "/Looks/m/tex")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    for name, value in inputs.items():
        kind = Sdf.ValueTypeNames.Float4 if isinstance(value, tuple) else Sdf.ValueTypeNames.Token
        texture.CreateInput(name, kind).Set(Gf.Vec4f(*value) if isinstance(value, tuple) else value)
    surface.GetInput("diffuseColor").ConnectToSource(texture.ConnectableAPI(), "rgb")
    bind(square, stage, "/Looks/m")
    return surface, texture


def albedo(scene: wc.Scene, span: float = 2.0, world: int = 0) -> np.ndarray:
    return image(scene, "albedo", above(3.0, 32, span, "albedo"), world)
