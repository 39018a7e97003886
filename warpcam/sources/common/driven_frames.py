"""Frames of a graph that a user drives, and the shapes, bodies, lights and cameras that hang on them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.kernels.runtime.launch import launch_kernel
from warpcam.kernels.update import poses
from warpcam.sources.common.geometry import polar
from warpcam.sources.common.scene_graph import SceneGraph

KINDS = ("shape", "body", "light", "camera")
HIDDEN = -1e30  # where nothing is left of a shape for a while [m]

Placed = tuple[int, np.ndarray, np.ndarray | None]  # node, (4, 4) to the world, and its rotation if that is another


class DrivenFrames:
    """Poses of driven frames on a device, and of all that follows them."""

    def __init__(self, graph: SceneGraph, num_worlds: int, device: wp.Device):
        self._graph, self._num_worlds, self._device = graph, num_worlds, device
        self._columns: dict[int, int] = {}  # of driven nodes
        self._frames = self._poses_of(0)
        self._attached = {kind: poses.AttachedPoses() for kind in KINDS}
        self._driven_kinds: list[str] = []

    def add(self, nodes: Sequence[int]) -> bool:
        """Have nodes be driven from now on; True if one is new, after which ``place`` is due."""
        new = [node for node in nodes if node not in self._columns]
        if not new:
            return False
        for node in new:
            self._columns[node] = len(self._columns)
        frames = self._poses_of(len(self._columns))
        for old, frame in zip(self._frames, frames, strict=True):
            host = frame.numpy()
            host[:, : old.shape[1]] = old.numpy()
            frame.assign(host)
        self._frames = frames
        return True

    def columns_of(self, nodes: Sequence[int]) -> wp.array:
        """Return the columns that hold the poses of driven nodes."""
        return wp.array([self._columns[node] for node in nodes], dtype=wp.int32, device=self._device)

    def place(self, worlds: np.ndarray, things: Mapping[str, Sequence[Placed]]) -> None:
        """Place things of each kind: in the world, or in the frame of the nearest driven node above them."""
        graph = self._graph
        driver = np.full(len(graph.nodes), -1, np.int64)
        for index, node in enumerate(graph.nodes):
            above = -1 if node.resets else node.parent
            driver[index] = index if index in self._columns else driver[above] if above >= 0 else -1
        self._driven_kinds = []
        for kind, rows in things.items():
            drivers, positions, rotations = [], np.zeros((len(rows), 3)), np.zeros((len(rows), 3, 3))
            for place, (index, matrix, turn) in enumerate(rows):
                matrix = matrix if np.isfinite(matrix).all() else _nowhere()
                position, rotation = matrix[:3, 3], polar(matrix[:3, :3])[0] if turn is None else turn
                if driver[index] >= 0:
                    frame = worlds[driver[index]]
                    back = polar(frame[:3, :3])[0].T
                    position, rotation = back @ (position - frame[:3, 3]), back @ rotation
                drivers.append(self._columns.get(int(driver[index]), -1))
                positions[place], rotations[place] = position, rotation
            if any(column >= 0 for column in drivers):
                self._driven_kinds.append(kind)
            attached = self._attached[kind]
            attached.drivers = wp.array(np.array(drivers, np.int32), dtype=wp.int32, device=self._device)
            attached.positions = wp.array(positions.astype(np.float32), dtype=wp.vec3, device=self._device)
            attached.rotations = wp.array(rotations.astype(np.float32), dtype=wp.mat33, device=self._device)

    def drive(self, nodes: Sequence[int], given: wp.array, columns: wp.array, arrays: Mapping[str, wp.array]) -> None:
        """Take poses (world*, path, 7) of driven nodes, and move what follows them; ``columns`` are the nodes'."""
        launch_kernel(
            poses.write_driven_poses,
            (self._num_worlds, len(nodes)),
            [given, columns],
            [*self._frames],
            device=self._device,
        )
        self._write(self._driven_kinds, arrays)

    def write_all(self, arrays: Mapping[str, wp.array]) -> None:
        """Write the poses of all things to a scene's live arrays."""
        self._write(KINDS, arrays)

    def _write(self, kinds: Sequence[str], arrays: Mapping[str, wp.array]) -> None:
        for kind in kinds:
            out = [arrays[f"{kind}_positions"], arrays[f"{kind}_rotations"]]
            if kind == "light":
                out.append(arrays["light_directions"])
            kernel = poses.update_attached_lights if kind == "light" else poses.update_attached
            if out[0].size:
                launch_kernel(kernel, out[0].shape, [self._attached[kind], *self._frames], out, device=self._device)

    def _poses_of(self, count: int) -> tuple[Any, ...]:
        """Positions and rotations of driven frames, (world, count)."""
        shape = (self._num_worlds, count)
        return tuple(wp.zeros(shape, dtype=dtype, device=self._device) for dtype in (wp.vec3, wp.mat33))


def _nowhere() -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = HIDDEN
    return matrix
