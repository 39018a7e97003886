"""Rays of one frame of mjlab's ray-cast sensor, as a lidar of warpcam."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import torch
import warp as wp

import warpcam as wc
from warpcam import sensors
from warpcam.compat.common.rows import columns_of
from warpcam.compat.mjlab import kernels
from warpcam.compat.mujoco_warp.context import load_groups
from warpcam.core import torch_interop
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.runtime.streams import preserve_cuda_context
from warpcam.sensors.lidar import ALIGNMENTS
from warpcam.sensors.scan_renderer import CPU_RUN

MISS = -1.0
PLACES = {"body": ("xpos", "xmat"), "site": ("site_xpos", "site_xmat"), "geom": ("geom_xpos", "geom_xmat")}


@dataclass(frozen=True)
class Frame:
    """What rays are attached to.

    Attributes:
        kind: "body", "site" or "geom".
        source: Its id.
        body: Id of the body that it is part of.
    """

    kind: str
    source: int
    body: int


@dataclass(frozen=True)
class Hits:
    """Arrays that all frames of a sensor write, (world, frame) and (world, ray)."""

    frame_positions: wp.array
    frame_rotations: wp.array
    distances: wp.array
    normals: wp.array
    positions: wp.array

    @classmethod
    def empty(cls, worlds: int, frames: int, rays: int, device: wp.Device) -> "Hits":
        """Arrays of nothing."""

        def of(count: int, dtype: Any) -> wp.array:
            return wp.zeros((worlds, count), dtype=dtype, device=device)

        return cls(of(frames, wp.vec3), of(frames, wp.vec4), of(rays, wp.float32), of(rays, wp.vec3), of(rays, wp.vec3))


class FrameRays:
    """The rays of one frame, in every world.

    Args:
        scene: What they may meet.
        d: ``mujoco_warp.Data``.
        frame: Where they begin.
        number: Of the frame among those of its sensor.
        offsets: (ray, 3), in the frame [m].
        directions: (ray, 3), unit.
        alignment: mjlab's ``ray_alignment``.
        max_distance: mjlab's [m].
        excludes: Whether shapes of the frame's body are not met.
        hits: Written by ``cast``.
    """

    def __init__(
        self,
        scene: wc.Scene,
        d: Any,
        frame: Frame,
        number: int,
        offsets: np.ndarray,
        directions: np.ndarray,
        alignment: str,
        max_distance: float,
        excludes: bool,
        hits: Hits,
    ):
        worlds, count, device = scene.num_worlds, len(directions), scene.device
        rows = (count // columns_of(offsets, directions), -1, 3)
        origins = offsets.reshape(rows) if offsets.any() else None  # a table without origins is traced faster
        self._lidar = sensors.Lidar(
            scene,
            sensors.patterns.rays(directions.reshape(rows), origins=origins, max_range=max_distance),
            outputs=("ranges", "normals"),
            miss=MISS,
            exclude_body=frame.body if excludes else (),
            far_sides=True,
        )
        self._device = device
        parameters, scan = self._lidar.parameters, self._lidar.scan
        mount = [_as(parameters.position, (worlds, 3), wp.vec3), _as(parameters.rotation, (worlds, 4), wp.vec4)]
        positions, rotations = (getattr(d, name) for name in PLACES[frame.kind])
        inputs = [positions, rotations, frame.source, ALIGNMENTS[alignment], number]
        inputs += [hits.frame_positions, hits.frame_rotations, *mount]
        self._place = bind_launch(kernels.place_frame, worlds, inputs, device)
        rays = [wp.array(table, dtype=wp.vec3, device=device) for table in (offsets, directions)]
        met = [_as(scan["ranges"], (worlds, count), wp.float32), _as(scan["normals"], (worlds, count, 3), wp.vec3)]
        inputs = [*mount, *rays, *met, number * count, hits.distances, hits.normals, hits.positions]
        run = 1 if device.is_cuda else CPU_RUN
        self._write = bind_launch(kernels.write_hits, worlds * -(-count // run), [*inputs, run], device)
        for stage in self.stages:
            stage.prepare()

    @property
    def stages(self) -> tuple[Stage, Stage]:
        """Those before the trace and after it."""
        return self._place, self._write

    def cast(self) -> None:
        """Send the rays into the state as it is now."""
        with torch_interop.in_order(self._device):
            self._place.launch()
            self._lidar.read()
            self._write.launch()


def load_casters(mjm: mujoco.MjModel, m: Any, d: Any, groups: tuple[int, ...]) -> wc.Scene:
    """The geoms of these groups that rays may meet."""
    with preserve_cuda_context():
        return load_groups(mjm, m, d, groups=groups, draw=("geoms",), reflections=False, transparency=False)


def _as(tensor: torch.Tensor, shape: tuple[int, ...], dtype: Any) -> wp.array:
    """The memory of a tensor as a Warp array."""
    return wp.from_torch(tensor.view(shape), dtype=dtype)
