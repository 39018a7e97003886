"""Cloth, soft bodies and particles of Newton."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
import newton_scenes  # noqa: E402, newton may be missing
from newton_scenes import eye, finalize, pose  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

CLOTH = 13 * 13  # particles of the cloth
CLOTH_TRIANGLES = 2 * 12 * 12
SOFT, PARTICLE = -3, -2


def two_worlds(device: wp.Device) -> tuple:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.cloth(), 2)
    builder.add_ground_plane()
    return finalize(builder, device)


def waved(state: "newton.State", world: int, size: float) -> "newton.State":
    """The cloth of one world bent."""
    points = state.particle_q.numpy()
    start = world * (len(points) // 2)
    cloth = points[start : start + CLOTH]
    cloth[:, 2] += size * np.sin(5.0 * cloth[:, 0]) * np.cos(4.0 * cloth[:, 1])
    state.particle_q.assign(points)
    return state


def as_meshes(model: "newton.Model", state: "newton.State", device: wp.Device) -> wc.Scene:
    """Build meshes that never move, seen from both sides, and spheres."""
    points, faces = state.particle_q.numpy(), model.tri_indices.numpy().reshape(-1, 3)
    worlds, bound = model.particle_world.numpy(), np.unique(model.tri_indices.numpy())
    inside = np.unique(model.tet_indices.numpy())
    builder = newton.ModelBuilder()
    for world in range(model.world_count):
        builder.begin_world()
        own = faces[worlds[faces[:, 0]] == world]
        corners = np.concatenate((own, own[:, ::-1])).ravel().astype(np.int32)
        builder.add_shape_mesh(-1, mesh=newton.Mesh(points, corners, compute_inertia=False))
        for particle in np.flatnonzero(worlds == world):
            if particle not in bound and particle not in inside and model.particle_flags.numpy()[particle] & 1:
                builder.add_shape_sphere(-1, radius=0.12, xform=pose(*(float(x) for x in points[particle])))
        builder.end_world()
    builder.add_ground_plane()
    return wc.from_newton(*finalize(builder, device))


VIEWS = {"above": (0.0, -3.0, 3.0), "below": (0.0, -3.0, 0.5), "side": (3.0, 0.3, 1.4)}


@pytest.mark.parametrize("view", VIEWS)
def test_soft_things_are_seen_where_their_particles_are(device: wp.Device, view: str) -> None:
    model, state = two_worlds(device)
    position = VIEWS[view]
    camera = eye(
        outputs=("depth", "segmentation", "normals", "rgb"), position=position, shadows=True,
        rotation=scenes.looking(position, (0.0, 0.0, 0.9)),
    )  # fmt: skip
    renderer = wc.Renderer(wc.from_newton(model, state), [camera])
    flat = scenes.on_host(renderer.render()["eye"])
    assert set(np.unique(flat["segmentation"])) >= {SOFT, PARTICLE, 0}
    waved(state, 1, 0.3)
    seen = scenes.on_host(renderer.render()["eye"])
    assert (seen["depth"][0] == flat["depth"][0]).all() and (seen["depth"][1] != flat["depth"][1]).any()
    expected = scenes.look(as_meshes(model, state, device), camera)
    close = np.abs(seen["depth"] - expected["depth"]) <= 1e-4
    assert (close | (seen["depth"] == expected["depth"])).mean() > 0.999
    assert (np.abs(seen["normals"] - expected["normals"]).max(axis=-1) < 1e-3).mean() > 0.998
    loose = seen["segmentation"] == PARTICLE
    assert (loose == np.isin(expected["segmentation"], (1, 2, 4, 5))).mean() > 0.999


def test_the_boxes_of_the_tree_hold_what_moves(device: wp.Device) -> None:
    model, state = two_worlds(device)
    scene = wc.from_newton(model, state)
    random = np.random.default_rng(0)
    points = state.particle_q.numpy()
    state.particle_q.assign((points + random.normal(0.0, 2.0, points.shape)).astype(np.float32))
    low, high = scene.bounds()
    bound = np.unique(model.tri_indices.numpy())
    points = state.particle_q.numpy()
    loose = points[np.setdiff1d(np.arange(len(points)), np.r_[bound, np.unique(model.tet_indices.numpy())])]
    loose = loose[[0, 1, 3, 4]]  # the third and the sixth are inactive
    everything = np.concatenate((points[bound], loose - 0.12, loose + 0.12))
    assert low == pytest.approx(everything.min(axis=0), abs=1e-5)
    assert high == pytest.approx(everything.max(axis=0), abs=1e-5)


def test_two_states_are_swapped(device: wp.Device) -> None:
    model, first = two_worlds(device)
    second = waved(model.state(), 0, 0.4)
    scene = wc.from_newton(model, first)
    renderer = wc.Renderer(scene, [eye()])
    flat = scenes.on_host(renderer.render()["eye"])["depth"]
    for _ in range(2):
        scene.bind(second)
        assert (scenes.on_host(renderer.render()["eye"])["depth"] != flat).any()
        scene.bind(first)
        assert (scenes.on_host(renderer.render()["eye"])["depth"] == flat).all()
    assert len(renderer._recordings) == 2


def test_a_particle_that_is_no_number_takes_its_triangles_along(device: wp.Device) -> None:
    model, state = two_worlds(device)
    outputs = ("depth", "segmentation", "normals", "rgb")
    above = {"position": (0.0, 0.0, 4.0), "rotation": (1.0, 0.0, 0.0, 0.0), "lens": wc.Pinhole(fovy=24.0)}
    renderer = wc.Renderer(wc.from_newton(model, state), [eye(width=96, height=96, outputs=outputs, **above)])
    images = renderer.render()["eye"]
    before = {name: image.clone() for name, image in images.items()}
    points = state.particle_q.numpy().copy()
    broken = points.copy()
    middle = len(points) // 2 + CLOTH // 2
    broken[middle] = np.nan
    state.particle_q.assign(broken)
    renderer.render()
    cloth, was = images["segmentation"][1] == SOFT, before["segmentation"][1] == SOFT
    of_it = (model.tri_indices.numpy() == middle).any(axis=1).sum() / CLOTH_TRIANGLES  # of the cloth's area
    assert float((was & ~cloth).sum()) == pytest.approx(of_it * float(was.sum()), rel=0.15)
    assert not (cloth & ~was).any() and not images["depth"].isnan().any() and not renderer.faulty.any()
    for name, image in images.items():
        assert (image[0] == before[name][0]).all(), name
    state.particle_q.assign(points)
    renderer.render()
    for name, image in images.items():
        assert (image == before[name]).all(), name


def test_particles_and_colours_change_in_place(device: wp.Device) -> None:
    model, state = two_worlds(device)
    camera = eye(outputs=("segmentation", "albedo"))
    renderer = wc.Renderer(wc.from_newton(model, state), [camera])
    before = scenes.on_host(renderer.render()["eye"])
    model.tri_color.fill_(wp.vec3(0.0, 0.0, 1.0))
    scenes.write(model.particle_flags, slice(None), 0)
    after = scenes.on_host(renderer.render()["eye"])
    assert (before["segmentation"] == PARTICLE).any() and not (after["segmentation"] == PARTICLE).any()
    assert (after["albedo"][after["segmentation"] == SOFT] == (0, 0, 255)).all()


def sheet(builder: "newton.ModelBuilder", x: float) -> None:
    """A small cloth in front of the camera."""
    builder.add_cloth_grid(
        pos=wp.vec3(x, -0.6, 1.0), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=4, dim_y=4, cell_x=0.2, cell_y=0.2,
        mass=0.1,
    )  # fmt: skip


def test_a_cloth_of_all_worlds_is_kept_once(device: wp.Device) -> None:
    builder, part = newton.ModelBuilder(), newton.ModelBuilder()
    sheet(builder, -1.2)
    sheet(part, 0.2)
    part.add_shape_sphere(part.add_body(xform=pose(0.0, 0.0, 0.5)), radius=0.2)
    builder.replicate(part, 3)
    scene = wc.from_newton(*finalize(builder, device))
    assert scene.tables().meshes.bounds_min.shape == (1 + 3,)
    seen = scenes.look(scene, eye())
    soft = seen["segmentation"] == SOFT
    assert (soft == soft[0]).all()
    assert soft[:, :, :48].any() and soft[:, :, 48:].any()
    assert [set(np.unique(image)) for image in seen["segmentation"]] == [{-1, SOFT, world} for world in range(3)]


def test_too_many_particles_are_told(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    builder = newton.ModelBuilder()
    for index in range(1025):
        builder.add_particle(wp.vec3(0.001 * index, 0.0, 1.0), wp.vec3(), 0.1, radius=0.01)
    with caplog.at_level("WARNING", logger="warpcam"):
        scene = wc.from_newton(*finalize(builder, device))
    assert "particles are not drawn: a world has 1025, at most 1024 are" in caplog.text
    assert scene.tables().num_drawn == 0


def test_a_state_with_other_particles_is_refused(device: wp.Device) -> None:
    model, state = two_worlds(device)
    other = finalize(newton_scenes.cloth(), device)[1]
    with pytest.raises(wc.WarpcamError, match="state was made from another model: it has 236 particles, model has 472"):
        wc.from_newton(model, state).bind(other)


@pytest.mark.parametrize("index", [-1, 500])
def test_triangles_of_no_particles_are_refused(device: wp.Device, index: int) -> None:
    model, state = finalize(newton_scenes.cloth(), device)
    scenes.write(model.tri_indices, (0, 1), index)
    with pytest.raises(wc.WarpcamError, match=r"model\.tri_indices: must be from 0 to 235, got .* to"):
        wc.from_newton(model, state)


def test_an_opened_cloth_looks_as_one_that_was_made_open(device: wp.Device) -> None:
    """Its tree is in another order by then: the image is the same, frame after frame."""

    def one() -> tuple:
        builder = newton.ModelBuilder()
        builder.add_cloth_grid(
            pos=wp.vec3(-1.0, -1.0, 1.0), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=20, dim_y=20, cell_x=0.1,
            cell_y=0.1, mass=0.1,
        )  # fmt: skip
        return finalize(builder, device)

    model, state = one()
    camera = eye(
        outputs=("depth", "normals"), position=(0.0, -3.0, 3.0), rotation=scenes.looking((0, -3, 3), (0, 0, 1))
    )
    expected = scenes.look(wc.from_newton(model, state), camera)
    flat = state.particle_q.numpy()
    model.particle_q.assign(np.random.default_rng(0).normal(0.0, 1.0, flat.shape).astype(np.float32))
    state = model.state()
    scene = wc.from_newton(model, state)
    renderer = wc.Renderer(scene, [camera])
    for _ in range(32):
        renderer.render()
    order = scene._source._trees[0]._moving.order.numpy().copy()
    state.particle_q.assign(flat)
    for frame in range(36):
        seen = scenes.on_host(renderer.render()["eye"])
        close = np.isclose(seen["depth"], expected["depth"], rtol=1e-6)
        assert (close | (seen["depth"] == expected["depth"])).all(), frame
        assert (np.abs(seen["normals"] - expected["normals"]).max(axis=-1) < 1e-5).mean() > 0.999
    assert (scene._source._trees[0]._moving.order.numpy() != order).any()


def test_swapping_states_builds_and_allocates_nothing(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    model, first = two_worlds(device)
    second = waved(model.state(), 0, 0.4)
    scene = wc.from_newton(model, first)
    renderer = wc.Renderer(
        scene,
        [eye(), replace(eye(outputs=("rgb",), shadows=True), name="other")],
    )
    for state in (first, second):
        scene.bind(state)
        renderer.render()

    counts = dict.fromkeys(("trees", "bound", "arrays"), 0)

    def count(owner: object, name: str, what: str) -> None:
        plain = getattr(owner, name)

        def counted(*args: object, **options: object) -> object:
            counts[what] += 1
            return plain(*args, **options)

        monkeypatch.setattr(owner, name, counted)

    from warpcam.kernels.runtime import launch
    from warpcam.kernels.update import refit

    count(refit.DeformingTree, "__init__", "trees")
    count(launch.Stage, "prepare", "bound")
    for name in ("empty", "zeros", "full", "clone"):
        count(wp, name, "arrays")
    for _ in range(3):
        for state in (first, second):
            scene.bind(state)
            renderer.render()
    assert counts == {"trees": 0, "bound": 0, "arrays": 0}
    assert len(renderer._recordings) == 2


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_shadows_fall_on_the_side_that_is_seen(device: wp.Device, side: float) -> None:
    """On either side of a cloth as on that of a mesh whose faces stand there twice."""
    builder = newton.ModelBuilder()
    builder.add_cloth_grid(
        pos=wp.vec3(-1.0, -1.0, 1.0), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=6, dim_y=6, cell_x=0.33,
        cell_y=0.33, mass=0.1,
    )  # fmt: skip
    ball = newton.Mesh.create_sphere(0.3, num_latitudes=12, num_longitudes=12, compute_inertia=False)
    builder.add_shape_mesh(-1, mesh=ball, xform=pose(0.0, 0.0, 1.0 + 0.7 * side))
    model, state = finalize(builder, device)
    light = wc.Light(kind="directional", direction=(0.3, 0.2, -side), color=(0.6, 0.6, 0.6))
    position = (0.0, -2.0, 1.0 + 2.0 * side)
    camera = eye(outputs=("rgb",), shadows=True, position=position, rotation=scenes.looking(position, (0.0, 0.0, 1.0)))
    lit = scenes.look(wc.from_newton(model, state, lights=[light]), replace(camera, shadows=False))["rgb"]
    seen = scenes.look(wc.from_newton(model, state, lights=[light]), camera)["rgb"]
    dark = (lit.astype(int) - seen).max(axis=-1) > 20
    points, faces = state.particle_q.numpy(), model.tri_indices.numpy().reshape(-1, 3)
    builder = newton.ModelBuilder()
    corners = np.concatenate((faces, faces[:, ::-1])).ravel().astype(np.int32)
    builder.add_shape_mesh(-1, mesh=newton.Mesh(points, corners, compute_inertia=False))
    builder.add_shape_mesh(-1, mesh=ball, xform=pose(0.0, 0.0, 1.0 + 0.7 * side))
    twice = wc.from_newton(*finalize(builder, device), lights=[light])
    expected = scenes.look(twice, replace(camera, shadows=False))["rgb"].astype(int) - scenes.look(twice, camera)["rgb"]
    assert dark.sum() > 0.01 * dark.size
    assert ((expected.max(axis=-1) > 20) == dark).mean() > 0.998


def test_many_surfaces_of_one_world_keep_their_opacity(device: wp.Device) -> None:
    """40 squares in each world, every third one hidden, others of which are so in the second world."""
    builder, tints = newton.ModelBuilder(), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for world in range(2):
        builder.begin_world()
        for square in range(40):
            x, z = -1.4 + 0.4 * (square % 8), 0.2 + 0.35 * (square // 8)
            corners = [
                builder.add_particle(wp.vec3(x + dx, 0.0, z + dz), wp.vec3(), 0.1)
                for dx, dz in ((0.0, 0.0), (0.3, 0.0), (0.0, 0.25), (0.3, 0.25))
            ]
            looks = {"color": tints[square % 3], "opacity": 0.0 if (square + world) % 3 == 0 else 1.0}
            for triangle in (corners[:3], corners[:0:-1]):
                builder.add_triangle(*triangle, **looks)
        builder.end_world()
    model, state = finalize(builder, device)
    seen = scenes.look(wc.from_newton(model, state), eye(outputs=("albedo", "segmentation")))
    for world, hidden in enumerate((0, 2)):
        shown = seen["albedo"][world][seen["segmentation"][world] == SOFT]
        assert len(shown) > 500
        assert set(np.unique(shown.argmax(axis=-1))) == {0, 1, 2} - {hidden}


def test_a_graph_of_ones_own_refits_what_moves(device: wp.Device) -> None:
    model, state = two_worlds(device)
    camera = eye(outputs=("depth", "rgb"), position=(0.0, -3.0, 3.0), rotation=scenes.looking((0, -3, 3), (0, 0, 1)))
    renderer = wc.Renderer(wc.from_newton(model, state), [camera])
    before = scenes.on_host(renderer.render()["eye"])
    with wp.ScopedCapture(device) as capture:
        renderer.render()
    waved(state, 1, 0.3)
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    after = scenes.on_host(renderer.images["eye"])
    assert (after["depth"][1] != before["depth"][1]).any()
    fresh = scenes.look(wc.from_newton(model, state), camera)
    assert all((after[name] == fresh[name]).all() for name in after)
