"""Views of a mesh from inside its box: no face that a ray meets is left out, and most others are."""

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from native_kernel import native_kernel

import warpcam as wc

FACES, RAYS = 10_000, 300  # so many rays of each part of an image, its corners among them
POSES, SIZE = 24, 24  # cameras, and their images' pixels
DEVICES = [str(device) for device in wp.get_devices()]


@wp.func_native("""
    using namespace warpcam;
    ShapeRecord record {};
    record.axis_x = { turn.data[0][0], turn.data[0][1], turn.data[0][2], 0 };
    record.axis_y = { turn.data[1][0], turn.data[1][1], turn.data[1][2], 0 };
    record.axis_z = { turn.data[2][0], turn.data[2][1], turn.data[2][2], 0 };
    const CornerRays rays(record, { part[0], part[1], part[2], part[3] });
    wp::index(may, i) = may_meet_face(rays, { face.data[0][0], face.data[0][1], face.data[0][2] },
                                      { face.data[1][0], face.data[1][1], face.data[1][2] },
                                      { face.data[2][0], face.data[2][1], face.data[2][2] }, both != 0);
""")
def try_face(
    turn: wp.mat33, face: wp.mat33, part: wp.vec4, both: wp.int32, i: wp.int32, may: wp.array(dtype=wp.bool)
): ...


@native_kernel("traversal/enclosing_mesh_cull.h")
def try_faces(
    turn: wp.array(dtype=wp.mat33),
    face: wp.array(dtype=wp.mat33),
    part: wp.array(dtype=wp.vec4),
    both: wp.int32,
    may: wp.array(dtype=wp.bool),
):
    i = wp.tid()
    try_face(turn[i], face[i], part[i], both, i, may)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("both", [False, True])
def test_faces_that_rays_meet_are_kept(device: str, both: bool) -> None:
    random = np.random.default_rng(3)
    turn = np.linalg.qr(random.normal(size=(FACES, 3, 3)))[0]
    turn[:, 0] *= np.sign(np.linalg.det(turn))[:, None]
    face = random.normal(size=(FACES, 1, 3)) + 10.0 ** random.uniform(-2.0, 1.0, (FACES, 1, 1)) * random.normal(
        size=(FACES, 3, 3)
    )
    center, size = random.uniform(-1.0, 1.0, (FACES, 2)), 10.0 ** random.uniform(-2.0, 0.0, (FACES, 2))
    aimed = np.arange(FACES) % 2 == 0  # half of the parts look at a point of their face
    away = np.einsum("nji,nj->ni", turn, np.einsum("nk,nki->ni", random.dirichlet((1.0, 1.0, 1.0), FACES), face))
    aimed &= away[:, 2] < -0.1
    center[aimed] = (-away[:, :2] / away[:, 2:])[aimed]
    first, last = center - size, center + size
    part = np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], 1)
    turn, face, part = (np.asarray(values, np.float32) for values in (turn, face, part))

    a, b, c = np.moveaxis(face.astype(np.float64), 1, 0)
    met = np.zeros(FACES, bool)
    for ray in range(RAYS):
        share = random.uniform(size=(FACES, 2)) if ray > 3 else np.full((FACES, 2), (ray % 2, ray // 2), np.float64)
        x, y = (part[:, k] + share[:, k // 2] * (part[:, k + 1].astype(np.float64) - part[:, k]) for k in (0, 2))
        step = np.einsum("nij,nj->ni", turn.astype(np.float64), np.stack([x, y, -np.ones(FACES)], 1))
        sides = np.stack([(step * np.cross(p, q)).sum(1) for p, q in ((a, b), (b, c), (c, a))])
        ahead = (a * np.cross(b, c)).sum(1) * sides.sum(0) > 0.0
        met |= ahead & ((sides <= 0.0).all(0) | (both & (sides >= 0.0).all(0)))
    may = wp.zeros(FACES, dtype=wp.bool, device=device)
    inputs = [wp.array(v, dtype=t, device=device) for v, t in ((turn, wp.mat33), (face, wp.mat33), (part, wp.vec4))]
    wp.launch(try_faces, dim=FACES, inputs=[*inputs, int(both), may], device=device)
    kept = may.numpy()
    assert met.sum() > FACES // 10
    assert kept[met].all()
    assert (kept & ~met).sum() < 0.3 * (~met).sum()


def dented_ball(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a closed mesh that is anything but convex: from within its box much of it is seen."""
    rings, around = 12, 20
    polar, azimuth = np.pi * np.arange(1, rings) / rings, 2.0 * np.pi * np.arange(around) / around
    sine = np.sin(polar)[:, None]
    points = np.stack((sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)[:, None] + 0.0 * azimuth), -1)
    points = points.reshape(-1, 3) * random.choice((0.15, 0.5), (len(points.reshape(-1, 3)), 1))
    vertices = np.concatenate((points, [(0, 0, 0.35), (0, 0, -0.35)]))
    faces = []
    for i in range(around):
        j = (i + 1) % around
        faces += [(len(points), i, j), (len(points) + 1, len(points) - around + j, len(points) - around + i)]
        for above in range(0, len(points) - around, around):
            below = above + around
            faces += [(above + i, below + i, below + j), (above + i, below + j, above + j)]
    return vertices, np.array(faces)


@pytest.mark.parametrize("device", DEVICES)
def test_from_inside_a_meshs_box(device: str) -> None:
    random = np.random.default_rng(5)
    vertices, faces = dented_ball(random)
    numbers = [" ".join(map(str, values.reshape(-1))) for values in (vertices, faces)]
    mjm = scenes.compile_xml(
        '<geom type="mesh" mesh="dented"/>', assets=f'<mesh name="dented" vertex="{numbers[0]}" face="{numbers[1]}"/>'
    )
    mjd = scenes.forward(mjm)
    corners = mjm.mesh_vert[mjm.mesh_face].astype(np.float64) @ mjd.geom_xmat[0].reshape(3, 3).T + mjd.geom_xpos[0]
    low, high = corners.min((0, 1)), corners.max((0, 1))
    places, turns = random.uniform(low, high, (POSES, 3)), random.normal(size=(POSES, 4))
    scene = wc.from_mujoco(mjm, mjd, device=device)
    rays = scenes.pixel_rays(SIZE, SIZE, 60.0).reshape(-1, 3)
    empty = wrong = 0
    for place, turn in zip(places, turns, strict=True):
        camera = wc.Camera(
            "own", width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=60.0), outputs=("segmentation",), near=0.0,
            position=tuple(place), rotation=tuple(turn),
        )  # fmt: skip
        seen = scenes.look(scene, camera)["segmentation"].reshape(-1) >= 0
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, turn / np.linalg.norm(turn))
        step = rays @ matrix.reshape(3, 3).T
        a, b, c = np.moveaxis(corners - place, 1, 0)
        sides = np.stack([step @ np.cross(p, q).T for p, q in ((a, b), (b, c), (c, a))])
        front = (sides <= 0.0).all(0) & ((a * np.cross(b, c)).sum(1) < 0.0)
        wrong += int((front.any(1) != seen).sum())
        empty += not seen.any()
    assert 3 <= empty <= POSES - 10  # so the cameras are in and out of it
    assert wrong <= 3  # at edges
