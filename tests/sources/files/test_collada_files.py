"""COLLADA files: units, axes, frames, materials; and sentences about files of meshes that show nothing."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("collada")

POINTS = "-1 -1 0 1 -1 0 1 1 0 -1 1 0"
QUARTERS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]


def dae(
    path: Path, *, unit: str = "", up: str = "Z_UP", shader: str = "", node: str = "", image: str = "q.png",
    material: str = "m", points: str = POINTS,
) -> Path:  # fmt: skip
    """A square with texture coordinates in the plane of x and y; ``shader`` is what stands in a <phong>."""
    Image.fromarray(np.array(QUARTERS, np.uint8).reshape(2, 2, 3).repeat(32, 0).repeat(32, 1)).save(
        path.parent / "q.png"
    )
    effect = (
        '<library_effects><effect id="e"><profile_COMMON><newparam sid="s"><surface type="2D"><init_from>i</init_from>'
        '</surface></newparam><newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>'
        f'<technique sid="common"><phong>{shader}</phong></technique></profile_COMMON></effect></library_effects>'
        '<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>'
    )
    bind = (
        '<bind_material><technique_common><instance_material symbol="y" target="#{}"/></technique_common>'
        "</bind_material>"
    )
    path.write_text(
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>'
        f"{unit}<up_axis>{up}</up_axis></asset>"
        f'<library_images><image id="i"><init_from>{image}</init_from></image></library_images>'
        f"{effect if shader else ''}"
        '<library_geometries><geometry id="g"><mesh>'
        f'<source id="p"><float_array id="pa" count="12">{points}</float_array><technique_common>'
        '<accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>'
        '<param name="Z" type="float"/></accessor></technique_common></source>'
        '<source id="u"><float_array id="ua" count="8">0 0 1 0 1 1 0 1</float_array><technique_common>'
        '<accessor source="#ua" count="4" stride="2"><param name="S" type="float"/><param name="T" type="float"/>'
        '</accessor></technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        '<polylist material="y" count="1"><input semantic="VERTEX" source="#v" offset="0"/>'
        '<input semantic="TEXCOORD" source="#u" offset="1"/><vcount>4</vcount><p>0 0 1 1 2 2 3 3</p></polylist>'
        '</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="w"><node id="n">'
        f'{node}<instance_geometry url="#g">{bind.format(material) if shader else ""}</instance_geometry></node>'
        '</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>'
    )
    return path


def corners(path: Path, device: wp.Device) -> list[tuple[int, ...]]:
    camera = wc.Camera(
        "c", width=8, height=8, lens=wc.Orthographic(height=2.0), position=(0, 0, 3), outputs=("albedo",)
    )
    image = wc.Renderer(wc.load(path, device=device), [camera]).render()["c"]["albedo"][0].cpu().numpy()
    return [tuple(map(int, image[row, column])) for row in (1, 6) for column in (1, 6)]


UNITS = ['<unit meter="0.01"/>', '<unit name="inch" meter="0.0254"/>', '<unit meter="1"/>', ""]


@pytest.mark.parametrize(("unit", "size"), list(zip(UNITS, (0.01, 0.0254, 1.0, 1.0), strict=True)))
def test_units(unit: str, size: float, tmp_path: Path, device: wp.Device) -> None:
    path = dae(tmp_path / "it.dae", unit=unit)
    np.testing.assert_allclose(wc.load(path, device=device).bounds()[1], (size, size, 0.0), atol=1e-6)
    high = wc.load(path, device=device, meters_per_unit=2.0).bounds()[1]
    np.testing.assert_allclose(high, (2.0, 2.0, 0.0), atol=1e-6)


@pytest.mark.parametrize(
    ("up", "right"), [("Z_UP", (1, 2, 4)), ("Y_UP", (1, 0, 2)), ("X_UP", (2, 4, 1)), (None, (1, 2, 4))]
)
def test_axes(up: str | None, right: tuple[float, ...], tmp_path: Path, device: wp.Device) -> None:
    path = dae(tmp_path / "it.dae", up=up or "Y_UP", points="0 0 0 1 0 0 1 2 0 0 0 4")
    high = wc.load(path, device=device, up_axis=None if up is None else "Z").bounds()[1]
    np.testing.assert_allclose(high, right, atol=1e-6)


def test_frames(tmp_path: Path, device: wp.Device) -> None:
    path = dae(tmp_path / "it.dae", node="<translate>10 0 5</translate><scale>2 1 1</scale>", unit=UNITS[0])
    np.testing.assert_allclose(
        wc.load(path, device=device).bounds(), ((0.08, -0.01, 0.05), (0.12, 0.01, 0.05)), atol=1e-6
    )


TEXTURED = '<diffuse><texture texture="t" texcoord="a"/></diffuse>'
RED = "<diffuse><color>1 0 0 1</color></diffuse>"


@pytest.mark.parametrize(
    ("shader", "image", "right"),
    [
        (TEXTURED, "q.png", QUARTERS),
        (TEXTURED, "./q.png", QUARTERS),
        (TEXTURED, "%71.png", QUARTERS),
        (TEXTURED, "C:\\somewhere\\q.png", QUARTERS),
        (RED, "q.png", [(255, 0, 0)] * 4),
        ("<diffuse><color>0.5 0.5 0.5 1</color></diffuse>", "q.png", [(128, 128, 128)] * 4),
        ("<shininess><float>10</float></shininess>", "q.png", [(118, 118, 118)] * 4),
        ("", "q.png", [(118, 118, 118)] * 4),
    ],
)
def test_colours(shader: str, image: str, right: list[tuple[int, ...]], tmp_path: Path, device: wp.Device) -> None:
    assert corners(dae(tmp_path / "it.dae", shader=shader, image=image), device) == right


@pytest.mark.parametrize(
    ("said", "opacity"),
    [
        ("<transparency><float>0.25</float></transparency>", 0.25),
        ("<transparent><color>1 1 1 0.5</color></transparent>", 0.5),
        (
            '<transparent opaque="RGB_ZERO"><color>0.5 0.5 0.5 1</color></transparent>'
            "<transparency><float>1</float></transparency>",
            0.5,
        ),
        ("<transparency><float>0</float></transparency>", 1.0),  # of programs that mean the other mode
        ("", 1.0),
    ],
)
def test_opacity(said: str, opacity: float, tmp_path: Path) -> None:
    scene = wc.load(dae(tmp_path / "it.dae", shader=RED + said), device="cpu")
    assert scene.array("shape_colors").numpy()[0, 0, 3] == pytest.approx(opacity, abs=1e-4)


def test_broken_materials_cost_no_shape(tmp_path: Path, caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    path = dae(tmp_path / "it.dae", shader=RED, material="gone")
    assert corners(path, device) == [(118, 118, 118)] * 4
    assert "pycollada says: DaeBrokenRefError" in caplog.text


def test_missing_images_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    wc.load(dae(tmp_path / "it.dae", shader=TEXTURED, image="gone.png"), device="cpu")
    assert "a file is not found" in caplog.text and "gone.png" in caplog.text


@pytest.mark.parametrize("suffix", ["dae", "glb", "gltf", "obj", "ply", "stl"])
def test_empty_files(suffix: str, tmp_path: Path) -> None:
    (tmp_path / f"it.{suffix}").touch()
    with pytest.raises(wc.WarpcamError, match="is empty: it has no bytes at all"):
        wc.load(tmp_path / f"it.{suffix}", device="cpu")


CLOUD = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"


@pytest.mark.parametrize(("name", "text"), [("it.ply", CLOUD + "0 0 0\n1 1 1\n"), ("it.obj", "v 0 0 0\nv 1 1 1\n")])
def test_clouds_of_points(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(wc.WarpcamError, match="is a cloud of 2 points without faces, which has no surface to draw"):
        wc.load(tmp_path / name, device="cpu")


def test_lengths_of_stl(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path, data = tmp_path / "it.stl", trimesh.creation.box().export(file_type="stl")
    path.write_bytes(data + b"more")
    np.testing.assert_allclose(wc.load(path, device="cpu").bounds()[1], (0.5, 0.5, 0.5))
    assert "has 4 bytes behind its last triangle, which are not read" in caplog.text
    for cut, text in ((data[:-60], "is cut off: its header says 12 triangles, and there are bytes for 10"),
                      (data[:50], "is no STL file: it has 50 bytes")):  # fmt: skip
        path.write_bytes(cut)
        with pytest.raises(wc.WarpcamError, match=text):
            wc.load(path, device="cpu")


def test_binary_stl_that_begins_as_text(tmp_path: Path) -> None:
    data = trimesh.creation.box().export(file_type="stl")
    (tmp_path / "it.stl").write_bytes(b"solid by a program".ljust(80) + data[80:])
    np.testing.assert_allclose(wc.load(tmp_path / "it.stl", device="cpu").bounds()[1], (0.5, 0.5, 0.5))
