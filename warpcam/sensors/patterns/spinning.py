"""Spinning lidars: a stack of beams that turns about z, clockwise as seen from above."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.core.arrays import as_numbers
from warpcam.core.errors import RefusedError, WarpcamError
from warpcam.core.file_access import Limits, read_named
from warpcam.sensors.patterns.pattern import Pattern, columns_of, number_of, positive

OUSTER_MODES = ((512, 10), (512, 20), (1024, 10), (1024, 20), (2048, 10))  # columns and rate
OUSTER_CHANNELS = (32, 64, 128)
ORIGIN = "lidar_origin_to_beam_origin_mm"  # of ouster_metadata


def spinning(
    elevations: Any,
    *,
    columns: int,
    rate: float = 10.0,
    azimuths: Any = 0.0,
    start: float = 0.0,
    span: float = 360.0,
    period: float | None = None,
    row_times: Any = 0.0,
    radius: float = 0.0,
    rings: Any = None,
    min_range: float = 0.0,
    max_range: float = math.inf,
) -> Pattern:
    """Return the pattern of a spinning lidar.

    The beam of row i in column j is sent at j period + row_times[i] after the sweep's beginning. The stack has then
    turned clockwise by that time's share of a turn.

    Args:
        elevations: (rows,), angle of each beam above the sensor's xy plane [degrees].
        columns: How often the stack is sent in a sweep.
        rate: Sweeps a second [Hz].
        azimuths: (rows,) or a number: by how much each beam is turned against the stack, counter-clockwise [degrees].
        start: Azimuth of the stack when a sweep begins, counter-clockwise from x [degrees].
        span: Angle of a sweep [degrees]; 360 is a whole turn.
        period: Time from column to column [s]; 1 / (rate columns) unless given.
        row_times: (rows,) or a number: when each beam is sent after its column's beginning [s].
        radius: How far in front of the axis beams begin, along the stack's azimuth [m]; ranges count from there.
        rings: (rows,), the device's own number of each beam.
        min_range: Nothing nearer gives a return [m].
        max_range: Nothing farther gives a return [m].
    """
    angles = np.atleast_1d(as_numbers(elevations, "spinning: elevations"))
    if angles.ndim != 1 or not angles.size or not (np.abs(angles) <= 90.0).all():
        raise WarpcamError(f"spinning: elevations must be (rows,) in [-90, 90] degrees, got {elevations!r}")
    rows = len(angles)
    columns, rate = columns_of(columns, "spinning: columns"), positive(rate, "spinning: rate")
    offsets, delays = _per_row(azimuths, rows, "azimuths"), _per_row(row_times, rows, "row_times")
    span, start = positive(span, "spinning: span"), number_of(start, "spinning: start")
    radius = number_of(radius, "spinning: radius")
    each = 1.0 / (rate * columns) if period is None else positive(period, "spinning: period")
    times = each * np.arange(columns)[None] + delays[:, None]
    turned = span / columns / each * times if period is None else 360.0 * rate * times
    stack = np.radians(start - turned)
    azimuth, elevation = stack + np.radians(offsets)[:, None], np.radians(angles)[:, None] + np.zeros((1, columns))
    flat = np.cos(elevation)
    directions = np.stack((flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)), axis=-1)
    origins = radius * np.stack((np.cos(stack), np.sin(stack), 0.0 * stack), axis=-1) if radius else None
    return Pattern(
        directions,
        origins=origins,
        times=times,
        rings=rings,
        rate=rate,
        min_range=min_range,
        max_range=max_range,
    )


def ouster_os0(channels: int = 128, columns: int = 1024, rate: float = 10.0) -> Pattern:
    """Return the pattern of an Ouster OS0: 90 degrees from the lowest to the highest beam, 0.2 m to 35 m.

    Sources: field of view, columns and rates: ``ouster-os1.sensor.xml`` of MRPT mvsim; ranges: ``OS_0_128_Config`` of
    aerial_gym_simulator 2.0.1. See ``ouster_os1`` for what they have in common.

    Args:
        channels: 32, 64 or 128, at equal angles.
        columns: 512, 1024 or 2048.
        rate: 10 or 20 [Hz]; with 2048 columns 10.
    """
    return _ouster("ouster_os0", 90.0, channels, columns, rate, (0.2, 35.0))


def ouster_os1(channels: int = 128, columns: int = 1024, rate: float = 10.0) -> Pattern:
    """Return the pattern of an Ouster OS1: 45 degrees from the lowest to the highest beam, 0.7 m to 90 m.

    Rows run from the highest beam to the lowest. A column is one azimuth, as in the images that Ouster's ``destagger``
    gives. A sweep begins at the back, where the connector is, and runs clockwise: Ouster's firmware user manual,
    "Coordinate Frames and XYZ Calculation". All beams begin at one place. ``ouster_metadata`` has the calibrated beams
    of one device, with their azimuths and the place where they begin.

    Sources: field of view, columns and rates: ``ouster-os1.sensor.xml`` of MRPT mvsim; ranges: ``OS_1_64_Config`` of
    aerial_gym_simulator 2.0.1.

    Args:
        channels: 32, 64 or 128, at equal angles.
        columns: 512, 1024 or 2048.
        rate: 10 or 20 [Hz]; with 2048 columns 10.
    """
    return _ouster("ouster_os1", 45.0, channels, columns, rate, (0.7, 90.0))


def ouster_os2(channels: int = 128, columns: int = 1024, rate: float = 10.0) -> Pattern:
    """Return the pattern of an Ouster OS2: 22.5 degrees from the lowest to the highest beam, 0.7 m to 200 m.

    Sources: field of view, columns and rates: ``ouster-os1.sensor.xml`` of MRPT mvsim; ranges: ``OS_2_64_Config`` of
    aerial_gym_simulator 2.0.1. See ``ouster_os1`` for what they have in common.

    Args:
        channels: 32, 64 or 128, at equal angles.
        columns: 512, 1024 or 2048.
        rate: 10 or 20 [Hz]; with 2048 columns 10.
    """
    return _ouster("ouster_os2", 22.5, channels, columns, rate, (0.7, 200.0))


def ouster_metadata(
    path: str | Path, *, min_range: float = 0.0, max_range: float = math.inf, limits: Limits | None = None
) -> Pattern:
    """Return the calibrated pattern of one Ouster, from the metadata that the device gives.

    Columns are those of the device: all beams of a column are sent at one time, each at its own azimuth. Beams begin
    ``lidar_origin_to_beam_origin_mm`` in front of the axis: Ouster's firmware user manual, "Lidar Range to XYZ". There
    the device's ranges count from the axis: they are longer than these by that length.

    Args:
        path: A JSON file with ``beam_altitude_angles``, ``beam_azimuth_angles`` and ``lidar_mode``, at any depth.
        min_range: Nothing nearer gives a return [m].
        max_range: Nothing farther gives a return [m].
        limits: Of the file's size; None is ``warpcam.Limits()``.

    Raises:
        WarpcamError: The file cannot be read or lacks one of these.
    """
    where = f"ouster_metadata: {path}"
    try:
        data = json.loads(read_named(path, limits, "ouster_metadata"))
    except RefusedError:
        raise
    except (OSError, TypeError, ValueError, RecursionError) as error:
        raise WarpcamError(f"{where}: cannot be read: {error}") from None
    found = {name: _find(data, name) for name in ("beam_altitude_angles", "beam_azimuth_angles", "lidar_mode")}
    if missing := [name for name, value in found.items() if value is None]:
        raise WarpcamError(f"{where}: there is no {', '.join(missing)}")
    columns, _, rate = str(found["lidar_mode"]).partition("x")
    if not (columns.isdecimal() and rate.isdecimal()):
        raise WarpcamError(f"{where}: lidar_mode must be like 1024x10, got {found['lidar_mode']!r}")
    origin = _find(data, ORIGIN)
    return spinning(
        found["beam_altitude_angles"],
        columns=int(columns),
        rate=float(rate),
        azimuths=-as_numbers(found["beam_azimuth_angles"], f"{where}: beam_azimuth_angles"),
        start=180.0,
        radius=1e-3 * (0.0 if origin is None else number_of(origin, f"{where}: {ORIGIN}")),
        min_range=min_range,
        max_range=max_range,
    )


def _ouster(name: str, fov: float, channels: int, columns: int, rate: float, ranges: tuple[float, float]) -> Pattern:
    if isinstance(channels, bool) or not isinstance(channels, int | np.integer) or channels not in OUSTER_CHANNELS:
        raise WarpcamError(f"{name}: channels must be 32, 64 or 128, got {channels!r}")
    if (columns, rate) not in OUSTER_MODES:
        allowed = ", ".join(f"{width} x {each}" for width, each in OUSTER_MODES)
        raise WarpcamError(f"{name}: columns x rate must be one of {allowed}, got {columns!r} x {rate!r}")
    elevations = np.linspace(0.5 * fov, -0.5 * fov, channels)
    return spinning(elevations, columns=columns, rate=rate, start=180.0, min_range=ranges[0], max_range=ranges[1])


def _per_row(value: Any, rows: int, name: str) -> np.ndarray:
    given = as_numbers(value, f"spinning: {name}")
    if given.shape not in ((), (rows,)) or not np.isfinite(given).all():
        raise WarpcamError(f"spinning: {name} must be a finite number or ({rows},), got {value!r}")
    return np.broadcast_to(given, rows).astype(np.float64)


def _find(data: Any, name: str) -> Any:
    """The value of that name in nested dicts; None if there is none."""
    if not isinstance(data, dict):
        return None
    if name in data:
        return data[name]
    return next((found for value in data.values() if (found := _find(value, name)) is not None), None)
