"""Newton's models: against MuJoCo's view of the same file, against Newton's own camera, against closed forms."""

from pathlib import Path
from types import SimpleNamespace
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
    """The same file as MuJoCo and as Newton read it, each geom named and floors endless, as Newton has them."""
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
    theirs, ours = wc.from_mujoco_warp(mjm, m, d, groups=scenes.ALL_GROUPS), wc.from_newton(model, state)
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


def cone(o: np.ndarray, d: np.ndarray, radius: float, half: float) -> closed_form.Entry:
    slope = 0.5 * radius / half
    w, dw = slope * (half - o[..., 2]), -slope * d[..., 2]
    a, b = (d[..., :2] ** 2).sum(-1) - dw**2, (o[..., :2] * d[..., :2]).sum(-1) - w * dw
    c = (o[..., :2] ** 2).sum(-1) - w**2
    square = b * b - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (-b - np.sqrt(np.maximum(square, 0.0))) / a
        cap = (-half - o[..., 2]) / d[..., 2]
    at = o + t[..., None] * d
    on_side = (square >= 0.0) & (t > 0.0) & (np.abs(at[..., 2]) <= half)
    around = at / np.maximum(np.linalg.norm(at[..., :2], axis=-1, keepdims=True), 1e-12)
    normal = np.stack((around[..., 0], around[..., 1], np.full(t.shape, slope)), axis=-1) / np.hypot(1.0, slope)
    base = o + cap[..., None] * d
    on_cap = (d[..., 2] > 0.0) & (cap > 0.0) & ((base[..., :2] ** 2).sum(-1) <= radius**2)
    return closed_form._nearest(
        [(np.where(on_side, t, np.inf), normal), (np.where(on_cap, cap, np.inf), np.array((0.0, 0.0, -1.0)))]
    )


def barrel(o: np.ndarray, d: np.ndarray, radius: float, half: float, arc: float) -> closed_form.Entry:
    """By steps along the ray and bisection."""

    def outside(t: np.ndarray) -> np.ndarray:
        at = o + t[..., None] * d
        z = np.clip(at[..., 2], -half, half)
        side = np.hypot(at[..., 0], at[..., 1]) - radius - np.sqrt(arc**2 - z**2) + np.sqrt(arc**2 - half**2)
        return np.maximum(side, np.abs(at[..., 2]) - half)

    times = np.linspace(0.0, 6.0, 3001)
    high, found = np.full(d.shape[:-1], np.inf), np.zeros(d.shape[:-1], bool)
    for t in times:
        inside = ~found & (outside(np.full(high.shape, t)) <= 0.0)
        high[inside], found = t, found | inside
    high = np.where(found, high, 0.0)
    low = high - times[1]
    for _ in range(40):
        middle = 0.5 * (low + high)
        inside = outside(middle) <= 0.0
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    at = o + high[..., None] * d
    around = at[..., :2] / np.maximum(np.hypot(at[..., 0], at[..., 1]), 1e-12)[..., None]
    rise = at[..., 2] / np.sqrt(np.maximum(arc**2 - at[..., 2] ** 2, 1e-12))
    normal = closed_form._unit(np.concatenate((around, rise[..., None]), axis=-1))
    cap = np.abs(np.abs(at[..., 2]) - half) < 1e-7
    normal = np.where(cap[..., None], np.sign(at[..., 2:]) * (0.0, 0.0, 1.0), normal)
    return np.where(found, high, np.inf), normal


SOLIDS = {
    "cone": (lambda o, d: cone(o, d, 0.5, 0.6), {"radius": 0.5, "half_height": 0.6}),
    "flat cone": (lambda o, d: cone(o, d, 0.9, 0.1), {"radius": 0.9, "half_height": 0.1}),
    "barrel": (lambda o, d: barrel(o, d, 0.3, 0.5, 0.7), {"radius": 0.3, "half_height": 0.5, "barrel_radius": 0.7}),
    "ball of a barrel": (
        lambda o, d: barrel(o, d, 0.2, 0.5, 0.5),
        {"radius": 0.2, "half_height": 0.5, "barrel_radius": 0.5},
    ),
    "hardly a barrel": (
        lambda o, d: barrel(o, d, 0.4, 0.5, 60.0),
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
    assert scene.tables().meshes.lower.shape == (2,)  # the tetrahedron is there twice, once as a hull
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


def test_states_are_swapped_without_rebuilding(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    model, first = finalize(builder, device)
    second = model.state()
    poses = second.body_q.numpy()
    poses[:, 2] += 0.4
    second.body_q.assign(poses)
    scene = wc.from_newton(model, first)
    renderer = wc.Renderer(scene, [eye()])
    low = scenes.on_host(renderer.render()["eye"])
    tables, recorded = scene.tables(), []
    for _ in range(3):
        scene.bind(second)
        high = scenes.on_host(renderer.render()["eye"])
        scene.bind(first)
        assert (scenes.on_host(renderer.render()["eye"])["depth"] == low["depth"]).all()
        recorded.append(list(renderer._recordings.values()))
    assert (high["depth"] != low["depth"]).any()
    fresh = scenes.look(wc.from_newton(model, second), eye())
    assert (high["depth"] == fresh["depth"]).all() and (high["segmentation"] == fresh["segmentation"]).all()
    assert scene.tables() is tables
    assert recorded[0] == recorded[1] == recorded[2] and len(recorded[0]) == 2
    for _ in range(20):
        scene.bind(model.state())
        renderer.render()
    assert len(renderer._recordings) <= 4


def change(array: wp.array, rows: Any, value: Any) -> None:
    scenes.write(array, rows, value)


LIVE = {
    "colour": (lambda m, s: change(m.shape_color, 0, (1.0, 0.0, 0.0)), "albedo"),
    "scale": (lambda m, s: change(m.shape_scale, 0, (0.1, 0.0, 0.0)), "depth"),
    "scale of a mesh": (lambda m, s: change(m.shape_scale, 7, (1.0, 1.0, -1.0)), "depth"),
    "transform": (lambda m, s: change(m.shape_transform, (1, 2), 1.2), "depth"),
    "flags": (lambda m, s: change(m.shape_flags, 2, 6), "segmentation"),
    "opacity": (lambda m, s: change(m.shape_opacity, 3, 0.0), "segmentation"),
    "pose": (lambda m, s: change(s.body_q, (0, 2), 0.5), "depth"),
}


@pytest.mark.parametrize("what", LIVE)
def test_what_changes_in_place_is_seen(device: wp.Device, what: str) -> None:
    write, output = LIVE[what]
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    model, state = finalize(builder, device)
    camera = eye(outputs=("depth", "segmentation", "albedo"))
    renderer = wc.Renderer(wc.from_newton(model, state), [camera])
    before = scenes.on_host(renderer.render()["eye"])
    write(model, state)
    after = scenes.on_host(renderer.render()["eye"])
    assert (after[output][0] != before[output][0]).any()
    assert (after[output][1] == before[output][1]).all()
    fresh = scenes.look(wc.from_newton(model, state), camera)
    assert all((after[name] == fresh[name]).all() for name in after)


def test_a_graph_of_ones_own_reads_live_poses(device: wp.Device) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    renderer = wc.Renderer(wc.from_newton(model, state), [eye()])
    before = scenes.on_host(renderer.render()["eye"])
    with wp.ScopedCapture(device) as capture:
        renderer.render()
    change(state.body_q, (0, 2), 0.5)
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    after = scenes.on_host(renderer.images["eye"])
    assert (after["depth"] != before["depth"]).any()
    assert (after["depth"] == scenes.look(wc.from_newton(model, state), eye())["depth"]).all()


def test_textures_lie_as_newton_lays_them(device: wp.Device) -> None:
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[0, 0], pixels[0, 1], pixels[1, 0], pixels[1, 1] = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)
    corners = np.array(((-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)), np.float32)
    uvs = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32)

    def quadrants(**options: Any) -> list[tuple[int, ...]]:
        mesh = newton.Mesh(
            corners, np.array((0, 1, 2, 0, 2, 3)), uvs=uvs, texture=pixels, compute_inertia=False, **options
        )
        builder = newton.ModelBuilder()
        builder.add_shape_mesh(-1, mesh=mesh, color=(1.0, 1.0, 1.0))
        model, state = finalize(builder, device)
        camera = eye(width=64, outputs=("albedo",), position=(0, -3, 0), rotation=scenes.looking((0, -3, 0), (0, 0, 0)))
        image = scenes.look(wc.from_newton(model, state), camera)["albedo"][0]
        return [tuple(255 * int(x > 127) for x in image[row, column]) for row in (22, 42) for column in (22, 42)]

    red, green, blue, white = (tuple(int(x) for x in pixels[i, j]) for i in (0, 1) for j in (0, 1))
    assert quadrants() == [red, green, blue, white]
    assert quadrants(texture_transform=((1, 0, 0.5), (0, 1, 0))) == [green, red, white, blue]
    assert quadrants(texture_transform=((0, 1, 0), (1, 0, 0))) == [white, green, blue, red]
    assert quadrants(texture_transform=((0, 1, 0), (-1, 0, 0))) == [green, white, red, blue]


def test_lights_shine_where_they_are_put(device: wp.Device) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    camera = eye(outputs=("rgb",))

    def picture(*lights: wc.Light, **options: Any) -> np.ndarray:
        return scenes.look(wc.from_newton(model, state, lights=lights, **options), camera)["rgb"][0].astype(int)

    assert picture(ambient=(0, 0, 0)).max() == 0
    even = picture(ambient=(0.5, 0.5, 0.5))
    assert even.max() > 50
    sun = picture(wc.Light(direction=(0, 2, 0)), ambient=(0, 0, 0))
    assert (sun <= picture(wc.Light(direction=(0, 1, 0)))).all()
    assert (picture(wc.Light(direction=(0, 1, 0), intensity=0.5), ambient=(0, 0, 0)) <= sun).all()
    lamp = picture(wc.Light(kind="point", position=(0, -4, 1.6)), ambient=(0, 0, 0))
    spot = picture(
        wc.Light(kind="spot", position=(0, -4, 1.6), direction=(0, 1, 0), cutoff=5, exponent=0), ambient=(0, 0, 0)
    )
    assert (spot <= lamp).all() and 0 < (spot.max(-1) > 0).sum() < (lamp.max(-1) > 0).sum()
    scene = wc.from_newton(model, state)
    assert scene.array("light_directions").numpy()[0, 0] == pytest.approx(np.array((-1, 1, -1)) / np.sqrt(3.0))
    renderer = wc.Renderer(scene, [camera])
    before = renderer.render()["eye"]["rgb"].clone()
    scene.array("light_directions").fill_(wp.vec3(0.0, 1.0, 0.0))
    assert (renderer.render()["eye"]["rgb"] != before).any()


def test_lights_may_differ_between_worlds(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    model, state = finalize(builder, device)
    light = wc.Light(color=((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), direction=(0.0, 1.0, -0.5), intensity=(0.5, 1.0))
    seen = scenes.look(wc.from_newton(model, state, lights=[light], ambient=(0, 0, 0)), eye(outputs=("rgb",)))["rgb"]
    assert (seen[0, ..., 1:] == 0).all() and (seen[1, ..., :2] == 0).all()
    assert seen[0, ..., 0].max() > 20 and seen[1, ..., 2].max() > 20


def test_the_light_is_above_whichever_way_is_up(device: wp.Device) -> None:
    builder = newton.ModelBuilder(up_axis=newton.Axis.Y)
    builder.add_ground_plane()
    scene = wc.from_newton(*finalize(builder, device))
    assert scene.array("light_directions").numpy()[0, 0] == pytest.approx(-np.ones(3) / np.sqrt(3.0), abs=1e-6)


@pytest.mark.parametrize("prefix", ["", "env"])
def test_a_camera_rides_on_a_body_of_each_world(device: wp.Device, prefix: str) -> None:
    builder = newton.ModelBuilder()
    for world, kinds in enumerate((("arm", "base"), ("base", "arm"), ("base", "leg"))):
        part = newton.ModelBuilder()
        for place, name in enumerate(kinds):
            body = part.add_body(label=name, xform=pose(0.0, 0.0, 1.0 + world if name == "arm" else 9.0))
            part.add_shape_box(body, hx=0.1, hy=0.1, hz=0.1, xform=pose(0.0, 0.0, 20.0 + place))
        builder.add_world(part, label_prefix=f"{prefix}{world}" if prefix else None)
    builder.add_ground_plane()
    model, state = finalize(builder, device)
    scene = wc.from_newton(model, state)
    first = model.body_label[0]
    for parent in (first, "arm", 0, 3):
        renderer = wc.Renderer(scene, [eye(position=(0, 0, 0), rotation=(1, 0, 0, 0), parent=parent)])
        depth = renderer.render()["eye"]["depth"][:, 32, 48, 0].tolist()
        assert depth == pytest.approx([1.0, 2.0, np.inf])
        assert renderer.faulty.tolist() == [0, 0, 1]
    with pytest.raises(
        wc.WarpcamError, match=r"eye.*parent: the scene has no body 'tail'; it has: 'arm', 'base', 'leg'"
    ):
        wc.Renderer(scene, [eye(parent="tail")])
    with pytest.raises(wc.WarpcamError, match="no body 6; it has indices 0 to 5"):
        wc.Renderer(scene, [eye(parent=6)])


def test_a_broken_pose_is_its_own_worlds(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    model, state = finalize(builder, device)
    change(state.body_q, (0, 0), np.nan)
    renderer = wc.Renderer(wc.from_newton(model, state), [eye()])
    seen = scenes.on_host(renderer.render()["eye"])
    assert renderer.faulty.tolist() == [1, 0]
    assert (seen["segmentation"][0] == -1).all() and (seen["segmentation"][1] >= 0).any()


def test_bounds_are_those_of_what_is_seen(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_mesh(-1, mesh=newton_scenes.tetrahedron((1, 1, 1)), scale=(-2.0, 1.0, 3.0))
    builder.add_shape_cone(-1, radius=0.5, half_height=1.0, xform=pose(0.0, 4.0, 0.0))
    builder.add_shape_cylinder(-1, radius=0.3, half_height=0.5, barrel_radius=0.5, xform=pose(0.0, 6.0, 0.0))
    hidden = newton.ModelBuilder.ShapeConfig(is_visible=False)
    builder.add_shape_sphere(-1, radius=50.0, cfg=hidden)
    model, state = finalize(builder, device)
    low, high = wc.from_newton(model, state).bounds()
    assert low == pytest.approx((-2.0, 0.0, -1.0), abs=1e-5)
    assert high == pytest.approx((0.8, 6.8, 3.0), abs=1e-5)


def test_an_empty_model_shows_nothing(device: wp.Device) -> None:
    model, state = finalize(newton.ModelBuilder(), device)
    seen = scenes.look(wc.from_newton(model, state), eye())
    assert np.isinf(seen["depth"]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (lambda m, s: ("model", s), "model must be a newton.Model, got str"),
        (lambda m, s: (m, m), "state must be a newton.State, got Model"),
        (
            lambda m, s: (m, newton.ModelBuilder().finalize(device=m.device).state()),
            "state was made from another model",
        ),
    ],
)
def test_bad_arguments(device: wp.Device, arguments: Any, message: str) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    with pytest.raises(wc.WarpcamError, match=message):
        wc.from_newton(*arguments(model, state))
    scene = wc.from_newton(model, state)
    with pytest.raises(wc.WarpcamError, match=r"state must be a newton\.State, got int"):
        scene.bind(3)


@pytest.mark.parametrize("what", ["bodies", "particles", "joint coordinates", "joint degrees of freedom"])
def test_a_state_of_another_model_is_refused_by_what_it_has(device: wp.Device, what: str) -> None:
    """As many of all else. A state keeps no link to its model: one that has as many of everything cannot be told."""

    def made(other: bool) -> tuple[Any, Any]:
        builder = newton.ModelBuilder()
        links = [builder.add_link(mass=1.0) for _ in range(2)]
        for link in links:
            builder.add_shape_sphere(link, radius=0.1)
        ball = other and what.startswith("joint")
        first = builder.add_joint_revolute(-1, links[0])
        if ball:  # of three degrees of freedom and four coordinates
            second = builder.add_joint_ball(links[0], links[1])
        else:
            second = builder.add_joint_revolute(links[0], links[1])
        builder.add_articulation([first, second])
        if other and what == "bodies":
            builder.add_body()
        for _ in range(3 if other and what == "particles" else 2):
            builder.add_particle(wp.vec3(0.0, -1.0, 1.0), wp.vec3(), 0.1, radius=0.1)
        return finalize(builder, device)

    model, state = made(False)
    scene = wc.from_newton(model, state)
    renderer = wc.Renderer(scene, [eye()])
    before = scenes.on_host(renderer.render()["eye"])["depth"]
    other = made(True)[1]
    if what == "joint degrees of freedom":  # the coordinates are looked at before
        other.joint_q = wp.clone(state.joint_q)
    if what == "bodies":
        other.joint_q = other.joint_qd = None
    with pytest.raises(wc.WarpcamError, match=f"state was made from another model: it has . {what}, model has ."):
        scene.bind(other)
    assert (scenes.on_host(renderer.render()["eye"])["depth"] == before).all()


@pytest.mark.skipif(len(wp.get_devices()) < 2, reason="there is one device")
def test_a_model_and_a_state_on_two_devices() -> None:
    model, _ = finalize(newton_scenes.zoo(), wp.get_device("cpu"))
    _, state = finalize(newton_scenes.zoo(), wp.get_device("cuda:0"))
    with pytest.raises(wc.WarpcamError, match="device: state is on cuda:0, but model is on cpu; both must be on one"):
        wc.from_newton(model, state)


@pytest.mark.parametrize("what", ["body_q", "particle_q"])
def test_a_state_on_another_device_is_refused_and_the_old_one_kept(device: wp.Device, what: str) -> None:
    """The other device is made up, so that one is enough."""
    builder = newton_scenes.zoo()
    builder.add_particle(wp.vec3(0.0, -1.0, 1.0), wp.vec3(), 0.1, radius=0.1)
    model, state = finalize(builder, device)
    scene = wc.from_newton(model, state)
    renderer = wc.Renderer(scene, [eye()])
    before = scenes.on_host(renderer.render()["eye"])["depth"]
    other = model.state()
    elsewhere = SimpleNamespace(alias="cuda:7")
    setattr(other, what, SimpleNamespace(shape=getattr(state, what).shape, device=elsewhere))
    message = f"device: state is on cuda:7, but model is on {device.alias}; both must be on one"
    with pytest.raises(wc.WarpcamError, match=message):
        scene.bind(other)
    with pytest.raises(wc.WarpcamError, match=message):
        wc.from_newton(model, other)
    assert (scenes.on_host(renderer.render()["eye"])["depth"] == before).all()


def test_a_missing_texture_is_named_and_its_colour_drawn(
    device: wp.Device, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "broken.png").write_bytes(b"no picture")
    corners = np.array(((-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)), np.float32)
    uvs = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32)
    for name in ("gone.png", "broken.png"):
        mesh = newton.Mesh(
            corners, np.array((0, 1, 2, 0, 2, 3)), uvs=uvs, texture=str(tmp_path / name), compute_inertia=False
        )
        builder = newton.ModelBuilder()
        builder.add_shape_mesh(-1, mesh=mesh, color=(1.0, 0.0, 0.0), label="wall")
        model, state = finalize(builder, device)
        caplog.clear()
        scene = wc.from_newton(model, state)
        assert "shape 'wall'" in caplog.text and name in caplog.text and "its colour is drawn" in caplog.text
        seen = scenes.look(scene, eye(outputs=("albedo", "segmentation")))
        assert (seen["albedo"][seen["segmentation"] == 0] == (255, 0, 0)).all()


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ({"kind": "sun"}, r"lights\[0\]: kind must be"),
        ({"direction": (0, 0, 0)}, r"lights\[0\]: direction must not be of length 0"),
        ({"kind": "spot", "cutoff": 100.0}, r"lights\[0\]: cutoff must be from 0 to 90"),
        ({"color": (1, 1)}, r"lights\[0\]: color must have shape"),
        ({"attenuation": (0, 0, 0)}, r"lights\[0\]: attenuation must not be"),
    ],
)
def test_bad_lights(device: wp.Device, light: dict[str, Any], message: str) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    with pytest.raises(wc.WarpcamError, match=message):
        wc.from_newton(model, state, lights=[wc.Light(**light)])
    with pytest.raises(wc.WarpcamError, match=r"lights must be a sequence of warpcam\.Light"):
        wc.from_newton(model, state, lights="sun")


def test_a_mesh_with_bad_indices_is_named(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    mesh = newton_scenes.tetrahedron()
    builder.add_shape_mesh(-1, mesh=mesh, label="broken")
    model, state = finalize(builder, device)
    mesh.indices[4] = 77
    with pytest.raises(wc.WarpcamError, match=r"mesh of shape 'broken'.*from 0 to 3, got \[0, 77, 3\] at face 1"):
        wc.from_newton(model, state)


def test_labels_of_articulations_bodies_and_paths(device: wp.Device) -> None:
    robot = newton.ModelBuilder()
    hand = robot.add_link(label="robot/arm/hand", xform=pose(0.0, 0.0, 1.0))
    arm = robot.add_link(label="robot/arm", xform=pose(0.8, 0.0, 1.0))
    joints = [robot.add_joint_fixed(-1, arm), robot.add_joint_fixed(arm, hand)]
    robot.add_articulation(joints, label="robot")
    robot.add_shape_sphere(arm, radius=0.2, label="robot/arm/upper")
    robot.add_shape_sphere(hand, radius=0.2, label="robot/arm/hand/palm")
    robot.add_shape_box(robot.add_body(label="mug", xform=pose(-0.8, 0.0, 1.0)), hx=0.1, hy=0.1, hz=0.1)
    bare = newton.ModelBuilder()
    bare.add_shape_box(bare.add_body(label="mug", xform=pose(0.0, 0.0, 1.0)), hx=0.1, hy=0.1, hz=0.1, label="lid")
    builder = newton.ModelBuilder()
    builder.add_world(robot)
    builder.add_world(bare)
    builder.add_world(robot)
    builder.add_ground_plane()
    model, state = finalize(builder, device)
    numbers = {"arm": 1, "hand": 2, "arm/hand": 3, "mug": 4, "lid": 5, "ground_plane": 6, "tail": 7}
    scene = wc.from_newton(model, state, semantics=numbers)
    seen = scenes.look(scene, eye(outputs=("segmentation", "instances", "semantics")))
    expected = {"upper": 1, "palm": 3, "mug": 4, "lid": 5, "ground_plane": 6}
    for world in range(3):
        for shape in np.unique(seen["segmentation"][world]):
            there = seen["segmentation"][world] == shape
            body = int(model.shape_body.numpy()[shape]) if shape >= 0 else -1
            names = {model.shape_label[shape].split("/")[-1], model.body_label[body] if body >= 0 else ""}
            of = [expected[name] for name in expected if shape >= 0 and name in names]
            assert set(np.unique(seen["semantics"][world][there])) == {max(of) if of else 0}, (world, shape)
            articulation = {"robot/arm": 0, "robot/arm/hand": 0, "mug": 1}.get(model.body_label[body], -1)
            instance = -1 if body < 0 else (articulation, 2, 3 + articulation)[world]
            assert set(np.unique(seen["instances"][world][there])) == {instance}, (world, shape)
    assert set(np.unique(seen["semantics"])) == {0, 1, 3, 4, 5, 6}
    assert set(np.unique(seen["instances"])) == {-1, 0, 1, 2, 3, 4}
    plain = scenes.look(wc.from_newton(model, state), eye(outputs=("semantics",)))
    assert (plain["semantics"] == 0).all()


@pytest.mark.parametrize(
    ("semantics", "message"),
    [
        (("mug",), "semantics must map labels to whole numbers, got tuple"),
        ({"mug": "one"}, "semantics: must map labels to whole numbers, got 'mug': 'one'"),
    ],
)
def test_bad_labels(device: wp.Device, semantics: Any, message: str) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    with pytest.raises(wc.WarpcamError, match=message):
        wc.from_newton(model, state, semantics=semantics)


def test_textures_of_ones_own_are_given_by_world(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_ground_plane()
    one = newton.ModelBuilder()
    one.add_shape_mesh(-1, mesh=newton.Mesh.create_box(0.5, compute_inertia=False), color=(1.0, 1.0, 1.0), label="box")
    builder.replicate(one, 3)
    model, state = finalize(builder, device)
    images = [np.full((4, 4, 3), color, np.uint8) for color in ((255, 0, 0), (0, 255, 0))]
    scene = wc.from_newton(model, state, lights=[], ambient=(1.0, 1.0, 1.0), textures=images)
    materials = wp.to_torch(scene.array("shape_materials"))
    last = scene.array("material_roughness").shape[1]
    renderer = wc.Renderer(scene, [eye(outputs=("albedo", "segmentation"))])
    for choice in ((0, 1, None), (1, None, 0)):
        for world, image in enumerate(choice):
            column = int(np.flatnonzero(scene.columns[world] == world + 1)[0])
            materials[world, column] = 0 if image is None else last - 2 + image
        seen = {name: output.cpu().numpy() for name, output in renderer.render()["eye"].items()}
        for world, image in enumerate(choice):
            box = seen["albedo"][world][seen["segmentation"][world, ..., 0] == world + 1]
            assert len(box) > 100
            assert (box == (255 if image is None else images[image][0, 0])).all()
    with pytest.raises(wc.WarpcamError, match=r"textures\[0\]: \(height, width, 3\) uint8 is needed, got float64"):
        wc.from_newton(model, state, textures=[np.zeros((4, 4, 3))])
