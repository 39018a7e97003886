"""Small USD stages: text, binary and packages, with meshes, shapes, materials, instances, lights and cameras."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils

POINTS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1))
FACES = ((0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4))


def _mesh(stage: Usd.Stage, path: str) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(POINTS)
    mesh.CreateFaceVertexCountsAttr([3] * len(FACES))
    mesh.CreateFaceVertexIndicesAttr([corner for face in FACES for corner in face])
    return mesh


def _shapes(stage: Usd.Stage) -> None:
    for place, kind in enumerate((UsdGeom.Sphere, UsdGeom.Cube, UsdGeom.Cylinder, UsdGeom.Capsule, UsdGeom.Cone)):
        shape = kind.Define(stage, f"/World/shape{place}")
        shape.AddTranslateOp().Set(Gf.Vec3d(2.0 * place, 0, 0))
        shape.CreateDisplayColorAttr([(0.2 * place, 0.5, 0.1)])


def _material(stage: Usd.Stage) -> None:
    mesh = _mesh(stage, "/World/mesh")
    uvs = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    uvs.Set([(point[0], point[1]) for point in POINTS])
    material = UsdShade.Material.Define(stage, "/World/look")
    shader = UsdShade.Shader.Define(stage, "/World/look/shader")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.4)
    texture = UsdShade.Shader.Define(stage, "/World/look/image")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./a.png")
    output = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(output)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def _instances(stage: Usd.Stage) -> None:
    many = UsdGeom.PointInstancer.Define(stage, "/World/many")
    mesh = _mesh(stage, "/World/many/one")
    many.CreatePrototypesRel().AddTarget(mesh.GetPath())
    many.CreateProtoIndicesAttr([0, 0, 0])
    many.CreatePositionsAttr([(0, 0, 0), (2, 0, 0), (4, 0, 0)])
    copy = stage.DefinePrim("/World/copy", "Xform")
    copy.GetReferences().AddInternalReference("/World/many")
    copy.SetInstanceable(True)


def _lights(stage: Usd.Stage) -> None:
    _mesh(stage, "/World/mesh")
    UsdLux.DistantLight.Define(stage, "/World/sun").CreateIntensityAttr(3.0)
    UsdLux.SphereLight.Define(stage, "/World/lamp").CreateRadiusAttr(0.2)
    UsdLux.DomeLight.Define(stage, "/World/sky").CreateTextureFileAttr("./a.png")
    UsdGeom.Camera.Define(stage, "/World/camera").AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))


def _curves(stage: Usd.Stage) -> None:
    curve = UsdGeom.BasisCurves.Define(stage, "/World/curve")
    curve.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (2, 1, 0), (3, 1, 1)])
    curve.CreateCurveVertexCountsAttr([4])
    curve.CreateWidthsAttr([0.1])
    points = UsdGeom.Points.Define(stage, "/World/points")
    points.CreatePointsAttr(POINTS)
    points.CreateWidthsAttr([0.2] * len(POINTS))


def _animated(stage: Usd.Stage) -> None:
    mesh = _mesh(stage, "/World/mesh")
    turn = mesh.AddRotateZOp()
    for time in range(4):
        turn.Set(30.0 * time, time)
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateDisplayOpacityAttr([0.5])


def stages(image: bytes) -> Iterator[tuple[str, bytes]]:
    """Names and bytes of files; textures of all are ``a.png`` beside them."""
    for fill in (_shapes, _material, _instances, _lights, _curves, _animated):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "a.png").write_bytes(image)
            for ending in ("usda", "usdc"):
                for up in ("Y", "Z"):
                    stage = Usd.Stage.CreateNew(str(folder / f"{up}.{ending}"))
                    UsdGeom.SetStageUpAxis(stage, up)
                    UsdGeom.SetStageMetersPerUnit(stage, 0.01 if up == "Y" else 1.0)
                    stage.SetDefaultPrim(stage.DefinePrim("/World", "Xform"))
                    fill(stage)
                    stage.Save()
                    yield f"a.{ending}", (folder / f"{up}.{ending}").read_bytes()
            UsdUtils.CreateNewUsdzPackage(str(folder / "Z.usda"), str(folder / "a.usdz"))
            yield "a.usdz", (folder / "a.usdz").read_bytes()
