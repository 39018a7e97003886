"""Occluder boxes of meshes: see native/shadow/occluder_boxes.h."""

import functools

import numpy as np
import warp as wp

from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.launch import BLOCK_DIM, launch_kernel
from warpcam.kernels.types import Meshes

MAX_OCCLUDER_BOXES, ROWS = 32, 3  # native/shadow/occluder_boxes.h
TURNS, SLABS = 4, 24  # native/build/occluder_builder.h


@functools.cache
def kernel() -> wp.Kernel:
    """Return the kernel that tests candidates."""

    @wp.func_native("return warpcam::find_occluder_box(meshes, open, mesh, face, warpcam::Way(way), at, rows);")
    def find(  # type: ignore[empty-body]
        meshes: Meshes,
        open: wp.array(dtype=wp.uint8),
        mesh: int,
        face: int,
        way: int,
        at: int,
        rows: wp.array(dtype=wp.vec4),
    ) -> float: ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        module_options=native_module("build/occluder_builder.h"),
    )
    def find_boxes(
        meshes: Meshes,
        open: wp.array(dtype=wp.uint8),
        owners: wp.array(dtype=wp.int32),
        faces: wp.array(dtype=wp.int32),
        ways: wp.array2d(dtype=wp.int32),
        worths: wp.array2d(dtype=wp.float32),
        rows: wp.array(dtype=wp.vec4),
    ):
        i, k = wp.tid()
        worths[i, k] = find(meshes, open, owners[i], faces[i], ways[i, k], i, rows)

    return find_boxes


def build_occluder_boxes(
    meshes: Meshes, open_faces: np.ndarray, owners: np.ndarray, faces: np.ndarray, device: wp.Device
) -> tuple[np.ndarray, np.ndarray]:
    """The best box over each of some faces.

    Args:
        meshes: What lies on ``device``; none of it moves, and no face is seen from behind.
        open_faces: Of all faces those that have an edge which an odd number of faces has, (face,) bool.
        owners: Index of the mesh of each of the faces that are looked at, (wanted,).
        faces: Which of the mesh's they are, in leaf order, (wanted,).
        device: Where to.

    Returns:
        Rows as shadows read them, (wanted, ROWS, 4), and what they are worth [m^2], (wanted,); 0 where there is none.
    """
    count = len(owners)
    given = [wp.array(open_faces, dtype=wp.uint8, device=device)]
    given += [wp.array(values, dtype=wp.int32, device=device) for values in (owners, faces)]

    def tried(ways: np.ndarray, rows: wp.array) -> np.ndarray:
        worths = wp.empty(ways.shape, dtype=wp.float32, device=device)
        inputs = [meshes, *given, wp.array(ways, dtype=wp.int32, device=device), worths, rows]
        launch_kernel(kernel(), ways.shape, inputs, device=device, block_dim=BLOCK_DIM)
        found: np.ndarray = worths.numpy()
        return found

    all_ways = np.broadcast_to(np.arange(TURNS * SLABS, dtype=np.int32), (count, TURNS * SLABS))
    best = tried(all_ways, wp.empty(0, dtype=wp.vec4, device=device)).argmax(axis=1)
    rows = wp.zeros(count * ROWS, dtype=wp.vec4, device=device)
    worths = tried(best[:, None].astype(np.int32), rows)[:, 0]
    return rows.numpy().reshape(count, ROWS, 4), worths
