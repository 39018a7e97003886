"""The triangles that light is computed at."""

import numpy as np
import pytest
import warp as wp
from warpcam.kernels.facet import (
    Facet,
    box_facet,
    endless_cell,
    facet_corner,
    height_field_facet,
    in_quad,
    plane_cell,
)
from warpcam.kernels.surface import box_surface
from warpcam.kernels.types import HeightFields

DEVICES = [str(device) for device in wp.get_devices()]


@wp.func
def write_facet(facet: Facet, i: wp.int32, corners: wp.array2d(dtype=wp.vec3), found: wp.array(dtype=Facet)):
    for k in range(3):
        corners[i, k] = facet_corner(facet, k)
    found[i] = facet


@wp.kernel(enable_backward=False)
def cut_box(
    local: wp.array(dtype=wp.vec3),
    ray: wp.array(dtype=wp.vec3),
    half: wp.vec3,
    corners: wp.array2d(dtype=wp.vec3),
    found: wp.array(dtype=Facet),
):
    i = wp.tid()
    surface = box_surface(local[i], half, ray[i])
    surface.local = local[i]
    write_facet(box_facet(surface, half), i, corners, found)


@wp.kernel(enable_backward=False)
def cut_height_field(
    fields: HeightFields,
    face: wp.array(dtype=wp.int32),
    local: wp.array(dtype=wp.vec3),
    corners: wp.array2d(dtype=wp.vec3),
    found: wp.array(dtype=Facet),
):
    i = wp.tid()
    write_facet(height_field_facet(fields, 0, face[i], local[i]), i, corners, found)


@wp.kernel(enable_backward=False)
def cut_plane(
    size: wp.vec3,
    local: wp.array(dtype=wp.vec3),
    corners: wp.array2d(dtype=wp.vec3),
    found: wp.array(dtype=Facet),
):
    i = wp.tid()
    u = plane_cell(local[i][0], size[0], size[2])
    v = plane_cell(local[i][1], size[1], size[2])
    write_facet(in_quad(local[i], 0, 1, u, v, False), i, corners, found)


@wp.kernel(enable_backward=False)
def cut_endless(
    eye: wp.float32,
    repeat: wp.float32,
    horizon: wp.float32,
    x: wp.array(dtype=wp.float32),
    cells: wp.array(dtype=wp.vec2),
):
    i = wp.tid()
    cells[i] = endless_cell(x[i], eye, repeat, horizon)


def check(local, corners, found):
    """The weights are barycentric and give back the place."""
    weights = found.numpy()["weights"]
    assert (weights >= -1e-5).all()
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-6)
    np.testing.assert_allclose(np.einsum("ik,ikd->id", weights, corners.numpy()), local, atol=2e-6)
    np.testing.assert_array_equal(found.numpy()["corners"], 3)


def put(values, dtype, device):
    """A Warp array of ``values``."""
    return wp.array(np.asarray(values), dtype=dtype, device=device)


def outputs(count, device):
    """Arrays for corners and facets."""
    return wp.zeros((count, 3), dtype=wp.vec3, device=device), wp.zeros(count, dtype=Facet, device=device)


@pytest.mark.parametrize("device", DEVICES)
def test_boxes_are_cut_into_four_by_four_quads_a_side(device):
    rng = np.random.default_rng(0)
    half = np.array([0.8, 0.5, 0.25], np.float32)
    local = rng.uniform(-1, 1, (200, 3)).astype(np.float32)
    axis, sign = rng.integers(0, 3, 200), rng.choice([-1, 1], 200)
    local[np.arange(200), axis] = sign
    local *= half
    ray = rng.normal(size=(200, 3)).astype(np.float32)
    ray[np.arange(200), axis] = -20 * sign
    corners, found = outputs(200, device)
    arguments = [put(local, wp.vec3, device), put(ray, wp.vec3, device), wp.vec3(*half), corners, found]
    wp.launch(cut_box, 200, arguments, device=device)
    check(local, corners, found)
    steps = 2 * corners.numpy() / half
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-5)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    ("size", "edges"),
    [
        ((1.0, 1.0, 40.0), [-1, 0, 1]),
        ((1.0, 1.0, 0.25), [-1, -0.5, 0, 0.5, 1]),
        ((1.0, 1.0, 0.4), [-1, -0.8, 0, 0.8, 1]),
    ],
)
def test_planes_are_cut_as_their_spacing_says(size, edges, device):
    rng = np.random.default_rng(1)
    local = rng.uniform(-1, 1, (300, 3)).astype(np.float32) * [1, 1, 0]
    corners, found = outputs(300, device)
    wp.launch(cut_plane, 300, [wp.vec3(*size), put(local, wp.vec3, device), corners, found], device=device)
    check(local, corners, found)
    got = np.unique(corners.numpy()[..., :2].round(4))
    np.testing.assert_allclose(got, edges, atol=1e-4)


@pytest.mark.parametrize("device", DEVICES)
def test_endless_planes_are_cut_around_the_eye(device):
    x = np.linspace(-3, 9, 100).astype(np.float32)
    cells = wp.zeros(100, dtype=wp.vec2, device=device)
    wp.launch(cut_endless, 100, [3.3, 4.0, 50.0, put(x, wp.float32, device), cells], device=device)
    start, length = cells.numpy().T
    np.testing.assert_allclose(length, (2.1 * 50 + 1.0) / 200, rtol=1e-6)  # two tiles of half a metre
    assert (start <= x + 1e-5).all()
    assert (x <= start + length + 1e-5).all()
    steps = (start - 3.0) / length  # the eye is nearest to tile pair 3
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-4)


@pytest.mark.parametrize("device", DEVICES)
def test_height_fields_are_cut_at_their_samples(device):
    rng = np.random.default_rng(2)
    fields = HeightFields()
    fields.size = put([[1.0, 0.5, 1.0, 0.1]], wp.vec4, device)
    fields.rows, fields.columns = put([3], wp.int32, device), put([4], wp.int32, device)
    fields.height_start = put([0], wp.int32, device)
    heights = rng.uniform(0, 1, (3, 4)).astype(np.float32)
    fields.heights = put(heights.reshape(-1), wp.float32, device)
    faces, places = [], []
    for cell in range(6):
        row, column = divmod(cell, 3)
        for upper in range(2):
            third = (row + 1, column) if upper else (row, column + 1)
            grid = np.array([(row, column), (row + 1, column + 1), third])
            points = np.stack([grid[:, 1] * 2 / 3 - 1, grid[:, 0] * 0.5 - 0.5, heights[grid[:, 0], grid[:, 1]]], 1)
            faces += [2 * cell + upper] * 5
            places += list(rng.dirichlet(np.ones(3), 5) @ points)
    local = np.array(places, np.float32)
    corners, found = outputs(len(local), device)
    arguments = [fields, put(faces, wp.int32, device), put(local, wp.vec3, device), corners, found]
    wp.launch(cut_height_field, len(local), arguments, device=device)
    check(local, corners, found)
    off = np.abs(corners.numpy()[..., 2].reshape(-1, 1) - heights.ravel())
    np.testing.assert_allclose(off.min(axis=1), 0, atol=1e-6)
