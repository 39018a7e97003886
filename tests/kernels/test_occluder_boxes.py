"""Occluder boxes: rays that are blocked without a traversal."""

import numpy as np
import pytest
import warp as wp
from bvh_checks import build_bvh4
from mesh_surfaces import CLOSED, SHAPES, grid, hills, meets
from native_kernel import native_kernel

from warpcam.accel import occluder_boxes
from warpcam.accel.meshes import Mesh, pack_meshes
from warpcam.kernels.types import Meshes

DEVICES = [str(device) for device in wp.get_devices()]


@wp.func_native("""
    using namespace warpcam;
    float least = MISS;
    for (int k = 0; k < MAX_OCCLUDER_BOXES; ++k) {
        const OccluderBox box = OccluderBox::load_from(meshes.occluder_boxes.data, mesh, k);
        least = warpcam::min(least, box.aside({ as_vec3(origin), as_vec3(direction) }, { 0.0f, 1.0f }));
    }
    wp::index(aside, i) = least;
""")
def ask(
    meshes: Meshes,
    mesh: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    i: wp.int32,
    aside: wp.array(dtype=wp.float32),
): ...


@native_kernel("shadow/occluder_boxes.h")
def try_rays(
    meshes: Meshes,
    mesh: wp.int32,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    aside: wp.array(dtype=wp.float32),
):
    i = wp.tid()
    ask(meshes, mesh, origins[i], directions[i], i, aside)


ALL = SHAPES | CLOSED


def with_occluder_boxes(points: np.ndarray, faces: np.ndarray, device: str) -> tuple[Meshes, np.ndarray]:
    """The mesh, and the corners of its faces (face, 3, 3)."""
    mesh = Mesh("shape", points, faces)
    meshes, _ = pack_meshes([mesh], wp.get_device(device))
    tree = build_bvh4(points, faces, cache=False)
    meshes.occluder_boxes = occluder_boxes.pack_occluder_boxes(meshes, [tree.faces], [0], wp.get_device(device))
    return meshes, points[faces].astype(np.float64)


def aside_of(meshes: Meshes, origins: np.ndarray, directions: np.ndarray, device: str) -> np.ndarray:
    aside = wp.zeros(len(origins), dtype=wp.float32, device=device)
    rays = [wp.array(values.astype(np.float32), dtype=wp.vec3, device=device) for values in (origins, directions)]
    wp.launch(try_rays, len(origins), inputs=[meshes, 0, *rays], outputs=[aside], device=device)
    return aside.numpy()


def rays_at(corners: np.ndarray, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Ways from anywhere around a mesh, or near to its faces, to anywhere."""
    random = np.random.default_rng(seed)
    middle, size = corners.reshape(-1, 3).mean(axis=0), np.ptp(corners.reshape(-1, 3), axis=0).max()
    start = middle + size * random.uniform(-1.0, 1.0, (count, 3))

    def on_faces() -> np.ndarray:
        faces = corners[random.integers(0, len(corners), count)]
        return np.einsum("rk,rkc->rc", random.dirichlet((1, 1, 1), count), faces)

    begin = np.where(random.random((count, 1)) < 0.7, start, on_faces() + 0.02 * size * random.normal(size=(count, 3)))
    through = on_faces()
    return begin, (through - begin) * random.uniform(0.5, 3.0, (count, 1))


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", ALL)
def test_what_is_stopped_meets_a_face(name: str, device: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(occluder_boxes, "FEW_FACES", 1)
    monkeypatch.setattr(occluder_boxes, "LOOKED_AT", 128)
    meshes, corners = with_occluder_boxes(*ALL[name](), device)
    origins, directions = rays_at(corners, 6000, 4)
    stopped = aside_of(meshes, origins, directions, device) < 1.0
    if name in CLOSED:
        assert stopped.mean() > 0.05
    origins, directions = (values[stopped].astype(np.float32).astype(np.float64) for values in (origins, directions))
    assert meets(origins, directions, corners, 0.0, 1.0).all()  # a face between both ends


@pytest.mark.parametrize("device", DEVICES)
def test_a_mesh_with_a_hole_lets_light_through_it(device: str, monkeypatch: pytest.MonkeyPatch):
    """A ball without one of its faces: no box reaches over where it was."""
    monkeypatch.setattr(occluder_boxes, "FEW_FACES", 1)
    points, faces = CLOSED["ball"]()
    corners = points[faces].astype(np.float64)
    random = np.random.default_rng(1)
    gone = int(np.argmax(corners.mean(axis=1) @ (0.6, 0.0, 0.8)))
    through = random.dirichlet((1, 1, 1), 500) @ corners[gone]
    whole = with_occluder_boxes(points, faces, device)[0]
    holed = with_occluder_boxes(points, np.delete(faces, gone, axis=0), device)[0]
    inside = np.zeros_like(through) + 0.01 * random.normal(size=through.shape)
    assert (aside_of(whole, inside, 1.5 * (through - inside), device) < 1.0).mean() > 0.5
    assert not (aside_of(holed, inside, 1.5 * (through - inside), device) < 1.0).any()


@pytest.mark.parametrize("device", DEVICES)
def test_each_mesh_has_its_own(device: str, monkeypatch: pytest.MonkeyPatch):
    """Also beside a mesh of few faces, which has none, and where several are the same."""
    monkeypatch.setattr(occluder_boxes, "LOOKED_AT", 32)
    few = Mesh("few", *grid(2, hills))
    meshes = [Mesh(name, *CLOSED[name]()) for name in ("ball", "cup")]

    def rows(*meshes: Mesh) -> np.ndarray:
        packed = pack_meshes(meshes, wp.get_device(device))[0]
        trees = {id(mesh): build_bvh4(mesh.vertices, mesh.faces, cache=False).faces for mesh in meshes}
        holders = [next(i for i, other in enumerate(meshes) if other is mesh) for mesh in dict.fromkeys(meshes)]
        found = occluder_boxes.pack_occluder_boxes(
            packed, [trees[id(meshes[i])] for i in holders], holders, wp.get_device(device)
        )
        return found.numpy().reshape(len(meshes), -1)

    alone = [rows(mesh)[0] for mesh in (few, *meshes)]
    assert (alone[0].reshape(occluder_boxes.ROWS + 1, -1, 4)[: occluder_boxes.ROWS, :, :3] == 0.0).all()
    assert (alone[1] != alone[2]).any()
    together = rows(few, meshes[1], meshes[0], meshes[1])
    for row, wanted in zip(together, (alone[0], alone[2], alone[1], alone[2]), strict=True):
        np.testing.assert_array_equal(row, wanted)


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (1.0, 0.01, 3.0), (1.0, 0.0, 2.0), (0.0, 0.0, 1.0)])
@pytest.mark.parametrize("count", [1, 3, 8, 500])
def test_outlines_hold_all_points(count: int, scale: tuple[float, ...]):
    random = np.random.default_rng(count)
    points = (random.normal(size=(count, 3)) * scale + (5.0, -2.0, 0.3)).astype(np.float32)
    outline = occluder_boxes.outline(points)
    assert outline.shape == (occluder_boxes.MAX_OCCLUDER_BOXES, 3)
    directions = random.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    beyond = (points @ directions.T).max(axis=0) - (outline @ directions.T).max(axis=0)
    assert beyond.max() < 2e-6
    box = np.linalg.norm(0.5 * np.ptp(points, axis=0))
    assert np.linalg.norm(outline - 0.5 * (points.min(axis=0) + points.max(axis=0)), axis=1).max() < 1.01 * box + 1e-5


def test_outlines_cut_edges_off():
    """The outline is that of a ball's box, whose corners are 1.73 away."""
    outline = occluder_boxes.outline(CLOSED["ball"]()[0])
    assert 1.0 < np.linalg.norm(outline, axis=1).max() < 1.25


def test_scenes_whose_meshes_are_worth_it():
    few, many = np.zeros((3 * 12, 4), np.float32), np.zeros((3 * 500, 4), np.float32)
    assert occluder_boxes.are_worth([few, many])
    assert not occluder_boxes.are_worth([])
    assert not occluder_boxes.are_worth([few] * 3)
    assert not occluder_boxes.are_worth([many] * 100)
