"""A renderer of the rays of a lidar, which are placed before each frame and measured after it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.accel import offset_ray_tables, ray_tables
from warpcam.camera.camera import Camera
from warpcam.core.color import srgb_to_linear
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import PLANE
from warpcam.render.renderer import Renderer
from warpcam.scene.scene import Scene
from warpcam.sensors.kernels import scan_echoes, scan_measurement, scan_planes, scan_poses, scan_rays
from warpcam.sensors.kernels.far_sides import bind_far_sides
from warpcam.sensors.kernels.random import Randomness
from warpcam.sensors.kernels.scan_echoes import SPREAD

CAMERA = "lidar"
BLOCK_DIM = 32  # of stages with a thread for each world
STREAM = 1 << 30  # of random numbers: rigs of the same seed have others
# Rec. 709 luminance of display values, by channel.
LUMINANCE = np.outer((0.2126, 0.7152, 0.0722), srgb_to_linear(np.arange(256) / 255.0)).ravel()
CPU_RUN = 64  # returns that a thread of a CPU writes: arguments are copied for each thread


@dataclass(frozen=True, eq=False)
class ScanSetup:
    """What is bound to each frame of a lidar.

    Attributes:
        mount: ``Mount``, but for the arrays of the scene.
        poses: ``ScanPoses``.
        rays: ``ScanRays``.
        scan: ``Scan``.
        params: ``ScanParams``.
        seeds: int32, (world,).
        echoes: ``Echoes``.
        gap: Between echoes [m].
        moves: Rays are sent on the way from the last pose to this.
        reach: How far from the sensor's position rays begin at most [m].
        far_sides: Rays that begin within a solid shape meet its far side.
        place: Gives the stages that place the sensor once more, of the camera's arrays of positions and rotations.
    """

    mount: Any
    poses: Any
    rays: Any
    scan: Any
    params: Any
    seeds: wp.array
    echoes: Any
    gap: float
    moves: bool
    reach: float
    far_sides: bool
    place: Callable[[wp.array, wp.array], Sequence[Stage]]


class ScanRenderer(Renderer):
    """Renders one camera, whose lens is a table of rays."""

    def __init__(self, scene: Scene, camera: Camera, setup: ScanSetup, *, graph: bool = True):
        self._setup = setup
        self._luminance = wp.array(LUMINANCE, dtype=wp.float32, device=scene.device)
        super().__init__(scene, [camera], graph=graph)

    def _head(self, everything: bool) -> list[Stage]:
        """Stages that place the sensor, and write its rays where they change."""
        setup, scene, device, mask = self._setup, self._scene, self._device, self._selection.mask
        binding, rays = self._bindings[CAMERA], setup.rays
        mount = setup.mount
        mount.parent_positions, mount.parent_rotations = scene.array("body_positions"), scene.array("body_rotations")
        pose = [binding.arrays["position"], binding.arrays["rotation"]]
        inputs = [mount, mask, int(everything), setup.poses, *pose, setup.params.max_range, binding.arrays["far"]]
        worlds = scene.num_worlds
        stages = [
            bind_launch(scan_poses.place_sensor, worlds, inputs, device, block_dim=BLOCK_DIM),
            *setup.place(*pose),
        ]
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
        """Stages that measure."""
        setup, device, mask = self._setup, self._device, self._selection.mask
        images = self._passes[CAMERA].images
        worlds, pixels = self._scene.num_worlds, setup.rays.rows * setup.rays.columns
        traced, randomness = scan_measurement.TracedScan(), Randomness()
        traced.distance = images["distance"].reshape((worlds, pixels))
        for name, output in (("shapes", "segmentation"), ("bodies", "bodies")):
            if output in images:
                setattr(traced, name, images[output].reshape((worlds, pixels)))
        for name in ("normals", "albedo"):
            if name in images:
                setattr(traced, name, images[name].reshape((worlds, pixels, 3)))
        traced.luminance = self._luminance
        randomness.seeds, randomness.frames = setup.seeds, self._counters.frames
        randomness.stream = STREAM
        seen: list[Any] = [mask, setup.rays, setup.poses, traced, self._planes()]
        stages = []
        if setup.far_sides:
            tables = self._bindings[CAMERA].camera_tables(self._scene.tables())
            shapes, materials = tables.shapes, tables.materials
            limit, rays, poses = setup.params.max_range, setup.rays, setup.poses
            stages.append(bind_far_sides(mask, limit, shapes, materials, rays, poses, traced, worlds, device))
        if setup.echoes.spread:
            inputs = [*seen, setup.params, setup.gap, setup.echoes]
            stages.append(bind_launch(scan_echoes.find_echoes, worlds * pixels // SPREAD, inputs, device))
        run = 1 if device.is_cuda else CPU_RUN
        inputs = [*seen, setup.echoes, setup.params, randomness, setup.scan, run]
        threads = worlds * -(-setup.scan.ranges.shape[1] // run)
        return [[[*stages, bind_launch(scan_measurement.measure, threads, inputs, device)]]]

    def _planes(self) -> Any:
        planes = scan_planes.EndlessPlanes()
        shapes = self._bindings[CAMERA].camera_tables(self._scene.tables()).shapes
        drawn = shapes.drawn.numpy()
        numbers = drawn[shapes.types.numpy()[drawn] == PLANE]
        planes.shapes = wp.array(numbers, dtype=wp.int32, device=self._device)
        planes.positions, planes.rotations, planes.sizes = shapes.positions, shapes.rotations, shapes.sizes
        return planes


def reach_of(origins: np.ndarray | None) -> float:
    """How far from the sensor's position rays begin at most [m]."""
    return (
        0.0 if origins is None else float(np.linalg.norm(origins, axis=-1).max()) * (1.0 + offset_ray_tables.ROUNDING)
    )
