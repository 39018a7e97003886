"""Meshes of robots in every format that ``load`` reads: sizes, colours and images on every way to a simulator."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.sources.common.formats import MESHES, USD
from warpcam.sources.mujoco import urdf

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("collada")
pytest.importorskip("pxr")

from pxr import Sdf, UsdUtils  # noqa: E402, it may be missing

COLORLESS = (".stl", ".msh")
RED = (1.0, 0.0, 0.0)
QUARTERS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
STAGE = """#usda 1.0
(
    defaultPrim = "it"
    metersPerUnit = {unit}
    upAxis = "{up}"
)
def Xform "it"
{{
{prims}
}}
"""
MESH = """def Mesh "box"
{{
    point3f[] points = [{points}]
    int[] faceVertexIndices = [{corners}]
    int[] faceVertexCounts = [{counts}]
    color3f[] primvars:displayColor = [(1, 0, 0)]
    uniform token subdivisionScheme = "none"
}}"""
SOLIDS = """def Cube "cube"
{
    double size = 200
}
def Sphere "ball"
{
    double radius = 100
    double3 xformOp:translate = (0, 0, 300)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Cube "hidden"
{
    double size = 5000
    token visibility = "invisible"
}"""
PLATE = """def Mesh "plate" (
    prepend apiSchemas = ["MaterialBindingAPI"]
)
{
    rel material:binding = </it/m>
    point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
        interpolation = "vertex"
    )
}
def Material "m"
{
    token outputs:surface.connect = </it/m/s.outputs:surface>
    def Shader "s"
    {
        uniform token info:id = "UsdPreviewSurface"
        token outputs:surface
        color3f inputs:diffuseColor.connect = </it/m/t.outputs:rgb>
    }
    def Shader "t"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @q.png@
        float3 outputs:rgb
    }
}"""
DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>
<up_axis>Z_UP</up_axis></asset><library_effects><effect id="e"><profile_COMMON><technique sid="t"><lambert><diffuse>
<color>1 0 0 1</color></diffuse></lambert></technique></profile_COMMON></effect></library_effects><library_materials>
<material id="m"><instance_effect url="#e"/></material></library_materials><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="24">{points}</float_array><technique_common><accessor source="#pa" count="8"
stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles material="y"
count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p></triangles></mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="w"><node id="n"><instance_geometry url="#g">
<bind_material><technique_common><instance_material symbol="y" target="#m"/></technique_common></bind_material>
</instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def msh(path: Path, mesh: Any, normals: bool = False, uvs: np.ndarray | None = None) -> Path:
    """MuJoCo's binary file of a mesh."""
    parts = [np.asarray(mesh.vertices, "<f4")]
    parts += [np.asarray(mesh.vertex_normals, "<f4")] if normals else []
    parts += [uvs.astype("<f4")] if uvs is not None else []
    count = len(mesh.vertices)
    head = np.array((count, normals * count, (uvs is not None) * count, len(mesh.faces)), "<i4")
    parts.append(np.asarray(mesh.faces, "<i4"))
    path.write_bytes(head.tobytes() + b"".join(part.tobytes() for part in parts))
    return path


def stage(path: Path, prims: str, unit: float = 1.0, up: str = "Z") -> Path:
    """A stage, in text or not by its suffix."""
    text = path.with_name("stage.usda")
    text.write_text(STAGE.format(unit=unit, up=up, prims=prims))
    if path.suffix == ".usdz":
        assert UsdUtils.CreateNewUsdzPackage(str(text), str(path))
    elif path.suffix != ".usda":
        Sdf.Layer.FindOrOpen(str(text)).Export(str(path))
    else:
        text.rename(path)
    return path


def red_box(path: Path) -> Path:
    """A box of 1 x 2 x 3 m, red if the format has colours."""
    mesh = trimesh.creation.box((1, 2, 3))
    if path.suffix in USD:
        points = ", ".join(str(tuple(map(float, point))) for point in mesh.vertices)
        corners = ", ".join(map(str, mesh.faces.reshape(-1)))
        return stage(path, MESH.format(points=points, corners=corners, counts=", ".join(["3"] * len(mesh.faces))))
    if path.suffix == ".msh":
        return msh(path, mesh)
    if path.suffix == ".dae":
        points, corners = (" ".join(map(str, part.reshape(-1))) for part in (mesh.vertices, mesh.faces))
        path.write_text(DAE.format(points=points, corners=corners))
        return path
    if path.suffix == ".obj":
        path.with_suffix(".mtl").write_text("newmtl m\nKd 1 0 0\n")
        text = mesh.export(file_type="obj", include_normals=False)
        path.write_text(f"mtllib {path.stem}.mtl\nusemtl m\n{text}")
        return path
    if path.suffix == ".ply":
        mesh.visual.vertex_colors = (255, 0, 0, 255)
    else:
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=(255, 0, 0, 255))
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
    if path.suffix == ".gltf":
        for name, data in trimesh.Scene(mesh).export(file_type="gltf").items():
            (path if name == "model.gltf" else path.with_name(name)).write_bytes(data)
        return path
    mesh.export(path)
    return path


def robot(folder: Path, name: str, more: str = "") -> Path:
    shape = f'<geometry><mesh filename="{name}"{more}/></geometry>'
    path = folder / "it.urdf"
    link = f'<link name="a">{INERTIAL}<visual>{shape}</visual><collision>{shape}</collision></link>'
    path.write_text(f'<robot name="r">{link}</robot>')
    return path


def by_mujoco(path: Path) -> list[tuple[Any, Any]]:
    """Extents and colours of visual and collision shape."""
    model = urdf.load(path)
    return [(size_in_mujoco(model, geom), model.geom_rgba[geom, :3]) for geom in range(model.ngeom)]


def size_in_mujoco(model: mujoco.MjModel, geom: int) -> Any:
    mesh = model.geom_dataid[geom]
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    return np.ptp(model.mesh_vert[start : start + count] @ turn.reshape(3, 3).T, axis=0)


def of_builder(builder: Any) -> list[tuple[Any, Any]]:
    return [
        (np.ptp(np.asarray(source.vertices), axis=0), np.asarray(color[:3], np.float64))
        for source, color in zip(builder.shape_source, builder.shape_color, strict=True)
    ]


def by_newton(path: Path) -> list[tuple[Any, Any]]:
    newton = pytest.importorskip("newton")
    builder = newton.ModelBuilder()
    wc.add_urdf(builder, path)
    return of_builder(builder)


def by_isaac_gym(path: Path) -> list[tuple[Any, Any]]:
    pytest.importorskip("newton")
    from warpcam.compat.isaacgym import gymapi

    gym, params = gymapi.acquire_gym(), gymapi.SimParams()
    params.up_axis, params.use_gpu_pipeline = gymapi.UP_AXIS_Z, False
    sim = gym.create_sim(-1, 0, gymapi.SIM_PHYSX, params)
    try:
        return of_builder(gym.load_asset(sim, str(path.parent), path.name, gymapi.AssetOptions()).builder)
    finally:
        gym.destroy_sim(sim)


WAYS: dict[str, Callable[[Path], list[tuple[Any, Any]]]] = {
    "load": by_mujoco,
    "Newton": by_newton,
    "Isaac Gym": by_isaac_gym,
}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of pycollada
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("suffix", [*MESHES, *USD])
def test_every_format(suffix: str, way: str, tmp_path: Path, caplog: Any) -> None:
    red_box(tmp_path / f"box{suffix}")
    found = WAYS[way](robot(tmp_path, f"box{suffix}", ' scale="2 1 1"'))
    assert len(found) == 2
    for size, _ in found:
        np.testing.assert_allclose(size, (2, 2, 3), atol=1e-4)
    shown = max((color for _, color in found), key=lambda color: float(np.ptp(color)))
    assert suffix in COLORLESS or np.abs(np.subtract(shown, RED)).max() < 0.01
    assert not caplog.text


@pytest.mark.parametrize("way", WAYS)
def test_solids_of_a_stage(way: str, tmp_path: Path) -> None:
    """They are cut into triangles; units count, axes do not, and what is invisible is left out."""
    stage(tmp_path / "it.usda", SOLIDS, 0.01, "Y")
    found = WAYS[way](robot(tmp_path, "it.usda"))
    sizes = sorted(tuple(np.round(size, 3).tolist()) for size, _ in found)
    assert sizes == [(2.0, 2.0, 2.0), (2.0, 2.0, 2.0), (2.0, 2.0, 5.0)]  # those that are seen, and both to be touched


def test_a_stage_keeps_its_image(tmp_path: Path, device: wp.Device) -> None:
    Image.fromarray(np.array(QUARTERS, np.uint8).reshape(2, 2, 3).repeat(32, 0).repeat(32, 1)).save(tmp_path / "q.png")
    stage(tmp_path / "it.usda", PLATE)
    scene = wc.load(robot(tmp_path, "it.usda"), device=device)
    camera = wc.Camera(
        "c", width=8, height=8, lens=wc.Orthographic(height=2.0), position=(0, 0, 3), outputs=("albedo",)
    )
    image = wc.Renderer(scene, [camera]).render()["c"]["albedo"][0].cpu().numpy()
    assert [tuple(map(int, image[row, column])) for row in (1, 6) for column in (1, 6)] == QUARTERS


@pytest.mark.parametrize("normals", [False, True])
def test_msh_is_read_as_mujoco_reads_it(normals: bool, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.apply_scale((1, 2, 3))
    uvs = np.stack((np.linspace(0.0, 1.0, len(ball.vertices)), np.linspace(0.0, 0.5, len(ball.vertices))), axis=1)
    path = msh(tmp_path / "ball.msh", ball, normals, uvs)
    geom = '<worldbody><geom type="mesh" mesh="m"/></worldbody>'
    model = mujoco.MjModel.from_xml_string(f'<mujoco><asset><mesh name="m" file="{path}"/></asset>{geom}</mujoco>')
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    theirs = wc.from_mujoco(model, data, device="cpu")
    ours = wc.load(path, device="cpu")
    np.testing.assert_allclose(ours.bounds(), theirs.bounds(), atol=1e-5)


BROKEN = {
    "short": (b"\1\0\0\0", "it has 4 bytes, and a header alone has 16"),
    "cut off": (np.array((3, 0, 0, 1), "<i4").tobytes(), "which are 64 bytes; it has 16"),
    "text": (b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", "is a file of Gmsh"),
    "no faces": (np.array((1, 0, 0, 0, 0, 0, 0), "<i4").tobytes(), "has no triangles that can be drawn"),
    "indices": (np.array((1, 0, 0, 1, 0, 0, 0, 0, 0, 7), "<i4").tobytes(), "must be indices from 0 to 0, got 7"),
    "numbers": (np.array((1, 0, 0, 1, 0x7FC00000, 0, 0, 0, 0, 0), "<i4").tobytes(), "vertices must be finite"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_broken_msh(kind: str, tmp_path: Path) -> None:
    data, text = BROKEN[kind]
    (tmp_path / "it.msh").write_bytes(data)
    with pytest.raises(wc.WarpcamError, match=text):
        wc.load(tmp_path / "it.msh", device="cpu")
