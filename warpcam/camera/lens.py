"""Lenses: how the pixels of an image become rays."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from warpcam.core.errors import WarpcamError

Projection = Literal["pinhole", "orthographic", "rays", "offset_rays"]


class Lens(ABC):
    """A lens of your own, in place of the one the scene's camera has."""

    @property
    @abstractmethod
    def projection(self) -> Projection:
        """Kind of the lens's rays."""

    @abstractmethod
    def values(self, width: int, height: int) -> Mapping[str, tuple[Any, ...]]:
        """The lens's numbers by the name of the array they go to, for an image of that size [pixels].

        Each number is a scalar or has shape (world,).
        """


@dataclass(frozen=True, eq=False)
class Pinhole(Lens):
    """The perspective of an ideal pinhole.

    Give either ``fovy``, or ``fx`` and, where they differ from the usual, ``fy``, ``cx`` and ``cy``. Every value may
    be one number or one for each world, (world,): numpy, torch or Warp.

    Attributes:
        fovy: Vertical field of view, in (0, 180) [degrees]. Pixels are square, the principal point is the centre.
        fx: Focal length across, positive [pixels].
        fy: Focal length down, positive [pixels]; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; the centre, width / 2, unless given.
        cy: Principal point from the top edge [pixels]; the centre, height / 2, unless given.
    """

    fovy: Any = None
    fx: Any = None
    fy: Any = None
    cx: Any = None
    cy: Any = None

    projection: ClassVar[Projection] = "pinhole"

    def __post_init__(self) -> None:
        pixels = [name for name in ("fx", "fy", "cx", "cy") if getattr(self, name) is not None]
        if self.fovy is None and self.fx is None:
            came = ", ".join(pixels) or "nothing"
            raise WarpcamError(f"Pinhole: {came} came; either fovy [degrees] or fx [pixels] is needed")
        if self.fovy is not None and pixels:
            raise WarpcamError(
                f"Pinhole: fovy came together with {', '.join(pixels)}; give either fovy [degrees], or fx, fy, cx, cy "
                "[pixels]"
            )

    def values(self, width: int, height: int) -> Mapping[str, tuple[Any, ...]]:
        if self.fovy is not None:
            return {"fovy": (self.fovy,)}
        fy = self.fx if self.fy is None else self.fy
        cx = 0.5 * width if self.cx is None else self.cx
        cy = 0.5 * height if self.cy is None else self.cy
        return {"intrinsics": (self.fx, fy, cx, cy)}


@dataclass(frozen=True, eq=False)
class Orthographic(Lens):
    """Parallel rays.

    Attributes:
        height: What the image spans from bottom to top, positive [m]; a number or (world,). Pixels are square.
    """

    height: Any

    projection: ClassVar[Projection] = "orthographic"

    def values(self, width: int, height: int) -> Mapping[str, tuple[Any, ...]]:
        return {"height": (self.height,)}
