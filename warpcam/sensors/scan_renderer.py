"""A renderer of the rays of a lidar, which are placed before each frame and measured after it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.accel import offset_ray_tables, ray_tables
from warpcam.camera.camera import Camera
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.render.renderer import Renderer
from warpcam.scene.scene import Scene
from warpcam.sensors.kernels import scan_echoes, scan_measurement, scan_poses, scan_rays
from warpcam.sensors.kernels.random import Randomness

CAMERA = "lidar"
BLOCK_DIM = 32  # of stages with a thread for each world


@dataclass(frozen=True, eq=False)
class ScanSetup:
    """What is bound to each frame of a lidar.

    Attributes:
        mount: ``Mount``, but for the arrays of the scene.
        poses: ``ScanPoses``.
        rays: ``ScanRays``.
        scan: ``Scan``.
        params: ``ScanParams``, but for ``max_range``.
        seeds: int32, (world,).
        echoes: Returns of a beam; 0: a beam is one ray.
        gap: Between echoes [m].
        moves: Rays are sent on the way from the last pose to this.
        reach: How far from the sensor's position rays begin at most [m].
    """

    mount: Any
    poses: Any
    rays: Any
    scan: Any
    params: Any
    seeds: wp.array
    echoes: int
    gap: float
    moves: bool
    reach: float


class ScanRenderer(Renderer):
    """Renders one camera, whose lens is a table of rays."""

    def __init__(self, scene: Scene, camera: Camera, setup: ScanSetup, *, graph: bool = True):
        self._setup = setup
        super().__init__(scene, [camera], graph=graph)

    @property
    def max_range(self) -> wp.array:
        """Farthest range of each world, (world,) float32 [m]; may be written."""
        return self._bindings[CAMERA].arrays["far"]

    def _head(self, everything: bool) -> list[Stage]:
        """Stages that place the sensor, and write its rays where they change."""
        setup, scene, device, mask = self._setup, self._scene, self._device, self._selection.mask
        binding, rays = self._bindings[CAMERA], setup.rays
        mount = setup.mount
        mount.parent_positions, mount.parent_rotations = scene.array("body_positions"), scene.array("body_rotations")
        pose = [binding.arrays["position"], binding.arrays["rotation"]]
        inputs = [mount, mask, int(everything), setup.poses, *pose]
        worlds = scene.num_worlds
        stages = [bind_launch(scan_poses.place_sensor, worlds, inputs, device, block_dim=BLOCK_DIM)]
        tiles = -(-rays.columns // ray_tables.TILE_WIDTH) * -(-rays.rows // ray_tables.TILE_HEIGHT)
        if rays.window is not None:
            stages.append(bind_launch(scan_rays.advance_window, 1, [rays], device))
        if setup.moves:
            inputs = [rays, setup.poses, setup.reach, mask, int(everything), binding.table, tiles]
            stages.append(bind_launch(scan_rays.write_moving_rays, worlds * tiles, inputs, device))
        elif rays.window is not None:
            stages.append(bind_launch(scan_rays.write_rays, tiles, [rays, binding.table, tiles], device))
        return stages

    def _tail(self) -> list[list[list[Stage]]]:
        """The stage that measures."""
        setup, device = self._setup, self._device
        images = self._passes[CAMERA].images
        size = (self._scene.num_worlds, setup.rays.rows * setup.rays.columns)
        traced, frame = scan_measurement.TracedScan(), scan_measurement.ScanFrame()
        traced.distance = images["distance"].reshape(size)
        for name, output in (("shapes", "segmentation"), ("bodies", "bodies")):
            if output in images:
                setattr(traced, name, images[output].reshape(size))
        for name in ("normals", "albedo"):
            if name in images:
                setattr(traced, name, images[name].reshape((*size, 3)))
        randomness = Randomness()
        randomness.seeds, randomness.frames = setup.seeds, self._counters.frames
        setup.params.max_range = self.max_range
        frame.rays, frame.poses, frame.traced = setup.rays, setup.poses, traced
        frame.params, frame.randomness, frame.scan = setup.params, randomness, setup.scan
        mask = self._selection.mask
        if not setup.echoes:
            return [[[bind_launch(scan_measurement.measure, size[0] * size[1], [mask, frame], device)]]]
        beams = size[0] * size[1] // scan_echoes.SPREAD
        inputs = [mask, frame, setup.gap, setup.echoes]
        return [[[bind_launch(scan_echoes.measure_echoes, beams, inputs, device)]]]


def reach_of(origins: np.ndarray | None) -> float:
    """How far from the sensor's position rays begin at most [m]."""
    return (
        0.0 if origins is None else float(np.linalg.norm(origins, axis=-1).max()) * (1.0 + offset_ray_tables.ROUNDING)
    )
