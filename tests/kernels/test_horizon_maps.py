"""Rays from a face that need not look for other faces of its mesh."""

import numpy as np
import pytest
import warp as wp
from mesh_surfaces import SHAPES, grid, meets
from native_kernel import native_kernel

from warpcam.accel.meshes import Mesh, pack_meshes
from warpcam.kernels.build import horizon_maps
from warpcam.kernels.types import Meshes

DEVICES = [str(device) for device in wp.get_devices()]


@wp.func_native("""
    using namespace warpcam;
    const unsigned row = unsigned(face * FACE_ROWS);
    const Float3Int a = load(meshes.faces.data, row), b = load(meshes.faces.data, row + 1);
    const Float3Int c = load(meshes.faces.data, row + 2);
    const FaceAxes axes = face_axes(as_vec3(a), as_vec3(b), as_vec3(c));
    wp::index(clear, i) = is_clear(unsigned(c.w), axes, as_vec3(direction));
""")
def ask(meshes: Meshes, face: wp.int32, direction: wp.vec3, i: wp.int32, clear: wp.array(dtype=wp.int32)): ...


@native_kernel("build/horizon_builder.h")
def look_up(
    meshes: Meshes,
    faces: wp.array(dtype=wp.int32),
    directions: wp.array(dtype=wp.vec3),
    clear: wp.array(dtype=wp.int32),
):
    i = wp.tid()
    ask(meshes, faces[i], directions[i], i, clear)


def horizons_of(points: np.ndarray, faces: np.ndarray, device: str) -> tuple[Meshes, np.ndarray]:
    """The mesh with its horizons, and the corners of its faces (face, 3, 3) in leaf order."""
    meshes, count = pack_meshes([Mesh("shape", points, faces)], wp.get_device(device))
    if not horizon_maps.uses_horizon_maps(wp.get_device(device)):
        assert not meshes.faces.numpy().view(np.int32).reshape(-1, 3, 4)[:, 2, 3].any()
        horizon_maps.build_horizon_maps(meshes, np.zeros(count, np.int32), wp.get_device(device))
    return meshes, meshes.faces.numpy().reshape(-1, 3, 4)[:, :, :3].astype(np.float64)


def are_clear(meshes: Meshes, faces: np.ndarray, directions: np.ndarray, device: str) -> np.ndarray:
    clear = wp.zeros(len(faces), dtype=wp.int32, device=device)
    inputs = [
        meshes,
        wp.array(faces, dtype=wp.int32, device=device),
        wp.array(directions, dtype=wp.vec3, device=device),
    ]
    wp.launch(look_up, len(faces), inputs=inputs, outputs=[clear], device=device)
    return clear.numpy() != 0


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", SHAPES)
def test_what_is_clear_meets_nothing(name: str, device: str):
    meshes, corners = horizons_of(*SHAPES[name](), device)
    random = np.random.default_rng(5)
    faces = random.integers(0, len(corners), 6000)
    directions = unit(random.normal(size=(6000, 3)))
    clear = are_clear(meshes, faces, directions.astype(np.float32), device)
    assert clear.mean() > (0.02 if name.startswith("dense") else 0.08)  # half of the directions are below their faces
    faces, directions = faces[clear], directions[clear]
    origins = np.einsum("rk,rkc->rc", random.dirichlet((0.5, 0.5, 0.5), len(faces)), corners[faces])
    assert not meets(origins, directions, corners, 1e-6).any()


@pytest.mark.parametrize("device", DEVICES)
def test_nothing_is_in_the_way_around_a_ball(device: str):
    meshes, corners = horizons_of(*SHAPES["ball"](), device)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    whole = np.flatnonzero(np.linalg.norm(normals, axis=1) > 1e-5)  # not those at the poles that have no area
    random = np.random.default_rng(6)
    faces = random.choice(whole, 4000)
    directions = unit(random.normal(size=(4000, 3)))
    rise = (directions * unit(normals)[faces]).sum(1)
    clear = are_clear(meshes, faces, directions.astype(np.float32), device)
    assert clear[rise > 0.2].all()
    assert not clear[rise < 0.18].any()  # too flat: see native/build/horizon_builder.h, LEAST


@pytest.mark.parametrize("device", DEVICES)
def test_each_mesh_has_its_own(device: str, monkeypatch: pytest.MonkeyPatch):
    """Also beside a mesh without faces, and where several are the same."""
    monkeypatch.setattr(horizon_maps, "uses_horizon_maps", lambda device: True)
    empty = Mesh("empty", np.zeros((3, 3), np.float32), np.zeros((0, 3), np.int32))
    ball, hills = (Mesh(name, *SHAPES[name]()) for name in ("ball", "hills"))

    def horizons(*meshes: Mesh) -> np.ndarray:
        packed = pack_meshes(meshes, wp.get_device(device))[0]
        return packed.faces.numpy().view(np.int32).reshape(-1, 3, 4)[:, 2, 3]

    alone = np.concatenate([horizons(ball), horizons(hills)])
    assert alone.any()
    np.testing.assert_array_equal(horizons(empty, ball, empty, ball, hills, empty), alone)


@pytest.mark.parametrize("device", DEVICES)
def test_walls_have_horizons(device: str):
    """A floor beside a wall of half its length: light over it reaches the far half, and not all of the near one."""
    points, faces = grid(8, lambda u, v: (2.0 * u, v, 0.0 * u))
    wall = np.array([(0, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1)], np.float32)
    joined = np.concatenate([points, wall]), np.concatenate([faces, np.array([(0, 1, 3), (0, 3, 2)]) + len(points)])
    meshes, corners = horizons_of(joined[0], joined[1].astype(np.int32), device)
    middle = corners.mean(axis=1)
    floor = np.flatnonzero(middle[:, 2] == 0.0)
    over = np.tile(np.float32((-0.6, 0.0, 0.8)), (len(floor), 1))
    clear = are_clear(meshes, floor, over, device)
    assert clear[middle[floor, 0] > 1.3].all()
    assert not clear[middle[floor, 0] < 0.7].any()
    away = are_clear(meshes, floor, over * np.float32((-1.0, 1.0, 1.0)), device)
    assert away[middle[floor, 0] > 0.5].all()
