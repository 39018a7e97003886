"""Trees that follow moving corners, in the layouts of both kinds of device."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from warpcam.accel.meshes import Mesh, pack_meshes
from warpcam.kernels.runtime.compile import NATIVE
from warpcam.kernels.update import refit


def sheet(cells: int) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    points = np.stack((x.ravel(), y.ravel(), 0 * x.ravel()), axis=1).astype(np.float32)
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    one = np.stack((first, first + cells + 1, first + 1), axis=1)
    other = np.stack((first + 1, first + cells + 1, first + cells + 2), axis=1)
    return points, np.concatenate((one, other)).astype(np.int32)


def test_runs_hold_whole_leaves_and_as_many_as_have_room() -> None:
    counts = np.random.default_rng(0).integers(1, 16, 700)
    begins = np.cumsum(counts) - counts
    runs = refit._runs(begins * 16 + counts)
    assert runs[0, 0] == 0
    assert runs[-1, 1] == len(counts) - 1
    assert (runs[1:, 0] == runs[:-1, 1] + 1).all()
    assert (runs[:, 2] == begins[runs[:, 0]]).all()
    assert (runs[:, 3] == [counts[first : last + 1].sum() for first, last in runs[:, :2]]).all()
    assert (runs[:, 3] <= refit.RUN_FACES).all()
    assert (runs[:-1, 3] + counts[runs[1:, 0]] > refit.RUN_FACES).all()
    assert "RUN_FACES = THREADS;" in (NATIVE / "accel" / "refit.h").read_text()
    assert refit.RUN_FACES == refit.THREADS
    assert refit._runs(np.zeros(0, np.int32)).shape == (0, 4)


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("cells", [1, 2, 30])
def test_boxes_hold_their_faces_tightly(device: wp.Device, monkeypatch: Any, two_sided: bool, cells: int) -> None:
    monkeypatch.setattr(refit, "FEW", 8)  # so that there are levels with a launch of their own
    instances, by_child = 3, device.is_cuda
    points, faces = sheet(cells)
    given_faces = np.concatenate((faces, faces[:, (0, 2, 1)])) if two_sided else faces
    mesh = Mesh("sheet", points, given_faces, moves=True, two_sided=two_sided)
    meshes, _ = pack_meshes([mesh] * instances, device)
    wide = 8 if by_child else 7
    random = np.random.default_rng(cells)
    moved = random.normal(size=(5 + instances * len(points), 3)).astype(np.float32)
    bases = 5 + len(points) * np.arange(instances)
    tree = refit.DeformingTree(meshes, np.arange(instances), bases, faces, device, two_sided=two_sided)
    for stage in tree.record(wp.array(moved, dtype=wp.vec3, device=device)):
        stage.launch()
    nodes, rows = meshes.nodes.numpy(), meshes.faces.numpy()
    starts, first_faces = meshes.node_start.numpy(), meshes.face_start.numpy()
    assert len(set(starts)) == len(set(first_faces)) == instances
    for instance in range(instances):
        own = moved[bases[instance] : bases[instance] + len(points)]
        seen = set()

        def corners(node: int, instance: int = instance, own: np.ndarray = own, seen: set = seen) -> np.ndarray:
            table = nodes[starts[instance] + wide * node :][:wide]
            low, high = (table[0::2, :3], table[1::2, :3]) if by_child else (table[0:3].T, table[3:6].T)
            codes = np.ascontiguousarray(table[0::2, 3] if by_child else table[6]).view(np.int32)
            found = []
            for child in np.flatnonzero(low[:, 0] < refit.FAR):
                if codes[child] < 0:
                    start, count = (-codes[child] - 1) >> 4, (-codes[child] - 1) & 15
                    block = rows[first_faces[instance] + 3 * start :][: 3 * count]
                    given, back, flat = np.ascontiguousarray(block[:, 3]).view(np.int32).reshape(-1, 3).T
                    assert (back == (given + len(faces) if two_sided else 0)).all() and (flat == two_sided).all()
                    assert (block[:, :3] == own[faces[given]].reshape(-1, 3)).all()
                    seen.update(given.tolist())
                    inside = block[:, :3]
                else:
                    inside = corners(int(codes[child]))
                assert (low[child] == inside.min(axis=0)).all() and (high[child] == inside.max(axis=0)).all()
                found.append(inside)
            return np.concatenate(found)

        everything = corners(0)
        assert seen == set(range(len(faces)))
        assert (meshes.bounds_min.numpy()[instance] == everything.min(axis=0)).all()
        assert (meshes.bounds_max.numpy()[instance] == everything.max(axis=0)).all()
        a, b, c = own[faces].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        if two_sided:  # they have their faces' normals
            continue
        first = 3 * meshes.corner_start.numpy()[instance]
        stored = meshes.normals.numpy()[first : first + 3 * len(faces)].reshape(-1, 3, 3)
        assert np.abs(stored - normal[:, None]).max() < 1e-4
