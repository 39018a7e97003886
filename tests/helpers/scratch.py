"""Scratch memory of pinhole cameras, without a renderer."""

from collections.abc import Mapping

import warp as wp

import warpcam as wc
from warpcam.kernels.plan.frame import plan_frame
from warpcam.kernels.scene_tables import SceneTables
from warpcam.render.camera_passes import request_of
from warpcam.render.scratch_memory import Scratch


def scratch_of(cameras: Mapping[str | int, wc.Camera], tables: SceneTables, device: wp.Device) -> Scratch:
    plans = {key: plan_frame(tables, request_of(camera, "pinhole"), device) for key, camera in cameras.items()}
    return Scratch(cameras, plans, tables.num_worlds, device)
