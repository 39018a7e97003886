"""Sorting what a simulator keeps in one list over all worlds into a table of worlds and columns."""

from collections.abc import Sequence

import numpy as np

MOST_EMPTY = 8  # times as large as what it holds a table of names may be, but for small ones


def columns_of(worlds: np.ndarray, kinds: np.ndarray, num_worlds: int) -> tuple[np.ndarray, np.ndarray]:
    """Assign each element a column; all elements of a column have one kind.

    Worlds with the same kinds in the same order, as replicated ones are, have their elements in that order. Otherwise
    there are as many columns of each kind as the world with most of it needs. What is in all worlds (-1) has columns of
    its own.

    Args:
        worlds: (element,) int32; -1 is all worlds.
        kinds: (element,) int32; negative ones are left out.
        num_worlds: At least 1.

    Returns:
        ids: (world, column) int32, indices of elements; -1 where a world has none.
        kinds: (column,) int32.
    """
    elements = np.flatnonzero((worlds >= 0) & (kinds >= 0))
    shared = np.flatnonzero((worlds < 0) & (kinds >= 0))
    order = elements[np.argsort(worlds[elements], kind="stable")]
    counts = np.bincount(worlds[order], minlength=num_worlds) if len(order) else np.zeros(num_worlds, np.int64)
    table, of_column = None, np.zeros(0, np.int32)
    if counts.min() == counts.max():
        table = order.reshape(num_worlds, -1)
        of_column = kinds[table[0]]
        if not (kinds[table] == of_column).all():
            table = None
    if table is None:
        keys = worlds[order].astype(np.int64) * (int(kinds.max()) + 1) + kinds[order]
        by_kind = np.argsort(keys, kind="stable")
        order, keys = order[by_kind], keys[by_kind]
        starts = np.flatnonzero(np.concatenate(([True], keys[1:] != keys[:-1])))
        rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.append(starts, len(order))))
        widths = np.zeros(int(kinds.max()) + 1, np.int64)
        np.maximum.at(widths, kinds[order], rank + 1)
        first = np.concatenate(([0], np.cumsum(widths)[:-1]))
        table = np.full((num_worlds, int(widths.sum())), -1, np.int64)
        table[worlds[order], first[kinds[order]] + rank] = order
        of_column = np.repeat(np.arange(len(widths)), widths)
    split = int(np.searchsorted(shared, order.min())) if len(order) else len(shared)
    before, after = shared[:split], shared[split:]
    rows = [np.broadcast_to(part, (num_worlds, len(part))) for part in (before, after)]
    ids = np.concatenate((rows[0], table, rows[1]), axis=1)
    return ids.astype(np.int32), np.concatenate((kinds[before], of_column, kinds[after])).astype(np.int32)


def places_of(worlds: np.ndarray, labels: Sequence[str], num_worlds: int) -> tuple[np.ndarray, list[str], np.ndarray]:
    """Assign each body a column; all bodies of a column have one name.

    A body's name is its label less the path that all labels of its world begin with, or less as many parts of it in all
    worlds, whichever makes fewer names. Should names tell little, as when each world has its own, bodies stand in their
    order.

    Returns:
        ids: (world, column) int32, indices of bodies; -1 where a world has none.
        names: Of the columns.
        places: (body,) int32, its column.
    """
    count = len(labels)
    order = np.argsort(worlds, kind="stable")
    numbers = np.bincount(worlds + 1, minlength=num_worlds + 1)
    ends = np.cumsum(numbers)
    blocks = [order[end - number : end] for end, number in zip(ends, numbers, strict=True)]
    names = _names_of(labels, blocks)
    ranks = np.zeros(count, np.int64)
    keys: dict[tuple[str, int, bool], int] = {}
    by_name = np.zeros(count, np.int64)
    for world, bodies in enumerate(blocks, -1):
        seen: dict[str, int] = {}
        for rank, body in enumerate(bodies):
            name, ranks[body] = names[body], rank
            occurrence = seen[name] = seen.get(name, -1) + 1
            by_name[body] = keys.setdefault((name, occurrence, world < 0), len(keys))
    most = int(numbers[1:].max()) + int(numbers[0])
    if len(keys) * num_worlds <= MOST_EMPTY * count + 2**16:
        places, titles = by_name, [name for name, _, _ in keys]
    else:
        places = np.where(worlds < 0, int(numbers[1:].max()) + ranks, ranks)
        titles = [""] * most
        for body in reversed(range(count)):
            titles[places[body]] = names[body]
    ids = np.full((num_worlds, len(titles)), -1, np.int32)
    local = worlds >= 0
    bodies = np.arange(count)
    ids[worlds[local], places[local]] = bodies[local]
    ids[:, places[~local]] = bodies[~local]
    return ids, titles, places.astype(np.int32)


def _names_of(labels: Sequence[str], blocks: Sequence[np.ndarray]) -> list[str]:
    """Names of bodies; the first of the blocks is that of bodies in all worlds, each other one a world's."""
    names, depths = [""] * len(labels), set()
    for number, bodies in enumerate(blocks):
        cut = _common_path([labels[body] for body in bodies])
        for body in bodies:
            names[body] = labels[body][cut:]
        if number and len(bodies):
            depths.add(labels[bodies[0]].count("/", 0, cut))
    if len(depths) <= 1:
        return names
    even, least = list(names), min(depths)
    for bodies in blocks[1:]:
        for body in bodies:
            even[body] = labels[body].split("/", least)[least]
    return even if len(set(even)) < len(set(names)) else names


def _common_path(labels: Sequence[str]) -> int:
    """Length of the path, up to a slash, that all labels begin with."""
    if not labels:
        return 0
    low, high = min(labels), max(labels)
    same = next((i for i, (a, b) in enumerate(zip(low, high, strict=False)) if a != b), min(len(low), len(high)))
    return low.rfind("/", 0, same) + 1
