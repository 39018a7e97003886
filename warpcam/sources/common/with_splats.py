"""Any source's worlds with clouds of Gaussians fixed to bodies: further shapes after the source's own."""

import operator
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from warpcam.accel.gaussians import GaussianCloud
from warpcam.core.rotations import rotation_matrices
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.types import SPLATS, Meshes
from warpcam.kernels.update.fixed_clouds import FixedClouds, ShapeColumns, bind_fixed_clouds, write_fixed_clouds
from warpcam.scene.source import LIVE_ARRAYS, ColorBlend, SceneDescription, Source
from warpcam.scene.validation import find_body
from warpcam.sources.common.splats import Splats

TABLE = ("positions", "rotations", "sizes", "assets", "materials", "colors")
WORLD = -1  # body of what is fixed to the world


def with_splats(source: Source, splats: Sequence[Splats]) -> Source:
    """The source with these splats, or as it is where there are none."""
    return SplatSource(source, splats) if splats else source


class SplatSource:
    """A source whose table of shapes has a column more for each of ``splats``.

    The choice of each world is the live array ``splat_choice``, (world, splats) int32, that the user alone writes.
    """

    def __init__(self, source: Source, splats: Sequence[Splats]):
        self._source, self.device = source, source.device
        self.live_on_device = source.live_on_device
        own = source.parts
        clouds = [each.read() for each in splats]
        bodies = [WORLD if each.body is None else find_body(own, each.body, "Splats: body") for each in splats]
        opaque = any(each.opaque for each in splats)
        self.parts = replace(_extended(own, clouds, bodies), opaque_splats=opaque)
        choices = np.stack([each.choices(own.num_worlds) for each in splats], axis=1)
        turns = rotation_matrices(np.array([each.rotation for each in splats], np.float64))
        counts = [len(each) for each in clouds]
        self._fixed, self._scales = FixedClouds(), np.array([each.scales() for each in splats], np.float32)
        self._fixed.bodies = self._array(bodies, wp.int32)
        self._fixed.positions = self._array([each.position for each in splats], wp.vec3)
        self._fixed.rotations = self._array(turns, wp.mat33)
        self._fixed.first = self._array(len(own.clouds) + np.cumsum([0, *counts[:-1]]), wp.int32)
        self._fixed.counts = self._array(counts, wp.int32)
        self._fixed.choice = self._choice = wp.array(choices, dtype=wp.int32, device=self.device)
        self._table: dict[str, wp.array] = {}
        self._arrays: Mapping[str, wp.array] = {}
        self._last: tuple[wp.array, ...] = ()
        self._stage: Stage | None = None
        self._stages: tuple[Stage, ...] = ()

    @property
    def color_blend(self) -> ColorBlend | None:
        return self._source.color_blend

    def arrays(self) -> Mapping[str, wp.array]:
        live = self._source.arrays()
        values = tuple(live.values())
        if len(values) != len(self._last) or not all(map(operator.is_, values, self._last)):
            self._bind(live)
            self._last = values
        return self._arrays

    def user_owned(self, field: str) -> bool:
        if field == "splat_choice":
            return True
        return not field.startswith("shape_") and self._source.user_owned(field)

    def user_name(self, field: str) -> str:
        return field if field == "splat_choice" else self._source.user_name(field)

    def global_ambient(self) -> float:
        return self._source.global_ambient()

    def clock(self) -> wp.array | None:
        return self._source.clock()

    def refresh(self) -> None:
        self._source.refresh()

    def kernels(self) -> list[wp.Kernel]:
        return [*self._source.kernels(), write_fixed_clouds]

    def stages(self, meshes: Meshes) -> tuple[Stage, ...]:
        theirs = self._source.stages(meshes)
        assert self._stage is not None  # made by arrays(), which is called first
        if self._stages[:-1] != theirs or self._stages[-1] is not self._stage:
            self._stages = (*theirs, self._stage)
        return self._stages

    def bind(self, state: Any) -> None:
        self._source.bind(state)

    def forward(self) -> None:
        self._source.forward()

    def _array(self, values: Any, dtype: Any) -> wp.array:
        scalar = np.int32 if dtype is wp.int32 else np.float32
        return wp.array(np.asarray(values, scalar), dtype=dtype, ndim=1, device=self.device)

    def _bind(self, live: Mapping[str, wp.array]) -> None:
        """Record the stage for other arrays of the source, with room for what they need."""
        out, theirs = ShapeColumns(), ShapeColumns()
        for name in TABLE:
            array = live[f"shape_{name}"]
            rows = self.parts.num_worlds if name == "assets" else array.shape[0]
            if name not in self._table or self._table[name].shape[0] != rows:
                self._table[name] = self._room(name, rows)
            setattr(theirs, name, array)
            setattr(out, name, self._table[name])
        self._fixed.body_positions, self._fixed.body_rotations = live["body_positions"], live["body_rotations"]
        self._stage = bind_fixed_clouds(theirs, self._fixed, out, self.device)
        self._stages = (self._stage,)
        table = {f"shape_{name}": array for name, array in self._table.items()}
        self._arrays = {**live, **table, "splat_choice": self._choice}

    def _room(self, name: str, rows: int) -> wp.array:
        """An array of the table, with what never changes of the clouds."""
        count, dtype = len(self._scales), LIVE_ARRAYS[f"shape_{name}"].dtype
        fixed = {"sizes": self._scales, "materials": np.full(count, -1), "colors": np.ones((count, 4))}
        entry = {"positions": (3,), "rotations": (3, 3), "sizes": (3,), "colors": (4,)}.get(name, ())
        host = np.zeros((rows, len(self.parts.shape_types), *entry), np.float32 if entry else np.int32)
        if name in fixed:
            host[:, -count:] = fixed[name]
        return wp.array(host, dtype=dtype, ndim=2, device=self.device)


def _extended(
    parts: SceneDescription, clouds: Sequence[Sequence[GaussianCloud]], bodies: Sequence[int]
) -> SceneDescription:
    """The parts with a shape for each of these, which have the next free ids."""
    more, count = len(clouds), len(parts.shape_types)
    first = count if parts.shape_ids is None else int(parts.shape_ids.max(initial=-1)) + 1
    if parts.objects is not None:
        first = len(parts.objects) - 1
    if parts.shape_ids is None and first > count:  # some ids are of what has no shape
        every = (parts.num_worlds, count)
        own_ids, own_bodies = np.arange(count, dtype=np.int32), np.asarray(parts.shape_bodies, np.int32)
        parts = replace(parts, shape_ids=np.broadcast_to(own_ids, every), body_ids=np.broadcast_to(own_bodies, every))
    ids, owners = np.arange(first, first + more), np.maximum(bodies, 0)

    def widened(table: np.ndarray, values: Any) -> np.ndarray:
        values = np.broadcast_to(np.asarray(values, table.dtype), (*table.shape[:-1], more))
        return np.ascontiguousarray(np.concatenate((table, values), axis=-1))

    objects = parts.objects
    if objects is not None:  # no kind of MuJoCo's
        own = np.stack((np.arange(more), np.zeros(more)), axis=1)
        objects = np.concatenate((objects[:first], own, objects[-1:])).astype(np.int32)
    return replace(
        parts,
        shape_types=np.append(parts.shape_types, np.full(more, SPLATS)).astype(np.int32),
        shape_bodies=np.append(parts.shape_bodies, owners).astype(np.int32),
        shape_ids=None if parts.shape_ids is None else widened(parts.shape_ids, ids),
        body_ids=None if parts.body_ids is None else widened(parts.body_ids, owners),
        shape_instances=None if parts.shape_instances is None else widened(parts.shape_instances, -1),
        shape_semantics=None if parts.shape_semantics is None else widened(parts.shape_semantics, 0),
        coincident=widened(parts.coincident, -1) if len(parts.coincident) else parts.coincident,
        objects=objects,
        clouds=[*parts.clouds, *(cloud for each in clouds for cloud in each)],
        splat_counts=[len(each) for each in clouds],
    )
