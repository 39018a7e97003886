"""Scenes for lidars: shapes all around a body that carries one, and floors."""

from typing import Any

import mujoco
import numpy as np
import scenes
import warp as wp

import warpcam as wc
from warpcam import sensors

BASE = '<body name="base" mocap="true"><geom name="shell" type="sphere" size=".2"/></body>'


def around(kinds: tuple[str, ...] = scenes.TYPES, more: str = "") -> mujoco.MjModel:
    """One shape of each type on a ring about the origin, with a body "base" that is moved by hand there, and more."""
    random = np.random.default_rng(3)
    world = BASE + more
    for number, kind in enumerate(kinds):
        angle = 2.0 * np.pi * number / len(kinds)
        place = (2.5 * np.cos(angle), 2.5 * np.sin(angle), 0.2 * (number % 3) - 0.2)
        turn = random.normal(size=4) if kind not in ("plane", "hfield") else (1.0, 0.0, 0.0, 0.0)
        pose = f'pos="{" ".join(map(str, place))}" quat="{" ".join(map(str, turn))}"'
        world += scenes.geom_xml(kind, more=pose)
    return scenes.compile_xml(world, assets=scenes.ASSETS)


def posed(mjm: mujoco.MjModel, position: Any = (0.0, 0.0, 0.0), rotation: Any = (1.0, 0.0, 0.0, 0.0)) -> mujoco.MjData:
    """State with "base" in that pose."""
    mjd = mujoco.MjData(mjm)
    mjd.mocap_pos[0], mjd.mocap_quat[0] = position, np.asarray(rotation) / np.linalg.norm(rotation)
    mujoco.mj_forward(mjm, mjd)
    return mjd


def floor(num_worlds: int, device: wp.Device, rgba: str = "1 1 1 1") -> wc.Scene:
    """Worlds with a floor at z = 0 alone."""
    mjm = scenes.compile_xml(f'<geom type="plane" size="0 0 1" rgba="{rgba}"/>')
    with wp.ScopedDevice(device):
        m, d = scenes.put(mjm, num_worlds)
    return wc.from_mujoco_warp(mjm, m, d)


def downward(side: int, max_range: float = np.inf) -> sensors.patterns.Pattern:
    """Parallel rays straight down, ``side`` x ``side`` of them."""
    return sensors.patterns.grid((0.01 * (side - 1), 0.01 * (side - 1)), 0.01, max_range=max_range)


def host(scan: Any) -> dict[str, np.ndarray]:
    """Copies of what a lidar reports."""
    return {name: tensor.cpu().numpy().copy() for name, tensor in scan.items()}
