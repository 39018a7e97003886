"""Groups that the shapes of a Newton model belong to, and the user's labels for them."""

import logging
from typing import Any

import newton
import numpy as np

from warpcam.scene.validation import check_semantics


def read_labels(
    model: newton.Model, ids: np.ndarray, bodies: np.ndarray, semantics: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Instances and semantics of what stands in the worlds' columns, (world or 1, column) int32.

    Args:
        model: Read once.
        ids: (world, column) int32, shapes; negative ones are none.
        bodies: (world, column) int32, their bodies, or -1.
        semantics: Number of each label, or None.
    """
    of_body = np.full(model.body_count + 1, -1, np.int32)
    if model.joint_count:
        articulations = model.joint_articulation.numpy()
        tree = articulations >= 0  # a joint that closes a loop is of none
        of_body[model.joint_child.numpy()[tree]] = articulations[tree]
    of_body[-1] = -1
    instances = of_body[bodies]
    numbers = LabelIds(semantics)
    if not numbers:
        return instances, np.zeros((1, ids.shape[1]), np.int32)
    marks = np.zeros(model.shape_count + 1, np.int32)
    known: dict[tuple[str, ...], int] = {}
    own = np.concatenate((model.shape_body.numpy(), [-1])) if model.shape_count else np.full(1, -1)
    for shape, label in enumerate(model.shape_label):
        body = own[shape]
        articulation = of_body[body]
        labels = (
            label,
            model.body_label[body] if body >= 0 else "",
            model.articulation_label[articulation] if articulation >= 0 else "",
        )
        if labels not in known:
            found = [numbers.find(each) for each in labels]
            known[labels] = next((number for number in found if number is not None), 0)
        marks[shape] = known[labels]
    if numbers.idle:
        names = ", ".join(map(repr, numbers.idle))
        logging.getLogger("warpcam").warning("from_newton: semantics has names that no shape is part of: %s", names)
    return instances, marks[np.where(ids >= 0, ids, -1)]


class LabelIds:
    """Numbers by label, where a label is some of the parts of a path in their order."""

    def __init__(self, semantics: Any):
        numbers = {} if semantics is None else check_semantics(semantics)
        self._numbers = {tuple(name.strip("/").split("/")): number for name, number in numbers.items()}
        self._lengths = sorted({len(key) for key in self._numbers}, reverse=True)
        self._found: set[tuple[str, ...]] = set()

    def __bool__(self) -> bool:
        return bool(self._numbers)

    @property
    def idle(self) -> list[str]:
        """The labels that no path has had yet."""
        return ["/".join(key) for key in self._numbers if key not in self._found]

    def find(self, path: str) -> int | None:
        """Return the number of the label that ends last in a path; of several, the longest."""
        parts, first = path.strip("/").split("/"), None
        for end in range(len(parts), 0, -1):
            for length in self._lengths:
                key = tuple(parts[max(end - length, 0) : end])
                if key in self._numbers:
                    self._found.add(key)
                    first = self._numbers[key] if first is None else first
                    if len(self._found) == len(self._numbers):  # there is no other to be heard of
                        return first
        return first
