"""Lights of one's own, for scenes whose simulator has none."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.arrays import per_world
from warpcam.core.errors import WarpcamError
from warpcam.kernels.types import FORM_POINT, LIGHT_DIRECTIONAL, LIGHT_SPOT

NO_CUTOFF = 180.0  # [degrees]: shines all around


@dataclass(frozen=True, eq=False, kw_only=True)
class Light:
    """A light. Each value is one for all worlds or has a leading world dimension.

    Attributes:
        kind: "directional" is as far away as the sun; "point" shines all around; "spot" shines in a cone.
        direction: (3,) or (world, 3): the way it shines, world frame, of any length but 0. Not read for "point".
        position: (3,) or (world, 3) [m], world frame. Not read for "directional".
        color: (3,) or (world, 3): what a white surface that faces it shows, linear, not negative.
        intensity: A factor of ``color``, a number or (world,), not negative.
        ambient: (3,) or (world, 3): what every surface shows of it, whichever way it faces; not in its shadows;
            not negative.
        attenuation: (3,) or (world, 3): a, b, c of the strength 1 / (a + b d + c d^2) at a distance d [m].
        cutoff: Half angle of a spot's cone [degrees], from 0 to 90; a number or (world,).
        exponent: How a spot falls off towards the edge of its cone, a number or (world,), not negative;
            0 is not at all.
        shadows: Whether it casts any, in cameras with ``shadows=True``; a bool, or (world,).
        active: Whether it is on; a bool, or (world,).
    """

    kind: Literal["directional", "point", "spot"] = "directional"
    direction: Any = (0.0, 0.0, -1.0)
    position: Any = (0.0, 0.0, 0.0)
    color: Any = (1.0, 1.0, 1.0)
    intensity: Any = 1.0
    ambient: Any = (0.0, 0.0, 0.0)
    attenuation: Any = (1.0, 0.0, 0.0)
    cutoff: Any = 45.0
    exponent: Any = 10.0
    shadows: Any = True
    active: Any = True


def light_arrays(lights: Any, num_worlds: int, device: wp.Device) -> Mapping[str, wp.array]:
    """The scene's fields that begin with "light_", each (world, light), to be written in place.

    Raises:
        WarpcamError: A light cannot be used; the message names it.
    """
    if isinstance(lights, Light) or not isinstance(lights, Sequence) or not all(isinstance(x, Light) for x in lights):
        raise WarpcamError(f"lights must be a sequence of warpcam.Light, got {lights!r}")
    rows = [_row(light, f"lights[{index}]", num_worlds) for index, light in enumerate(lights)]
    dtypes: dict[str, tuple[Any, tuple[int, ...], type]] = {
        "types": (wp.int32, (), np.int32),
        "active": (wp.bool, (), np.bool_),
        "casts_shadow": (wp.bool, (), np.bool_),
        "positions": (wp.vec3, (3,), np.float32),
        "directions": (wp.vec3, (3,), np.float32),
        "attenuation": (wp.vec3, (3,), np.float32),
        "cutoff": (wp.float32, (), np.float32),
        "exponent": (wp.float32, (), np.float32),
        "ambient": (wp.vec3, (3,), np.float32),
        "diffuse": (wp.vec3, (3,), np.float32),
        "specular": (wp.vec3, (3,), np.float32),
    }
    arrays = {}
    for name, (dtype, width, kind) in dtypes.items():
        values: np.ndarray = np.zeros((num_worlds, len(rows), *width), kind)
        for index, row in enumerate(rows):
            values[:, index] = row[name]
        arrays[f"light_{name}"] = wp.array(values, dtype=dtype, device=device)
    arrays["light_forms"] = wp.full((1, len(rows)), FORM_POINT, dtype=wp.int32, device=device)
    arrays["light_sizes"] = wp.zeros((1, len(rows)), dtype=wp.vec3, device=device)
    upright = np.tile(np.eye(3, dtype=np.float32), (num_worlds, len(rows), 1, 1))
    arrays["light_rotations"] = wp.array(upright, dtype=wp.mat33, ndim=2, device=device)
    return arrays


def _row(light: Light, where: str, num_worlds: int) -> dict[str, Any]:
    if light.kind not in ("directional", "point", "spot"):
        raise WarpcamError(f'{where}: kind must be "directional", "point" or "spot", got {light.kind!r}')

    def numbers(name: str, width: tuple[int, ...] = (3,)) -> np.ndarray:
        return per_world(getattr(light, name), f"{where}: {name}", num_worlds, width)

    def switch(name: str) -> np.ndarray:
        try:
            value = np.asarray(torch_interop.to_numpy(getattr(light, name)))
        except (TypeError, ValueError, RuntimeError):
            value = np.zeros(0)
        if value.dtype != np.bool_ or value.shape not in ((), (num_worlds,)):
            allowed = f"True, False or ({num_worlds},) bool"
            raise WarpcamError(f"{where}: {name} must be {allowed}, got {getattr(light, name)!r}")
        return value

    direction = numbers("direction")
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    if light.kind != "point" and not length.all():
        raise WarpcamError(f"{where}: direction must not be of length 0, got {light.direction!r}")
    cutoff = np.full(num_worlds, NO_CUTOFF, np.float32)
    if light.kind == "spot":
        cutoff = numbers("cutoff", ())
        if cutoff.min() < 0.0 or cutoff.max() > 90.0:
            raise WarpcamError(f"{where}: cutoff must be from 0 to 90 degrees, got {light.cutoff!r}")
    attenuation = numbers("attenuation")
    if attenuation.min() < 0.0 or not attenuation.any(axis=1).all():
        raise WarpcamError(f"{where}: attenuation must not be negative or all 0, got {light.attenuation!r}")
    for name in ("color", "intensity", "ambient", "exponent"):
        if numbers(name, () if name in ("intensity", "exponent") else (3,)).min() < 0.0:
            raise WarpcamError(f"{where}: {name} must not be negative, got {getattr(light, name)!r}")
    color = numbers("color") * numbers("intensity", ())[:, None]
    return {
        "types": LIGHT_DIRECTIONAL if light.kind == "directional" else LIGHT_SPOT,
        "active": switch("active"),
        "casts_shadow": switch("shadows"),
        "positions": numbers("position"),
        "directions": direction / np.where(length > 0.0, length, 1.0),
        "attenuation": attenuation,
        "cutoff": cutoff,
        "exponent": numbers("exponent", ()),
        "ambient": numbers("ambient"),
        "diffuse": color,
        "specular": color,
    }
