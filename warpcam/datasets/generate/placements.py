"""Poses of things that recipes place."""

from collections.abc import Sequence

import numpy as np

from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.random_numbers import any_rotation, apart, generator, yaw
from warpcam.datasets.generate.recipes import Placement


def placed(
    plan: Plan, sample: int, things: Sequence[tuple[str, Placement, np.ndarray]], taken: list[np.ndarray]
) -> dict[str, np.ndarray]:
    """Poses of a sample, by name: position [m] and quaternion w x y z, (7,).

    Args:
        plan: Whose seed and spacing count.
        sample: Its number.
        things: Name, recipe, and rotation that "keep" keeps, w x y z.
        taken: Positions from which others keep away; those of the things are added.
    """
    poses = {}
    for name, recipe, kept in things:
        random = generator(plan.seed, sample, f"pose {name}")
        position = apart(random, np.array(recipe.low), np.array(recipe.high), taken, plan.recipes.spacing)
        taken.append(position)
        rotation = kept
        if recipe.rotation != "keep":
            rotation = any_rotation(random) if recipe.rotation == "any" else yaw(random)
        poses[name] = np.concatenate((position, rotation))
    return poses
