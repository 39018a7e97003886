"""The calls of one renderer: what each kind of them draws with, and on which device."""

import threading
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.jax.drawing import Drawings, Input, Recipe
from warpcam.kernels.outputs import OUTPUTS


class Calls:
    """Kinds of calls by their inputs and their number of worlds.

    Args:
        recipe: Makes the renderers.
        num_worlds: As many worlds each call must have; None: any number.
        device: Where programs of XLA are expected to run; None: where JAX puts arrays by itself.
    """

    def __init__(self, recipe: Recipe, num_worlds: int | None, device: wp.Device | None):
        self.recipe, self._num_worlds, self._device = recipe, num_worlds, device
        self.dtypes = [np.dtype(wp.dtype_to_numpy(OUTPUTS[name].dtype)) for _, name, _ in recipe.outputs]
        self._kinds: dict[tuple[Any, ...], Drawings] = {}
        self._compiled: dict[tuple[Input, ...], Any] = {}
        self._lock = threading.Lock()

    def drawings(self, inputs: tuple[Input, ...], rows: tuple[int, ...]) -> Drawings:
        """Return what calls of that kind draw with, by the rows of each input."""
        worlds = max(rows)
        if self._num_worlds is not None and worlds != self._num_worlds:
            raise WarpcamError(
                f"render: worlds is {self._num_worlds} in this Renderer, and a call has {worlds}; give as many, or "
                "worlds=None for any number"
            )
        with self._lock:
            if (inputs, rows) not in self._kinds:
                self._kinds[inputs, rows] = Drawings(self.recipe, worlds, inputs, rows)
            return self._kinds[inputs, rows]

    def device_of(self, platform: str) -> wp.Device:
        """Return the device that a program of this platform runs on unless its arrays are put elsewhere."""
        if self._device is not None:
            return self._device
        chosen = jax.config.jax_default_device
        kind = "cpu" if platform == "cpu" else "gpu"
        if chosen is None or isinstance(chosen, str) or chosen.platform != kind:
            chosen = jax.local_devices(backend=kind)[0]
        return wp.device_from_jax(chosen)

    def compiled(self, function: Callable[..., Any], inputs: tuple[Input, ...]) -> Any:
        """Return a jitted function of the arrays, for calls outside of a program."""
        if inputs not in self._compiled:
            self._compiled[inputs] = jax.jit(lambda arrays: function(arrays, self, inputs))
        return self._compiled[inputs]
