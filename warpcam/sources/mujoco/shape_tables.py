"""The tables of shapes of a MuJoCo scene that has more than geoms, and the stages that write them on the device."""

import operator
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.types import Meshes
from warpcam.kernels.update.refit import DeformingTree, kernels_of
from warpcam.kernels.update.skinning import SkinWeights, bind_offset_vertices, bind_skin, offset_vertices
from warpcam.scene.source import LIVE_ARRAYS
from warpcam.sources.mujoco.kernels.tendon_limits import bind_limit_impedance, write_limit_impedance
from warpcam.sources.mujoco.kernels.visual_geoms import (
    CRANK,
    EDGE,
    MARK,
    SEGMENT,
    STRING,
    ShapeTable,
    VisualGeomTable,
    bind_shape_table,
    kernel_of,
)
from warpcam.sources.mujoco.visual_geoms import VisualGeoms

# What is read beside the fields of a scene, by our names: theirs in mjData, and in MuJoCo-Warp's Data.
MARKS: Mapping[str, str] = {"mark_positions": "site_xpos", "mark_rotations": "site_xmat"}
PATHS: Mapping[str, str] = {
    "stops": "wrap_xpos",
    "stop_objects": "wrap_obj",
    "path_starts": "ten_wrapadr",
    "path_counts": "ten_wrapnum",
}
LENGTHS: Mapping[str, str] = {"path_lengths": "ten_length"}
VERTICES: Mapping[str, str] = {"vertices": "flexvert_xpos"}
DTYPES: Mapping[str, Any] = {
    "mark_positions": wp.vec3,
    "mark_rotations": wp.mat33,
    "stops": wp.vec3,
    "stop_objects": wp.int32,
    "path_starts": wp.int32,
    "path_counts": wp.int32,
    "path_lengths": wp.float32,
    "vertices": wp.vec3,
}
TABLE = ("positions", "rotations", "sizes", "assets", "materials", "colors")


def names_of(extras: VisualGeoms | None) -> dict[str, str]:
    """Return the simulator's arrays that visual geoms read, by our names."""
    names: dict[str, str] = {}
    if extras is not None:
        if extras.reads(MARK) or extras.reads(CRANK):
            names.update(MARKS)
        if extras.reads(SEGMENT) or extras.reads(STRING):
            names.update(PATHS)
        if extras.held is not None:
            names.update(LENGTHS)
        if extras.reads(EDGE) or any(not part.of_skin for part in extras.moved):
            names.update(VERTICES)
    return names


class VisualGeomArrays:
    """Tables of all shapes, geoms and others; written at the head of each frame."""

    def __init__(self, extras: VisualGeoms, num_worlds: int, num_meshes: int, device: wp.Device):
        self._extras, self._num_worlds, self._first_mesh, self._device = extras, num_worlds, num_meshes, device
        self._what = wp.array(extras.entries, dtype=wp.vec4i, device=device)
        self._lengths = wp.array(extras.lengths, dtype=wp.float32, device=device)
        self._crank_colors = wp.array(extras.crank_colors, dtype=wp.vec4, device=device)
        self._radii = wp.array(extras.radii, dtype=wp.float32, device=device)
        self._types = wp.array(extras.types, dtype=wp.int32, device=device)
        self._offsets = wp.array(extras.offsets, dtype=wp.vec3, device=device)
        self._turns = wp.array(extras.turns, dtype=wp.mat33, device=device)
        self._colors = extras.colors
        self._held = extras.held.upload(device) if extras.held is not None else None
        self._over = extras.held.upload(device) if extras.held is not None else None
        if self._held is not None:
            self._held.colors = wp.array(extras.colors[None], dtype=wp.vec4, device=device)
        self._table: dict[str, wp.array] = {}
        self._arrays: dict[str, wp.array] = {}
        self._last: tuple[Any, ...] = ()
        self._stages: tuple[Stage, ...] | None = None
        self._blending: tuple[wp.array, Stage] | None = None
        self._live: Mapping[str, wp.array] = {}
        self._trees: list[DeformingTree] | None = None
        points = (num_worlds, extras.num_points)
        self._points, self._normals = (wp.zeros(points, dtype=wp.vec3, device=device) for _ in range(2))
        self._skin = wp.zeros((num_worlds, extras.num_skin_vertices), dtype=wp.vec3, device=device)
        self._surfaces = [part.hull.upload(device) for part in extras.moved]
        self._bones = SkinWeights()
        self._bones.starts = wp.array(extras.bonds.starts, dtype=wp.int32, device=device)
        self._bones.bodies = wp.array(extras.bonds.bodies, dtype=wp.int32, device=device)
        self._bones.places = wp.array(extras.bonds.places, dtype=wp.vec4, device=device)

    def arrays(self, live: Mapping[str, wp.array]) -> Mapping[str, wp.array]:
        """The scene's arrays, made of the simulator's, which are given by the names of fields and those above."""
        values = tuple(live.values())
        if len(values) != len(self._last) or not all(map(operator.is_, values, self._last)):
            self._bind(live)
            self._last = values
        return self._arrays

    def paint(self, colors: np.ndarray) -> None:
        """Give the columns these colours, (column, 4) float32. Those of geoms are written from the live array."""
        if np.array_equal(colors, self._colors):
            return
        self._colors = colors
        if self._held is not None:
            self._held.colors.assign(colors[None])
        if "colors" in self._table:
            table = self._table["colors"]
            table.assign(np.broadcast_to(colors, (table.shape[0], *colors.shape)))

    def without_blend(self, colors: np.ndarray) -> np.ndarray:
        """Return the table's colours, (world*, column, 4), without the change at limits."""
        if self._extras.held is not None:
            columns = self._extras.held.columns
            colors[:, columns] = self._colors[columns]
        return colors

    def blend(self, painted: wp.array) -> tuple[Stage, ...]:
        """Return the stages that blend written colours, (world, column), with those of limits.

        They run each frame after ``stages`` and the colours' writers.
        """
        if self._held is None or self._over is None:
            return ()
        if self._blending is None or self._blending[0] is not painted:
            self._over.lengths, self._over.colors = self._held.lengths, painted
            self._blending = painted, bind_limit_impedance(self._over, painted, self._device)
        return (self._blending[1],)

    def kernels(self) -> list[wp.Kernel]:
        """Return the kernels of the stages."""
        kernels = [kernel_of(self._extras.kinds)]
        if self._held is not None:
            kernels.append(write_limit_impedance)
        moving = [offset_vertices, *kernels_of(False, self._device)] if self._extras.moved else []
        return [*kernels, *moving]

    def stages(self, meshes: Meshes) -> tuple[Stage, ...]:
        """Return the stages that write the tables and move meshes.

        It is the same tuple until the simulator's arrays change.
        """
        if self._stages is None:
            self._stages = tuple(self._record(meshes))
        return self._stages

    def _bind(self, live: Mapping[str, wp.array]) -> None:
        for name, dtype in DTYPES.items():
            if name in live and not isinstance(live[name], wp.array):
                raise WarpcamError(f"{name}: a Warp array of {dtype.__name__} is needed, got {type(live[name])}")
        rows = {name: live[f"shape_{name}"].shape[0] for name in TABLE}
        rows["assets"] = self._num_worlds if self._extras.moved else rows["assets"]
        rows["sizes"] = self._num_worlds if self._extras.lines else rows["sizes"]
        colored = self._held is not None or self._extras.reads(CRANK)
        rows["colors"] = self._num_worlds if colored else rows["colors"]
        for name in TABLE:
            if name not in self._table or self._table[name].shape[0] != rows[name]:
                self._table[name] = self._make(name, rows[name])
        self._live = live
        self._arrays = {name: live[name] for name in (*LIVE_ARRAYS, "headlight")}
        self._arrays.update({f"shape_{name}": array for name, array in self._table.items()})
        self._stages = self._blending = None

    def _make(self, name: str, rows: int) -> wp.array:
        """A table with what never changes in its columns."""
        extras, shape = self._extras, (rows, self._extras.num_columns)
        if name == "rotations":
            host = np.broadcast_to(np.eye(3, dtype=np.float32), (*shape, 3, 3)).copy()
        elif name == "positions":
            host = np.zeros((*shape, 3), np.float32)
        else:
            values = self._colors if name == "colors" else getattr(extras, name)
            host = np.broadcast_to(values, (rows, *values.shape)).copy()
        if name == "assets":
            for number, part in enumerate(extras.moved):
                host[:, part.column] = self._first_mesh + number * self._num_worlds + np.arange(rows)
        return wp.array(host, dtype=LIVE_ARRAYS[f"shape_{name}"].dtype, ndim=2, device=self._device)

    def _record(self, meshes: Meshes) -> list[Stage]:
        device, live = self._device, self._live
        entries, table = VisualGeomTable(), ShapeTable()
        entries.what, entries.radii, entries.lengths = self._what, self._radii, self._lengths
        entries.crank_colors = self._crank_colors
        entries.up, entries.num_points = wp.vec3(*self._extras.up), self._extras.num_points_of_string
        entries.slices, entries.types = self._extras.slices, self._types
        entries.offsets, entries.turns = self._offsets, self._turns
        for name in TABLE:
            setattr(entries, name, live[f"shape_{name}"])
            setattr(table, name, self._table[name])
        read: dict[str, wp.array] = {}
        for name, dtype in DTYPES.items():
            if name in live:
                device_rule.require_same(device, "the scene's other arrays are", live[name].device, name)
                read[name] = _as(live[name], dtype)
            else:
                read[name] = wp.empty((0, 0), dtype=dtype, device=device)
        lengths = read.pop("path_lengths")
        for name, array in read.items():
            setattr(entries, name, array)
        stages = [bind_shape_table(entries, table, self._extras.kinds, device)]
        if self._held is not None:
            self._held.lengths = lengths
            stages.append(bind_limit_impedance(self._held, table.colors, device))
        if any(part.of_skin for part in self._extras.moved):
            bodies = live["body_positions"], live["body_rotations"]
            stages.append(bind_skin(self._bones, *bodies, self._skin, device))
        points, normals = self._points, self._normals
        flat = points.flatten(), normals.flatten()
        for part, surface, tree in zip(self._extras.moved, self._surfaces, self._make_trees(meshes), strict=True):
            vertices = self._skin if part.of_skin else entries.vertices
            stages.append(bind_offset_vertices(surface, vertices, points, normals, device))
            stages += tree.record(*flat)
        return stages

    def _make_trees(self, meshes: Meshes) -> list[DeformingTree]:
        if self._trees is None:
            self._trees = []
            worlds = np.arange(self._num_worlds)
            for number, part in enumerate(self._extras.moved):
                assets = self._first_mesh + number * self._num_worlds + worlds
                bases = worlds * self._extras.num_points + part.hull.first_point
                self._trees.append(DeformingTree(meshes, assets, bases, part.mesh.faces, self._device, part.shading))
        return self._trees


def _as(array: wp.array, dtype: Any) -> wp.array:
    """A contiguous array of rows that are several of ``dtype`` each, as (world, row) of that."""
    if array.dtype is dtype and array.ndim == 2:
        return array
    rows, size = array.shape[0], wp.types.type_size_in_bytes(dtype)
    width = array.size * wp.types.type_size_in_bytes(array.dtype) // (rows * size)
    return shared(array, (rows, width), dtype)


class ModelSource:
    """Parts that the sources of classic MuJoCo and MuJoCo-Warp share: stages of visual geoms, if there are any."""

    _tables: VisualGeomArrays | None

    @property
    def color_blend(self) -> VisualGeomArrays | None:
        return self._tables

    def kernels(self) -> list[wp.Kernel]:
        return [] if self._tables is None else self._tables.kernels()

    def stages(self, meshes: Meshes) -> tuple[Stage, ...]:
        return () if self._tables is None else self._tables.stages(meshes)

    def bind(self, state: Any) -> None:
        raise WarpcamError("bind: this scene reads the data that it was made from; make another scene for another")
