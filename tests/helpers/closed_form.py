"""Intersections of rays with solids, by the textbook, in float64: the judge of test_closed_form.py.

Every function takes origins and directions (..., 3) in the solid's frame and returns t, (...), inf where the ray
does not enter, and the outward normal there, (..., 3).
"""

import numpy as np

Entry = tuple[np.ndarray, np.ndarray]


def halfspaces(o: np.ndarray, d: np.ndarray, normals: np.ndarray, offsets: np.ndarray) -> Entry:
    """The convex solid of all p with normals @ p <= offsets."""
    speed, gap = d @ normals.T, offsets - o @ normals.T
    with np.errstate(divide="ignore", invalid="ignore"):
        t = gap / speed
    enters = np.where(speed < 0.0, t, -np.inf)
    leaves = np.where(speed > 0.0, t, np.inf)
    leaves = np.where((speed == 0.0) & (gap < 0.0), -np.inf, leaves)
    which, enter = enters.argmax(axis=-1), enters.max(axis=-1)
    hit = (enter <= leaves.min(axis=-1)) & (enter > 0.0)
    return np.where(hit, enter, np.inf), normals[which]


def box(o: np.ndarray, d: np.ndarray, half: np.ndarray) -> Entry:
    """Half extents ``half``, (3,)."""
    return halfspaces(o, d, np.concatenate((np.eye(3), -np.eye(3))), np.concatenate((half, half)))


def ramp(o: np.ndarray, d: np.ndarray, size: np.ndarray) -> Entry:
    """A height field that rises evenly from 0 at -x to full height at +x; ``size`` is (x, y, height, base)."""
    x, y, top, base = size
    slope = np.array((-0.5 * top / x, 0.0, 1.0))
    normals = np.concatenate((np.eye(3)[:2], -np.eye(3), [slope / np.linalg.norm(slope)]))
    return halfspaces(o, d, normals, np.array((x, y, x, y, base, 0.5 * top / np.linalg.norm(slope))))


def ellipsoid(o: np.ndarray, d: np.ndarray, half: np.ndarray) -> Entry:
    """Half extents ``half``, (3,)."""
    t = _first_root(o / half, d / half)
    at = _at(o, d, t) / half**2
    return t, _unit(at)


def plane(o: np.ndarray, d: np.ndarray, half: np.ndarray) -> Entry:
    """z = 0 seen from above; half widths, 0 is infinite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -o[..., 2] / d[..., 2]
    at = np.abs(_at(o, d, t))
    limits = np.where(half[:2] > 0.0, half[:2], np.inf)
    hit = (d[..., 2] < 0.0) & (t > 0.0) & (at[..., :2] <= limits).all(axis=-1)
    return np.where(hit, t, np.inf), np.broadcast_to((0.0, 0.0, 1.0), d.shape)


def tube(o: np.ndarray, d: np.ndarray, radius: float, half: float) -> Entry:
    """The side of a cylinder about z, without caps."""
    flat = np.array((1.0, 1.0, 0.0))
    t = _first_root(o * flat / radius, d * flat / radius)
    at = _at(o, d, t)
    hit = np.abs(at[..., 2]) <= half
    return np.where(hit, t, np.inf), _unit(at * flat)


def cylinder(o: np.ndarray, d: np.ndarray, radius: float, half: float) -> Entry:
    """Radius and half length along z."""
    entries = [tube(o, d, radius, half)]
    for side in (1.0, -1.0):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (side * half - o[..., 2]) / d[..., 2]
        at = _at(o, d, t)
        hit = (d[..., 2] * side < 0.0) & (t > 0.0) & (at[..., 0] ** 2 + at[..., 1] ** 2 <= radius**2)
        entries.append((np.where(hit, t, np.inf), np.broadcast_to((0.0, 0.0, side), d.shape)))
    return _nearest(entries)


def capsule(o: np.ndarray, d: np.ndarray, radius: float, half: float) -> Entry:
    """Radius and half length of the straight part, along z."""
    entries = [tube(o, d, radius, half)]
    for side in (1.0, -1.0):
        end = np.array((0.0, 0.0, side * half))
        entries.append(ellipsoid(o - end, d, np.full(3, radius)))
    return _nearest(entries)


def cone(o: np.ndarray, d: np.ndarray, radius: float, half: float) -> Entry:
    """About z, its tip at +half."""
    slope = 0.5 * radius / half
    w, dw = slope * (half - o[..., 2]), -slope * d[..., 2]
    a, b = (d[..., :2] ** 2).sum(-1) - dw**2, (o[..., :2] * d[..., :2]).sum(-1) - w * dw
    c = (o[..., :2] ** 2).sum(-1) - w**2
    square = b * b - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (-b - np.sqrt(np.maximum(square, 0.0))) / a
        cap = (-half - o[..., 2]) / d[..., 2]
    at = o + t[..., None] * d
    on_side = (square >= 0.0) & (t > 0.0) & (np.abs(at[..., 2]) <= half)
    around = at / np.maximum(np.linalg.norm(at[..., :2], axis=-1, keepdims=True), 1e-12)
    normal = np.stack((around[..., 0], around[..., 1], np.full(t.shape, slope)), axis=-1) / np.hypot(1.0, slope)
    base = o + cap[..., None] * d
    on_cap = (d[..., 2] > 0.0) & (cap > 0.0) & ((base[..., :2] ** 2).sum(-1) <= radius**2)
    return _nearest(
        [(np.where(on_side, t, np.inf), normal), (np.where(on_cap, cap, np.inf), np.array((0.0, 0.0, -1.0)))]
    )


def barrel(o: np.ndarray, d: np.ndarray, radius: float, half: float, arc: float) -> Entry:
    """A cylinder about z whose side is bent outwards in an arc, by steps along the ray and bisection."""
    around = np.hypot(radius + arc - np.sqrt(arc**2 - half**2), half)  # a ball, in which all of it lies
    o, square = np.broadcast_to(o, d.shape), (d * d).sum(-1)
    closest = -(o * d).sum(-1) / square
    inwards = around**2 - np.square(o + closest[..., None] * d).sum(-1)
    near = inwards > 0.0
    reach = np.sqrt(inwards[near] / square[near])
    t, normal = np.full(near.shape, np.inf), np.tile((0.0, 0.0, 1.0), (*near.shape, 1))
    first = closest[near] - reach
    t[near], normal[near] = _into_barrel(o[near], d[near], first, 2.0 * reach.max(initial=0.0), radius, half, arc)
    return t, normal


def _into_barrel(
    o: np.ndarray, d: np.ndarray, first: np.ndarray, reach: float, radius: float, half: float, arc: float
) -> Entry:
    def outside(t: np.ndarray) -> np.ndarray:
        at = o + t[..., None] * d
        z = np.clip(at[..., 2], -half, half)
        side = np.hypot(at[..., 0], at[..., 1]) - radius - np.sqrt(arc**2 - z**2) + np.sqrt(arc**2 - half**2)
        return np.maximum(side, np.abs(at[..., 2]) - half)

    step = 0.002
    high, found = first.copy(), np.zeros(first.shape, bool)
    for further in np.arange(0.0, reach + step, step):
        inside = ~found & (outside(first + further) <= 0.0)
        high[inside], found = (first + further)[inside], found | inside
    low = high - step
    for _ in range(40):
        middle = 0.5 * (low + high)
        inside = outside(middle) <= 0.0
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    at = o + high[..., None] * d
    around = at[..., :2] / np.maximum(np.hypot(at[..., 0], at[..., 1]), 1e-12)[..., None]
    rise = at[..., 2] / np.sqrt(np.maximum(arc**2 - at[..., 2] ** 2, 1e-12))
    normal = _unit(np.concatenate((around, rise[..., None]), axis=-1))
    cap = np.abs(np.abs(at[..., 2]) - half) < 1e-7
    normal = np.where(cap[..., None], np.sign(at[..., 2:]) * (0.0, 0.0, 1.0), normal)
    return np.where(found, high, np.inf), np.where(found[..., None], normal, (0.0, 0.0, 1.0))


def _first_root(o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """First root of |o + t d| = 1 for a start outside."""
    a, b, c = (d * d).sum(-1), (o * d).sum(-1), (o * o).sum(-1) - 1.0
    square = b * b - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (-b - np.sqrt(np.maximum(square, 0.0))) / a
    return np.where((square >= 0.0) & (t > 0.0), t, np.inf)


def _at(o: np.ndarray, d: np.ndarray, t: np.ndarray) -> np.ndarray:
    return o + np.where(np.isfinite(t), t, 0.0)[..., None] * d


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def _nearest(entries: list[Entry]) -> Entry:
    times = np.stack([t for t, _ in entries])
    normals = np.stack([np.broadcast_to(n, (*t.shape, 3)) for t, n in entries])
    which = times.argmin(axis=0)
    return times.min(axis=0), np.take_along_axis(normals, which[None, ..., None], axis=0)[0]
