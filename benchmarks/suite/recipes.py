"""Recipes of the generated scenes: everything that tells them apart, drawn from their seeds."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from warpcam.core.errors import WarpcamError


@dataclass(frozen=True)
class Family:
    """A kind of place.

    Attributes:
        shapes: Least and largest number of shapes.
        faces: Least and largest number of faces of a mesh.
        floors: Kinds of floor that it can have; see `FLOORS`.
        lights: Numbers of lights that it can have.
    """

    name: str
    about: str
    shapes: tuple[int, int]
    faces: tuple[int, int]
    floors: tuple[str, ...]
    lights: tuple[int, ...]


@dataclass(frozen=True)
class Recipe:
    """A scene.

    Attributes:
        half: "tuning" or "held-out".
        shapes: About how many shapes.
        faces: About how many faces a mesh has.
        textures: Fraction of shapes with a texture.
        light: Kind of lights: "sun" and lamps, "lamps" (spots) or "bulbs" (points).
        casting: How many of the lights cast shadows.
    """

    seed: int
    family: str
    half: str
    shapes: int
    faces: int
    floor: str
    textures: float
    light: str
    lights: int
    casting: int
    colored_lights: bool

    @property
    def name(self) -> str:
        return f"{self.family}_{self.seed:02d}"


FLOORS = tuple(f"{where}-{how}" for where in ("finite", "infinite") for how in ("grey", "colored", "textured"))
FEW, SOME, MANY = (0, 1, 1, 2), (1, 2, 2, 4), (2, 4, 4, 8)
FAMILIES = (
    Family("pile", "loose primitives on the ground", (20, 250), (500, 500), FLOORS, FEW),
    Family("table", "table with clutter", (30, 150), (300, 3000), (*FLOORS, "none"), SOME),
    Family("bin", "bin of loose parts, seen from above", (20, 120), (300, 6000), (*FLOORS, "none"), FEW),
    Family("arms", "arms at a bench, seen from a hand", (40, 300), (1000, 10000), (*FLOORS, "none"), SOME),
    Family("walkers", "walking robots, seen from one of them", (30, 250), (500, 500), (*FLOORS, "hills"), SOME),
    Family("maze", "walls and a wheeled robot with a camera between them", (60, 800), (500, 500), FLOORS, SOME),
    Family("store", "racks of boxes, seen from an aisle", (400, 3000), (300, 1000), FLOORS, MANY),
    Family("kitchen", "kitchen with doors, drawers and dishes", (500, 2000), (300, 2000), FLOORS[:3], SOME),
    Family("flat", "kitchen and living room", (2000, 5000), (300, 1000), FLOORS[:3], MANY),
    Family("garden", "trees and rocks on hills, seen from a drone", (100, 1000), (300, 2000), ("hills",), FEW),
    Family("statues", "dense meshes", (20, 60), (2000, 60000), (*FLOORS, "none"), SOME),
    Family("office", "desks, chairs and screens", (200, 1500), (300, 1000), FLOORS[:3], MANY),
)
# Each family has as many seeds in either half. The seeds of a half do not change: results of it are compared.
HALVES = ("tuning", "held-out")
SEEDS_PER_HALF = 2
SEEDS = range(len(FAMILIES) * len(HALVES) * SEEDS_PER_HALF)


def half_of(seed: int) -> str:
    return HALVES[seed // len(FAMILIES) % len(HALVES)]


@cache
def recipe_of(seed: int) -> Recipe:
    family = FAMILIES[seed % len(FAMILIES)]
    rank = seed // (len(FAMILIES) * len(HALVES))  # among the family's seeds of the half: one has few shapes, one many
    random = np.random.default_rng((3, seed))

    def between(low: int, high: int) -> int:
        place = (rank + random.uniform()) / SEEDS_PER_HALF
        return round(low * (high / low) ** place)

    lights = int(random.choice(family.lights))
    return Recipe(
        seed=seed,
        family=family.name,
        half=half_of(seed),
        shapes=between(*family.shapes),
        faces=between(*family.faces),
        floor=str(random.choice(family.floors)),
        textures=float(random.choice((0.0, 0.3, 0.9))),
        light=str(random.choice(("sun", "sun", "lamps", "bulbs"))),
        lights=lights,
        casting=lights if random.uniform() < 0.6 else (lights + 1) // 2,
        colored_lights=bool(random.uniform() < 0.4),
    )


def recipes_of(half: str) -> list[Recipe]:
    """Recipes of a half, or of "all"."""
    if half not in (*HALVES, "all"):
        raise WarpcamError(f"--suite: {half!r} came, known are: {', '.join((*HALVES, 'all'))}")
    return [recipe_of(seed) for seed in SEEDS if half in ("all", half_of(seed))]
