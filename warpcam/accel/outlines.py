"""Outlines of meshes: a few points whose hull holds a mesh more tightly than its box does."""

import itertools

import numpy as np

NUM_POINTS = 32  # as many as a warp has lanes; kernels/native/outline.h has the same number

_EDGES = [(1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]
_AXES = np.vstack([np.eye(3), np.array(_EDGES) / np.sqrt(2.0)])
_NORMALS = np.vstack([_AXES, -_AXES])  # of a box whose edges are cut off
_TRIPLES = np.array(list(itertools.combinations(range(len(_NORMALS)), 3)))
_TRIPLES = _TRIPLES[np.abs(np.linalg.det(_NORMALS[_TRIPLES])) > 1e-6]
_INVERSES = np.linalg.inv(_NORMALS[_TRIPLES])
_NEAR = 1e-6  # of the largest size: corners nearer to each other are one


def outline(points: np.ndarray) -> np.ndarray:
    """Corners of the smallest box with cut edges, along the axes, that holds the points.

    Args:
        points: (point, 3), at least one.

    Returns:
        (NUM_POINTS, 3) float32, some of them equal.
    """
    points = points.astype(np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    centre, size = 0.5 * (low + high), max(float((high - low).max()), 1e-30)
    along = (points - centre) @ _AXES.T
    ends = np.concatenate([along.max(axis=0), -along.min(axis=0)])
    met = np.einsum("tij,tj->ti", _INVERSES, ends[_TRIPLES])
    inside = (met @ _NORMALS.T <= ends + _NEAR * size).all(axis=1)
    corners = met[inside]
    places = np.unique(np.round(corners / (4.0 * _NEAR * size)), axis=0, return_index=True)[1]
    corners = corners[places]
    if not 0 < len(corners) <= NUM_POINTS:  # more meet in a corner than can be told apart
        half = 0.5 * (high - low)
        corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half
    whole = np.resize(corners, (NUM_POINTS, 3)) * (1.0 + 1e-5)
    return (whole + centre).astype(np.float32)
