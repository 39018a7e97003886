"""The stages that follow meshes whose corners move: their faces, and the boxes of their trees, from the leaves up.

On CUDA faces, boxes of leaves and those of whole meshes come first: all that is read of a mesh that is projected into
images (native/traversal/projected_faces.h). The rest of a tree is for rays that walk through it.

A tree whose boxes have grown gets its faces in a new order, in place: see native/accel/reorder.h.
"""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import Meshes

FAR = 1.0e29  # bounds of children that are not there lie beyond it
LANES = 32  # of a warp
EVERY = 16  # frames that share in measuring a tree; accel/reorder.h has the same number
RUN_FACES = THREADS  # of leaves that a block moves on CUDA; accel/refit.h has the same number
RUN = 32  # of leaves, children or faces that an index of a CPU's launch does; accel/refit.h has the same number
FEW = 1024  # children of a level: so many one block brings to where they are now, with all levels above


@wp.struct
class DeformingMeshes:
    """Meshes that move, with one tree: the instances have their own boxes, faces and order, and the rest in common."""

    assets: wp.array(dtype=wp.int32)  # (instance,) mesh
    bases: wp.array(dtype=wp.int32)  # (instance,) point that its corners count from
    triangles: wp.array(dtype=wp.vec3i)  # (face,) points, as they were given, counted from the instance's base
    order: wp.array2d(dtype=wp.int32)  # (instance, row) the face that stands there, in leaf order
    looseness: wp.array(dtype=wp.float32)  # (instance,) of the tree as it was ordered; below 0: not measured yet
    areas: wp.array(dtype=wp.vec2)  # (instance,) of boxes and of single faces, as far as they have been measured
    ages: wp.array(dtype=wp.int32)  # (instance,) which share of them is next
    num_nodes: wp.int32
    offset: wp.float32  # how far points lie beside what they were made of, along their normals [m]
    num_smooth: wp.int32  # so many faces, the first as they were given, have the normals of their points
    num_flat: wp.int32  # the first that are flat as what they were made of; all others are as flat as they lie
    backs: wp.int32  # 1 where each face is seen from behind, too, and flat: see Meshes.faces
    num_leaves: wp.int32
    # (entry,) a node, a child's number, and the child: leaves in the order of their faces, then nodes from below
    entries: wp.array(dtype=wp.vec3i)
    levels: wp.array(dtype=wp.int32)  # (level + 1,) where in `entries` the levels of nodes begin, and the end
    # (run,) of leaves that a block moves: the first and the last in `entries`, where its faces begin, and how many
    # they are; and of each instance and run the box, lower and upper corner; both on CUDA alone
    runs: wp.array(dtype=wp.vec4i)
    boxes: wp.array(dtype=wp.float32)


MOVING = {"moving": DeformingMeshes, "meshes": Meshes}
POINTS = MOVING | {"points": wp.array(dtype=wp.vec3)}
NATIVE = native_module("accel/refit.h")

move_leaves = make_kernel("move_leaves", "warpcam::move_leaves(moving, meshes, points, index);", POINTS, NATIVE)
move_bounds = make_kernel("move_bounds", "warpcam::move_bounds(moving, meshes, index);", MOVING, NATIVE)
move_level = make_kernel(
    "move_level",
    "warpcam::move_level(moving, meshes, begin, count, index);",
    MOVING | {"begin": wp.int32, "count": wp.int32},
    NATIVE,
)
finish_trees = make_kernel(
    "finish_trees", "warpcam::finish_tree(moving, meshes, points, level, index);", POINTS | {"level": wp.int32}, NATIVE
)
move_normals = make_kernel(
    "move_normals",
    "warpcam::move_normals(moving, meshes, points, normals, index);",
    POINTS | {"normals": wp.array(dtype=wp.vec3)},
    NATIVE,
)


def kernels_of(backs: bool, device: wp.Device) -> list[wp.Kernel]:
    """Return the kernels of most trees' stages; faces with ``backs`` compute their own normals."""
    bounds = [move_bounds] if device.is_cuda else []
    return [move_leaves, *bounds, finish_trees, *([] if backs else [move_normals])]


@dataclass(frozen=True)
class FaceShading:
    """Shading of the faces of a moving mesh: see ``DeformingMeshes``."""

    offset: float = 0.0
    num_smooth: int = 0
    num_flat: int = 0


class DeformingTree:
    """Tree that the instances of one moving mesh share, and the stages that move it.

    Args:
        meshes: Of the scene, in which all instances have copies of one tree.
        assets: The instances' meshes.
        bases: The point that each one's corners count from.
        faces: (face, 3) int32, the mesh's faces as they were given; of a mesh with two sides those of its front.
        device: Where all of it lies.
        for_shading_only: How faces are shaded: None is as they lie.
        two_sided: Whether each face is seen from behind, too; then all are shaded as they lie.
    """

    def __init__(
        self,
        meshes: Any,
        assets: np.ndarray,
        bases: np.ndarray,
        faces: np.ndarray,
        device: wp.Device,
        shading: FaceShading | None = None,
        two_sided: bool = False,
    ):
        self._meshes, self._device = meshes, device
        asset = int(assets[0])
        first_node, first_face = (int(start.numpy()[asset]) for start in (meshes.node_start, meshes.face_start))
        levels, rows = self._read(first_node)
        marks = meshes.faces[first_face : first_face + 3 * rows].numpy().reshape(-1, 3, 4)[:, 0, 3]
        given = np.ascontiguousarray(marks).view(np.int32)
        self._moving = moving = DeformingMeshes()
        moving.assets = self._integers(assets)
        moving.bases = self._integers(bases)
        moving.triangles = wp.array(faces.astype(np.int32), dtype=wp.vec3i, device=device)
        order = np.broadcast_to(given, (len(assets), rows))
        moving.order = wp.array(np.ascontiguousarray(order), dtype=wp.int32, ndim=2, device=device)
        moving.looseness = wp.full(len(assets), -1.0, dtype=wp.float32, device=device)
        moving.areas = wp.zeros(len(assets), dtype=wp.vec2, device=device)
        moving.ages = self._integers(np.arange(len(assets)) % EVERY)  # not all at once
        shading = shading or FaceShading()
        moving.offset, moving.num_smooth, moving.num_flat = shading.offset, shading.num_smooth, shading.num_flat
        moving.backs = int(two_sided)
        leaves = np.concatenate([level[level[:, 2] < 0] for level in levels])
        leaves = leaves[np.argsort(-leaves[:, 2])]  # as their faces stand
        inner = [level[level[:, 2] >= 0] for level in levels[::-1]]
        inner = [level for level in inner if len(level)]
        moving.num_leaves, moving.num_nodes = len(leaves), 1 + sum(map(len, inner))
        entries = np.concatenate((leaves, *inner)).astype(np.int32)
        moving.entries = wp.array(entries, dtype=wp.vec3i, device=device)
        runs = _runs(-leaves[:, 2] - 1) if device.is_cuda else np.zeros((0, 4), np.int32)
        moving.runs = wp.array(runs, dtype=wp.vec4i, device=device)
        moving.boxes = wp.zeros(6 * len(assets) * len(runs), dtype=wp.float32, device=device)
        self._starts = np.cumsum([len(leaves), *map(len, inner)])
        moving.levels = self._integers(self._starts)
        self._instances = len(assets)

    def record(self, points: wp.array, normals: wp.array | None = None, aside: bool = False) -> list[Stage]:
        """Bind the stages that move all instances.

        Args:
            points: (point,) vec3, world frame [m].
            normals: (point,) vec3, unit, for faces that are not shaded as they lie.
            aside: Whether nothing of the scene's writes ``points``: see ``Stage``.
        """
        stages = self._record(points, normals)
        for stage in stages:
            stage.independent = aside
        return stages

    def _record(self, points: wp.array, normals: wp.array | None) -> list[Stage]:
        moving, meshes, device, instances = self._moving, self._meshes, self._device, self._instances
        if normals is None:
            normals = wp.empty(0, dtype=wp.vec3, device=device)
        threads, run = (THREADS, 1) if device.is_cuda else (1, RUN)
        blocks = instances * moving.runs.shape[0]
        leaves = THREADS * blocks if device.is_cuda else -(-instances * moving.num_leaves // run)
        moved = [moving, meshes, points]
        stages = [bind_launch(move_leaves, leaves, moved, device, block_dim=THREADS)] if leaves else []
        if device.is_cuda:
            stages.append(bind_launch(move_bounds, instances * LANES, [moving, meshes], device))
        first, level = len(stages), 0
        for begin, end in itertools.pairwise(map(int, self._starts)):
            if end - begin <= FEW:
                break
            count = end - begin
            stages.append(bind_launch(move_level, -(-instances * count // run), [moving, meshes, begin, count], device))
            level += 1
        finish = [moving, meshes, points, level]
        stages.append(bind_launch(finish_trees, instances * threads, finish, device, block_dim=THREADS))
        for stage in stages[first:]:
            stage.for_trees_only = device.is_cuda  # on a CPU the root's box is the mesh's
        if moving.backs:  # these have their normals from their faces
            return stages
        faces = moving.triangles.shape[0]
        whole = -(-faces // LANES) * LANES if device.is_cuda else faces  # a warp works on faces of one instance
        stages.append(
            bind_launch(move_normals, -(-instances * whole // run), [moving, meshes, points, normals], device)
        )
        stages[-1].for_shading_only = True
        return stages

    def _integers(self, values: np.ndarray) -> wp.array:
        return wp.array(np.asarray(values, np.int32), dtype=wp.int32, device=self._device)

    def _read(self, first: int) -> tuple[list[np.ndarray], int]:
        """Children that are there, by level from the root, (child, 3) node, number, code; how many faces they list."""
        wide = 8 if self._device.is_cuda else 7  # rows of a node, see Meshes.nodes
        total = self._meshes.nodes.shape[0]
        nodes = np.zeros(1, np.int64)
        levels, listed, read = [], 0, 0
        host = np.zeros((0, 4), np.float32)
        while len(nodes):
            end = min(first + wide * (int(nodes.max()) + 1), total)
            if end - first > read:
                host, read = self._meshes.nodes[first:end].numpy(), end - first
            table = host[: read // wide * wide].reshape(-1, wide, 4)
            if wide == 8:
                low, codes = table[nodes, 0::2, 0], np.ascontiguousarray(table[nodes, 0::2, 3]).view(np.int32)
            else:
                low, codes = table[nodes, 0], np.ascontiguousarray(table[nodes, 6]).view(np.int32)
            there = low < FAR
            owner, number = np.nonzero(there)
            codes = codes[there]
            levels.append(np.stack((nodes[owner], number, codes), axis=1))
            leaves = -codes[codes < 0].astype(np.int64) - 1
            if len(leaves):
                listed = max(listed, int(((leaves >> 4) + (leaves & 15)).max()))
            nodes = codes[codes >= 0].astype(np.int64)
        return levels, listed


def _runs(codes: np.ndarray) -> np.ndarray:
    """Runs of leaves, whose codes ascend: see ``DeformingMeshes.runs``."""
    begins, counts = codes >> 4, codes & 15
    runs, first = [], 0
    while first < len(codes):
        end = first + int(np.searchsorted(begins[first:] + counts[first:] - begins[first], RUN_FACES, "right"))
        runs.append((first, end - 1, begins[first], begins[end - 1] + counts[end - 1] - begins[first]))
        first = end
    return np.array(runs, np.int32).reshape(-1, 4)
