"""The triangles that light is computed at."""

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels.types import BOX, HEIGHT_FIELD, PLANE, HeightFields, Meshes

DEVICES = [str(device) for device in wp.get_devices()]


@wp.func_native("""
    using namespace warpcam;
    using All = SceneTypes<255, 0>;
    const Vec3 from = as_vec3(eye);
    ShapeAppearance<All, ShadingNeeds<RGB, 0>> look;
    look.pose = { { 1.0f, 0.0f, 0.0f, as_int(from.x) }, { 0.0f, 1.0f, 0.0f, as_int(from.y) },
                  { 0.0f, 0.0f, 1.0f, as_int(from.z) }, make_float3_int(as_vec3(size), kind + 16) };
    const float repeats[2] = { 0.0f, 0.0f };
    look.cells = plane_cells(look.pose, repeats, 0.0f);
    const SurfaceInteraction surface = surface_at<All>(look.pose, meshes, fields, face, as_vec3(local), as_vec3(ray));
    GouraudTriangle gouraud;
    gouraud_at<All>(look, meshes, surface, as_vec3(local) - from, gouraud);
    for (int k = 0; k < 3; ++k) {
        const Vec3 corner = gouraud.place[k] + from;
        wp::index(corners, i, k) = wp::vec3(corner.x, corner.y, corner.z);
    }
    wp::index(weights, i) = wp::vec3(1.0f - gouraud.weight1 - gouraud.weight2, gouraud.weight1, gouraud.weight2);
    wp::index(three, i) = gouraud.three;
""")
def find_facet(
    meshes: Meshes,
    fields: HeightFields,
    kind: wp.int32,
    size: wp.vec3,
    eye: wp.vec3,
    face: wp.int32,
    local: wp.vec3,
    ray: wp.vec3,
    i: wp.int32,
    corners: wp.array2d(dtype=wp.vec3),
    weights: wp.array(dtype=wp.vec3),
    three: wp.array(dtype=wp.int32),
): ...


@native_kernel("shading/gouraud.h")
def cut(
    meshes: Meshes,
    fields: HeightFields,
    kind: wp.int32,
    size: wp.vec3,
    eye: wp.vec3,
    face: wp.array(dtype=wp.int32),
    local: wp.array(dtype=wp.vec3),
    ray: wp.array(dtype=wp.vec3),
    corners: wp.array2d(dtype=wp.vec3),
    weights: wp.array(dtype=wp.vec3),
    three: wp.array(dtype=wp.int32),
):
    i = wp.tid()
    find_facet(meshes, fields, kind, size, eye, face[i], local[i], ray[i], i, corners, weights, three)


@wp.func_native("""
    const warpcam::CellSpan cell = warpcam::cell_around(warpcam::cells_of_endless(repeat, horizon), x);
    wp::index(cells, i) = wp::vec2(cell.start, cell.length);
""")
def find_cell(
    repeat: wp.float32,
    horizon: wp.float32,
    x: wp.float32,
    i: wp.int32,
    cells: wp.array(dtype=wp.vec2),
): ...


@native_kernel("shading/gouraud.h")
def cut_endless(
    repeat: wp.float32,
    horizon: wp.float32,
    x: wp.array(dtype=wp.float32),
    cells: wp.array(dtype=wp.vec2),
):
    i = wp.tid()
    find_cell(repeat, horizon, x[i], i, cells)


def corners_of(kind, local, device, *, size=(0, 0, 0), ray=(0, 0, -1), face=0, fields=None):
    """Corners, (n, 3, 3), of the facets that places on a shape lie in; the weights must give back the places."""
    count = len(local)
    corners = wp.zeros((count, 3), dtype=wp.vec3, device=device)
    weights, three = wp.zeros(count, dtype=wp.vec3, device=device), wp.zeros(count, dtype=wp.int32, device=device)
    inputs = [
        put(np.broadcast_to(face, count).astype(np.int32), wp.int32, device),
        put(local, wp.vec3, device),
        put(np.broadcast_to(np.asarray(ray, np.float32), (count, 3)), wp.vec3, device),
    ]
    eye = wp.vec3(0.25, -0.5, 1.5)
    arguments = [Meshes(), fields or HeightFields(), kind, wp.vec3(*size), eye, *inputs, corners, weights, three]
    wp.launch(cut, count, arguments, device=device)
    check(local, corners.numpy(), weights.numpy())
    np.testing.assert_array_equal(three.numpy(), 1)
    return corners.numpy()


def check(local, corners, weights):
    """The weights are barycentric and give back the place."""
    assert (weights >= -1e-5).all()
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-6)
    np.testing.assert_allclose(np.einsum("ik,ikd->id", weights, corners), local, atol=2e-6)


def put(values, dtype, device):
    """A Warp array of ``values``."""
    return wp.array(np.asarray(values), dtype=dtype, device=device)


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
    steps = 2 * corners_of(BOX, local, device, size=half, ray=ray) / half
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-5)
    # Which diagonal a quad is cut along: its triangles have their right angle at the low or high corner, or at others.
    middle = (steps.max(axis=1) + steps.min(axis=1)) / 2
    towards = np.delete((steps[:, 0] - middle).reshape(-1), axis + 3 * np.arange(200)).reshape(200, 2)
    np.testing.assert_array_equal(towards[:, 0] * towards[:, 1] < 0, (axis == 1) == (sign > 0))


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
    got = np.unique(corners_of(PLANE, local, device, size=size)[..., :2].round(4))
    np.testing.assert_allclose(got, edges, atol=1e-4)


@pytest.mark.parametrize("device", DEVICES)
def test_endless_planes_are_cut_from_their_middle(device):
    x = np.linspace(-3, 9, 100).astype(np.float32)
    cells = wp.zeros(100, dtype=wp.vec2, device=device)
    wp.launch(cut_endless, 100, [4.0, 50.0, put(x, wp.float32, device), cells], device=device)
    start, length = cells.numpy().T
    np.testing.assert_allclose(length, (2.1 * 50 + 1.0) / 200, rtol=1e-6)  # two tiles of half a metre
    assert (start <= x + 1e-5).all()
    assert (x <= start + length + 1e-5).all()
    steps = start / length
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
    corners = corners_of(HEIGHT_FIELD, local, device, face=faces, fields=fields)
    off = np.abs(corners[..., 2].reshape(-1, 1) - heights.ravel())
    np.testing.assert_allclose(off.min(axis=1), 0, atol=1e-6)
