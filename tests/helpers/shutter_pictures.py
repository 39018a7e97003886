"""Pictures of a moving scene by cameras with a shutter."""

import numpy as np
import warp as wp
from moving_scene import MovingScene

from warpcam import sensors, visualize

SHUTTERS: dict[str, sensors.Effect] = {
    "rolling_shutter": sensors.RollingShutter(readout=0.05),
    "rolling_shutter_right": sensors.RollingShutter(readout=0.05, direction="right"),
    "rolling_shutter_depth": sensors.RollingShutter(readout=0.05, changes="depth"),
    "motion_blur": sensors.MotionBlur(exposure=0.03, samples=8),
    "accumulation": sensors.Accumulation(samples=4),
}


def exposed(name: str, device: wp.Device) -> np.ndarray:
    """What the camera measures while it turns and moves, and a ball flies by."""
    return _read(name, device)[1]


def frozen(name: str, device: wp.Device) -> np.ndarray:
    """The scene at the last moment, as it is without a shutter."""
    return _read(name, device)[0]


def _read(name: str, device: wp.Device) -> list[np.ndarray]:
    with wp.ScopedDevice(device):
        moving = MovingScene(
            ball=lambda time: (0.3 + 12.0 * time, 0.1, 0.0),
            camera=lambda time: (0.0, 3.0 * time, 0.0),
            turn=lambda time: 1.5 * time,
            size=(48, 48),
        )
    rig = sensors.Rig(moving.renderer, {"eye": [SHUTTERS[name]]})
    times = (-0.03, -0.02, -0.01, 0.0) if name == "accumulation" else (-0.05, 0.0)
    for time in times:
        moving.set(time)
        rig.read()
    output = "depth" if name.endswith("depth") else "rgb"
    both = [images["eye"][output].cpu().numpy() for images in (moving.renderer.images, rig.images)]
    return [visualize.picture(output, image)[0] for image in both]
