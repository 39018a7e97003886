"""Features that need more than one layer of visibility: mirrors, transparent shapes, haze.

They are found when a scene is made.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.layers import Haze, LayerTables
from warpcam.kernels.passes.mirrors import OPAQUE_ABOVE
from warpcam.kernels.types import BOX, PLANE

MAX_TRANSPARENT_SHAPES = 256  # shapes that a block can sort

# Which shapes are transparent: all, none, those that are now. "backs": those, and planes from behind in any case.
Transparency = bool | None | Literal["backs"]


@dataclass(frozen=True, eq=False)
class Layers:
    """Parts of a scene that need more than one layer.

    Attributes:
        mirrors: ids of the shapes that may reflect, ascending.
        reflectance: (material,) float32.
        transparent_shapes: ids of the shapes that may be transparent, ascending.
        reach: (shape,) float32, radius of a sphere around the shape's position that holds it; infinite for planes,
            negative where it follows from type and size [m].
        haze_plane: id of the endless plane that has a haze over its horizon, or -1.
        haze_color: Display colour of it.
        haze_width: How far it reaches in from the skybox, as a part of its distance.
        haze_radius: The skybox's distance [m].
    """

    mirrors: Sequence[int] = ()
    reflectance: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))
    transparent_shapes: Sequence[int] = ()
    reach: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))
    haze_plane: int = -1
    haze_color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    haze_width: float = 0.0
    haze_radius: float = 0.0

    def tables(self, num_shapes: int, device: wp.Device) -> LayerTables | None:
        """For the kernels; None where one layer is enough."""
        if not self.mirrors and not self.transparent_shapes and self.haze_plane < 0:
            return None
        places = np.full(num_shapes, -1, np.int32)
        places[np.asarray(self.transparent_shapes, np.int64)] = np.arange(len(self.transparent_shapes))
        haze = None
        if self.haze_plane >= 0:
            haze = Haze()
            haze.color = wp.vec3(*self.haze_color)
            haze.plane, haze.width, haze.radius = self.haze_plane, self.haze_width, self.haze_radius
        return LayerTables(
            mirrors=wp.array(np.asarray(self.mirrors, np.int32), dtype=wp.int32, device=device),
            reflectance=wp.array(self.reflectance, dtype=wp.float32, device=device),
            transparent_shapes=wp.array(np.asarray(self.transparent_shapes, np.int32), dtype=wp.int32, device=device),
            transparent_index=wp.array(places, dtype=wp.int32, device=device),
            reach=wp.array(self.reach, dtype=wp.float32, device=device),
            haze=haze,
        )


def check_tristate(name: str, wanted: Any) -> bool | None:
    """Check a tristate argument ``name``: True, False, or None where the scene decides."""
    if not isinstance(wanted, bool | np.bool_ | None):
        raise WarpcamError(f"{name} must be True, False or None, got {wanted!r}")
    return None if wanted is None else bool(wanted)


def check_planes(transparency: Any, planes_from_behind: Any) -> Transparency:
    """Check both arguments, and return which shapes are transparent."""
    wanted = check_tristate("transparency", transparency)
    if not isinstance(planes_from_behind, bool | np.bool_):
        raise WarpcamError(f"planes_from_behind must be True or False, got {planes_from_behind!r}")
    if not planes_from_behind or wanted:
        return wanted
    if wanted is False:
        raise WarpcamError(
            "planes_from_behind is True and transparency False; colours show planes from behind as transparent: "
            "allowed are transparency None and True"
        )
    return "backs"


def find_mirrors(
    types: np.ndarray, drawn: Sequence[int], materials: np.ndarray, reflectance: np.ndarray, wanted: bool | None
) -> list[int]:
    """Planes and boxes that reflect in some world, or with ``wanted`` all that may ever come to.

    Args:
        types: (shape,).
        drawn: ids.
        materials: (n, shape), -1 for none.
        reflectance: (material,).
        wanted: None looks; True and False are the user's word.
    """
    wanted = check_tristate("reflections", wanted)
    able = [shape for shape in drawn if types[shape] in (PLANE, BOX)]
    if wanted is not None:
        return able if wanted else []
    reflects = np.append(reflectance, 0.0) > 0.0
    return [shape for shape in able if reflects[materials[:, shape]].any()]


def find_transparent(
    types: np.ndarray, drawn: Sequence[int], opacity: np.ndarray, wanted: Transparency, backs: bool = True
) -> list[int]:
    """Shapes that are transparent in some world and planes, which are so from behind, or with ``wanted`` all.

    Of more than ``MAX_TRANSPARENT_SHAPES`` those that are transparent now come first; what is left over is drawn solid,
    which the log says.

    Args:
        types: (shape,).
        drawn: ids.
        opacity: (n, shape).
        wanted: None looks, and so does "backs", which front ends say; True and False are the user's word.
        backs: Whether planes are seen from behind.
    """
    if wanted != "backs":
        wanted = check_tristate("transparency", wanted)
    transparent = [shape for shape in drawn if ((opacity[:, shape] > 0.0) & (opacity[:, shape] < OPAQUE_ABOVE)).any()]
    if wanted is False or (wanted is None and not transparent):
        return []
    transparent += [shape for shape in drawn if backs and types[shape] == PLANE]
    if wanted is True:
        transparent += drawn
    found = list(dict.fromkeys(transparent))
    if len(found) > MAX_TRANSPARENT_SHAPES:
        logging.getLogger("warpcam").warning(
            "transparency: %d shapes are or may become transparent; %d of them are seen through, %d are drawn solid",
            len(found),
            MAX_TRANSPARENT_SHAPES,
            len(found) - MAX_TRANSPARENT_SHAPES,
        )
    return sorted(found[:MAX_TRANSPARENT_SHAPES])


def transparent_layers(types: np.ndarray, drawn: Sequence[int], opacity: np.ndarray, wanted: bool | None) -> Layers:
    """The layers of a physically based scene, whose planes are not seen from behind; see ``find_transparent``."""
    reach = np.where(types == PLANE, np.inf, -1.0).astype(np.float32)
    wanted = check_tristate("transparency", wanted)
    return Layers(transparent_shapes=find_transparent(types, drawn, opacity, wanted, backs=False), reach=reach)
