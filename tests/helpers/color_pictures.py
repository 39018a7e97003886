"""Pictures of a chart as each effect on colours changes it; no renderer draws the chart, so the effect alone counts."""

import numpy as np
import warp as wp
from color_effects import EFFECTS
from measured_colors import measured

from warpcam.core.color import linear_to_srgb, srgb_to_linear
from warpcam.kernels.types import View
from warpcam.sensors.effect import names_of

SIDE = 48
PATCHES = ((115, 82, 68), (98, 122, 157), (214, 126, 44), (56, 61, 150), (70, 148, 73), (175, 54, 60), (231, 199, 31))
COLOR_EFFECTS = {f"effect_{name}": effect for name, effect in zip(names_of(EFFECTS), EFFECTS, strict=True)}


def chart() -> np.ndarray:
    """Display colours, (height, width, 3) bytes: patches, a slanted edge, stripes, a ramp and bright dots."""
    y, x = np.mgrid[:SIDE, :SIDE]
    image = np.array((*PATCHES, (200, 200, 200)))[(x // 12 + 4 * (y // 12)) % 8]
    edge = np.where(x - 0.3 * (y - 24) < 12.0, 25, 225)
    stripes = 125 + 95 * np.sin((x - 24) ** 2 / 14.0)
    ramp = 12 + 4.8 * x
    grey = np.where(y < 36, np.where(x < 24, edge, stripes), ramp)[..., None]
    image = np.where(y[..., None] < 24, image, grey)
    image[40:46:5, 4:40:7] = (250, 240, 205)
    return image.astype(np.uint8)


def depth() -> np.ndarray:
    """Depth of the chart [m]: its left half, its right half, and what lies before both."""
    y, x = np.mgrid[:SIDE, :SIDE]
    return np.where((y > 15) & (y < 33) & (x > 8) & (x < 30), 0.3, np.where(x < 24, 0.5, 1.0))


def colored(name: str, device: wp.Device) -> np.ndarray:
    """The chart as a camera with that effect shows it, and no other."""
    effect, view = COLOR_EFFECTS[name], View()
    view.scale, view.center = wp.vec2(1.0 / SIDE), wp.vec2(0.5 * SIDE)
    image = _given(name)
    return _shown(name, measured(effect, image[None], device, seed=1, views=[view], depth=depth())[0])


def without(name: str) -> np.ndarray:
    """The same picture if the effect did nothing."""
    return _shown(name, _given(name))


def _given(name: str) -> np.ndarray:
    display = chart() / 255.0
    return srgb_to_linear(display) if COLOR_EFFECTS[name].kind == "linear" else display


def _shown(name: str, image: np.ndarray) -> np.ndarray:
    effect, light = COLOR_EFFECTS[name], np.clip(image.astype(np.float64), 0.0, 1.0)
    display = linear_to_srgb(light) if effect.kind == "linear" and not effect.encodes else light
    return np.rint(255.0 * display).astype(np.uint8)
