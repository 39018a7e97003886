"""What hides light in the real-time look: how it is asked for, and what a camera keeps for its rays."""

import math
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.core.errors import WarpcamError
from warpcam.kernels.passes.occlusion import SHAPE_ROWS, OcclusionArrays
from warpcam.kernels.scene_tables import SceneTables


@dataclass(frozen=True)
class Occlusion:
    """Rays that a renderer traces of what its cameras see.

    Attributes:
        radius: Within which shapes hide light from all around [m]; None: no shape does.
        soft: Lights of a size cast soft shadows.
        indirect: Light comes from shapes, once; they hide light from all around at any distance then.
    """

    radius: float | None = None
    soft: bool = False
    indirect: bool = False

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of a renderer that ask for these."""
        return {"ambient_occlusion": self.radius, "soft_shadows": self.soft, "indirect_light": self.indirect}

    @classmethod
    def of(
        cls,
        ambient_occlusion: Any,
        soft_shadows: Any,
        indirect_light: Any,
        look: str,
        has_splats: bool,
        cameras: Iterable[Camera],
    ) -> "Occlusion":
        """What came to a renderer, or the error that says what is wrong with it."""
        for name, value in (("soft_shadows", soft_shadows), ("indirect_light", indirect_light)):
            if not isinstance(value, bool | np.bool_):
                raise WarpcamError(f"Renderer: {name} must be True or False, got {value!r}")
        if ambient_occlusion is not None and not _is_radius(ambient_occlusion):
            raise WarpcamError(
                f"Renderer: ambient_occlusion must be a radius above 0 in metres or None, got {ambient_occlusion!r}"
            )
        if indirect_light and ambient_occlusion is not None and ambient_occlusion != math.inf:
            raise WarpcamError(
                f"Renderer: ambient_occlusion is {ambient_occlusion!r} and indirect_light is True, whose light comes "
                "from shapes at any distance, and they hide light from all around; allowed are None and math.inf"
            )
        asked = {"ambient_occlusion": ambient_occlusion is not None, "soft_shadows": bool(soft_shadows)}
        asked["indirect_light"] = bool(indirect_light)
        for name in (name for name, came in asked.items() if came):
            if look != "pbr":
                raise WarpcamError(f"Renderer: {name} is of look='pbr', and the look is {look!r}")
            if has_splats:
                raise WarpcamError(f"Renderer: {name} is of scenes of shapes, and this one has clouds of Gaussians")
        if soft_shadows and not any(camera.shadows for camera in cameras):
            raise WarpcamError("Renderer: soft_shadows are those of cameras with shadows=True, and none has it")
        radius = None if ambient_occlusion is None else float(ambient_occlusion)
        return cls(radius, bool(soft_shadows), bool(indirect_light))


NO_OCCLUSION = Occlusion()


def _is_radius(value: Any) -> bool:
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    return number and (0.0 < value <= sys.float_info.max or value == math.inf)


def _num_rows(tables: SceneTables) -> int:
    shapes = tables.shapes if tables.casters is None else tables.casters
    return SHAPE_ROWS * max(shapes.drawn.size, 1)


def occlusion_bytes(tables: SceneTables) -> int:
    """Bytes of what a camera keeps for its rays in all worlds."""
    vector, number = (wp.types.type_size_in_bytes(dtype) for dtype in (wp.vec4, wp.int32))
    return tables.num_worlds * (_num_rows(tables) * vector + number)


def make_occlusion(tables: SceneTables, radius: float | None, device: wp.Device) -> OcclusionArrays:
    """Allocate what a camera keeps for its rays."""
    return OcclusionArrays(
        wp.zeros((tables.num_worlds, _num_rows(tables)), dtype=wp.vec4, device=device),
        wp.zeros(tables.num_worlds, dtype=wp.int32, device=device),
        0.0 if radius is None else radius,
    )
