"""Depth and normals of every type of shape, against closed forms; lenses against projection by hand."""

import closed_form
import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

SIZE, FOVY = 48, 50.0
VIEWS = 6  # of each type: straight on, then turned and off the axis
AWAY = np.array((0.0, 0.0, -500.0))
OUTPUTS = ("depth", "segmentation", "normals", "distance", "points")

ENTRIES = {
    "plane": lambda o, d, mjm: closed_form.plane(o, d, np.array(scenes.SIZES["plane"])),
    "hfield": lambda o, d, mjm: closed_form.ramp(o, d, mjm.hfield_size[0]),
    "sphere": lambda o, d, mjm: closed_form.ellipsoid(o, d, np.full(3, 0.5)),
    "capsule": lambda o, d, mjm: closed_form.capsule(o, d, *scenes.SIZES["capsule"]),
    "ellipsoid": lambda o, d, mjm: closed_form.ellipsoid(o, d, np.array(scenes.SIZES["ellipsoid"])),
    "cylinder": lambda o, d, mjm: closed_form.cylinder(o, d, *scenes.SIZES["cylinder"]),
    "box": lambda o, d, mjm: closed_form.box(o, d, np.array(scenes.SIZES["box"])),
    # MuJoCo turns a mesh into its axes of inertia; this one stays a cube around the origin.
    "mesh": lambda o, d, mjm: closed_form.box(o, d, mjm.mesh_vert.max(axis=0).astype(np.float64)),
}


ANALYTIC = tuple(kind for kind in scenes.TYPES if kind not in ("hfield", "mesh"))


@pytest.fixture(scope="module")
def zoo() -> mujoco.MjModel:
    """One shape of each type."""
    return scenes.compile_xml("".join(map(scenes.geom_xml, scenes.TYPES)), assets=scenes.ASSETS)


@pytest.fixture(scope="module")
def analytic_zoo() -> mujoco.MjModel:
    """One shape of each type that is no mesh and no height field: the trace writes their normals itself."""
    return scenes.compile_xml("".join(map(scenes.geom_xml, ANALYTIC)))


def alone(mjm: mujoco.MjModel, kind: str, position: np.ndarray, rotation: np.ndarray) -> mujoco.MjData:
    """The shape of one type where it should be, the others far behind every camera here."""
    mjd = scenes.forward(mjm)
    mjd.geom_xpos[:] = AWAY
    mjd.geom_xpos[mjm.geom(kind).id] = position
    mjd.geom_xmat[mjm.geom(kind).id] = rotation.reshape(9)
    return mjd


def placements(kind: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Position and rotation of the shape in front of a camera at the origin that looks along +y."""
    random = np.random.default_rng(scenes.TYPES.index(kind))
    straight = scenes.matrix(scenes.looking((0, 0, 0), (0, 1, 0)))  # the shape's z axis is towards the camera
    found = [(np.array((0.0, 2.0, 0.0)), straight)]
    while len(found) < VIEWS:
        position = np.array((0.0, 3.0, 0.0)) + random.uniform(-0.7, 0.7, 3)
        quaternion = random.normal(size=4)
        if kind == "plane" and scenes.matrix(quaternion)[:, 2] @ position > -0.5:
            continue  # seen from behind
        found.append((position, scenes.matrix(quaternion)))
    return found


def float32(values: np.ndarray) -> np.ndarray:
    """Round to float32, as on the device."""
    return np.asarray(values, np.float32).astype(np.float64)


def test_every_type(device: wp.Device, zoo: mujoco.MjModel) -> None:
    check_types(device, zoo, scenes.TYPES, SIZE, SIZE)


@pytest.mark.parametrize(("width", "height"), [(48, 48), (44, 46), (47, 45)])
def test_every_analytic_type(device: wp.Device, analytic_zoo: mujoco.MjModel, width: int, height: int) -> None:
    check_types(device, analytic_zoo, ANALYTIC, width, height)


def check_types(device: wp.Device, zoo: mujoco.MjModel, types: tuple[str, ...], width: int, height: int) -> None:
    cases = [(kind, *placement) for kind in types for placement in placements(kind)]
    scene = wc.from_mujoco(zoo, [alone(zoo, *case) for case in cases], device=device)
    eye = scenes.looking((0, 0, 0), (0, 1, 0))
    camera = scenes.own_camera(width=width, height=height, outputs=OUTPUTS, lens=wc.Pinhole(fovy=FOVY), rotation=eye)
    images = scenes.look(scene, camera)
    rays = scenes.pixel_rays(width, height, FOVY)
    directions = rays @ scenes.matrix(float32(eye)).T
    for world, (kind, position, rotation) in enumerate(cases):
        turn, shift = float32(rotation), float32(position)

        def cast(d: np.ndarray, kind: str = kind, turn: np.ndarray = turn, shift: np.ndarray = shift) -> tuple:
            t, normal = ENTRIES[kind](np.broadcast_to(-shift @ turn, d.shape), d @ turn, zoo)
            return t, normal @ turn.T

        t, normal = cast(directions)
        near_edge = np.zeros(t.shape, bool)
        for dx, dz in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            other_t, other_normal = cast(directions + 1e-5 * np.array((dx, 0.0, dz)))
            near_edge |= np.isfinite(t) != np.isfinite(other_t)
            near_edge |= np.sum(normal * other_normal, axis=-1) < 0.99
        hit = np.isfinite(t) & ~near_edge
        assert hit.sum() > 100, kind
        assert near_edge.mean() < 0.02, kind
        seen = {name: image[world] for name, image in images.items()}
        expected = np.where(np.isfinite(t), zoo.geom(kind).id, -1)
        assert (seen["segmentation"] == expected)[~near_edge].all(), (kind, world)
        assert np.isinf(seen["depth"][~np.isfinite(t) & ~near_edge]).all()
        assert np.abs(seen["depth"][hit] - t[hit]).max() <= 4e-5, (kind, world)
        length = np.linalg.norm(rays, axis=-1)
        assert np.abs(seen["distance"][hit] - (t * length)[hit]).max() <= 4e-5, (kind, world)
        assert np.abs(seen["points"][hit] - t[hit, None] * directions[hit]).max() <= 4e-5, (kind, world)
        assert np.abs(seen["normals"][hit] - normal[hit]).max() <= 2e-3, (kind, world)
        assert (seen["normals"][~np.isfinite(t) & ~near_edge] == 0.0).all()


def test_two_ways_to_normals_agree(device: wp.Device, zoo: mujoco.MjModel, analytic_zoo: mujoco.MjModel) -> None:
    eye = scenes.looking((0, 0, 0), (0, 1, 0))
    camera = scenes.own_camera(width=SIZE, height=SIZE, outputs=("normals",), lens=wc.Pinhole(fovy=FOVY), rotation=eye)
    cases = [(kind, *placement) for kind in ANALYTIC for placement in placements(kind)]
    by_trace, by_second_pass = (
        scenes.look(wc.from_mujoco(mjm, [alone(mjm, *case) for case in cases], device=device), camera)["normals"]
        for mjm in (analytic_zoo, zoo)
    )
    # all but where a ray meets an edge, or grazes
    assert (np.abs(by_trace - by_second_pass).max(axis=-1) > 1e-3).mean() < 2e-4


@pytest.mark.parametrize(("width", "height"), [(8, 8), (12, 10), (7, 5)])
def test_passes_over_many_balls(device: wp.Device, width: int, height: int) -> None:
    random = np.random.default_rng(0)
    count, radius, fovy = 400, 0.1, 8.0
    centers = np.stack((*random.uniform(-0.3, 0.3, (2, count)), random.uniform(-6.0, -3.0, count)), axis=-1)
    centers = centers[np.argsort(centers[:, 2])]  # the nearest come with the last pass
    bodies = "".join(f'<body pos="{" ".join(map(str, center))}"><geom size="{radius}"/></body>' for center in centers)
    mjm = scenes.compile_xml(bodies)
    camera = scenes.own_camera(width=width, height=height, outputs=(*OUTPUTS, "bodies"), lens=wc.Pinhole(fovy=fovy))
    seen = {
        name: image[0]
        for name, image in scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera).items()
    }
    rays = scenes.pixel_rays(width, height, fovy)
    square = np.sum(rays**2, axis=-1)[..., None]
    along = rays @ centers.T / square
    gap = radius**2 - np.sum(centers**2, axis=-1) + along**2 * square
    t = np.where(gap > 0.0, along - np.sqrt(np.maximum(gap, 0.0) / square), np.inf)
    first, second = np.sort(t, axis=-1)[..., :2].transpose(2, 0, 1)
    sure = (np.abs(gap).min(axis=-1) > 1e-6) & (~np.isfinite(first) | (second > first + 1e-3))
    hit = sure & np.isfinite(first)
    nearest = t.argmin(axis=-1)
    assert hit.mean() > 0.5
    assert nearest[hit].max() >= 256
    assert (seen["segmentation"][sure] == np.where(np.isfinite(first), nearest, -1)[sure]).all()
    assert (seen["bodies"][sure] == np.where(np.isfinite(first), nearest + 1, -1)[sure]).all()
    points = first[..., None] * rays
    assert np.abs(seen["depth"][hit] - first[hit]).max() <= 1e-4
    assert np.abs(seen["distance"][hit] - (first * np.sqrt(square[..., 0]))[hit]).max() <= 1e-4
    assert np.abs(seen["points"][hit] - points[hit]).max() <= 1e-4
    assert np.abs(seen["normals"][hit] - ((points - centers[nearest]) / radius)[hit]).max() <= 5e-3


@pytest.mark.parametrize(
    ("kind", "turn", "depth"),
    [
        ("plane", (0, 0, 0), 2.0),
        ("hfield", (0, 0, 0), 1.8),  # half way up the ramp, 0.2
        ("hfield", (180, 0, 0), 1.8),  # its base
        ("hfield", (0, -90, 0), 1.4),  # its high side
        ("hfield", (0, 90, 0), 1.4),  # its low side, which lies wholly under z = 0
        ("sphere", (0, 0, 0), 1.5),
        ("capsule", (0, 0, 0), 1.3),
        ("capsule", (90, 0, 0), 1.7),
        ("ellipsoid", (0, 0, 0), 1.7),
        ("ellipsoid", (0, 90, 0), 1.4),
        ("ellipsoid", (90, 0, 0), 1.6),
        ("cylinder", (0, 0, 0), 1.5),
        ("cylinder", (90, 0, 0), 1.6),
        ("box", (0, 0, 0), 1.7),
        ("box", (0, 90, 0), 1.5),
        ("box", (90, 0, 0), 1.6),
    ],
)
def test_centre_by_hand(device: wp.Device, zoo: mujoco.MjModel, kind: str, turn: tuple, depth: float) -> None:
    quaternion = np.zeros(4)
    mujoco.mju_euler2Quat(quaternion, np.radians(turn), "xyz")
    # Seen from z = 2; sides of the height field are met just under its z = 0.
    rotation = scenes.matrix(quaternion)
    shift = rotation @ (0.0, 0.0, 0.05) if kind == "hfield" and turn[1] else np.zeros(3)
    scene = wc.from_mujoco(zoo, alone(zoo, kind, shift, rotation), device=device)
    seen = scenes.look(scene, scenes.own_camera(position=(0, 0, 2), width=9, height=9, lens=wc.Pinhole(fovy=1e-2)))
    assert seen["depth"][0, 4, 4] == pytest.approx(depth, abs=2e-6)
    assert seen["segmentation"][0, 4, 4] == zoo.geom(kind).id


@pytest.mark.parametrize("kind", ["plane", "endless plane", "box"])
def test_wall_is_as_far_everywhere(device: wp.Device, zoo: mujoco.MjModel, kind: str) -> None:
    mjm = zoo.__copy__()
    mjm.geom("plane").size[:2] = 0.0 if kind == "endless plane" else 9.0
    mjm.geom("box").size[:] = 9.0, 9.0, 0.5
    name = kind.split()[-1]
    position = np.array((0.0, 0.0, -2.0 if name == "plane" else -2.5))
    scene = wc.from_mujoco(mjm, alone(mjm, name, position, np.eye(3)), device=device)
    seen = scenes.look(scene, scenes.own_camera(width=SIZE, height=SIZE, outputs=OUTPUTS))
    cosine = 1.0 / np.linalg.norm(scenes.pixel_rays(SIZE, SIZE, 60.0), axis=-1)
    assert np.abs(seen["depth"] - 2.0).max() <= 2e-6
    assert np.abs(seen["distance"] - 2.0 / cosine).max() <= 5e-6
    assert (seen["normals"] == (0.0, 0.0, 1.0)).all()


def test_of_shapes_at_one_place_the_later_is_seen(device: wp.Device) -> None:
    ball = '<geom type="sphere" size=".5" pos="{} 0 -3"/>'
    mjm = scenes.compile_xml("".join(ball.format(x) for x in (-0.8, 0.8, -0.8, 0.0, 0.8, -0.8)))
    m, d = scenes.put(mjm, 2)
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [scenes.own_camera()])
    seen = scenes.on_host(renderer.render()["eye"])["segmentation"]
    assert set(np.unique(seen)) == {-1, 3, 4, 5}
