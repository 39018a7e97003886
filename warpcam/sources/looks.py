"""From materials and lights as files give them to those that the kernels have: the one place where they meet.

The kernels light surfaces as MuJoCo does, on display colours; files give linear ones, roughness and metalness, and
light in physical units. So colours are encoded, a highlight stands for roughness, and lights are scaled together until
the middle of the scene is exposed as a white surface would be.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warpcam.kernels.types import LIGHT_DIRECTIONAL, LIGHT_SPOT
from warpcam.sources.graph import Lamp, Look

UNSET = (0.5, 0.5, 0.5, 1.0)  # a material's colour: shapes carry their own, but for this one which is read from here
BARE = (0.18, 0.18, 0.18)  # of a shape that says nothing of its colour, linear
WHITE = (1.0, 1.0, 1.0)
FROM_ABOVE = 0.4  # share of a dome's light that comes from above instead of from everywhere
HEADLIGHT = ((0.2, 0.2, 0.2), (0.8, 0.8, 0.8), (0.3, 0.3, 0.3))  # in a scene without lights
MAX_EXPONENT = 128.0
DARKEST = 0.1  # of what shines: its own colour, to what it emits


def encoded(linear: np.ndarray | Sequence[float]) -> np.ndarray:
    """The sRGB transfer function (IEC 61966-2-1) of values in [0, 1]; others are cut off."""
    value = np.clip(np.nan_to_num(np.asarray(linear, np.float64)), 0.0, 1.0)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1.0 / 2.4) - 0.055)


@dataclass(frozen=True)
class Material:
    """One row of the kernels' materials."""

    color: tuple[float, float, float, float]  # for the shapes that have it
    emission: float
    specular: float
    shininess: float
    texture: int


def material_of(look: Look) -> Material:
    color, emission = np.asarray(look.color), np.asarray(look.emission)
    texture = look.texture
    base = np.ones(3) if texture >= 0 and not look.emits else encoded(color)
    glow = np.ones(3) if look.emits else encoded(emission)
    strength = 0.0
    if glow.max() > 0.0:
        # One colour for what it reflects and what it emits: the hue of both, as bright as what it reflects.
        both = (0.0 if look.emits else base) + glow
        bright = max(0.0 if look.emits else float(base.max()), DARKEST * float(glow.max()))
        base, strength = both / both.max() * bright, float(glow.max()) / bright
    roughness = float(np.clip(look.roughness, 0.0, 1.0))
    alpha = max(roughness, 0.05) ** 2
    exponent = min(2.0 / alpha**2 - 2.0, MAX_EXPONENT)  # Blinn-Phong's that is as wide as GGX
    specular = (1.0 - roughness) * (0.25 + 0.5 * float(np.clip(look.metallic, 0.0, 1.0)))
    red, green, blue = (float(channel) for channel in base)
    return Material((red, green, blue, float(look.opacity)), strength, specular, exponent / 128.0, texture)


def color_of(look: Look | None, color: tuple[float, float, float, float] | None) -> tuple[float, float, float, float]:
    """Display colour of a shape."""
    if look is not None and color is None:
        return material_of(look).color
    red, green, blue, alpha = color if color is not None else (*BARE, 1.0)
    red, green, blue = (float(channel) for channel in encoded((red, green, blue)))
    return red, green, blue, float(alpha)


def arriving(lamp: Lamp, place: np.ndarray, middle: np.ndarray) -> float:
    """What a light at ``place`` sends to the middle of a scene, if that faces it; (3,) each [m]."""
    if not lamp.active:
        return 0.0
    square = float(((place - middle) ** 2).sum()) + lamp.near if lamp.kind == "local" else 1.0
    light = max(lamp.strength) / max(square, 1e-12)
    return light if 0.0 < light < np.inf else 0.0


def light_rows(lamps: Sequence[Lamp], gain: float) -> dict[str, np.ndarray]:
    """Rows of the kernels' lights by field; all light is multiplied by ``gain``."""
    strengths = np.array([lamp.strength for lamp in lamps], np.float64).reshape(-1, 3)
    near = np.array([lamp.near for lamp in lamps], np.float64)
    local = np.array([lamp.kind == "local" for lamp in lamps], bool)
    on = np.array([lamp.active for lamp in lamps], bool)
    dome = np.array([lamp.kind == "dome" for lamp in lamps], bool)
    light = gain * strengths
    direct = np.where(dome[:, None], FROM_ABOVE * light, light)
    return {
        "types": np.where(local, LIGHT_SPOT, LIGHT_DIRECTIONAL).astype(np.int32),
        "active": on & (light.max(axis=1, initial=0.0) > 0.0),
        "casts_shadow": np.array([lamp.casts_shadow and lamp.kind != "dome" for lamp in lamps], bool),
        "attenuation": np.where(
            local[:, None], np.stack((near, 0.0 * near, 1.0 + 0.0 * near), axis=1), (1.0, 0.0, 0.0)
        ),
        "cutoff": np.array([min(lamp.cone, 90.0) if lamp.one_sided else lamp.cone for lamp in lamps], np.float32),
        "exponent": np.array([float(lamp.one_sided) for lamp in lamps], np.float32),
        "ambient": np.where(dome[:, None], (1.0 - FROM_ABOVE) * light, 0.0),
        "diffuse": direct,
        "specular": np.where(dome[:, None], 0.0, direct),
    }
