"""Generated scenes to measure widely: as many for tuning as are only looked at in the end."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco

from warpcam.benchmarks.cases import Case
from warpcam.benchmarks.suite import outdoors, rooms, tabletops
from warpcam.benchmarks.suite.place import Place
from warpcam.benchmarks.suite.recipes import FAMILIES, Recipe, recipe_of, recipes_of


@dataclass(frozen=True)
class Builder:
    """Builder of a family's scenes.

    Attributes:
        build: Adds so many shapes to a place.
        extent: Size of its places [m], a power of two.
        scatter: How far free bodies are moved; see `Case`.
    """

    build: Callable[[Place, int], None]
    extent: float
    scatter: tuple[float, float] = (0.05, 0.5)


BUILDERS = {
    "pile": Builder(tabletops.pile, 2.0, (0.1, 3.0)),
    "table": Builder(tabletops.table, 2.0),
    "bin": Builder(tabletops.bin_of_parts, 2.0, (0.05, 3.0)),
    "arms": Builder(tabletops.arms, 2.0),
    "walkers": Builder(outdoors.walkers, 8.0, (0.1, 0.2)),
    "maze": Builder(outdoors.maze, 8.0),
    "store": Builder(outdoors.store, 16.0, (0.03, 0.2)),
    "kitchen": Builder(rooms.kitchen, 4.0),
    "flat": Builder(rooms.flat, 8.0),
    "garden": Builder(outdoors.garden, 16.0, (0.8, 0.3)),
    "statues": Builder(tabletops.statues, 4.0),
    "office": Builder(rooms.office, 8.0),
}
LARGE = 400  # shapes of a scene that is drawn in fewer worlds on a CPU


def build(seed: int) -> mujoco.MjSpec:
    """The scene of a seed."""
    recipe = recipe_of(seed)
    builder = BUILDERS[recipe.family]
    place = Place(recipe, builder.extent)
    builder.build(place, recipe.shapes)
    return place.spec


def case_of(recipe: Recipe) -> Case:
    about = next(family.about for family in FAMILIES if family.name == recipe.family)
    worlds = 2 if recipe.shapes > LARGE else 8
    scatter = BUILDERS[recipe.family].scatter
    return Case(recipe.name, about, partial(build, recipe.seed), ("view",), cpu_worlds=worlds, scatter=scatter)


def cases(half: str) -> list[Case]:
    """Cases of "tuning", "held-out" or "all"."""
    return [case_of(recipe) for recipe in recipes_of(half)]
