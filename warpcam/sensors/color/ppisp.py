"""PPISP, the camera model of neural reconstructions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.color.tone import bind_responses
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.ppisp import Optics, prepare_worlds, process

CHANNELS = ("R", "G", "B")
# Names of inputs in Isaac Lab and on cameras of USD stages by parameter.
INPUTS: Mapping[str, tuple[str, ...]] = {
    "responsivity": ("responsivity",),
    "exposure_offset": ("exposureOffset",),
    "vignetting_center": tuple(f"vignettingCenter{channel}" for channel in CHANNELS),
    "vignetting": tuple(f"vignettingAlpha{power}{channel}" for channel in CHANNELS for power in (1, 2, 3)),
    "color_latents": tuple(f"colorLatent{color}" for color in ("Blue", "Red", "Green", "Neutral")),
    "toe": tuple(f"crfToe{channel}" for channel in CHANNELS),
    "shoulder": tuple(f"crfShoulder{channel}" for channel in CHANNELS),
    "gamma": tuple(f"crfGamma{channel}" for channel in CHANNELS),
    "center": tuple(f"crfCenter{channel}" for channel in CHANNELS),
}
PAIRS = ("vignetting_center", "color_latents")


@dataclass(frozen=True, eq=False)
class Ppisp(Effect):
    """Physically plausible image signal processing: exposure, vignetting, colour and response.

    Linear light times ``responsivity * 2^exposure_offset``; times each channel's vignetting (see ``Vignetting``); with
    its chromaticity (red, green, sum) mapped by the homography that moves pure blue, red, green and grey by
    ``color_latents``, its sum kept; and through each channel's ``ResponseCurve``. Source: "PPISP", arXiv 2601.18336;
    constants and defaults are those of Isaac Lab 3.0 (isaaclab_ppisp), which change nothing.

    Attributes:
        responsivity: A number or (world,).
        exposure_offset: [EV]; a number or (world,).
        vignetting_center: x and y for red, green and blue, as ``Vignetting.center``; (6,) or (world, 6).
        vignetting: Three coefficients for red, green and blue; (9,) or (world, 9).
        color_latents: Two numbers for blue, red, green and grey; (8,) or (world, 8).
        toe: As ``ResponseCurve.toe``; (3,) or (world, 3).
        shoulder: (3,) or (world, 3).
        gamma: (3,) or (world, 3).
        center: (3,) or (world, 3).
    """

    responsivity: Any = parameter(1.0, low=0.0)
    exposure_offset: Any = parameter(0.0, low=-64.0, high=64.0)
    vignetting_center: Any = parameter((0.0,) * 6, width=(6,))
    vignetting: Any = parameter((0.0,) * 9, width=(9,))
    color_latents: Any = parameter((0.0,) * 8, width=(8,))
    toe: Any = parameter((0.013659,) * 3, width=(3,))
    shoulder: Any = parameter((0.013659,) * 3, width=(3,))
    gamma: Any = parameter((0.378165,) * 3, width=(3,))
    center: Any = parameter((0.0,) * 3, width=(3,))

    kind = "linear"
    reads_bytes = True
    writes_bytes = True
    encodes = True

    @classmethod
    def from_inputs(cls, inputs: Mapping[str, Any]) -> "Ppisp":
        """Make the effect from inputs as Isaac Lab and USD cameras name them, like "crfToeR"; others have defaults.

        Raises:
            WarpcamError: A name is not known, or a value has not the length of its input.
        """
        known = [name for names in INPUTS.values() for name in names]
        for name in inputs:
            if name not in known:
                raise WarpcamError(f"Ppisp.from_inputs: input {name!r} came, allowed are {', '.join(known)}")
        default, values = cls(), {}
        for key, names in INPUTS.items():
            length = 2 if key in PAIRS else 1
            row = list(_numbers(getattr(default, key)))
            for place, name in enumerate(names):
                if name in inputs:
                    row[length * place : length * (place + 1)] = _checked(name, inputs[name], length)
            values[key] = row[0] if len(row) == 1 else tuple(row)
        return cls(**values)

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params, optics = frame.params, Optics()
        optics.responsivity, optics.exposure_offset = params.responsivity, params.exposure_offset
        optics.centers, optics.coefficients = params.vignetting_center, params.vignetting
        homographies = wp.empty(len(frame.worlds), dtype=wp.mat33, device=frame.device)
        optics.factors = wp.empty(len(frame.worlds), dtype=wp.float32, device=frame.device)
        responses, find = bind_responses(frame)
        return [
            find,
            frame.per_world(prepare_worlds, [params.color_latents, homographies, optics]),
            frame.per_color_strip(process, [optics, homographies, responses]),
        ]


def _numbers(value: Any) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


def _checked(name: str, value: Any, length: int) -> tuple[float, ...]:
    try:
        numbers = tuple(map(float, value)) if length > 1 else (float(value),)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != length:
        wanted = "two numbers" if length > 1 else "a number"
        raise WarpcamError(f"Ppisp.from_inputs: {name} must be {wanted}, got {value!r}")
    return numbers
