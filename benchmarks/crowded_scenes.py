"""Scenes of many copies of thin things, in the manner of MuJoCo's own models: a crowd, cards, planks, bricks, a helix.

A shape covers a few pixels of their pictures or less than one, so that edges are most of what is seen.
"""

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from warpcam.benchmarks.procedural_scenes import color
from warpcam.benchmarks.scenes import GEOM, add_floor, add_sun, look_at

Floats = tuple[float, ...]
SKIN = (0.9, 0.6, 0.4, 1.0)
# Limbs of a standing figure: both ends [m], radius [m]. Those with y > 0 exist on both sides.
LIMBS: tuple[tuple[Floats, Floats, float], ...] = (
    ((0.0, 0.0, 1.5), (0.0, 0.0, 1.501), 0.09),
    ((0.0, -0.08, 1.28), (0.0, 0.08, 1.28), 0.07),
    ((0.0, -0.06, 1.02), (0.0, 0.06, 1.02), 0.09),
    ((0.0, 0.1, 0.9), (0.03, 0.1, 0.5), 0.06),
    ((0.03, 0.1, 0.5), (0.0, 0.1, 0.08), 0.045),
    ((-0.05, 0.1, 0.03), (0.14, 0.11, 0.03), 0.03),
    ((0.0, 0.17, 1.3), (0.12, 0.3, 1.08), 0.035),
    ((0.12, 0.3, 1.08), (0.3, 0.14, 1.2), 0.03),
)
CARD = (0.0315, 0.044, 0.0003)  # half of a card's size [m]
PLANK = (0.0585, 0.0117, 0.0039)  # half of a plank's size [m]
BRICK = (0.12, 0.057, 0.036)  # half of a brick's size [m]
JOINT = 0.006  # between bricks [m]


def turned(axis: Floats, angle: float) -> np.ndarray:
    """Quaternion wxyz of a turn by ``angle`` [rad]."""
    quaternion = np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, np.array(axis), angle)
    return quaternion


def add_box(
    spec: mujoco.MjSpec,
    center: Floats,
    half: Floats,
    rgba: Floats,
    quat: np.ndarray | Floats = (1.0, 0.0, 0.0, 0.0),
) -> None:
    spec.worldbody.add_geom(type=GEOM.mjGEOM_BOX, pos=center, size=half, quat=quat, rgba=rgba)


def begin() -> mujoco.MjSpec:
    """A floor under a light."""
    spec = mujoco.MjSpec()
    add_floor(spec)
    add_sun(spec)
    return spec


def crowd() -> mujoco.MjSpec:
    """A hundred figures of thirteen limbs in ten rings: a limb is two to four pixels wide."""
    spec = begin()
    for index in range(100):
        ring, place = divmod(index, 10)
        angle = 0.2 * np.pi * place + 0.3 * ring
        away = 1.2 + 0.5 * ring
        figure = spec.worldbody.add_body(
            pos=(away * np.cos(angle), away * np.sin(angle), 0.0), quat=turned((0.0, 0.0, 1.0), 7.0 * index)
        )
        for start, end, radius in LIMBS:
            for side in (1.0, -1.0) if start[1] > 0.0 else (1.0,):
                ends = (*np.multiply(start, (1, side, 1)), *np.multiply(end, (1, side, 1)))
                figure.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=ends, size=(radius, 0.0, 0.0), rgba=SKIN)
    look_at(spec, (-9.0, -8.0, 6.0), (0.0, 0.0, 0.6))
    return spec


def cards() -> mujoco.MjSpec:
    """A house of cards of three storeys beside a fanned stack of 40: a card seen edge-on is a quarter of a pixel."""
    spec = begin()
    lean, tall = 0.3, float(np.cos(0.3)) * CARD[1]
    apart = float(np.sin(lean)) * CARD[1]
    for storey in range(3):
        low = storey * (2.0 * tall + 4.0 * CARD[2])
        for tent in range(3 - storey):
            middle = (tent + 0.5 * storey) * 4.4 * apart
            for side in (-1.0, 1.0):
                center = (middle + side * apart, 0.0, low + tall)
                add_box(spec, center, (CARD[2], *CARD[:2]), color(tent + storey), turned((0.0, 1.0, 0.0), -side * lean))
            if tent:
                add_box(
                    spec, (middle - 2.2 * apart, 0.0, low + 2.0 * tall), (CARD[1], CARD[0], CARD[2]), color(storey + 3)
                )
    for index in range(40):
        quat = turned((0.0, 0.0, 1.0), 0.04 * index)
        add_box(spec, (0.02, -0.13, (2.4 * index + 1.0) * CARD[2]), CARD, color(index), quat)
    look_at(spec, (0.33, -0.5, 0.16), (0.06, -0.03, 0.05))
    return spec


def planks() -> mujoco.MjSpec:
    """A tower of planks in layers, open between them, and planks that stand on end around it."""
    spec = begin()
    for layer in range(28):
        across = layer % 2 == 1
        for side in (-1.0, 0.0, 1.0):
            aside = side * (PLANK[0] - PLANK[1])
            center = (aside if across else 0.0, 0.0 if across else aside, (2 * layer + 1) * PLANK[2])
            quat = turned((0.0, 0.0, 1.0), 0.5 * np.pi * across + 0.02 * layer)
            add_box(spec, center, PLANK, color(layer + int(side)), quat)
    for index in range(24):
        angle = np.pi * index / 12.0
        center = (0.16 * np.cos(angle), 0.16 * np.sin(angle), PLANK[0])
        add_box(spec, center, (PLANK[2], PLANK[1], PLANK[0]), color(index), turned((0.0, 0.0, 1.0), 3.0 * angle))
    look_at(spec, (0.75, -0.55, 0.35), (0.0, 0.0, 0.09))
    return spec


def bricks() -> mujoco.MjSpec:
    """A wall of 14 courses with joints of half a pixel, and bricks that lie about."""
    spec = begin()
    for course in range(14):
        high = course * (2.0 * BRICK[2] + JOINT) + BRICK[2]
        for place in range(10):
            along = (place - 5.0 + 0.5 * (course % 2)) * (2.0 * BRICK[0] + JOINT)
            add_box(spec, (along, 0.0, high), BRICK, (0.6 + 0.02 * (place % 4), 0.3, 0.2 + 0.02 * (course % 3), 1.0))
    for index in range(30):  # apart, as renderers do not agree which of two faces in one place is seen
        row, place = divmod(index, 10)
        center = (0.34 * (place - 4.5), -0.4 - 0.4 * row, BRICK[2])
        add_box(spec, center, BRICK, color(index), turned((0.0, 0.0, 1.0), 1.3 * index))
    look_at(spec, (1.8, -3.2, 1.4), (0.0, 0.0, 0.4))
    return spec


def helix() -> mujoco.MjSpec:
    """A stair of 240 thin steps, each a slab and a ball on a rod, around an axis."""
    spec = begin()
    for index in range(240):
        angle, high = 0.1 * index, 0.01 * index
        out = np.array((np.cos(angle), np.sin(angle), 0.0))
        quat = turned((0.0, 0.0, 1.0), angle)
        add_box(spec, tuple(0.7 * out + (0.0, 0.0, high)), (0.3, 0.03, 0.004), color(index // 5), quat)
        rod = (*(0.98 * out + (0.0, 0.0, high)), *(0.98 * out + (0.0, 0.0, high + 0.25)))
        spec.worldbody.add_geom(type=GEOM.mjGEOM_CYLINDER, fromto=rod, size=(0.006, 0.0, 0.0), rgba=color(3))
        top = tuple(0.98 * out + (0.0, 0.0, high + 0.26))
        spec.worldbody.add_geom(type=GEOM.mjGEOM_SPHERE, pos=top, size=(0.02, 0.0, 0.0), rgba=color(2))
    look_at(spec, (3.6, -3.0, 2.6), (0.0, 0.0, 1.15))
    return spec


SCENES: Mapping[str, Callable[[], mujoco.MjSpec]] = {
    "crowd": crowd,
    "cards": cards,
    "planks": planks,
    "bricks": bricks,
    "helix": helix,
}
