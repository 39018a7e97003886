"""Large scenes: walking robots, mazes, stores and gardens."""

from typing import Any

import numpy as np

from warpcam.benchmarks.scenes import GEOM
from warpcam.benchmarks.suite.place import Place


def add_walker(place: Place, pos: Any, yaw: float, eye: bool) -> None:
    """Add a walking robot: a trunk, a head and four legs of three joints each; with an eye also a camera."""
    trunk = place.body(place.world, pos, yaw)
    trunk.add_freejoint()
    look, dark = place.look(0.4), {"rgba": (0.2, 0.2, 0.22, 1.0)}
    place.box((0.0, 0.0, 0.0), (0.6, 0.25, 0.12), trunk, **look)
    place.add(trunk, GEOM.mjGEOM_ELLIPSOID, (0.12, 0.09, 0.08), (0.36, 0.0, 0.05), **look)
    place.bar((-0.25, 0.0, 0.09), (0.2, 0.0, 0.09), 0.03, trunk, **dark)
    for x, y in ((0.24, 0.16), (0.24, -0.16), (-0.24, 0.16), (-0.24, -0.16)):
        hip = place.hinged(trunk, (x, y, 0.0), (1, 0, 0), -0.3, 0.3)
        place.add(hip, GEOM.mjGEOM_CYLINDER, (0.05, 0.04), **dark)
        thigh = place.hinged(hip, (0.0, 0.0, 0.0), (0, 1, 0), 0.2, 1.2)
        place.bar((0.0, 0.0, 0.0), (0.0, 0.0, -0.26), 0.035, thigh, **look)
        shank = place.hinged(thigh, (0.0, 0.0, -0.26), (0, 1, 0), -1.8, -0.8)
        place.bar((0.0, 0.0, 0.0), (0.0, 0.0, -0.26), 0.022, shank, **dark)
        place.add(shank, GEOM.mjGEOM_SPHERE, (0.03,), (0.0, 0.0, -0.27), **dark)
    if eye:
        place.camera((-1.3, 0.0, 0.7), (0.6, 0.0, 0.1), 70.0, trunk)


def walkers(place: Place, count: int) -> None:
    """Robots and obstacles; the camera flies behind the first robot."""
    place.floor(15.0)
    place.light(6.0, 6.0)
    number = max(2, min(12, count // 30))
    for index in range(number):
        x, y = (0.0, 0.0) if index == 0 else (1.3 + 1.1 * (index // 3), 1.3 * (index % 3 - 1))
        add_walker(place, (x, y, 0.55), place.random.uniform(-0.3, 0.3), eye=index == 0)
    while place.count < count:
        x, y = place.random.uniform((-3.0, -4.0), (9.0, 4.0))
        if abs(y) > 0.8 or x > 1.0:
            place.primitive(place.world, place.random.uniform(0.1, 0.35), pos=(x, y, 0.12))


def maze(place: Place, count: int) -> None:
    """Walls on a grid with things between them; the camera drives about between the walls."""
    cells = int(np.clip(np.sqrt(0.6 * count), 5, 16))
    half = 0.5 * cells
    place.floor(half + 4.0)
    place.light(half, 3.5)
    look = [place.look(0.5) for _ in range(4)]
    for row in range(cells + 1):
        for column in range(cells):
            x, y = column - half + 0.5, row - half
            border, near = row in (0, cells), max(abs(x), abs(y)) < 1.2
            if border or (not near and place.random.uniform() < 0.4):
                place.box((x, y, 0.5), (1.0, 0.08, 1.0), **look[(row + column) % 4])
            if border or (not near and place.random.uniform() < 0.4):
                place.box((y, x, 0.5), (0.08, 1.0, 1.0), **look[(row + column) % 4])
    while place.count < count - 3:
        x, y = place.random.uniform(-half, half, 2)
        loose = place.random.uniform() < 0.15
        place.primitive(place.free((x, y, 0.15)) if loose else place.body(place.world, (x, y, 0.15)), 0.15)
    cart = place.sliding(place.world, (0.0, 0.0, 0.1), (1, 0, 0), -0.8, 0.8)
    cart = place.sliding(cart, (0.0, 0.0, 0.0), (0, 1, 0), -0.8, 0.8)
    cart = place.hinged(cart, (0.0, 0.0, 0.0), (0, 0, 1), -np.pi, np.pi)
    place.add(cart, GEOM.mjGEOM_CYLINDER, (0.18, 0.06))
    for side in (-1.0, 1.0):
        turned = {"quat": (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)}
        place.add(cart, GEOM.mjGEOM_CYLINDER, (0.09, 0.02), (0.0, 0.2 * side, 0.0), **turned)
    place.camera((-0.1, 0.0, 0.4), (1.0, 0.0, 0.25), 75.0, cart)


def store(place: Place, count: int) -> None:
    """Racks with boxes on shelves along aisles; the camera rides on a truck in the middle one."""
    racks = max(2, min(8, count // 250))
    bays = max(3, min(10, count // (racks * 45)))
    long, wide = 1.6 * bays, 3.0 * racks
    place.floor(max(long, wide))
    place.light(0.4 * wide, 6.5)
    frame = {"rgba": place.color()}
    each = max(1, (count - 12 - racks * bays * 10) // (racks * bays * 4))  # boxes of a shelf
    for rack in range(racks):
        y = 3.0 * (rack - 0.5 * (racks - 1))
        for bay in range(bays):
            x = 1.6 * (bay - 0.5 * (bays - 1))
            for side in (-0.45, 0.45):
                place.box((x - 0.8, y + side, 1.9), (0.08, 0.08, 3.8), **frame)
            for level in range(4):
                z = 0.15 + 1.0 * level
                place.box((x, y, z), (1.55, 1.0, 0.05), rgba=(0.6, 0.55, 0.45, 1.0))
                place.bar((x - 0.78, y - 0.48, z), (x + 0.78, y - 0.48, z), 0.04, **frame)
                for index in range(each):
                    if place.count >= count - 12:
                        break
                    add_parcel(place, (x - 0.65 + 1.3 * (index + 0.5) / each, y, z + 0.03), 1.3 / each)
    truck = place.sliding(place.world, (0.0, 1.5 if racks % 2 else 0.0, 0.0), (1, 0, 0), -0.4 * long, 0.4 * long)
    truck = place.hinged(truck, (0.0, 0.0, 0.0), (0, 0, 1), -0.8, 0.8)
    if racks % 2 == 0:
        place.box((0.0, 0.0, 0.0), (0.01, 0.01, 0.01), truck)
    place.box((0.0, 0.0, 0.45), (1.2, 0.8, 0.6), truck)
    place.box((0.6, 0.0, 1.1), (0.1, 0.7, 2.0), truck)
    for side in (-0.25, 0.25):
        place.box((1.1, side, 0.12), (1.0, 0.12, 0.06), truck)
        for along in (-0.4, 0.4):
            wheel = {"quat": (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)}
            place.add(truck, GEOM.mjGEOM_CYLINDER, (0.15, 0.06), (along, 1.6 * side, 0.15), **wheel)
    place.camera((0.75, 0.0, 2.0), (3.0, 0.2, 1.6), 75.0, truck)


def add_parcel(place: Place, pos: Any, room: float) -> None:
    """Add a box, a drum or a vase to a shelf; one of ten is loose."""
    x, y, z = pos
    body = place.free(pos) if place.random.uniform() < 0.1 else place.world
    base = np.zeros(3) if body is not place.world else np.array((x, y, z))
    kind = place.random.uniform()
    if kind < 0.75:
        size = place.random.uniform((0.6 * room, 0.4, 0.2), (0.95 * room, 0.9, 0.8))
        place.box(np.add(base, (0.0, 0.0, 0.5 * size[2])), size, body, **place.look(0.4))
    elif kind < 0.9:
        radius, half = min(0.4, 0.45 * room), place.random.uniform(0.1, 0.4)
        place.add(body, GEOM.mjGEOM_CYLINDER, (radius, half), np.add(base, (0.0, 0.0, half)))
    else:
        place.mesh(body, "vessel", base)


def garden(place: Place, count: int) -> None:
    """Trees, bushes and rocks on hills; the camera is a drone among them."""
    place.floor(16.0)
    place.light(6.0, 12.0)
    leaves = [{"rgba": (0.2 + 0.1 * k, 0.45 + 0.07 * k, 0.2, 1.0)} for k in range(4)]
    bark = {"rgba": (0.4, 0.3, 0.2, 1.0)}
    while place.count < count:
        x, y = place.random.uniform(-10.0, 10.0, 2)
        if max(abs(x), abs(y)) < 1.0:
            continue
        kind = place.random.uniform()
        if kind < 0.5:
            tall = place.random.uniform(1.2, 3.0)
            foot = (x, y, 0.0)
            swaying = kind < 0.1
            tree = place.hinged(place.world, foot, (1, 0, 0), -0.08, 0.08) if swaying else place.body(place.world, foot)
            place.bar((0.0, 0.0, -0.5), (0.0, 0.0, tall), 0.08, tree, **bark)
            for _ in range(int(place.random.integers(2, 6))):
                about = (*place.random.uniform(-0.45, 0.45, 2), tall + place.random.uniform(-0.3, 0.6))
                crown = leaves[int(place.random.integers(4))]
                place.primitive(tree, place.random.uniform(0.35, 0.7), GEOM.mjGEOM_ELLIPSOID, pos=about, **crown)
        elif kind < 0.7:
            bush = leaves[int(place.random.integers(4))]
            place.primitive(place.world, 0.4, GEOM.mjGEOM_ELLIPSOID, pos=(x, y, 0.15), **bush)
        elif kind < 0.9:
            place.mesh(place.body(place.world, (x, y, 0.1), place.random.uniform(0.0, 6.0)), "rock")
        else:
            place.primitive(place.free((x, y, 0.6)), 0.25)
    drone = place.free((0.0, 0.0, 2.6))
    place.camera((0.0, 0.0, 0.0), (5.0, 0.0, -1.2), 65.0, drone)
