"""Which shapes are which instance, in each world."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.scene.scene import Scene

Grouping = Literal["body", "shape", "instance", "semantic"]
OUTPUT_OF: dict[str, str] = {
    "body": "bodies",
    "shape": "segmentation",
    "instance": "instances",
    "semantic": "semantics",
}
NONE = -1  # in place of the id of an instance that a world lacks


@dataclass(frozen=True, eq=False)
class Instances:
    """Instances of all worlds; rows are those of worlds, or one row is that of all.

    Attributes:
        output: Name of the image that has their ids.
        ids: (row, instance) int32, ascending in each row; those that a world lacks are NONE, and come last.
        places: (row, shape) int32, which of these each shape belongs to, or -1.
        frame_bodies: (row, instance) int32, the body whose frame an instance has, or -1.
        frame_shapes: (row, instance) int32, the shape whose frame it has, or -1. Where both are -1 it has the world's.
    """

    output: str
    ids: np.ndarray
    places: np.ndarray
    frame_bodies: np.ndarray
    frame_shapes: np.ndarray

    def members(self, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Those of some shapes that belong to each instance.

        Returns:
            Shapes, (row, place) int32, instance after instance, and the place of each instance's first one and the
            end, (row, instance + 1) int32.
        """
        rows, count = self.ids.shape
        places = self.places[:, shapes]
        keys = np.where(places < 0, count, places)
        order = np.argsort(keys, axis=1, kind="stable")
        sizes = np.zeros((rows, count + 1), np.int32)
        np.add.at(sizes, (np.arange(rows)[:, None], keys), 1)
        starts = np.zeros((rows, count + 1), np.int32)
        np.cumsum(sizes[:, :-1], axis=1, out=starts[:, 1:])
        columns = np.asarray(shapes, np.int32)[order]
        return (columns if len(shapes) else np.zeros((rows, 1), np.int32)), starts


def find_instances(scene: Scene, by: Any, ids: Any) -> Instances:
    """The instances of a scene.

    Args:
        scene: Whose shapes they are of.
        by: What an instance is: a key of ``OUTPUT_OF``.
        ids: Those to take alone; None is all.

    Raises:
        WarpcamError: An argument is not allowed, or there is no instance.
    """
    if not isinstance(by, str) or by not in OUTPUT_OF:
        raise WarpcamError(f"labels: by must be one of {', '.join(map(repr, OUTPUT_OF))}, got {by!r}")
    shown = scene.description().ids_of_shapes(OUTPUT_OF[by])
    bodies = scene.shape_bodies()
    shapes = scene.tables().shapes.drawn.numpy()
    rows = max(len(shown), len(bodies))
    shown, bodies = (np.broadcast_to(table, (rows, table.shape[1])) for table in (shown, bodies))
    drawn = np.zeros(shown.shape, bool)
    drawn[:, shapes] = True
    drawn &= (shown != NONE) & (bodies != -2)
    if by == "semantic":
        drawn &= shown != 0
    known = np.unique(shown[drawn])
    if ids is not None:
        known = _chosen(ids, by, known)
        drawn &= np.isin(shown, known)
    if not known.size:
        raise WarpcamError(f"labels: by={by!r}: no shape of the scene is part of such an instance")
    found = [np.unique(own[there]) for own, there in zip(shown, drawn, strict=True)]
    count = max(map(len, found))
    numbers = np.full((rows, count), NONE, np.int32)
    places = np.full(shown.shape, -1, np.int32)
    for row, own in enumerate(found):
        numbers[row, : len(own)] = own
        places[row, drawn[row]] = np.searchsorted(own, shown[row, drawn[row]])
    return Instances(OUTPUT_OF[by], numbers, places, *_frames(places, bodies, count, by == "shape"))


def _frames(places: np.ndarray, bodies: np.ndarray, count: int, by_shape: bool) -> tuple[np.ndarray, np.ndarray]:
    """Body and shape whose frame each instance has, (row, instance): the only one that it is of."""
    row, column = np.nonzero(places >= 0)
    at = row, places[row, column]
    found = []
    for owners in (bodies[row, column], column):
        least, most = np.full((len(places), count), np.iinfo(np.int32).max), np.full((len(places), count), -1)
        np.minimum.at(least, at, owners)
        np.maximum.at(most, at, owners)
        found.append(np.where(least == most, most, -1).astype(np.int32))
    of_bodies, of_shapes = found
    if not by_shape:
        return of_bodies, np.full_like(of_shapes, -1)
    return np.where(of_shapes >= 0, -1, of_bodies).astype(np.int32), of_shapes


def _chosen(ids: Any, by: str, known: np.ndarray) -> np.ndarray:
    is_list = isinstance(ids, Sequence | np.ndarray) and not isinstance(ids, str)
    numbers = np.asarray(ids) if is_list else np.zeros(())
    if numbers.ndim != 1 or numbers.dtype.kind not in "iu" or not numbers.size:
        raise WarpcamError(f"labels: ids must be whole numbers, (n,) with n >= 1, or None, got {ids!r}")
    missing = np.setdiff1d(numbers, known)
    if missing.size:
        some = ", ".join(map(str, known[:20])) + (", ..." if len(known) > 20 else "")
        raise WarpcamError(f"labels: ids has {missing[0]}; by={by!r} there are {some or 'none'}")
    return np.unique(numbers).astype(np.int32)
