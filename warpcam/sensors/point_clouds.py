"""Point clouds of many worlds, packed and thinned out on the device."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.memory_errors import memory_told
from warpcam.core.world_mask import Selection
from warpcam.kernels.runtime.launch import Stage, prepare
from warpcam.kernels.runtime.streams import preserve_cuda_context, recording_lock
from warpcam.render.drawn_cameras import DrawnCamera, drawn_cameras
from warpcam.render.renderer import Renderer
from warpcam.sensors.cloud_frames import CloudFrame, frame_of
from warpcam.sensors.cloud_options import CloudOptions, Corners, Method, Padding, check_excluded, check_names
from warpcam.sensors.kernels import point_clouds as kernels
from warpcam.sensors.point_sources import PixelPoints, Positions, of_camera, of_tensors
from warpcam.sensors.rig import Rig

CHOICES = {"first": kernels.FIRST, "uniform": kernels.UNIFORM, "farthest": kernels.PICKED}
MAX_THREADS = 2**31  # of a launch, and one more


class PointClouds:
    """Point clouds of a renderer's or a rig's cameras: one for each world, of several cameras together.

    ``read`` takes the images of the last ``render()``, or of the last ``read()`` of the rig: call that first. Points
    that count are packed in the order of their pixels, camera after camera and row after row: those that hit something,
    lie within ``bounds`` and are not excluded. With a ``voxel_size`` the first point of each voxel stays. Then
    ``num_points`` of them are chosen. A world's cloud has the same bits in every run on a device, whatever the number
    of worlds. Building one allocates all memory and compiles all kernels; ``read`` does neither, waits for nothing, and
    may be part of a CUDA graph.

    Args:
        renderer: Its cameras need the output ``points``, or ``depth`` with a pinhole or an orthographic lens. A ``Rig``
            is as good: clouds are of what it measures.
        cameras: Names of the cameras to merge, in their order; None is all.
        num_points: Points of each cloud, K.
        method: How K points are chosen where there are more. "farthest": the first, then again and again the point that
            is farthest from all chosen (farthest point sampling: Eldar et al., "The Farthest Point Strategy for
            Progressive Image Sampling", 1997), exactly, the first of those that are equally far. "uniform": any, all as
            likely, drawn anew at each read from ``seed``, in random order. "first": the first.
        voxel_size: Edge of a voxel [m]. Voxels are aligned with the origin of ``frame``, and of points more than 2^30
            voxels from it along an axis one stays for each side; ``bounds`` must lie nearer. None keeps all points.
        frame: Frame of points and normals: "world"; a camera of the renderer (x right, y up, z backward) as it was
            drawn; or a body as it is when ``read`` is called. A name that is both is told apart by ("camera", name) or
            ("body", name).
        bounds: Lowest and highest corner of a box in ``frame`` [m], both of it; points outside are left out.
        exclude: Ids to leave out, by output: {"bodies": (0,)}. The cameras need these outputs.
        attributes: Outputs that points bring along, as ("rgb", "normals", "segmentation").
        positions: The output that says where points are; None is "depth" where that was measured, by a rig or a stereo
            camera, and ``points`` were not, else "points" where a camera has it, else "depth".
        images: In place of the cameras' own images, {camera: {output: tensor}}: what was measured, in tensors as
            ``render()`` gives them, which are read at each ``read``. None is the rig's, or nothing.
        padding: What follows where a world has fewer points than K: "repeat" its points again, in their order; "zeros"
            zeros, and -1 as id. A world without any point has zeros.
        seed: Of "uniform", at least 0, below 2^31. A world's draw depends on it, on the world's number and on how many
            reads of the world there were.

    Attributes:
        cloud: What ``read`` returns, tensors on the device, the same memory at each read: "points", float32
            (world, K, 3) [m]; "count", int32 (world,), how many points are not padding; "pixels", int32 (world, K),
            number of the pixel among the pixels of all cameras, -1 for zeros; and each attribute with the dtype of its
            image, (world, K, channels), or (world, K) for one channel.

    Raises:
        WarpcamError: An argument is none of these, or a camera lacks an output.
    """

    @preserve_cuda_context()
    @memory_told("PointClouds")
    def __init__(
        self,
        renderer: Any,
        cameras: Sequence[str | int] | None = None,
        *,
        num_points: int = 1024,
        method: Method = "farthest",
        voxel_size: float | None = None,
        frame: str | tuple[str, str | int] = "world",
        bounds: Corners | None = None,
        exclude: Mapping[str, Sequence[int]] | None = None,
        attributes: Sequence[str] = (),
        positions: Positions | None = None,
        images: Mapping[str | int, Mapping[str, Any]] | None = None,
        padding: Padding = "repeat",
        seed: int = 0,
    ):
        if isinstance(renderer, Rig):
            images = renderer.images if images is None else images
        self._measured = renderer  # kept with its images
        drawing = renderer.renderer if isinstance(renderer, Rig) else renderer
        scene, drawn = drawn_cameras(drawing, "PointClouds")
        self._lock = drawing.lock if isinstance(drawing, Renderer) else recording_lock(scene.device)
        options = CloudOptions(num_points, method, voxel_size, bounds, padding, seed)
        chosen, names, excluded = _chosen(cameras, drawn), check_names(attributes), check_excluded(exclude)
        others = {} if images is None else images
        if not isinstance(others, Mapping) or not set(others) <= set(drawn):
            known = ", ".join(map(repr, drawn))
            raise WarpcamError(f"PointClouds: images must be a dictionary by camera, of {known}, got {images!r}")
        wanted = tuple(dict.fromkeys((*names, *excluded)))
        sources = [of_camera(drawn[key], positions, others.get(key), wanted, "PointClouds") for key in chosen]
        selection = Selection(scene.num_worlds, scene.device)
        self._build(sources, options, names, excluded, frame_of(frame, scene, drawn, selection.mask), selection)

    @classmethod
    def of(
        cls,
        points: Any,
        *,
        valid: Any = None,
        attributes: Mapping[str, Any] | None = None,
        num_points: int = 1024,
        method: Method = "farthest",
        voxel_size: float | None = None,
        bounds: Corners | None = None,
        exclude: Mapping[str, Sequence[int]] | None = None,
        padding: Padding = "repeat",
        seed: int = 0,
    ) -> "PointClouds":
        """Point clouds of any points, as a lidar gives them.

        All tensors are read in place at each ``read``: write to them. Clouds are in the frame of the points.

        Args:
            points: float32 (world, ..., 3) [m]; those that are not finite are left out.
            valid: bool or uint8 (world, ...): points with 0 are left out.
            attributes: By name, uint8, int32 or float32 (world, ...) or (world, ..., channels).
            num_points: See ``PointClouds``, as for all that follow.
            method: Likewise.
            voxel_size: Likewise.
            bounds: Likewise.
            exclude: Ids to leave out, by the name of an attribute of int32 with one channel.
            padding: Likewise; zeros are 0 in attributes, too.
            seed: Likewise.

        Raises:
            WarpcamError: An argument is none of these.
        """
        where = "PointClouds.of"
        options = CloudOptions(num_points, method, voxel_size, bounds, padding, seed)
        given = {} if attributes is None else attributes
        if not isinstance(given, Mapping):
            raise WarpcamError(f"{where}: attributes must be a dictionary of tensors, got {attributes!r}")
        names, excluded = check_names(tuple(given)), check_excluded(exclude)
        for name in excluded:
            if name not in given:
                raise WarpcamError(f"{where}: exclude has {name!r}; attributes are {', '.join(given) or 'none'}")
        source = of_tensors(points, valid, given, where)
        clouds = cls.__new__(cls)
        with preserve_cuda_context():
            selection = Selection(source.points.shape[0], source.points.device)
            clouds._lock = recording_lock(source.points.device)
            clouds._build([source], options, names, excluded, CloudFrame(), selection)
        return clouds

    def read(self, worlds: Any = None) -> dict[str, torch_interop.Tensor]:
        """Take the points of the images as they are now.

        On CUDA the work is queued, in order with what torch's and Warp's current streams hold, and nothing waits for
        it. Inside a capture it becomes part of the captured graph, for whose replays the clouds must be kept alive.

        Args:
            worlds: Which worlds, as ``Renderer.render`` takes them; the others' clouds stay. None is all.

        Returns:
            ``cloud``.
        """
        with self._lock, torch_interop.in_order(self._device) as capturing:
            self._select(worlds, capturing, "read")
            for stage in (*self._frame.stages(), *self._stages):
                stage.launch()
        return self.cloud

    def reset(self, worlds: Any = None) -> None:
        """Have "uniform" draw from now on what it drew from the first read on; other methods draw nothing.

        It is queued as ``read`` is, and may be part of a capture.

        Args:
            worlds: As ``read`` takes them.
        """
        with self._lock, torch_interop.in_order(self._device) as capturing:
            self._select(worlds, capturing, "reset")
            self._forget.launch()

    def __reduce__(self) -> Any:
        raise WarpcamError(
            "PointClouds: it cannot be copied or pickled, as it holds memory of a device; make another one"
        )

    def _select(self, worlds: Any, capturing: bool, call: str) -> None:
        if worlds is None:
            self._selection.mask.fill_(1)
        else:
            self._selection.select(worlds, capturing, f"PointClouds.{call}")

    def _build(
        self,
        sources: Sequence[PixelPoints],
        options: CloudOptions,
        names: Sequence[str],
        excluded: Mapping[str, np.ndarray],
        frame: CloudFrame,
        selection: Selection,
    ) -> None:
        """Allocate all memory, bind the stages and compile their kernels."""
        self._device, self._selection, self._frame, self._sources = selection.mask.device, selection, frame, sources
        torch_interop.require_no_capture(self._device, "PointClouds")
        self._num_worlds, points = selection.mask.shape[0], int(options.num_points)
        starts = np.cumsum([0, *(source.num_pixels for source in sources)])
        capacity, entries = _capacity(int(starts[-1]), options)
        if self._num_worlds * points >= MAX_THREADS:
            raise WarpcamError(
                f"PointClouds: num_points must be below 2^31 in all {self._num_worlds} worlds together, got {points} "
                "for each"
            )
        frame.crop.low, frame.crop.high = (wp.vec3(*corner) for corner in options.corners())
        works = options.voxel_size is not None or _kind(options, capacity) == kernels.PICKED
        candidates = self._candidates(capacity, works)
        placed = [(source, int(first)) for source, first in zip(sources, starts, strict=False)]
        stages = [
            kernels.bind_pack(source.source(first, excluded), frame.crop, candidates, self._device)
            for source, first in placed
        ]
        if options.voxel_size is not None:
            table = self._zeros((self._num_worlds, entries), wp.int32)
            stages.append(kernels.bind_voxels(candidates, float(options.voxel_size), table, self._device))
        out = kernels.CloudPoints()
        out.counts = self._zeros(self._num_worlds, wp.int32)
        out.points = self._zeros((self._num_worlds, points), wp.vec3)
        out.pixels = self._zeros((self._num_worlds, points), wp.int32)
        stages += self._choose(options, candidates, out, capacity)
        flat = out.points.view(wp.float32).reshape((self._num_worlds, points, 3))
        arrays = {"points": flat, "count": out.counts, "pixels": out.pixels}
        for name in names:
            arrays[name] = self._attribute(name, placed, out.pixels, stages)
        if frame.moves and "normals" in arrays:
            directions = arrays["normals"].view(wp.vec3).reshape((self._num_worlds, points))
            stages.append(kernels.bind_turn(selection.mask, frame.crop, directions, self._device))
        self._stages = stages
        self._arrays = arrays
        self.cloud = {name: torch_interop.to_torch(array) for name, array in arrays.items()}
        with torch_interop.in_order(self._device):
            prepare([*frame.stages(), *stages, self._forget])

    def _candidates(self, capacity: int, works: bool) -> Any:
        candidates = kernels.Candidates()
        candidates.mask, candidates.counts = self._selection.mask, self._zeros(self._num_worlds, wp.int32)
        candidates.points = self._zeros((self._num_worlds, 3, capacity), wp.float32)
        candidates.pixels = self._zeros((self._num_worlds, capacity), wp.int32)
        candidates.work = self._zeros((self._num_worlds, capacity if works else 0), wp.int32)
        return candidates

    def _choose(self, options: CloudOptions, candidates: Any, out: Any, capacity: int) -> list[Stage]:
        """Bind the stages that choose points and write them."""
        choice, stages = kernels.Choice(), []
        choice.kind = _kind(options, capacity)
        choice.repeats = int(options.padding == "repeat")
        choice.randomness.seeds = wp.full(self._num_worlds, int(options.seed), dtype=wp.int32, device=self._device)
        choice.randomness.frames = reads = self._zeros(self._num_worlds, wp.int32)
        if choice.kind == kernels.PICKED:
            choice.picks = self._zeros(out.points.shape, wp.int32)
            stages.append(kernels.bind_farthest(candidates, choice.picks, self._device))
        self._forget = kernels.bind_reset(self._selection.mask, reads, self._device)
        return [*stages, *kernels.bind_choice(candidates, choice, out, self._device)]

    def _attribute(
        self, name: str, placed: Sequence[tuple[PixelPoints, int]], pixels: wp.array, stages: list[Stage]
    ) -> wp.array:
        """An attribute of clouds, and the stages that write it."""
        one = placed[0][0].attributes[name]
        out = self._zeros((*pixels.shape, one.values.shape[2]), one.values.dtype)
        for source, first in placed:
            values = source.attributes[name].values
            stages.append(kernels.bind_gather(self._selection.mask, pixels, values, first, one.rest, out, self._device))
        return out.reshape(pixels.shape) if one.is_scalar else out

    def _zeros(self, shape: Any, dtype: Any) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self._device)


def _chosen(cameras: Any, drawn: Mapping[str | int, DrawnCamera]) -> list[str | int]:
    """Names of the cameras that are merged."""
    if cameras is None:
        return list(drawn)
    known = ", ".join(map(repr, drawn))
    if isinstance(cameras, str) or not isinstance(cameras, Sequence) or not cameras:
        raise WarpcamError(f"PointClouds: cameras must be names of some of {known}, or None for all, got {cameras!r}")
    for key in cameras:
        if key not in tuple(drawn):
            raise WarpcamError(f"PointClouds: cameras has {key!r}, the renderer has {known}")
        if cameras.count(key) > 1:
            raise WarpcamError(f"PointClouds: cameras has {key!r} more than once")
    return list(cameras)


def _capacity(pixels: int, options: CloudOptions) -> tuple[int, int]:
    """Candidates of a world, and entries of its hash table of voxels."""
    if options.voxel_size is None:
        return (min(options.num_points, pixels) if options.method == "first" else pixels), 0
    return pixels, kernels.table_size(pixels)


def _kind(options: CloudOptions, capacity: int) -> int:
    """How points are chosen among at most so many candidates."""
    return CHOICES[options.method] if capacity > options.num_points else kernels.FIRST
