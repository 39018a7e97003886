"""Where meshes surely stop light: see native/shutters.h."""

import functools

import numpy as np
import warp as wp

from .launch import native_module
from .types import Meshes

SHUTTERS, ROWS = 32, 3  # native/shutters.h
TURNS, SLABS = 4, 24  # native/shutter_build.h


@functools.cache
def _kernel() -> wp.Kernel:
    @wp.func_native("warpcam::find_shutter(meshes, open, mesh, face, turn, slab, at, rows, worths);")
    def find(
        meshes: Meshes,
        open: wp.array(dtype=wp.uint8),
        mesh: int,
        face: int,
        turn: int,
        slab: int,
        at: int,
        rows: wp.array(dtype=wp.vec4),
        worths: wp.array(dtype=wp.float32),
    ): ...

    @wp.kernel(
        module="unique", enable_backward=False, grid_stride=False, module_options=native_module("shutter_build.h")
    )
    def shutters(
        meshes: Meshes,
        open: wp.array(dtype=wp.uint8),
        owners: wp.array(dtype=wp.int32),
        faces: wp.array(dtype=wp.int32),
        rows: wp.array(dtype=wp.vec4),
        worths: wp.array(dtype=wp.float32),
    ):
        i, way = wp.tid()
        find(meshes, open, owners[i], faces[i], way % TURNS, way // TURNS, i * TURNS * SLABS + way, rows, worths)

    return shutters


@wp.kernel(enable_backward=False)
def pick(
    rows: wp.array(dtype=wp.vec4),
    worths: wp.array(dtype=wp.float32),
    best: wp.array2d(dtype=wp.vec4),
    worth: wp.array(dtype=wp.float32),
):
    i = wp.tid()
    at = i * TURNS * SLABS
    for k in range(at + 1, (i + 1) * TURNS * SLABS):
        if worths[k] > worths[at]:
            at = k
    worth[i] = worths[at]
    if worths[at] > 0.0:
        for k in range(ROWS):
            best[i, k] = rows[ROWS * at + k]


def find_shutters(
    meshes: Meshes, open_faces: np.ndarray, owners: np.ndarray, faces: np.ndarray, device: wp.Device
) -> tuple[np.ndarray, np.ndarray]:
    """The best shutter over each of some faces.

    Args:
        meshes: What lies on ``device``; none of it moves, and no face is seen from behind.
        open_faces: Of all faces those that have an edge which no other has, (face,) bool.
        owners: Index of the mesh of each of the faces that are looked at, (wanted,).
        faces: Which of the mesh's they are, in leaf order, (wanted,).
        device: Where to.

    Returns:
        Rows as shadows read them, (wanted, ROWS, 4), and what they are worth [m^2], (wanted,); 0 where there is none.
    """
    count = len(owners)
    rows = wp.empty(count * TURNS * SLABS * ROWS, dtype=wp.vec4, device=device)
    worths = wp.empty(count * TURNS * SLABS, dtype=wp.float32, device=device)
    best = wp.zeros((count, ROWS), dtype=wp.vec4, device=device)
    worth = wp.empty(count, dtype=wp.float32, device=device)
    given = [wp.array(open_faces, dtype=wp.uint8, device=device)]
    given += [wp.array(values, dtype=wp.int32, device=device) for values in (owners, faces)]
    wp.launch(_kernel(), (count, TURNS * SLABS), [meshes, *given, rows, worths], device=device)
    wp.launch(pick, count, [rows, worths, best, worth], device=device)
    return best.numpy(), worth.numpy()
