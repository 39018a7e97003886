"""A rig: cameras of a renderer, each measured as a real sensor would."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.memory_errors import memory_told
from warpcam.core.seeds import seeds_of
from warpcam.core.world_arrays import WorldArrays
from warpcam.core.world_mask import Selection
from warpcam.kernels.runtime.launch import Stage, bind_launch, prepare
from warpcam.kernels.runtime.streams import nonblocking_stream
from warpcam.render.rendered_tensors import Images
from warpcam.render.renderer import Renderer
from warpcam.sensors.effect import Effect
from warpcam.sensors.kernels import images as kernels
from warpcam.sensors.kernels.random import ANY_WORLD, Randomness
from warpcam.sensors.measurement import Measurement
from warpcam.sensors.timing.clock import Clock
from warpcam.sensors.timing.delivery import Deliveries

# A launch has fewer threads than this.
MAX_THREADS = 2**31


class Rig:
    """Cameras of a renderer, and what each measures.

    Building one allocates all memory and compiles all kernels; ``read`` does neither, and waits for nothing. Threads
    may read rigs of one renderer: each read measures what it has rendered. Outputs that no effect changes are those of
    the frame drawn last, whoever drew it. Where effects read ``flow`` a renderer has one rig: to
    these effects a world that others have drawn since has no frame before.

    Args:
        renderer: Draws the cameras.
        sensors: By camera: the effects that its images go through, in their order. A camera that is not named here is
            not measured.
        seed: Whole number. Random numbers follow from it, the world, the number of the world's frame and the pixel
            alone, so a world measures the same whatever the number of worlds; or int32 (world,), one for each world.
        by_world: Whether the world's number counts. False: worlds with the same seed measure with the same random
            numbers, so that with a seed for each sample of a data set no sample depends on which world measures it.

    Attributes:
        renderer: The renderer; ``renderer.images`` is the truth.
        images: What was measured last, by camera and output: as ``Renderer.images``, and the same tensors in every
            frame. Outputs that no effect changes are the renderer's own. A camera with a ``Delivery`` has tensors of
            its own for all outputs, and "frame_age" beside them: float32, (world,), age of the frame shown [s].
        frames: int32 tensor, (world,): how many frames of each world have been measured.
        seeds: int32 tensor, (world,): the seeds; what is written to it, as to ``frames``, counts from the next frame.

    Raises:
        WarpcamError: An effect does not fit the camera, or a parameter is not allowed.
    """

    @memory_told("Rig")
    def __init__(
        self, renderer: Renderer, sensors: Mapping[str | int, Sequence[Effect]], *, seed: Any = 0, by_world: bool = True
    ):
        if not isinstance(renderer, Renderer):
            raise WarpcamError(f"Rig: renderer must be a warpcam.Renderer, got {type(renderer).__name__}")
        if not isinstance(sensors, Mapping) or not sensors:
            raise WarpcamError(f"Rig: sensors must be a dict of effects by camera, got {sensors!r}")
        self.renderer, device = renderer, renderer.scene.device
        torch_interop.require_no_capture(device, "Rig")
        self._device, self._num_worlds = device, renderer.scene.num_worlds
        if not isinstance(by_world, bool | np.bool_):
            raise WarpcamError(f"Rig: by_world must be True or False, got {by_world!r}")
        self._seeds, self._by_world = seeds_of(seed, "Rig", self._num_worlds, device), bool(by_world)
        self.seeds = torch_interop.to_torch(self._seeds)
        self._clock = Clock(renderer)
        self._frames = wp.zeros(self._num_worlds, dtype=wp.int32, device=device)
        self.frames = torch_interop.to_torch(self._frames)
        self._graphs: list[wp.Graph] = []
        self._reset = Selection(self._num_worlds, device)
        self._measurements: dict[str | int, Measurement] = {}
        for number, (camera, effects) in enumerate(sensors.items()):
            self._measurements[camera] = Measurement(
                renderer,
                camera,
                effects,
                first_stream=number << 16,
                randomness=self._randomness,
                clock=self._clock,
            )
        self.images: Images = {
            camera: {**images, **(self._measurements[camera].images if camera in self._measurements else {})}
            for camera, images in renderer.images.items()
        }
        mask = renderer.drawn
        count = bind_launch(kernels.count_frames, self._num_worlds, [mask, self._frames], device)
        self._stages: list[Stage] = [count, self._clock.bind(mask)]
        for worlds in self._groups():
            for measurement in self._measurements.values():
                self._stages += measurement.bind(worlds, mask[worlds.start : worlds.stop])
        prepare(self._stages)
        self._forget = [
            stage for measurement in self._measurements.values() for stage in measurement.bind_reset(self._reset.mask)
        ]
        prepare(self._forget)

    def read(self, worlds: Any = None, forward: bool = False, *, time: Any = None) -> Images:
        """Render the state as it is now, and measure it.

        On CUDA the work is queued as that of ``Renderer.render`` is, and may be part of a capture.

        Args:
            worlds: Which worlds, as ``Renderer.render`` takes them; the others' images stay. None is all.
            forward: Have the simulator compute poses from its state first.
            time: The simulation's time [s], a number or (world,); a tensor inside a capture. None is the scene's own,
                ``Renderer.times``. Scenes of Newton and of files keep none, and effects that need it want it given.

        Returns:
            ``images``.
        """
        for camera, measurement in self._measurements.items():
            if measurement.timed:
                self._clock.require(time, f"{measurement.timed} of {camera!r}")
        given = self._clock.check(time)
        with self.renderer.lock:
            self.renderer.draw(worlds, forward, "Rig.read")
            with torch_interop.in_order(self._device) as capturing:
                self._clock.set(given)
                self._run(capturing)
        return self.images

    def reset(self, worlds: Any = None) -> None:
        """Forget what some worlds have measured, as drift; to be called when a world has jumped to another state.

        Random numbers go on, so that no two episodes have the same noise. Frames under way are lost; the next one is
        shown at once. The renderer is reset, too.

        Args:
            worlds: As ``read`` takes them.
        """
        with self.renderer.lock:
            with torch_interop.in_order(self._device) as capturing:
                if worlds is None:
                    self._reset.mask.fill_(1)
                else:
                    self._reset.select(worlds, capturing, "Rig.reset")
            self.renderer.reset(worlds)
            with torch_interop.in_order(self._device):
                for stage in self._forget:
                    stage.launch()

    def parameters(self, camera: str | int) -> WorldArrays:
        """Return the parameters of a camera's effects: tensors (world,) or (world, n) that may be written in place.

        Each has the name of its effect and its own, as ``axial_noise_scale``. ``warpcam.randomize`` draws them.
        """
        if camera not in tuple(self._measurements):
            known = ", ".join(map(repr, self._measurements))
            raise WarpcamError(f"Rig: camera {camera!r} came, it measures {known}")
        return self._measurements[camera].parameters

    def deliveries(self, camera: str | int) -> Deliveries:
        """Return the age of a camera's frames, and how many were captured and lost; it must have a ``Delivery``."""
        known = {key: found.deliveries for key, found in self._measurements.items() if found.deliveries is not None}
        if camera not in tuple(known):
            names = ", ".join(map(repr, known)) or "none"
            raise WarpcamError(f"Rig: camera {camera!r} came, those with a Delivery are: {names}")
        return known[camera]

    def __reduce__(self) -> Any:
        raise WarpcamError("Rig: it cannot be copied or pickled, as it holds memory of a device; make another one")

    def _randomness(self, stream: int, worlds: range) -> Randomness:
        """Seeds and frame counters of some worlds, for an effect with that number."""
        within, randomness = slice(worlds.start, worlds.stop), Randomness()
        randomness.seeds, randomness.frames = self._seeds[within], self._frames[within]
        randomness.first_world, randomness.stream = worlds.start if self._by_world else ANY_WORLD, stream
        return randomness

    def _groups(self) -> list[range]:
        """Worlds that one launch has threads for."""
        pixels = max(measurement.width * measurement.height for measurement in self._measurements.values())
        size = max(1, (MAX_THREADS - 1) // pixels)
        bounds = [*range(0, self._num_worlds, size), self._num_worlds]
        return [range(first, end) for first, end in itertools.pairwise(bounds)]

    def _run(self, capturing: bool) -> None:
        if capturing or not self._device.is_cuda:
            for stage in self._stages:
                stage.launch()
            return
        if not self._graphs:
            for stage in self._stages:  # the first time by themselves: the driver may still have to load the kernels
                stage.launch()
            stream = nonblocking_stream(self._device)
            with wp.ScopedCapture(stream=stream) as capture:
                for stage in self._stages:
                    stage.launch(stream)
            self._graphs.append(capture.graph)
            return
        wp.capture_launch(self._graphs[0], stream=self._device.stream)
