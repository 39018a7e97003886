"""The stages that follow meshes whose corners move: their faces, and the boxes of their trees, level by level.

A tree whose boxes have grown gets its faces in a new order, in place: see native/reorder.h.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from .launch import Stage, native_options, record
from .types import Meshes
from .visibility import THREADS

FAR = 1.0e29  # bounds of children that are not there lie beyond it


@wp.struct
class Moving:
    """Meshes that move, with one tree: the instances have their own boxes, faces and order, and the rest in common."""

    assets: wp.array(dtype=wp.int32)  # (instance,) mesh
    bases: wp.array(dtype=wp.int32)  # (instance,) point that its corners count from
    triangles: wp.array(dtype=wp.vec3i)  # (face,) points, as they were given, counted from the instance's base
    order: wp.array2d(dtype=wp.int32)  # (instance, row) the face that stands there, in leaf order
    looseness: wp.array(dtype=wp.float32)  # (instance,) of the tree as it was ordered; below 0: not measured yet
    ages: wp.array(dtype=wp.int32)  # (instance,) frames since it was measured
    num_nodes: wp.int32
    offset: wp.float32  # how far points lie beside what they were made of, along their normals [m]
    num_smooth: wp.int32  # so many faces, the first as they were given, have the normals of their points
    num_flat: wp.int32  # the first that are flat as what they were made of; all others are as flat as they lie
    entries: wp.array(dtype=wp.vec3i)  # (entry,) from the deepest level up: a node, a child's number, and the child


@wp.kernel(enable_backward=False)
def move_faces(
    moving: Moving,
    meshes: Meshes,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    first: wp.int32,
):
    index = first + wp.tid()
    rows = moving.order.shape[1]
    instance = index // rows
    row = index - instance * rows
    asset = moving.assets[instance]
    base = moving.bases[instance]
    face = moving.order[instance, row]
    corners = moving.triangles[face]
    a = points[base + corners[0]]
    b = points[base + corners[1]]
    c = points[base + corners[2]]
    at = meshes.face_start[asset] + 3 * row
    meshes.faces[at] = wp.vec4(a[0], a[1], a[2], wp.cast(face, wp.float32))
    meshes.faces[at + 1] = wp.vec4(b[0], b[1], b[2], 0.0)
    meshes.faces[at + 2] = wp.vec4(c[0], c[1], c[2], 0.0)
    corner = 3 * (meshes.corner_start[asset] + face)
    if face < moving.num_smooth:
        meshes.normals[corner] = normals[base + corners[0]]
        meshes.normals[corner + 1] = normals[base + corners[1]]
        meshes.normals[corner + 2] = normals[base + corners[2]]
        return
    if face < moving.num_flat:
        a -= moving.offset * normals[base + corners[0]]
        b -= moving.offset * normals[base + corners[1]]
        c -= moving.offset * normals[base + corners[2]]
    normal = wp.normalize(wp.cross(b - a, c - a))
    meshes.normals[corner] = normal
    meshes.normals[corner + 1] = normal
    meshes.normals[corner + 2] = normal


@wp.func_native("warpcam::reorder(moving, meshes, points, index);")
def _reorder(moving: Moving, meshes: Meshes, points: wp.array(dtype=wp.vec3), index: wp.int32): ...


@wp.kernel(
    module="unique",
    enable_backward=False,
    grid_stride=False,
    module_options={"extra_build_options": native_options("reorder.h")},
)
def keep_order(moving: Moving, meshes: Meshes, points: wp.array(dtype=wp.vec3), first: wp.int32):
    _reorder(moving, meshes, points, first + wp.tid())


@wp.func
def child_low(meshes: Meshes, at: wp.int32, child: wp.int32, by_child: wp.int32) -> wp.vec3:
    if by_child != 0:
        row = meshes.nodes[at + 2 * child]
        return wp.vec3(row[0], row[1], row[2])
    return wp.vec3(meshes.nodes[at][child], meshes.nodes[at + 1][child], meshes.nodes[at + 2][child])


@wp.func
def child_high(meshes: Meshes, at: wp.int32, child: wp.int32, by_child: wp.int32) -> wp.vec3:
    if by_child != 0:
        row = meshes.nodes[at + 2 * child + 1]
        return wp.vec3(row[0], row[1], row[2])
    return wp.vec3(meshes.nodes[at + 3][child], meshes.nodes[at + 4][child], meshes.nodes[at + 5][child])


@wp.func
def put(rows: wp.array(dtype=wp.vec4), at: wp.int32, child: wp.int32, value: wp.float32):
    row = rows[at]
    row[child] = value
    rows[at] = row


@wp.kernel(enable_backward=False)
def move_boxes(moving: Moving, meshes: Meshes, begin: wp.int32, count: wp.int32, by_child: wp.int32, first: wp.int32):
    """One level of nodes: a thread for each child, or one for each instance where children share rows, as on a CPU."""
    index = first + wp.tid()
    instance = index
    entry = begin
    end = begin + count
    if by_child != 0:
        instance = index // count
        entry = begin + index - instance * count
        end = entry + 1
    asset = moving.assets[instance]
    nodes = meshes.node_start[asset]
    faces = meshes.face_start[asset]
    rows = 7
    if by_child != 0:
        rows = 8
    while entry < end:
        what = moving.entries[entry]
        code = what[2]
        low = wp.vec3(1.0e30, 1.0e30, 1.0e30)
        high = -low
        if code < 0:
            start = (-code - 1) >> 4
            for face in range(start, start + ((-code - 1) & 15)):
                for corner in range(3):
                    row = meshes.faces[faces + 3 * face + corner]
                    low = wp.min(low, wp.vec3(row[0], row[1], row[2]))
                    high = wp.max(high, wp.vec3(row[0], row[1], row[2]))
        else:
            for child in range(4):
                below = child_low(meshes, nodes + rows * code, child, by_child)
                if below[0] < FAR:
                    low = wp.min(low, below)
                    high = wp.max(high, child_high(meshes, nodes + rows * code, child, by_child))
        at = nodes + rows * what[0]
        if by_child != 0:
            mark = meshes.nodes[at + 2 * what[1]]
            meshes.nodes[at + 2 * what[1]] = wp.vec4(low[0], low[1], low[2], mark[3])
            meshes.nodes[at + 2 * what[1] + 1] = wp.vec4(high[0], high[1], high[2], 0.0)
        else:
            for axis in range(3):
                put(meshes.nodes, at + axis, what[1], low[axis])
                put(meshes.nodes, at + 3 + axis, what[1], high[axis])
        entry += 1


@wp.kernel(enable_backward=False)
def move_bounds(moving: Moving, meshes: Meshes, by_child: wp.int32, first: wp.int32):
    asset = moving.assets[first + wp.tid()]
    low = wp.vec3(1.0e30, 1.0e30, 1.0e30)
    high = -low
    for child in range(4):
        below = child_low(meshes, meshes.node_start[asset], child, by_child)
        if below[0] < FAR:
            low = wp.min(low, below)
            high = wp.max(high, child_high(meshes, meshes.node_start[asset], child, by_child))
    meshes.lower[asset] = low
    meshes.upper[asset] = high


@dataclass(frozen=True)
class Shading:
    """How the faces of a moving mesh are shaded: see ``Moving``."""

    offset: float = 0.0
    num_smooth: int = 0
    num_flat: int = 0


class Tree:
    """What the instances of one moving mesh have in common, and the stages that move them.

    Args:
        meshes: Of the scene, in which all instances have copies of one tree.
        assets: The instances' meshes.
        bases: The point that each one's corners count from.
        faces: (face, 3) int32, the mesh's faces as they were given.
        device: Where all of it lies.
        by_child: Whether nodes lie as they do on CUDA, child by child.
        shading: How faces are shaded: None is as they lie.
    """

    def __init__(
        self,
        meshes: Any,
        assets: np.ndarray,
        bases: np.ndarray,
        faces: np.ndarray,
        device: wp.Device,
        by_child: bool,
        shading: Shading | None = None,
    ):
        self._meshes, self._device, self._by_child = meshes, device, int(by_child)
        asset, wide = int(assets[0]), 8 if by_child else 7
        first_node, first_face = (int(start.numpy()[asset]) for start in (meshes.node_start, meshes.face_start))
        levels, rows = self._levels(first_node, wide)
        marks = meshes.faces[first_face : first_face + 3 * rows].numpy().reshape(-1, 3, 4)[:, 0, 3]
        given = np.ascontiguousarray(marks).view(np.int32)
        self._moving = Moving()
        self._moving.assets = wp.array(assets.astype(np.int32), dtype=wp.int32, device=device)
        self._moving.bases = wp.array(bases.astype(np.int32), dtype=wp.int32, device=device)
        self._moving.triangles = wp.array(faces.astype(np.int32), dtype=wp.vec3i, device=device)
        order = np.broadcast_to(given, (len(assets), rows))
        self._moving.order = wp.array(np.ascontiguousarray(order), dtype=wp.int32, ndim=2, device=device)
        self._moving.looseness = wp.full(len(assets), -2.0, dtype=wp.float32, device=device)
        self._moving.ages = wp.array(np.arange(len(assets)) % 8, dtype=wp.int32, device=device)  # not all at once
        self._moving.num_nodes = 1 + sum(int((level[:, 2] >= 0).sum()) for level in levels)
        shading = shading or Shading()
        self._moving.offset = shading.offset
        self._moving.num_smooth, self._moving.num_flat = shading.num_smooth, shading.num_flat
        entries = np.concatenate(levels[::-1]).astype(np.int32)
        self._moving.entries = wp.array(entries, dtype=wp.vec3i, device=device)
        self._counts = [len(level) for level in levels[::-1]]
        self._instances, self._rows = len(assets), rows

    def record(self, points: wp.array, normals: wp.array | None = None) -> list[Stage]:
        """Bind the stages that move all instances.

        Args:
            points: (point,) vec3, world frame [m].
            normals: (point,) vec3, unit, for faces that are not shaded as they lie.
        """
        moving, meshes, device = self._moving, self._meshes, self._device
        if normals is None:
            normals = wp.empty(0, dtype=wp.vec3, device=device)
        whole = self._instances * (THREADS if device.is_cuda else 1)
        stages = [record(keep_order, whole, [moving, meshes, points], device, block_dim=THREADS)]
        stages += [record(move_faces, self._instances * self._rows, [moving, meshes, points, normals], device)]
        begin = 0
        for count in self._counts:
            threads = self._instances * (count if self._by_child else 1)
            stages.append(record(move_boxes, threads, [moving, meshes, begin, count, self._by_child], device))
            begin += count
        stages.append(record(move_bounds, self._instances, [moving, meshes, self._by_child], device))
        return stages

    def _levels(self, first: int, wide: int) -> tuple[list[np.ndarray], int]:
        """Children that are there, by level from the root, (child, 3) node, number, code; how many faces they list."""
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
