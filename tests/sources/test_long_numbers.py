"""Whole numbers of files that no float can hold: a value of theirs is refused, or the default taken, and told."""

import base64
import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import warpcam as wc
from warpcam.core.numbers import is_finite_number
from warpcam.datasets.generate.recipes import read_recipes
from warpcam.sensors import patterns

LONG = 10**400
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32).tobytes()
UVS = np.zeros((3, 2), np.float32).tobytes()
PIXEL = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4z8AAAAMBAQDJ/pLvAAAAAElFTkSuQmCC"
TURNED = {"KHR_texture_transform": {"offset": [0.1, 0.2], "scale": [2, 3], "rotation": 1, "texCoord": 0}}
GLTF: dict[str, Any] = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "translation": [1, 2, 3], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0, "mode": 4}]}],
    "accessors": [
        {"bufferView": 0, "byteOffset": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
        {"bufferView": 1, "byteOffset": 0, "componentType": 5126, "count": 3, "type": "VEC2"},
    ],
    "bufferViews": [
        {"buffer": 0, "byteOffset": 0, "byteLength": 36},
        {"buffer": 0, "byteOffset": 36, "byteLength": 24},
    ],
    "buffers": [
        {"uri": "data:application/octet-stream;base64," + base64.b64encode(CORNERS + UVS).decode(), "byteLength": 60}
    ],
    "materials": [
        {
            "pbrMetallicRoughness": {
                "baseColorFactor": [1, 0, 0, 1],
                "metallicFactor": 1,
                "roughnessFactor": 1,
                "baseColorTexture": {"index": 0, "texCoord": 0, "extensions": TURNED},
            },
            "emissiveFactor": [0, 0, 1],
            "alphaMode": "MASK",
            "alphaCutoff": 1,
            "extensions": {"KHR_materials_ior": {"ior": 2}, "KHR_materials_transmission": {"transmissionFactor": 1}},
        }
    ],
    "textures": [{"source": 0, "sampler": 0}],
    "samplers": [{"wrapS": 10497, "wrapT": 10497, "magFilter": 9729, "minFilter": 9729}],
    "images": [{"uri": f"data:image/png;base64,{PIXEL}"}],
}


def places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all numbers."""
    if isinstance(tree, dict | list):
        keys = tree if isinstance(tree, dict) else range(len(tree))
        return [found for key in keys for found in places(tree[key], (*path, key))]
    return [path] if isinstance(tree, int | float) else []


def with_number(path: tuple[Any, ...], number: int) -> str:
    tree = json.loads(json.dumps(GLTF))
    inner = tree
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = number
    return json.dumps(tree)


@pytest.mark.parametrize("number", [LONG, -LONG])
def test_gltf_files(number: int, tmp_path: Path) -> None:
    path = tmp_path / "it.gltf"
    path.write_text(json.dumps(GLTF))
    assert wc.load(path, device="cpu").num_worlds == 1
    assert len(places(GLTF)) > 50
    for place in places(GLTF):
        path.write_text(with_number(place, number))
        with contextlib.suppress(wc.WarpcamError):
            wc.load(path, device="cpu")


def test_recipes(tmp_path: Path) -> None:
    path = tmp_path / "it.yaml"
    for text in (f"frames: {LONG}", f"camera: {{fovy: {LONG}}}", f"lights: [{{intensity: [{LONG}, {LONG}]}}]"):
        path.write_text(text + "\n")
        with pytest.raises(wc.WarpcamError):
            read_recipes(path)


def test_patterns() -> None:
    for name in ("min_range", "max_range"):
        with pytest.raises(wc.WarpcamError, match=f"{name} must be a number"):
            patterns.rays(np.ones((2, 2, 3)), **{name: LONG})
    with pytest.raises(wc.WarpcamError, match="must be a positive number"):
        patterns.spinning([0.0], columns=4, rate=LONG)


def test_numbers_that_a_float_holds() -> None:
    for value in (0, -3, 2.5, np.float32(1.0), np.int64(7), 10**300):
        assert is_finite_number(value)
    for value in (True, np.nan, np.inf, LONG, -LONG, "1", None, 1j, np.complex64(1)):
        assert not is_finite_number(value)
