"""Sensors: what a robot's cameras and range sensors measure, in every world, on the device."""

from warpcam.sensors.cloud_export import to_open3d, write_ply
from warpcam.sensors.depth.range_limits import DepthRange
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.point_clouds import PointClouds
from warpcam.sensors.rig import Rig
from warpcam.sensors.timing.accumulation import Accumulation
from warpcam.sensors.timing.delivery import Deliveries, Delivery
from warpcam.sensors.timing.shutter import MotionBlur, RollingShutter

__all__ = [
    "Accumulation",
    "Deliveries",
    "Delivery",
    "DepthRange",
    "Effect",
    "EffectFrame",
    "MotionBlur",
    "PointClouds",
    "Rig",
    "RollingShutter",
    "parameter",
    "to_open3d",
    "write_ply",
]
