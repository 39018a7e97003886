"""Faults of lenses on colours: vignetting, colour fringes and blur; and sharpening, which answers blur."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import BLOCK_DIM, Stage, bind_launch
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.neighborhoods import BLUR_ROWS, MAX_SIGMA, blur, blur_rows, sharpen, shift_channels
from warpcam.sensors.kernels.vignetting import darken_by_radius, darken_naturally

BUSY_THREADS = 2**18  # that keep a GPU busy


@dataclass(frozen=True, eq=False)
class NaturalVignetting(Effect):
    """Natural vignetting: light falls off with cos^4 of the angle between the ray and the axis.

    The law is that of thin lenses that keep straight lines, so the camera must have a ``Pinhole`` lens; its focal
    length and centre in each world are the renderer's.

    Attributes:
        strength: 1 is the law, 0 no falloff; a number or (world,).
    """

    strength: Any = parameter(1.0, low=0.0, high=1.0)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True
    needs_pinhole = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(darken_naturally, [frame.views, frame.params.strength])]


@dataclass(frozen=True, eq=False)
class Vignetting(Effect):
    """Vignetting by a polynomial: linear light times ``clamp(1 + a r^2 + b r^4 + c r^6, 0, 1)``.

    r is the distance from the centre in units of the image's longer side, as in PPISP (arXiv 2601.18336), so corners of
    a square image have r^2 = 0.5.

    Attributes:
        coefficients: a, b and c; (3,) or (world, 3).
        center: From the middle of the image to the right and down, in units of the longer side; (2,) or (world, 2).
    """

    coefficients: Any = parameter(width=(3,))
    center: Any = parameter((0.0, 0.0), width=(2,))

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(darken_by_radius, [frame.params.coefficients, frame.params.center])]


@dataclass(frozen=True, eq=False)
class ChromaticAberration(Effect):
    """Lateral chromatic aberration: red and blue are magnified about the middle of the image, green is not.

    Channels are read between pixels bilinearly; beyond the border the image goes on as its border. A factor f moves
    what is r pixels from the middle by (f - 1) r.

    Attributes:
        red: Magnification of red; a number or (world,).
        blue: Magnification of blue; a number or (world,).
    """

    red: Any = parameter(1.0, low=0.5, high=2.0)
    blue: Any = parameter(1.0, low=0.5, high=2.0)

    kind = "linear"
    in_place = False
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        inputs = [frame.mask, frame.size, frame.params.red, frame.params.blue, frame.source, frame.color_target]
        return [frame.per_strip(shift_channels, inputs)]


@dataclass(frozen=True, eq=False)
class Blur(Effect):
    """Point spread of a lens: a Gaussian, out to three standard deviations.

    Attributes:
        sigma: Standard deviation [pixels]; a number or (world,). Its cost grows with it.
    """

    sigma: Any = parameter(low=0.0, high=MAX_SIGMA)

    kind = "linear"
    in_place = False
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return bind_blur(frame, blur, [frame.params.sigma])


@dataclass(frozen=True, eq=False)
class Sharpening(Effect):
    """Unsharp mask: display colours plus ``amount`` times what a Gaussian blur takes from them.

    Attributes:
        amount: A number or (world,).
        sigma: Standard deviation of the blur [pixels]; a number or (world,).
    """

    amount: Any = parameter(low=0.0)
    sigma: Any = parameter(1.0, low=0.0, high=MAX_SIGMA)

    kind = "display"
    in_place = False
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return bind_blur(frame, sharpen, [frame.params.amount, frame.params.sigma])


def bind_blur(frame: EffectFrame, kernel: wp.Kernel, parameters: Sequence[wp.array]) -> Sequence[Stage]:
    """Bind the blur along rows, which narrow blurs do without, and a kernel that finishes it; the last is sigma."""
    worlds, width, height = len(frame.worlds), 3 * frame.width, frame.height
    images = [frame.source, wp.empty_like(frame.source)]
    source, rows = (shared(image, (worlds, width * height), wp.float32) for image in images)
    pieces, common = width * -(-height // BLUR_ROWS), [frame.mask, width, height]
    lanes = min(pieces, max(BLOCK_DIM, BUSY_THREADS // worlds)) if frame.device.is_cuda else pieces
    inputs = [*common, lanes, parameters[-1], source, rows]
    return [
        bind_launch(blur_rows, worlds * lanes, inputs, frame.device),
        bind_launch(kernel, worlds * pieces, [*common, *parameters, source, rows, frame.color_target], frame.device),
    ]
