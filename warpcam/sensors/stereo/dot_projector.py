"""Projectors of infrared dots."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError
from warpcam.sensors.effect import parameter

SPACING = 6.0  # between dots unless their number is given [pixels of the camera]
OVERSAMPLING = 2  # pixels of the pattern for one of the camera, along each axis
SIGMAS = 3.0  # of a dot that are drawn
FULL_WIDTH = 2.0 * np.sqrt(2.0 * np.log(2.0))  # of a Gaussian at half its height, in standard deviations


@dataclass(frozen=True, eq=False)
class DotProjector:
    """A projector of a fixed pattern of infrared dots, which give walls a texture.

    The pattern is that of a slide: it goes out from one place in a cone along the camera's view. Its light falls with
    the square of the distance and with the cosine of the angle to the surface's normal, is reflected by the luminance
    of the surface's albedo, and is not where something stands before the surface, seen from the projector: that is
    found in an image of depth that is rendered there.

    Dots lie at random places of random cells of a grid, so that no two are the same and few are close to each other.

    Attributes:
        intensity: Light at the middle of a dot on a white surface that faces the projector at 1 m, where 1 is a white
            pixel; at least 0, a number or (world,).
        dots: Number of dots in the cone; None is one for each 6x6 pixels of the camera.
        size: Full width of a dot at half its brightness [pixels of the camera], at least 1.
        fovx: Angle of the cone across [degrees]; None: around what the camera sees as it is built, in all worlds.
        fovy: Angle of the cone down [degrees], likewise.
        position: (3,) in the frame of the left imager: right, up, backward [m]; None is the middle between the imagers.
        pattern: A pattern of your own in place of dots, (rows, columns), from 0 to 1, stretched over the cone; its
            first row is the upper one.
        seed: Of the dots, a whole number of at least 0. Patterns are equal in all worlds and frames.

    Raises:
        WarpcamError: A value is not allowed.
    """

    intensity: Any = parameter(3.0, low=0.0)
    dots: int | None = None
    size: float = 2.0
    fovx: float | None = None
    fovy: float | None = None
    position: Any = None
    pattern: Any = None
    seed: int = 0

    def __post_init__(self) -> None:
        for name, allowed, least in (
            ("dots", "a whole number of at least 1, or None", 1),
            ("seed", "a whole number of at least 0", 0),
        ):
            value = getattr(self, name)
            none = value is None and name == "dots"
            if not none and (isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least):
                raise WarpcamError(f"DotProjector: {name} must be {allowed}, got {value!r}")
        self._number("size", "a number of at least 1", 1.0, np.inf)
        for name in ("fovx", "fovy"):
            if getattr(self, name) is not None:
                self._number(name, "an angle in (0, 150) degrees, or None", 1e-3, 150.0)
        if self.position is not None:
            place = as_numbers(self.position, "DotProjector: position", "three numbers, or None")
            if place.shape != (3,) or not np.isfinite(place).all():
                raise WarpcamError(f"DotProjector: position must be three numbers, or None, got {self.position!r}")
        if self.pattern is not None:
            slide = as_numbers(self.pattern, "DotProjector: pattern", "numbers (rows, columns)")
            outside = slide[~((slide >= 0.0) & (slide <= 1.0))]
            if slide.ndim != 2 or slide.size == 0 or outside.size:
                got = outside.flat[0] if outside.size else f"shape {slide.shape}"
                raise WarpcamError(f"DotProjector: pattern must be (rows, columns) of numbers from 0 to 1, got {got}")

    def _number(self, name: str, allowed: str, low: float, high: float) -> None:
        value = getattr(self, name)
        number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
        if not number or not low <= value < high:
            raise WarpcamError(f"DotProjector: {name} must be {allowed}, got {value!r}")

    def slide(self, width: int, height: int) -> np.ndarray:
        """Draw the pattern for a view of that size [pixels of the camera], (rows, columns) float32."""
        if self.pattern is not None:
            return np.ascontiguousarray(as_numbers(self.pattern, "DotProjector: pattern"), np.float32)
        random = np.random.Generator(np.random.PCG64(int(self.seed)))
        dots = max(1, round(width * height / SPACING**2)) if self.dots is None else int(self.dots)
        columns = max(1, round(np.sqrt(dots * width / height)))
        rows = -(-dots // columns)
        cells = random.permutation(rows * columns)[:dots]
        places = random.random((dots, 2))
        size = (OVERSAMPLING * height, OVERSAMPLING * width)
        y = (cells // columns + places[:, 0]) / rows * size[0] - 0.5
        x = (cells % columns + places[:, 1]) / columns * size[1] - 0.5
        sigma = OVERSAMPLING * float(self.size) / FULL_WIDTH
        reach = np.arange(-np.ceil(SIGMAS * sigma), np.ceil(SIGMAS * sigma) + 1.0)
        slide = np.zeros(size, np.float32)
        for down in reach:
            for across in reach:
                row, column = np.rint(y) + down, np.rint(x) + across
                inside = (row >= 0) & (row < size[0]) & (column >= 0) & (column < size[1])
                light = np.exp(-0.5 * ((row - y) ** 2 + (column - x) ** 2) / sigma**2)
                at = (row[inside].astype(int), column[inside].astype(int))
                np.maximum.at(slide, at, light[inside].astype(np.float32))
        return slide
