"""Drawing into the buffers that XLA lends for one call: worlds on one device, with arrays that the call fills."""

import inspect
import threading
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes import views
from warpcam.kernels.runtime.streams import preserve_cuda_context
from warpcam.render.renderer import Renderer
from warpcam.sources.mujoco import written
from warpcam.sources.mujoco.model import MODEL_NAMES

MODEL_FIELDS = {name: field for field, name in MODEL_NAMES.items()}


@dataclass(frozen=True)
class Input:
    """One array of a call.

    Attributes:
        name: MuJoCo's name; of a camera's own array the name of that.
        dtype: Warp's, of an element.
        shape: Of one world's elements.
        camera: The camera that it moves, None for the scene's arrays.
    """

    name: str
    dtype: Any
    shape: tuple[int, ...]
    camera: str | int | None = None

    @property
    def is_shared(self) -> bool:
        """Whether one row may stand for all worlds."""
        return self.camera is None and self.name in MODEL_FIELDS

    @property
    def dims(self) -> tuple[int, ...]:
        """Shape of one world's numbers."""
        return (*self.shape, *written.element_shape(self.dtype))

    @property
    def scalar(self) -> Any:
        """Dtype of the numbers, numpy's."""
        return np.float32 if written.element_shape(self.dtype) else wp.dtype_to_numpy(self.dtype)


@dataclass(frozen=True, eq=False)
class Recipe:
    """Makes renderers of as many worlds as a call has.

    Attributes:
        mjm: The host's model, as it was when the recipe was made.
        cameras: Of the renderers.
        options: Of ``written.load``.
        graph: Replay frames as CUDA graphs.
    """

    mjm: mujoco.MjModel
    cameras: Sequence[Camera]
    options: Mapping[str, Any]
    graph: bool

    @property
    def outputs(self) -> list[tuple[str | int, str, tuple[int, int, int]]]:
        """Camera, name and shape of each image, in the order of a call's results."""
        return [
            (camera.name, name, (camera.height, camera.width, OUTPUTS[name].channels))
            for camera in self.cameras
            for name in camera.outputs
        ]


class Drawing:
    """A renderer, the arrays that it reads, and the images that it writes: on one device."""

    @preserve_cuda_context()
    def __init__(
        self, recipe: Recipe, num_worlds: int, inputs: Sequence[Input], rows: Sequence[int], device: wp.Device
    ):
        varied = [each.name for each, count in zip(inputs, rows, strict=True) if each.is_shared and count > 1]
        scene, arrays = written.load(recipe.mjm, num_worlds, device, varied=varied, **recipe.options)
        self.renderer = Renderer(scene, recipe.cameras, graph=recipe.graph)
        self._filled = [self._array(each, arrays) for each in inputs]
        self._images = [self.renderer.array(camera, name) for camera, name, _ in recipe.outputs]
        self.renderer.render()  # records the graph now, and not in the middle of a program of XLA

    def draw(self, buffers: Sequence[wp.array]) -> None:
        """Fill the arrays from the first buffers, render, and fill the other buffers with the images."""
        count = len(self._filled)
        for array, buffer in zip(self._filled, buffers[:count], strict=True):
            wp.copy(array, buffer)
        self.renderer.render()
        for buffer, image in zip(buffers[count:], self._images, strict=True):
            wp.copy(buffer, image)

    def _array(self, given: Input, arrays: Mapping[str, wp.array]) -> wp.array:
        if given.camera is None:
            return arrays[given.name]
        array = torch_interop.as_array(getattr(self.renderer.camera(given.camera), given.name))
        assert array is not None
        return array


class Drawings:
    """The drawings of one kind of call, one for each device, and the function that XLA calls.

    The function does not keep the drawings alive; who calls it does.
    """

    def __init__(self, recipe: Recipe, num_worlds: int, inputs: Sequence[Input], rows: Sequence[int]):
        self._recipe, self._num_worlds, self._inputs, self._rows = recipe, num_worlds, inputs, rows
        self._by_device: dict[str, Drawing] = {}
        self._lock = threading.Lock()
        me = weakref.ref(self)

        def draw(*buffers: wp.array) -> None:
            drawings = me()
            if drawings is None:
                raise WarpcamError("render: its warpcam.jax.Renderer is gone; keep it as long as what calls it")
            drawings.on(wp.get_device()).draw(buffers)

        kinds = [wp.array(dtype=each.dtype, ndim=1 + len(each.shape)) for each in inputs]
        names = [f"input_{number}" for number in range(len(kinds))]
        images = {}
        for number, (_, name, shape) in enumerate(recipe.outputs):
            kinds.append(wp.array(dtype=OUTPUTS[name].dtype, ndim=4))
            names.append(f"image_{number}")
            images[names[-1]] = (num_worlds, *shape)
        draw.__annotations__ = dict(zip(names, kinds, strict=True))
        positional = inspect.Parameter.POSITIONAL_OR_KEYWORD
        draw.__signature__ = inspect.Signature([inspect.Parameter(name, positional) for name in names])  # type: ignore[attr-defined]
        draw.__module__ = views.__name__  # Warp loads the kernels of a callable's module; these are loaded anyhow
        self.call = wp.jax_callable(
            draw,
            num_outputs=len(images),
            graph_mode=wp.JaxCallableGraphMode.NONE,  # the renderer replays its own
            output_dims=images,
            module_preload_mode=wp.JaxModulePreloadMode.NONE,
        )

    def on(self, device: wp.Device) -> Drawing:
        """Return the drawing of a device; the first time it is made, which allocates and compiles."""
        with self._lock:
            if device.alias not in self._by_device:
                self._by_device[device.alias] = Drawing(
                    self._recipe, self._num_worlds, self._inputs, self._rows, device
                )
            return self._by_device[device.alias]
