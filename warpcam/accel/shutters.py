"""Where meshes surely stop light: which boxes are kept, see kernels/native/shutters.h."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warpcam.kernels.shutters import ROWS, SHUTTERS, find_shutters
from warpcam.kernels.types import Meshes

LOOKED_AT = 512  # faces of a mesh over which shutters are looked for
FEW_FACES = 128  # a mesh with fewer has none: light that it stops is found quickly without
NONE = np.zeros((ROWS, 4), np.float32)
NONE[:, 3] = 4.0  # stops nothing


def pack_shutters(
    meshes: Meshes, trees: Sequence[np.ndarray], holders: Sequence[int], device: wp.Device
) -> wp.array:
    """Find the shutters of all meshes.

    Args:
        meshes: What lies on ``device``, but for these.
        trees: Faces of each tree in leaf order, (3 * face, 4), in the order of ``meshes.faces``.
        holders: Index of the first mesh that has each tree.
    """
    packed = np.tile(NONE[:, None], (meshes.face_start.shape[0], 1, SHUTTERS, 1)).reshape(-1, ROWS, SHUTTERS, 4)
    wanted = [_wanted(tree) for tree in trees]
    owners = np.repeat(np.array(holders, np.int32), [len(faces) for faces in wanted])
    if len(owners):
        opens = np.concatenate([_open_faces(tree) for tree in trees])
        rows, worths = find_shutters(meshes, opens, owners, np.concatenate(wanted), device)
        starts = meshes.face_start.numpy()
        for tree, faces, holder in zip(trees, wanted, holders, strict=True):
            found = owners == holder
            middles = tree.reshape(-1, 3, 4)[faces, :, :3].mean(axis=1)
            chosen = _chosen(rows[found], worths[found], middles)
            packed[starts == starts[holder], :, : len(chosen)] = rows[found][chosen].transpose(1, 0, 2)
    return wp.array(packed.reshape(-1, 4), dtype=wp.vec4, device=device)


def _wanted(tree: np.ndarray) -> np.ndarray:
    """Some of a tree's faces, spread over its area."""
    corners = tree.reshape(-1, 3, 4)[:, :, :3]
    if len(corners) < FEW_FACES:
        return np.zeros(0, np.int32)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    until = np.cumsum(areas.astype(np.float64))
    places = np.searchsorted(until, until[-1] * (np.arange(LOOKED_AT) + 0.5) / LOOKED_AT)
    return np.unique(np.minimum(places, len(corners) - 1)).astype(np.int32)


def _open_faces(tree: np.ndarray) -> np.ndarray:
    """Which of a tree's faces have an edge that an odd number of faces has, (face,)."""
    corners = tree.reshape(-1, 3, 4)
    given = corners.view(np.int32)[:, 0, 3]
    _, first, copies = np.unique(given, return_index=True, return_inverse=True)
    points = np.ascontiguousarray(corners[first, :, :3].reshape(-1, 3) + np.float32(0.0))
    _, ids = np.unique(points.view([("", np.float32)] * 3).ravel(), return_inverse=True)
    ends = ids.reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]]
    ends.sort(axis=2)
    keys = ends[..., 0] * np.int64(len(ids)) + ends[..., 1]
    _, edges, counts = np.unique(keys.ravel(), return_inverse=True, return_counts=True)
    opens = (counts % 2 == 1)[edges].reshape(-1, 3).any(axis=1)
    return opens[copies.ravel()]


def _chosen(rows: np.ndarray, worths: np.ndarray, points: np.ndarray) -> list[int]:
    """Those that together stop light at most of some points, not at all by what others do already."""
    lengths = np.linalg.norm(rows[:, :, :3], axis=2)
    limits = np.ones((len(rows), 3), np.float32)
    there = worths > 0.0
    limits[there, :2] -= lengths[there, :2] / lengths[there, 2:] * 1.0
    places = np.einsum("ski,pi->spk", rows[:, :, :3], points) + rows[:, None, :, 3]
    stops = (np.abs(places) <= limits[:, None]).all(axis=2) & there[:, None]
    chosen: list[int] = []
    while len(chosen) < SHUTTERS and stops.any():
        best = int(stops.sum(axis=1).argmax())
        chosen.append(best)
        stops[:, stops[best]] = False
    return chosen
