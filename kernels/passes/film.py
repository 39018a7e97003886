"""Automatic exposure, bloom and the curve, from the light of a whole image."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.camera_frame import CameraFrame, empty
from warpcam.kernels.plan.film import FilmKey
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())

IMAGES = ("rgb", "rgba", "hdr")
HEADER = "shading_pass/film.h"


@wp.struct
class Metering:
    """How light that was measured sets the exposure."""

    key: wp.float32  # that the mean luminance becomes
    lowest: wp.float32  # exposure [stops]
    highest: wp.float32
    rate: wp.float32  # of the way from the last frame's exposure, in (0, 1]


@wp.struct
class FilmFrame:
    """Arrays of one camera."""

    mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world's images alone
    width: wp.int32
    height: wp.int32
    light: wp.array(dtype=wp.float32)  # radiance, channel after channel
    scattered: wp.array(dtype=wp.vec3)  # the same, blurred along rows; empty without bloom
    weights: wp.array(dtype=wp.float32)  # (radius + 1,) of the blur
    radius: wp.int32  # [pixels]
    strength: wp.float32  # share of light that is scattered
    exposures: wp.array(dtype=wp.float32)  # (world,) [stops]
    gains: wp.array(dtype=wp.vec3)  # (world,) factors of red, green and blue
    automatic: wp.array(dtype=wp.float32)  # (world,) automatic exposure [stops]; empty without


@wp.struct
class FilmImages:
    """Images, channel after channel; empty if not asked for."""

    rgb: wp.array(dtype=OUTPUTS["rgb"].dtype)
    rgba: wp.array(dtype=OUTPUTS["rgba"].dtype)
    hdr: wp.array(dtype=OUTPUTS["hdr"].dtype)


@dataclass(frozen=True, eq=False)
class FilmArrays:
    """What one camera has for it.

    Attributes:
        exposures: float32, (world,) [stops], beside the automatic exposure.
        gains: vec3, (world,), factors of red, green and blue.
        metering: Metering, or None without automatic exposure.
        automatic: float32, (world,) [stops]: the automatic exposure of the last frame, NaN before the first.
        before: float32, (world,): that of the frame before.
        weights: float32, (radius + 1,), of the bloom's blur.
        strength: Share of light that is scattered.
    """

    exposures: wp.array
    gains: wp.array
    metering: Any
    automatic: wp.array
    before: wp.array
    weights: wp.array
    strength: float


@wp.kernel(enable_backward=False)
def adapt_exposure(
    mask: wp.array(dtype=wp.uint8),
    sums: wp.array(dtype=wp.vec2),  # (world * threads,) stops of pixels, and how many
    threads: wp.int32,
    metering: Metering,
    fresh: wp.int32,  # 1: a frame begins
    automatic: wp.array(dtype=wp.float32),
    before: wp.array(dtype=wp.float32),
    first: wp.int32,
):
    world = first + wp.tid()
    if mask[world] == wp.uint8(0):
        return
    if fresh == 1:
        before[world] = automatic[world]
    total = wp.vec2(0.0, 0.0)
    for thread in range(threads):
        total += sums[world * threads + thread]
    stops = metering.highest
    if total[1] > 0.0:
        stops = wp.clamp(wp.log2(metering.key) - total[0] / total[1], metering.lowest, metering.highest)
    last = before[world]
    if not wp.isnan(last):
        last = wp.clamp(last, metering.lowest, metering.highest)
        stops = (1.0 - metering.rate) * last + metering.rate * stops
    automatic[world] = stops


@wp.kernel(enable_backward=False)
def forget_exposure(automatic: wp.array(dtype=wp.float32), mask: wp.array(dtype=wp.uint8), first: wp.int32):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        automatic[world] = wp.nan


@functools.cache
def _meter_kernel() -> wp.Kernel:
    return make_kernel(
        "meter_light",
        "warpcam::meter_light(mask, light, sums, pixels, threads, index);",
        {
            "mask": wp.array(dtype=wp.uint8),
            "light": wp.array(dtype=wp.float32),
            "sums": wp.array(dtype=wp.vec2),
            "pixels": wp.int32,
            "threads": wp.int32,
        },
        native_module(HEADER),
    )


@functools.cache
def _bloom_kernel() -> wp.Kernel:
    code = "warpcam::scatter_along_rows(frame, index);"
    return make_kernel("scatter_light", code, {"frame": FilmFrame}, native_module(HEADER))


@functools.cache
def _film_kernel(key: FilmKey) -> wp.Kernel:
    return make_kernel(
        "develop_images",
        f"warpcam::develop<{int(key.flags)}>(frame, images, index);",
        {"frame": FilmFrame, "images": FilmImages},
        native_module(HEADER),
        (THREADS, key.blocks),
    )


def _frame(planned: PlannedPass[Any], frame: CameraFrame) -> Any:
    film: FilmArrays = frame.film
    arrays: Any = FilmFrame()
    arrays.mask, arrays.width, arrays.height = frame.mask, frame.width, frame.height
    arrays.light = frame.get(planned, "light")
    scattered = frame.find(planned, "scattered")
    arrays.scattered = empty(wp.vec3, frame.device) if scattered is None else scattered
    arrays.weights, arrays.radius, arrays.strength = film.weights, film.weights.size - 1, film.strength
    arrays.exposures, arrays.gains, arrays.automatic = film.exposures, film.gains, film.automatic
    return arrays


@register("light meter")
def bind_meter(planned: PlannedPass[None], frame: CameraFrame) -> Stage:
    """Bind the stage that adds up an image's light."""
    arguments = [frame.mask, frame.get(planned, "light"), frame.get(planned, "sums")]
    arguments += [frame.width * frame.height, planned.threads]
    return frame.launch(planned, _meter_kernel(), arguments)


def bind_exposure(planned: PlannedPass[None], frame: CameraFrame, fresh: bool) -> Stage:
    """Bind the stage that sets the exposure; ``fresh``: a frame begins, and its last exposure is that before."""
    film, sums = frame.film, frame.buffers[planned.name_of("sums") or ""]
    arguments = [frame.mask, frame.get(planned, "sums"), sums.shape[2], film.metering, int(fresh)]
    return frame.launch(planned, adapt_exposure, [*arguments, film.automatic, film.before])


@register("automatic exposure")
def bind_fresh_exposure(planned: PlannedPass[None], frame: CameraFrame) -> Stage:
    """Bind the exposure of a new frame."""
    return bind_exposure(planned, frame, fresh=True)


@register("bloom")
def bind_bloom(planned: PlannedPass[None], frame: CameraFrame) -> Stage:
    """Bind the stage that scatters light along rows."""
    return frame.launch(planned, _bloom_kernel(), [_frame(planned, frame)])


@register("film")
def bind_film(planned: PlannedPass[FilmKey], frame: CameraFrame) -> Stage:
    """Bind the stage that writes what is shown."""
    images = frame.fill(planned, FilmImages(), IMAGES)
    return frame.launch(planned, _film_kernel(planned.key), [_frame(planned, frame), images])


def bind_reset(automatic: wp.array, mask: wp.array, device: wp.Device) -> Stage:
    """Bind the stage after which the worlds that a mask has adapt to light anew."""
    return bind_launch(forget_exposure, automatic.shape[0], [automatic, mask], device)


def bind_again(passes: Sequence[PlannedPass[Any]], frame: CameraFrame) -> list[Stage]:
    """Bind the stages that show the last frame's light with what was added to it; ``passes``: the frame's."""
    by_name = {each.name: each for each in passes}
    stages = []
    if "automatic exposure" in by_name:
        stages.append(bind_meter(by_name["light meter"], frame))
        stages.append(bind_exposure(by_name["automatic exposure"], frame, fresh=False))
    if "bloom" in by_name:
        stages.append(bind_bloom(by_name["bloom"], frame))
    return [*stages, bind_film(by_name["film"], frame)] if "film" in by_name else []
