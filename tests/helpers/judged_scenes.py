"""Scenes that Mitsuba has rendered, as data: for our stages and for the script that made the references.

The camera stands at the origin and looks along -z; lengths are metres, radiance and colours linear, boxes are turned
about y. All lights are in front of it or behind it, never in its view unless they are shapes.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

SIZE = 64  # pixels
FOVY = 40.0  # degrees


@dataclass(frozen=True)
class Look:
    """A material: matt, a metal that reflects all, glass of an index, or a light."""

    color: tuple[float, float, float] = (0.7, 0.7, 0.7)
    kind: str = "matt"  # "metal", "glass"
    roughness: float = 0.0
    index: float = 1.5
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    texture: bool = False  # texture() in place of the colour


@dataclass(frozen=True)
class Ball:
    middle: tuple[float, float, float]
    radius: float
    look: Look = field(default_factory=Look)


@dataclass(frozen=True)
class Box:
    middle: tuple[float, float, float]
    half: tuple[float, float, float]
    turn: float = 0.0
    look: Look = field(default_factory=Look)


@dataclass(frozen=True)
class Faces:
    points: Any
    faces: Any
    look: Look = field(default_factory=Look)
    uvs: Any = None


@dataclass(frozen=True)
class Rectangle:
    """A light that shines along its -z, turned by angles about x, y and z one after the other."""

    middle: tuple[float, float, float]
    half: tuple[float, float]
    turn: tuple[float, float, float]
    radiance: tuple[float, float, float]


@dataclass(frozen=True)
class Point:
    middle: tuple[float, float, float]
    intensity: tuple[float, float, float]


@dataclass(frozen=True)
class Sun:
    toward: tuple[float, float, float]
    irradiance: float


@dataclass(frozen=True)
class Judged:
    shapes: tuple[Any, ...]
    lights: tuple[Any, ...] = ()
    sky: tuple[float, float, float] | None = None


def texture() -> np.ndarray:
    """(512, 512, 3) uint8, sRGB-coded: large texels, as we interpolate what is coded and Mitsuba what is decoded."""
    rows, columns = np.mgrid[:512, :512] // 32
    checks = (rows // 4 + columns // 4) % 2
    return np.stack((60 + 160 * checks, 200 - 8 * rows, 40 + 12 * columns), axis=-1).astype(np.uint8)


def quad(*corners: Any, look: Look | None = None, uvs: bool = False) -> Faces:
    around = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    return Faces(list(corners), [(0, 1, 2), (0, 2, 3)], look or Look(), around if uvs else None)


def room(floor: Look | None = None, textured: bool = False) -> tuple[Faces, ...]:
    """Walls, floor and ceiling around the view, and a wall behind it."""
    x, y, near, far = 1.5, 1.5, 1.0, -6.0
    a, b, c, d = (-x, -y, far), (x, -y, far), (x, y, far), (-x, y, far)
    e, f, g, h = (-x, -y, near), (x, -y, near), (x, y, near), (-x, y, near)
    return (
        quad(e, f, b, a, look=floor, uvs=textured),
        quad(d, c, g, h),
        quad(a, b, c, d),
        quad(e, a, d, h, look=Look((0.7, 0.15, 0.1))),
        quad(b, f, g, c, look=Look((0.15, 0.6, 0.15))),
        quad(f, e, h, g),
    )


def icosahedron(middle: Any, radius: float, look: Look) -> Faces:
    p = (1.0 + 5.0**0.5) / 2.0
    points = np.array([(-1, p, 0), (1, p, 0), (-1, -p, 0), (1, -p, 0), (0, -1, p), (0, 1, p), (0, -1, -p), (0, 1, -p),
                       (p, 0, -1), (p, 0, 1), (-p, 0, -1), (-p, 0, 1)], float)  # fmt: skip
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2),
             (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11),
             (6, 2, 10), (8, 6, 7), (9, 8, 1)]  # fmt: skip
    return Faces((points / np.linalg.norm(points[0]) * radius + middle).tolist(), faces, look)


# Mitsuba's lights are shapes, which hold light up; ours are not: a black plate does it for both.
PLATE = Box((0.0, 1.456, -3.5), (0.5, 0.005, 0.5), look=Look((0.0, 0.0, 0.0)))
WHITE, GREY = Look((0.75, 0.75, 0.75)), Look((0.4, 0.4, 0.4))
LAMP = Rectangle((0.0, 1.45, -3.5), (0.5, 0.5), (-90.0, 0.0, 0.0), (9.0, 8.0, 6.0))
TWO = (Box((-0.5, -0.9, -4.5), (0.4, 0.6, 0.4), 20.0, WHITE), Ball((0.6, -1.0, -3.8), 0.5, WHITE))

SCENES = {
    "boxes and a ball in a room": Judged((*room(), *TWO, PLATE), (LAMP,)),
    "textures, a point and a sun": Judged(
        (quad((-2, -1, 0), (2, -1, 0), (2, -1, -6), (-2, -1, -6), look=Look(texture=True), uvs=True),
         Ball((0.5, -0.5, -3.5), 0.5, GREY), Box((-0.6, -0.6, -4.0), (0.3, 0.4, 0.3), 35.0, WHITE)),
        (Point((1.0, 1.5, -2.0), (3.0, 3.0, 4.0)), Sun((-0.4, 1.0, 0.5), 1.5)),
    ),
    "metals under an even sky": Judged(
        (quad((-3, -1, 1), (3, -1, 1), (3, -1, -7), (-3, -1, -7), look=Look((0.6, 0.3, 0.2))),
         Ball((-0.6, -0.4, -3.8), 0.6, Look(kind="metal", roughness=0.2)),
         Box((0.7, -0.6, -3.6), (0.4, 0.4, 0.4), 30.0, Look(kind="metal", roughness=0.1))),
        sky=(0.8, 0.9, 1.0),
    ),
    "a glass ball under an even sky": Judged(
        (quad((-3, -1, 1), (3, -1, 1), (3, -1, -7), (-3, -1, -7), look=Look(texture=True), uvs=True),
         Ball((0.0, -0.3, -3.2), 0.7, Look((1.0, 1.0, 1.0), kind="glass"))),
        sky=(1.0, 0.9, 0.8),
    ),
    "rough glass under an even sky": Judged(
        (quad((-3, -1, 1), (3, -1, 1), (3, -1, -7), (-3, -1, -7), look=Look((0.2, 0.5, 0.3))),
         Ball((-0.6, -0.4, -3.4), 0.6, Look((1.0, 1.0, 1.0), kind="glass", roughness=0.5)),
         Box((0.7, -0.45, -3.6), (0.4, 0.5, 0.4), 30.0, Look((1.0, 1.0, 1.0), kind="glass", roughness=0.4))),
        sky=(1.0, 1.0, 1.0),
    ),
    "a mesh that shines in a room": Judged(
        (*room(), Box((-0.5, -0.9, -4.5), (0.4, 0.6, 0.4), 20.0, WHITE),
         icosahedron((0.4, 0.2, -4.0), 0.35, Look((0.0, 0.0, 0.0), emission=(3.0, 4.0, 5.0)))),
    ),
    "a box and a ball that shine in a room": Judged(
        (*room(), Box((-0.6, 0.5, -4.5), (0.3, 0.2, 0.3), 40.0, Look((0.0, 0.0, 0.0), emission=(4.0, 2.0, 1.0))),
         Ball((0.6, 0.3, -4.0), 0.3, Look((0.0, 0.0, 0.0), emission=(1.0, 2.0, 4.0))),
         Ball((0.2, -1.0, -3.8), 0.5, WHITE)),
    ),
    "a glass mesh and a mirror in a room": Judged(
        (*room(), icosahedron((0.5, -0.4, -3.6), 0.6, Look((1.0, 1.0, 1.0), kind="glass")),
         Box((-0.7, -0.5, -4.6), (0.5, 1.0, 0.1), 30.0, Look(kind="metal", roughness=0.1)),
         Ball((0.0, 1.0, -4.0), 0.3, Look((0.0, 0.0, 0.0), emission=(8.0, 8.0, 7.0)))),
    ),
    "a mesh and a ball under an even sky": Judged(
        (icosahedron((-0.5, 0.0, -3.5), 0.8, Look((0.8, 0.5, 0.2))), Ball((0.8, -0.2, -3.2), 0.5, GREY),
         quad((-3, -1, 1), (3, -1, 1), (3, -1, -7), (-3, -1, -7), look=GREY)),
        sky=(0.5, 0.7, 1.0),
    ),
}  # fmt: skip


def file_name(name: str) -> str:
    return name.replace(",", "").replace(" ", "_") + ".npy"
