"""Patterns of lidars: which rays a sweep has, and when each is sent."""

from warpcam.sensors.patterns.domes import robosense_bpearl
from warpcam.sensors.patterns.grids import grid
from warpcam.sensors.patterns.hesai import hesai_at128, hesai_qt128, hesai_xt32
from warpcam.sensors.patterns.livox import livox_csv
from warpcam.sensors.patterns.pattern import Pattern, rays
from warpcam.sensors.patterns.spinning import ouster_metadata, ouster_os0, ouster_os1, ouster_os2, spinning
from warpcam.sensors.patterns.velodyne import velodyne_hdl64e, velodyne_vlp16, velodyne_vlp32c

__all__ = [
    "Pattern",
    "grid",
    "hesai_at128",
    "hesai_qt128",
    "hesai_xt32",
    "livox_csv",
    "ouster_metadata",
    "ouster_os0",
    "ouster_os1",
    "ouster_os2",
    "rays",
    "robosense_bpearl",
    "spinning",
    "velodyne_hdl64e",
    "velodyne_vlp16",
    "velodyne_vlp32c",
]
