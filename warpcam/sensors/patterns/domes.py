"""Lidars that see a half sphere."""

import numpy as np

from warpcam.sensors.patterns.pattern import Pattern, periods_of
from warpcam.sensors.patterns.spinning import spinning

# Time of one round of firings [s]: RS-Bpearl User Manual 2.0.1, chapter 9.
BPEARL_CYCLE = 55.5e-6


def robosense_bpearl(columns: int | None = None, rate: float = 10.0) -> Pattern:
    """Return the pattern of a RoboSense RS-Bpearl: 32 beams from 89.5 to 2.3125 degrees above the xy plane.

    All beams of a column are sent at once. Sources: first and last angle, time of a round: RS-Bpearl User Manual 2.0.1;
    the angles between: ``BpearlPatternCfg`` of Isaac Lab, equal steps of 2.8125 degrees but for the last digits.

    Args:
        columns: Rays of each beam in a turn; as many as there are rounds, 1801 at 10 Hz, unless given.
        rate: Turns a second [Hz].
    """
    if columns is None:
        columns = int(periods_of(rate, BPEARL_CYCLE, "robosense_bpearl: rate"))
    elevations = 89.5 - 2.8125 * np.arange(32)
    return spinning(elevations, columns=columns, rate=rate)
