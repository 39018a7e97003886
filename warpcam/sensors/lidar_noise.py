"""Noise and dropout of lidars."""

from dataclasses import dataclass
from typing import Any

from warpcam.sensors.effect import parameter


@dataclass(frozen=True, eq=False)
class LidarNoise:
    """Noise of ranges: r becomes r + offset + sigma(r) n, with n of a normal distribution, rounded to the resolution.

    sigma(r) = constant + linear r + quadratic r^2, at least 0, as ``apply_noise`` of aerial_gym_simulator 2.0.1 has it.
    Its values for Ouster's OS0 are (9.619e-3, -3.172e-4, 3.362e-5), for OS1 and OS2 (5.308e-3, -4.073e-6, 3.083e-6),
    for RoboSense's Airy and Ouster's OSDome (1.553e-2, -3.434e-3, 3.809e-4), in the order of the attributes.

    Each is a number or has shape (world,): numpy, torch or Warp. A float32 tensor on the scene's device is read in
    place.

    Attributes:
        constant: Of sigma [m].
        linear: Of sigma, for each metre of range.
        quadratic: Of sigma [1 / m].
        offset: Mean error [m].
        resolution: Step of ranges, at least 0; 0 rounds nothing [m].
    """

    constant: Any = parameter(0.0)
    linear: Any = parameter(0.0)
    quadratic: Any = parameter(0.0)
    offset: Any = parameter(0.0)
    resolution: Any = parameter(0.0, low=0.0)


@dataclass(frozen=True, eq=False)
class LidarDropout:
    """Returns that are lost, as CARLA's ray-cast lidar loses them (``RayCastLidar.cpp``).

    A ray is lost with the probability ``rate``. Of the others, light I = exp(-attenuation r) comes back of the range r
    [m]. Above ``intensity_limit`` it is seen; below, the probability is 1 - zero_intensity + zero_intensity I /
    intensity_limit. CARLA's own values are rate 0.45, intensity_limit 0.8, zero_intensity 0.4 and attenuation 0.004:
    ``LidarDropout.carla()``.

    Each is a number or has shape (world,): numpy, torch or Warp. A float32 tensor on the scene's device is read in
    place.

    Attributes:
        rate: Probability in [0, 1] that a ray is lost, whatever it meets.
        intensity_limit: Light in [0, 1] above which no further ray is lost.
        zero_intensity: Probability in [0, 1] that a ray is lost of which no light comes back.
        attenuation: Loss of light in the air, at least 0 [1 / m]; ``intensities`` fall by it, too.
    """

    rate: Any = parameter(0.0, low=0.0, high=1.0)
    intensity_limit: Any = parameter(0.0, low=0.0, high=1.0)
    zero_intensity: Any = parameter(0.0, low=0.0, high=1.0)
    attenuation: Any = parameter(0.0, low=0.0)

    @classmethod
    def carla(cls) -> "LidarDropout":
        """Return CARLA's default values: ``FLidarDescription``."""
        return cls(rate=0.45, intensity_limit=0.8, zero_intensity=0.4, attenuation=0.004)
