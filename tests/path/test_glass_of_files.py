"""Transmission and index of refraction of files: glTF's extensions and UsdPreviewSurface."""

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from path_scenes import traced
from PIL import Image

pytest.importorskip("trimesh")
pytest.importorskip("pxr.Usd")
import trimesh
from pbr_scenes import add_ball
from pxr import Usd

import warpcam as wc

TRANSMISSION, IOR, VOLUME = "KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume"


def written(folder: Path, extensions: dict[str, Any], more: Any = None, **plain: Any) -> Path:
    """A glTF file of a ball of radius 1 m with one material, which is no metal unless ``plain`` says so."""
    files = trimesh.creation.icosphere(subdivisions=3).export(file_type="gltf")
    for name, data in files.items():
        (folder / name).write_bytes(data)
    path = folder / "model.gltf"
    tree = json.loads(path.read_text())
    numbers = {"baseColorFactor": [0.9, 0.95, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.0, **plain}
    tree["materials"] = [{"name": "window", "pbrMetallicRoughness": numbers, "extensions": extensions}]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    path.write_text(json.dumps(tree | (more or {})))
    return path


def opened(path: Path, device: wp.Device) -> wc.Scene:
    return wc.load(path, device=device, up_axis=None)


def transmission(folder: Path, extensions: dict[str, Any], more: Any = None, **plain: Any) -> float:
    scene = opened(written(folder, extensions, more, **plain), wp.get_device("cpu"))
    return float(scene.array("material_transmission").numpy().item())


def metal_map(folder: Path, *values: int) -> dict[str, Any]:
    """An image whose texels, one beside the other, are so much metal, in 255ths."""
    pixels = np.array([[(0, 255, value) for value in values]], np.uint8)
    Image.fromarray(pixels).save(folder / "metal.png")
    return {"images": [{"uri": "metal.png"}], "textures": [{"source": 0}]}


def eye(*outputs: str) -> wc.Camera:
    return wc.Camera(
        "eye", width=24, height=24, lens=wc.Pinhole(fovy=40.0), position=(0.0, 0.0, 4.0), outputs=outputs or ("hdr",)
    )


def test_a_ball_of_gltf_is_that_set_by_hand(tmp_path: Path, device: wp.Device) -> None:
    """Bit for bit; and it is not what a solid ball shows."""
    said = {TRANSMISSION: {"transmissionFactor": 0.75}, IOR: {"ior": 1.8}}
    scene = opened(written(tmp_path, said), device)
    seen = traced(scene, eye(), 16)["hdr"]
    by_hand = opened(written(tmp_path, {}), device)
    solid = traced(by_hand, eye(), 16)["hdr"]
    by_hand.array("material_transmission").fill_(0.75)
    by_hand.array("material_reflectance").fill_((0.8 / 2.8) ** 2)
    np.testing.assert_array_equal(seen, traced(by_hand, eye(), 16)["hdr"])
    assert np.abs(seen - solid).max() > 0.05


@pytest.mark.parametrize(("said", "metal", "wanted"), [
    ({}, 0.0, 0.0), ({"transmissionFactor": 0.6}, 0.0, 0.6), ({"transmissionFactor": 0.6}, 0.25, 0.45),
    ({"transmissionFactor": 1.0}, 1.0, 0.0), ({"transmissionFactor": 7.0}, 0.0, 1.0),
    ({"transmissionFactor": "much"}, 0.0, 0.0),
])  # fmt: skip
def test_share_that_goes_through(said: dict[str, Any], metal: float, wanted: float, tmp_path: Path) -> None:
    """Metals let no light through."""
    assert transmission(tmp_path, {TRANSMISSION: said}, metallicFactor=metal) == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize(("values", "wanted"), [((0, 0), 0.8), ((255, 255), 0.0), ((0, 255), 0.4)])
def test_maps_of_metal_count_by_their_mean(
    values: tuple[int, int], wanted: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Which is told where texels differ."""
    plain = {"metallicFactor": 1.0, "metallicRoughnessTexture": {"index": 0}}
    found = transmission(tmp_path, {TRANSMISSION: {"transmissionFactor": 0.8}}, metal_map(tmp_path, *values), **plain)
    assert found == pytest.approx(wanted, abs=1e-6)
    assert ("has transmission and a map of metalness, whose mean counts for it: window" in caplog.text) == (
        values[0] != values[1]
    )


def test_unlit_materials_are_solid(tmp_path: Path) -> None:
    assert transmission(tmp_path, {TRANSMISSION: {"transmissionFactor": 1.0}, "KHR_materials_unlit": {}}) == 0.0


def test_a_map_of_transmission_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    said = {TRANSMISSION: {"transmissionFactor": 0.5, "transmissionTexture": {"index": 0}}}
    assert transmission(tmp_path, said) == pytest.approx(0.5)
    assert "has a map of transmission, which is not read: its factor counts everywhere: window" in caplog.text


@pytest.mark.parametrize("thickness", [None, 0.0, 0.1])
def test_walls_without_thickness_are_told(
    thickness: float | None, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    volume = {} if thickness is None else {VOLUME: {"thicknessFactor": thickness}}
    with caplog.at_level(logging.INFO, logger="warpcam"):
        transmission(tmp_path, {TRANSMISSION: {"transmissionFactor": 1.0}, **volume})
    told = "has transmission without a thickness, and is drawn as a body that refracts: window" in caplog.text
    assert told == (not thickness)


def test_the_real_time_look_tells_once(tmp_path: Path, device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    """By the material's name, once for a scene; its image is that of a solid ball. Paths of light tell nothing."""
    scene = opened(written(tmp_path, {TRANSMISSION: {"transmissionFactor": 1.0}}), device)
    wc.estimate_memory(scene, [eye()], look="path")
    assert "transmission" not in caplog.text
    seen = [wc.Renderer(scene, [eye()]).render()["eye"]["hdr"].cpu().numpy() for _ in range(2)]
    assert caplog.text.count("look='pbr' draws no transmission") == 1
    assert "drawn solid: window" in caplog.text
    solid = opened(written(tmp_path, {}), device)
    np.testing.assert_array_equal(seen[1], wc.Renderer(solid, [eye()]).render()["eye"]["hdr"].cpu().numpy())
    assert caplog.text.count("transmission") == 1


@pytest.mark.parametrize("ior", [1.0, 1.5, 2.4])
def test_index_of_refraction_of_usd(ior: float, stage: Usd.Stage) -> None:
    """UsdPreviewSurface has an index and an opacity, and no transmission: its opacity stays opacity."""
    add_ball(stage, diffuseColor=(1.0, 1.0, 1.0), ior=ior, opacity=0.5)
    scene = wc.from_usd(stage, device="cpu")
    assert scene.array("material_reflectance").numpy().item() == pytest.approx(((ior - 1.0) / (ior + 1.0)) ** 2)
    assert scene.array("material_transmission").numpy().item() == 0.0
    assert scene.array("shape_colors").numpy()[0, 0, 3] == pytest.approx(0.5)
