"""A stereo camera in every world: two infrared images and depth by matching them."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Pinhole
from warpcam.core import torch_interop
from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError
from warpcam.core.memory_errors import memory_told
from warpcam.core.seeds import seeds_of
from warpcam.core.world_arrays import WorldArrays
from warpcam.render.memory import Memory, estimate_memory, require_free
from warpcam.scene.scene import Scene
from warpcam.sensors.effect import parameter_array, parameters_of, world_numbers
from warpcam.sensors.stereo.dot_projector import DotProjector
from warpcam.sensors.stereo.infrared_noise import InfraredNoise
from warpcam.sensors.stereo.matching import StereoMatching
from warpcam.sensors.stereo.stereo_renderer import StereoRenderer, StereoSetup

MAX_THREADS = 2**31 - 1  # of a launch
MAX_CELLS = 2**31 - 1  # disparities of all pixels of one world
MEASURED = {"depth": wp.float32, "disparity": wp.float32, "infrared_left": wp.uint8, "infrared_right": wp.uint8}
# Least values of the camera's own numbers of each world.
LEAST = {"baseline": 1e-6, "min_depth": 0.0, "max_depth": 0.0, "ambient": 0.0}
LIT_BY_PROJECTOR = ("depth", "normals", "albedo")  # outputs that say how a surface sends dots back
# What is there unless another is given.
DOTS, SAPIENS_MATCHING, SAPIENS_NOISE = DotProjector(), StereoMatching(), InfraredNoise()
NO_LIGHT, NO_NOISE = DotProjector(intensity=0.0), InfraredNoise(speckle=0.0, sigma=0.0)


class StereoCamera:
    """An active or passive stereo camera: two infrared images of a scene, and depth by matching them, in every world.

    The left imager is the camera that is given, the right one a camera beside it. Both see the luminance of the scene's
    light and a projector's dots, with noise, as 8 bits of linear light. Images are matched on the device; the depth is
    that of the left imager, focal length times baseline over the disparity. Edges, occlusions, walls without a texture,
    repeated patterns, reflections and overexposure have the effects on depth that they have on such cameras.

    Building one allocates all memory and compiles all kernels; ``read`` does neither, and waits for nothing. Matching
    takes width * height * (4 * max_disparity + 20) bytes for each world that is matched at the same time: 4.5 MB at
    128x128 with 64 disparities, 217 MB at 848x480 with 128. Worlds are matched in groups, one after another, that
    ``work_memory`` has room for.

    Args:
        scene: What to look at.
        camera: Left imager, with a ``Pinhole`` lens of its own. Its outputs are there beside the measured ones.
        baseline: Place of the right imager to the right of the left one, positive [m]; a number or (world,).
        projector: Projector of infrared dots; None: the camera is passive.
        matching: How images are matched; SAPIEN's values unless given.
        noise: Of both images; SAPIEN's values unless given; None: none.
        ambient: Share of the scene's own light that the imagers see, at least 0; a number or (world,). 1 has a pixel of
            white, 0.2 leaves room for dots as a filter before the imagers does.
        min_depth: Least depth that is measured [m]; a number or (world,). SAPIEN's unless given.
        max_depth: Greatest depth that is measured [m]; a number or (world,). SAPIEN's unless given.
        work_memory: How much memory matching may take [bytes]; one world at least is matched at a time.
        seed: Whole number, or int32 (world,), one for each world. Noise follows from it, the world, how often the world
            was read, and the pixel, whatever the number of worlds.
        graph: As ``Renderer`` has it.

    Attributes:
        images: What was measured last; the same tensors at each read.
        truth: Depth of the left imager as it is: float32 (world, height, width, 1) [m]; where nothing is hit as the
            camera's ``depth_clipping`` has it, inf unless given.
        parameters: Tensors (world,) that may be written in place and that ``warpcam.randomize`` draws: ``baseline``,
            ``min_depth``, ``max_depth``, ``ambient``, ``projector_intensity``, ``noise_speckle``, ``noise_sigma`` and
            ``noise_offset``, the last four where there is a projector or noise.
        renderer: Renderer of all cameras. Pose, lens and range of the left one, ``renderer.camera(name)``, may be
            written; the right one follows, and the projector follows its pose and ``near``. Its images of the left
            camera have the measured depth, so that ``Rig(stereo.renderer, {name: effects})`` and
            ``PointClouds(stereo.renderer, [name])`` go on from there; effects on colours look up true depth.
        memory: What was allocated for it all; its parameters aside.

    Raises:
        WarpcamError: An argument does not fit; ``OutOfMemoryError`` if the device has too little memory free.
    """

    @memory_told("StereoCamera")
    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        *,
        baseline: Any,
        projector: DotProjector | None = DOTS,
        matching: StereoMatching = SAPIENS_MATCHING,
        noise: InfraredNoise | None = SAPIENS_NOISE,
        ambient: Any = 0.2,
        min_depth: Any = 0.2,
        max_depth: Any = 10.0,
        work_memory: int = 2**28,
        seed: Any = 0,
        graph: bool = True,
    ):
        where = "StereoCamera"
        _check(scene, camera, projector, matching, noise, work_memory)
        torch_interop.require_no_capture(scene.device, where)
        self._device, self._num_worlds = scene.device, scene.num_worlds
        left, right, light = _cameras(camera, projector, scene)
        cells = left.width * left.height * matching.max_disparity
        if cells > MAX_CELLS:
            raise WarpcamError(f"{where}: width * height * max_disparity must be below 2^31, got {cells}")
        at_once = self._worlds_at_once(left, matching, int(work_memory))
        work = at_once * matching.bytes_per_world(left.width, left.height)
        cameras = [left, right] + ([] if light is None else [light])
        slide = None if light is None or projector is None else projector.slide(light.width, light.height)
        self.memory = self._memory(estimate_memory(scene, cameras), left, work, slide)
        require_free(self.memory, scene.device)
        own = {"baseline": baseline, "min_depth": min_depth, "max_depth": max_depth, "ambient": ambient}
        arrays = self._make_parameters(own, projector, noise)
        shape = (self._num_worlds, left.height, left.width, 1)
        measured = {name: wp.zeros(shape, dtype=dtype, device=self._device) for name, dtype in MEASURED.items()}
        given = None if projector is None or projector.position is None else as_numbers(projector.position, where)
        setup = StereoSetup(
            left=left,
            right=right,
            projector=light,
            projector_share=0.5 if given is None else 0.0,
            projector_offset=(0.0, 0.0, 0.0) if given is None else given.tolist(),
            pattern=None if slide is None else wp.array(slide, dtype=wp.float32, device=self._device),
            arrays=arrays,
            matcher=self._make_matcher(matching, left, at_once),
            measured=measured,
            has_noise=noise is not None,
            axes=matching.paths // 2,
            seeds=seeds_of(seed, where, self._num_worlds, self._device),
        )
        self.renderer = StereoRenderer(scene, setup, graph=graph)
        self.truth = self.renderer.truth
        seen = {name: self.renderer.images[left.name][name] for name in camera.outputs if name != "depth"}
        self.images: dict[str, torch_interop.Tensor] = {
            **{name: torch_interop.to_torch(array) for name, array in measured.items()},
            **seen,
        }

    def read(self, worlds: Any = None, forward: bool = False) -> Mapping[str, torch_interop.Tensor]:
        """Render both infrared images of the state as it is now, and match them.

        On CUDA the work is queued as that of ``Renderer.render`` is, and may be part of a capture.

        Args:
            worlds: Which worlds, as ``Renderer.render`` takes them; the others' images stay. None is all.
            forward: Have the simulator compute poses from its state first.

        Returns:
            ``images``: by output, tensors on the scene's device, (world, height, width, 1):

            - ``depth`` float32 [m]: planar, of the left imager; 0 where nothing is measured.
            - ``disparity`` float32 [pixels]; 0 where nothing is measured.
            - ``infrared_left``, ``infrared_right`` uint8.

            Further outputs of the camera, as ``rgb``, are there as ``Renderer`` gives them.
        """
        self.renderer.draw(worlds, forward, "StereoCamera.read")
        return self.images

    def reset(self, worlds: Any = None) -> None:
        """Forget the last frame of some worlds, which only the output ``flow`` of the camera asks for.

        Random numbers go on, so that no two episodes have the same noise. It may be part of a capture.

        Args:
            worlds: As ``read`` takes them.
        """
        self.renderer.reset(worlds)

    def __reduce__(self) -> Any:
        raise WarpcamError(
            "StereoCamera: it cannot be copied or pickled, as it holds memory of a device; make another one"
        )

    def _worlds_at_once(self, camera: Camera, matching: StereoMatching, work_memory: int) -> int:
        pixels = camera.width * camera.height
        fit = min(work_memory // matching.bytes_per_world(camera.width, camera.height), MAX_THREADS // (64 * pixels))
        return max(1, min(self._num_worlds, fit))

    def _memory(self, images: Memory, camera: Camera, work: int, slide: np.ndarray | None) -> Memory:
        """Memory of the cameras, of what is measured and of matching."""
        pixels = self._num_worlds * camera.width * camera.height
        measured = {name: pixels * wp.types.type_size_in_bytes(dtype) for name, dtype in MEASURED.items()}
        scratch = images.scratch + work + (0 if slide is None else slide.nbytes)
        return dataclasses.replace(images, images={**images.images, "measured": measured}, scratch=scratch)

    def _make_parameters(
        self, own: Mapping[str, Any], projector: DotProjector | None, noise: InfraredNoise | None
    ) -> dict[str, wp.array]:
        """Arrays of all numbers of a world by name; ``parameters`` has those that count."""
        where, worlds, device = "StereoCamera", self._num_worlds, self._device
        arrays, named, ranges = {}, {}, {}
        for name, value in own.items():
            limits = {"low": LEAST[name], "high": math.inf, "width": ()}
            named[name] = arrays[name] = world_numbers(value, f"{where}: {name}", limits, worlds, device)
            ranges[name] = (LEAST[name], math.inf)
        nearest, farthest = (arrays[name].numpy() for name in ("min_depth", "max_depth"))
        if not (nearest < farthest).all():
            world = int(np.argmin(nearest < farthest))
            raise WarpcamError(
                f"{where}: min_depth must be below max_depth, got {nearest[world]:g} and {farthest[world]:g}"
            )
        for prefix, given, model in (
            ("projector", projector, projector or NO_LIGHT),
            ("noise", noise, noise or NO_NOISE),
        ):
            for entry in parameters_of(model):
                arrays[entry.name] = parameter_array(model, entry, where, worlds, device)
                if given is not None:
                    named[f"{prefix}_{entry.name}"] = arrays[entry.name]
                    ranges[f"{prefix}_{entry.name}"] = (entry.metadata["low"], entry.metadata["high"])
        self.parameters = WorldArrays(where, named, worlds, device, ranges)
        return arrays

    def _make_matcher(self, matching: StereoMatching, camera: Camera, worlds: int) -> Any:
        matcher, pixels = matching.matcher(camera.width, camera.height), camera.width * camera.height
        for name, dtype, count in (
            ("left", wp.uint32, pixels),
            ("right", wp.uint32, pixels),
            ("costs", wp.uint16, pixels * matching.max_disparity),
            ("totals", wp.uint16, pixels * matching.max_disparity),
            ("found", wp.float32, pixels),
            ("found_right", wp.int32, pixels),
            ("checked", wp.float32, pixels),
        ):
            setattr(matcher, name, wp.empty((worlds, count), dtype=dtype, device=self._device))
        return matcher


def _check(scene: Any, camera: Any, projector: Any, matching: Any, noise: Any, work_memory: Any) -> None:
    """Raise for arguments that are not of their kind."""
    where = "StereoCamera"
    if not isinstance(scene, Scene):
        raise WarpcamError(f"{where}: scene must be made by from_mujoco_warp or the like, got {type(scene).__name__}")
    if not isinstance(camera, Camera) or not isinstance(camera.lens, Pinhole):
        lens = f" with the lens {camera.lens!r}" if isinstance(camera, Camera) else ""
        raise WarpcamError(
            f"{where}: camera must be a Camera with a Pinhole lens of its own, got {type(camera).__name__}{lens}"
        )
    for name, value, kind in (
        ("projector", projector, DotProjector),
        ("matching", matching, StereoMatching),
        ("noise", noise, InfraredNoise),
    ):
        if not isinstance(value, kind) and (value is not None or name == "matching"):
            none = "" if name == "matching" else " or None"
            raise WarpcamError(f"{where}: {name} must be sensors.{kind.__name__}{none}, got {value!r}")
    if isinstance(work_memory, bool) or not isinstance(work_memory, int | np.integer) or work_memory < 1:
        raise WarpcamError(f"{where}: work_memory must be a whole number of bytes, at least 1, got {work_memory!r}")


def _cameras(camera: Camera, projector: DotProjector | None, scene: Scene) -> tuple[Camera, Camera, Camera | None]:
    """The left imager, the right one and the projector's view."""
    needed = ("rgb", "depth") if projector is None else ("rgb", *LIT_BY_PROJECTOR)
    left = dataclasses.replace(camera, outputs=tuple(dict.fromkeys([*camera.outputs, *needed])))
    placed: dict[str, Any] = {"position": (0.0, 0.0, 0.0), "rotation": (1.0, 0.0, 0.0, 0.0), "parent": None}
    right = dataclasses.replace(
        camera,
        name=f"{camera.name} right",
        outputs=needed if projector else ("rgb",),
        near=0.0,
        far=math.inf,
        depth_clipping="none",
        **placed,
    )
    if projector is None:
        return left, right, None
    across, down, width, height = _cone(camera, projector, scene)
    light = Camera(
        f"{camera.name} projector",
        width=width,
        height=height,
        outputs=("depth",),
        lens=Pinhole(fx=0.5 * width / across, fy=0.5 * height / down),
        exclude_bodies=camera.exclude_bodies,
        **placed,
    )
    return left, right, light


def _cone(camera: Camera, projector: DotProjector, scene: Scene) -> tuple[float, float, int, int]:
    """Tangents of half the angles of a projector's cone, and its size [pixels of the camera]."""
    lens: Any = camera.lens
    matrix = lens.numbers(camera.width, camera.height, scene.num_worlds, camera.where).matrix
    tangents, sizes = [], []
    for axis, (side, angle) in enumerate(((camera.width, projector.fovx), (camera.height, projector.fovy))):
        focal, centre = matrix[:, axis, axis], matrix[:, axis, 2]
        widest = float((np.maximum(centre, side - centre) / focal).max())
        tangents.append(widest if angle is None else math.tan(math.radians(0.5 * angle)))
        sizes.append(max(1, round(2.0 * tangents[-1] * float(focal.min()))))
    return tangents[0], tangents[1], sizes[0], sizes[1]
