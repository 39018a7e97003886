"""Shapes of Newton's models: as Newton's own camera, MuJoCo-Warp and closed forms have them, in all worlds."""

from pathlib import Path
from typing import Any

import closed_form
import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
import newton_scenes  # noqa: E402, newton may be missing
from newton_scenes import FOVY, eye, finalize, pose  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own


MODELS = (
    "primitives.xml",
    "humanoid/humanoid.xml",
    "humanoid/n_humanoid.xml",
    "constraints.xml",
    "collision.xml",
    "ray.xml",
    "skybox/checker.xml",
    "hfield/hfield.xml",
    "actuation/slidercrank.xml",
    "convex_collision/box100.xml",
)


def both(file: Path, folder: Path, device: wp.Device) -> tuple[mujoco.MjModel, Any, Any]:
    """Read one file as MuJoCo and as Newton do, each geom named and floors infinite, as Newton has them."""
    spec = mujoco.MjSpec.from_file(str(file))
    spec.compile()
    for index, geom in enumerate(spec.geoms):
        geom.name = f"shape-{index}"
    spec.meshdir = str((file.parent / (spec.meshdir or "")).resolve())
    spec.compile()
    path = folder / "model.xml"
    path.write_text(spec.to_xml())
    mjm = mujoco.MjModel.from_xml_path(str(path))
    mjm.geom_size[mjm.geom_type == mujoco.mjtGeom.mjGEOM_PLANE, :2] = 0.0
    for field in range(mjm.nhfield):  # of which the file's own base is lost
        mjm.hfield_size[field, 3] = 1e-3 * max(1.0, *mjm.hfield_size[field, :3])
    builder = newton.ModelBuilder()
    builder.add_mjcf(str(path))
    model, state = finalize(builder, device)
    newton.eval_fk(model, model.joint_q, model.joint_qd, state)
    return mjm, model, state


@pytest.mark.parametrize("name", MODELS)
def test_same_file_through_mujoco_warp_and_newton(device: wp.Device, name: str, tmp_path: Path) -> None:
    mjm, model, state = both(scenes.MUJOCO_WARP_MODELS / name, tmp_path, device)
    names = {mjm.geom(geom).name: geom for geom in range(mjm.ngeom)}
    geoms = np.array([names.get(label.rsplit("/", 1)[-1], -1) for label in model.shape_label])
    assert sorted(geoms[geoms >= 0]) == list(range(mjm.ngeom))
    # Newton hides what only collides, MuJoCo's sites are no geoms: the same is shown on both sides.
    flags = model.shape_flags.numpy()
    model.shape_flags.assign(np.where(geoms >= 0, flags | 1, flags & ~1).astype(np.int32))
    mjd = scenes.forward(mjm)
    mujoco.mj_resetData(mjm, mjd)
    mujoco.mj_forward(mjm, mjd)
    m, d = scenes.put(mjm, 1, mjd=mjd)
    theirs = wc.from_mujoco_warp(mjm, m, d, groups=scenes.ALL_GROUPS, draw=("geoms", "sites", "tendons"))
    ours = wc.from_newton(model, state)
    low, high = theirs.bounds()
    reach = max(0.5 * float(np.linalg.norm(high - low)), 0.1)
    target = 0.5 * (low + high)
    for direction in ((1.3, -1.1, 0.7), (-0.4, 1.5, 1.2)):
        position = target + reach * np.array(direction)
        camera = eye(position=position, rotation=scenes.looking(position, target))
        expected, seen = scenes.look(theirs, camera), scenes.look(ours, camera)
        ids = np.where(seen["segmentation"] >= 0, geoms[seen["segmentation"]], -1)
        assert (ids >= 0).mean() > 0.02
        same = ids == expected["segmentation"]
        assert same.mean() > 0.999
        hit = same & (ids >= 0)
        assert (np.abs(seen["depth"] - expected["depth"])[hit] <= 2e-5 * (1.0 + expected["depth"][hit])).mean() > 0.999
        assert (np.abs(seen["normals"] - expected["normals"])[same].max(axis=-1) <= 2e-3).mean() > 0.999


def test_every_type_as_newtons_own_camera(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    builder.add_ground_plane(height=-0.5)
    model, state = finalize(builder, device)
    expected = newton_scenes.newtons_own(model, state, eye())
    seen = scenes.look(wc.from_newton(model, state), eye())
    assert set(np.unique(expected["segmentation"])) == {-1, *range(model.shape_count)}
    same = seen["segmentation"] == expected["segmentation"]
    assert same.mean() > 0.998
    hit = same & (seen["segmentation"] >= 0)
    close = np.abs(seen["depth"] - expected["depth"]) <= 2e-4 + 1e-5 * expected["depth"]
    barrels = [shape for shape, label in enumerate(model.shape_label) if label == "barrel"]
    exact = hit & ~np.isin(seen["segmentation"], barrels)  # Newton's own are not exact
    assert close[exact].mean() > 0.999
    assert np.abs(seen["depth"] - expected["depth"])[hit & ~exact].max() < 0.02
    smooth = [shape for shape, label in enumerate(model.shape_label) if label == "mirrored"]
    flat = exact & ~np.isin(seen["segmentation"], smooth)  # its normals are those of its vertices there
    assert (np.sum(seen["normals"] * expected["normals"], axis=-1)[flat] > 0.999).mean() > 0.998


def test_cylinders_of_sites_are_straight(device: wp.Device) -> None:
    """Newton keeps a third size with those of MJCF files that is no barrel's."""
    builder, straight = newton.ModelBuilder(), newton.ModelBuilder()
    builder.add_mjcf(
        '<mujoco><worldbody><site type="cylinder" size=".2 .4" pos="-.6 0 1"/>'
        '<site type="cylinder" size=".3 .4 .5" pos=".6 0 1"/></worldbody></mujoco>'
    )
    assert min(scale[2] for scale in builder.shape_scale) > 0.0
    builder.shape_flags = [flags | 1 for flags in builder.shape_flags]
    straight.add_shape_cylinder(-1, radius=0.2, half_height=0.4, xform=pose(-0.6, 0.0, 1.0))
    straight.add_shape_cylinder(-1, radius=0.3, half_height=0.4, xform=pose(0.6, 0.0, 1.0))
    seen, expected = (scenes.look(wc.from_newton(*finalize(each, device)), eye()) for each in (builder, straight))
    assert set(np.unique(expected["segmentation"])) == {-1, 0, 1}
    for name, image in expected.items():
        assert (seen[name] == image).all(), name


SOLIDS = {
    "cone": (lambda o, d: closed_form.cone(o, d, 0.5, 0.6), {"radius": 0.5, "half_height": 0.6}),
    "flat cone": (lambda o, d: closed_form.cone(o, d, 0.9, 0.1), {"radius": 0.9, "half_height": 0.1}),
    "barrel": (
        lambda o, d: closed_form.barrel(o, d, 0.3, 0.5, 0.7),
        {"radius": 0.3, "half_height": 0.5, "barrel_radius": 0.7},
    ),
    "ball of a barrel": (
        lambda o, d: closed_form.barrel(o, d, 0.2, 0.5, 0.5),
        {"radius": 0.2, "half_height": 0.5, "barrel_radius": 0.5},
    ),
    "hardly a barrel": (
        lambda o, d: closed_form.barrel(o, d, 0.4, 0.5, 60.0),
        {"radius": 0.4, "half_height": 0.5, "barrel_radius": 60.0},
    ),
}


@pytest.mark.parametrize("what", SOLIDS)
def test_solids_of_newton_alone(device: wp.Device, what: str) -> None:
    enter, sizes = SOLIDS[what]
    random = np.random.default_rng(list(SOLIDS).index(what))
    builder = newton.ModelBuilder()
    turns, shifts = [], []
    for world in range(6):
        quaternion = random.normal(size=4) if world else np.array((1.0, 0.0, 0.0, 0.0))
        turns.append(scenes.matrix(quaternion))
        shifts.append(np.array((0.0, 0.0, -3.0)) + (random.uniform(-0.5, 0.5, 3) if world else 0.0))
        builder.begin_world()
        add = builder.add_shape_cone if what.endswith("cone") else builder.add_shape_cylinder
        add(-1, xform=pose(*shifts[-1], quaternion[[1, 2, 3, 0]]), **sizes)
        builder.end_world()
    model, state = finalize(builder, device)
    camera = eye(position=(0.0, 0.0, 0.0), rotation=(1.0, 0.0, 0.0, 0.0), width=64)
    seen = scenes.look(wc.from_newton(model, state), camera)
    rays = scenes.pixel_rays(64, 64, FOVY)
    for world, (turn, shift) in enumerate(zip(turns, shifts, strict=True)):

        def cast(directions: np.ndarray, turn: np.ndarray = turn, shift: np.ndarray = shift) -> closed_form.Entry:
            t, normal = enter(np.broadcast_to(-shift @ turn, directions.shape), directions @ turn)
            return t, normal @ turn.T

        t, normal = cast(rays)
        near_edge = np.zeros(t.shape, bool)
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            other_t, other_normal = cast(rays + 1e-4 * np.array((dx, dy, 0.0)))
            near_edge |= np.isfinite(t) != np.isfinite(other_t)
            near_edge |= np.sum(normal * other_normal, axis=-1) < 0.98
        hit = np.isfinite(t) & ~near_edge
        assert hit.sum() > 100
        assert near_edge.mean() < 0.03
        assert (np.isfinite(seen["depth"][world]) == np.isfinite(t))[~near_edge].all(), world
        assert np.abs(seen["depth"][world] - t)[hit].max() <= 1e-4, world
        assert np.abs(seen["normals"][world] - normal)[hit].max() <= 5e-3, world


def test_worlds_of_all_kinds_lie_on_one_place(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_box(-1, hx=0.2, hy=0.2, hz=0.2, xform=pose(-1.0, 0.0, 1.0), label="of all")
    builder.begin_world()
    builder.add_shape_sphere(-1, radius=0.4, xform=pose(0.0, 0.0, 1.0))
    builder.end_world()
    builder.begin_world()
    builder.add_shape_mesh(-1, mesh=newton_scenes.tetrahedron(), xform=pose(0.0, 0.0, 1.0))
    builder.add_shape_sphere(builder.add_body(xform=pose(0.7, 0.0, 1.0)), radius=0.2)
    builder.end_world()
    builder.begin_world()
    builder.add_body()  # a world with nothing to see of its own
    builder.end_world()
    builder.begin_world()
    builder.add_shape_mesh(-1, mesh=newton.Mesh.create_box(0.3, 0.3, 0.3), xform=pose(0.0, 0.0, 1.0))
    builder.add_shape_capsule(-1, radius=0.1, half_height=0.3, xform=pose(0.7, 0.0, 1.0))
    builder.end_world()
    builder.add_ground_plane()
    model, state = finalize(builder, device)
    images = scenes.look(wc.from_newton(model, state), eye(outputs=("depth", "segmentation", "bodies")))
    ids = [set(np.unique(image)) for image in images["segmentation"]]
    ground = model.shape_count - 1
    assert ids == [{-1, 0, ground} | own for own in ({1}, {2, 3}, set(), {4, 5})]
    assert (images["bodies"] == np.where(images["segmentation"] == 3, 0, -1)).all()
    expected = newton_scenes.newtons_own(model, state, eye())
    assert (images["segmentation"] == expected["segmentation"]).mean() > 0.999
    alone = scenes.look(wc.from_newton(model, state), eye(outputs=("segmentation",)))
    assert (alone["segmentation"] == images["segmentation"]).all()


def test_more_shapes_than_one_pass_draws(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    random = np.random.default_rng(0)
    for _ in range(2):
        builder.begin_world()
        for place in random.uniform((-2.0, 0.0, -0.5), (2.0, 3.0, 2.0), (300, 3)):
            builder.add_shape_sphere(-1, radius=0.1, xform=pose(*place))
        builder.end_world()
    model, state = finalize(builder, device)
    expected = newton_scenes.newtons_own(model, state, eye())
    for outputs in (("depth", "segmentation"), ("depth", "segmentation", "rgb"), ("segmentation",)):
        seen = scenes.look(wc.from_newton(model, state), eye(outputs=outputs))
        assert (seen["segmentation"] == expected["segmentation"]).mean() > 0.999
    assert len(np.unique(expected["segmentation"][1])) > 100


def test_replicated_worlds_keep_each_mesh_once(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 5)
    model, state = finalize(builder, device)
    scene = wc.from_newton(model, state)
    assert scene.tables().meshes.bounds_min.shape == (2,)  # the tetrahedron is there twice, once as a hull
    assert scene.tables().num_drawn == 11
    assert scene.array("shape_assets").shape[0] == 1
    images = scenes.look(scene, eye())
    for world in range(1, 5):
        shift = np.where(images["segmentation"][0] >= 0, world * 11, 0)
        assert (images["segmentation"][world] == images["segmentation"][0] + shift).all()
        assert (images["depth"][world] == images["depth"][0]).all()


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (0.5, 1.5, 2.0), (-1.0, 1.0, 1.0), (0.7, -1.2, 1.0), (-1, -1, -2)])
def test_scaled_meshes_are_those_of_scaled_vertices(device: wp.Device, scale: tuple) -> None:
    def build(scaled: bool) -> wc.Scene:
        mesh = newton.Mesh.create_sphere(0.5, num_latitudes=9, num_longitudes=7, compute_inertia=False)
        if scaled:
            faces = np.asarray(mesh.indices).reshape(-1, 3)
            faces = faces[:, ::-1] if np.prod(scale) < 0 else faces
            normals = np.asarray(mesh.normals) / scale
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            mesh = newton.Mesh(mesh.vertices * scale, faces.ravel(), normals=normals, compute_inertia=False)
        builder = newton.ModelBuilder()
        where = pose(0.2, 0.0, 1.0, (0.3, -0.2, 0.5, 0.7))
        builder.add_shape_mesh(-1, mesh=mesh, scale=(1.0, 1.0, 1.0) if scaled else scale, xform=where)
        builder.add_ground_plane()
        model, state = finalize(builder, device)
        return wc.from_newton(model, state)

    camera = eye(outputs=("depth", "segmentation", "normals", "rgb"), shadows=True)
    seen, expected = scenes.look(build(False), camera), scenes.look(build(True), camera)
    same = seen["segmentation"] == expected["segmentation"]
    assert same.mean() > 0.999 and (seen["segmentation"] == 0).mean() > 0.02
    hit = same & (seen["segmentation"] >= 0)
    assert np.abs(seen["depth"] - expected["depth"])[hit].max() < 2e-5
    assert (np.abs(seen["normals"] - expected["normals"])[same].max(axis=-1) < 1e-3).mean() > 0.995
    assert (np.abs(seen["rgb"].astype(int) - expected["rgb"])[same].max(axis=-1) <= 1).mean() > 0.99
