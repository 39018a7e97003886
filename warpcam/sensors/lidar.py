"""A lidar in every world: rays of a pattern from a body, and the returns that they give."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera, bodies_of
from warpcam.core import torch_interop
from warpcam.core.arrays import per_world
from warpcam.core.errors import WarpcamError
from warpcam.core.memory_errors import memory_told
from warpcam.core.seeds import seeds_of
from warpcam.core.world_arrays import WorldArrays
from warpcam.core.world_mask import Selection
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.render.memory import Memory, estimate_memory, require_free
from warpcam.scene.scene import Scene
from warpcam.sensors.effect import parameter_array, parameters_of
from warpcam.sensors.kernels import scan_echoes, scan_measurement, scan_poses, scan_rays
from warpcam.sensors.lidar_noise import LidarDropout, LidarNoise
from warpcam.sensors.patterns.pattern import Pattern, parts_of
from warpcam.sensors.scan_lens import ScanLens, parallel_lens, spread_rays
from warpcam.sensors.scan_renderer import CAMERA, ScanRenderer, ScanSetup, reach_of

Alignment = Literal["base", "yaw", "world"]
Intensity = Literal["reflectivity", "raw"]
Frame = Literal["sensor", "world"]
Sweep = Literal["instant", "moving"]
ALIGNMENTS = {"base": scan_poses.BASE, "yaw": scan_poses.YAW, "world": scan_poses.WORLD}


@dataclass(frozen=True)
class Report:
    """One thing that a lidar reports.

    Attributes:
        dtype: Of its array.
        channels: Length of its last dimension; 0: it has none.
        needs: Outputs of the camera that it follows from.
    """

    dtype: Any
    channels: int = 0
    needs: tuple[str, ...] = ()


REPORTS: Mapping[str, Report] = {
    "ranges": Report(wp.float32),
    "intensities": Report(wp.float32, needs=("albedo", "normals")),
    "ids": Report(wp.int32, needs=("segmentation",)),
    "bodies": Report(wp.int32, needs=("bodies",)),
    "normals": Report(wp.float32, 3, needs=("normals",)),
    "points": Report(wp.float32, 3),
    "times": Report(wp.float32),
}
DEFAULT_OUTPUTS = ("ranges", "intensities", "ids", "points", "times")


class Lidar:
    """A lidar, or any sensor of rays, in every world.

    The sensor's frame has x ahead, y left and z up, as ROS and the makers' drivers have it: with the identity as
    ``rotation`` a lidar looks along its parent's x. A warpcam camera that looks the same way has the rotation
    ``rotation`` times (0.5, 0.5, -0.5, -0.5).

    Building one allocates all memory and compiles all kernels; ``read`` does neither, and waits for nothing.

    Args:
        scene: What to look at.
        pattern: Rays of a sweep: of ``warpcam.sensors.patterns``.
        parent: Name or index of the body to which it is fixed; None is the world.
        position: (3,) or (world, 3), in the parent's frame [m].
        rotation: Quaternion w x y z of any length but 0, (4,) or (world, 4), from the sensor's frame to the parent's.
        alignment: What of the parent's rotation the sensor follows: all of it ("base"), its turn about the world's z
            ("yaw"), as height scans do, or nothing ("world"). Its position follows in any case.
        outputs: What to report: names of the table at ``read``.
        frame: Frame of ``points``: the "sensor"'s, or the "world"'s.
        miss: Written to ``ranges`` and all coordinates of ``points`` where nothing returns: inf unless given, as
            ``distance`` of cameras has it and REP 117 asks for; Ouster's drivers have 0, MuJoCo -1, ROS's clouds NaN.
        intensity: "reflectivity", which does not fall with the range, as calibrated lidars report it; or "raw", which
            falls with its square.
        noise: Of ranges; None: none.
        dropout: Returns that are lost; None: none.
        echoes: Returns of each beam, from 1 to 7. More than 1 need ``divergence``, and give all outputs a dimension
            (echo,) after the columns.
        divergence: Full angle of the cone of a beam [degrees]; None: beams are lines. Of each beam 7 rays are traced.
        echo_gap: Surfaces of a beam that lie farther apart than this give echoes of their own [m]; goes with
            ``divergence``.
        sweep: "instant": all rays are sent from where the sensor is now. "moving": each is sent from where the sensor
            was at its time if a sweep lasts from one read to the next, on a straight line and at a constant turn. The
            scene is as it is now in both. Each world takes 32 bytes for each ray then. The first read of a world, and
            that after a reset, is instant.
        exclude_body: A body that the sensor does not see, as its own housing, or several; name or index.
        far_sides: Whether a ray that begins within a sphere, capsule, ellipsoid, cylinder or box meets its far side, as
            MuJoCo's rays do; the normal there points outwards. Else it sees out. Not with "intensities",
            ``divergence``, ``sweep="moving"`` and patterns of a table.
        seed: Whole number, or int32 (world,), one for each world. Random numbers follow from it, the world, how often
            the world was read, and the ray alone, whatever the number of worlds. Lidars with the same seed have the
            same numbers: give each of a robot's its own.
        graph: As ``Renderer`` has it.

    Attributes:
        pattern: As given.
        scan: What was reported last, by output; the same tensors at each read.
        parameters: Tensors (world, ...) that may be written in place and that ``warpcam.randomize`` draws:
            ``position``, ``rotation``, ``min_range``, ``max_range``, and those of ``noise`` and ``dropout``, named like
            ``noise_offset`` and ``dropout_rate``.
        renderer: Renderer of the rays; its images are the truth.
        memory: What was allocated for it all, images of the rays and returns; its poses and parameters aside.

    Raises:
        WarpcamError: An argument does not fit; ``OutOfMemoryError`` if the device has too little memory free.
    """

    @memory_told("Lidar")
    def __init__(
        self,
        scene: Scene,
        pattern: Pattern,
        *,
        parent: str | int | None = None,
        position: Any = (0.0, 0.0, 0.0),
        rotation: Any = (1.0, 0.0, 0.0, 0.0),
        alignment: Alignment = "base",
        outputs: Sequence[str] = DEFAULT_OUTPUTS,
        frame: Frame = "sensor",
        miss: float = math.inf,
        intensity: Intensity = "reflectivity",
        noise: LidarNoise | None = None,
        dropout: LidarDropout | None = None,
        echoes: int = 1,
        divergence: float | None = None,
        echo_gap: float | None = None,
        sweep: Sweep = "instant",
        exclude_body: str | int | Sequence[str | int] = (),
        far_sides: bool = False,
        seed: Any = 0,
        graph: bool = True,
    ):
        if not isinstance(scene, Scene):
            raise WarpcamError(f"Lidar: scene must be made by from_mujoco_warp or the like, got {type(scene).__name__}")
        if not isinstance(pattern, Pattern):
            raise WarpcamError(f"Lidar: pattern must be of warpcam.sensors.patterns, got {pattern!r}")
        for name, value, allowed in (
            ("alignment", alignment, get_args(Alignment)),
            ("frame", frame, get_args(Frame)),
            ("intensity", intensity, get_args(Intensity)),
            ("sweep", sweep, get_args(Sweep)),
        ):
            if not isinstance(value, str) or value not in allowed:
                raise WarpcamError(f"Lidar: {name} must be {' or '.join(map(repr, allowed))}, got {value!r}")
        if isinstance(miss, bool) or not isinstance(miss, int | float | np.number):
            raise WarpcamError(f"Lidar: miss must be a number, got {miss!r}")
        torch_interop.require_no_capture(scene.device, "Lidar")
        self.pattern, self._device, self._num_worlds = pattern, scene.device, scene.num_worlds
        self._outputs = _check_outputs(outputs)
        self._echoes = _check_echoes(echoes, divergence, echo_gap)
        traced = pattern if divergence is None else spread_rays(pattern, divergence)
        moves = sweep == "moving"
        parts = parts_of(traced, 'Lidar: sweep="moving"') if moves else None
        if not isinstance(far_sides, bool | np.bool_):
            raise WarpcamError(f"Lidar: far_sides must be True or False, got {far_sides!r}")
        if far_sides:
            _check_far_sides(self._outputs, pattern, divergence, moves)
        origins = np.zeros_like(traced.directions) if moves and traced.origins is None else traced.origins
        parallel = None if moves or divergence is not None else parallel_lens(pattern)
        camera = Camera(
            CAMERA,
            width=traced.columns,
            height=traced.rows,
            outputs=("distance", *_camera_outputs(self._outputs)),
            lens=ScanLens(traced.directions, origins, per_world=moves) if parallel is None else parallel[0],
            position=position,
            rotation=rotation,
            far=pattern.max_range,
            exclude_bodies=bodies_of(exclude_body, "Lidar: exclude_body"),
        )
        for body in camera.exclude_bodies:
            scene.body(body, "Lidar: exclude_body")
        self.memory = self._memory(estimate_memory(scene, [camera]))
        require_free(self.memory, scene.device)
        arrays, limits = {}, {}
        for name in ("min_range", "max_range"):
            values = np.full(self._num_worlds, getattr(pattern, name), np.float32)
            arrays[name], limits[name] = wp.array(values, device=self._device), (0.0, math.inf)
        models = {"noise": _model("noise", noise, LidarNoise), "dropout": _model("dropout", dropout, LidarDropout)}
        for name, model in models.items():
            for entry in parameters_of(model):
                arrays[f"{name}_{entry.name}"] = parameter_array(model, entry, "Lidar", self._num_worlds, self._device)
                limits[f"{name}_{entry.name}"] = (entry.metadata["low"], entry.metadata["high"])
        scan = self._make_scan(miss, intensity == "raw", frame == "world")
        self._poses = self._make_poses()
        mount = scan_poses.Mount()
        mount.parent = -1 if parent is None else scene.body(parent, "Lidar: parent")
        mount.alignment = ALIGNMENTS[alignment]
        mount.positions, mount.rotations = self._make_mount(position, rotation)
        params = scan_measurement.ScanParams()
        for name, array in arrays.items():
            setattr(params, name, array)
        setup = ScanSetup(
            mount=mount,
            poses=self._poses,
            rays=self._make_rays(traced, parts, flipped=parallel is not None and parallel[1]),
            scan=scan,
            params=params,
            seeds=seeds_of(seed, "Lidar", self._num_worlds, self._device),
            echoes=self._make_echoes(divergence is not None),
            gap=0.0 if echo_gap is None else float(echo_gap),
            moves=moves,
            reach=reach_of(traced.origins),
            far_sides=bool(far_sides),
            place=self._place,
        )
        self.renderer = ScanRenderer(scene, camera, setup, graph=graph)
        arrays = {"position": mount.positions, "rotation": mount.rotations, **arrays}
        self.parameters = WorldArrays("Lidar", arrays, self._num_worlds, self._device, limits)
        self._selection = Selection(self._num_worlds, self._device)
        inputs = [self._selection.mask, self._poses.known]
        self._forget = bind_launch(scan_poses.forget_poses, self._num_worlds, inputs, self._device)
        self._forget.prepare()

    def read(self, worlds: Any = None, forward: bool = False) -> Mapping[str, torch_interop.Tensor]:
        """Send the rays of one sweep into the state as it is now.

        On CUDA the work is queued as that of ``Renderer.render`` is, and may be part of a capture.

        Args:
            worlds: Which worlds, as ``Renderer.render`` takes them; the others' returns stay. None is all.
            forward: Have the simulator compute poses from its state first.

        Returns:
            ``scan``: by output, tensors on the scene's device, (world, rows, columns), or (world, rows, columns, echo),
            the strongest echo first:

            - ``ranges`` float32 [m], from where a ray begins; ``miss`` where nothing returns.
            - ``intensities`` float32: luminance (Rec. 709) of the albedo in linear light, times the cosine of the angle
              between ray and normal, times exp(-attenuation r); "raw" divides by r^2 [m^2], too. Of echoes: the sum
              over the rays that end there, over 7. 0 where nothing returns.
            - ``ids`` int32: as ``segmentation``; -1 where nothing returns. ``bodies`` likewise.
            - ``normals`` float32, (..., 3): unit, world frame; 0 where nothing returns.
            - ``points`` float32, (..., 3) [m]: where the measured range ends; in the sensor's frame at the time of the
              ray, or in the world's. ``miss`` where nothing returns.
            - ``times`` float32 [s]: from the sweep's beginning, the pattern's own; one memory for all worlds.
        """
        self.renderer.draw(worlds, forward, "Lidar.read")
        return self.scan

    def reset(self, worlds: Any = None) -> None:
        """Forget where the sensor was at the last read, which only ``sweep="moving"`` asks for.

        To be called when a world has jumped to another state. Random numbers go on, so that no two episodes have the
        same noise. It may be part of a capture.

        Args:
            worlds: As ``read`` takes them.
        """
        with self.renderer.lock, torch_interop.in_order(self._device) as capturing:
            if worlds is None:
                self._poses.known.zero_()
                return
            self._selection.select(worlds, capturing, "Lidar.reset")
            self._forget.launch()

    def __reduce__(self) -> Any:
        raise WarpcamError("Lidar: it cannot be copied or pickled, as it holds memory of a device; make another one")

    def _place(self, positions: wp.array, rotations: wp.array) -> Sequence[Stage]:
        """Stages of a subclass that place the sensor in its own way."""
        return ()

    def _memory(self, images: Memory) -> Memory:
        """Memory of the rays' images and of what is reported."""
        returns = self._num_worlds * self.pattern.rows * self.pattern.columns * self._echoes
        reported = {
            name: 4 * returns * max(REPORTS[name].channels, 1) for name in {*self._outputs, "ranges"} - {"times"}
        }
        return replace(images, images={**images.images, "returns": reported})

    def _make_scan(self, miss: float, raw: bool, in_world: bool) -> Any:
        """The struct of outputs, and their tensors in ``scan``."""
        scan = scan_measurement.Scan()
        scan.miss, scan.raw, scan.in_world = miss, int(raw), int(in_world)
        shape = (self._num_worlds, self.pattern.rows, self.pattern.columns, *([self._echoes] * (self._echoes > 1)))
        count = self.pattern.rows * self.pattern.columns * self._echoes
        self.scan: dict[str, torch_interop.Tensor] = {}
        for name, report in REPORTS.items():
            if name == "times":
                continue
            wanted = name in self._outputs or name == "ranges"
            if not wanted:
                continue
            ends = (report.channels,) if report.channels else ()
            array = wp.zeros((self._num_worlds, count, *ends), dtype=report.dtype, device=self._device)
            setattr(scan, name, array)
            self.scan[name] = torch_interop.to_torch(array).view((*shape, *ends))
        if "times" in self._outputs:
            times = torch_interop.to_torch(wp.array(self.pattern.times, dtype=wp.float32, device=self._device))
            of_world = times if self._echoes == 1 else times[..., None].expand(shape[1:]).contiguous()
            self.scan["times"] = of_world.expand(shape)
        self.scan = {name: self.scan[name] for name in self._outputs}
        return scan

    def _make_echoes(self, widens: bool) -> Any:
        echoes = scan_measurement.Echoes()
        if widens:
            echoes.count, echoes.spread = self._echoes, scan_echoes.SPREAD
            shape = (self._num_worlds, self.pattern.rows * self.pattern.columns * self._echoes)
            echoes.distance, echoes.light = (wp.zeros(shape, dtype=wp.float32, device=self._device) for _ in range(2))
            echoes.rays = wp.zeros(shape, dtype=wp.int32, device=self._device)
        return echoes

    def _make_poses(self) -> Any:
        poses, worlds, device = scan_poses.ScanPoses(), self._num_worlds, self._device
        poses.known = wp.zeros(worlds, dtype=wp.uint8, device=device)
        poses.positions, poses.last_positions = (wp.zeros(worlds, dtype=wp.vec3, device=device) for _ in range(2))
        poses.rotations, poses.last_rotations = (wp.zeros(worlds, dtype=wp.quat, device=device) for _ in range(2))
        return poses

    def _make_mount(self, position: Any, rotation: Any) -> tuple[wp.array, wp.array]:
        positions = per_world(position, "Lidar: position", self._num_worlds, (3,))
        rotations = per_world(rotation, "Lidar: rotation", self._num_worlds, (4,)).astype(np.float64)
        lengths = np.linalg.norm(rotations, axis=1, keepdims=True)
        if not lengths.all():
            raise WarpcamError(f"Lidar: rotation must not be of length 0, got {rotation!r}")
        unit = (rotations / lengths).astype(np.float32)
        return (
            wp.array(positions, dtype=wp.vec3, device=self._device),
            wp.array(unit, dtype=wp.vec4, device=self._device),
        )

    def _make_rays(self, traced: Pattern, parts: np.ndarray | None, flipped: bool) -> Any:
        rays, device = scan_rays.ScanRays(), self._device
        table = traced.directions if traced.table is None else traced.table
        rays.directions = wp.array(table.reshape(-1, 3), dtype=wp.vec3, device=device)
        rays.rows, rays.columns, rays.flipped = traced.rows, traced.columns, int(flipped)
        if traced.origins is not None:
            rays.origins = wp.array(traced.origins.reshape(-1, 3), dtype=wp.vec3, device=device)
        if parts is not None:
            rays.parts = wp.array(parts.reshape(-1), dtype=wp.float32, device=device)
        if traced.table is not None:
            begin = -traced.rows * traced.columns % len(table)  # the first read goes on to 0
            rays.window = wp.array([begin], dtype=wp.int32, device=device)
        return rays


def _check_outputs(outputs: Any) -> tuple[str, ...]:
    names = outputs if isinstance(outputs, Sequence) and not isinstance(outputs, str) else ()
    if not names or not all(isinstance(name, str) and name in REPORTS for name in names):
        raise WarpcamError(f"Lidar: outputs must be some of {', '.join(map(repr, REPORTS))}, got {outputs!r}")
    return tuple(dict.fromkeys(names))


def _camera_outputs(outputs: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(need for name in outputs for need in REPORTS[name].needs))


def _check_echoes(echoes: Any, divergence: Any, gap: Any) -> int:
    most = scan_echoes.SPREAD
    if isinstance(echoes, bool) or not isinstance(echoes, int | np.integer) or not 1 <= echoes <= most:
        raise WarpcamError(f"Lidar: echoes must be a whole number from 1 to {most}, got {echoes!r}")
    if (divergence is None) != (gap is None):
        raise WarpcamError(f"Lidar: divergence and echo_gap go together, got {divergence!r} and {gap!r}")
    if divergence is None:
        if echoes > 1:
            raise WarpcamError(f"Lidar: {echoes} echoes need divergence and echo_gap; a ray alone gives one")
        return int(echoes)
    for name, value, highest in (("divergence", divergence, 90.0), ("echo_gap", gap, math.inf)):
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0.0 < value < highest:
            raise WarpcamError(f"Lidar: {name} must be a number in (0, {highest:g}), got {value!r}")
    return int(echoes)


def _check_far_sides(outputs: Sequence[str], pattern: Pattern, divergence: Any, moves: bool) -> None:
    """Raise for what goes by what is seen out of shapes."""
    for name, given in (
        ('outputs with "intensities"', "intensities" in outputs),
        ("divergence", divergence is not None),
        ('sweep="moving"', moves),
        ("a pattern that has a table", pattern.table is not None),
    ):
        if given:
            raise WarpcamError(f"Lidar: far_sides and {name} do not go together")


def _model(name: str, given: Any, kind: type) -> Any:
    """The model that was given, or that of nothing."""
    if given is not None and not isinstance(given, kind):
        raise WarpcamError(f"Lidar: {name} must be sensors.{kind.__name__} or None, got {given!r}")
    return kind() if given is None else given
