"""Newton's deformable visual meshes, against where Newton says that their points are."""

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
from newton_scenes import eye, finalize, pose  # noqa: E402, newton may be missing

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

SOFT = -3
VIEW = {"position": (0.0, -2.5, 2.5), "rotation": scenes.looking((0.0, -2.5, 2.5), (0.0, 0.0, 1.0))}


def fine_sheet(cells: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices and texture coordinates on the unit square, and triangles."""
    x, y = np.meshgrid(*2 * (np.linspace(0.0, 1.0, cells + 1),), indexing="ij")
    uvs = np.stack((x.ravel(), y.ravel()), axis=1).astype(np.float32)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate((np.stack((a, b, c), axis=1), np.stack((a, c, d), axis=1)))
    return np.column_stack((uvs, np.zeros(len(uvs)))).astype(np.float32), uvs, faces


def cloth(builder: "newton.ModelBuilder") -> tuple[int, int]:
    builder.add_cloth_grid(
        pos=wp.vec3(-0.8, -0.8, 1.0), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=4, dim_y=4, cell_x=0.4, cell_y=0.4,
        mass=0.1,
    )  # fmt: skip
    return 0, builder.tri_count


def dressed(kind: str) -> "newton.ModelBuilder":
    builder = newton.ModelBuilder()
    sheet, uvs, faces = fine_sheet()
    texture = np.zeros((8, 8, 3), np.uint8)
    texture[:4], texture[4:] = (255, 0, 0), (0, 0, 255)
    if kind == "triangle":
        triangles = cloth(builder)
        vertices = 1.5 * sheet + (-0.75, -0.75, 1.0)
        builder.add_deformable_visual_mesh(
            vertices, faces.ravel(), kind="triangle", tri_range=triangles, uvs=uvs, texture=texture
        )
    elif kind == "particle":
        cloth(builder)
        builder.add_deformable_visual_mesh(
            np.asarray(builder.particle_q), np.asarray(builder.tri_indices).ravel(), kind="particle",
            parent=np.arange(builder.particle_count),
        )  # fmt: skip
    elif kind == "tetrahedron":
        builder.add_soft_grid(
            pos=wp.vec3(-0.6, -0.6, 0.6), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=3, dim_y=3, dim_z=2, cell_x=0.4,
            cell_y=0.4, cell_z=0.4, density=100.0, k_mu=1e3, k_lambda=1e3, k_damp=0.0,
        )  # fmt: skip
        ball = newton.Mesh.create_sphere(0.35, num_latitudes=12, num_longitudes=12, compute_inertia=False)
        builder.add_deformable_visual_mesh(
            np.add(ball.vertices, (0.0, 0.0, 1.0)), np.asarray(ball.indices), kind="tetrahedron",
            tet_range=(0, builder.tet_count),
        )  # fmt: skip
    else:
        bodies = [builder.add_body(xform=pose(x, 0.0, 1.0), mass=1.0) for x in (-0.5, 0.5)]
        builder.add_deformable_visual_mesh(
            1.5 * sheet + (-0.75, -0.75, 1.0), faces.ravel(), kind="body", bodies=bodies
        )  # fmt: skip
    return builder


def disturbed(model: "newton.Model", state: "newton.State", seed: int = 0) -> "newton.State":
    random = np.random.default_rng(seed)
    if model.particle_count:
        points = state.particle_q.numpy()
        state.particle_q.assign(points + random.normal(0.0, 0.08, points.shape).astype(np.float32))
    if model.body_count:
        poses = state.body_q.numpy()
        poses[:, :3] += random.normal(0.0, 0.1, (len(poses), 3))
        poses[:, 3:] = random.normal(size=(len(poses), 4)) * 0.1 + (0.0, 0.0, 0.0, 1.0)
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        state.body_q.assign(poses.astype(np.float32))
    return state


def as_mesh(model: "newton.Model", state: "newton.State", world: int, device: wp.Device) -> wc.Scene:
    """One world's visual mesh as a shape that never moves, seen from both sides, its normals Newton's."""
    visuals = newton.geometry.DeformableVisuals(model).update(state)
    mesh = model.deformable_visual_meshes[world]
    points, normals = visuals.get_points(mesh).numpy(), visuals.get_normals(mesh).numpy()
    faces = mesh.indices.numpy().reshape(-1, 3)
    builder = newton.ModelBuilder()
    shape = newton.Mesh(
        np.concatenate((points, points)), np.concatenate((faces, faces[:, ::-1] + len(points))).ravel(),
        normals=np.concatenate((normals, -normals)), compute_inertia=False,
    )  # fmt: skip
    builder.add_shape_mesh(-1, mesh=shape, color=(1.0, 1.0, 1.0))
    return wc.from_newton(*finalize(builder, device))


@pytest.mark.parametrize("kind", ["particle", "triangle", "tetrahedron", "body"])
def test_visual_meshes_are_where_newton_says(device: wp.Device, kind: str) -> None:
    worlds = newton.ModelBuilder()
    worlds.replicate(dressed(kind), 2)
    model, state = finalize(worlds, device)
    camera = eye(outputs=("depth", "segmentation", "rgb"), **VIEW)
    renderer = wc.Renderer(wc.from_newton(model, state), [camera])
    renderer.render()
    disturbed(model, state)
    seen = scenes.on_host(renderer.render()["eye"])
    for world in range(2):
        expected = scenes.look(as_mesh(model, state, world, device), camera)
        hit = np.isfinite(expected["depth"][0])
        assert hit.sum() > 150
        assert ((seen["segmentation"][world] == SOFT) == hit).mean() > 0.999  # and nothing of what it hangs on
        close = np.isclose(seen["depth"][world], expected["depth"][0], atol=1e-4)
        assert close[hit].mean() > 0.998
        if kind != "triangle":  # which has a texture
            off = np.abs(seen["rgb"][world].astype(int) - expected["rgb"][0]).max(axis=-1)
            assert (off[hit] <= 2).mean() > 0.99


def test_a_texture_lies_on_its_coordinates(device: wp.Device) -> None:
    model, state = finalize(dressed("triangle"), device)
    seen = scenes.look(wc.from_newton(model, state), eye(outputs=("albedo", "segmentation", "points"), **VIEW))
    on = seen["segmentation"] == SOFT
    y = seen["points"][..., 1]
    upper, lower = (y > 0.1) & (y < 0.6), (y < -0.1) & (y > -0.6)  # the image repeats at its edges
    assert (seen["albedo"][on & upper] == (255, 0, 0)).mean() > 0.97
    assert (seen["albedo"][on & lower] == (0, 0, 255)).mean() > 0.97


def test_a_missing_texture_is_named(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    model, state = finalize(dressed("triangle"), device)
    model.deformable_visual_meshes[0].texture = "/nowhere/gone.png"
    seen = scenes.look(wc.from_newton(model, state), eye(outputs=("albedo", "segmentation"), **VIEW))
    assert "gone.png" in caplog.text
    assert (seen["albedo"][seen["segmentation"] == SOFT] == 255).all()


def test_one_mesh_hides_only_what_it_hangs_on(device: wp.Device) -> None:
    builder = dressed("triangle")
    builder.add_cloth_grid(
        pos=wp.vec3(-0.3, -0.3, 1.5), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=3, dim_y=3, cell_x=0.2, cell_y=0.2,
        mass=0.1,
    )  # fmt: skip
    model, state = finalize(builder, device)
    colors = np.zeros((model.tri_count, 3), np.float32)
    colors[32:] = (0.0, 1.0, 0.0)
    model.tri_color.assign(colors)
    seen = scenes.look(wc.from_newton(model, state), eye(outputs=("albedo",), **VIEW))["albedo"][0]
    shown = {tuple(color) for color in seen.reshape(-1, 3)}
    assert (0, 255, 0) in shown and (255, 0, 0) in shown


def test_states_are_swapped_under_visual_meshes(device: wp.Device) -> None:
    model, first = finalize(dressed("tetrahedron"), device)
    second = disturbed(model, model.state())
    scene = wc.from_newton(model, first)
    renderer = wc.Renderer(scene, [eye(**VIEW)])
    rest = scenes.on_host(renderer.render()["eye"])["depth"]
    for _ in range(2):
        scene.bind(second)
        assert (scenes.on_host(renderer.render()["eye"])["depth"] != rest).any()
        scene.bind(first)
        assert (scenes.on_host(renderer.render()["eye"])["depth"] == rest).all()


@pytest.mark.parametrize("kind", ["particle", "cloth alone"])
def test_what_is_compiled_while_trees_are_built_is_launched(device: wp.Device, kind: str) -> None:
    builder = newton.ModelBuilder()
    if kind == "cloth alone":
        cloth(builder)
    else:
        builder = dressed(kind)
    scene = wc.from_newton(*finalize(builder, device))
    assert {kernel.module for kernel in scene._source.kernels()} == {stage.module for stage in scene.stages()}
