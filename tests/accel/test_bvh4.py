"""The 4-wide tree: whole, tight, shallow, right under rays, and better than halving."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bvh_checks import ABSENT, build_bvh4, check, codes, given_of, halved, hits, sah_cost, same, traverse

from warpcam.accel.bvh4 import Bvh4
from warpcam.accel.meshes import _short, child_by_child
from warpcam.core.errors import WarpcamError
from warpcam.kernels.build.bvh4 import MAX_LEAF


def soup(count: int, seed: int = 0, size: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of mixed sizes that share no corners."""
    rng = np.random.default_rng(seed)
    centers = rng.random((count, 1, 3))
    corners = centers + size * rng.lognormal(size=(count, 1, 1)) * rng.standard_normal((count, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def grid(rows: int, columns: int, height: float) -> tuple[np.ndarray, np.ndarray]:
    """A sheet of 2 * rows * columns faces in x and y, waved along z."""
    y, x = np.mgrid[: rows + 1, : columns + 1]
    z = height * np.sin(0.3 * x) * np.cos(0.2 * y)
    a = (y * (columns + 1) + x)[:-1, :-1].ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    return np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32), faces.astype(np.int32)


def fan(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Slivers around one corner, ever longer: boxes that all overlap, over 12 orders of magnitude."""
    length = np.geomspace(1e-6, 1e6, count)
    angle = np.linspace(0, 1, count + 1)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    corners = np.stack([np.zeros((count, 3)), rim[:-1] * length[:, None], rim[1:] * length[:, None]], 1)
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def rod(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A thin cylinder across a cube beside a fine sheet: a few long faces, whose boxes are empty but for a diagonal."""
    side = count // 8
    angle = np.arange(side) * (2 * np.pi / side)
    across = np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2], [6]])
    rim = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
    first = np.arange(side)
    second, other = (first + 1) % side, first + side
    cylinder = np.concatenate([np.stack([first, second, other], 1), np.stack([second, second % side + side, other], 1)])
    vertices, faces = grid(10, (count - 2 * side) // 20, 0.1)
    points = np.concatenate([rim, rim + 1, 0.01 * vertices - 1])
    return points.astype(np.float32), np.concatenate([cylinder, faces + 2 * side]).astype(np.int32)


def powers(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Faces at 2^-k: halving space peels off one face after another."""
    vertices, faces = soup(count)
    scale = np.exp2(-np.arange(count) * (100 / count)).repeat(3)[:, None]
    return (vertices * scale).astype(np.float32), faces


def repeated(count: int) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = soup(1)
    return vertices, np.repeat(faces, count, axis=0)


def star(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Faces of many sizes whose boxes share one centre."""
    size = np.linspace(1, 100, count)[:, None, None]
    corners = size * np.array([[-1, -1, 0], [1, 1, 0], [1, -1, 0]])
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


MESHES = {
    "one face": soup(1),
    "two faces": soup(2),
    "a leaf's worth": soup(MAX_LEAF),
    "one more": soup(MAX_LEAF + 1),
    "soup": soup(1500),
    "waves": grid(30, 40, 3.0),
    "flat": grid(30, 40, 0.0),
    "ribbon": grid(1, 1500, 0.0),
    "line": (grid(1, 1500, 0.0)[0] * np.float32([1, 0, 0]), grid(1, 1500, 0.0)[1]),
    "point": (np.zeros((3, 3), np.float32), np.zeros((700, 3), np.int32)),
    "sliver": (np.float32([[0, 0, 0], [1e6, 1e-6, 0], [1e6, 0, 1e-6]]), np.int32([[0, 1, 2]])),
    "rod": rod(1500),
    "slivers": fan(1500),
    "powers": powers(1500),
    "5000 times one face": repeated(5000),
    "one centre": star(1500),
    "tiny": (soup(300)[0] * np.float32(1e-36), soup(300)[1]),
    "denormal": (soup(300)[0] * np.float32(1e-41), soup(300)[1]),
    "huge": (soup(300)[0] * np.float32(1e16), soup(300)[1]),
    "far away": (soup(300)[0] + np.float32(1e8), soup(300)[1]),
    "tiny rod": (rod(300)[0] * np.float32(1e-36), rod(300)[1]),
    "denormal rod": (rod(300)[0] * np.float32(1e-41), rod(300)[1]),
    "huge rod": (rod(300)[0] * np.float32(1e17), rod(300)[1]),
    "rod far away": (rod(300)[0] + np.float32(1e6), rod(300)[1]),
}


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WARPCAM_CACHE_DIR", str(tmp_path))


every_mesh = pytest.mark.parametrize("name", MESHES)


@every_mesh
def test_leaves_cover_every_face_and_boxes_hold_no_more(name: str) -> None:
    check(build_bvh4(*MESHES[name]), *MESHES[name])


@pytest.mark.parametrize("name", ["two faces", "one more", "soup", "rod", "waves", "flat", "powers"])
def test_rays_hit_what_brute_force_hits(name: str) -> None:
    vertices, faces = MESHES[name]
    bvh = build_bvh4(vertices, faces)
    rng = np.random.default_rng(1)
    size = np.ptp(vertices, axis=0)
    met = 0
    for _ in range(60):
        origin = vertices.mean(axis=0) + rng.standard_normal(3) * (size + size.max())
        target = vertices[faces[rng.integers(len(faces))]].astype(float).T @ rng.dirichlet((1, 1, 1))
        ray = target - origin
        brute = hits(origin, ray, vertices[faces].astype(float))
        t, winner, most = traverse(bvh, origin, ray)
        assert t == brute.min()
        assert winner < 0 or brute[given_of(bvh)[winner]] == t
        assert most <= 3 * bvh.depth
        met += winner >= 0
    assert met > 50


@pytest.mark.parametrize(("name", "ratio"), [("soup", 0.9), ("waves", 0.9), ("ribbon", 0.9), ("rod", 0.5)])
def test_costs_less_than_halving(name: str, ratio: float) -> None:
    vertices, faces = MESHES[name]
    plain = halved(vertices, faces)
    check(plain, vertices, faces)
    assert sah_cost(build_bvh4(vertices, faces)) < ratio * sah_cost(plain)


def test_only_cut_faces_stand_in_several_leaves() -> None:
    def listed(name: str) -> float:
        return len(given_of(build_bvh4(*MESHES[name]))) / len(MESHES[name][1])

    assert listed("flat") == 1.0
    assert listed("rod") > 1.2


def test_same_mesh_same_tree() -> None:
    first, second = build_bvh4(*MESHES["soup"]), build_bvh4(*MESHES["soup"])
    assert same(first, second)


def test_no_faces_make_a_node_without_children() -> None:
    bvh = build_bvh4(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert bvh.nodes.shape == (7, 4) and bvh.faces.shape == (0, 4) and bvh.depth == 1
    assert (bvh.nodes[:6] == ABSENT).all()


def test_arrays_need_not_be_contiguous() -> None:
    vertices, faces = MESHES["soup"]
    strided = np.zeros((len(vertices), 4), np.float32)[:, :3]
    strided[:] = vertices
    assert same(build_bvh4(strided, np.asfortranarray(faces)), build_bvh4(vertices, faces))


def stretch(bvh: Bvh4) -> None:
    bvh.nodes[3, 0] += 1


def shrink(bvh: Bvh4) -> None:
    bvh.nodes[-4, 0] -= 1e-3


def lose_a_face(bvh: Bvh4) -> None:
    node, k = np.argwhere(codes(bvh) < 0)[0]
    bvh.nodes.view(np.int32)[7 * node + 6, k] += 1


def move_a_corner(bvh: Bvh4) -> None:
    bvh.faces[1, 0] = np.nextafter(bvh.faces[1, 0], np.float32(9))


def give_a_face_twice(bvh: Bvh4) -> None:
    bvh.faces[3:6] = bvh.faces[0:3]


@pytest.mark.parametrize("fault", [stretch, shrink, lose_a_face, move_a_corner, give_a_face_twice])
def test_the_check_sees_faults(fault: Callable[[Bvh4], None]) -> None:
    bvh = build_bvh4(*MESHES["soup"])
    fault(bvh)
    with pytest.raises(AssertionError):
        check(bvh, *MESHES["soup"])


TRIANGLE = np.eye(3, dtype=np.float32), np.int32([[0, 1, 2]])


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (TRIANGLE[0].tolist(), TRIANGLE[1], "vertices must be a numpy array, got list"),
        (TRIANGLE[0].astype(np.float64), TRIANGLE[1], "vertices must have dtype float32, got float64"),
        (TRIANGLE[0], TRIANGLE[1].astype(np.int64), "faces must have dtype int32, got int64"),
        (TRIANGLE[0].ravel(), TRIANGLE[1], r"vertices must have shape \(n, 3\), got \(9,\)"),
        (TRIANGLE[0], np.int32([[0, 1, 2, 0]]), r"faces must have shape \(n, 3\), got \(1, 4\)"),
        (TRIANGLE[0] * np.float32([1, np.nan, 1]), TRIANGLE[1], "vertices must be finite .* at vertex 0"),
        (TRIANGLE[0] + np.float32([[0], [0], [np.inf]]), TRIANGLE[1], "vertices must be finite .* at vertex 2"),
        (TRIANGLE[0] * np.float32(1e18), TRIANGLE[1], "magnitudes below 1e"),
        (TRIANGLE[0], TRIANGLE[1] + 1, r"faces must index its 3 vertices, got \[1, 2, 3\] at face 0"),
        (TRIANGLE[0], TRIANGLE[1] - 1, r"faces must index its 3 vertices, got \[-1, 0, 1\] at face 0"),
        (TRIANGLE[0][:0], TRIANGLE[1], "faces must index its 0 vertices"),
    ],
)
def test_bad_meshes_are_refused_by_name(vertices: np.ndarray, faces: np.ndarray, message: str) -> None:
    with pytest.raises(WarpcamError, match="^mesh 'gripper': .*" + message):
        build_bvh4(vertices, faces, name="gripper")
    with pytest.raises(WarpcamError, match="^mesh: .*" + message):
        build_bvh4(vertices, faces)


def test_rows_for_cuda() -> None:
    vertices, faces = soup(500)
    vertices = vertices + np.float32((3.0, -0.5, 0.1))
    tree = build_bvh4(vertices, faces)
    given = tree.nodes.view(np.int32).reshape(-1, 7, 4)
    bounds = tree.nodes.reshape(-1, 7, 4).astype(np.float64)
    extent = np.abs(vertices[faces]).max()
    rows = _short(tree.nodes, float(extent)).view(np.uint32).reshape(-1, 4, 4)
    there = bounds[:, 0] != ABSENT
    low, high = (
        (half.astype(np.float64) - 32768.0) / 32760.0 * extent for half in (rows[:, :3] & 0xFFFF, rows[:, :3] >> 16)
    )
    step = extent / 32760.0
    for k in range(3):
        below, above = (bounds[:, k] - low[:, k])[there], (high[:, k] - bounds[:, 3 + k])[there]
        assert (below > 0.99 * step).all() and (below < 2.01 * step).all()
        assert (above > 0.99 * step).all() and (above < 2.01 * step).all()
    assert (~there).any() and (rows[:, :3].transpose(0, 2, 1)[~there] == 65535).all()  # lower bounds above upper ones
    codes_there = rows[:, 3].view(np.int32)
    assert (codes_there[there] == given[:, 6][there]).all() and (codes_there[~there] == -1).all()
    children = child_by_child(tree.nodes).view(np.int32).reshape(-1, 4, 2, 4)
    assert (children[:, :, 0, :3].transpose(0, 2, 1) == given[:, :3]).all()
    assert (children[:, :, 1, :3].transpose(0, 2, 1) == given[:, 3:6]).all()
    assert (children[:, :, 0, 3] == given[:, 6]).all()
