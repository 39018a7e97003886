"""Vertices of moving meshes in the previous frame, for flow.py."""

from typing import Any

import numpy as np
import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import MeshReads, Stage, bind_launch
from warpcam.kernels.types import Meshes

wp.set_module_options(compiler_flags())


@wp.struct
class VertexHistory:
    """The faces of meshes that move, as they were."""

    starts: wp.array(dtype=wp.int32)  # (mesh,) first in `corners`, or -1 for a mesh that does not move
    worlds: wp.array(dtype=wp.int32)  # (mesh,) the world that has it, or -1 for several
    rows: wp.array(dtype=wp.vec2i)  # (row,) a row of Meshes.faces where one of these faces begins, and its mesh
    corners: wp.array(dtype=wp.vec3)  # (corner,) corner k of the mesh's face f, as given, at start + 3 f + k


@wp.kernel(enable_backward=False)
def store_vertices(
    before: VertexHistory, faces: wp.array(dtype=wp.vec4), mask: wp.array(dtype=wp.uint8), first: wp.int32
):
    row = before.rows[first + wp.tid()]
    world = before.worlds[row[1]]
    if world >= 0:
        if mask[world] == wp.uint8(0):
            return
    mark = faces[row[0]]
    at = before.starts[row[1]] + 3 * wp.cast(mark[3], wp.int32)
    for k in range(3):
        corner = faces[row[0] + k]
        before.corners[at + k] = wp.vec3(corner[0], corner[1], corner[2])


def bind_vertex_history(before: VertexHistory, meshes: Meshes, mask: wp.array, device: wp.Device) -> Stage:
    """Bind the stage after all traces that keeps where the corners of moving meshes are."""
    stage = bind_launch(store_vertices, before.rows.shape[0], [before, meshes.faces, mask], device)
    stage.reads = MeshReads.FACES
    return stage


def allocate_vertex_history(
    meshes: Meshes, moving: np.ndarray, counts: np.ndarray, worlds: np.ndarray, device: wp.Device
) -> Any:
    """Room for the corners of the meshes that move.

    Args:
        meshes: Of the scene.
        moving: ids of those that move, each with rows of its own.
        counts: Faces of each, as given.
        worlds: (mesh,) int32: VertexHistory.
        device: Where it is to lie.
    """
    starts = np.full(meshes.face_start.shape[0], -1, np.int32)
    starts[moving] = 3 * np.append(0, np.cumsum(counts)[:-1])
    before = VertexHistory()
    before.starts = wp.array(starts, dtype=wp.int32, device=device)
    before.worlds = wp.array(worlds.astype(np.int32), dtype=wp.int32, device=device)
    before.rows = wp.array(_face_rows(meshes, moving), dtype=wp.vec2i, device=device)
    before.corners = wp.zeros(3 * int(counts.sum()), dtype=wp.vec3, device=device)
    return before


def vertex_history_bytes(meshes: Meshes, moving: np.ndarray, counts: np.ndarray) -> int:
    """Bytes of ``allocate_vertex_history``."""
    return 8 * int(meshes.face_start.shape[0]) + 8 * len(_face_rows(meshes, moving)) + 36 * int(counts.sum())


def _face_rows(meshes: Meshes, moving: np.ndarray) -> np.ndarray:
    """VertexHistory."""
    first = meshes.face_start.numpy()
    ends = np.append(np.unique(first), meshes.faces.shape[0])
    last = ends[np.searchsorted(ends, first[moving], "right")]
    return np.concatenate(
        [
            np.stack(np.broadcast_arrays(np.arange(first[mesh], end, 3), mesh), axis=1)
            for mesh, end in zip(moving, last, strict=True)
        ]
    ).astype(np.int32)
