"""mjlab's camera and ray-cast sensors, traced by warpcam.

``from warpcam.compat.mjlab import CameraSensorCfg, RayCastSensorCfg, TerrainHeightSensorCfg``. Configurations and
sensors are mjlab's own but for who draws: see docs/compat/mjlab.md. Importing this has ``Simulation.sense`` read these
sensors beside whatever else it does.
"""

from dataclasses import fields
from typing import Any

import mjlab.sensor as theirs

from warpcam.compat.mjlab.camera_sensor import CameraSensor, CameraSensorCfg, CameraSensorData
from warpcam.compat.mjlab.ray_cast_sensor import (
    RayCastSensor,
    RayCastSensorCfg,
    TerrainHeightSensor,
    TerrainHeightSensorCfg,
)

__all__ = [
    "CameraSensor",
    "CameraSensorCfg",
    "CameraSensorData",
    "RayCastSensor",
    "RayCastSensorCfg",
    "TerrainHeightSensor",
    "TerrainHeightSensorCfg",
    "use",
]

RAY_CASTS = {theirs.RayCastSensorCfg: RayCastSensorCfg, theirs.TerrainHeightSensorCfg: TerrainHeightSensorCfg}


def use(cfg: Any, **more: Any) -> Any:
    """Have the camera and ray-cast sensors of a task's configuration read by warpcam.

    Args:
        cfg: mjlab's ManagerBasedRlEnvCfg, or its SceneCfg; changed in place.
        **more: Chosen for all of its cameras, those that are ours already too: ``antialiasing`` and the like.

    Returns:
        ``cfg``.
    """
    scene = getattr(cfg, "scene", cfg)
    scene.sensors = tuple(_ours(sensor, more) for sensor in scene.sensors or ())
    return cfg


def _ours(sensor: Any, more: dict[str, Any]) -> Any:
    if type(sensor) in (theirs.CameraSensorCfg, CameraSensorCfg):
        return CameraSensorCfg.of(sensor, **more)
    kind = RAY_CASTS.get(type(sensor))
    return sensor if kind is None else kind(**{field.name: getattr(sensor, field.name) for field in fields(sensor)})
