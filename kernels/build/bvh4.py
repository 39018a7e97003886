"""Building one mesh's 4-wide tree: ``native/build/bvh4_builder.h`` as a kernel of one CPU thread."""

from typing import Any

import numpy as np
import warp as wp

from warpcam.kernels.runtime.compile import NATIVE, building, compiler_flags
from warpcam.kernels.runtime.kernels import make_kernel

MAX_DEPTH = 16  # levels of 4-wide nodes, as kMaxDepth
MAX_LEAF = 12  # faces in a leaf, as kMaxLeaf
MAX_FACES = 67_000_000  # in a mesh, as kMaxFaces
ABSENT = np.float32(1e30)  # all the bounds of a child that is not there, as kAbsent
HEADERS = tuple(
    NATIVE / "build" / f"{part}.h" for part in ("build_prims", "object_split", "spatial_split", "bvh4_builder")
)

SCRATCH = 320  # bytes a face or box, as kScratch


def builder_options(header: str) -> dict[str, Any]:
    """Options of a module with a builder in ``native/build/``.

    They are for the CPU alone: a build for CUDA, which nothing launches, is of an empty kernel.
    """
    path = NATIVE / "build" / header
    build = wp.ModuleBuildOptions(
        extra_cpu_include_dirs=[str(NATIVE)],
        extra_cpu_preamble=f'#include "{path.as_posix()}"',
        extra_build_dependencies=[str(used) for used in dict.fromkeys((*HEADERS, path))],
    )
    return {"extra_build_options": build, **compiler_flags()}


_build = make_kernel(
    "build_bvh4",
    """
#if !defined(__CUDA_ARCH__)
    warpcam::bvh4_build::Size size =
        warpcam::bvh4_build::build(vertices.data, faces.data, num_faces, scratch.data, nodes.data, rows.data);
    counts.data[0] = size.nodes;
    counts.data[1] = size.depth;
    counts.data[2] = size.faces;
#endif
""",
    {
        "vertices": wp.array(dtype=wp.float32),
        "faces": wp.array(dtype=wp.int32),
        "num_faces": wp.int32,
        "scratch": wp.array(dtype=wp.int32),
        "nodes": wp.array(dtype=wp.float32),
        "rows": wp.array(dtype=wp.float32),
        "counts": wp.array(dtype=wp.int32),
    },
    builder_options("bvh4_builder.h"),
)


def run_builder(kernel: wp.Kernel, *arguments: np.ndarray | int) -> None:
    """Run a builder on one core; contiguous arrays are read and written in place."""
    inputs = [
        wp.array(value.reshape(-1), device="cpu", copy=False) if isinstance(value, np.ndarray) else value
        for value in arguments
    ]
    wp.launch(kernel, dim=1, inputs=[*inputs, 0], device="cpu")


def load() -> None:
    """Compile the builder, by a thread for which others are compiled, too: each has to precompile headers."""
    with building:
        wp.force_load("cpu", [_build.module], max_workers=0)


def max_listed(num_faces: int) -> int:
    """Return the most faces that the leaves of a mesh list, as room_for() has it.

    Faces that are split occur several times.
    """
    return 2 * num_faces


def build(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Build the tree of one mesh, on one core. Several threads may, after ``load()``.

    Args:
        vertices: (vertex, 3) float32, contiguous, magnitudes below 1e18 [m].
        faces: (face, 3) int32, contiguous, at least one face and at most ``MAX_FACES``, indices in range.

    Returns:
        Node rows (7 * node, 4) float32, face rows (3 * face, 4) float32, both as ``Meshes`` in ``types.py`` has
        them, and the number of levels of nodes, at most ``MAX_DEPTH``. A face may stand in several leaves: there
        are at most ``max_listed(len(faces))`` in all.
    """
    count = len(faces)
    room = max_listed(count)
    nodes = np.empty((7 * room, 4), np.float32)
    rows = np.empty((3 * room, 4), np.float32)
    counts = np.zeros(3, np.int32)
    scratch = np.empty(count * SCRATCH // 4, np.int32)

    run_builder(_build, vertices, faces, count, scratch, nodes, rows, counts)
    return nodes[: 7 * counts[0]].copy(), rows[: 3 * counts[2]].copy(), int(counts[1])
