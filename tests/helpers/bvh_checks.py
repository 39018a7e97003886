"""Trees of four children a node as the layout has them: read, judged, walked, and built the plain way."""

import numpy as np

from warpcam.accel.bvh4 import MAX_DEPTH, Bvh4, build_bvh4s
from warpcam.kernels.build.bvh4 import MAX_LEAF, max_listed

ABSENT = np.float32(1e30)


def build_bvh4(vertices: np.ndarray, faces: np.ndarray, *, cache: bool = True, name: str | None = None) -> Bvh4:
    """The tree of one mesh."""
    return build_bvh4s([(vertices, faces, name)], cache=cache)[0]


def codes(bvh: Bvh4) -> np.ndarray:
    """Children of the nodes, (node, 4) int32."""
    return np.ascontiguousarray(bvh.nodes.reshape(-1, 7, 4)[:, 6]).view(np.int32)


def corners_of(bvh: Bvh4) -> np.ndarray:
    """Corners in leaf order, (face, 3, 3) float32."""
    return bvh.faces.reshape(-1, 3, 4)[:, :, :3]


def given_of(bvh: Bvh4) -> np.ndarray:
    """Index of each face among the faces as given, in leaf order, (face,) int32."""
    return np.ascontiguousarray(bvh.faces[::3, 3]).view(np.int32)


def leaf_of(code: int) -> range:
    first, count = divmod(-code - 1, 16)
    return range(first, first + count)


def check(bvh: Bvh4, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Everything that the layout promises, by a walk from the root."""
    assert bvh.nodes.dtype == bvh.faces.dtype == np.float32
    assert bvh.nodes.shape[1:] == bvh.faces.shape[1:] == (4,)
    given, corners = given_of(bvh), corners_of(bvh)
    assert sorted(set(given.tolist())) == list(range(len(faces)))
    assert len(given) <= max_listed(len(faces))
    np.testing.assert_array_equal(corners, vertices[faces[given]])
    assert not np.ascontiguousarray(bvh.faces.reshape(-1, 3, 4)[:, 1:, 3]).view(np.int32).any()
    nodes, children = bvh.nodes.reshape(-1, 7, 4), codes(bvh)
    boxes = np.full((len(given), 2, 3), np.nan)  # of the leaf that each face stands in
    seen_nodes, seen_faces, deepest = [], [], 0

    def walk(node: int, depth: int) -> tuple[np.ndarray, np.ndarray]:
        nonlocal deepest
        deepest = max(deepest, depth)
        seen_nodes.append(node)
        bounds = []
        for k, code in enumerate(children[node].tolist()):
            low, high = nodes[node, :3, k], nodes[node, 3:6, k]
            if (nodes[node, :6, k] == ABSENT).all():
                continue
            assert (low <= high).all()
            if code < 0:
                leaf = leaf_of(code)
                assert 1 <= len(leaf) <= MAX_LEAF
                inside = corners[leaf.start : leaf.stop]
                assert len(set(given[leaf.start : leaf.stop].tolist())) == len(leaf)
                assert (low >= inside.min(axis=(0, 1))).all() and (high <= inside.max(axis=(0, 1))).all()
                seen_faces.extend(leaf)
                boxes[leaf.start : leaf.stop] = low, high
            else:
                np.testing.assert_array_equal((low, high), walk(code, depth + 1))
            bounds.append((low, high))
        assert bounds
        return np.min([low for low, _ in bounds], axis=0), np.max([high for _, high in bounds], axis=0)

    walk(0, 1)
    assert sorted(seen_nodes) == list(range(len(nodes)))
    assert sorted(seen_faces) == list(range(len(given)))
    assert deepest == bvh.depth <= MAX_DEPTH
    check_cover(given, boxes, vertices[faces].astype(np.float64))


def check_cover(given: np.ndarray, boxes: np.ndarray, corners: np.ndarray) -> None:
    """Points of every face lie in the box of a leaf that it stands in; of whole faces so do the corners."""
    slack = 1e-15 * np.abs(corners).max()  # the rounding of the points themselves
    copies = np.bincount(given, minlength=len(corners))[given]
    whole = corners[given[copies == 1]]
    box = boxes[copies == 1]
    assert (whole.min(axis=1) >= box[:, 0]).all() and (whole.max(axis=1) <= box[:, 1]).all()
    rng = np.random.default_rng(3)
    cut = given[copies > 1]
    for weights in [*np.eye(3), *rng.dirichlet((0.5, 0.5, 0.5), size=60)]:
        points = weights @ corners[cut]
        box = boxes[copies > 1]
        inside = ((points >= box[:, 0] - slack) & (points <= box[:, 1] + slack)).all(axis=1)
        covered = np.zeros(len(corners), bool)
        np.logical_or.at(covered, cut, inside)
        assert covered[cut].all()


def sah_cost(bvh: Bvh4) -> float:
    """Expected work of a ray that meets the root's box, in nodes, where four faces are tested at a time."""
    nodes, children = bvh.nodes.reshape(-1, 7, 4).astype(np.float64), codes(bvh)
    present = nodes[:, 0] < ABSENT
    x, y, z = np.moveaxis(nodes[:, 3:6] - nodes[:, :3], 1, 0)
    area = x * y + y * z + z * x
    extent = np.ptp(corners_of(bvh).reshape(-1, 3).astype(np.float64), axis=0)
    whole = extent @ np.roll(extent, 1)
    work = np.where(children < 0, 0.6 + 0.6 * np.ceil(((-children - 1) & 15) / 4), 1.0)
    return 1 + (area * work)[present].sum() / whole


def halved(vertices: np.ndarray, faces: np.ndarray) -> Bvh4:
    """The plain tree: both levels of a node halve the faces along the widest axis, down to eight."""
    corners = vertices[faces]
    centers = corners.mean(axis=1)
    rows: list[np.ndarray] = []
    order: list[int] = []
    deepest = 0

    def halves(part: np.ndarray) -> list[np.ndarray]:
        if len(part) <= 8:
            return [part]
        axis = np.argmax(np.ptp(centers[part], axis=0))
        part = part[np.argsort(centers[part, axis], kind="stable")]
        return [part[: len(part) // 2], part[len(part) // 2 :]]

    def add(part: np.ndarray, depth: int) -> int:
        nonlocal deepest
        deepest = max(deepest, depth)
        me = len(rows)
        node = np.full((7, 4), ABSENT, np.float32)
        rows.append(node)
        node_codes = np.zeros(4, np.int32)
        for k, child in enumerate([quarter for half in halves(part) for quarter in halves(half)]):
            node[:3, k], node[3:6, k] = corners[child].min(axis=(0, 1)), corners[child].max(axis=(0, 1))
            if len(child) <= 8:
                node_codes[k] = -(16 * len(order) + len(child)) - 1
                order.extend(child)
            else:
                node_codes[k] = add(child, depth + 1)
        node[6] = node_codes.view(np.float32)
        return me

    add(np.arange(len(faces)), 1)
    leaf_order = np.zeros((len(faces), 3, 4), np.float32)
    leaf_order[:, :, :3] = corners[order]
    leaf_order[:, 0, 3] = np.int32(order).view(np.float32)
    return Bvh4(np.concatenate(rows), leaf_order.reshape(-1, 4), deepest)


def same(a: Bvh4, b: Bvh4) -> bool:
    return a.nodes.tobytes() == b.nodes.tobytes() and a.faces.tobytes() == b.faces.tobytes() and a.depth == b.depth


def hits(origin: np.ndarray, ray: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance along a ray at which it hits each triangle, inf where it does not, (face,) float64."""
    v0, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(ray, e2)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.sum(e1 * p, axis=1)
        u = np.sum((origin - v0) * p, axis=1) * inverse
        q = np.cross(origin - v0, e1)
        v = np.sum(ray * q, axis=1) * inverse
        t = np.sum(e2 * q, axis=1) * inverse
    return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)


def traverse(bvh: Bvh4, origin: np.ndarray, ray: np.ndarray) -> tuple[float, int, int]:
    """The nearest hit: distance, leaf order's face, and the most stack entries it took."""
    nodes, children, corners = bvh.nodes.reshape(-1, 7, 4).astype(np.float64), codes(bvh), corners_of(bvh).astype(float)
    best, winner, stack, most = np.inf, -1, [(0.0, 0)], 0
    while stack:
        near, code = stack.pop()
        if near > best:
            continue
        if code < 0:
            t = hits(origin, ray, corners[leaf_of(code).start : leaf_of(code).stop])
            if t.min() < best:
                best, winner = t.min(), leaf_of(code).start + int(np.argmin(t))
            continue
        slabs = (nodes[code, :6].reshape(2, 3, 4) - origin[None, :, None]) / ray[None, :, None]
        enter, leave = np.maximum(slabs.min(axis=0).max(axis=0), 0) * (1 - 1e-9), slabs.max(axis=0).min(axis=0)
        met = [(enter[k], int(children[code, k])) for k in range(4) if enter[k] <= leave[k] * (1 + 1e-9)]
        stack += sorted(met, reverse=True)
        most = max(most, len(stack) - 1)
    return best, winner, most
