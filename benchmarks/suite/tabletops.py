"""Small scenes: piles, tables, bins, arms at benches and statues."""

from typing import Any

import numpy as np

from warpcam.benchmarks.scenes import GEOM
from warpcam.benchmarks.suite.place import Place

TABLE = 0.75  # height of tables and benches [m]


def pile(place: Place, count: int) -> None:
    """Loose primitives, the more the higher they lie; the scene's camera looks at them from a side."""
    side = 0.14 * count ** (1.0 / 3.0)
    place.floor(8.0)
    place.light(2.0, 4.0)
    while place.count < count:
        x, y = place.random.normal(0.0, side, 2)
        z = place.random.uniform(0.1, 0.1 + 2.0 * side * np.exp(-(x * x + y * y) / (2.0 * side * side)))
        place.primitive(place.free((x, y, z)), 0.12)
    place.around(2.6 * side + 0.6, 1.6 * side + 0.3, (0.0, 0.0, 0.5 * side))


def add_table(place: Place, center: Any, size: tuple[float, float], height: float = TABLE) -> None:
    """Add a top on four legs."""
    x, y = center
    look = place.look(0.3)
    place.box((x, y, height - 0.02), (*size, 0.04), **look)
    for sx, sy in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)):
        foot = (x + sx * (size[0] - 0.1), y + sy * (size[1] - 0.1), 0.5 * height - 0.02)
        place.add(place.world, GEOM.mjGEOM_CYLINDER, (0.025, 0.5 * height - 0.02), foot, **look)


def add_ware(place: Place, pos: Any, loose: bool) -> None:
    """Add a household thing of one to three shapes."""
    body = place.free(pos) if loose else place.body(place.world, pos, place.random.uniform(-np.pi, np.pi))
    kind = place.random.choice(("dish", "vessel", "rock", "mug", "block", "primitive"))
    if kind == "mug":
        look = place.look()
        place.add(body, GEOM.mjGEOM_CYLINDER, (0.04, 0.05), (0.0, 0.0, 0.05), **look)
        place.bar((0.04, 0.0, 0.075), (0.07, 0.0, 0.06), 0.007, body, **look)
        place.bar((0.07, 0.0, 0.06), (0.04, 0.0, 0.025), 0.007, body, **look)
    elif kind == "block":
        place.box((0.0, 0.0, 0.05), place.random.uniform(0.05, 0.16, 3), body)
    elif kind == "primitive":
        place.primitive(body, 0.05, pos=(0.0, 0.0, 0.04))
    else:
        place.mesh(body, str(kind), (0.0, 0.0, 0.08 if kind == "rock" else 0.0))


def table(place: Place, count: int) -> None:
    place.floor(5.0)
    place.light(1.5, 2.6)
    add_table(place, (0.0, 0.0), (1.6, 0.9))
    while place.count < count:
        x, y = place.random.uniform((-0.72, -0.38), (0.72, 0.38))
        add_ware(place, (x, y, TABLE + 0.03), loose=place.random.uniform() < 0.8)
    place.around(1.25, 0.75, (0.0, 0.0, TABLE))


def bin_of_parts(place: Place, count: int) -> None:
    """An open bin on a table with parts in it, and the camera above."""
    place.floor(4.0)
    place.light(0.8, 2.4)
    add_table(place, (0.0, 0.0), (1.2, 0.9))
    look = place.look()
    place.box((0.0, 0.0, TABLE + 0.01), (0.7, 0.5, 0.02), **look)
    for x, y, wide, deep in ((-0.35, 0, 0.02, 0.5), (0.35, 0, 0.02, 0.5), (0, -0.25, 0.7, 0.02), (0, 0.25, 0.7, 0.02)):
        place.box((x, y, TABLE + 0.11), (wide, deep, 0.2), **look)
    while place.count < count:
        x, y, z = place.random.uniform((-0.27, -0.17, 0.05), (0.27, 0.17, 0.2))
        body = place.free((x, y, TABLE + z))
        kind = place.random.choice(("rock", "dish", "vessel", "primitive"))
        if kind == "primitive":
            place.primitive(body, 0.05)
        else:
            place.mesh(body, str(kind))
    place.camera((0.05, -0.1, TABLE + 0.85), (0.0, 0.0, TABLE + 0.1), 50.0)


def add_arm(place: Place, pos: Any, yaw: float, eye: bool) -> None:
    """Add an arm of six joints with a gripper, its links meshes between capsules and cylinders."""
    link = place.body(place.world, pos, yaw)
    look, dark = place.look(0.2), {"rgba": (0.15, 0.15, 0.17, 1.0)}
    place.add(link, GEOM.mjGEOM_CYLINDER, (0.09, 0.05), (0.0, 0.0, 0.05), **dark)
    lengths = (0.15, 0.32, 0.28, 0.12, 0.1, 0.05)
    axes = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1))
    # At rest the hand points down in front of the arm.
    rest = (0.0, 0.5, 1.6, 0.0, 0.9, 0.0)
    reach = (1.4, 0.5, 0.5, 0.6, 0.5, 3.0)
    start = 0.1
    for number, (length, axis) in enumerate(zip(lengths, axes, strict=True)):
        link = place.hinged(link, (0.0, 0.0, start), axis, -reach[number], reach[number])
        link.quat = (np.cos(0.5 * rest[number]), 0.0, np.sin(0.5 * rest[number]), 0.0)
        place.add(link, GEOM.mjGEOM_SPHERE, (0.055 - 0.005 * number,), **dark)
        if length > 0.11:
            place.bar((0.0, 0.0, 0.03), (0.0, 0.0, length - 0.03), 0.045 - 0.004 * number, link, **look)
            place.mesh(link, "vessel", **look)
        start = length
    place.box((0.0, 0.0, 0.06), (0.05, 0.12, 0.04), link, **dark)
    for side in (-1.0, 1.0):
        finger = place.sliding(link, (0.0, 0.02 * side, 0.08), (0, side, 0), 0.0, 0.035)
        place.box((0.0, 0.0, 0.04), (0.02, 0.012, 0.08), finger, **look)
    if eye:
        place.camera((0.11, 0.0, -0.12), (0.04, 0.0, 0.35), 75.0, link)


def arms(place: Place, count: int) -> None:
    """Arms at a bench with parts; the camera sits on the hand of the first."""
    place.floor(6.0)
    place.light(1.5, 3.0)
    place.box((0.0, 0.0, TABLE - 0.03), (2.0, 1.0, 0.06))
    place.box((0.0, 0.52, 0.9), (2.0, 0.04, 1.8))
    for x in (-0.9, 0.9):
        place.box((x, 0.0, 0.36), (0.08, 0.9, 0.72))
    add_arm(place, (-0.45, -0.15, TABLE), 0.0, eye=True)
    if count > 100:
        add_arm(place, (0.75, -0.15, TABLE), np.pi, eye=False)
    while place.count < count:
        x, y = place.random.uniform((-0.3, -0.45), (0.5, 0.25))
        add_ware(place, (x, y, TABLE + 0.01), loose=place.random.uniform() < 0.7)


def statues(place: Place, count: int) -> None:
    """Dense meshes on pedestals that turn, and small things among them."""
    place.floor(10.0)
    place.light(3.0, 5.0)
    number = max(4, count // 5)
    for index in range(number):
        angle, radius = 2.4 * index, 0.55 * np.sqrt(index + 0.3)
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        place.box((x, y, 0.2), (0.4, 0.4, 0.4))
        body = place.hinged(place.world, (x, y, 0.4), (0, 0, 1), -3.0, 3.0)
        place.mesh(body, "statue")
    while place.count < count:
        x, y = place.random.uniform(-1.0, 1.0, 2) * 0.6 * np.sqrt(number)
        place.mesh(place.free((x, y, 0.12)), str(place.random.choice(("rock", "vessel"))))
    place.around(0.9 * np.sqrt(number) + 0.6, 1.4, (0.0, 0.0, 0.55))
