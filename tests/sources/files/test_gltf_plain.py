"""glTF files whose numbers are stored in other ways than as plain floats of triangles: where surfaces come to lie."""

import base64
import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("trimesh")

import warpcam as wc
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.files.gltf_textures import laid

SQUARE = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
FACES = np.array([(0,), (1,), (2,), (0,), (2,), (3,)], np.uint16)
KINDS = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A file of one mesh, in the making."""

    def __init__(self) -> None:
        self.blob = b""
        self.primitive: dict[str, Any] = {"attributes": {}}
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [self.primitive]}], "bufferViews": [], "accessors": [],
        }  # fmt: skip

    def view(self, array: np.ndarray) -> int:
        self.blob += bytes(-len(self.blob) % 4)
        view = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": array.nbytes}
        self.tree["bufferViews"].append(view)
        self.blob += array.tobytes()
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, array: np.ndarray, **more: Any) -> int:
        kind = {"componentType": KINDS[str(array.dtype)], "count": len(array), "type": TYPES[array.shape[1]]}
        self.tree["accessors"].append({"bufferView": self.view(array), **kind, **more})
        return len(self.tree["accessors"]) - 1

    def bounds(self, folder: Path, name: str | None = None) -> list[list[float]]:
        uri = name or "data:application/octet-stream;base64," + base64.b64encode(self.blob).decode()
        self.tree["buffers"] = [{"byteLength": len(self.blob), "uri": uri}]
        (folder / "made.gltf").write_text(json.dumps(self.tree))
        low, high = wc.load(folder / "made.gltf", device="cpu", up_axis=None).bounds()
        return np.round([low, high], 4).tolist()


def square(points: np.ndarray = SQUARE, **more: Any) -> Gltf:
    file = Gltf()
    file.primitive["attributes"]["POSITION"] = file.accessor(points, **more)
    file.primitive["indices"] = file.accessor(FACES)
    return file


@pytest.mark.parametrize("kind", [np.int8, np.int16])
def test_normalized_positions(tmp_path: Path, kind: Any) -> None:
    most = np.iinfo(kind).max
    padded = np.zeros((4, 4), kind)
    padded[:, :3] = SQUARE * most
    file = square()
    at = file.tree["accessors"][0]
    at |= {"bufferView": file.view(padded), "componentType": KINDS[np.dtype(kind).name], "normalized": True}
    file.tree["bufferViews"][-1]["byteStride"] = padded.strides[0]
    assert file.bounds(tmp_path) == [[-1, -1, 0], [1, 1, 0]]


@pytest.mark.parametrize("base", [True, False])
def test_sparse_accessors(tmp_path: Path, base: bool) -> None:
    file = square()
    if not base:
        del file.tree["accessors"][0]["bufferView"]
    where, values = np.array([[2]], np.uint16), np.array([(3, 5, 7)], np.float32)
    file.tree["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": file.view(where), "componentType": 5123},
        "values": {"bufferView": file.view(values)},
    }
    assert file.bounds(tmp_path) == [[-1, -1, 0] if base else [0, 0, 0], [3, 5, 7]]


@pytest.mark.parametrize(("mode", "order"), [(5, (0, 1, 3, 2)), (6, (0, 1, 2, 3))])
@pytest.mark.parametrize("indexed", [True, False])
def test_strips_and_fans(tmp_path: Path, mode: int, order: tuple[int, ...], indexed: bool) -> None:
    file = Gltf()
    line = np.array(order, np.uint16)
    file.primitive["mode"] = mode
    file.primitive["attributes"]["POSITION"] = file.accessor(SQUARE if indexed else SQUARE[line])
    if indexed:
        file.primitive["indices"] = file.accessor(line[:, None])
    assert file.bounds(tmp_path) == [[-1, -1, 0], [1, 1, 0]]


def test_encoded_names(tmp_path: Path) -> None:
    file = square()
    (tmp_path / "my scene.bin").write_bytes(file.blob)
    assert file.bounds(tmp_path, "my%20scene.bin") == [[-1, -1, 0], [1, 1, 0]]


@pytest.mark.parametrize("place", ["meshes", "nodes"])
def test_morph_targets_at_rest(tmp_path: Path, place: str) -> None:
    file = square()
    file.primitive["targets"] = [{"POSITION": file.accessor(SQUARE)}]
    file.tree["meshes"][0]["weights"] = [0.0]
    file.tree[place][0]["weights"] = [0.5]
    assert file.bounds(tmp_path) == [[-1.5, -1.5, 0], [1.5, 1.5, 0]]


def test_instances(tmp_path: Path) -> None:
    file = square()
    places = file.accessor(np.array([(-5, 0, 0), (7, 0, 0)], np.float32))
    file.tree["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
    file.tree["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    assert file.bounds(tmp_path) == [[-6, -1, 0], [8, 1, 0]]


def test_extensions_that_are_not_drawn(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = square()
    file.tree["extensionsUsed"] = ["KHR_materials_volume", "KHR_materials_sheen", "KHR_mesh_quantization"]
    with caplog.at_level(logging.WARNING):
        file.bounds(tmp_path)
    assert "KHR_materials_volume, KHR_materials_sheen" in caplog.text
    assert "KHR_mesh_quantization" not in caplog.text


def rows(matrix: np.ndarray) -> np.ndarray:
    """A matrix as glTF stores it, column after column."""
    return np.ascontiguousarray(matrix.T.reshape(1, 16), np.float32)


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


@pytest.mark.parametrize("turned", [False, True])
def test_skins_are_as_they_are_at_rest(tmp_path: Path, turned: bool) -> None:
    """The right half of a square hangs on a joint that has moved since it was bound; the mesh's node has no effect."""
    file = square()
    file.primitive["attributes"]["JOINTS_0"] = file.accessor(np.array([(0, 1, 0, 0)] * 4, np.uint8))
    weights = np.array([(1, 0, 0, 0), (0, 1, 0, 0), (0, 1, 0, 0), (1, 0, 0, 0)], np.float32)
    file.primitive["attributes"]["WEIGHTS_0"] = file.accessor(weights)
    binds = file.accessor(np.concatenate((rows(np.eye(4)), rows(moved(x=-1.0)))))
    file.tree["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [0, 50, 0]},
        {"children": [2]},
        {"translation": [4, 0, 0], **({"rotation": [0, 0, 1, 0]} if turned else {})},
    ]
    file.tree["scenes"] = [{"nodes": [0, 1]}]
    file.tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": binds}]
    # a corner (1, y) is (0, y) in the joint's frame: at (4, y), or turned about z at (4, -y)
    assert file.bounds(tmp_path) == [[-1, -1, 0], [4, 1, 0]]


def test_a_skin_blends_its_joints(tmp_path: Path) -> None:
    file = square()
    file.primitive["attributes"]["JOINTS_0"] = file.accessor(np.array([(0, 1, 0, 0)] * 4, np.uint16))
    share = np.array([(64, 191, 0, 0)] * 4, np.uint8)
    file.primitive["attributes"]["WEIGHTS_0"] = file.accessor(share, normalized=True)
    file.tree["nodes"] = [{"mesh": 0, "skin": 0}, {}, {"translation": [0, 0, 255]}]
    file.tree["scenes"] = [{"nodes": [0, 1, 2]}]
    file.tree["skins"] = [{"joints": [1, 2]}]
    assert file.bounds(tmp_path) == [[-1, -1, 191], [1, 1, 191]]


UVS = np.array([(0.25, 0.5), (1.0, 0.0)], np.float32)
TRANSFORMS: dict[str, tuple[dict[str, Any], list[tuple[float, float]]]] = {
    "none": ({}, [(0.25, 0.5), (1.0, 0.0)]),
    "offset": ({"offset": [0.5, -1.0]}, [(0.75, -0.5), (1.5, -1.0)]),
    "scale": ({"scale": [2.0, 0.5]}, [(0.5, 0.25), (2.0, 0.0)]),
    "a quarter turn, counter-clockwise in images": ({"rotation": np.pi / 2}, [(0.5, -0.25), (0.0, -1.0)]),
    "all": ({"offset": [1.0, 1.0], "rotation": np.pi / 2, "scale": [2.0, 1.0]}, [(1.5, 0.5), (1.0, -1.0)]),
}


@pytest.mark.parametrize("kind", TRANSFORMS)
def test_texture_coordinates_are_moved(kind: str) -> None:
    transform, expected = TRANSFORMS[kind]
    texture = {"index": 0, "extensions": {"KHR_texture_transform": transform}}
    tree = {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": texture}}], "textures": [{}]}
    found = laid(tree, 0, {"TEXCOORD_0": UVS}, WarningCollector("it"))
    np.testing.assert_allclose(found["TEXCOORD_0"], expected, atol=1e-6)


@pytest.mark.parametrize("by_extension", [False, True])
def test_the_set_of_texture_coordinates_is_the_textures_own(by_extension: bool) -> None:
    texture: dict[str, Any] = {"index": 0, "texCoord": 0 if by_extension else 1}
    if by_extension:
        texture["extensions"] = {"KHR_texture_transform": {"texCoord": 1}}
    tree = {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": texture}}], "textures": [{}]}
    found = laid(tree, 0, {"TEXCOORD_0": UVS, "TEXCOORD_1": UVS + 2}, WarningCollector("it"))
    np.testing.assert_array_equal(found["TEXCOORD_0"], UVS + 2)
    assert set(found) == {"TEXCOORD_0"}


def test_a_file_without_scenes_shows_all_its_nodes(tmp_path: Path) -> None:
    file = square()
    file.tree["nodes"] = [{"translation": [5, 0, 0], "children": [1]}, {"mesh": 0}, {"mesh": 0}]
    del file.tree["scene"], file.tree["scenes"]
    assert file.bounds(tmp_path) == [[-1, -1, 0], [6, 1, 0]]


def test_accessors_that_reach_beyond_their_buffer(tmp_path: Path) -> None:
    file = square()
    file.tree["accessors"][0]["count"] = 400
    with pytest.raises(wc.WarpcamError, match="accessor 0: its 400 elements reach beyond the buffer's end"):
        file.bounds(tmp_path)
