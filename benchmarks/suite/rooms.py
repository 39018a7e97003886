"""Rooms with walls: kitchens, flats and offices, in which nine of ten shapes never move."""

from typing import Any

import numpy as np

from warpcam.benchmarks.scenes import GEOM
from warpcam.benchmarks.suite.place import Place
from warpcam.benchmarks.suite.tabletops import add_table, add_ware

DEEP, WIDE, TALL, PANEL = 0.6, 0.6, 0.9, 0.02  # a base cabinet, and its panels [m]
HIGH = 2.6  # walls [m]
LOOSE = 0.1  # largest fraction of shapes that move


class Room:
    """A room of walls, and the shapes in it that move so far."""

    def __init__(self, place: Place, half: tuple[float, float]) -> None:
        self.place, self.half, self.moving = place, half, 0
        x, y = half
        walls = ((-x, 0.0, 0.1, 2.0 * y), (x, 0.0, 0.1, 2.0 * y), (0.0, -y, 2.0 * x, 0.1), (0.0, y, 2.0 * x, 0.1))
        look = place.look(0.3)
        for px, py, wide, deep in walls:
            place.box((px, py, 0.5 * HIGH), (wide, deep, HIGH), **look)
            place.box((px * 0.985, py * 0.985, 0.05), (wide, deep, 0.1), rgba=(0.9, 0.9, 0.88, 1.0))

        if place.recipe.light != "sun":
            place.box((0.0, 0.0, HIGH + 0.05), (2.0 * x, 2.0 * y, 0.1), rgba=(0.85, 0.85, 0.83, 1.0))

    def may_move(self, shapes: int) -> bool:
        """Return True if so many shapes more may move, and count them."""
        enough = self.moving + shapes <= LOOSE * self.place.recipe.shapes
        self.moving += shapes if enough else 0
        return enough


def add_handle(place: Place, body: Any, center: Any, along: Any) -> None:
    """Add a bar on two posts in front (+y) of a place, on a body or the world."""
    center, along, out = np.array(center), np.array(along), np.array((0.0, 0.03, 0.0))
    steel = {"rgba": (0.7, 0.7, 0.72, 1.0)}
    place.bar(center + out - along, center + out + along, 0.006, body, **steel)
    for side in (-0.8, 0.8):
        place.bar(center + side * along, center + out + side * along, 0.004, body, **steel)


def add_cabinet(room: Room, pos: Any, yaw: float, size: tuple[float, float, float], drawers: int, inside: int) -> None:
    """Add a cabinet that opens to its +y: panels, a door or drawers with handles, and ware on its shelf."""
    place = room.place
    wide, deep, tall = size
    case, look, front = place.body(place.world, pos, yaw), place.look(0.2), place.look(0.3)
    place.box((0.0, 0.0, 0.5 * PANEL), (wide, deep, PANEL), case, **look)
    place.box((0.0, 0.0, tall - 0.5 * PANEL), (wide, deep, PANEL), case, **look)
    place.box((0.0, -0.5 * deep, 0.5 * tall), (wide, PANEL, tall), case, **look)
    for side in (-0.5, 0.5):
        place.box((side * (wide - PANEL), 0.0, 0.5 * tall), (PANEL, deep, tall), case, **look)
    face = 0.5 * deep + 0.5 * PANEL
    for index in range(drawers):
        high = (tall - 0.04) / drawers
        at = (0.0, face, 0.02 + high * (index + 0.5))
        body = place.sliding(case, at, (0, 1, 0), 0.0, 0.4) if room.may_move(6) else place.body(case, at)
        place.box((0.0, 0.0, 0.0), (wide - 0.01, PANEL, high - 0.01), body, **front)
        place.box((0.0, -0.5 * deep, -0.3 * high), (wide - 0.06, 0.9 * deep, 0.01), body, **look)
        place.box((0.0, -0.9 * deep, 0.0), (wide - 0.06, 0.01, 0.6 * high), body, **look)
        add_handle(place, body, (0.0, 0.5 * PANEL, 0.0), (0.08, 0.0, 0.0))
    if not drawers:
        place.box((0.0, 0.0, 0.5 * tall), (wide - 2.0 * PANEL, 0.9 * deep, PANEL), case, **look)
        add_row(room, case, (0.0, 0.0, 0.5 * tall + PANEL), 0.8 * wide, inside)
        at = (-0.5 * wide, face, 0.5 * tall)
        door = place.hinged(case, at, (0, 0, 1), 0.0, 1.6) if room.may_move(4) else place.body(case, at)
        place.box((0.5 * wide, 0.0, 0.0), (wide - 0.01, PANEL, tall - 0.01), door, **front)
        add_handle(place, door, (0.9 * wide, 0.5 * PANEL, 0.0), (0.0, 0.0, 0.08))


def add_row(room: Room, body: Any, pos: Any, wide: float, number: int) -> None:
    """Add a row of cups, jars, books and dishes, of one shape each."""
    place = room.place
    for index in range(number):
        x = pos[0] - 0.5 * wide + wide * (index + 0.5) / number
        half = min(0.06, 0.42 * wide / number)
        kind = int(place.random.integers(5))
        tall = place.random.uniform(0.03, 0.12)
        if kind == 0:
            place.mesh(body, "vessel", (x, pos[1], pos[2]))
        elif kind == 1:
            place.mesh(body, "dish", (x, pos[1], pos[2]))
        elif kind == 2:
            place.add(body, GEOM.mjGEOM_CYLINDER, (half, tall), (x, pos[1], pos[2] + tall))
        else:
            place.box((x, pos[1], pos[2] + tall), (1.6 * half, 0.15, 2.0 * tall), body)


def add_tiles(place: Place, wall: float, low: float, start: float, end: float, number: int) -> None:
    """Add about so many tiles to a wall at +y."""
    rows = max(1, round(np.sqrt(number / 6.0)))
    columns = max(1, number // rows)
    looks = [place.look(0.4) for _ in range(3)]
    step, high = (end - start) / columns, 0.55 / rows
    for row in range(rows):
        for column in range(columns):
            at = (start + step * (column + 0.5), wall, low + high * (row + 0.5))
            place.box(at, (0.94 * step, 0.012, 0.94 * high), **looks[int(place.random.integers(3))])


def add_stove(place: Place, x: float, y: float) -> None:
    """Add a stove with plates, knobs, an oven of bars and a hood."""
    steel, black = {"rgba": (0.65, 0.66, 0.68, 1.0)}, {"rgba": (0.1, 0.1, 0.11, 1.0)}
    place.box((x, y, 0.45), (WIDE, DEEP, TALL), **steel)
    place.box((x, y - 0.31, 0.4), (0.5, 0.02, 0.45), **black)
    for dx, dy in ((-0.14, -0.12), (0.14, -0.12), (-0.14, 0.12), (0.14, 0.12)):
        place.add(place.world, GEOM.mjGEOM_CYLINDER, (0.09, 0.006), (x + dx, y + dy, TALL + 0.006), **black)
    for index in range(6):
        knob = place.hinged(place.world, (x - 0.22 + 0.088 * index, y - 0.33, 0.8), (0, 1, 0), -1.5, 1.5)
        turned = {"quat": (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)}
        place.add(knob, GEOM.mjGEOM_CYLINDER, (0.02, 0.02), **turned, **black)
    for index in range(10):
        place.bar((x - 0.22, y - 0.25 + 0.05 * index, 0.4), (x + 0.22, y - 0.25 + 0.05 * index, 0.4), 0.004, **steel)
    place.box((x, y + 0.05, 1.75), (WIDE, 0.5, 0.12), **steel)
    place.box((x, y + 0.15, 2.15), (0.25, 0.25, 0.7), **steel)


def add_chair(place: Place, pos: Any, yaw: float) -> None:
    chair, look = place.body(place.world, pos, yaw), place.look(0.4)
    place.box((0.0, 0.0, 0.45), (0.42, 0.42, 0.04), chair, **look)
    place.box((0.0, 0.2, 0.75), (0.4, 0.03, 0.35), chair, **look)
    for x, y in ((-0.18, -0.18), (-0.18, 0.18), (0.18, -0.18), (0.18, 0.18)):
        place.bar((x, y, 0.02), (x, y, 0.43), 0.018, chair, **look)


def furnish_kitchen(room: Room, count: int) -> None:
    """Put cabinets along the wall at +y, and a table with ware in front of it; tiles and ware make up the number."""
    place, (x_half, y_half) = room.place, room.half
    columns = int((2.0 * x_half - 0.3) / WIDE)
    stove, back = columns // 2, y_half - 0.05 - 0.5 * DEEP
    inside = int(np.clip((count - 200) / (2.5 * columns), 2, 16))
    xs = [WIDE * (column - 0.5 * (columns - 1)) for column in range(columns)]
    for column, x in enumerate(xs):
        if column == stove:
            add_stove(place, x, back)
            continue
        drawers = int(place.random.choice((0, 0, 3, 4)))
        add_cabinet(room, (x, back, 0.0), np.pi, (WIDE, DEEP, TALL), drawers, inside)
        add_cabinet(room, (x, back + 0.12, 1.5), np.pi, (WIDE, 0.36, 0.8), 0, inside)
        place.box((x, back - 0.01, TALL + 0.02), (WIDE, DEEP + 0.02, 0.04), **place.look(0.2))
    add_table(place, (0.0, -0.2), (1.4, 0.8))
    for x, y, yaw in ((-0.4, -0.8, np.pi), (0.4, -0.8, np.pi), (-0.4, 0.45, 0.0), (0.4, 0.45, 0.0)):
        add_chair(place, (x, y, 0.0), yaw)
    for index in range(14):
        x, y = place.random.uniform((-0.6, -0.5), (0.6, 0.1))
        z = 0.76
        if index % 2:
            x, y, z = xs[int(place.random.integers(columns))], back + place.random.uniform(-0.2, 0.2), TALL + 0.05
        add_ware(place, (x, y, z), loose=room.may_move(3))
    left = max(0, count - place.count)
    add_tiles(place, y_half - 0.056, TALL + 0.03, -x_half + 0.1, x_half - 0.1, min(left, 240))
    level = 0
    while place.count < count:  # open shelves on the other walls
        side, row = level % 2, level // 2 % 5
        x, y = (-1.0, 1.0)[side] * (x_half - 0.2), -y_half + 0.8 + 1.1 * (level // 10 % 4)
        shelf = place.body(place.world, (x, y, 0.6 + 0.4 * row), 0.5 * np.pi)
        place.box((0.0, 0.0, 0.0), (1.0, 0.25, 0.02), shelf)
        add_row(room, shelf, (0.0, 0.12 * (level // 40 % 2) - 0.03, 0.01), 0.95, min(16, max(1, count - place.count)))
        level += 1


def kitchen(place: Place, count: int) -> None:
    half = (2.0 + 0.0005 * count, 1.9)
    room = Room(place, half)
    place.floor(max(half))
    place.light(0.7 * half[1], 2.5)
    furnish_kitchen(room, count)
    place.camera((-0.7 * half[0], -1.6, 1.75), (0.3, 1.2, 0.9), 65.0)


def flat(place: Place, count: int) -> None:
    """A kitchen and, beyond a wall with a doorway, a living room with shelves of books; the camera is on a robot."""
    half = (4.0, 4.5)
    room = Room(place, half)
    place.floor(max(half))
    place.light(3.0, 2.5)
    for x in (-2.4, 2.4):
        place.box((x, -1.4, 0.5 * HIGH), (3.2, 0.1, HIGH))
    furnish_kitchen(room, round(0.7 * count))
    level = 0
    while place.count < count - 60:
        x, y, row = -3.2 + 1.05 * (level % 7), -half[1] + 0.2, level // 7 % 6
        shelf = place.body(place.world, (x, y + 0.26 * (level // 42), 0.25 + 0.36 * row))
        place.box((0.0, 0.0, 0.0), (1.0, 0.25, 0.02), shelf)
        add_row(room, shelf, (0.0, 0.0, 0.01), 0.95, 14)
        level += 1
    for x in (-2.5, 2.5):
        add_table(place, (x, -2.6), (0.9, 0.5), 0.45)
        place.box((x, -3.3, 0.25), (1.6, 0.7, 0.4))
        place.box((x, -3.6, 0.6), (1.6, 0.15, 0.5))
    while place.count < count - 4:
        loose = room.may_move(3)
        add_ware(place, (*place.random.uniform((-3.5, -3.0), (3.5, -2.0)), 0.05), loose)
    robot = place.sliding(place.world, (0.0, -1.1, 0.0), (1, 0, 0), -0.5, 0.5)
    robot.quat = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))  # towards +y
    robot = place.hinged(robot, (0.0, 0.0, 0.0), (0, 0, 1), -1.4, 1.4)
    place.add(robot, GEOM.mjGEOM_CYLINDER, (0.22, 0.15), (0.0, 0.0, 0.18))
    place.bar((0.0, 0.0, 0.3), (0.0, 0.0, 1.25), 0.04, robot)
    place.box((0.0, 0.0, 1.3), (0.12, 0.2, 0.12), robot)
    place.camera((0.1, 0.0, 1.35), (2.0, 0.0, 1.1), 75.0, robot)


def office(place: Place, count: int) -> None:
    """Rows of desks with screens, keys and ware; the camera hangs in a corner."""
    desks = int(np.clip(count // 45, 4, 20))
    columns = int(np.ceil(np.sqrt(desks)))
    half = (0.9 * columns + 0.8, 0.9 * columns + 0.8)
    room = Room(place, half)
    place.floor(max(half))
    place.light(0.8 * half[0], 2.5)
    middles = []
    for index in range(desks):
        row, column = divmod(index, columns)
        x, y = 1.8 * (column - 0.5 * (columns - 1)), 1.8 * (row - 0.5 * (columns - 1))
        middles.append((x, y))
        add_table(place, (x, y), (1.4, 0.7))
        swivel = place.hinged(place.world, (x, y - 0.6, 0.0), (0, 0, 1), -0.7, 0.7) if room.may_move(5) else place.world
        at = np.zeros(3) if swivel is not place.world else np.array((x, y - 0.6, 0.0))
        place.add(swivel, GEOM.mjGEOM_CYLINDER, (0.22, 0.03), np.add(at, (0.0, 0.0, 0.45)))
        place.add(swivel, GEOM.mjGEOM_CYLINDER, (0.03, 0.2), np.add(at, (0.0, 0.0, 0.22)))
        place.box(np.add(at, (0.0, -0.2, 0.75)), (0.4, 0.05, 0.5), swivel)
        for leg in range(2):
            place.box(np.add(at, (0.0, 0.0, 0.03)), ((0.5, 0.06), (0.06, 0.5))[leg] + (0.04,), swivel)
        for side in (-0.3, 0.3):
            place.box((x + side, y + 0.2, 1.05), (0.5, 0.03, 0.32), rgba=(0.08, 0.08, 0.1, 1.0))
            place.box((x + side, y + 0.22, 0.84), (0.06, 0.03, 0.14), rgba=(0.3, 0.3, 0.3, 1.0))
        for key in range(min(30, max(0, count // desks - 26))):
            at_key = (x - 0.2 + 0.04 * (key % 10), y - 0.15 - 0.04 * (key // 10), 0.76)
            place.box(at_key, (0.035, 0.035, 0.015), rgba=(0.85, 0.85, 0.85, 1.0))
    while place.count < count:
        offset = place.random.uniform((-0.6, -0.25), (0.6, 0.1))
        x, y = np.add(middles[int(place.random.integers(desks))], offset)
        add_ware(place, (x, y, 0.77), loose=room.may_move(3))
    place.camera((-half[0] + 0.3, -half[1] + 0.3, 2.3), (0.3, 0.3, 0.6), 70.0)
