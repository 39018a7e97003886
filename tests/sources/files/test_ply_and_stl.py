"""PLY files with faces of several kinds, colours with an alpha, and colours of STL files."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from PIL import Image

pytest.importorskip("trimesh")

import warpcam as wc

POINTS = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
COORDINATES = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
QUARTERS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]
RED, GREEN, GREY = (255, 0, 0), (0, 255, 0), (118, 118, 118)
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
PLACE = ["float x", "float y", "float z"]
LIST, COLOR = "list uchar int vertex_indices", ["uchar red", "uchar green", "uchar blue"]


def drawn(path: Path, device: wp.Device, output: str = "albedo") -> np.ndarray:
    eye = wc.Camera("eye", width=8, height=8, lens=wc.Orthographic(height=2.0), position=(0, 0, 3), outputs=(output,))
    return wc.Renderer(wc.load(path, device=device), [eye]).render()["eye"][output][0].cpu().numpy()


def corners(path: Path, device: wp.Device) -> list[tuple[int, ...]]:
    return [tuple(map(int, color)) for color in drawn(path, device)[[0, 0, -1, -1], [0, -1, 0, -1]]]


def ply(
    path: Path, form: str, vertex: list[str], count: int, faces: list[str], number: int, body: bytes, **more: Any
) -> Path:
    lines = ["ply", f"format {form} 1.0", *more.get("comments", ()), f"element vertex {count}"]
    lines += [f"property {name}" for name in vertex] + [f"element {more.get('name', 'face')} {number}"]
    lines += [f"property {name}" for name in faces] + ["end_header\n"]
    path.write_bytes("\n".join(lines).encode() + body)
    return path


def packed(order: str, *parts: tuple[str, Any]) -> bytes:
    return b"".join(struct.pack(order + kind, *values) for kind, values in parts)


@pytest.mark.parametrize("form", ORDERS)
def test_faces_of_several_numbers_of_corners(form: str, tmp_path: Path, device: wp.Device) -> None:
    """A square above a triangle, and their colours."""
    vertices = [("fff", point) for point in (*POINTS, *[(x, y, -1.0) for x, y, _ in POINTS[:3]])]
    faces = [("B4iBBB", (4, 0, 1, 2, 3, *RED)), ("B3iBBB", (3, 4, 5, 6, *GREEN))]
    body = packed(ORDERS[form], *vertices, *faces)
    path = ply(tmp_path / "it.ply", form, PLACE, 7, [LIST, *COLOR], 2, body)
    assert corners(path, device) == [RED] * 4


@pytest.mark.parametrize("form", ORDERS)
def test_an_image_on_faces_of_several_numbers_of_corners(form: str, tmp_path: Path, device: wp.Device) -> None:
    Image.fromarray(np.array(QUARTERS, np.uint8).reshape(2, 2, 3).repeat(32, 0).repeat(32, 1)).save(tmp_path / "q.png")
    flat = [number for pair in COORDINATES for number in pair]
    faces = [("B4iB8f", (4, 0, 1, 2, 3, 8, *flat)), ("B3iB6f", (3, 0, 1, 1, 6, *flat[:6]))]
    body = packed(ORDERS[form], *[("fff", point) for point in POINTS], *faces)
    kinds = [LIST, "list uchar float texcoord"]
    path = ply(tmp_path / "it.ply", form, PLACE, 4, kinds, 2, body, comments=["comment TextureFile q.png"])
    assert corners(path, device) == QUARTERS


@pytest.mark.parametrize("form", ["ascii", *ORDERS])
def test_strips(form: str, tmp_path: Path, device: wp.Device) -> None:
    """A strip turns every other triangle, and -1 begins the next one."""
    strip = (0, 1, 3, 2, -1, 0, 1, 2)
    if form == "ascii":
        body = "\n".join(" ".join(map(str, row)) for row in (*POINTS, (len(strip), *strip))).encode()
    else:
        body = packed(ORDERS[form], *[("fff", point) for point in POINTS], ("i8i", (len(strip), *strip)))
    kinds = ["list int int vertex_indices"]
    path = ply(tmp_path / "it.ply", form, PLACE, 4, kinds, 1, body, name="tristrips")
    assert corners(path, device) == [GREY] * 4


def test_files_that_are_cut_off(tmp_path: Path) -> None:
    body = packed("<", *[("fff", point) for point in POINTS], ("B4i", (4, 0, 1, 2, 3)), ("B", (3,)))
    path = ply(tmp_path / "it.ply", "binary_little_endian", PLACE, 4, [LIST], 2, body)
    with pytest.raises(wc.WarpcamError, match="it ends before its header says"):
        wc.load(path, device="cpu")


NAMES = {
    "red": ["red", "green", "blue"],
    "diffuse_red": ["diffuse_red", "diffuse_green", "diffuse_blue"],
    "r": ["r", "g", "b"],
}
KINDS = {"uchar": 255, "ushort": 65535, "float": 1.0}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", NAMES)
def test_names_and_types_of_colours(name: str, kind: str, tmp_path: Path, device: wp.Device) -> None:
    rows = [" ".join(map(str, (*point, KINDS[kind], 0, 0))) for point in POINTS]
    vertex = [*PLACE, *[f"{kind} {channel}" for channel in NAMES[name]]]
    body = "\n".join([*rows, "3 0 1 2", "3 0 2 3"]).encode()
    assert corners(ply(tmp_path / "it.ply", "ascii", vertex, 4, [LIST], 2, body), device) == [RED] * 4


@pytest.mark.parametrize("alphas", [(64,) * 4, (0, 0, 255, 255)], ids=["one alpha", "several"])
def test_alpha_of_colours(alphas: tuple[int, ...], tmp_path: Path, device: wp.Device) -> None:
    rows = [" ".join(map(str, (*point, *RED, alpha))) for point, alpha in zip(POINTS, alphas, strict=True)]
    body = "\n".join([*rows, "3 0 1 2", "3 0 2 3"]).encode()
    path = ply(tmp_path / "it.ply", "ascii", [*PLACE, *COLOR, "uchar alpha"], 4, [LIST], 2, body)
    found = drawn(path, device, "rgba")[:, 4, 3].astype(float)
    right = np.full(8, 64.0) if alphas[0] else np.linspace(255, 0, 17)[1::2]
    np.testing.assert_allclose(found, right, atol=8)


WHOLE = b"COLOR=\x00\xff\x00\xff"
PAINTED = {
    "none": (b"", (0, 0), [GREY, GREY]),
    "blue lowest": (b"", (0x8000 | 31 << 10, 0x8000 | 31), [RED, (0, 0, 255)]),
    "not all": (b"", (0x8000 | 31 << 10, 0), [GREY, GREY]),
    "red lowest": (WHOLE, (31, 31 << 10), [RED, (0, 0, 255)]),
    "the whole's": (WHOLE, (0x8000, 31), [GREEN, RED]),
}


@pytest.mark.parametrize("kind", PAINTED)
def test_colours_of_stl(kind: str, tmp_path: Path, device: wp.Device) -> None:
    """The first face is to the right and below, the second one to the left and above."""
    head, spare, right = PAINTED[kind]
    data = head.ljust(80, b" ") + struct.pack("<I", 2)
    for places, number in zip(((0, 1, 2), (0, 2, 3)), spare, strict=True):
        data += struct.pack("<12fH", 0, 0, 1, *[x for place in places for x in POINTS[place]], number)
    (tmp_path / "it.stl").write_bytes(data)
    image = drawn(tmp_path / "it.stl", device)
    assert [tuple(map(int, image[row, column])) for row, column in ((6, 4), (1, 3))] == right
