"""Normals, mappings and materials of hits against closed forms."""

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels import types
from warpcam.kernels.types import BOX, CAPSULE, CYLINDER, ELLIPSOID, HEIGHT_FIELD, MESH, PLANE, SPHERE

DEVICES = [str(device) for device in wp.get_devices()]


@wp.struct
class Found:
    """Examination of one hit."""

    normal: wp.vec3
    weights: wp.vec3  # of the corners of its Gouraud triangle
    shading: wp.mat33  # rows: the normals there
    uv: wp.vec2
    along: wp.vec2  # change of uv over a step
    direction: wp.vec3  # into a cube texture


@wp.func_native("""
    using namespace warpcam;
    using All = SceneTypes<255, 0>;
    Camera camera {};
    for (int k = 0; k < 3; ++k)
        camera.rotation.at[k][k] = 1.0f;
    const auto look = load_appearance<All, ShadingNeeds<RGB | NORMALS, HAS_MATERIALS | HAS_TEXTURES>>(
        shapes, materials, None {}, textures, meshes, fields, camera, 0.0f, 0, shape);
    const Vec3 sight = as_vec3(ray);
    const SurfaceInteraction surface = surface_at<All>(look.pose, meshes, fields, face, as_vec3(local), sight);
    GouraudTriangle gouraud;
    gouraud_at<All>(look, meshes, surface, as_vec3(local), gouraud);
    const Vec3 to_next = as_vec3(step);
    const Footprint at = footprint_2d<All>(look.pose, look.layout, meshes, surface, sight, to_next, to_next);
    const Vec3 direction = map_cube<All>(look.pose, look.layout, surface).direction;
    auto& one = wp::index(found, i);
    one.normal = wp::vec3(surface.normal.x, surface.normal.y, surface.normal.z);
    one.weights = wp::vec3(1.0f - gouraud.weight1 - gouraud.weight2, gouraud.weight1, gouraud.weight2);
    for (int k = 0; k < 3; ++k) {
        one.shading.data[k][0] = gouraud.normal[k].x;
        one.shading.data[k][1] = gouraud.normal[k].y;
        one.shading.data[k][2] = gouraud.normal[k].z;
    }
    one.uv = wp::vec2(at.u, at.v);
    one.along = wp::vec2(at.right.x, at.right.y);
    one.direction = wp::vec3(direction.x, direction.y, direction.z);
""")
def examine_hit(
    shapes: types.Shapes,
    meshes: types.Meshes,
    fields: types.HeightFields,
    materials: types.Materials,
    textures: types.Textures,
    shape: wp.int32,
    face: wp.int32,
    local: wp.vec3,
    ray: wp.vec3,
    step: wp.vec3,
    i: wp.int32,
    found: wp.array(dtype=Found),
): ...


@native_kernel("shading_pass/shading_pass.h")
def examine(
    shapes: types.Shapes,
    meshes: types.Meshes,
    fields: types.HeightFields,
    materials: types.Materials,
    textures: types.Textures,
    shape: wp.int32,
    face: wp.array(dtype=wp.int32),
    local: wp.array(dtype=wp.vec3),
    ray: wp.array(dtype=wp.vec3),
    step: wp.array(dtype=wp.vec3),
    found: wp.array(dtype=Found),
):
    i = wp.tid()
    examine_hit(shapes, meshes, fields, materials, textures, shape, face[i], local[i], ray[i], step[i], i, found)


@wp.struct
class Finish:
    """Appearance of a shape."""

    color: wp.vec3
    texture: wp.int32
    emission: wp.float32
    specular: wp.float32
    exponent: wp.float32


@wp.func_native("""
    const auto material = warpcam::load_material<true>(shapes, materials, world, shape);
    auto& one = wp::index(finishes, world, shape);
    one.color = wp::vec3(material.color.x, material.color.y, material.color.z);
    one.texture = material.color.w;
    one.emission = material.gloss.x;
    one.specular = material.gloss.y;
    one.exponent = material.gloss.z;
""")
def find_finish(
    shapes: types.Shapes,
    materials: types.Materials,
    world: wp.int32,
    shape: wp.int32,
    finishes: wp.array2d(dtype=Finish),
): ...


@native_kernel("shading_pass/shading_pass.h")
def finish_shapes(shapes: types.Shapes, materials: types.Materials, finishes: wp.array2d(dtype=Finish)):
    world, shape = wp.tid()
    find_finish(shapes, materials, world, shape, finishes)


HALF = (0.8, 0.5, 0.3)
SIZES = {
    PLANE: (0.8, 0.5, 0.1),
    SPHERE: (0.7, 0, 0),
    CAPSULE: (0.4, 0.5, 0),
    ELLIPSOID: HALF,
    CYLINDER: (0.4, 0.5, 0),
    BOX: HALF,
    MESH: (0, 0, 0),
    HEIGHT_FIELD: (0, 0, 0),
}
CORNERS = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 1]], np.float32)
HEIGHTS = np.array([[0.0, 0.3, 0.9], [0.2, 0.7, 0.1], [1.0, 0.4, 0.6]], np.float32)


class Examined:
    def __init__(
        self, kind, local, ray, device, face=0, repeat=(1, 1), uniform=False, size=None, step=(0, 0, 0), cube=False
    ):
        def put(values, dtype):
            return wp.array(values, dtype=dtype, device=device)

        shapes = types.Shapes()
        shapes.types = put([kind], wp.int32)
        shapes.positions = put(np.zeros((1, 1, 3), np.float32), wp.vec3)
        shapes.rotations = put(np.eye(3, dtype=np.float32)[None, None], wp.mat33)
        shapes.sizes = put(np.array([[size or SIZES[kind]]], np.float32), wp.vec3)
        shapes.assets = put(np.array([[0]], np.int32), wp.int32)
        shapes.materials = put(np.array([[0]], np.int32), wp.int32)
        shapes.colors = put(np.array([[[1, 0, 0, 1]]], np.float32), wp.vec4)
        materials = types.Materials()
        materials.color = put(np.ones((1, 1, 4), np.float32), wp.vec4)
        for name in ("emission", "specular", "shininess"):
            setattr(materials, name, put(np.zeros((1, 1), np.float32), wp.float32))
        materials.texture = put(np.zeros((1, 1, 2), np.int32), wp.int32)
        materials.texture_repeat = put(np.array([[repeat]], np.float32), wp.vec2)
        materials.texture_uniform = put(np.array([[uniform]]), wp.bool)
        textures = types.Textures()
        textures.kind = put([types.TEXTURE_CUBE if cube else types.TEXTURE_2D], wp.int32)
        for name in ("width", "height", "levels", "start"):
            setattr(textures, name, put([1], wp.int32))
        # Two faces; in leaf order the second as given comes first.
        meshes = types.Meshes()
        rows = np.zeros((6, 4), np.float32)
        rows[:, :3] = np.concatenate([CORNERS[3:], CORNERS[:3]])
        rows[[0, 3], 3] = np.array([1, 0], np.int32).view(np.float32)
        meshes.faces = put(rows, wp.vec4)
        meshes.bounds_min = put([[0.0, 0.0, 0.0]], wp.vec3)
        meshes.bounds_max = put([[2.0, 1.0, 1.0]], wp.vec3)
        meshes.face_start = put([0], wp.int32)
        meshes.corner_start = put([0], wp.int32)
        normals = np.array([[0, 0, 1]] * 3 + [[1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
        meshes.normals = put(normals, wp.vec3)
        meshes.uvs = put(np.array([[0, 0], [1, 0], [0, 1]] * 2, np.float32), wp.vec2)
        meshes.has_uvs = put([1], wp.int32)
        fields = types.HeightFields()
        fields.size = put([[1.0, 0.5, 1.0, 0.25]], wp.vec4)
        fields.rows = put([3], wp.int32)
        fields.columns = put([3], wp.int32)
        fields.height_start = put([0], wp.int32)
        fields.heights = put(HEIGHTS.reshape(-1), wp.float32)

        local = np.atleast_2d(np.asarray(local, np.float32))
        count = len(local)
        found = wp.zeros(count, dtype=Found, device=device)
        inputs = [
            put(np.broadcast_to(face, count).astype(np.int32), wp.int32),
            put(local, wp.vec3),
            put(np.broadcast_to(np.asarray(ray, np.float32), local.shape), wp.vec3),
            put(np.broadcast_to(np.asarray(step, np.float32), local.shape), wp.vec3),
        ]
        arguments = [shapes, meshes, fields, materials, textures, 0, *inputs, found]
        wp.launch(examine, count, arguments, device=device)
        values = found.numpy()
        self.normals, self.weights, self.shading = values["normal"], values["weights"], values["shading"]
        self.uv, self.along, self.direction = values["uv"], values["along"], values["direction"]


def points_on(kind, count=60):
    """Points on a shape, their outward normals, and directions that see them."""
    rng = np.random.default_rng(kind)
    unit = rng.normal(size=(count, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    radius, half = SIZES[kind][0], SIZES[kind][1]
    if kind == PLANE:
        local = np.stack([rng.uniform(-0.8, 0.8, count), rng.uniform(-0.5, 0.5, count), np.zeros(count)], 1)
        normal = np.tile([0.0, 0.0, 1.0], (count, 1))
    elif kind == SPHERE:
        local, normal = radius * unit, unit
    elif kind == CAPSULE:
        local = radius * unit + np.where(unit[:, 2:] > 0, 1, -1) * [0, 0, half]
        normal = unit.copy()
        side = slice(0, count // 2)
        normal[side, 2] = 0
        normal[side] /= np.linalg.norm(normal[side], axis=1, keepdims=True)
        local[side] = radius * normal[side] + rng.uniform(-half, half, (count // 2, 1)) * [0, 0, 1]
    elif kind == ELLIPSOID:
        local = unit * HALF
        normal = unit / HALF
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    elif kind == CYLINDER:
        turn = rng.uniform(0, 2 * np.pi, count)
        normal = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
        local = radius * normal + rng.uniform(-half, half, (count, 1)) * [0, 0, 1]
        caps = slice(0, count // 2)
        normal[caps] = rng.choice([-1, 1], (count // 2, 1)) * [0, 0, 1]
        local[caps] = local[caps] * [0.7, 0.7, 0] + half * normal[caps]
    else:
        local = rng.uniform(-0.99, 0.99, (count, 3))
        axis, sign = rng.integers(0, 3, count), rng.choice([-1, 1], count)
        local[np.arange(count), axis] = sign
        local *= HALF
        normal = np.zeros((count, 3))
        normal[np.arange(count), axis] = sign
    seen = rng.normal(size=(count, 3))
    seen *= -np.sign(np.sum(seen * normal, axis=1, keepdims=True))
    return local, normal, seen


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("kind", [PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX])
def test_normals_of_solids(kind, device):
    local, normal, seen = points_on(kind)
    examined = Examined(kind, local, seen, device)
    np.testing.assert_allclose(examined.normals, normal, atol=2e-6)
    np.testing.assert_allclose(examined.shading, np.repeat(normal[:, None], 3, axis=1), atol=2e-6)


@pytest.mark.parametrize("device", DEVICES)
def test_an_edge_of_a_box_shows_a_side_the_ray_can_enter(device):
    examined = Examined(BOX, [[0.8, 0.0, 0.3]], [1.0, 0.1, -2.0], device)
    np.testing.assert_array_equal(examined.normals, [[0, 0, 1]])


@pytest.mark.parametrize("device", DEVICES)
def test_height_field_triangles(device):
    """Cells are cut from low row and column to high row and column."""
    for row in range(2):
        for column in range(2):
            for upper in range(2):
                a, c = (column, row), (column + 1, row + 1)
                b = (column, row + 1) if upper else (column + 1, row)
                corners = [(x - 1.0, 0.5 * (y - 1.0), HEIGHTS[y, x]) for x, y in ((a, c, b) if upper else (a, b, c))]
                p, q, r = np.array(corners)
                normal = np.cross(q - p, r - p)
                normal /= np.linalg.norm(normal)
                face = 2 * (2 * row + column) + upper
                examined = Examined(HEIGHT_FIELD, [(p + q + r) / 3], [0, 0, -1], device, face=face)
                np.testing.assert_allclose(examined.normals, [normal], atol=1e-6)


@pytest.mark.parametrize("device", DEVICES)
def test_height_field_sides_and_base(device):
    places = [[1, 0.2, 0.1], [-1, 0.2, -0.1], [0.3, 0.5, 0.2], [0.3, -0.5, 0.1], [0.3, 0.1, -0.25]]
    normals = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1]]
    np.testing.assert_array_equal(Examined(HEIGHT_FIELD, places, [0, 0, 1], device, face=-1).normals, normals)


@pytest.mark.parametrize("device", DEVICES)
def test_mesh_normals_and_coordinates(device):
    weights = np.array([0.2, 0.3, 0.5])
    flat = Examined(MESH, weights @ CORNERS[:3], [0, 0, -1], device, face=1)
    np.testing.assert_allclose(flat.normals, [[0, 0, 1]], atol=1e-6)
    np.testing.assert_allclose(flat.uv, [[0.3, 1 - 0.5]], atol=1e-6)
    steep = Examined(MESH, weights @ CORNERS[3:], [0, 0, -1], device, face=0)
    geometric = np.cross(CORNERS[4] - CORNERS[3], CORNERS[5] - CORNERS[3])
    np.testing.assert_allclose(steep.normals, [geometric / np.linalg.norm(geometric)], atol=1e-6)
    np.testing.assert_allclose(steep.shading, [np.eye(3)], atol=1e-6)
    np.testing.assert_allclose(steep.weights, [weights], atol=1e-6)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("kind", [PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH])
@pytest.mark.parametrize("uniform", [False, True])
def test_gradients_are_those_of_the_mapping(kind, uniform, device):
    if kind == MESH:
        rng = np.random.default_rng(7)
        local = rng.dirichlet(np.ones(3) * 5, 40) @ CORNERS[3:]
        normal = np.tile(np.cross(CORNERS[4] - CORNERS[3], CORNERS[5] - CORNERS[3]) / 5**0.5, (40, 1))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        seen = -normal
    else:
        local, normal, seen = points_on(kind)
        if kind == SPHERE or kind == ELLIPSOID or kind == CAPSULE:
            keep = np.hypot(local[:, 0], local[:, 1]) > 0.1  # not at the poles
            local, normal, seen = local[keep], normal[keep], seen[keep]
        if kind == CAPSULE:
            keep = np.abs(np.abs(local[:, 2]) - 0.5) > 0.01  # not at the joints
            local, normal, seen = local[keep], normal[keep], seen[keep]
    step = np.cross(normal, np.random.default_rng(3).normal(size=local.shape))
    step *= 1e-3 / np.linalg.norm(step, axis=1, keepdims=True)
    options = {"face": 0, "repeat": (3.0, 0.5), "uniform": uniform}
    here = Examined(kind, local, seen, device, step=step, **options)
    there = Examined(kind, local + step, seen, device, **options)
    back = Examined(kind, local - step, seen, device, **options)
    change = (there.uv - back.uv) / 2
    change[np.abs(change) > 0.1] = np.nan  # across the seam at +x
    expected = here.along
    good = ~np.isnan(change)
    assert good.mean() > 0.9
    np.testing.assert_allclose(expected[good], change[good], atol=4e-5, rtol=0.02)


# Where MuJoCo 3.17's renderer put the points of shapes on a texture that shows its own coordinates.
MEASURED = [
    (PLANE, (1, 0.5, 0.1), (0.842, 0.039, 0), (0.8, 0.6), False, (0.74, 0.279)),
    (PLANE, (1, 0.5, 0.1), (0.842, 0.039, 0), (0.8, 0.6), True, (0.736, 0.139)),
    (PLANE, (0, 0, 0.1), (1.37, -0.728, 0), (0.8, 0.6), True, (0.049, 0.717)),
    (PLANE, (0, 0.5, 0.1), (0.061, 0.287, 0), (0.8, 0.6), False, (0.525, 0.631)),
    (PLANE, (1, 0, 0.1), (0.478, 0.456, 0), (0.8, 0.6), False, (0.092, 0.365)),
    (BOX, (1, 0.5, 0.3), (0.154, 0.14, 0.3), (0.8, 0.6), False, (0.463, 0.217)),
    (BOX, (1, 0.5, 0.3), (0.377, -0.5, 0.245), (0.8, 0.6), True, (0.549, 0.029)),
    (BOX, (1, 0.5, 0.3), (1, -0.069, 0.061), (0.8, 0.6), True, (0.346, 0.123)),
    (SPHERE, (0.7, 0, 0), (0.181, -0.33, 0.588), (1, 1), False, (0.83, 0.182)),
    (SPHERE, (0.7, 0, 0), (0.387, -0.313, -0.492), (0.8, 0.6), True, (0.502, 0.314)),
    (CAPSULE, (0.4, 0.5, 0), (0.124, -0.313, 0.711), (1, 1), False, (0.811, 0.646)),
    (CAPSULE, (0.4, 0.5, 0), (0.138, -0.373, 0.49), (1, 1), False, (0.807, 0.014)),
    (CAPSULE, (0.4, 0.5, 0), (0.181, -0.219, -0.78), (0.8, 0.6), True, (0.275, 0.119)),
    (CYLINDER, (0.4, 0.5, 0), (-0.313, 0.244, 0.5), (1, 1), False, (0.111, 0.807)),
    (CYLINDER, (0.4, 0.5, 0), (0.299, -0.264, 0.17), (0.8, 0.6), True, (0.283, 0.08)),
    (ELLIPSOID, (0.4, 0.5, 0.8), (0.231, -0.303, 0.43), (1, 1), False, (0.869, 0.318)),
    (ELLIPSOID, (0.4, 0.5, 0.8), (0.352, -0.192, 0.201), (0.8, 0.6), True, (0.299, 0.127)),
    (HEIGHT_FIELD, (0, 0, 0), (0.494, -0.432, 0.027), (0.8, 0.6), False, (0.697, 0.76)),
    (HEIGHT_FIELD, (0, 0, 0), (-0.129, -0.223, 0.185), (0.8, 0.6), True, (0.447, 0.568)),
]


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("kind", "size", "place", "repeat", "uniform", "uv"), MEASURED)
def test_textures_lie_where_mujoco_lays_them(kind, size, place, repeat, uniform, uv, device):
    eye = np.array([2.0, -2.2, 1.9])
    face = 0 if kind == HEIGHT_FIELD else -1
    options = {"face": face, "repeat": repeat, "uniform": uniform, "size": size}
    mapped = Examined(kind, [place], np.array(place) - eye, device, **options).uv[0]
    off = (mapped - uv + 0.5) % 1.0 - 0.5
    np.testing.assert_allclose(off, 0, atol=0.008)


@pytest.mark.parametrize("device", DEVICES)
def test_cube_directions(device):
    cap = Examined(CAPSULE, [[0.0, 0.2, 0.8]], [0, 0, -1], device, cube=True)
    np.testing.assert_allclose(cap.direction, [[0, 0.5, 1 + 0.3 / 0.4]], atol=1e-6)
    side = Examined(CAPSULE, [[0.4, 0.0, 0.25]], [-1, 0, 0], device, cube=True)
    np.testing.assert_allclose(side.direction, [[1, 0, 0.5]], atol=1e-6)
    box = Examined(BOX, [[0.4, 0.25, 0.3]], [0, 0, -1], device, uniform=True, cube=True)
    np.testing.assert_allclose(box.direction, [[0.4, 0.25, 0.3]], atol=1e-6)


@pytest.mark.parametrize("device", DEVICES)
def test_a_shapes_own_colour_hides_its_materials(device):
    shapes, materials = types.Shapes(), types.Materials()
    grey, red = (0.5, 0.5, 0.5, 1.0), (1.0, 0.0, 0.0, 1.0)
    shapes.colors = wp.array(np.array([[grey, red, grey, grey]], np.float32), dtype=wp.vec4, device=device)
    shapes.materials = wp.array(np.array([[0, 0, -1, 7]], np.int32), dtype=wp.int32, device=device)
    blue = np.array([[(0, 0, 1, 1)], [(0, 1, 1, 1)]], np.float32)
    materials.color = wp.array(blue, dtype=wp.vec4, device=device)
    for name, value in (("emission", 0.1), ("specular", 0.2), ("shininess", 0.3)):
        setattr(materials, name, wp.array(np.full((1, 1), value, np.float32), dtype=wp.float32, device=device))
    materials.texture = wp.array(np.array([[[9, 4]]], np.int32), dtype=wp.int32, device=device)
    materials.texture_repeat = wp.array(np.ones((1, 1, 2), np.float32), dtype=wp.vec2, device=device)
    materials.texture_uniform = wp.array(np.zeros((1, 1), bool), dtype=wp.bool, device=device)
    finishes = wp.zeros((2, 4), dtype=Finish, device=device)
    wp.launch(finish_shapes, (2, 4), [shapes, materials, finishes], device=device)
    got = finishes.numpy()
    np.testing.assert_array_equal(got["color"][0], [(0, 0, 1), red[:3], grey[:3], grey[:3]])
    np.testing.assert_array_equal(got["color"][1, 0], (0, 1, 1))
    np.testing.assert_array_equal(got["texture"][0], [4, 4, -1, -1])  # 7 is no material
    np.testing.assert_allclose(got["specular"][0], [0.2, 0.2, 0.5, 0.5])
    np.testing.assert_allclose(got["exponent"][0], [38.4, 38.4, 64, 64], rtol=1e-6)
    np.testing.assert_allclose(got["emission"][0], [0.1, 0.1, 0.0, 0.0])
