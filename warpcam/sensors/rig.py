"""A rig: cameras of a renderer, each measured as a real sensor would."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.world_arrays import WorldArrays
from warpcam.core.world_mask import Selection
from warpcam.kernels.runtime.launch import Stage, bind_launch, prepare
from warpcam.kernels.runtime.streams import nonblocking_stream, recording_lock
from warpcam.render.renderer import Images, Renderer
from warpcam.sensors.effect import Effect
from warpcam.sensors.kernels import images as kernels
from warpcam.sensors.kernels.random import Randomness
from warpcam.sensors.measurement import Measurement

# A launch has fewer threads than this.
MAX_THREADS = 2**31


class Rig:
    """Cameras of a renderer, and what each measures.

    Building one allocates all memory and compiles all kernels; ``read`` does neither, and waits for nothing.

    Args:
        renderer: Draws the cameras.
        sensors: By camera: the effects that its images go through, in their order. A camera that is not named here is
            not measured.
        seed: Whole number. Random numbers follow from it, the world, the number of the world's frame and the pixel
            alone, so a world measures the same whatever the number of worlds; or int32 (world,), one for each world.

    Attributes:
        renderer: The renderer; ``renderer.images`` is the truth.
        images: What was measured last, by camera and output: as ``Renderer.images``, and the same tensors in every
            frame. Outputs that no effect changes are the renderer's own.
        frames: int32 tensor, (world,): how many frames of each world have been measured.

    Raises:
        WarpcamError: An effect does not fit the camera, or a parameter is not allowed.
    """

    def __init__(self, renderer: Renderer, sensors: Mapping[str | int, Sequence[Effect]], *, seed: Any = 0):
        if not isinstance(renderer, Renderer):
            raise WarpcamError(f"Rig: renderer must be a warpcam.Renderer, got {type(renderer).__name__}")
        if not isinstance(sensors, Mapping) or not sensors:
            raise WarpcamError(f"Rig: sensors must be a dict of effects by camera, got {sensors!r}")
        self.renderer, device = renderer, renderer.scene.device
        torch_interop.require_no_capture(device, "Rig")
        self._device, self._num_worlds = device, renderer.scene.num_worlds
        self._seeds = _seeds(seed, self._num_worlds, device)
        self._frames = wp.zeros(self._num_worlds, dtype=wp.int32, device=device)
        self.frames = torch_interop.to_torch(self._frames)
        self._graphs: list[wp.Graph] = []
        self._lock = recording_lock(device)
        self._reset = Selection(self._num_worlds, device)
        self._measurements: dict[str | int, Measurement] = {}
        for number, (camera, effects) in enumerate(sensors.items()):
            self._measurements[camera] = Measurement(
                renderer, camera, effects, first_stream=number << 16, randomness=self._randomness
            )
        self.images: Images = {
            camera: {**images, **(self._measurements[camera].images if camera in self._measurements else {})}
            for camera, images in renderer.images.items()
        }
        mask = renderer.drawn
        count = bind_launch(kernels.count_frames, self._num_worlds, [mask, self._frames], device)
        self._stages: list[Stage] = [count]
        for worlds in self._groups():
            for measurement in self._measurements.values():
                self._stages += measurement.bind(worlds, mask[worlds.start : worlds.stop])
        prepare(self._stages)
        self._forget = [
            stage for measurement in self._measurements.values() for stage in measurement.bind_reset(self._reset.mask)
        ]
        prepare(self._forget)

    def read(self, worlds: Any = None, forward: bool = False) -> Images:
        """Render the state as it is now, and measure it.

        On CUDA the work is queued as that of ``Renderer.render`` is, and may be part of a capture.

        Args:
            worlds: Which worlds, as ``Renderer.render`` takes them; the others' images stay. None is all.
            forward: Have the simulator compute poses from its state first.

        Returns:
            ``images``.
        """
        self.renderer.render(worlds, forward)
        with self._lock, torch_interop.in_order(self._device) as capturing:
            self._run(capturing)
        return self.images

    def reset(self, worlds: Any = None) -> None:
        """Forget what some worlds have measured, as drift; to be called when a world has jumped to another state.

        Random numbers go on, so that no two episodes have the same noise. The renderer is reset, too.

        Args:
            worlds: As ``read`` takes them.
        """
        self.renderer.reset(worlds)
        with self._lock, torch_interop.in_order(self._device) as capturing:
            if worlds is None:
                self._reset.mask.fill_(1)
            else:
                self._reset.select(worlds, capturing, "reset")
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

    def _randomness(self, stream: int, worlds: range) -> Randomness:
        """Seeds and frame counters of some worlds, for an effect with that number."""
        within, randomness = slice(worlds.start, worlds.stop), Randomness()
        randomness.seeds, randomness.frames = self._seeds[within], self._frames[within]
        randomness.first_world, randomness.stream = worlds.start, stream
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


def _seeds(seed: Any, num_worlds: int, device: wp.Device) -> wp.array:
    numbers = np.asarray(torch_interop.to_numpy(seed))
    whole = numbers.dtype.kind in "iu" and numbers.shape in ((), (num_worlds,))
    if not whole or (numbers < -(2**31)).any() or (numbers >= 2**31).any():
        raise WarpcamError(
            f"Rig: seed must be a whole number of 32 bits, or one for each world, ({num_worlds},), got {seed!r}"
        )
    return wp.array(np.broadcast_to(numbers, num_worlds).astype(np.int32), dtype=wp.int32, device=device)
