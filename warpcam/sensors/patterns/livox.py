"""Livox's lidars, whose rays never repeat, from the maker's own tables."""

import io
import math
import warnings
from pathlib import Path

import numpy as np

from warpcam.core.errors import RefusedError, WarpcamError
from warpcam.core.file_access import Limits, read_named
from warpcam.sensors.patterns.pattern import Pattern, count_of, positive


def livox_csv(
    path: str | Path,
    *,
    samples: int,
    rate: float = 10.0,
    rows: int = 4,
    min_range: float = 0.0,
    max_range: float = math.inf,
    limits: Limits | None = None,
) -> Pattern:
    """Return a pattern whose rays come from a table: each read takes the next ``samples``, and begins anew at its end.

    Tables lie in ``scan_mode`` of https://github.com/Livox-SDK/livox_laser_simulation (MIT licence): avia, HAP,
    horizon, mid40, mid70, mid360 and tele. None is part of this package. That repository takes 24,000 samples of avia,
    horizon, mid40 and tele at a read, 10,000 of mid70 and 45,300 of HAP, ten times a second.

    Args:
        path: A CSV file with a line of titles and then three columns: a number or a time that is not read, azimuth
            counter-clockwise from x, and angle from z [degrees].
        samples: Rays of a read.
        rate: Reads a second [Hz]; ``times`` follow from it.
        rows: Rays follow each other down a column of so many, and then down the next. Rays are traced 8 columns and 4
            rows at a time, so 4 takes least time. It must divide ``samples``.
        min_range: Nothing nearer gives a return [m].
        max_range: Nothing farther gives a return [m].
        limits: Of the file's size; None is ``warpcam.Limits()``.

    Raises:
        WarpcamError: The file cannot be read, or has fewer rays than ``samples``.
    """
    where = f"livox_csv: {path}"
    samples, rows = count_of(samples, "livox_csv: samples"), count_of(rows, "livox_csv: rows")
    rate = positive(rate, "livox_csv: rate")
    if samples % rows:
        raise WarpcamError(f"livox_csv: rows must divide samples, got {rows} and {samples}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file without lines, whose shape tells it below
            text = read_named(path, limits, "livox_csv").decode()  # numpy would unpack archives, and ask the network
            numbers = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, ndmin=2)
    except RefusedError:
        raise
    except (OSError, TypeError, ValueError) as error:
        raise WarpcamError(f"{where}: cannot be read: {error}") from None
    if numbers.shape[1:] != (3,) or len(numbers) < samples or not np.isfinite(numbers).all():
        raise WarpcamError(
            f"{where}: three columns of finite numbers and at least {samples} lines are needed, got {numbers.shape}"
        )
    azimuth, zenith = np.radians(numbers[:, 1]), np.radians(numbers[:, 2])
    table = np.stack((np.sin(zenith) * np.cos(azimuth), np.sin(zenith) * np.sin(azimuth), np.cos(zenith)), axis=-1)
    columns = samples // rows
    times = np.arange(samples).reshape(columns, rows).T / (samples * rate)
    first = table[:samples].reshape(columns, rows, 3).transpose(1, 0, 2)
    return Pattern(first, times=times, rate=rate, min_range=min_range, max_range=max_range, table=table)
