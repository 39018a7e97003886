"""Rays as Newton's helpers make them, recognised as lenses, or taken as they are."""

import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

import warpcam as wc
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

_outdated: dict[int, int] = {}  # how often an array was written again, by its id

MOST = 0.02  # pixels that a ray may lie beside the lens that is found


@dataclass(frozen=True, eq=False)
class RayBundle:
    """What one bundle of rays is.

    Attributes:
        size: Width and height [pixels].
        samples: Rays of each pixel.
        lens: Of the same kind, with any numbers; of a table of rays the lens itself.
        numbers: fx, fy, cx, cy [pixels], or the height [m] and zeros; of a table zeros.
        origin: (3,) where the lens stands in the camera's frame [m].
    """

    size: tuple[int, int]
    samples: int
    lens: wc.Lens
    numbers: tuple[float, float, float, float]
    origin: tuple[float, float, float]

    @property
    def kind(self) -> tuple[Any, ...]:
        """What renderers can be shared by."""
        table = isinstance(self.lens, wc.Rays)
        return self.size, self.lens if table else type(self.lens)


class RayBundles:
    """Bundles by the arrays that hold them; each is read once."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[weakref.ref[Any], int, RayBundle]] = {}

    def find(self, rays: wp.array) -> RayBundle:
        """The bundle in ``rays``, (height, width, sample, 2) vec3: origins and directions in the camera's frame."""
        known = self._known.get(id(rays))
        age = _outdated.get(id(rays), 0)
        if known is not None and known[0]() is rays and known[1] == age:
            return known[2]
        if torch_interop.is_capturing(rays.device):
            raise WarpcamError(
                "camera_rays: a capture is under way, and these rays have not been seen before; call update with them "
                "once before the capture"
            )
        bundle = read_bundle(rays.numpy())
        self._known = {key: entry for key, entry in self._known.items() if entry[0]() is not None}
        self._known[id(rays)] = weakref.ref(rays), age, bundle
        return bundle

    def forget(self, rays: wp.array) -> None:
        """Read the array anew when it is used next: its rays are others now."""
        self._known.pop(id(rays), None)

    @staticmethod
    def outdated(rays: wp.array) -> None:
        """Have every sensor read the array anew: a helper has written it."""
        _outdated[id(rays)] = _outdated.get(id(rays), 0) + 1


def read_bundle(rays: np.ndarray) -> RayBundle:
    """The lens that makes such rays: one of Newton's helpers, or a table of them all."""
    height, width, samples = rays.shape[:3]
    rays = rays.astype(np.float64)
    # Newton's helpers send the first of three or more rays through the pixel's centre, and two around it.
    chosen = rays[:, :, 0] if samples != 2 else rays.mean(axis=2)
    if not np.isfinite(chosen).all():
        raise WarpcamError("camera_rays: some are not finite; allowed are finite origins and directions")
    origins, directions = chosen[..., 0, :].reshape(-1, 3), chosen[..., 1, :].reshape(-1, 3)
    column, row = (part.reshape(-1) + 0.5 for part in np.meshgrid(np.arange(width), np.arange(height)))
    used = (directions != 0.0).any(axis=1)
    size = (width, height)
    if not used.any():
        return RayBundle(size, samples, wc.Pinhole(fx=1.0), (1.0, 1.0, 0.5 * width, 0.5 * height), (0.0, 0.0, 0.0))
    origins, directions, column, row = origins[used], directions[used], column[used], row[used]
    together = np.ptp(origins, axis=0).max() <= 1e-6 * (1.0 + np.abs(origins).max())
    if (directions[:, 2] >= 0.0).any():
        return _table(size, samples, chosen, origins[0] if together else None)
    slopes = directions[:, :2] / -directions[:, 2:]
    if together:
        (fx, cx), (fy, cy) = _line(column, slopes[:, 0]), _line(row, -slopes[:, 1])
        if (width > 1) != (height > 1):  # one row or column does not tell the other focal length
            fx, fy = (fx, fx) if width > 1 else (fy, fy)
            cx, cy = column[0] - fx * slopes[0, 0], row[0] + fy * slopes[0, 1]
        aside = np.hypot(fx * slopes[:, 0] + cx - column, -fy * slopes[:, 1] + cy - row).max()
        if not (fx > 0.0 and fy > 0.0 and aside <= MOST):
            return _table(size, samples, chosen, origins[0])
        x, y, z = (float(value) for value in origins[0])
        return RayBundle(size, samples, wc.Pinhole(fx=1.0), (float(fx), float(fy), float(cx), float(cy)), (x, y, z))
    if np.abs(slopes).max() <= 1e-6:
        across, down = _line(column, origins[:, 0]), _line(row, -origins[:, 1])
        scale = across[0] if width > 1 else down[0]
        x, y = origins[:, 0] * scale + 0.5 * width, -origins[:, 1] * scale + 0.5 * height
        if scale > 0.0 and np.ptp(origins[:, 2]) < 1e-6 and np.hypot(x - column, y - row).max() <= MOST:
            z = float(origins[0, 2])
            return RayBundle(size, samples, wc.Orthographic(1.0), (height / scale, 0.0, 0.0, 0.0), (0.0, 0.0, z))
    return _table(size, samples, chosen, None)


def _table(size: tuple[int, int], samples: int, chosen: np.ndarray, origin: np.ndarray | None) -> RayBundle:
    """Fisheyes, distorted lenses and all others, which come from one place, or each from its own."""
    origins, directions = (np.ascontiguousarray(chosen[..., part, :]) for part in (0, 1))
    x, y, z = (0.0, 0.0, 0.0) if origin is None else (float(value) for value in origin)
    lens = wc.Rays(directions, origins=origins if origin is None else None)
    return RayBundle(size, samples, lens, (0.0, 0.0, 0.0, 0.0), (x, y, z))


def _line(place: np.ndarray, slope: np.ndarray) -> tuple[float, float]:
    """F and c of slope = (place - c) / f."""
    first, last = int(np.argmin(place)), int(np.argmax(place))
    if place[first] == place[last]:
        return 1.0, float(place[0] - slope[0])
    rise = slope[last] - slope[first]
    f = float((place[last] - place[first]) / rise) if rise else np.inf
    return f, float(place[first] - f * slope[first])
