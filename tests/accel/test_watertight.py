"""No ray slips through a closed mesh: half a million rays at points, edges and vertices, near the origin and far off.
Nor through a cylinder where its cap and its side meet, nor through a height field where its base and its sides do.

One world a ray, with a camera of one pixel. The meshes are looked at from the inside (wound to face inwards, so that
their fronts are there), and from the outside, where a ray that passes a front face may not come out at nothing.
"""

import functools
from dataclasses import replace

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.accel.meshes import Mesh, face_normals
from warpcam.scene.scene import Scene
from warpcam.sources.mujoco.device import MujocoWarpSource

RAYS = 28_000  # each time; times 18 is half a million
FAR_OFF = (148376.0, 1234.0, -223423.0)
MODEL = '<geom type="mesh" mesh="any"/>'
ANY_MESH = '<mesh name="any" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>'


def icosphere() -> tuple[np.ndarray, np.ndarray]:
    """The icosahedron's faces cut in four, four times: 5,120 faces on the unit sphere."""
    g = 0.5 * (1.0 + np.sqrt(5.0))
    corners = [(a, b * g, 0.0) for a in (-1, 1) for b in (-1, 1)]
    vertices = [tuple(np.roll(corner, turn)) for turn in range(3) for corner in corners]
    points = np.array(vertices) / np.hypot(1.0, g)
    edge = 2.0 / np.hypot(1.0, g)
    near = np.abs(np.linalg.norm(points[:, None] - points[None], axis=-1) - edge) < 1e-6
    faces = np.array(
        [(i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] & near[j, k] & near[i, k]]
    )
    outward = np.linalg.det(points[faces]) > 0.0
    faces[~outward] = faces[~outward][:, ::-1]
    for _ in range(4):
        middles = {}
        points = list(points)
        cut = []
        for face in faces:
            mids = []
            for a, b in zip(face, np.roll(face, -1), strict=True):
                key = (min(a, b), max(a, b))
                if key not in middles:
                    middles[key] = len(points)
                    middle = points[a] + points[b]
                    points.append(middle / np.linalg.norm(middle))
                mids.append(middles[key])
            (a, b, c), (ab, bc, ca) = face, mids
            cut += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        points, faces = np.array(points), np.array(cut)
    return points, faces


def slivers() -> tuple[np.ndarray, np.ndarray]:
    """A lens with two fans of 1,000 faces and 4,000 thin ones between, 1,000 times as long as they are wide."""
    around, heights = 1000, (0.6, 0.59, 0.0)
    angle = 2.0 * np.pi * np.arange(around) / around
    rings = [
        np.stack((np.cos(angle) * r, np.sin(angle) * r, np.full(around, z)), 1)
        for r, z in ((0.3, heights[0]), (1.0, heights[1]), (0.9, -0.6))
    ]
    points = np.concatenate((*rings, [(0, 0, 0.65), (0, 0, -0.7)]))
    faces, top, bottom = [], 3 * around, 3 * around + 1
    for i in range(around):
        j = (i + 1) % around
        faces += [(top, i, j), (bottom, 2 * around + j, 2 * around + i)]
        for a, b in ((0, around), (around, 2 * around)):
            faces += [(a + i, b + i, b + j), (a + i, b + j, a + j)]
    return points, np.array(faces)


MESHES = {"icosphere": icosphere(), "slivers": slivers()}
# Each place with each thing to aim at; either mesh at each place, and with each thing to aim at.
CASES = [
    (list(MESHES)[(i + j) % 2], offset, size, what)
    for i, (offset, size) in enumerate((((0, 0, 0), 1.0), ((1e3, 1e3, 1e3), 1.0), (FAR_OFF, 100.0)))
    for j, what in enumerate(("points", "edges", "vertices"))
]


@functools.cache
def bodies(device: str) -> tuple:
    """One geom at the origin in as many worlds as there are rays: host model, model and data."""
    mjm = scenes.compile_xml(MODEL, assets=ANY_MESH)
    with wp.ScopedDevice(device):
        m, d = scenes.put(mjm, RAYS)
    d.geom_xpos.zero_()
    d.geom_xmat.fill_(wp.mat33(np.eye(3)))
    return mjm, m, d


def scene_of(device: wp.Device, vertices: np.ndarray, faces: np.ndarray) -> Scene:
    """The mesh where its vertices are, in every world: MuJoCo would move it to its centre of mass."""
    source = MujocoWarpSource(*bodies(device.alias), (0,))
    vertices, faces = vertices.astype(np.float32), faces.astype(np.int32)
    normals = np.repeat(face_normals(vertices, faces)[:, None], 3, axis=1)
    source.parts = replace(source.parts, meshes=[Mesh("closed", vertices, faces, normals, None)])
    return Scene(source)


def targets(vertices: np.ndarray, faces: np.ndarray, what: str, random: np.random.Generator) -> np.ndarray:
    """Random points of faces, edges or vertices, (ray, 3) float64."""
    weights = random.dirichlet((1.0, 1.0, 1.0), RAYS)
    if what == "edges":
        weights[:, 2] = 0.0
        weights /= weights.sum(axis=1, keepdims=True)
    elif what == "vertices":
        weights = np.eye(3)[random.integers(3, size=RAYS)]
    return np.einsum("rk,rkd->rd", weights, vertices[faces[random.integers(len(faces), size=RAYS)]])


def leaks(scene: Scene, origins: np.ndarray, aims: np.ndarray) -> int:
    """Count the rays from ``origins`` (ray, 3), float32, at ``aims``, (ray, 3), that hit nothing."""
    forward = aims - origins
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    # The shortest turn of -z to that direction.
    rotations = np.stack((1.0 - forward[:, 2], forward[:, 1], -forward[:, 0], np.zeros(RAYS)), axis=1)
    camera = scenes.own_camera(
        width=1, height=1, lens=wc.Pinhole(fovy=1.0), position=origins, rotation=rotations, outputs=("segmentation",)
    )
    return int((scenes.look(scene, camera)["segmentation"] != 0).sum())


@pytest.mark.parametrize(("mesh", "offset", "size", "what"), CASES)
def test_no_leak(device: wp.Device, mesh: str, offset: tuple, size: float, what: str) -> None:
    random = np.random.default_rng(7)
    points, faces = MESHES[mesh]
    vertices = (points * size + offset).astype(np.float32)  # as the device has them
    exact = vertices.astype(np.float64)
    inside = (np.array(offset) + size * random.uniform(-0.2, 0.2, (RAYS, 3))).astype(np.float32)
    inwards = scene_of(device, vertices, faces[:, ::-1])
    assert leaks(inwards, inside, targets(exact, faces, what, random)) == 0, "from the inside"

    # From outside, past what is aimed at, towards the middle.
    aims, middle = targets(exact, faces, what, random), np.array(offset)
    outside = (middle + 3.0 * (aims - middle) + size * random.uniform(-0.1, 0.1, (RAYS, 3))).astype(np.float32)
    assert leaks(scene_of(device, vertices, faces), outside, aims) == 0, "from the outside"


def test_a_hole_is_found(device: wp.Device) -> None:
    """The judge itself: one face of 5,120 is missing."""
    random = np.random.default_rng(7)
    vertices, faces = MESHES["icosphere"]
    inside = random.uniform(-0.2, 0.2, (RAYS, 3)).astype(np.float32)
    found = leaks(scene_of(device, vertices, faces[1:, ::-1]), inside, targets(vertices, faces, "points", random))
    assert 0 < found < 30


@pytest.mark.parametrize("distance", [6.0, 60.0, 600.0])
@pytest.mark.parametrize("size", [(1.0, 1.0), (1.0, 0.01), (0.05, 1.0)])
def test_no_leak_at_the_rim_of_a_cylinder(device: wp.Device, size: tuple[float, float], distance: float) -> None:
    """Rays to that half of a rim behind which the cap lies on the one side and the side on the other."""
    random, side = np.random.default_rng(7), 200
    radius, half = size
    eye = np.array((0.0, -0.8, 0.6), np.float32) * np.float32(distance)
    angle = random.uniform(-1.2, 1.2, (side, side))
    rim = np.stack((radius * np.sin(angle), -radius * np.cos(angle), np.full(angle.shape, half)), axis=-1)
    camera = scenes.own_camera(
        width=side, height=side, lens=wc.Rays(rim - eye), position=eye, outputs=("segmentation", "distance")
    )
    mjm = scenes.compile_xml(scenes.geom_xml("cylinder", size=size))
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)
    assert (seen["segmentation"] != 0).sum() == 0
    assert np.abs(seen["distance"][0] - np.linalg.norm(rim - eye, axis=-1)).max() < 2e-4 * (1.0 + distance * 0.1)


@pytest.mark.parametrize("distance", [2.0, 20.0, 200.0])
def test_no_leak_at_the_bottom_of_a_height_field(device: wp.Device, distance: float) -> None:
    """Rays to two edges of the base, from below."""
    random, side = np.random.default_rng(7), 200
    mjm = scenes.compile_xml(scenes.geom_xml("hfield"), assets=scenes.ASSETS)
    half_x, half_y, _, base = mjm.hfield_size[0]
    eye = np.array((-0.5, -0.7, -0.6), np.float32) * np.float32(distance)
    along, first = random.uniform(-1.0, 1.0, (side, side)), random.uniform(size=(side, side)) < 0.5
    x, y = np.where(first, along * half_x, -half_x), np.where(first, -half_y, along * half_y)
    edge = np.stack((x, y, np.full(along.shape, -base)), axis=-1)
    camera = scenes.own_camera(
        width=side, height=side, lens=wc.Rays(edge - eye), position=eye, outputs=("segmentation", "distance")
    )
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)
    assert (seen["segmentation"] != 0).sum() == 0
    assert np.abs(seen["distance"][0] - np.linalg.norm(edge - eye, axis=-1)).max() < 1e-4 * (1.0 + distance)
