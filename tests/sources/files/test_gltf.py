"""Colours and textures of glTF files beside the plain case: drawn, or told of."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from PIL import Image

pytest.importorskip("trimesh")

import warpcam as wc

POINTS = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
UVS = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
KINDS = {"<f4": 5126, "<u2": 5123, "|u1": 5121}
HALF = 188  # of linear light, as a display value


def write(folder: Path, colors: Any = None, material: dict | None = None, **more: Any) -> Path:
    """A square, 2 m wide, that faces +z; with colours of its corners."""
    blob, views, accessors = b"", [], []
    arrays = {"POSITION": POINTS, "TEXCOORD_0": UVS, "COLOR_0": colors, "": FACES}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    for name, array in arrays.items():
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
        kind = {1: "SCALAR", 2: f"VEC{array.shape[-1]}"}[array.ndim]
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": KINDS[array.dtype.str], "count": len(array), "type": kind}
        )
        if name == "POSITION":
            accessors[-1] |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        if name == "COLOR_0" and array.dtype.kind == "u":
            accessors[-1]["normalized"] = True
        blob += array.tobytes() + bytes(-array.nbytes % 4)
    places = {name: index for index, name in enumerate(arrays)}
    primitive: dict[str, Any] = {"indices": places.pop(""), "attributes": places}
    if material is not None:
        primitive["material"] = 0
        more["materials"] = [{"name": "paint", **material}]
    uri = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": len(blob), "uri": uri}],
        "bufferViews": views,
        "accessors": accessors,
        **more,
    }
    path = folder / "it.gltf"
    path.write_text(json.dumps(tree))
    return path


def shown(path: Path, device: wp.Device) -> np.ndarray:
    """Base colours of the square's quarters, row by row, (4, 3)."""
    eye = wc.Camera("eye", width=4, height=4, lens=wc.Orthographic(height=2.0), position=(0, 0, 3), outputs=("albedo",))
    scene = wc.load(path, device=device, up_axis=None)
    albedo = wc.Renderer(scene, [eye]).render()["eye"]["albedo"][0].cpu().numpy()
    return albedo[[0, 0, 3, 3], [0, 3, 0, 3]].astype(int)


def image(folder: Path, color: tuple[int, int, int] = (0, 255, 0)) -> dict[str, Any]:
    Image.fromarray(np.full((4, 4, 3), color, np.uint8)).save(folder / "it.png")
    return {"images": [{"uri": "it.png"}], "textures": [{"source": 0}]}


def even(color: tuple, dtype: Any = np.float32) -> np.ndarray:
    return np.tile(np.array(color, dtype), (4, 1))


COLORS = {
    "floats": even((0.5, 0, 0, 1)),
    "without alpha": even((0.5, 0, 0)),
    "bytes": even((128, 0, 0, 255), np.uint8),
    "words": even((32768, 0, 0, 65535), np.uint16),
}


@pytest.mark.parametrize("kind", COLORS)
def test_colours_of_corners(kind: str, tmp_path: Path, device: wp.Device) -> None:
    """Vertex colours are linear, also without a material."""
    for material in ({}, None):
        found = shown(write(tmp_path, COLORS[kind], material), device)
        np.testing.assert_allclose(found, np.tile((HALF, 0, 0), (4, 1)), atol=1)


def test_colours_of_corners_are_a_factor(tmp_path: Path, device: wp.Device) -> None:
    """Vertex colours multiply the base colour, and, if all are alike, its texture."""
    dark = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 1]}}
    found = shown(write(tmp_path, even((1, 1, 0)), dark), device)
    np.testing.assert_allclose(found, np.tile((HALF, 255, 0), (4, 1)), atol=1)
    painted = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    found = shown(write(tmp_path, even((1, 0.5, 1)), painted, **image(tmp_path)), device)
    np.testing.assert_allclose(found, np.tile((0, HALF, 0), (4, 1)), atol=1)


def test_corners_of_several_colours(tmp_path: Path, caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    """Blended between them; beside a texture they are left out, and that is said."""
    colors = np.array([(1, 0, 0), (1, 0, 0), (0, 0, 1), (0, 0, 1)], np.float32)  # red below, blue above
    found = shown(write(tmp_path, colors, {}), device)
    assert (found[:2, 2] > found[:2, 0] + 60).all() and (found[2:, 0] > found[2:, 2] + 60).all()
    assert not caplog.text
    painted = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    found = shown(write(tmp_path, colors, painted, **image(tmp_path)), device)
    np.testing.assert_array_equal(found, np.tile((0, 255, 0), (4, 1)))
    assert "has colours of corners beside textures, and is drawn without them" in caplog.text


MOVED = {"index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0]}}}
TOLD: dict[str, tuple[dict, dict]] = {
    "has textures that lie differently, and is drawn with all as the first: paint": (
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "emissiveTexture": MOVED},
        {},
    ),
    "has a texture for texture coordinates 1, which a mesh has not: paint": (
        {"normalTexture": {"index": 0, "texCoord": 1}},
        {},
    ),
    "uses extensions of glTF that are not drawn: KHR_materials_sheen": (
        {},
        {"extensionsRequired": ["KHR_materials_sheen"]},
    ),
    "has things of glTF that are not read: cameras, lights, animations": (
        {},
        {
            "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
            "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point"}]}},
            "animations": [{"channels": [], "samplers": []}],
        },
    ),
}


@pytest.mark.parametrize("packed", [False, True], ids=["gltf", "glb"])
@pytest.mark.parametrize("text", TOLD)
def test_what_is_not_drawn_is_told(text: str, packed: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    material, more = TOLD[text]
    path = write(tmp_path, None, material, **image(tmp_path), **more)
    if packed:
        chunk = path.read_bytes()
        chunk += b" " * (-len(chunk) % 4)
        path = path.with_suffix(".glb")
        head = [0x46546C67, 2, 20 + len(chunk), len(chunk), 0x4E4F534A]
        path.write_bytes(b"".join(number.to_bytes(4, "little") for number in head) + chunk)
    wc.load(path, device="cpu")
    assert text in caplog.text


def test_what_changes_nothing_is_not_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    still = {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": {}}}
    names = ["KHR_texture_transform"]
    material = {"pbrMetallicRoughness": {"baseColorTexture": still}}
    wc.load(write(tmp_path, None, material, **image(tmp_path), extensionsRequired=names), device="cpu")
    assert not caplog.text


def test_extensions_that_are_needed_and_not_known(tmp_path: Path) -> None:
    names = ["EXT_meshopt_compression"]
    with pytest.raises(wc.WarpcamError, match="needs extensions of glTF that are not read here: EXT_meshopt"):
        wc.load(write(tmp_path, None, None, extensionsRequired=names, extensionsUsed=names), device="cpu")
