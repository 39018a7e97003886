"""Occluder boxes of meshes: selection among candidates. See kernels/native/shadow/occluder_boxes.h."""

import itertools
from collections.abc import Sequence

import numpy as np
import warp as wp

from warpcam.kernels.build.occluder_boxes import MAX_OCCLUDER_BOXES, ROWS, build_occluder_boxes
from warpcam.kernels.types import Meshes

LOOKED_AT = 512  # faces of a mesh over which occluder boxes are looked for
FEW_FACES = 128  # a mesh with fewer has none: light that it stops is found quickly without
MANY_MESHES = 32  # of a scene; with more the search takes long
NONE = np.zeros((ROWS, 4), np.float32)
NONE[:, 3] = 4.0  # stops nothing
# Planes of such a box by their normals, (18, 3), and what three of them at a time meet in: which, (corner, 3), and the
# matrices that make a corner of how far they reach.
NORMALS = np.array([n for n in itertools.product((-1, 0, 1), repeat=3) if 0 < np.abs(n).sum() < 3], np.float64)
TRIPLES = np.array([t for t in itertools.combinations(range(18), 3) if abs(np.linalg.det(NORMALS[list(t)])) > 0.1])
CORNERS = np.linalg.inv(NORMALS[TRIPLES])


def are_worth(trees: Sequence[np.ndarray]) -> bool:
    """Return whether a scene of these meshes, given as their faces in leaf order, gains by occluder boxes."""
    return 0 < len(trees) <= MANY_MESHES and any(len(tree) >= 3 * FEW_FACES for tree in trees)


def pack_occluder_boxes(
    meshes: Meshes, trees: Sequence[np.ndarray], holders: Sequence[int], device: wp.Device
) -> wp.array:
    """Find the occluder boxes and outlines of all meshes.

    Args:
        meshes: What lies on ``device``, but for these.
        trees: Faces of each tree in leaf order, (3 * face, 4), in the order of ``meshes.faces``.
        holders: Index of the first mesh that has each tree.
    """
    packed = np.zeros((meshes.face_start.shape[0], ROWS + 1, MAX_OCCLUDER_BOXES, 4), np.float32)
    packed[:, :ROWS] = NONE[:, None]
    wanted = [_wanted(tree) for tree in trees]
    owners = np.repeat(np.array(holders, np.int32), [len(faces) for faces in wanted])
    if len(owners):
        opens = np.concatenate([_open_faces(tree) for tree in trees])
        rows, worths = build_occluder_boxes(meshes, opens, owners, np.concatenate(wanted), device)
    starts = meshes.face_start.numpy()
    for tree, faces, holder in zip(trees, wanted, holders, strict=True):
        same = starts == starts[holder]
        if len(faces):
            found = owners == holder
            middles = tree.reshape(-1, 3, 4)[faces, :, :3].mean(axis=1)
            chosen = _chosen(rows[found], worths[found], middles)
            packed[same, :ROWS, : len(chosen)] = rows[found][chosen].transpose(1, 0, 2)
        packed[same, ROWS, :, :3] = outline(tree[:, :3])
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
    """Return which faces of a tree have an edge that an odd number of faces share, (face,)."""
    corners = tree.reshape(-1, 3, 4)
    given = corners.view(np.int32)[:, 0, 3]  # copies of a face have the same number
    places = np.full(given.max(initial=-1) + 1, -1)
    places[given] = np.arange(len(given))
    one_of = places[places >= 0]
    places[places >= 0] = np.arange(len(one_of))
    points = _mixed((corners[one_of, :, :3] + np.float32(0.0)).view(np.uint32))  # -0 is 0
    others = points[:, [1, 2, 0]]
    edges = _mixed(np.stack([points + others, points ^ others], axis=-1)).ravel()  # the same from either end
    order = np.argsort(edges, kind="stable")
    begins = np.concatenate([[True], np.diff(edges[order]) != 0]) if len(edges) else np.zeros(0, bool)
    group = np.cumsum(begins) - 1
    odd = np.empty(len(edges), bool)
    counts: np.ndarray = np.bincount(group)
    odd[order] = counts[group] % 2 == 1
    sides = odd.reshape(-1, 3)
    return (sides[:, 0] | sides[:, 1] | sides[:, 2])[places[given]]


def _mixed(parts: np.ndarray) -> np.ndarray:
    """One number of 64 bits for those of the last axis: the same for the same ones alone, but for one in 2^64."""
    mixed = np.zeros(parts.shape[:-1], np.uint64)
    for part in np.moveaxis(parts, -1, 0):
        mixed = (mixed + part) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(32)
    return mixed


def _chosen(rows: np.ndarray, worths: np.ndarray, points: np.ndarray) -> list[int]:
    """Select boxes that together block light at most of some points, without redundant ones."""
    lengths = np.linalg.norm(rows[:, :, :3], axis=2)
    there = worths > 0.0
    limits = np.ones((len(rows), 3), np.float32)
    limits[there, :2] -= lengths[there, :2] / lengths[there, 2:]  # light that slants by as much as 45 degrees
    places = np.matmul(rows[:, :, :3], points.T) + rows[:, :, 3:]
    stops = ((np.abs(places) <= limits[:, :, None]).all(axis=1) & there[:, None]).astype(np.float32)
    left = np.ones(len(points), np.float32)
    chosen: list[int] = []
    while len(chosen) < min(MAX_OCCLUDER_BOXES, len(rows)):
        more = stops @ left
        best = int(more.argmax())
        if more[best] == 0.0:
            break
        chosen.append(best)
        left *= 1.0 - stops[best]
    return chosen


def outline(points: np.ndarray) -> np.ndarray:
    """Corners of a box around some points with its edges cut off, (MAX_OCCLUDER_BOXES, 3); it holds all of them."""
    if not len(points):
        return np.zeros((MAX_OCCLUDER_BOXES, 3))
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)).astype(np.float64)
    size = float(np.abs(points - middle).max(initial=1e-30))
    away = (points - middle) / size
    reach = (away @ NORMALS.T).max(axis=0) + 1e-6
    corners = np.einsum("tij,tj->ti", CORNERS, reach[TRIPLES])
    corners = corners[(corners @ NORMALS.T <= reach + 1e-9).all(axis=1)]
    corners = np.unique(np.round(corners, 7), axis=0)
    if not 0 < len(corners) <= MAX_OCCLUDER_BOXES:
        corners = np.array(list(itertools.product(*zip(away.min(axis=0), away.max(axis=0), strict=True))))
    found: np.ndarray = middle + size * np.resize(corners, (MAX_OCCLUDER_BOXES, 3))
    return found
