"""A pattern: the rays of one sweep of a lidar, and when each is sent."""

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from warpcam.accel.ray_tables import MOST_PIXELS, unit
from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError
from warpcam.core.numbers import is_finite_number


@dataclass(frozen=True, eq=False)
class Pattern:
    """Rays of one sweep, in the sensor's frame: x ahead, y left, z up.

    ``dataclasses.replace`` changes one thing of a pattern, as ``replace(pattern, max_range=50.0)``.

    Attributes:
        directions: (rows, columns, 3) float32, of length 1, or 0 for a place without a ray.
        origins: (rows, columns, 3) float32, where rays begin [m]; None: all at the sensor's position. Ranges count from
            there.
        times: (rows, columns) float32, when each ray is sent, from the sweep's beginning [s]; 0 unless given.
        rings: (rows,) int32, the device's own number of each row; from 0 on unless given.
        rate: Sweeps a second, positive [Hz]; None where nothing depends on it.
        min_range: Nothing nearer gives a return; at least 0 [m].
        max_range: Nothing farther gives a return; beyond ``min_range``, may be inf [m].
        table: (n, 3) float32, directions of a sweep that takes ``rows * columns`` of them at each read, column after
            column, and goes on where the last read of any worlds ended; None: all reads have the same directions.
    """

    directions: Any
    _: KW_ONLY
    origins: Any = None
    times: Any = None
    rings: Any = None
    rate: float | None = None
    min_range: float = 0.0
    max_range: float = math.inf
    table: Any = None

    def __post_init__(self) -> None:
        directions = _table(self.directions, "directions", None)
        if not directions.any():
            raise WarpcamError("Pattern: directions are all 0: no ray sees anything")
        rows, columns = directions.shape[:2]
        if max(rows, columns) > MOST_PIXELS:
            raise WarpcamError(f"Pattern: at most {MOST_PIXELS} rows and columns are allowed, got {rows} x {columns}")
        set_to = object.__setattr__
        set_to(self, "directions", unit(directions).astype(np.float32))
        if self.origins is not None:
            set_to(self, "origins", _float32(_table(self.origins, "origins", (rows, columns, 3)), "origins"))
        times = np.zeros((rows, columns)) if self.times is None else _table(self.times, "times", (rows, columns))
        set_to(self, "times", _float32(times, "times"))
        rings = np.arange(rows) if self.rings is None else _table(self.rings, "rings", (rows,))
        broken = rings[(rings != np.rint(rings)) | (np.abs(rings) >= 2**31)]
        if broken.size:
            raise WarpcamError(f"Pattern: rings must be whole numbers of 32 bits, got {broken[0]}")
        set_to(self, "rings", rings.astype(np.int32))
        if self.rate is not None:
            set_to(self, "rate", positive(self.rate, "Pattern: rate"))
        near, far = _number(self.min_range, "min_range"), _number(self.max_range, "max_range")
        if not 0.0 <= near < far:
            raise WarpcamError(
                f"Pattern: min_range must be at least 0 and max_range beyond it [m], got {near} and {far}"
            )
        set_to(self, "min_range", near)
        set_to(self, "max_range", far)
        if self.table is not None:
            self._check_table(rows * columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.directions.shape[0])

    @property
    def columns(self) -> int:
        """Number of columns."""
        return int(self.directions.shape[1])

    def _check_table(self, rays: int) -> None:
        if self.origins is not None:
            raise WarpcamError("Pattern: table and origins came; rays of a table begin at the sensor's position")
        given = as_numbers(self.table, "Pattern: table")
        if given.ndim != 2 or given.shape[1] != 3 or len(given) < rays or not np.isfinite(given).all():
            raise WarpcamError(
                f"Pattern: table must have shape (n, 3), n at least {rays}, and be finite, got {given.shape}"
            )
        object.__setattr__(self, "table", unit(given).astype(np.float32))


def rays(
    directions: Any,
    origins: Any = None,
    times: Any = None,
    *,
    rings: Any = None,
    rate: float | None = None,
    min_range: float = 0.0,
    max_range: float = math.inf,
) -> Pattern:
    """Return a pattern of any rays; arguments are those of ``Pattern``, numpy, torch or Warp."""
    return Pattern(
        directions, origins=origins, times=times, rings=rings, rate=rate, min_range=min_range, max_range=max_range
    )


def parts_of(pattern: Pattern, where: str) -> np.ndarray:
    """Part of the sweep that is over when each ray is sent, (rows, columns) float32 from 0 to 1.

    Raises:
        WarpcamError: The pattern has no rate, or rays are sent before the sweep or after it.
    """
    if pattern.rate is None:
        raise WarpcamError(f"{where} needs a pattern with a rate, which says when each ray is sent")
    parts = pattern.times * pattern.rate
    outside = pattern.times[(parts < 0.0) | (parts > 1.0 + 1e-6)]
    if outside.size:
        raise WarpcamError(
            f"{where} needs times of the pattern from 0 to 1 / rate, which is {1.0 / pattern.rate:g} s, "
            f"got {outside[0]:g}"
        )
    return np.minimum(parts, 1.0).astype(np.float32)


def positive(value: Any, where: str) -> float:
    """A finite number above 0."""
    if not is_finite_number(value) or value <= 0.0:
        raise WarpcamError(f"{where} must be a positive number, got {value!r}")
    return float(value)


def number_of(value: Any, where: str) -> float:
    """A finite number."""
    given = as_numbers(value, where, "a finite number")
    if given.shape != () or not np.isfinite(given):
        raise WarpcamError(f"{where} must be a finite number, got {value!r}")
    return float(given)


def columns_of(value: Any, where: str) -> int:
    """Number of columns: whole, and so few that a pattern may have them."""
    columns = count_of(value, where)
    if columns > MOST_PIXELS:
        raise WarpcamError(f"{where} must be at most {MOST_PIXELS}, got {value!r}")
    return columns


def periods_of(rate: Any, period: float, where: str) -> float:
    """How often a period [s] lies in a turn of that rate [Hz].

    Raises:
        WarpcamError: The rate is not positive, or a turn has more periods than a pattern may have columns, or none.
    """
    periods = 1.0 / (positive(rate, where) * period)
    if not 1.0 <= periods <= MOST_PIXELS:
        least, most = 1.0 / (MOST_PIXELS * period), 1.0 / period
        raise WarpcamError(f"{where} must be from {least:.3g} to {most:.6g} Hz, got {rate!r}")
    return periods


def count_of(value: Any, where: str) -> int:
    """A whole number of at least 1."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise WarpcamError(f"{where} must be a whole number of at least 1, got {value!r}")
    return int(value)


def _table(value: Any, name: str, shape: tuple[int, ...] | None) -> np.ndarray:
    given = as_numbers(value, f"Pattern: {name}")
    fits = given.shape == shape if shape is not None else given.ndim == 3 and given.shape[2] == 3 and given.size > 0
    if not fits:
        wanted = str(shape) if shape is not None else "(rows, columns, 3)"
        raise WarpcamError(f"Pattern: {name} must have shape {wanted}, got {given.shape}")
    if not np.isfinite(given).all():
        raise WarpcamError(f"Pattern: {name} must be finite, got {given[~np.isfinite(given)][0]}")
    return given


def _float32(given: np.ndarray, name: str) -> np.ndarray:
    with np.errstate(over="ignore"):
        values: np.ndarray = given.astype(np.float32)
    if not np.isfinite(values).all():
        raise WarpcamError(f"Pattern: {name} must be finite in float32, got {given[~np.isfinite(values)][0]}")
    return values


def _number(value: Any, name: str) -> float:
    is_infinite = isinstance(value, float | np.floating) and math.isinf(value)
    if not is_infinite and not is_finite_number(value):
        raise WarpcamError(f"Pattern: {name} must be a number [m], got {value!r}")
    return float(value)
