"""Scenes made here from nothing but numbers, and the ones that sweeps make larger and larger."""

import mujoco
import numpy as np

from warpcam.benchmarks.scenes import GEOM, add_checkered, add_floor, add_hills, add_sun, facing, look_at

COLORS = ((0.85, 0.3, 0.25), (0.25, 0.55, 0.8), (0.9, 0.7, 0.25), (0.35, 0.65, 0.4), (0.6, 0.45, 0.75))
# Kinds of small bodies, with sizes of about the same volume [m].
SMALL = (
    (GEOM.mjGEOM_SPHERE, (0.18, 0.0, 0.0)),
    (GEOM.mjGEOM_BOX, (0.16, 0.16, 0.16)),
    (GEOM.mjGEOM_CAPSULE, (0.1, 0.15, 0.0)),
    (GEOM.mjGEOM_CYLINDER, (0.14, 0.15, 0.0)),
)


def color(index: int) -> tuple[float, float, float, float]:
    return (*COLORS[index % len(COLORS)], 1.0)


def add_small(spec: mujoco.MjSpec, position: np.ndarray, kind: int, scale: float = 1.0, free: bool = True) -> None:
    """Add a body of one small shape."""
    body = spec.worldbody.add_body(pos=position)
    if free:
        body.add_freejoint()
    shape, size = SMALL[kind % len(SMALL)]
    body.add_geom(type=shape, size=scale * np.array(size), rgba=color(kind // len(SMALL) + kind))


def shapes(count: int) -> mujoco.MjSpec:
    """`count` shapes in a square grid over a checkered plane under one light; the camera sees all of them.

    Not more than 256 of them are free: a simulator's own tables grow with the square of that.
    """
    spec = mujoco.MjSpec()
    add_floor(spec)
    add_sun(spec)
    side = int(np.ceil(np.sqrt(count)))
    spacing = 12.8 / max(side, 4)
    random = np.random.default_rng(0)
    for index in range(count):
        row, column = divmod(index, side)
        grid = spacing * (np.array((column, row)) - 0.5 * (side - 1))
        position = np.array((*grid, random.uniform(0.3, 0.7)))
        add_small(spec, position, index, scale=spacing / 0.8, free=index % (1 + (count - 1) // 256) == 0)
    look_at(spec, (9.0, 9.0, 6.0), (0.0, 0.0, 0.0))
    return spec


def shapes_256() -> mujoco.MjSpec:
    return shapes(256)


def lights(count: int) -> mujoco.MjSpec:
    """64 shapes under `count` spot lights that all cast shadows."""
    spec = shapes(64)
    for light in list(spec.lights):
        spec.delete(light)
    for index in range(count):
        angle = 2.0 * np.pi * index / count
        position = np.array((5.0 * np.cos(angle), 5.0 * np.sin(angle), 6.0))
        diffuse = np.full(3, 0.8 / count)
        spec.worldbody.add_light(pos=position, dir=-position, diffuse=diffuse, cutoff=60.0, castshadow=True)
    return spec


def ball_of(faces: int) -> mujoco.MjSpec:
    """One bumpy ball of about `faces` triangles, seen whole, turned in each world."""
    rings = max(3, round(np.sqrt(faces / 4.0)))
    around = 2 * rings
    polar, azimuth = np.meshgrid(np.linspace(0.0, np.pi, rings + 1)[1:-1], np.arange(around) * 2.0 * np.pi / around)
    polar, azimuth = polar.T.ravel(), azimuth.T.ravel()
    radius = 0.4 + 0.03 * np.sin(9.0 * polar) * np.sin(11.0 * azimuth)
    points = np.stack((np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)), axis=1)
    points = np.vstack((radius[:, None] * points, (0.0, 0.0, 0.4), (0.0, 0.0, -0.4)))
    ring, step = np.meshgrid(np.arange(rings - 2), np.arange(around), indexing="ij")
    a, b = ring * around + step, ring * around + (step + 1) % around
    c, d = a + around, b + around
    first, last = np.arange(around), (rings - 2) * around + np.arange(around)
    top, bottom = np.full(around, len(points) - 2), np.full(around, len(points) - 1)
    triangles = [(a, c, b), (b, c, d), (top, first, np.roll(first, -1)), (bottom, np.roll(last, -1), last)]
    indices = np.concatenate([np.stack([corner.ravel() for corner in corners], axis=1) for corners in triangles])
    spec = mujoco.MjSpec()
    shell = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.add_mesh(name="ball", uservert=points.ravel(), userface=indices.ravel(), inertia=shell)
    body = spec.worldbody.add_body(pos=(0.0, 0.0, 0.5), mass=1.0, inertia=(1.0, 1.0, 1.0), explicitinertial=True)
    body.add_freejoint()
    body.add_geom(type=GEOM.mjGEOM_MESH, meshname="ball", contype=0, conaffinity=0, mass=0.0, rgba=color(0))
    add_floor(spec)
    add_sun(spec)
    look_at(spec, (1.2, -0.9, 0.9), (0.0, 0.0, 0.5))
    return spec


def quadruped() -> mujoco.MjSpec:
    """A walking robot: a trunk and four legs of cylinders, capsules, boxes and spheres, 29 geoms, on a plane."""
    spec = mujoco.MjSpec()
    add_floor(spec)
    add_sun(spec)
    trunk = spec.worldbody.add_body(name="trunk", pos=(0.0, 0.0, 0.55))
    trunk.add_freejoint()
    lying = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)
    trunk.add_geom(type=GEOM.mjGEOM_CYLINDER, size=(0.1, 0.35, 0.0), quat=lying, rgba=color(0))
    trunk.add_geom(type=GEOM.mjGEOM_BOX, size=(0.2, 0.12, 0.05), pos=(0.0, 0.0, 0.08), rgba=color(1))
    trunk.add_geom(type=GEOM.mjGEOM_ELLIPSOID, size=(0.1, 0.07, 0.06), pos=(0.42, 0.0, 0.05), rgba=color(2))
    trunk.add_geom(type=GEOM.mjGEOM_SPHERE, size=(0.03, 0.0, 0.0), pos=(0.5, 0.0, 0.08), rgba=color(3))
    for index, (x, y) in enumerate(((0.3, 0.1), (0.3, -0.1), (-0.3, 0.1), (-0.3, -0.1))):
        side = np.sign(y)
        hip = trunk.add_body(name=f"hip{index}", pos=(x, y, 0.0))
        hip.add_joint(axis=(1, 0, 0), range=(-0.4, 0.4), limited=True)
        hip.add_geom(type=GEOM.mjGEOM_CYLINDER, size=(0.045, 0.03, 0.0), quat=lying, rgba=color(1))
        hip.add_geom(type=GEOM.mjGEOM_SPHERE, size=(0.045, 0.0, 0.0), pos=(0.0, 0.05 * side, 0.0), rgba=color(2))
        thigh = hip.add_body(name=f"thigh{index}", pos=(0.0, 0.08 * side, 0.0))
        thigh.add_joint(axis=(0, 1, 0), range=(0.0, 1.2), limited=True)
        thigh.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(0, 0, 0, 0, 0, -0.25), size=(0.03, 0, 0), rgba=color(3))
        shank = thigh.add_body(name=f"shank{index}", pos=(0.0, 0.0, -0.25))
        shank.add_joint(axis=(0, 1, 0), range=(-1.8, -0.4), limited=True)
        shank.add_geom(type=GEOM.mjGEOM_CYLINDER, fromto=(0, 0, 0, 0, 0, -0.25), size=(0.02, 0, 0), rgba=color(4))
        shank.add_geom(type=GEOM.mjGEOM_BOX, size=(0.03, 0.03, 0.03), rgba=color(0))
        shank.add_geom(type=GEOM.mjGEOM_SPHERE, size=(0.03, 0.0, 0.0), pos=(0.0, 0.0, -0.26), rgba=color(1))
    look_at(spec, (1.4, 1.4, 0.9), (0.0, 0.0, 0.4))
    return spec


def room() -> mujoco.MjSpec:
    """A furnished room of 1,000 geoms under three lights: tables, chairs, shelves of books, and 60 loose things."""
    spec = mujoco.MjSpec()
    random = np.random.default_rng(0)
    wood = add_checkered(spec, "wood", (0.5, 0.35, 0.2), (0.55, 0.4, 0.25), 4.0)
    add_floor(spec)

    def add_box(center: tuple[float, ...], half: tuple[float, ...], **look: object) -> None:
        spec.worldbody.add_geom(type=GEOM.mjGEOM_BOX, pos=center, size=half, **look)

    walls = ((-5.0, 0.0, 0.05, 4.0), (5.0, 0.0, 0.05, 4.0), (0.0, -4.0, 5.0, 0.05), (0.0, 4.0, 5.0, 0.05))
    for x, y, across, along in walls:
        add_box((x, y, 1.4), (across, along, 1.4), rgba=(0.85, 0.85, 0.8, 1.0))
    for x, y in ((x, y) for x in (-3.0, -1.0, 1.0, 3.0) for y in (-1.5, 0.5, 2.5)):
        add_box((x, y, 0.72), (0.6, 0.4, 0.02), material=wood)
        for dx, dy in ((0.55, 0.35), (0.55, -0.35), (-0.55, 0.35), (-0.55, -0.35)):
            leg = (x + dx, y + dy, 0.35)
            spec.worldbody.add_geom(type=GEOM.mjGEOM_CYLINDER, pos=leg, size=(0.025, 0.35, 0.0), rgba=color(1))
        for sx in (-0.3, 0.3):
            add_box((x + sx, y - 0.7, 0.42), (0.2, 0.2, 0.02), material=wood)
            add_box((x + sx, y - 0.88, 0.65), (0.2, 0.02, 0.2), rgba=color(0))
            for tx, ty in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                add_box((x + sx + 0.17 * tx, y - 0.7 + 0.17 * ty, 0.2), (0.02, 0.02, 0.2), rgba=color(3))
    loose = 60
    shelf = 0
    while len(spec.geoms) < 1000 - loose:  # shelves of books along the walls, until there are enough
        wall, place = divmod(shelf, 40)
        level, column = divmod(place, 8)
        x, y, z = -4.4 + 1.2 * column, (3.8, -3.8)[wall], 0.3 + 0.45 * level
        add_box((x, y, z), (0.55, 0.14, 0.012), material=wood)
        for book in range(9):
            if len(spec.geoms) == 1000 - loose:
                break
            tall = random.uniform(0.1, 0.17)
            center = (x - 0.48 + 0.12 * book, y, z + 0.012 + tall)
            add_box(center, (random.uniform(0.02, 0.055), 0.1, tall), rgba=color(int(random.integers(5))))
        shelf += 1
    for index in range(loose):
        add_small(spec, random.uniform((-4.0, -3.0, 0.9), (4.0, 3.2, 1.6)), index, scale=0.5)
    add_sun(spec)
    for x in (-2.5, 2.5):
        spec.worldbody.add_light(pos=(x, 0.0, 2.7), dir=(0.0, 0.0, -1.0), diffuse=(0.4, 0.4, 0.35), cutoff=70.0)
    look_at(spec, (4.7, -3.6, 2.5), (-1.0, 1.0, 0.5))
    return spec


def terrain() -> mujoco.MjSpec:
    """A height field of 256 x 256 cells with boulders on it, seen from a flying camera that moves over it."""
    spec = mujoco.MjSpec()
    add_hills(spec, 257, seed=1)
    add_sun(spec)
    random = np.random.default_rng(1)
    for index in range(12):
        x, y = random.uniform(-4.0, 4.0, 2)
        add_small(spec, np.array((x, y, 0.5)), index, scale=1.5)
    position = (6.0, -6.0, 3.5)
    drone = spec.worldbody.add_body(pos=position, mass=1.0, inertia=(1.0, 1.0, 1.0), explicitinertial=True)
    drone.add_freejoint()
    drone.add_camera(name="drone", quat=facing(position, (0.0, 0.0, 0.0)), fovy=60.0)
    return spec
