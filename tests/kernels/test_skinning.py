"""Points and normals beside vertices: a vertex for each index and a world for each are the same."""

import numpy as np
import pytest
import warp as wp

from warpcam.kernels.runtime.launch import bind_launch
from warpcam.kernels.update.skinning import Shell, offset_vertices, offset_vertices_by_world

WORLDS, COUNT = 3, 5


@pytest.mark.parametrize("by_area", [False, True], ids=["by_face", "by_area"])
@pytest.mark.parametrize("both", [False, True], ids=["one_side", "both_sides"])
def test_a_world_for_each_index_is_the_same(device: wp.Device, both: bool, by_area: bool) -> None:
    rng = np.random.default_rng(7)
    # A sheet of COUNT x COUNT vertices, the first of which is another surface's; one vertex has no face.
    number = np.arange(COUNT * COUNT).reshape(COUNT, COUNT)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]))
    faces = np.concatenate((np.stack((a, b, c), axis=1), np.stack((c, b, d), axis=1))).astype(np.int32)
    vertices = rng.normal(size=(WORLDS, 1 + number.size + 1, 3)).astype(np.float32)
    hull = Shell(faces, number.size + 1, 0.01, by_area, first_vertex=1, first_point=2, both=both)
    surface = hull.upload(device)
    seen = []
    for kernel, dim in ((offset_vertices, WORLDS * (number.size + 1)), (offset_vertices_by_world, WORLDS)):
        points, normals = (
            wp.full((WORLDS, 2 + 2 * (number.size + 1)), wp.vec3(7.0), dtype=wp.vec3, device=device) for _ in range(2)
        )
        placed = wp.array(vertices, dtype=wp.vec3, device=device)
        bind_launch(kernel, dim, [surface, placed, points, normals], device).launch()
        seen.append((points.numpy(), normals.numpy()))
    (points, normals), (others, other_normals) = seen
    np.testing.assert_allclose(others, points, rtol=0, atol=1e-6)
    np.testing.assert_allclose(other_normals, normals, rtol=0, atol=1e-5)

    corners = vertices[:, 1:][:, faces]
    across = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    if not by_area:
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
    sums = np.zeros((WORLDS, number.size, 3))
    for k in range(3):
        np.add.at(sums, (slice(None), faces[:, k]), across)
    expected = sums / np.linalg.norm(sums, axis=-1, keepdims=True)
    own = normals[:, 2 : 2 + number.size]
    np.testing.assert_allclose(own, expected, rtol=0, atol=1e-4)
    np.testing.assert_allclose(points[:, 2 : 2 + number.size], vertices[:, 1:-1] + 0.01 * own, rtol=0, atol=1e-6)
    assert (points[:, :2] == 7.0).all()  # what is another surface's
    behind = slice(3 + number.size, 3 + 2 * number.size)
    if both:
        np.testing.assert_allclose(normals[:, behind], -own, rtol=0, atol=0)
    else:
        assert (normals[:, behind] == 7.0).all()
