"""Distractors: a pool of things that follows from the seed, of which each sample shows some."""

from dataclasses import dataclass

import numpy as np

from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.random_numbers import any_rotation, apart, generator
from warpcam.datasets.generate.recipes import Distractors

ROOT = "/WarpcamDistractors"  # of their paths in scenes of files
SPARE = 64  # things of a pool beyond those that a sample may have, at most


@dataclass(frozen=True, eq=False)
class Thing:
    """One of a pool: kind of shape, and three sizes [m], of which the kind reads what it needs."""

    kind: str
    size: np.ndarray


class DistractorPool:
    """Things of a plan.

    Attributes:
        things: All that there are.
        paths: Path of each in scenes of files.
    """

    def __init__(self, plan: Plan, recipe: Distractors):
        self._plan, self._recipe = plan, recipe
        random = generator(plan.seed, 0, "distractor shapes")
        count = min(4 * recipe.count[1], recipe.count[1] + SPARE)
        self.things = [
            Thing(recipe.shapes[int(random.integers(len(recipe.shapes)))], random.uniform(*recipe.size, 3))
            for _ in range(count)
        ]
        self.paths = [f"{ROOT}/thing{number}" for number in range(count)]

    def chosen(self, sample: int) -> np.ndarray:
        """Numbers of the things that a sample has."""
        random, (low, high) = generator(self._plan.seed, sample, "distractors"), self._recipe.count
        return random.permutation(len(self.things))[: int(random.integers(low, high + 1))]

    def poses(self, sample: int, taken: list[np.ndarray]) -> dict[int, np.ndarray]:
        """Poses of these, position [m] and quaternion w x y z, (7,), away from ``taken``, to which they are added."""
        random = generator(self._plan.seed, sample, "distractor poses")
        low, high = np.array(self._recipe.low), np.array(self._recipe.high)
        found = {}
        for number in self.chosen(sample):
            position = apart(random, low, high, taken, self._plan.recipes.spacing)
            taken.append(position)
            found[int(number)] = np.concatenate((position, any_rotation(random)))
        return found

    def colors(self, sample: int) -> np.ndarray:
        """Colours of all, (thing, 4) float32; those that the sample lacks are transparent."""
        chosen, colors = self.chosen(sample), np.zeros((len(self.things), 4), np.float32)
        colors[chosen, :3] = generator(self._plan.seed, sample, "distractor colours").uniform(
            0.05, 0.95, (len(chosen), 3)
        )
        colors[chosen, 3] = 1.0
        return colors
