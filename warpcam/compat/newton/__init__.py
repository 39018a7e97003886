"""Newton's camera sensors, by the classes it has: ``from warpcam.compat.newton import SensorCamera``.

Constructor, ``update``, ``allocate_image_*``, ray helpers, settings, packing and the values where nothing is hit are
those of ``newton.sensors``: see docs/compat/newton.md.
"""

from warpcam.compat.newton.sensor_camera import SensorCamera
from warpcam.compat.newton.sensor_tiled_camera import SensorTiledCamera

__all__ = ["SensorCamera", "SensorTiledCamera"]
