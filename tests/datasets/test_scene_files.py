"""Files that a scene is read from are all found, and a data set is not gone on with once one of them has changed."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from dataset_plans import plan_of
from PIL import Image

import warpcam as wc
from warpcam.core.file_access import FileAccess
from warpcam.datasets.generate import generate
from warpcam.datasets.generate.scene_files import scene_files

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def write_obj(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "mesh.obj").write_text("mtllib my looks.mtl\nmtllib a.mtl b.mtl\n" + TETRAHEDRON)
    (folder / "my looks.mtl").write_text("newmtl x\nmap_Kd -s 2 2 1 images\\wood grain.png\nmap_Ka not_drawn.png\n")
    for name in ("a", "b"):
        (folder / f"{name}.mtl").write_text(f"newmtl {name}\nKd 1 0 0\nnorm {name}.png\n")
        write_image(folder / f"{name}.png")
    write_image(folder / "images" / "wood grain.png")
    write_image(folder / "not_drawn.png")


def write_image(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((2, 2, 3), 99, np.uint8)).save(path)


OF_OBJ = {"mesh.obj", "my looks.mtl", "a.mtl", "b.mtl", "a.png", "b.png", "images/wood grain.png"}


def obj(folder: Path) -> tuple[str, set[str]]:
    write_obj(folder)
    return "mesh.obj", OF_OBJ


def mjcf(folder: Path) -> tuple[str, set[str]]:
    (folder / "parts").mkdir()
    (folder / "m").mkdir()
    (folder / "m" / "mesh.obj").write_text(TETRAHEDRON)
    write_image(folder / "m" / "wood.png")
    asset = '<asset><mesh file="mesh.obj"/><texture name="wood" type="2d" file="wood.png"/></asset>'
    (folder / "parts" / "more.xml").write_text(f"<mujoco>{asset}</mujoco>")
    (folder / "scene.xml").write_text(
        '<mujoco><compiler assetdir="m"/><include file="parts/more.xml"/>'
        '<worldbody><geom type="mesh" mesh="mesh"/></worldbody></mujoco>'
    )
    return "scene.xml", {"scene.xml", "parts/more.xml", "m/mesh.obj", "m/wood.png"}


def urdf(folder: Path) -> tuple[str, set[str]]:
    write_obj(folder / "arm" / "meshes")
    (folder / "arm" / "urdf").mkdir()
    mesh = '<visual><geometry><mesh filename="package://arm/meshes/mesh.obj"/></geometry></visual>'
    (folder / "arm" / "urdf" / "arm.urdf").write_text(f'<robot name="arm"><link name="base">{mesh}</link></robot>')
    return "arm/urdf/arm.urdf", {"arm/urdf/arm.urdf", *(f"arm/meshes/{name}" for name in OF_OBJ)}


def gltf(folder: Path) -> tuple[str, set[str]]:
    (folder / "my data.bin").write_bytes(bytes(12))
    write_image(folder / "wood.png")
    inside = {"uri": "data:image/png;base64,aaaa"}
    tree = {"asset": {"version": "2.0"}, "buffers": [{"uri": "my%20data.bin", "byteLength": 12}]}
    (folder / "scene.gltf").write_text(json.dumps({**tree, "images": [{"uri": "wood.png"}, inside]}))
    return "scene.gltf", {"scene.gltf", "my data.bin", "wood.png"}


def usd(folder: Path) -> tuple[str, set[str]]:
    pytest.importorskip("pxr.Usd", reason="needs USD: pip install warpcam[usd]")
    write_image(folder / "wood.png")
    header = '#usda 1.0\n(defaultPrim = "Mug")\n'
    texture = 'def Shader "image" {\n asset inputs:file = @wood.png@\n}\n'
    (folder / "mug.usda").write_text(header + 'def Xform "Mug" {\n' + texture + "}\n")
    (folder / "scene.usda").write_text('#usda 1.0\ndef "World" (references = @./mug.usda@) {\n}\n')
    return "scene.usda", {"scene.usda", "mug.usda", "wood.png"}


def collada(folder: Path) -> tuple[str, set[str]]:
    for name in ("my wood.png", "tin.png"):
        write_image(folder / name)
    images = "<image><init_from>file:///elsewhere/my%20wood.png</init_from></image>"
    images += "<image><init_from><ref>tin.png</ref></init_from></image>"
    (folder / "scene.dae").write_text(f"<COLLADA>{images}</COLLADA>")
    return "scene.dae", {"scene.dae", "my wood.png", "tin.png"}


def ply(folder: Path) -> tuple[str, set[str]]:
    write_image(folder / "scan.png")
    (folder / "scan.ply").write_bytes(b"ply\nformat ascii 1.0\ncomment TextureFile scan.png\nend_header\n")
    return "scan.ply", {"scan.ply", "scan.png"}


@pytest.mark.parametrize("write", [obj, mjcf, urdf, gltf, usd, collada, ply])
def test_all_that_a_scene_names(write: Callable[[Path], tuple[str, set[str]]], tmp_path: Path) -> None:
    scene, files = write(tmp_path)
    (tmp_path / "unrelated.obj").write_text(TETRAHEDRON)
    assert {
        path.relative_to(tmp_path).as_posix() for path in scene_files(tmp_path / scene, FileAccess(tmp_path / scene))
    } == files


@pytest.mark.parametrize("name", ["a.xml", "a.urdf", "a.gltf", "a.glb", "a.usda", "a.dae", "a.obj", "a.ply"])
def test_a_broken_file_names_nothing(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"\xff\x00<{ broken")
    assert scene_files(tmp_path / name, FileAccess(tmp_path / name)) == [tmp_path / name]


def test_changed_files_are_named(tmp_path: Path) -> None:
    scene, _ = mjcf(tmp_path)
    plan = plan_of(tmp_path, recipes="textures: {folder: TEXTURES}\nlabels: {by: shape, classes: {m: mesh}}", count=1)
    text = '<mujoco><compiler assetdir="m"/><include file="parts/more.xml"/>'
    text += '<worldbody><geom name="mesh" type="mesh" mesh="mesh"/></worldbody></mujoco>'
    (tmp_path / scene).write_text(text)
    generate(plan)
    generate(plan)
    mesh, image = tmp_path / "m" / "mesh.obj", tmp_path / "textures" / "1.png"
    before = mesh.read_text(), image.read_bytes()
    mesh.write_text(TETRAHEDRON.replace("v 0 0 1", "v 0 0 2"))
    write_image(image)
    with pytest.raises(wc.WarpcamError, match=re.escape("made with other scene_sha256.m/mesh.obj, textures_sha256;")):
        generate(plan)
    mesh.write_text(before[0])
    image.write_bytes(before[1])
    generate(plan)
