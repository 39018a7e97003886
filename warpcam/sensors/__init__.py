"""Sensors: what a robot's cameras and range sensors measure, in every world, on the device."""

from warpcam.sensors import patterns
from warpcam.sensors.depth.range_limits import DepthRange
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.lidar import Lidar
from warpcam.sensors.lidar_noise import Dropout, RangeNoise
from warpcam.sensors.rig import Rig

__all__ = ["DepthRange", "Dropout", "Effect", "EffectFrame", "Lidar", "RangeNoise", "Rig", "parameter", "patterns"]
