"""Colours and textures of OBJ and PLY files are those that the files say, and none of a library's own."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.sources.files.mtl import libraries_of, read_libraries, texture_map

pytest.importorskip("trimesh")

QUARTERS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]  # of the image, and of the square seen from above
GREY = [(118, 118, 118)] * 4  # of what says nothing of its colour
POINTS = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
UVS = [(0, 0), (1, 0), (1, 1), (0, 1)]
SQUARE = "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS) + "".join(f"vt {u} {v}\n" for u, v in UVS)


def quarters(path: Path, mode: str = "RGB") -> None:
    Image.fromarray(np.array(QUARTERS, np.uint8).reshape(2, 2, 3).repeat(32, 0).repeat(32, 1)).convert(mode).save(path)


def corners(path: Path, device: wp.Device) -> list[tuple[int, ...]]:
    """Colours of the square's quarters, from above."""
    camera = wc.Camera(
        "c", width=8, height=8, lens=wc.Orthographic(height=2.0), position=(0, 0, 3), outputs=("albedo",)
    )
    image = wc.Renderer(wc.load(path, device=device), [camera]).render()["c"]["albedo"][0].cpu().numpy()
    return [tuple(map(int, image[row, column])) for row in (1, 6) for column in (1, 6)]


def square(folder: Path, mtl: str, head: str = "mtllib it.mtl\n", use: str = "usemtl m\n") -> Path:
    quarters(folder / "q.png")
    quarters(folder / "with space.png")
    (folder / "it.mtl").write_text(f"newmtl m\n{mtl}\n")
    (folder / "it.obj").write_text(f"{head}{SQUARE}{use}f 1/1 2/2 3/3 4/4\n")
    return folder / "it.obj"


RED = [(255, 0, 0)] * 4
MATERIALS: dict[str, tuple[str, list[tuple[int, ...]]]] = {
    "an image without Kd": ("map_Kd q.png", QUARTERS),
    "an image and Kd": ("Kd 1 1 1\nmap_Kd q.png", QUARTERS),
    "a dark image": ("Kd 0 0 0\nmap_Kd q.png", [(0, 0, 0)] * 4),
    "Kd": ("Kd 1 0 0", RED),
    "one number": ("Kd 1", [(255,) * 3] * 4),
    "nothing": ("Ns 10\nKa 1 1 1", GREY),
    "a name with a space": ("map_Kd with space.png", QUARTERS),
    "options before it": ("map_Kd -blendu on -mm 0 1 -o 0 0 0 -s 1 1 1 -clamp off with space.png", QUARTERS),
    "offset by half": ("map_Kd -o 0.5 0 q.png", [QUARTERS[1], QUARTERS[0], QUARTERS[3], QUARTERS[2]]),
    "one number of an offset": ("map_Kd -o 0.5 q.png", [QUARTERS[1], QUARTERS[0], QUARTERS[3], QUARTERS[2]]),
    "a quarter of it": ("map_Kd -s 0.5 0.5 q.png", [QUARTERS[2]] * 4),
    "clamped": ("map_Kd -o 1 1 -clamp on q.png", [QUARTERS[1]] * 4),
    "dimmed": ("map_Kd -mm 0 0.2 q.png", [tuple(c // 5 for c in color) for color in QUARTERS]),
    "a missing image": ("Kd 1 0 0\nmap_Kd gone.png", RED),
    "a folder of Windows": ("map_Kd .\\q.png", QUARTERS),
}


@pytest.mark.parametrize("case", MATERIALS)
def test_materials_of_obj(case: str, tmp_path: Path, device: wp.Device) -> None:
    mtl, right = MATERIALS[case]
    assert np.abs(np.subtract(corners(square(tmp_path, mtl), device), right)).max() <= 1


@pytest.mark.parametrize(
    ("head", "use", "right"),
    [
        ("", "", GREY),  # no material, but texture coordinates
        ("mtllib it.mtl\n", "", GREY),
        ("mtllib other.mtl\nmtllib it.mtl\n", "usemtl m\n", RED),
        ("mtllib other.mtl it.mtl\n", "usemtl m\n", RED),
        ("mtllib two words.mtl\n", "usemtl m\n", [(0, 255, 0)] * 4),
        ("mtllib it.mtl\n", "usemtl two words\n", [(0, 0, 255)] * 4),
        ("# mtllib gone.mtl\nmtllib it.mtl\n", "usemtl m\n", RED),
    ],
)
def test_libraries_of_obj(head: str, use: str, right: Any, tmp_path: Path, device: wp.Device) -> None:
    (tmp_path / "other.mtl").write_text("newmtl other\nKd 0 0 0\n")
    (tmp_path / "two words.mtl").write_text("newmtl m\nKd 0 1 0\n")
    assert corners(square(tmp_path, "Kd 1 0 0\nnewmtl two words\nKd 0 0 1", head, use), device) == right


def test_unknown_materials_are_named_once(tmp_path: Path, caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    path = square(tmp_path, "Kd 1 0 0", use="usemtl none\nusemtl gone\n")
    assert corners(path, device) == GREY
    assert caplog.text.count("no mtllib defines it; it is drawn grey: none, gone") == 1


def test_names_in_other_codes(tmp_path: Path, device: wp.Device) -> None:
    path = square(tmp_path, "Kd 1 0 0")
    path.write_bytes(path.read_bytes().replace(b"usemtl m", "usemtl grün".encode("latin-1")))
    (tmp_path / "it.mtl").write_bytes("newmtl grün\nKd 1 0 0\n".encode("latin-1"))
    assert corners(path, device) == RED


def test_gloss_of_obj(tmp_path: Path) -> None:
    def look(mtl: str) -> Any:
        return wc.load(square(tmp_path, mtl), device="cpu")._graph_source.graph.materials[0]

    assert look("Ns 0").roughness == 1.0 and look("Ns 30").roughness == pytest.approx(0.5) and look("").roughness == 0.5
    assert look("Ks 0.5 0.5 0.5").reflectance == pytest.approx(0.04) and look("Ks 0 0 0").reflectance == 0.0
    assert look("illum 1\nKs 1 1 1").reflectance == 0.0
    assert look("Pr 0.25\nPm 1").roughness == 0.25 and look("Pr 0.25\nPm 1").metallic == 1.0
    assert look("Ke 1 0 0").emission == (1.0, 0.0, 0.0)


def test_statements() -> None:
    assert libraries_of("mtllib a b.mtl\n  mtllib\tc.mtl \\\n d\n#mtllib e\n") == ["a b.mtl", "c.mtl   d"]
    found = texture_map("-s 1 2 -clamp on -bm 0.5 1.png")
    assert (found.file, found.options["-s"], found.options["-clamp"]) == ("1.png", ["1", "2"], ["on"])
    lost: list[str] = []
    assert read_libraries(["a"], lambda _: "Kd 1\nnewmtl x\nKd 2\nkd 3\n", lost.append) == {"x": {"kd": "3"}}
    assert read_libraries(["a b.mtl"], lambda _: None, lost.append) == {} and lost == ["a b.mtl"]


def ply(path: Path, *, image: str = "", uvs: bool = False, colors: str = "", faces: str = "") -> Path:
    """The square; ``colors`` and ``faces`` are types of the colours of vertices, red, and of faces, blue."""
    rgb = "".join(f"property {{0}} {name}\n" for name in ("red", "green", "blue"))
    head = f"ply\nformat ascii 1.0\n{f'comment TextureFile {image}' + chr(10) if image else ''}element vertex 4\n"
    head += "".join(f"property float {name}\n" for name in ("xyzst" if uvs else "xyz"))
    head += (rgb.format(colors) if colors else "") + "element face 2\nproperty list uchar int vertex_indices\n"
    head += (rgb.format(faces) if faces else "") + "end_header\n"
    top = {"uchar": 255, "float": 1, "": 0}
    for point, uv in zip(POINTS, UVS, strict=True):
        values = (*point, *(uv if uvs else ()), *((top[colors], 0, 0) if colors else ()))
        head += " ".join(map(str, values)) + "\n"
    for corner in ("3 0 1 2", "3 0 2 3"):
        head += corner + (f" 0 0 {top[faces]}" if faces else "") + "\n"
    path.write_text(head)
    return path


BLUE = [(0, 0, 255)] * 4


@pytest.mark.parametrize(
    ("said", "right"),
    [
        ({}, GREY),
        ({"uvs": True}, GREY),
        ({"uvs": True, "image": "q.png"}, QUARTERS),
        ({"uvs": True, "image": "with space.png"}, QUARTERS),
        ({"uvs": True, "image": "gone.png"}, GREY),
        ({"colors": "uchar"}, RED),
        ({"colors": "uchar", "uvs": True}, RED),
        ({"colors": "float", "uvs": True}, RED),
        ({"faces": "uchar"}, BLUE),
        ({"faces": "uchar", "uvs": True}, BLUE),
    ],
)
def test_colours_of_ply(said: dict[str, Any], right: Any, tmp_path: Path, device: wp.Device) -> None:
    quarters(tmp_path / "q.png")
    quarters(tmp_path / "with space.png")
    assert corners(ply(tmp_path / "it.ply", **said), device) == right
