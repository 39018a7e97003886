"""What is done to the light of a whole image before it is shown: automatic exposure, bloom and the curve."""

import math
from dataclasses import dataclass

from warpcam.kernels.flags import ShadingFlag
from warpcam.kernels.plan import shading
from warpcam.kernels.plan.request import ImageRequest


@dataclass(frozen=True)
class FilmKey:
    """The kernel that writes what is shown: native/shading_pass/film.h."""

    flags: ShadingFlag

    @property
    def blocks(self) -> int:
        """Blocks that a multiprocessor is to hold: bounds the registers of a thread."""
        return 8


def plan_film(request: ImageRequest) -> FilmKey:
    """The kernel for the outputs of a request."""
    return FilmKey(shading.tone_flag(request, request.outputs))


def meter_threads(request: ImageRequest) -> int:
    """Threads that add up the light of an image; one adds up theirs: both have about as much to do."""
    return math.isqrt(request.width * request.height)
