"""One effect bound by itself, as a rig would bind it."""

from types import SimpleNamespace
from typing import Any

import warp as wp

from warpcam.kernels.types import View
from warpcam.sensors.effect import Effect, EffectFrame, parameter_array, parameters_of
from warpcam.sensors.kernels.random import Randomness


def effect_frame(
    effect: Effect,
    source: wp.array,
    target: wp.array,
    size: tuple[int, int],
    frames: wp.array,
    *,
    seed: int = 0,
    **others: Any,
) -> EffectFrame:
    """What an effect is bound to between two images of a test's own, in worlds that are all drawn.

    Args:
        effect: Its parameters are those of all worlds.
        source: (world, pixel).
        target: Likewise.
        size: Width and height of the images [pixels].
        frames: int32 (world,), how many frames were measured.
        seed: Of all worlds.
        others: Fields of the frame that the effect reads; times are 0, and nothing else is there.
    """
    worlds, device = source.shape[0], source.device
    randomness = Randomness()
    randomness.seeds = wp.full(worlds, seed, dtype=wp.int32, device=device)
    randomness.frames, randomness.first_world, randomness.stream = frames, 0, 0
    given = {entry.name: parameter_array(effect, entry, "bench", worlds, device) for entry in parameters_of(effect)}
    fields: dict[str, Any] = {
        "truth": {},
        "views": wp.array([], dtype=View, device=device),
        "times": wp.zeros(worlds, dtype=wp.float32, device=device),
        "elapsed": wp.zeros(worlds, dtype=wp.float32, device=device),
        "renders": frames,
        "mask": wp.full(worlds, 1, dtype=wp.uint8, device=device),
        "memory": {},
    }
    return EffectFrame(
        source=source,
        target=target,
        params=SimpleNamespace(**given),
        randomness=randomness,
        width=size[0],
        height=size[1],
        device=device,
        worlds=range(worlds),
        **fields | others,
    )
