"""Cases of Newton's own tests of its camera, as tests of ours."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
import newton_scenes  # noqa: E402, newton may be missing
from newton_scenes import eye, finalize, pose  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

DOWN = (1.0, 0.0, 0.0, 0.0)


def above(height: float, **changes: Any) -> wc.Camera:
    """Looks straight down."""
    return eye(**{"width": 48, "height": 48, "position": (0.0, 0.0, height), "rotation": DOWN, **changes})


def as_newton_sees(builder: "newton.ModelBuilder", device: wp.Device, camera: wc.Camera, most: float = 0.002) -> dict:
    """Our images, held by those of Newton's own camera."""
    model, state = finalize(builder, device)
    expected = newton_scenes.newtons_own(model, state, camera)
    seen = scenes.look(wc.from_newton(model, state), camera)
    same = seen["segmentation"] == expected["segmentation"]
    assert (~same).mean() <= most
    hit = same & (seen["segmentation"] >= 0)
    close = np.abs(seen["depth"] - expected["depth"])[hit] <= 2e-4 + 1e-5 * expected["depth"][hit]
    assert close.mean() > 0.998
    assert (np.sum(seen["normals"] * expected["normals"], axis=-1)[hit] > 0.999).mean() > 0.995
    return seen


@pytest.mark.skipif(find_spec("pxr") is None, reason="the rabbit is a USD file")
def test_a_row_of_solids_and_a_rabbit(device: wp.Device) -> None:
    from pxr import Usd, UsdGeom

    builder = newton.ModelBuilder()
    builder.add_ground_plane()
    builder.add_shape_sphere(builder.add_body(xform=pose(0.0, -2.0, 0.5)), radius=0.5)
    builder.add_shape_capsule(builder.add_body(xform=pose(0.0, 0.0, 0.75)), radius=0.25, half_height=0.5)
    builder.add_shape_cylinder(builder.add_body(xform=pose(0.0, -4.0, 0.5)), radius=0.4, half_height=0.5)
    builder.add_shape_box(builder.add_body(xform=pose(0.0, 2.0, 0.5)), hx=0.5, hy=0.35, hz=0.5)
    assets = Path(newton.__file__).parent / "examples" / "assets"
    stage = Usd.Stage.Open(str(assets / "bunny.usd"))
    rabbit = UsdGeom.Mesh(next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)))
    points, indices = (np.array(a.Get()) for a in (rabbit.GetPointsAttr(), rabbit.GetFaceVertexIndicesAttr()))
    mesh = newton.Mesh(points, indices, compute_inertia=False)
    builder.add_shape_mesh(builder.add_body(xform=pose(0.0, 4.0, 0.0, (0.5, 0.5, 0.5, 0.5))), mesh=mesh)
    position = (7.0, 1.0, 4.0)
    camera = eye(width=128, height=96, position=position, rotation=scenes.looking(position, (0.0, 0.0, 0.5)))
    seen = as_newton_sees(builder, device, camera)
    assert set(np.unique(seen["segmentation"])) >= {0, 1, 2, 3, 4, 5}


@pytest.mark.parametrize("heights", [np.ones((3, 3)), np.random.default_rng(0).uniform(0.5, 1.5, (12, 9))])
def test_a_height_field_fills_the_view(device: wp.Device, heights: np.ndarray) -> None:
    """A flat one's surface lies at its lowest height: its base must not come before it."""
    low, high = float(heights.min()), float(heights.max())
    ground = newton.Heightfield(
        heights.astype(np.float32), *heights.shape, hx=2.0, hy=2.0, min_z=low, max_z=high
    )  # fmt: skip
    builder = newton.ModelBuilder()
    builder.add_shape_heightfield(heightfield=ground)
    model, state = finalize(builder, device)
    depth = scenes.look(wc.from_newton(model, state), above(5.0, lens=wc.Pinhole(fovy=30.0)))["depth"][0]
    assert np.isfinite(depth).all()
    assert (depth >= 5.0 - high - 1e-5).all() and (depth <= 5.0 - low + 1e-5).all()
    if low == high:
        assert depth == pytest.approx(4.0, abs=1e-5)


def test_a_height_field_of_each_world(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    for world in range(3):
        level = 0.5 * world
        ground = newton.Heightfield(np.zeros((4, 4)), 4, 4, hx=2.0, hy=2.0, min_z=level, max_z=level)
        builder.begin_world()
        builder.add_shape_heightfield(heightfield=ground)
        builder.end_world()
    model, state = finalize(builder, device)
    seen = scenes.look(wc.from_newton(model, state), above(5.0, lens=wc.Pinhole(fovy=30.0)))
    for world in range(3):
        assert seen["depth"][world] == pytest.approx(5.0 - 0.5 * world, abs=1e-5)
        assert (seen["segmentation"][world] == world).all()


@pytest.mark.parametrize("spacing", [0.0, 10.0, 1000.0])
def test_particles_of_all_worlds_look_alike(device: wp.Device, spacing: float) -> None:
    part, builder = newton.ModelBuilder(), newton.ModelBuilder()
    part.add_particle_grid(
        pos=wp.vec3(-0.4, -0.4, 0.1), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=8, dim_y=8, dim_z=2, cell_x=0.1,
        cell_y=0.1, cell_z=0.1, mass=0.0, jitter=0.0, radius_mean=0.04,
    )  # fmt: skip
    for world in range(4):
        builder.add_world(part, xform=pose(world * spacing, 0.0, 0.0))
    model, state = finalize(builder, device)
    positions = np.array([(world * spacing, 0.0, 3.0) for world in range(4)])
    seen = scenes.look(wc.from_newton(model, state), above(3.0, position=positions, outputs=("depth", "segmentation")))
    hit = seen["segmentation"] == -2
    assert 0.02 < hit.mean() < 0.5
    assert (hit == hit[0]).mean() > 0.999
    both = hit & hit[0]
    assert np.abs(np.where(both, seen["depth"], 0.0) - np.where(both, seen["depth"][0], 0.0)).max() < 2e-4 * (
        1.0 + 0.01 * spacing
    )


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_worlds_of_any_size(device: wp.Device, size: float) -> None:
    """One, two and no shapes, a millimetre and a kilometre across."""
    builder = newton.ModelBuilder()
    for count in range(3):
        builder.begin_world()
        for place in range(count):
            builder.add_shape_sphere(-1, radius=0.2 * size, xform=pose((place - 0.5) * size, 0.0, 0.0))
        if count == 0:
            builder.add_body()
        builder.end_world()
    model, state = finalize(builder, device)
    seen = scenes.look(wc.from_newton(model, state), above(2.0 * size))
    assert [set(np.unique(image)) for image in seen["segmentation"]] == [{-1}, {-1, 0}, {-1, 1, 2}]
    assert seen["depth"].min() / size == pytest.approx(1.8, abs=0.01)


def test_what_is_global_is_in_every_world(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_sphere(-1, radius=0.3, xform=pose(0.5, 0.0, 1.0))
    box = newton.ModelBuilder()
    box.add_shape_box(box.add_body(xform=pose(-0.5, 0.0, 1.0)), hx=0.2, hy=0.2, hz=0.2)
    builder.replicate(box, 3)
    builder.add_ground_plane()
    builder.add_shape_mesh(-1, mesh=newton_scenes.tetrahedron(), xform=pose(0.0, 0.0, 1.5))
    seen = as_newton_sees(builder, device, eye())
    assert [set(np.unique(image)) for image in seen["segmentation"]] == [{-1, 0, 1 + w, 4, 5} for w in range(3)]


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 1.0), (0.3, -0.2, 0.1, 1.0)])
@pytest.mark.parametrize("width", [0.0, 1.5])
def test_planes_end_where_newtons_do(device: wp.Device, width: float, turn: tuple) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_plane(None, width=width, length=0.7 * width, xform=pose(0.2, -0.1, 0.3, turn))
    builder.add_shape_box(-1, hx=0.2, hy=0.2, hz=0.2, xform=pose(0.0, 0.0, 0.5))
    # Newton's camera sees no farther than a kilometre, where the pixels of the horizon are.
    seen = as_newton_sees(builder, device, eye(), 0.01)
    assert {0, 1} <= set(np.unique(seen["segmentation"])) <= {-1, 0, 1}


def test_planes_are_not_seen_from_below(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_plane(None, width=2.0, length=2.0, xform=pose(0.0, 0.0, 3.0))
    builder.add_shape_sphere(-1, radius=0.2, xform=pose(0.0, 0.0, 4.0))
    camera = above(1.0, rotation=(0.0, 1.0, 0.0, 0.0))
    seen = as_newton_sees(builder, device, camera)
    assert set(np.unique(seen["segmentation"])) == {-1, 1}


def test_what_is_wholly_transparent_hides_nothing(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_box(-1, hx=1.0, hy=1.0, hz=0.1, xform=pose(0.0, 0.0, 2.0))
    builder.add_shape_sphere(-1, radius=0.3, color=(0.7, 0.5, 0.3))
    model, state = finalize(builder, device)
    renderer = wc.Renderer(wc.from_newton(model, state), [above(4.0, shadows=True, outputs=("segmentation", "rgb"))])
    covered = scenes.on_host(renderer.render()["eye"])
    assert set(np.unique(covered["segmentation"])) == {0}
    scenes.write(model.shape_opacity, 0, 0.0)
    seen = scenes.on_host(renderer.render()["eye"])
    assert set(np.unique(seen["segmentation"])) == {-1, 1}
    alone = newton.ModelBuilder()
    alone.add_shape_sphere(-1, radius=0.3, color=(0.7, 0.5, 0.3))
    expected = scenes.look(
        wc.from_newton(*finalize(alone, device)), above(4.0, shadows=True, outputs=("segmentation", "rgb"))
    )
    assert (seen["rgb"] == expected["rgb"]).all()  # and casts no shadow


@pytest.mark.parametrize("down", [False, True])
def test_an_open_mesh_casts_a_shadow_whichever_side_is_lit(device: wp.Device, down: bool) -> None:
    """A ray to a light meets both sides of all meshes, as in Newton's camera."""
    corners = np.float32(((-0.4, -0.3, 0.0), (0.4, -0.3, 0.0), (0.0, 0.5, 0.0)))
    builder = newton.ModelBuilder()
    builder.add_ground_plane()
    turn = (1.0, 0.0, 0.0, 0.0) if down else None
    sheet = newton.Mesh(corners, np.array((0, 1, 2)), compute_inertia=False)
    builder.add_shape_mesh(-1, mesh=sheet, xform=pose(0.1, 0.2, 0.8, turn))
    model, state = finalize(builder, device)
    light = wc.Light(direction=(0.0, 0.0, -1.0))
    scene = wc.from_newton(model, state, lights=[light], ambient=(0.0, 0.0, 0.0))
    lit, seen = (
        scenes.look(scene, eye(outputs=("hdr", "segmentation", "points"), shadows=shadows)) for shadows in (False, True)
    )
    floor = seen["segmentation"] == 0
    points, dark = seen["points"][floor], (seen["hdr"] < 0.5 * lit["hdr"]).any(axis=-1)[floor]
    x, y = points[:, 0] - 0.1, (-1.0 if down else 1.0) * (points[:, 1] - 0.2)
    inside = np.minimum(y + 0.3, (0.5 - y) / 0.8 * 0.4 - np.abs(x))  # how far from the edges, about [m]
    assert (dark == (inside > 0.0))[np.abs(inside) > 0.02].all() and dark.sum() > 20
    assert ((seen["segmentation"] == 1).sum() > 0) != down


def test_a_smooth_closed_mesh_is_lit_where_light_falls(device: wp.Device) -> None:
    """Its own faces, which are met from both sides, do not shade it there."""
    builder = newton.ModelBuilder()
    ball = newton.Mesh.create_sphere(0.6, num_latitudes=24, num_longitudes=24, compute_inertia=False)
    builder.add_shape_mesh(-1, mesh=ball, xform=pose(0.0, 0.0, 0.9, (0.1, 0.2, 0.3, 0.9)))
    model, state = finalize(builder, device)
    direction = np.array((0.4, 0.7, -0.6))
    scene = wc.from_newton(model, state, lights=[wc.Light(direction=tuple(direction))], ambient=(0.0, 0.0, 0.0))
    lit, shaded = (scenes.look(scene, eye(outputs=("hdr", "normals"), shadows=shadows)) for shadows in (False, True))
    facing = lit["normals"] @ -direction / np.linalg.norm(direction) > 0.15
    assert facing.sum() > 200 and (lit["hdr"][facing].max(axis=-1) > 0.02).all()
    np.testing.assert_array_equal(lit["hdr"][facing], shaded["hdr"][facing])


def test_a_convex_hull_is_drawn_as_its_mesh(device: wp.Device) -> None:
    def look(add: str) -> dict:
        builder = newton.ModelBuilder()
        mesh = newton.Mesh.create_box(0.3, 0.2, 0.4, duplicate_vertices=False)
        getattr(builder, add)(-1, mesh=mesh, xform=pose(0.0, 0.0, 1.0, (0.2, 0.3, 0.1, 0.9)))
        return scenes.look(wc.from_newton(*finalize(builder, device)), eye())

    hull, mesh = look("add_shape_convex_hull"), look("add_shape_mesh")
    assert (hull["segmentation"] == mesh["segmentation"]).all() and (hull["segmentation"] == 0).any()
    hit = hull["segmentation"] == 0
    assert np.abs(hull["depth"] - mesh["depth"])[hit].max() < 1e-5


def test_two_cameras_on_one_model_do_not_meet(device: wp.Device) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    scene = wc.from_newton(model, state)
    first, second = wc.Renderer(scene, [eye()]), wc.Renderer(wc.from_newton(model, state), [above(4.0)])
    expected = [scenes.on_host(renderer.render()["eye"])["depth"] for renderer in (first, second)]
    for _ in range(2):
        for renderer, depth in zip((first, second), expected, strict=True):
            assert (scenes.on_host(renderer.render()["eye"])["depth"] == depth).all()


@pytest.mark.parametrize("channels", [0, 1, 3, 4])
def test_images_of_any_number_of_channels(device: wp.Device, channels: int) -> None:
    corners = np.array(((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)), np.float32)
    uvs = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32)
    value = (200, 100, 50, 255)
    pixels = np.full((2, 2, *([channels] if channels else [])), value[0], np.uint8)
    if channels > 1:
        pixels[...] = value[:channels]
    mesh = newton.Mesh(corners, np.array((0, 1, 2, 0, 2, 3)), uvs=uvs, texture=pixels, compute_inertia=False)
    builder = newton.ModelBuilder()
    builder.add_shape_mesh(-1, mesh=mesh, color=(1.0, 1.0, 1.0))
    seen = scenes.look(wc.from_newton(*finalize(builder, device)), above(3.0, outputs=("albedo",)))["albedo"][0]
    assert seen[24, 24].tolist() == list(value[:3] if channels > 1 else value[:1] * 3)


def test_cloth_hides_what_is_behind_it_from_both_sides(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_cloth_grid(
        pos=wp.vec3(-0.5, -0.5, 1.0), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=4, dim_y=4, cell_x=0.25, cell_y=0.25,
        mass=0.1,
    )  # fmt: skip
    builder.add_shape_sphere(-1, radius=0.2, xform=pose(0.0, 0.0, 0.5))
    builder.add_shape_sphere(-1, radius=0.2, xform=pose(0.0, 0.0, 1.5))
    scene = wc.from_newton(*finalize(builder, device))
    for camera, ball in ((above(4.0), 1), (above(-2.0, rotation=(0.0, 1.0, 0.0, 0.0)), 0)):
        seen = scenes.look(scene, camera)
        assert set(np.unique(seen["segmentation"])) == {-1, -3, ball}
        up = 1.0 if camera.position[2] > 0.0 else -1.0
        assert seen["normals"][seen["segmentation"] == -3][:, 2] == pytest.approx(up)
