"""Velodyne's spinning lidars. Rows run from the highest beam to the lowest, sweeps begin ahead."""

import numpy as np

from warpcam.sensors.patterns.pattern import Pattern, periods_of
from warpcam.sensors.patterns.spinning import spinning

# Time of one round of firings, and from one firing to the next [s]: ros-drivers/velodyne, velodyne_pointcloud/
# src/lib/rawdata.cc, of VLP-16 and VLP-32C.
CYCLE, FIRING = 55.296e-6, 2.304e-6

VLP16_ELEVATIONS = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)

# By laser, elevation and azimuth [degrees]: ros-drivers/velodyne, velodyne_pointcloud/params/VeloView-VLP-32C.yaml.
VLP32C_ELEVATIONS = (
    *(-25.0, -1.0, -1.667, -15.639, -11.31, 0.0, -0.667, -8.843, -7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667),
    *(-4.0, -4.667, 1.667, 1.0, -3.667, -3.333, 3.333, 2.333, -2.667, -3.0, 7.0, 4.667, -2.333, -2.0, 15.0, 10.333),
    -1.333,
)
VLP32C_AZIMUTHS = (
    *(-1.4, 4.2, -1.4, 1.4, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -4.2, 1.4),
    *(-1.4, 4.2, -1.4, 4.2, -4.2, 1.4, -1.4, 1.4, -1.4, 1.4, -1.4, 4.2, -4.2, 1.4, -1.4, 1.4),
)


def velodyne_vlp16(rate: float = 10.0) -> Pattern:
    """Return the pattern of a Velodyne VLP-16: 16 beams from -15 to 15 degrees, one after another, up to 100 m.

    Columns follow from the time of a round: 1808 at 10 Hz. Sources: angles: ros-drivers/velodyne,
    ``params/VLP16db.yaml``; times: ``rawdata.cc`` there; range: ``VELODYNE_VLP_16_RAYCASTER_CFG`` of Isaac Lab.

    Args:
        rate: Turns a second [Hz].
    """
    return _velodyne("velodyne_vlp16", VLP16_ELEVATIONS, np.zeros(16), FIRING * np.arange(16), rate, 100.0)


def velodyne_vlp32c(rate: float = 10.0) -> Pattern:
    """Return the pattern of a Velodyne VLP-32C: 32 beams from -25 to 15 degrees, two at a time, up to 200 m.

    Columns follow from the time of a round: 1808 at 10 Hz. Sources: angles: ros-drivers/velodyne,
    ``params/VeloView-VLP-32C.yaml``; times: ``rawdata.cc`` there; range: page of the LOKI data set.

    Args:
        rate: Turns a second [Hz].
    """
    delays = FIRING * (np.arange(32) // 2)
    return _velodyne("velodyne_vlp32c", VLP32C_ELEVATIONS, np.array(VLP32C_AZIMUTHS), delays, rate, 200.0)


def velodyne_hdl64e(columns: int = 2083, rate: float = 10.0) -> Pattern:
    """Return the nominal pattern of a Velodyne HDL-64E: 32 beams from 2 to -8.33 and 32 from -8.83 to -24.33 degrees.

    They lie 1/3 and 1/2 degree apart. 2083 columns are those of 10 Hz, 4167 of 5 Hz, 1042 of 20 Hz. All beams of a
    column are sent at once, which those of the device are not. Range: 120 m. Sources: tables of Velodyne's HDL-64E S2
    manual as LeGO-LOAM's and RangeNet's forks for it repeat them; range: page of the KITTI data set.

    Args:
        columns: Rays of each beam in a turn.
        rate: Turns a second [Hz].
    """
    elevations = np.concatenate((2.0 - np.arange(32) / 3.0, -8.83 - 0.5 * np.arange(32)))
    return spinning(elevations, columns=columns, rate=rate, max_range=120.0)


def _velodyne(
    name: str, elevations: tuple[float, ...], azimuths: np.ndarray, delays: np.ndarray, rate: float, far: float
) -> Pattern:
    angles = np.array(elevations, np.float64)
    order = np.argsort(-angles)
    rings = np.argsort(np.argsort(angles))[order]  # Velodyne's drivers count rings from the lowest beam
    return spinning(
        angles[order],
        columns=int(periods_of(rate, CYCLE, f"{name}: rate")),
        rate=rate,
        azimuths=azimuths[order],
        period=CYCLE,
        row_times=delays[order],
        rings=rings,
        max_range=far,
    )
