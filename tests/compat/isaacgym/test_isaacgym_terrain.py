"""Isaac Gym's terrains: heights are where triangles of the same samples are, and things rest on them."""

import itertools
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
from gym_worlds import GYM, at, new_sim, props, tensors_of  # noqa: E402, newton may be missing

from warpcam.compat.isaacgym import gymapi, gymtorch  # noqa: E402
from warpcam.compat.isaacgym.terrain.heightfield_from_mesh import _cover, heights_of, is_convex, seen_from_above  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
ALONG_X, ALONG_Y, STEP_X, STEP_Y, RISE = 12, 7, 0.25, 0.4, 0.005
SAMPLES = np.random.default_rng(5).integers(-80, 80, (ALONG_X, ALONG_Y)).astype(np.int16)

EYE, TARGET = np.array((-0.7, 0.6, 2.4)), np.array((0.1, 0.8, 0.0))


def triangles_of(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles, as programs of the field make them of samples by x and y."""
    count_x, count_y = samples.shape
    x, y = np.meshgrid(np.arange(count_x) * STEP_X, np.arange(count_y) * STEP_Y, indexing="ij")
    vertices = np.stack((x, y, samples * RISE), axis=-1).reshape(-1, 3).astype(np.float32)
    first = (np.arange(count_x - 1)[:, None] * count_y + np.arange(count_y - 1)).reshape(-1)
    pairs = [np.stack((first, first + count_y + 1, first + 1)), np.stack((first, first + count_y, first + count_y + 1))]
    return vertices, np.concatenate(pairs, axis=1).T.astype(np.uint32)


def described(by_row: bool = False) -> gymapi.HeightFieldParams:
    """Columns along x, or rows."""
    params = gymapi.HeightFieldParams()
    params.nbColumns, params.nbRows = (ALONG_Y, ALONG_X) if by_row else (ALONG_X, ALONG_Y)
    params.column_scale, params.row_scale = (STEP_Y, STEP_X) if by_row else (STEP_X, STEP_Y)
    params.vertical_scale, params.segmentation_id = RISE, 9
    return params


def placed(params: Any) -> Any:
    params.transform = gymapi.Transform(
        gymapi.Vec3(-1.0, -0.5, 0.3), gymapi.Quat.from_axis_angle(gymapi.Vec3(0.2, 0.1, 1.0), 0.6)
    )
    return params


def seen(device: wp.Device, add: Callable[[gymapi.Sim], Any]) -> dict[Any, np.ndarray]:
    """From above and aslant."""
    sim = new_sim(device)
    add(sim)
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, GYM.create_sphere(sim, 0.1), at(0, 0, 1.2), "ball", 0, 0, 3)
    camera = GYM.create_camera_sensor(env, props(width=48, height=40))
    GYM.set_camera_location(camera, env, gymapi.Vec3(*EYE), gymapi.Vec3(*TARGET))
    images = tensors_of(sim, env, camera)
    GYM.render_all_camera_sensors(sim)
    return {kind: image.cpu().numpy() for kind, image in images.items()}


LAYOUTS = {
    "by x and y": (SAMPLES, False),
    "one after the other": (SAMPLES.flatten(), False),
    "transposed view": (SAMPLES.T, False),
    "rows along x": (SAMPLES, True),
}


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_heights_are_seen_where_their_triangles_are(device: wp.Device, layout: str) -> None:
    samples, by_row = LAYOUTS[layout]
    mesh = placed(gymapi.TriangleMeshParams(segmentation_id=9))
    vertices, triangles = triangles_of(SAMPLES)
    expected = seen(device, lambda sim: GYM.add_triangle_mesh(sim, vertices.flatten(), triangles.flatten(), mesh))
    images = seen(device, lambda sim: GYM.add_heightfield(sim, samples, placed(described(by_row))))
    depth, other = images[gymapi.IMAGE_DEPTH], expected[gymapi.IMAGE_DEPTH]
    assert 0.3 < np.isfinite(depth).mean() < 0.95 and np.ptp(depth[np.isfinite(depth)]) > 1.0
    # A pixel or two of the rim may fall to either side.
    assert (np.isfinite(depth) != np.isfinite(other)).sum() <= 3
    both = np.isfinite(depth) & np.isfinite(other)
    assert (np.abs(depth[both] - other[both]) > 1e-4).sum() <= 3
    assert (images[gymapi.IMAGE_SEGMENTATION] != expected[gymapi.IMAGE_SEGMENTATION]).sum() <= 3
    assert set(np.unique(images[gymapi.IMAGE_SEGMENTATION])) == {0, 3, 9}


@pytest.mark.parametrize("made_of", ["heights", "triangles"])
@pytest.mark.parametrize("count", [1, 2], ids=["MuJoCo", "MuJoCo-Warp"])
def test_a_ball_rests_in_a_ditch(device: wp.Device, count: int, made_of: str) -> None:
    """The ball lies in a ditch that the hull of the terrain would close."""
    sim = new_sim(device, dt=0.01, substeps=2)
    if made_of == "heights":
        samples = np.repeat(100 * np.abs(np.arange(9) - 4), 6).astype(np.int16)  # along y, its sides rise by 1
        params = gymapi.HeightFieldParams(row_scale=0.5, column_scale=0.5, vertical_scale=0.005, nbRows=6, nbColumns=9)
    else:
        params = gymapi.TriangleMeshParams()
    params.transform.p, params.dynamic_friction = gymapi.Vec3(-1.0, -1.0, 0.25), 0.125
    if made_of == "heights":
        GYM.add_heightfield(sim, samples, params)
    else:
        vertices, triangles = triangles_of(np.repeat(50 * np.abs(np.arange(17) - 8)[:, None], 7, axis=1))
        GYM.add_triangle_mesh(sim, vertices, triangles, params)
    ball = GYM.create_sphere(sim, 0.2)
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
        GYM.create_actor(env, ball, at(1.2, 0.3, 1.0), "ball", index, 0, 3)
    GYM.prepare_sim(sim)
    roots = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(sim))
    for _ in range(100):
        GYM.simulate(sim)
    GYM.refresh_actor_root_state_tensor(sim)
    resting = (1.0, 0.25 + 0.2 * 2.0**0.5)  # it may roll along the ditch
    np.testing.assert_allclose(roots[:, [0, 2]].cpu(), [resting] * count, atol=0.02)
    assert 0.125 in sim.physics.model.shape_material_mu.numpy()


def upright(samples: np.ndarray, threshold: int) -> tuple[np.ndarray, np.ndarray]:
    """Build upright walls as legged_gym has them: vertices below and above a steep slope stand over one another."""
    vertices, triangles = triangles_of(samples)
    steep_x, steep_y = (np.diff(samples.astype(int), axis=axis) for axis in range(2))
    move_x, move_y, corner = (np.zeros(samples.shape, int) for _ in range(3))
    move_x[:-1] += steep_x > threshold
    move_x[1:] -= -steep_x > threshold
    move_y[:, :-1] += steep_y > threshold
    move_y[:, 1:] -= -steep_y > threshold
    steep = samples[1:, 1:].astype(int) - samples[:-1, :-1]
    corner[:-1, :-1] += steep > threshold
    corner[1:, 1:] -= -steep > threshold
    vertices[:, 0] += ((move_x + corner * (move_x == 0)) * STEP_X).reshape(-1)
    vertices[:, 1] += ((move_y + corner * (move_y == 0)) * STEP_Y).reshape(-1)
    return vertices, triangles


@pytest.mark.parametrize("walls", [False, True])
def test_what_collides_can_be_seen(device: wp.Device, walls: bool) -> None:
    """Triangles on a grid show the surface of their heights, except for upright walls, which are slopes of a step."""
    block = np.zeros(SAMPLES.shape, int)
    block[5:9, 2:5] = 160
    vertices, triangles = upright(block, 100) if walls else triangles_of(SAMPLES)
    sim = new_sim(device)
    GYM.add_triangle_mesh(sim, vertices, triangles, placed(gymapi.TriangleMeshParams(segmentation_id=9)))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, GYM.create_sphere(sim, 0.1), at(0, 0, 1.2), "ball", 0, 0, 3)
    images = []
    for collides in (False, True):
        camera = GYM.create_camera_sensor(env, props(use_collision_geometry=collides))
        GYM.set_camera_location(camera, env, gymapi.Vec3(*EYE), gymapi.Vec3(*TARGET))
        images.append(tensors_of(sim, env, camera))
    GYM.render_all_camera_sensors(sim)
    seen, felt = (image[gymapi.IMAGE_DEPTH].cpu().numpy() for image in images)
    both = np.isfinite(seen) & np.isfinite(felt)
    apart = (np.abs(seen[both] - felt[both]) > 1e-4).sum()
    assert both.mean() > 0.3 and (apart > 20 if walls else apart <= 3)
    if not walls:
        assert (images[0][gymapi.IMAGE_SEGMENTATION] != images[1][gymapi.IMAGE_SEGMENTATION]).sum() <= 3


def test_heights_are_found_in_triangles() -> None:
    samples = np.zeros((20, 16), int)
    samples[4:9, 3:8], samples[12:17, 5:14], samples[14:16, 7:9] = 60, -40, 80
    samples += np.random.default_rng(3).integers(-3, 3, samples.shape)
    for exact, (vertices, triangles) in ((True, triangles_of(samples)), (False, upright(samples, 20))):
        found = heights_of(vertices, triangles)
        assert found is not None
        heights, first, steps = found
        np.testing.assert_allclose(first, 0.0, atol=1e-6)
        np.testing.assert_allclose(steps, (STEP_X, STEP_Y), rtol=1e-6)
        # Where a vertex was moved away it is between its neighbours on this side of the wall.
        np.testing.assert_allclose(heights / RISE, samples, atol=1e-3 if exact else 6.0)
    assert len(np.unique(upright(samples, 20)[0][:, :2], axis=0)) < samples.size


def test_heights_are_found_far_from_the_first_ones() -> None:
    """Steps of single precision differ, so that one of them does not tell how many there are."""
    samples = np.zeros((12, 4000), int)
    samples[3:7, 2000:2003] = 60
    found = heights_of(*upright(samples, 20))
    assert found is not None and found[0].shape == samples.shape
    np.testing.assert_allclose(found[0] / RISE, samples, atol=1e-3)


def test_a_vertex_may_have_left_the_rim() -> None:
    samples = np.zeros((7, 6), int)
    samples[3, 1] = samples[5, 4] = 60
    vertices, triangles = upright(samples, 20)
    assert not np.isclose(vertices[3 * 6, :2], (3 * STEP_X, 0.0)).all()
    found = heights_of(vertices, triangles)
    assert found is not None
    np.testing.assert_allclose(found[0][[3, 6, 5], [0, 4, 5]], 0.0)
    assert found[0][3, 1] == found[0][5, 4] == np.float32(60 * RISE)


def bent(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices that stand on no grid."""
    vertices, triangles = triangles_of(samples)
    vertices[5, 0] += 0.3 * STEP_X
    return vertices, triangles


def test_triangles_that_are_no_grid_are_collided_with_as_seen_from_above(device: wp.Device) -> None:
    """Large ones and small ones, and a hole."""
    tall = np.array([(0.0, 0.0), (0.5, 0.0), (0.5, 0.3), (1.0, 0.3), (1.0, 0.0), (3.0, 0.0), (3.0, 0.0), (3.2, 0.2)])
    points = np.array([(x, y, z) for x, z in tall for y in (0.0, 2.0)], np.float32)
    first = 2 * np.array([0, 1, 2, 3, 4, 6])[:, None]
    faces = np.concatenate([first + np.array((0, 2, 1)), first + np.array((1, 2, 3))])
    sim = new_sim(device, dt=0.01)
    with pytest.warns(
        RuntimeWarning, match="no grid along x and y, so that MuJoCo collides with heights .* from above"
    ):
        GYM.add_triangle_mesh(sim, points, faces, gymapi.TriangleMeshParams())
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    ball = GYM.create_sphere(sim, 0.1)
    for x in (0.75, 2.0):  # the hull would hold both up, at 0.4 and at 0.3
        GYM.create_actor(env, ball, at(x, 1.0, 0.6), "ball", 0, 0, 3)
    GYM.prepare_sim(sim)
    roots = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(sim))
    for _ in range(150):
        GYM.simulate(sim)
    GYM.refresh_actor_root_state_tensor(sim)
    np.testing.assert_allclose(roots[:, 2].cpu(), (0.4, 0.1), atol=0.01)


def test_heights_seen_from_above_are_those_of_the_highest_triangles() -> None:
    rng = np.random.default_rng(2)
    points, faces = bent(rng.integers(-80, 80, (30, 20)))
    # A large triangle across, above some of them.
    points = np.concatenate((points, np.array([(0.3, 0.2, 0.1), (5.0, 1.0, 0.1), (2.0, 6.5, 0.1)], np.float32)))
    faces = np.concatenate((faces, [np.arange(len(points) - 3, len(points))])).astype(np.int64)
    assert heights_of(points, faces) is None
    heights, first, steps = seen_from_above(points, faces)
    mesh = trimesh.Trimesh(points, faces, process=False)
    x, y = (rng.integers(1, count - 1, 200) for count in heights.shape)
    above = np.stack((first[0] + x * steps[0], first[1] + y * steps[1], np.full(200, 5.0)), axis=1)
    hits, rays, _ = mesh.ray.intersects_location(above + 1e-7, np.tile((0.0, 0.0, -1.0), (200, 1)), multiple_hits=True)
    highest = np.full(200, -np.inf)
    np.maximum.at(highest, rays, hits[:, 2])
    np.testing.assert_allclose(heights[x, y], highest, atol=1e-5)
    assert (np.abs(highest - 0.1) < 1e-6).sum() > 20


def test_upright_triangles_are_no_taller_than_they_are() -> None:
    """Rounding alone decides where in its triangles a wall lies that crosses places."""
    rng = np.random.default_rng(0)
    for wide in rng.uniform(0.05, 0.4, 20):
        along = rng.integers(0, 100, 600) * np.float32(0.05)
        heights = np.full((60, 60), -np.inf)
        places = np.stack((along / wide, along / (3.0 * wide)), axis=1)
        _cover(heights, places, rng.uniform(0.0, 1.0, 600), np.arange(600).reshape(-1, 3))
        assert heights.max() <= 1.0


def test_places_on_a_long_terrain_are_as_near_as_on_a_short_one() -> None:
    count = 12000
    x = np.repeat(np.arange(count) * 0.1, 2)
    strip = np.stack((x, np.tile((0.0, 0.1), count), np.zeros(2 * count)), axis=1).astype(np.float32)
    strip[5, 0] += 0.03
    first = 2 * np.arange(count - 1)[:, None]
    _, _, steps = seen_from_above(strip, np.concatenate((first + np.array((0, 3, 1)), first + np.array((0, 2, 3)))))
    np.testing.assert_allclose(steps, 0.1, atol=0.01)


def test_what_is_convex_is_collided_with_as_it_is() -> None:
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    corners[1::2, 0] += 0.2
    sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    faces = np.array([(a, b, c) for a, *rest in sides for b, c in itertools.pairwise(rest)])
    assert is_convex(corners, faces) and is_convex(corners[faces].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert not is_convex(*bent(SAMPLES)) and not is_convex(corners[:3], faces[:0])
    assert not is_convex(corners, faces[:-2])  # a box without a lid: the hull would close it
    dented = corners.copy()
    dented[0] = 0.6
    assert not is_convex(dented, faces)
    for points, triangles, upright in ((corners, faces, False), (corners[[0, 1, 2]] * (0, 1, 1), [(0, 1, 2)], True)):
        sim = new_sim(wp.get_device("cpu"))
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            GYM.add_triangle_mesh(sim, points, np.asarray(triangles), gymapi.TriangleMeshParams())
        assert sim.grounds.terrains[0].felt is sim.grounds.terrains[0].seen
        assert any("the triangles are all upright" in str(each.message) for each in told) == upright


def test_where_y_is_up_terrains_are_collided_with_as_their_hull() -> None:
    sim = new_sim(wp.get_device("cpu"), up=gymapi.UP_AXIS_Y)
    with pytest.warns(RuntimeWarning, match="add_triangle_mesh: z is not up, so that MuJoCo collides with the convex"):
        GYM.add_triangle_mesh(sim, *triangles_of(SAMPLES), gymapi.TriangleMeshParams())


def test_level_heights_are_level(device: wp.Device) -> None:
    params = described()
    params.transform.p.x = -1.5
    images = seen(device, lambda sim: GYM.add_heightfield(sim, np.full((ALONG_X, ALONG_Y), 40, np.int16), params))
    away = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    assert images[gymapi.IMAGE_SEGMENTATION][20, 24] == 9  # beside the middle by half a pixel
    assert images[gymapi.IMAGE_DEPTH][20, 24] == pytest.approx((EYE[2] - 0.2) / away[2], abs=0.03)


def test_what_no_terrain_can_be_made_of_is_named() -> None:
    sim = new_sim(wp.get_device("cpu"))
    lying = new_sim(wp.get_device("cpu"), up=gymapi.UP_AXIS_Y)
    bare, thin, flat = described(), described(), described()
    bare.nbRows, thin.row_scale, flat.vertical_scale = 1, float("nan"), 0.0
    mistakes: list[tuple[Callable[[], Any], str]] = [
        (lambda: GYM.add_heightfield(lying, SAMPLES, described()), "z must be up"),
        (lambda: GYM.add_heightfield(sim, SAMPLES, gymapi.TriangleMeshParams()), "HeightFieldParams are needed"),
        (lambda: GYM.add_heightfield(sim, SAMPLES, bare), "nbRows must be a whole number, at least 2, got 1"),
        (lambda: GYM.add_heightfield(sim, SAMPLES, thin), "row_scale must be positive and finite, got nan"),
        (lambda: GYM.add_heightfield(sim, SAMPLES, flat), "vertical_scale must be positive and finite, got 0.0"),
        (lambda: GYM.add_heightfield(sim, SAMPLES * 0.1, described()), "whole numbers, int16, got float64"),
        (lambda: GYM.add_heightfield(sim, SAMPLES[1:], described()), r"12 columns of 7 rows .* shape \(11, 7\)"),
        (lambda: GYM.add_heightfield(sim, SAMPLES.flatten()[1:], described()), r"of shape \(83,\)"),
    ]
    for call, message in mistakes:
        with pytest.raises(wc.WarpcamError, match=f"add_heightfield: .*{message}"):
            call()
    vertices, triangles = triangles_of(SAMPLES)
    nowhere = vertices.copy()
    nowhere[5, 2] = np.nan
    for points in (nowhere, vertices.flatten()[:-1]):
        with pytest.raises(wc.WarpcamError, match="add_triangle_mesh: vertices must be three finite numbers each"):
            GYM.add_triangle_mesh(sim, points, triangles, gymapi.TriangleMeshParams())
    with pytest.raises(wc.WarpcamError, match="add_triangle_mesh: TriangleMeshParams are needed, got HeightField"):
        GYM.add_triangle_mesh(sim, *triangles_of(SAMPLES), described())
    GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.prepare_sim(sim)
    with pytest.raises(wc.WarpcamError, match="add_heightfield: the simulation is prepared already"):
        GYM.add_heightfield(sim, SAMPLES, described())
