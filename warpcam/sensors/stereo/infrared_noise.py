"""Noise of infrared images."""

from dataclasses import dataclass
from typing import Any

from warpcam.sensors.effect import parameter


@dataclass(frozen=True, eq=False)
class InfraredNoise:
    """Speckle and thermal noise: a level I becomes G I + offset + sigma N, of 255 levels.

    G has a gamma distribution of mean 1, N a normal one (Landau, Choo and Beling, "Simulating Kinect Infrared and Depth
    Images", 2016). Default values are those of SAPIEN's ``SimSenseComponent``: shape 1333.33 and scale 1 / 1333.33,
    sigma 0.25, no offset. Its ``ir_speckle_noise`` is a factor of ``speckle``, ``ir_thermal_noise`` one of ``sigma``.

    Each is a number or has shape (world,): numpy, torch or Warp. A float32 tensor on the scene's device is read in
    place.

    Attributes:
        speckle: Variance of G, from 0, none, to 1.
        sigma: Standard deviation of thermal noise [levels].
        offset: Mean of thermal noise [levels].
    """

    speckle: Any = parameter(1.0 / 1333.33, low=0.0, high=1.0)
    sigma: Any = parameter(0.25, low=0.0)
    offset: Any = parameter(0.0)
