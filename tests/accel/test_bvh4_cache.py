"""The cache of trees: by content, and trusted only where the file is whole and the mesh's own."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from bvh_checks import build_bvh4

from warpcam.accel import bvh4
from warpcam.accel.bvh4 import Bvh4


def soup(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Triangles that share no corners."""
    rng = np.random.default_rng(seed)
    corners = rng.random((count, 1, 3)) + 0.1 * rng.standard_normal((count, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def same(a: Bvh4, b: Bvh4) -> bool:
    return a.nodes.tobytes() == b.nodes.tobytes() and a.faces.tobytes() == b.faces.tobytes() and a.depth == b.depth


SMALL = soup(2000)
LARGE = soup(3000)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder, and no other."""
    monkeypatch.setenv("WARPCAM_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache" / "bvh4"


@pytest.fixture
def builds(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sizes of the trees that were built rather than read."""
    sizes = []
    build = bvh4.bvh4_build.build

    def counted(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        sizes.append(len(faces))
        return build(vertices, faces)

    monkeypatch.setattr(bvh4.bvh4_build, "build", counted)
    return sizes


def test_cache_keeps_large_meshes(folder: Path, builds: list[int]) -> None:
    first, second = build_bvh4(*LARGE), build_bvh4(*LARGE)
    assert same(first, second) and builds == [3000]
    second.faces[0] = 0  # the arrays are the caller's
    assert same(first, build_bvh4(*LARGE)) and builds == [3000]
    assert len(list(folder.iterdir())) == 1


def test_cache_tells_meshes_apart(folder: Path, builds: list[int]) -> None:
    vertices, faces = LARGE
    moved = vertices.copy()
    moved[-1, 2] = np.nextafter(moved[-1, 2], np.float32(9))
    for mesh in ((vertices, faces), (moved, faces), (vertices, faces[:, [1, 2, 0]]), (vertices, faces[:-1])):
        vertices, faces = mesh
        rows = build_bvh4(vertices, faces).faces.reshape(-1, 3, 4)
        given = np.ascontiguousarray(rows[:, 0, 3]).view(np.int32)
        np.testing.assert_array_equal(rows[:, :, :3], vertices[faces[given]])
    assert len(builds) == 4


def test_cache_keeps_faces_that_stand_in_several_leaves(folder: Path, builds: list[int]) -> None:
    vertices, faces = soup(3000)
    vertices[:600, 0] += 10 * np.tile(np.float32([0, 0, 1]), 200)  # some of them long
    first = build_bvh4(vertices, faces)
    assert len(first.faces) > 3 * len(faces)
    assert same(first, build_bvh4(vertices, faces)) and builds == [3000]


@pytest.mark.parametrize("changed", range(len(bvh4.bvh4_build.HEADERS)))
def test_cache_is_of_one_builder(
    folder: Path, builds: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: int
) -> None:
    build_bvh4(*LARGE)
    headers = list(bvh4.bvh4_build.HEADERS)
    edited = tmp_path / "edited.h"
    edited.write_bytes(headers[changed].read_bytes() + b"\n")
    headers[changed] = edited
    monkeypatch.setattr(bvh4.bvh4_build, "HEADERS", tuple(headers))
    build_bvh4(*LARGE)
    assert builds == [3000, 3000]


def test_cache_is_for_large_meshes_and_for_who_wants_it(folder: Path, builds: list[int]) -> None:
    build_bvh4(*SMALL)
    build_bvh4(*LARGE, cache=False)
    assert not folder.exists()


def truncate(path: Path, length: int) -> None:
    path.write_bytes(path.read_bytes()[:length])


def flip(path: Path, at: int) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 0x10
    path.write_bytes(content)


def be_another(path: Path) -> None:
    """The whole and valid file of another mesh of the same size, under this mesh's key."""
    build_bvh4(*soup(3000, seed=1))
    (other,) = (found for found in path.parent.iterdir() if found != path)
    shutil.move(other, path)


def be_an_archive(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, nodes=np.zeros((7, 4)))


def be_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


SPOILED = {
    "empty": lambda path: path.write_bytes(b""),
    "cut in the head": lambda path: truncate(path, 40),
    "cut in the rows": lambda path: truncate(path, 5000),
    "a byte short": lambda path: truncate(path, -1),
    "a byte long": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "magic": lambda path: flip(path, 0),
    "key": lambda path: flip(path, 20),
    "sizes": lambda path: flip(path, 46),
    "sizes, high": lambda path: flip(path, 52),
    "depth": lambda path: flip(path, 61),
    "first row": lambda path: flip(path, 80),
    "rows": lambda path: flip(path, 100_000),
    "digest": lambda path: flip(path, -1),
    "foreign": be_an_archive,
    "another mesh": be_another,
}


@pytest.mark.parametrize("fault", SPOILED)
def test_spoiled_files_are_built_again(folder: Path, builds: list[int], fault: str) -> None:
    first = build_bvh4(*LARGE)
    (path,) = folder.iterdir()
    SPOILED[fault](path)
    builds.clear()
    assert same(build_bvh4(*LARGE), first) and builds == [3000]
    assert same(build_bvh4(*LARGE), first) and builds == [3000]
    assert list(folder.iterdir()) == [path]


def test_no_place_for_the_cache_means_no_cache(
    folder: Path, builds: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = build_bvh4(*LARGE)
    (path,) = folder.iterdir()
    be_a_folder(path)
    assert same(build_bvh4(*LARGE), first)
    assert list(folder.iterdir()) == [path]
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("WARPCAM_CACHE_DIR", str(tmp_path / "file"))
    assert same(build_bvh4(*LARGE), first)
    assert builds == [3000] * 3


def test_where_the_cache_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for own, shared, expected in [
        ("own", "shared", "own/bvh4"),
        ("", "shared", "shared/warpcam/bvh4"),
        ("", "", "home/.cache/warpcam/bvh4"),
    ]:
        monkeypatch.setenv("WARPCAM_CACHE_DIR", own and str(tmp_path / own))
        monkeypatch.setenv("XDG_CACHE_HOME", shared and str(tmp_path / shared))
        build_bvh4(*LARGE)
        assert len(list((tmp_path / expected).iterdir())) == 1
