"""Pictures of one scene as each effect on depth changes it: the truth to the left, what is measured beside it."""

import functools

import numpy as np
import scenes
import warp as wp

import warpcam as wc
from warpcam import sensors, visualize
from warpcam.sensors.effect import names_of

SIZE = (64, 48)
SENSOR = {"baseline": 0.075, "focal_length": 400.0}  # of a stereo camera with more pixels than the picture
# One of each effect on depth, strong enough to be seen.
EFFECTS: list[sensors.Effect] = [
    sensors.AxialNoise(constant=0.01, quadratic=0.01, angular=0.002),
    sensors.AzureKinectNoise(constant=0.005, slope=0.06, start=1.5),
    sensors.DarkDropout(threshold=0.12),
    sensors.DepthBias(offset=0.1, scale=1.15),
    sensors.DepthDrift(sigma=0.25),
    sensors.DepthFixedPattern(constant=0.02, linear=0.03),
    sensors.DepthQuantization(unit=0.25),
    sensors.DepthRange(min=1.2, max=2.6),
    sensors.DisparityNoise(sigma=0.8, cell=2.0, **SENSOR),
    sensors.DisparityQuantization(step=1.0, **SENSOR),
    sensors.EdgeDropout(threshold=0.4),
    sensors.FlyingPixels(threshold=0.4, probability=0.8),
    sensors.GrazingDropout(start=60.0, end=75.0),
    sensors.LateralNoise(constant=1.0, angular=0.1),
    sensors.MatchingWindow(tolerance=0.5, radius=2, **SENSOR),
    sensors.PolynomialNoise(constant=0.01, linear=0.01, quadratic=0.02),
    sensors.RandomDropout(probability=0.2, cell=2.0),
    sensors.ShiftedLookup(sigma=0.8),
    sensors.StereoShadow(baseline=0.25),
]
DEPTH_EFFECTS = {f"effect_{name}": effect for name, effect in zip(names_of(EFFECTS), EFFECTS, strict=True)}
# What lasts from frame to frame is shown in two.
FRAMES = {"effect_depth_drift": 2, "effect_depth_fixed_pattern": 2}
# A floor, a wall with nothing beside it, a slope, a thin post, a black box and a shiny ball.
WORLD = """
<light type="directional" pos="0 0 3" dir="-.4 .5 -1" diffuse=".8 .7 .6" castshadow="false"/>
<geom type="plane" size="2 4 1" rgba=".6 .6 .6 1"/>
<geom type="box" size="1.1 .05 1.4" pos="-.5 1.4 1" rgba=".8 .7 .5 1"/>
<geom type="box" size=".45 .6 .02" pos=".75 .5 .45" euler="35 0 20" rgba=".3 .6 .4 1"/>
<geom type="capsule" size=".025 .5" pos="-.1 -.9 .5" euler="0 6 0" rgba=".3 .6 .8 1"/>
<geom type="box" size=".2 .15 .25" pos="-.75 -.2 .25" euler="0 0 25" rgba=".02 .02 .02 1"/>
<geom type="sphere" size=".25" pos=".35 -.7 .25" material="shiny"/>
"""
ASSETS = '<material name="shiny" rgba=".9 .9 .95 1" specular="1" shininess="1"/>'
EYE, TARGET = (0.1, -2.4, 1.2), (-0.05, 0.0, 0.5)


def measured(name: str, device: wp.Device) -> np.ndarray:
    """The scene's depth as a camera with that effect measures it, and no other, frame beside frame."""
    truth, frames = _depths(name, device)
    return _picture([truth, *frames])


def without(name: str, device: wp.Device) -> np.ndarray:
    """The same picture if the effect did nothing."""
    truth, frames = _depths(name, device)
    return _picture([truth, *[truth] * len(frames)])


def _depths(name: str, device: wp.Device) -> tuple[np.ndarray, list[np.ndarray]]:
    """True depth, and that of each frame, (1, height, width, 1)."""
    renderer = scene_renderer(device.alias)
    rig = sensors.Rig(renderer, {"eye": [DEPTH_EFFECTS[name]]}, seed=1)
    frames = [rig.read()["eye"]["depth"].cpu().numpy().copy() for _ in range(FRAMES.get(name, 1))]
    return renderer.images["eye"]["depth"].cpu().numpy(), frames


@functools.cache
def scene_renderer(device: str) -> wc.Renderer:
    """Renderer of the scene on the device of that name, with a camera "eye"."""
    mjm = scenes.compile_xml(WORLD, assets=ASSETS)
    camera = wc.Camera(
        "eye",
        width=SIZE[0],
        height=SIZE[1],
        outputs=("depth", "normals", "rgb"),
        lens=wc.Pinhole(fovy=60.0),
        position=EYE,
        rotation=scenes.looking(EYE, TARGET),
    )
    return wc.Renderer(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), [camera])


def _picture(depths: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(list(visualize.picture("depth", np.concatenate(depths))), axis=1)
