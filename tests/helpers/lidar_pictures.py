"""Pictures of scans of a ring of shapes, one of each type, on a floor before a wall."""

from typing import Any

import lidar_scenes
import numpy as np
import scenes
import warp as wp

import warpcam as wc
from warpcam import sensors, visualize

ROOM = '<geom type="plane" size="0 0 1" pos="0 0 -1"/><geom type="box" size=".1 3 1.5" pos="4 0 0"/>'
PATTERNS = sensors.patterns
OUSTER = PATTERNS.ouster_os1(channels=32, columns=512)
SPINNING = PATTERNS.spinning(
    np.linspace(20.0, -25.0, 32), columns=128, azimuths=np.tile((4.0, 1.0, -1.0, -4.0), 8), start=90.0, max_range=4.0
)
# What a lidar sees, by name: the sensor's output and its arguments.
SCANS: dict[str, tuple[str, dict[str, Any]]] = {
    "lidar_ouster": ("ranges", {"pattern": OUSTER}),
    "lidar_spinning": ("ranges", {"pattern": SPINNING}),
    "lidar_dome": ("ranges", {"pattern": PATTERNS.robosense_bpearl(columns=128), "rotation": (0.0, 1.0, 0.0, 0.0)}),
    "lidar_grid": (
        "ranges",
        {"pattern": PATTERNS.grid((6.0, 6.0), 0.125), "position": (0.0, 0.0, 1.5), "alignment": "yaw"},
    ),
    "lidar_intensities": ("intensities", {"pattern": SPINNING}),
    "lidar_ids": ("ids", {"pattern": SPINNING}),
    "lidar_points": ("points", {"pattern": SPINNING}),
    "lidar_noise": ("ranges", {"pattern": SPINNING, "noise": sensors.LidarNoise(constant=0.1, resolution=0.05)}),
    "lidar_dropout": ("ranges", {"pattern": SPINNING, "dropout": sensors.LidarDropout.carla()}),
    "lidar_echo": ("ranges", {"pattern": SPINNING, "echoes": 2, "divergence": 4.0, "echo_gap": 0.3}),
    "lidar_moving": ("ranges", {"pattern": SPINNING, "sweep": "moving"}),
}
POSES = (((0.0, 0.4, 0.1), (1.0, 0.0, 0.0, -0.1)), ((0.3, 0.0, 0.0), (1.0, 0.05, 0.1, 0.2)))


def scanned(name: str, device: wp.Device) -> np.ndarray:
    """The second scan of a body that moves; of echoes the second."""
    return _scan(*SCANS[name], device)


def without(name: str, device: wp.Device) -> np.ndarray:
    """The same picture without noise and without dropout."""
    output, arguments = SCANS[name]
    return _scan(output, {key: value for key, value in arguments.items() if key not in ("noise", "dropout")}, device)


def _scan(output: str, arguments: dict[str, Any], device: wp.Device) -> np.ndarray:
    mjm = lidar_scenes.around(more=ROOM)
    mjd = lidar_scenes.posed(mjm)
    scene = wc.from_mujoco(mjm, mjd, device=device)
    options = {"parent": "base", "exclude_body": "base", "seed": 1, "outputs": (output,), **arguments}
    lidar = sensors.Lidar(scene, **options)
    for place, turn in POSES:
        mjd.mocap_pos[0], mjd.mocap_quat[0] = place, np.asarray(turn) / np.linalg.norm(turn)
        scenes.mujoco.mj_forward(mjm, mjd)
        scan = lidar.read()[output][0].cpu().numpy()
    return _picture(output, scan[:, :, -1] if "echoes" in arguments else scan)


def _picture(output: str, scan: np.ndarray) -> np.ndarray:
    if output == "intensities":  # brighter is brighter, as nearer is in pictures of lengths
        scan = np.where(scan > 0.0, 1.0 / np.maximum(scan, 1e-6), np.inf)
    kind = {"ranges": "distance", "intensities": "distance", "ids": "segmentation", "points": "points"}[output]
    return visualize.picture(kind, scan.reshape(1, *scan.shape[:2], -1))[0]
