"""Writes a small scene as a USD stage, a URDF robot and a glTF file; `warpcam render` makes a picture of each.

python examples/formats.py FOLDER
warpcam render FOLDER/breakfast.usda --camera /World/Camera --worlds 1 --outputs rgb
warpcam render FOLDER/rover.urdf --worlds 1 --outputs rgb
warpcam render FOLDER/vases.glb --worlds 1 --outputs rgb
warpcam render --worlds 1 --outputs rgb  # the demo, an MJCF file
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

import warpcam

ASSETS = Path(warpcam.__file__).parent / "data"


def breakfast(path: Path) -> None:
    """A table with cups and a bowl of oranges: solids, instances, materials and lights."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.Xform.Define(stage, "/World")

    def paint(prim: UsdGeom.Gprim, color: tuple[float, float, float], roughness: float = 0.6) -> None:
        name = f"/World/Looks/{prim.GetPrim().GetName()}"
        material, shader = UsdShade.Material.Define(stage, name), UsdShade.Shader.Define(stage, f"{name}/surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material)

    def place(prim: UsdGeom.Gprim, position: tuple[float, float, float], scale: tuple[float, float, float]) -> None:
        prim.AddTranslateOp().Set(Gf.Vec3d(*position))
        prim.AddScaleOp().Set(Gf.Vec3f(*scale))

    floor = UsdGeom.Plane.Define(stage, "/World/Floor")
    floor.CreateWidthAttr(8.0)
    floor.CreateLengthAttr(8.0)
    paint(floor, (0.42, 0.44, 0.4))
    top = UsdGeom.Cube.Define(stage, "/World/Table")
    place(top, (0.0, 0.0, 0.7), (0.6, 0.4, 0.02))
    paint(top, (0.35, 0.19, 0.09))
    for index, (x, y) in enumerate(((-0.5, -0.3), (0.5, -0.3), (-0.5, 0.3), (0.5, 0.3))):
        leg = UsdGeom.Cylinder.Define(stage, f"/World/Leg{index}")
        leg.CreateRadiusAttr(0.03)
        leg.CreateHeightAttr(0.68)
        place(leg, (x, y, 0.34), (1.0, 1.0, 1.0))
        paint(leg, (0.3, 0.16, 0.08))
    for index, (x, y, color) in enumerate(
        ((-0.35, -0.1, (0.1, 0.3, 0.5)), (-0.1, -0.22, (0.7, 0.65, 0.5)), (0.4, 0.15, (0.55, 0.12, 0.1)))
    ):
        cup = UsdGeom.Cylinder.Define(stage, f"/World/Cup{index}")
        cup.CreateRadiusAttr(0.05)
        cup.CreateHeightAttr(0.12)
        place(cup, (x, y, 0.78), (1.0, 1.0, 1.0))
        paint(cup, color, 0.2)
    bowl = UsdGeom.Cone.Define(stage, "/World/Bowl")
    bowl.CreateRadiusAttr(0.18)
    bowl.CreateHeightAttr(0.14)
    place(bowl, (0.15, 0.0, 0.75), (1.0, 1.0, -1.0))
    paint(bowl, (0.75, 0.73, 0.68), 0.3)
    oranges = UsdGeom.PointInstancer.Define(stage, "/World/Oranges")
    orange = UsdGeom.Sphere.Define(stage, "/World/Oranges/Orange")
    orange.CreateRadiusAttr(0.05)
    paint(orange, (0.85, 0.32, 0.04), 0.4)
    angles = np.arange(5) * 2.0 * np.pi / 5.0
    places = [(0.15 + 0.09 * np.cos(a), 0.09 * np.sin(a), 0.86) for a in angles] + [(0.15, 0.0, 0.93)]
    oranges.CreatePositionsAttr([Gf.Vec3f(*map(float, place)) for place in places])
    oranges.CreateProtoIndicesAttr([0] * len(places))
    oranges.CreatePrototypesRel().AddTarget(orange.GetPath())
    sun = UsdLux.DistantLight.Define(stage, "/World/Sun")
    sun.CreateIntensityAttr(60000.0)  # of a disk half a degree wide
    sun.AddRotateXYZOp().Set(Gf.Vec3f(40.0, 25.0, 0.0))
    UsdLux.DomeLight.Define(stage, "/World/Sky").CreateIntensityAttr(0.5)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateFocalLengthAttr(32.0)
    view = Gf.Matrix4d().SetLookAt(Gf.Vec3d(1.3, -1.6, 1.7), Gf.Vec3d(0.0, 0.0, 0.68), Gf.Vec3d(0, 0, 1))
    camera.AddTransformOp().Set(view.GetInverse())
    stage.Save()


def rover(path: Path) -> None:
    """A robot with four wheels and an arm."""
    links, joints = [], []

    def link(name: str, shapes: str, parent: str = "", joint: str = "", kind: str = "continuous") -> None:
        inertia = '<mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
        links.append(f'<link name="{name}"><inertial>{inertia}</inertial>{shapes}</link>')
        if parent:
            limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind == "revolute" else ""
            ends = f'<parent link="{parent}"/><child link="{name}"/>'
            joints.append(f'<joint name="to_{name}" type="{kind}">{ends}{joint}{limit}</joint>')

    def shape(geometry: str, color: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
        where, what = f'<origin xyz="{xyz}" rpy="{rpy}"/>', f"<geometry>{geometry}</geometry>"
        paint = f'<material name="m{color}"><color rgba="{color} 1"/></material>'
        return f"<visual>{where}{what}{paint}</visual>"

    body = shape('<box size="0.6 0.36 0.12"/>', "1 0.65 0.1", "0 0 0.2")
    mast = shape('<cylinder radius="0.02" length="0.3"/>', "0.3 0.3 0.33", "0.2 0 0.4")
    eye = shape('<box size="0.06 0.16 0.06"/>', "0.15 0.15 0.18", "0.2 0 0.57")
    ground = shape('<box size="1.1 0.9 0.02"/>', "0.75 0.72 0.66", "0 0 -0.01")
    link("base", body + mast + eye + ground)
    wheel = shape('<cylinder radius="0.12" length="0.08"/>', "0.25 0.25 0.28", rpy="1.5708 0 0")
    hub = shape('<cylinder radius="0.05" length="0.09"/>', "0.95 0.95 0.9", rpy="1.5708 0 0")
    for index, (x, y) in enumerate(((0.22, 0.24), (0.22, -0.24), (-0.22, 0.24), (-0.22, -0.24))):
        link(f"wheel{index}", wheel + hub, "base", f'<origin xyz="{x} {y} 0.12"/><axis xyz="0 1 0"/>')
    arm = shape('<cylinder radius="0.03" length="0.3"/>', "0.9 0.92 0.95", "0 0 0.15")
    elbow = shape('<sphere radius="0.04"/>', "0.2 0.5 0.95", "0 0 0.3")
    turn = '<origin xyz="-0.15 0 0.26" rpy="0 0.4 0"/><axis xyz="0 1 0"/>'
    link("upper_arm", arm + elbow, "base", turn, "revolute")
    turn = '<origin xyz="0 0 0.3" rpy="0 1.4 0"/><axis xyz="0 1 0"/>'
    link("fore_arm", arm, "upper_arm", turn, "revolute")
    extra = '<mujoco><compiler discardvisual="false" fusestatic="false"/></mujoco>'
    path.write_text(f'<robot name="rover">{extra}{"".join(links)}{"".join(joints)}</robot>\n')


def vases(path: Path) -> None:
    """The demo's vase four times, with its texture and in plain colours, on a board."""
    vase = trimesh.load(ASSETS / "vase.obj", force="mesh", process=False)
    painted = trimesh.visual.material.PBRMaterial(
        "painted", baseColorTexture=Image.open(ASSETS / "vase.png"), metallicFactor=0.0, roughnessFactor=0.4
    )
    scene = trimesh.Scene()
    board = trimesh.creation.box((0.95, 0.95, 0.04))
    board.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial("board", baseColorFactor=(90, 75, 60, 255), metallicFactor=0.0)
    )
    upright = trimesh.transformations.rotation_matrix(-0.5 * np.pi, (1.0, 0.0, 0.0))  # glTF has y up
    scene.add_geometry(
        board, transform=upright @ trimesh.transformations.translation_matrix((0, 0, -0.02)), geom_name="board"
    )
    for index, color in enumerate((None, (40, 90, 130, 255), (170, 60, 45, 255), (210, 190, 120, 255))):
        copy = vase.copy()
        if color is None:
            copy.visual.material = painted
        else:
            copy.visual = trimesh.visual.TextureVisuals(
                material=trimesh.visual.material.PBRMaterial(
                    f"plain{index}", baseColorFactor=color, metallicFactor=0.0, roughnessFactor=0.3
                )
            )
        x, y = divmod(index, 2)
        shift = trimesh.transformations.translation_matrix((0.45 * x - 0.22, 0.45 * y - 0.22, 0.0))
        scene.add_geometry(copy, transform=upright @ shift, geom_name=f"vase{index}")
    scene.export(path)


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "breakfast.usda").unlink(missing_ok=True)
    breakfast(folder / "breakfast.usda")
    rover(folder / "rover.urdf")
    vases(folder / "vases.glb")
    print(*sorted(folder.iterdir()), sep="\n")
