"""A renderer of two imagers and a projector, whose frames end with infrared images and depth by matching."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.camera.camera import Camera
from warpcam.core import torch_interop
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.render.renderer import Renderer
from warpcam.scene.scene import Scene
from warpcam.sensors.kernels import infrared, stereo_matching, stereo_poses
from warpcam.sensors.kernels.random import Randomness
from warpcam.sensors.scan_renderer import LUMINANCE

BLOCK_DIM = 32  # of stages with a thread for each world
STREAM = (1 << 30) + 1  # of random numbers of the left imager, the right one has the next: rigs and lidars have others
POSES = ("position", "rotation")
CPU_RUN = 64  # pixels that a thread of a CPU writes: arguments are copied for each thread


@dataclass(frozen=True, eq=False)
class StereoSetup:
    """Arrays and settings that are bound to each frame of a stereo camera.

    Attributes:
        left: Camera of the left imager.
        right: Camera of the right imager.
        projector: Camera of the projector, or None.
        projector_share: How far to the right the projector is, as a share of the baseline.
        projector_offset: Further place of the projector in the left imager's frame [m].
        pattern: float32 (row, column), or None.
        arrays: Numbers of each world, (world,) float32, by name.
        matcher: ``Matcher`` with arrays of as many worlds as are matched at the same time.
        measured: By name, (world, height, width, 1): "depth", "disparity", "infrared_left" and "infrared_right".
        has_noise: Images have noise.
        axes: Lines along which costs are added up.
        seeds: int32, (world,).
    """

    left: Camera
    right: Camera
    projector: Camera | None
    projector_share: float
    projector_offset: Sequence[float]
    pattern: wp.array | None
    arrays: Mapping[str, wp.array]
    matcher: stereo_matching.Matcher
    measured: Mapping[str, wp.array]
    has_noise: bool
    axes: int
    seeds: wp.array


class StereoRenderer(Renderer):
    """Renders the cameras of a stereo camera. ``images`` and ``array`` have the measured depth of the left one."""

    def __init__(self, scene: Scene, setup: StereoSetup, *, graph: bool = True):
        self._setup = setup
        self._luminance = wp.array(LUMINANCE, dtype=wp.float32, device=scene.device)
        cameras = [setup.left, setup.right] + ([setup.projector] if setup.projector else [])
        super().__init__(scene, cameras, graph=graph)
        self.truth = self.images[setup.left.name]["depth"]
        self.images[setup.left.name]["depth"] = torch_interop.to_torch(setup.measured["depth"])

    def array(self, camera: str | int, output: str) -> wp.array:
        if camera == self._setup.left.name and output == "depth":
            return self._setup.measured["depth"]
        return super().array(camera, output)

    def _head(self, everything: bool) -> list[Stage]:
        """Stages that place the right imager and the projector, and give them what they share with the left imager.

        The right imager has its lens, range and colours, the projector the least depth alone: what stands before it,
        as a housing, casts no shadow.
        """
        setup, worlds, device = self._setup, self._scene.num_worlds, self._device
        left, right = self._bindings[setup.left.name], self._bindings[setup.right.name]
        places: list[tuple[Any, float, Any]] = [(right, 1.0, wp.vec3())]
        if setup.projector is not None:
            binding = self._bindings[setup.projector.name]
            places.append((binding, setup.projector_share, wp.vec3(*setup.projector_offset)))
        stages = []
        for binding, share, offset in places:
            inputs = [left.pose(), setup.arrays["baseline"], share, offset]
            inputs += [binding.arrays[name] for name in POSES]
            stages.append(bind_launch(stereo_poses.place_beside, worlds, inputs, device, block_dim=BLOCK_DIM))
        shared = [(right, name) for name in sorted(left.arrays.keys() - set(POSES))]
        if setup.projector is not None:
            shared.append((self._bindings[setup.projector.name], "near"))
        for binding, name in shared:
            inputs = [_numbers(each.arrays[name]) for each in (left, binding)]
            stages.append(bind_launch(stereo_poses.copy_numbers, inputs[0].size, inputs, device, block_dim=BLOCK_DIM))
        return stages

    def _tail(self) -> list[list[list[Stage]]]:
        """Stages that make infrared images and match them, for some worlds after others."""
        at_once, worlds = self._setup.matcher.found.shape[0], self._scene.num_worlds
        stages: list[Stage] = []
        for begin in range(0, worlds, at_once):
            stages += self._match(slice(begin, min(begin + at_once, worlds)))
        return [[stages]]

    def _match(self, within: slice) -> list[Stage]:
        setup, mask = self._setup, self._selection.mask[within]
        rows = {name: array[within].reshape((mask.size, -1)) for name, array in setup.measured.items()}
        seen = (rows["infrared_left"], rows["infrared_right"])
        params = infrared.InfraredParams()
        for name in ("ambient", "intensity", "speckle", "sigma", "offset"):
            setattr(params, name, setup.arrays[name][within])
        projector, stages = self._projector(within), []
        run = 1 if self._device.is_cuda else CPU_RUN
        for number, (camera, image) in enumerate(zip((setup.left, setup.right), seen, strict=True)):
            randomness = Randomness()
            randomness.seeds, randomness.frames = setup.seeds[within], self._counters.frames[within]
            randomness.first_world, randomness.stream = within.start, STREAM + number
            eye = self._eye(camera, within)
            inputs = [mask, eye, projector, params, randomness, camera.width, int(setup.has_noise), image, run]
            threads = mask.size * -(-image.shape[1] // run)
            stages.append(bind_launch(infrared.see_infrared, threads, inputs, self._device))
        out = stereo_matching.MeasuredDepth()
        out.views = self._passes[setup.left.name].views[within]
        for name in ("baseline", "min_depth", "max_depth"):
            setattr(out, name, setup.arrays[name][within])
        out.depth, out.disparity = rows["depth"], rows["disparity"]
        return [*stages, *stereo_matching.bind_matching(mask, setup.matcher, seen, out, setup.axes, self._device)]

    def _eye(self, camera: Camera, within: slice) -> infrared.Eye:
        passes, eye = self._passes[camera.name], infrared.Eye()
        eye.views, eye.luminance = passes.views[within], self._luminance
        pixels = (within.stop - within.start, camera.width * camera.height)
        images = {name: array[within] for name, array in passes.images.items()}
        eye.colors = images["rgb"].reshape((*pixels, 3))
        if self._setup.projector is not None:
            eye.albedo, eye.normals = (images[name].reshape((*pixels, 3)) for name in ("albedo", "normals"))
            eye.depth = images["depth"].reshape(pixels)
        return eye

    def _projector(self, within: slice) -> infrared.Projector:
        setup, projector = self._setup, infrared.Projector()
        if setup.projector is not None:
            camera, passes = setup.projector, self._passes[setup.projector.name]
            projector.views, projector.pattern = passes.views[within], setup.pattern
            depth = passes.images["depth"][within]
            projector.depth = depth.reshape((depth.shape[0], camera.height, camera.width))
        return projector


def _numbers(array: wp.array) -> wp.array:
    """An array of numbers or vectors as numbers, in its own memory."""
    return array.view(wp.float32).flatten() if array.dtype is not wp.float32 else array
