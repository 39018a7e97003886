"""Hesai's lidars. Rows run from the highest beam to the lowest."""

import numpy as np

from warpcam.sensors.patterns.pattern import Pattern, periods_of
from warpcam.sensors.patterns.spinning import spinning

# Of the XT32 [s]: tier4/nebula, pandar_xt32.hpp: from column to column, and of beams after their column's beginning.
XT32_PERIOD, XT32_FIRST, XT32_FIRING = 50e-6, 0.368e-6, 1.512e-6

# Of the QT128, by laser up to 96 [degrees]: tier4/nebula, calibration/PandarQT128.csv, without signs of azimuths: they
# are positive, negative and positive for 32 lasers each. Lasers 97 to 128 mirror lasers 32 to 1.
QT128_ELEVATIONS = (
    *(-52.63, -51.03, -49.51, -48.07, -46.69, -45.37, -44.09, -42.85, -41.65, -40.48, -39.34, -38.23, -37.14),
    *(-36.08, -35.03, -34, -32.99, -32, -31.02, -30.05, -29.09, -28.15, -27.22, -26.29, -25.38, -24.47),
    *(-23.58, -22.69, -21.8, -20.93, -20.06, -19.19, -18.33, -17.48, -16.63, -15.78, -14.94, -14.1, -13.27),
    *(-12.44, -11.61, -10.78, -9.96, -9.14, -8.32, -7.5, -6.69, -5.87, -5.06, -4.25, -3.44, -2.63, -1.82),
    *(-1.01, -0.2, 0.61, 1.41, 2.22, 3.03, 3.84, 4.65, 5.47, 6.28, 7.09, 7.91, 8.73, 9.55, 10.37, 11.19),
    *(12.02, 12.85, 13.68, 14.52, 15.36, 16.2, 17.05, 17.9, 18.76, 19.62, 20.49, 21.36, 22.24, 23.13, 24.02),
    *(24.92, 25.83, 26.75, 27.68, 28.62, 29.57, 30.53, 31.5, 32.49, 33.49, 34.51, 35.55),
)
QT128_AZIMUTHS = (
    *(10.11, 9.72, 9.38, 9.09, 8.83, 8.6, 8.4, 8.21, 8.04, 7.88, 7.74, 7.61, 7.49, 7.38, 7.28, 7.18, 7.09, 7.01),
    *(6.93, 6.85, 6.79, 6.72, 6.66, 6.6, 6.55, 6.5, 6.45, 6.41, 6.36, 6.32, 6.29, 6.25, 6.22, 6.19, 6.16, 6.13),
    *(6.1, 6.08, 6.06, 6.04, 6.02, 6, 5.98, 5.97, 5.96, 5.94, 5.93, 5.92, 5.91, 5.91, 5.9, 5.9, 5.89, 5.89, 5.89),
    *(5.89, 5.89, 5.9, 5.9, 5.9, 5.91, 5.92, 5.93, 5.94, 5.95, 5.96, 5.98, 5.99, 6.01, 6.03, 6.05, 6.07, 6.09),
    *(6.12, 6.14, 6.17, 6.2, 6.23, 6.27, 6.3, 6.34, 6.38, 6.43, 6.47, 6.52, 6.57, 6.63, 6.69, 6.75, 6.82, 6.89),
    *(6.97, 7.05, 7.13, 7.23, 7.33),
)


def hesai_xt32(rate: float = 10.0) -> Pattern:
    """Return the nominal pattern of a Hesai XT32: 32 beams from 15 to -16 degrees, 0.05 m to 120 m.

    Beams are sent one after another, columns are 50 us apart: 2000 at 10 Hz. Sources, all of tier4/nebula: angles:
    ``calibration/PandarXT32.csv``, rounded to degrees; times and ranges: ``pandar_xt32.hpp``.

    Args:
        rate: Turns a second [Hz].
    """
    return spinning(
        15.0 - np.arange(32),
        columns=round(periods_of(rate, XT32_PERIOD, "hesai_xt32: rate")),
        rate=rate,
        period=XT32_PERIOD,
        row_times=XT32_FIRST + XT32_FIRING * np.arange(32),
        min_range=0.05,
        max_range=120.0,
    )


def hesai_qt128(columns: int, rate: float = 10.0) -> Pattern:
    """Return the pattern of a Hesai QT128: 128 beams from 52.6 to -52.6 degrees, 0.05 m to 50 m.

    All 128 are sent in each column, at once, while the device sends a part of them in turns. Sources, all of
    tier4/nebula: angles: ``calibration/PandarQT128.csv``; ranges: ``pandar_qt128.hpp``.

    Args:
        columns: Rays of each beam in a turn.
        rate: Turns a second [Hz].
    """
    elevations = np.array(QT128_ELEVATIONS)
    azimuths = np.repeat((1.0, -1.0, 1.0), 32) * QT128_AZIMUTHS
    elevations = np.concatenate((elevations, -elevations[31::-1]))
    azimuths = np.concatenate((azimuths, -azimuths[31::-1]))
    order = np.argsort(-elevations, kind="stable")
    return spinning(
        elevations[order],
        columns=columns,
        rate=rate,
        azimuths=-azimuths[order],  # Hesai's azimuths run clockwise
        rings=order,
        min_range=0.05,
        max_range=50.0,
    )


def hesai_at128(columns: int = 1200, rate: float = 10.0) -> Pattern:
    """Return the nominal pattern of a Hesai AT128: 128 beams from 12.93 to -12.47 degrees, 120 degrees wide.

    Ranges are 1 m to 180 m. All beams of a column are sent at once. Sources, all of tier4/nebula: angles:
    ``calibration/PandarAT128.csv``; width: ``PandarAT128.param.yaml`` (30 to 150 degrees); columns and ranges:
    ``pandar_at128.hpp`` (307200 points of two returns).

    Args:
        columns: Rays of each beam in a sweep.
        rate: Sweeps a second [Hz].
    """
    beams = np.arange(128)
    outer = beams % 2 == 0
    mirrored = beams // 16 % 2 == 1
    azimuths = np.where(outer, 2.4, -0.65)
    azimuths = np.where(mirrored, -azimuths, azimuths)
    return spinning(
        12.93 - 0.2 * beams,
        columns=columns,
        rate=rate,
        azimuths=-azimuths,
        start=60.0,
        span=120.0,
        min_range=1.0,
        max_range=180.0,
    )
