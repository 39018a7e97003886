"""Scenes for stereo cameras: walls with and without a texture, seen by a camera that looks down from the origin."""

from typing import Any

import mujoco
import numpy as np
import scenes
import warp as wp

import warpcam as wc
from warpcam import sensors

SIZE = 160, 120  # width and height of images
FOVY = 50.0
FOCAL = 0.5 * SIZE[1] / np.tan(np.radians(0.5 * FOVY))  # [pixels]
BASELINE = 0.1  # [m]
LIGHT = '<visual><headlight ambient=".6 .6 .6" diffuse="0 0 0" specular="0 0 0"/></visual>'
TEXTURE = '<texture name="grain" type="2d" builtin="flat" width="512" height="512"/>'
TEXTURE += '<material name="grain" texture="grain" texrepeat="1 1"/>'
TEXTURED, PLAIN = 'material="grain"', 'rgba=".8 .8 .8 1"'


def wall(distance: float, paint: str, turn: str = "0 0 0") -> str:
    """A wall at a distance [m] before the camera, turned by Euler angles [degrees]."""
    return f'<geom type="plane" size="4 4 .1" pos="0 0 {-distance}" euler="{turn}" {paint}/>'


def model(world: str) -> mujoco.MjModel:
    """Shapes in even light; the texture has spots of random grey."""
    mjm = scenes.compile_xml(world, assets=TEXTURE, more=LIGHT)
    spots = np.random.default_rng(0).integers(40, 255, (256, 256), dtype=np.uint8).repeat(2, axis=0).repeat(2, axis=1)
    mjm.tex_data[:] = spots.reshape(-1, 1).repeat(3, axis=1).ravel()
    return mjm


def scene_of(world: str, num_worlds: int, device: wp.Device) -> wc.Scene:
    with wp.ScopedDevice(device):
        mjm = model(world)
        m, d = scenes.put(mjm, num_worlds)
    return wc.from_mujoco_warp(mjm, m, d)


def eye(**options: Any) -> wc.Camera:
    given = {"outputs": ("depth",), "lens": wc.Pinhole(fovy=FOVY), "position": (0.0, 0.0, 0.0), **options}
    return wc.Camera("eye", width=SIZE[0], height=SIZE[1], **given)


def stereo_of(world: str, device: wp.Device, num_worlds: int = 1, **options: Any) -> sensors.StereoCamera:
    given = {"baseline": BASELINE, "matching": sensors.StereoMatching(max_disparity=32), **options}
    return sensors.StereoCamera(scene_of(world, num_worlds, device), eye(), **given)


def read(stereo: sensors.StereoCamera, **options: Any) -> dict[str, np.ndarray]:
    """Copies of what is measured, (world, height, width)."""
    return {name: image.cpu().numpy()[..., 0].copy() for name, image in stereo.read(**options).items()}


def true_disparity(stereo: sensors.StereoCamera) -> np.ndarray:
    """(world, height, width) [pixels]."""
    return FOCAL * stereo.parameters.baseline.cpu().numpy()[:, None, None] / stereo.truth.cpu().numpy()[..., 0]
