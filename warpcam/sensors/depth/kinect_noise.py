"""Axial and lateral noise of a Kinect, as Nguyen et al. measured them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.depth_lookup import shift_nearest
from warpcam.sensors.kernels.depth_noise import add_axial_noise


@dataclass(frozen=True, eq=False)
class AxialNoise(Effect):
    """Gaussian noise along the optical axis that grows with depth z and angle of incidence theta.

    ``sigma = constant + quadratic (z - start)^2 + angular / sqrt(z) (theta / (pi / 2 - theta))^2``. Source of formula
    and defaults: Nguyen, Izadi and Lovell, "Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking",
    3DIMPVT 2012. Angles above 89 degrees count as 89, pixels without a normal as seen head-on: their depth is a
    neighbour's, by ``LateralNoise``. Needs the camera's ``normals``.

    Attributes:
        constant: Least standard deviation [m]; a number or (world,), as all that follow.
        quadratic: Growth with depth [1/m].
        start: Depth where the growth begins [m].
        angular: Growth with the angle [m^1.5].
    """

    constant: Any = parameter(0.0012, low=0.0)
    quadratic: Any = parameter(0.0019, low=0.0)
    start: Any = parameter(0.4, low=0.0)
    angular: Any = parameter(0.0001, low=0.0)

    kind = "depth"
    reads = ("normals",)
    needs_pinhole = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [
            frame.mask,
            frame.size,
            frame.views,
            frame.truth["normals"],
            frame.randomness,
            params.constant,
            params.quadratic,
        ]
        inputs += [params.start, params.angular, frame.source, frame.target]
        return [frame.per_strip(add_axial_noise, inputs)]


@dataclass(frozen=True, eq=False)
class LateralNoise(Effect):
    """Noise across the optical axis: each pixel shows the depth of a pixel at a random distance.

    Both coordinates of the distance are Gaussian, ``sigma = constant + angular theta / (pi / 2 - theta)`` with the
    angle of incidence theta, cut off at 89 degrees. Source: as of ``AxialNoise``. Pixels without a measurement are
    looked up as any other, so outlines fray to both sides. Needs the camera's ``normals``.

    Attributes:
        constant: Standard deviation at right angles [pixels of the sensor]; a number or (world,), as all that follow.
        angular: Growth with the angle [pixels of the sensor].
        focal_length: Focal length of the sensor [pixels], for images that have fewer pixels than it; 0 is the camera's
            own.
        focal_length_y: That of columns, where pixels of the sensor are not square; 0 is ``focal_length``.
    """

    constant: Any = parameter(0.8, low=0.0)
    angular: Any = parameter(0.035, low=0.0)
    focal_length: Any = parameter(0.0, low=0.0)
    focal_length_y: Any = parameter(0.0, low=0.0)

    kind = "depth"
    reads = ("normals",)
    in_place = False
    needs_pinhole = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [
            frame.mask,
            frame.size,
            frame.views,
            frame.truth["normals"],
            frame.randomness,
            params.constant,
            params.angular,
        ]
        inputs += [params.focal_length, params.focal_length_y, frame.source, frame.target]
        return [frame.per_strip(shift_nearest, inputs)]
