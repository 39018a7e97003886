"""Point clouds as files and for Open3D: what is written is what was read, without padding."""

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

import warpcam as wc
from warpcam import sensors

COLORS = ((255, 0, 3), (10, 20, 30), (0, 99, 7))


def cloud_of(**attributes: Any) -> dict[str, torch.Tensor]:
    """Three points of the second of two worlds, in clouds of five points."""
    points = torch.arange(24, dtype=torch.float32).reshape(2, 4, 3)
    points[1, 2] = torch.inf
    points[0] = torch.inf
    given = {
        "rgb": torch.tensor([[0] * 12, [*COLORS[0], *COLORS[1], 1, 1, 1, *COLORS[2]]], dtype=torch.uint8).reshape(
            2, 4, 3
        ),
        "normals": torch.nn.functional.normalize(torch.ones(2, 4, 3), dim=-1),
        "segmentation": torch.tensor([[0] * 4, [7, -1, 5, 6]], dtype=torch.int32),
        "barycentrics": torch.arange(16, dtype=torch.float32).reshape(2, 4, 2),
        **attributes,
    }
    given = {name: values for name, values in given.items() if values is not None}
    return sensors.PointClouds.of(points, attributes=given, num_points=5).read()


def says(text: str) -> Any:
    return pytest.raises(wc.WarpcamError, match=re.escape(text))


def test_a_ply_file_holds_the_cloud(tmp_path: Path) -> None:
    cloud = cloud_of()
    sensors.write_ply(tmp_path / "cloud.ply", cloud, world=1)
    read = trimesh.load(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(read.vertices, cloud["points"][1, :3])
    np.testing.assert_array_equal(read.colors[:, :3], COLORS)
    data = read.metadata["_ply_raw"]["vertex"]["data"]
    normals = np.stack([data[name] for name in ("nx", "ny", "nz")], axis=-1)
    np.testing.assert_allclose(normals, cloud["normals"][1, :3], atol=1e-6)
    assert data["segmentation"].tolist() == [7, -1, 6] and data["segmentation"].dtype == np.int32
    assert data["pixels"].tolist() == [0, 1, 3]
    assert data["barycentrics_0"].tolist() == [8.0, 10.0, 14.0] and data["barycentrics_1"].tolist() == [9.0, 11.0, 15.0]


def test_a_ply_file_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    cloud = cloud_of()
    for path, reason in ((tmp_path / "none" / "cloud.ply", "No such file or directory"), (tmp_path, "Is a directory")):
        with says(f"write_ply: {path} cannot be written: {reason}"):
            sensors.write_ply(path, cloud, world=1)


def test_a_ply_file_of_points_alone(tmp_path: Path) -> None:
    cloud = cloud_of(rgb=None, normals=None, segmentation=None, barycentrics=None)
    sensors.write_ply(str(tmp_path / "cloud.ply"), cloud, world=1)
    read = trimesh.load(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(read.vertices, cloud["points"][1, :3])
    assert set(read.metadata["_ply_raw"]["vertex"]["properties"]) == {"x", "y", "z", "pixels"}


def test_a_ply_file_of_an_empty_world(tmp_path: Path) -> None:
    sensors.write_ply(tmp_path / "cloud.ply", cloud_of(), world=0)
    assert b"element vertex 0\n" in (tmp_path / "cloud.ply").read_bytes()


def test_a_cloud_of_open3d() -> None:
    pytest.importorskip("open3d", reason="needs Open3D: pip install open3d")
    cloud = cloud_of()
    found = sensors.to_open3d(cloud, world=1)
    np.testing.assert_array_equal(found.point.positions.numpy(), cloud["points"][1, :3])
    np.testing.assert_allclose(found.point.colors.numpy(), np.array(COLORS) / 255.0, atol=1e-6)
    np.testing.assert_array_equal(found.point.normals.numpy(), cloud["normals"][1, :3])
    assert found.point.segmentation.numpy().tolist() == [[7], [-1], [6]]
    legacy = found.to_legacy()
    np.testing.assert_allclose(np.asarray(legacy.colors), np.array(COLORS) / 255.0, atol=1e-6)
    assert sensors.to_open3d(cloud).point.positions.shape[0] == 0


def test_colors_in_numbers(tmp_path: Path) -> None:
    light = torch.tensor([[0.0, 0.25, 1.0], [0.5, 0.2, 0.1], [0.3, 0.0, 0.9], [2.0, -1.0, 0.6]]).expand(2, 4, 3)
    cloud = cloud_of(rgb=light.clone())
    sensors.write_ply(tmp_path / "cloud.ply", cloud, world=1)
    read = trimesh.load(tmp_path / "cloud.ply")
    bytes_of = [[0, 64, 255], [128, 51, 26], [255, 0, 153]]
    np.testing.assert_array_equal(read.colors[:, :3], bytes_of)


def test_colors_in_numbers_for_open3d() -> None:
    pytest.importorskip("open3d", reason="needs Open3D: pip install open3d")
    light = torch.tensor([[0.0, 0.25, 1.0], [0.5, 0.2, 0.1], [0.3, 0.0, 0.9], [0.2, 0.1, 0.6]])
    found = sensors.to_open3d(cloud_of(rgb=light.expand(2, 4, 3).clone()), world=1)
    np.testing.assert_allclose(found.point.colors.numpy(), light[[0, 1, 3]])


@pytest.mark.parametrize(
    ("attributes", "text"),
    [
        ({"x": torch.zeros(2, 4)}, "cloud has an attribute 'x', but the file has 'x' already"),
        ({"red": torch.zeros(2, 4)}, "cloud has an attribute 'red', but the file has 'red' already"),
        (
            {"v": torch.zeros(2, 4, 2), "v_1": torch.zeros(2, 4)},
            "cloud has an attribute 'v_1', but the file has 'v_1' already",
        ),
        ({"my name": torch.zeros(2, 4)}, "names in a file must be ASCII without spaces, got 'my name'"),
        ({"": torch.zeros(2, 4)}, "names in a file must be ASCII without spaces, got ''"),
        ({"ä\n": torch.zeros(2, 4)}, "names in a file must be ASCII without spaces, got 'ä\\n'"),
        ({"rgb": torch.zeros(2, 4, 2, dtype=torch.uint8)}, "rgb must have 3 or 4 channels, got 2"),
        ({"rgb": torch.zeros(2, 4, dtype=torch.uint8)}, "rgb must have 3 or 4 channels, got 1"),
        ({"rgb": torch.zeros(2, 4, 3, dtype=torch.int32)}, "rgb must be uint8 or float32, got int32"),
        ({"normals": torch.zeros(2, 4)}, "normals must have 3 channels, got 1"),
        ({"normals": torch.zeros(2, 4, 4)}, "normals must have 3 channels, got 4"),
    ],
)
def test_attributes_that_a_file_cannot_have(attributes: Any, text: str, tmp_path: Path) -> None:
    for world in (0, 1):
        with says(f"write_ply: {text}"):
            sensors.write_ply(tmp_path / "cloud.ply", cloud_of(**attributes), world=world)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["positions", "colors"])
def test_names_that_open3d_has(name: str) -> None:
    pytest.importorskip("open3d", reason="needs Open3D: pip install open3d")
    with says(f"to_open3d: cloud has an attribute {name!r}, a name that Open3D has of its own"):
        sensors.to_open3d(cloud_of(**{name: torch.zeros(2, 4, 3)}))


@pytest.mark.parametrize(
    ("missing", "text"),
    [
        ("trimesh", "trimesh is not installed, and write_ply needs it: pip install 'warpcam[meshes]'"),
        ("open3d", "open3d is not installed, and to_open3d needs it: pip install open3d"),
    ],
)
def test_libraries_that_are_not_installed(
    missing: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with says(text):
        sensors.write_ply(tmp_path / "cloud.ply", cloud_of()) if missing == "trimesh" else sensors.to_open3d(cloud_of())


@pytest.mark.parametrize(
    ("cloud", "world", "text"),
    [
        (None, 2, "world must be 0 to 1, got 2"),
        (None, -1, "world must be 0 to 1, got -1"),
        (None, True, "world must be 0 to 1, got True"),
        ({"points": torch.zeros(1, 3)}, 0, "cloud must be what PointClouds.read gives, got dict"),
        (torch.zeros(1, 3), 0, "cloud must be what PointClouds.read gives, got Tensor"),
    ],
)
def test_mistakes(cloud: Any, world: Any, text: str, tmp_path: Path) -> None:
    with says(f"write_ply: {text}"):
        sensors.write_ply(tmp_path / "cloud.ply", cloud_of() if cloud is None else cloud, world=world)
    assert not list(tmp_path.iterdir())
