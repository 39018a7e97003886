"""Trees that follow moving corners, in the layouts of both kinds of device."""

import numpy as np
import pytest
import warp as wp
from warpcam.kernels.refit import FAR, Tree

from warpcam.accel.meshes import Mesh, _child_by_child, pack_meshes


def sheet(cells: int) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    points = np.stack((x.ravel(), y.ravel(), 0 * x.ravel()), axis=1).astype(np.float32)
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    one = np.stack((first, first + cells + 1, first + 1), axis=1)
    other = np.stack((first + 1, first + cells + 1, first + cells + 2), axis=1)
    return points, np.concatenate((one, other)).astype(np.int32)


@pytest.mark.parametrize("by_child", [False, True])
@pytest.mark.parametrize("cells", [1, 2, 30])
def test_boxes_hold_their_faces_tightly(by_child: bool, cells: int) -> None:
    device, instances = wp.get_device("cpu"), 3
    points, faces = sheet(cells)
    meshes, _ = pack_meshes([Mesh("sheet", points, faces, moves=True)] * instances, device)
    wide = 8 if by_child else 7
    if by_child:
        meshes.nodes = wp.array(_child_by_child(meshes.nodes.numpy()), dtype=wp.vec4, device=device)
        meshes.node_start = wp.array(meshes.node_start.numpy() // 7 * 8, dtype=wp.int32, device=device)
    random = np.random.default_rng(cells)
    moved = random.normal(size=(5 + instances * len(points), 3)).astype(np.float32)
    bases = 5 + len(points) * np.arange(instances)
    tree = Tree(meshes, np.arange(instances), bases, faces, device, by_child)
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
            for child in np.flatnonzero(low[:, 0] < FAR):
                if codes[child] < 0:
                    start, count = (-codes[child] - 1) >> 4, (-codes[child] - 1) & 15
                    block = rows[first_faces[instance] + 3 * start :][: 3 * count]
                    given = np.ascontiguousarray(block[::3, 3]).view(np.int32)
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
        assert (meshes.lower.numpy()[instance] == everything.min(axis=0)).all()
        assert (meshes.upper.numpy()[instance] == everything.max(axis=0)).all()
        a, b, c = own[faces].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        first = 3 * meshes.corner_start.numpy()[instance]
        stored = meshes.normals.numpy()[first : first + 3 * len(faces)].reshape(-1, 3, 3)
        assert np.abs(stored - normal[:, None]).max() < 1e-4
