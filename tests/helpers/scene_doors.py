"""Small scenes that name one other file, for each way in which a format does so."""

import base64
import io
import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import numpy as np
from PIL import Image

TETRAHEDRON = "v 0 0 0\nv 3 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nf 1/1 3/1 2/1\nf 1/1 2/1 4/1\nf 1/1 4/1 3/1\nf 2/1 3/1 4/1\n"
POINTS = np.array(((0, 0, 0), (3, 0, 0), (0, 1, 0)), "<f4").tobytes()
TRIANGLE = (
    '<mujoco><asset><mesh name="m" vertex="0 0 0 3 0 0 0 1 0 0 0 1"/>{}</asset><worldbody>{}</worldbody></mujoco>'
)
STAGE = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n{}\n)\n{}\n'
SOLID = 'def Cube "World" (\n{}\n)\n{{\n    double size = 6\n}}\n'
OVER = 'over "World" (\n{}\n)\n{{\n}}\n'


@dataclass(frozen=True)
class Door:
    """A way in.

    Attributes:
        write: Writes a scene into a folder, which names a file as given; returns the scene's file.
        ending: Of the other file.
        content: Of the other file.
    """

    write: Callable[[Path, str], Path]
    ending: str
    content: bytes


def png(width: int = 2, height: int = 2) -> bytes:
    """A red image."""
    data = io.BytesIO()
    Image.new("RGB", (width, height), (255, 0, 0)).save(data, "PNG")
    return data.getvalue()


def _written(ending: str, text: Callable[[str], str | bytes]) -> Callable[[Path, str], Path]:
    def write(folder: Path, name: str) -> Path:
        path, content = folder / f"it{ending}", text(name)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def _textured_obj(folder: Path, name: str) -> Path:
    (folder / "it.mtl").write_text(f"newmtl a\nmap_Kd {name}\n")
    (folder / "it.obj").write_text(f"mtllib it.mtl\nusemtl a\n{TETRAHEDRON}")
    return folder / "it.obj"


def gltf(buffer: str, image: str | None = None, **accessor: int) -> str:
    """A triangle whose positions are in a buffer."""
    tree = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": buffer, "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"} | accessor],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}} if image else {}}],
        "nodes": [{"mesh": 0}],
    }
    if image:
        tree |= {"images": [{"uri": image}], "textures": [{"source": 0}]}
    return json.dumps(tree)


def _ply(name: str) -> bytes:
    head = f"ply\nformat binary_little_endian 1.0\ncomment TextureFile {name}\nelement vertex 3\n" + "".join(
        f"property float {axis}\n" for axis in "xyzst"
    )
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = ((0, 0, 0, 0, 0), (3, 0, 0, 1, 0), (0, 1, 0, 0, 1))
    return head.encode() + b"".join(struct.pack("<5f", *row) for row in rows) + struct.pack("<Biii", 3, 0, 1, 2)


def dae(image: str, head: str = "") -> str:
    """A textured triangle."""
    return f"""<?xml version="1.0"?>{head}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>{image}</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="p"><sampler2D><source>s</source></sampler2D></newparam>
<technique sid="t"><lambert><diffuse><texture texture="p" texcoord="u"/></diffuse></lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="g-p"><float_array id="g-a" count="9">0 0 0 3 0 0 0 1 0</float_array><technique_common>
<accessor source="#g-a" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="g-v"><input semantic="POSITION" source="#g-p"/></vertices>
<triangles count="1" material="m"><input semantic="VERTEX" source="#g-v" offset="0"/><p>0 1 2</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="v"><node><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="m" target="#m"/></technique_common></bind_material></instance_geometry></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#v"/></scene></COLLADA>"""


def _urdf(visual: str) -> str:
    return f'<robot name="a"><link name="b"><visual>{visual}</visual></link></robot>'


def _mjcf(assets: str, body: str = '<geom type="mesh" mesh="m"/>', first: str = "") -> str:
    return TRIANGLE.format(assets, body).replace("<mujoco>", f"<mujoco>{first}")


def _of_folder(name: str) -> str:
    folder, _, file = name.rpartition("/")
    return _mjcf(f'<mesh name="n" file="{file}"/>', '<geom type="mesh" mesh="n"/>', f'<compiler meshdir="{folder}"/>')


def _clip(name: str) -> str:
    clips = (
        "    clips = {\n        dictionary default = {\n            double2[] active = [(0, 0)]\n            double2[] "
        f'times = [(0, 0)]\n            asset[] assetPaths = [@{name}@]\n            string primPath = "/World"\n'
        "        }\n    }"
    )
    return STAGE.format("", SOLID.format(clips))


def _usd_texture(name: str) -> str:
    return STAGE.format("", SOLID.format('    prepend apiSchemas = ["MaterialBindingAPI"]')).replace(
        "double size = 6", "double size = 6\n    rel material:binding = </Look>"
    ) + (
        'def Material "Look"\n{\n    token outputs:surface.connect = </Look/s.outputs:surface>\n'
        '    def Shader "s"\n    {\n'
        '        uniform token info:id = "UsdPreviewSurface"\n        color3f inputs:diffuseColor.connect = '
        '</Look/t.outputs:rgb>\n        token outputs:surface\n    }\n    def Shader "t"\n    {\n'
        f'        uniform token info:id = "UsdUVTexture"\n        asset inputs:file = @{name}@\n'
        "        float3 outputs:rgb\n    }\n}\n"
    )


DATA = f"data:application/octet-stream;base64,{base64.b64encode(POINTS).decode()}"
MESH, IMAGE = TETRAHEDRON.encode(), png()
LAYER = STAGE.format('    defaultPrim = "World"', SOLID.format("")).encode()
MODEL = _mjcf("", '<body name="b"><geom type="mesh" mesh="m"/></body>').encode()
PART = b'<mujoco><worldbody><geom type="box" size="3 1 1"/></worldbody></mujoco>'
FIELD = struct.pack("<ii6f", 2, 3, *range(6))
BOX = '<geometry><box size="1 1 1"/></geometry>'
IMAGED = '<material name="k" texture="t"/><texture name="t" type="2d" file="{}"/>'

DOORS = {
    "obj-mtllib": Door(_written(".obj", lambda name: f"mtllib {name}\n{TETRAHEDRON}"), ".mtl", b"newmtl a\nKd 1 0 0\n"),
    "obj-map": Door(_textured_obj, ".png", IMAGE),
    "gltf-buffer": Door(_written(".gltf", lambda name: gltf(quote(name))), ".bin", POINTS),
    "gltf-image": Door(_written(".gltf", lambda name: gltf(DATA, quote(name))), ".png", IMAGE),
    "ply-image": Door(_written(".ply", _ply), ".png", IMAGE),
    "dae-image": Door(_written(".dae", dae), ".png", IMAGE),
    "urdf-mesh": Door(
        _written(".urdf", lambda name: _urdf(f'<geometry><mesh filename="{name}"/></geometry>')), ".obj", MESH
    ),
    "urdf-image": Door(
        _written(".urdf", lambda name: _urdf(f'{BOX}<material name="m"><texture filename="{name}"/></material>')),
        ".png",
        IMAGE,
    ),
    "mjcf-mesh": Door(
        _written(".xml", lambda name: _mjcf(f'<mesh name="n" file="{name}"/>', '<geom type="mesh" mesh="n"/>')),
        ".obj",
        MESH,
    ),
    "mjcf-meshdir": Door(_written(".xml", _of_folder), ".obj", MESH),
    "mjcf-texture": Door(
        _written(".xml", lambda name: _mjcf(IMAGED.format(name), '<geom type="mesh" mesh="m" material="k"/>')),
        ".png",
        IMAGE,
    ),
    "mjcf-hfield": Door(
        _written(
            ".xml",
            lambda name: _mjcf(f'<hfield name="h" size="1 1 1 1" file="{name}"/>', '<geom type="hfield" hfield="h"/>'),
        ),
        ".hf",
        FIELD,
    ),
    "mjcf-include": Door(_written(".xml", lambda name: _mjcf("", first=f'<include file="{name}"/>')), ".xml", PART),
    "mjcf-model": Door(
        _written(
            ".xml", lambda name: _mjcf(f'<model name="c" file="{name}"/>', '<attach model="c" body="b" prefix="p"/>')
        ),
        ".xml",
        MODEL,
    ),
    "usd-sublayer": Door(
        _written(".usda", lambda name: STAGE.format(f"    subLayers = [@{name}@]", SOLID.format(""))), ".usda", LAYER
    ),
    "usd-reference": Door(
        _written(".usda", lambda name: STAGE.format("", SOLID.format(f"    references = @{name}@"))), ".usda", LAYER
    ),
    "usd-payload": Door(
        _written(".usda", lambda name: STAGE.format("", SOLID.format(f"    payload = @{name}@"))), ".usda", LAYER
    ),
    "usd-clip": Door(_written(".usda", _clip), ".usda", LAYER),
    "usd-image": Door(_written(".usda", _usd_texture), ".png", IMAGE),
}
