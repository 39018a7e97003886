"""Stages for tests, and images of them."""

from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

import warpcam as wc


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
    """It faces up."""
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
