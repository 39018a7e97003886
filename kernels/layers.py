"""Tables of what one layer of visibility cannot show: mirrors, transparent shapes, haze. Only some scenes have them."""

from dataclasses import dataclass
from typing import Any

import warp as wp


@wp.struct
class Mirror:
    """The surface of one world that reflects, as one camera sees it. Written each frame."""

    shape: wp.int32  # -1 if there is none
    strength: wp.float32  # reflectance
    # The mirror's plane in the mirrored view's frame: points p with dot(normal, p) = distance; the view's side is less
    normal: wp.vec3
    distance: wp.float32  # [m]
    headlight: wp.vec3  # direction to the view's own headlight in the mirrored view's frame
    eye: wp.vec3  # centre of projection of the view itself, world frame [m]


@wp.struct
class Haze:
    """The haze over the horizon of an endless plane."""

    color: wp.vec3  # display colour
    plane: wp.int32  # shape id of the plane
    width: wp.float32  # how far the haze reaches in from the skybox, as a part of its distance
    radius: wp.float32  # distance of the skybox [m]


@dataclass(frozen=True, eq=False)
class LayerTables:
    """Layer tables of a scene.

    Attributes:
        mirrors: int32, ids of the shapes that may reflect, ascending.
        reflectance: float32, (material,).
        transparent_shapes: int32, ids of the shapes that may be transparent, ascending.
        transparent_index: int32, (shape,) where it stands in ``transparent_shapes``, or -1.
        reach: float32, (shape,) radius of a sphere around its position that holds it [m]; infinite for planes,
            negative where it follows from type and size.
        haze: Haze, or None.
    """

    mirrors: wp.array
    reflectance: wp.array
    transparent_shapes: wp.array
    transparent_index: wp.array
    reach: wp.array
    haze: Any = None

    @property
    def has_mirrors(self) -> bool:
        return self.mirrors.size > 0

    @property
    def has_transparent(self) -> bool:
        return self.transparent_shapes.size > 0
