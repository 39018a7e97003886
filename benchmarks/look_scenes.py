"""Scenes of the gallery of looks: files that are written into a folder, and files of packages."""

import json
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import warpcam
from warpcam.benchmarks import scenes

Color = tuple[float, float, float]
Point = tuple[float, float, float]
DATA = Path(warpcam.__file__).parent / "data"


@dataclass(frozen=True)
class LookScene:
    """One scene, and where it is seen from.

    Attributes:
        title: What it is, and of which kind of file.
        write: Writes the files of the scene into a folder, if it is not a file of a package; returns its path.
        camera: Of the scene; None has one at ``position``.
        position: Of a camera [m].
        target: What that camera looks at [m].
        fovy: Its field of view [degrees].
        exposure: Of a scene of USD [stops]; None makes a white surface just white.
    """

    title: str
    write: Callable[[Path], Path]
    camera: str | None = None
    position: Point = (0.0, -4.0, 1.5)
    target: Point = (0.0, 0.0, 0.5)
    fovy: float = 40.0
    exposure: float | None = None


METALS = """<mujoco>
  <visual><headlight ambient="0 0 0" diffuse="0 0 0" specular="0 0 0"/><quality shadowsize="4096"/></visual>
  <asset>
    <texture type="skybox" builtin="gradient" rgb1="0.3 0.5 0.8" rgb2="0.9 0.9 0.85" width="128" height="768"/>
    <texture name="t" type="2d" builtin="checker" rgb1="0.75 0.75 0.72" rgb2="0.35 0.37 0.4" width="256" height="256"/>
    <material name="floor" texture="t" texrepeat="1 1" texuniform="true" specular="0.2" roughness="0.7"/>
    {materials}
  </asset>
  <worldbody>
    <light type="directional" pos="0 0 4" dir="0.5 0.6 -1" diffuse="0.8 0.75 0.65" specular="0.5 0.5 0.5"/>
    <geom type="plane" size="0 0 1" material="floor"/>
    {balls}
  </worldbody>
</mujoco>"""


def metals(folder: Path) -> Path:
    """Gold in front and plastic behind, rougher from left to right."""
    materials = balls = ""
    for row, (metallic, color) in enumerate(((1.0, "0.95 0.72 0.3"), (0.0, "0.7 0.1 0.1"))):
        for column, roughness in enumerate((0.05, 0.2, 0.4, 0.7)):
            name = f"m{row}{column}"
            materials += f'<material name="{name}" rgba="{color} 1" metallic="{metallic}" roughness="{roughness}"/>\n'
            place = f"{0.8 * column - 1.2} {0.9 * row} {0.35}"
            balls += f'<geom type="sphere" size="0.35" pos="{place}" material="{name}"/>\n'
    path = folder / "metals.xml"
    path.write_text(METALS.format(materials=materials, balls=balls))
    return path


def material(
    name: str, color: Color, roughness: float = 0.8, metallic: float = 0.0, emission: Color = (0.0,) * 3
) -> str:
    """Text of a material of USD."""
    return f"""def Material "{name}" {{
        token outputs:surface.connect = </{name}/surface.outputs:surface>
        def Shader "surface" {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = {color}
            float inputs:roughness = {roughness}
            float inputs:metallic = {metallic}
            color3f inputs:emissiveColor = {emission}
            token outputs:surface
        }}
    }}
    """


def solid(name: str, kind: str, of: str, place: Point, scale: Point = (1.0, 1.0, 1.0), turn: float = 0.0) -> str:
    """Text of a ball or a box of 2 m, scaled, turned about z [degrees] and put somewhere, with a material."""
    size = "double size = 2" if kind == "Cube" else "double radius = 1"
    return f"""def {kind} "{name}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
        {size}
        rel material:binding = </{of}>
        double3 xformOp:translate = {place}
        float xformOp:rotateZ = {turn}
        float3 xformOp:scale = {scale}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ", "xformOp:scale"]
    }}
    """


def write_stage(path: Path, *parts: str) -> Path:
    path.write_text('#usda 1.0\n(\nmetersPerUnit = 1\nupAxis = "Z"\n)\n' + "\n".join(parts))
    return path


def walls() -> tuple[str, ...]:
    """A room of 3 m with a red and a green wall, open towards -y."""
    return (
        material("white", (0.75, 0.75, 0.75)),
        material("red", (0.6, 0.08, 0.06)),
        material("green", (0.1, 0.45, 0.1)),
        solid("floor", "Cube", "white", (0.0, 0.0, -0.05), (1.6, 1.6, 0.05)),
        solid("ceiling", "Cube", "white", (0.0, 0.0, 3.05), (1.6, 1.6, 0.05)),
        solid("back", "Cube", "white", (0.0, 1.55, 1.5), (1.6, 0.05, 1.5)),
        solid("left", "Cube", "red", (-1.55, 0.0, 1.5), (0.05, 1.6, 1.5)),
        solid("right", "Cube", "green", (1.55, 0.0, 1.5), (0.05, 1.6, 1.5)),
    )


def area_light(folder: Path) -> Path:
    light = """def RectLight "lamp" {
        float inputs:width = 1
        float inputs:height = 1
        float inputs:intensity = 10
        double3 xformOp:translate = (0, 0, 2.95)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }"""
    tall = solid("tall", "Cube", "white", (-0.5, 0.5, 0.8), (0.4, 0.4, 0.8), 20.0)
    steel = material("steel", (0.8, 0.8, 0.82), 0.15, 1.0)
    ball = solid("ball", "Sphere", "steel", (0.55, -0.3, 0.5), (0.5, 0.5, 0.5))
    return write_stage(folder / "area_light.usda", *walls(), steel, tall, ball, light)


def lamps(folder: Path) -> Path:
    """What shines by itself in a room with hardly another light."""
    dim = 'def DomeLight "sky" {\nfloat inputs:intensity = 0.15\n}'
    parts = (
        material("warm", (0.0, 0.0, 0.0), emission=(9.0, 5.0, 2.0)),
        material("cold", (0.0, 0.0, 0.0), emission=(2.0, 4.0, 9.0)),
        solid("bulb", "Sphere", "warm", (-0.6, 0.2, 2.0), (0.25, 0.25, 0.25)),
        solid("tube", "Cube", "cold", (1.2, 0.4, 1.0), (0.05, 0.05, 0.9)),
        solid("table", "Cube", "white", (-0.3, 0.2, 0.4), (0.6, 0.4, 0.4), 15.0),
        solid("ball", "Sphere", "white", (0.7, -0.4, 0.35), (0.35, 0.35, 0.35)),
    )
    return write_stage(folder / "lamps.usda", *walls(), *parts, dim)


def sky(folder: Path) -> Path:
    """Balls from smooth to rough below an image of a sky with a bright sun."""
    rows, columns = np.mgrid[:128, :256]
    up = np.cos(np.pi * (rows + 0.5) / 128)[..., None]
    blue, ground = np.array((90.0, 140.0, 220.0)), np.array((90.0, 80.0, 70.0))
    image = np.where(up > 0.0, blue + (200.0 - blue) * np.exp(-6.0 * np.abs(up)), ground)
    image[np.hypot(rows - 40, columns - 90) < 7] = 255.0
    Image.fromarray(image.astype(np.uint8)).save(folder / "sky.png")
    dome = """def DomeLight "sky" {
        asset inputs:texture:file = @./sky.png@
        float xformOp:rotateX = 90
        uniform token[] xformOpOrder = ["xformOp:rotateX"]
    }"""
    parts = [material("floor", (0.5, 0.47, 0.42)), solid("ground", "Cube", "floor", (0, 0, -0.05), (4, 4, 0.05))]
    for number, roughness in enumerate((0.05, 0.2, 0.4, 0.7)):
        parts.append(material(f"metal{number}", (0.9, 0.9, 0.9), roughness, 1.0))
        place = (0.9 * number - 1.35, 0.0, 0.4)
        parts.append(solid(f"ball{number}", "Sphere", f"metal{number}", place, (0.4, 0.4, 0.4)))
    return write_stage(folder / "sky.usda", *parts, dome)


def write_gltf(path: Path, parts: Sequence[tuple[Any, Point, str, dict[str, Any]]]) -> Path:
    """Write meshes of trimesh, each at a place, with a material's name and what is added to the material."""
    import trimesh

    scene = trimesh.Scene()
    for number, (mesh, place, _, _) in enumerate(parts):
        moved = mesh.copy()
        moved.apply_translation(place)
        moved.apply_transform(trimesh.transformations.rotation_matrix(-0.5 * np.pi, (1, 0, 0)))  # glTF has y up
        moved.visual.material.name = f"material{number}"
        scene.add_geometry(moved, geom_name=f"part{number}")
    data = scene.export(file_type="glb")
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    added = {f"material{number}": (name, more) for number, (_, _, name, more) in enumerate(parts)}
    for each in document["materials"]:
        each["name"], more = added[each["name"]]
        each.update(more)
    names = {name for _, more in added.values() for name in more.get("extensions", ())}
    document["extensionsUsed"] = sorted({*document.get("extensionsUsed", ()), *names})
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    path.write_bytes(head + text + rest)
    return path


def _with_material(mesh: Any, uv: Any = None, **values: Any) -> Any:
    import trimesh

    surface = trimesh.visual.material.PBRMaterial(**values)
    mesh.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(mesh.vertices), 2)) if uv is None else uv,
                                                material=surface)  # fmt: skip
    return mesh


def _vase(**values: Any) -> Any:
    import trimesh

    mesh = trimesh.load(DATA / "vase.obj", process=False, force="mesh")
    return _with_material(mesh, mesh.visual.uv, **values)


def _floor() -> Any:
    """A checked floor of 3 m."""
    import trimesh

    checks = np.indices((8, 8)).sum(axis=0) % 2 * 110 + 80
    picture = Image.fromarray(np.kron(checks, np.ones((32, 32))).astype(np.uint8)).convert("RGB")
    corners = np.array([(-1.5, -1.5, 0.0), (1.5, -1.5, 0.0), (1.5, 1.5, 0.0), (-1.5, 1.5, 0.0)])
    mesh = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)
    uv = corners[:, :2] / 3.0 + 0.5
    return _with_material(mesh, uv, baseColorTexture=picture, roughnessFactor=0.8, metallicFactor=0.0)


def _block() -> Any:
    import trimesh

    box = _with_material(trimesh.creation.box((0.3, 0.2, 0.3)))
    box.apply_transform(trimesh.transformations.rotation_matrix(0.5, (0, 0, 1)))
    return box


def vases(folder: Path) -> Path:
    """A textured mesh as earthenware, glazed and of metal."""
    picture = Image.open(DATA / "vase.png").convert("RGB")
    looks = ((0.9, 0.0), (0.15, 0.0), (0.25, 1.0))
    parts: list[Any] = [(_floor(), (0.0, 0.0, 0.0), "floor", {})]
    for number, (roughness, metallic) in enumerate(looks):
        vase = _vase(baseColorTexture=picture, roughnessFactor=roughness, metallicFactor=metallic)
        parts.append((vase, (0.4 * number - 0.4, 0.0, 0.0), f"vase{number}", {}))
    return write_gltf(folder / "vases.glb", parts)


def glass(folder: Path) -> Path:
    """A ball and a vase of glass, and a vase that is not."""
    import trimesh

    def clear(color: Color, ior: float) -> dict[str, Any]:
        said = {"KHR_materials_transmission": {"transmissionFactor": 1.0}, "KHR_materials_ior": {"ior": ior},
                "KHR_materials_volume": {"thicknessFactor": 0.1}}  # fmt: skip
        return {"extensions": said, "pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "roughnessFactor": 0.0,
                                                             "metallicFactor": 0.0}}  # fmt: skip

    ball = _with_material(trimesh.creation.icosphere(subdivisions=4, radius=0.17))
    picture = Image.open(DATA / "vase.png").convert("RGB")
    vase = _vase(baseColorTexture=picture, roughnessFactor=0.3, metallicFactor=0.0)
    parts = [
        (_floor(), (0.0, 0.0, 0.0), "floor", {}),
        (ball, (-0.22, -0.25, 0.17), "ball", clear((1.0, 1.0, 1.0), 1.5)),
        (_block(), (0.32, -0.15, 0.15), "block", clear((0.6, 0.85, 0.75), 1.45)),
        (vase, (0.05, 0.45, 0.0), "vase", {}),
    ]
    return write_gltf(folder / "glass.glb", parts)


def arms(folder: Path) -> Path:
    """A file of the package mujoco_warp."""
    return scenes.package_folder("mujoco_warp") / "test_data" / "aloha_pot" / "scene.xml"


SCENES: dict[str, LookScene] = {
    "demo": LookScene("the demo, MJCF", lambda _: DATA / "demo.xml", "overview"),
    "arms": LookScene("two arms at a table, MJCF", arms, "overhead_cam"),
    "metals": LookScene("gold and plastic, MJCF", metals, position=(0.0, -3.6, 1.9), target=(0.0, 0.4, 0.25)),
    "area_light": LookScene(
        "a room with an area light, USD", area_light, position=(0.0, -5.4, 1.5), target=(0.0, 0.0, 1.5)
    ),
    "lamps": LookScene(
        "materials that shine, USD", lamps, position=(0.0, -5.4, 1.5), target=(0.0, 0.0, 1.5), exposure=0.0
    ),
    "sky": LookScene("metal below an image of a sky, USD", sky, position=(0.0, -4.2, 1.2), target=(0.0, 0.0, 0.4)),
    "vases": LookScene("textures, glTF", vases, position=(0.0, -1.6, 0.8), target=(0.0, 0.0, 0.15)),
    "glass": LookScene("glass, glTF", glass, position=(0.0, -1.5, 0.75), target=(0.0, 0.0, 0.13)),
}
