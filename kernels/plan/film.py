"""What is done to the light of a whole image before it is shown: automatic exposure, bloom and the curve."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.kernels.flags import ShadingFlag
from warpcam.kernels.outputs import lit_outputs
from warpcam.kernels.plan import shading
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.plan.request import BUFFER, ImageRequest
from warpcam.kernels.runtime.launch import MeshReads

LIGHT = f"{BUFFER}light"  # of an image, where it is no output
SUMS, SCATTERED = f"{BUFFER}sums of light", f"{BUFFER}scattered light"


@dataclass(frozen=True)
class FilmKey:
    """The kernel that writes what is shown: native/shading_pass/film.h."""

    flags: ShadingFlag

    @property
    def blocks(self) -> int:
        """Blocks that a multiprocessor is to hold: bounds the registers of a thread."""
        return 8


def plan_passes(request: ImageRequest) -> Iterator[PlannedPass[Any]]:
    """Yield the passes after those that draw light."""
    pixels, images = request.width * request.height, tuple((name, name) for name in lit_outputs(request.outputs))
    light, reads = ("light", "hdr"), MeshReads.FACES
    if request.metered:
        yield PlannedPass("light meter", None, _meter_threads(request), (light, ("sums", SUMS)), reads)
        yield PlannedPass("automatic exposure", None, 1, (("sums", SUMS),), reads)
    if request.bloom:
        images = (("scattered", SCATTERED), *images)
        yield PlannedPass("bloom", None, pixels, (light, ("scattered", SCATTERED)), reads)
    key = FilmKey(shading.tone_flag(request, request.outputs))
    yield PlannedPass("film", key, pixels, (light, *images), reads)


def plan_buffers(request: ImageRequest) -> tuple[tuple[str, Any, tuple[int, int]], ...]:
    """Names, dtypes and sizes, down and across, of what these passes read and write beside images."""
    size = (request.height, request.width)
    buffers = {
        LIGHT: (wp.vec3, size, "hdr" not in request.outputs),
        SUMS: (wp.vec2, (1, _meter_threads(request)), request.metered),
        SCATTERED: (wp.vec3, size, request.bloom),
    }
    return tuple((name, dtype, size) for name, (dtype, size, there) in buffers.items() if there)


def _meter_threads(request: ImageRequest) -> int:
    """Threads that add up the light of an image; one adds up theirs: both have about as much to do."""
    return math.isqrt(request.width * request.height)
