"""Pictures of what depth cameras and stereo cameras measure, each beside the truth."""

import numpy as np
import scenes
import warp as wp

import warpcam as wc
from warpcam import sensors, visualize

SIZE = 48
DEPTH_CAMERAS = (
    *("azure_kinect", "kinect_v1", "oak_d", "realsense_d405", "realsense_d415", "realsense_d435", "realsense_d455"),
    *("vl53l5cx", "zed_2"),
)
# For a camera that measures up to 4 m: a floor, a wall of which a part is too far away, and what stands between.
GEOMS = (
    ("plane", "2 4 1", "0 0 0", "0 0 0", ".6 .6 .6 1"),
    ("box", "1.4 .05 1.4", ".3 1.2 1", "0 0 -25", ".8 .7 .5 1"),
    ("sphere", ".4", "-.4 0 .4", "0 0 0", ".8 .4 .3 1"),
    ("capsule", ".04 .5", ".35 -.5 .6", "0 15 0", ".3 .6 .8 1"),
    ("box", ".25 .2 .3", ".75 .2 .3", "0 0 30", ".02 .02 .02 1"),
)
EYE, TARGET = (0.0, -2.3, 1.4), (0.1, 0.2, 0.6)
LIGHT = '<light type="directional" pos="0 0 3" dir="-0.4 0.5 -1" diffuse="0.8 0.7 0.6" castshadow="false"/>'
# For a camera with a short range: a table before a wall, and what lies on it.
TABLE = """
<geom type="box" size="2 .8 .05" pos="0 .2 -.05" rgba=".7 .7 .7 1"/>
<geom type="box" size="2 .05 .5" pos="0 1.1 .2" rgba=".9 .9 .9 1"/>
<geom type="sphere" size=".14" pos="-.25 .1 .14" rgba=".8 .5 .4 1"/>
<geom type="box" size=".1 .1 .18" pos=".2 .25 .18" euler="0 0 30" rgba=".4 .6 .9 1"/>
"""


def _numbers(text: str, scale: float) -> str:
    return " ".join(str(scale * float(number)) for number in text.split())


def world(scale: float) -> str:
    """What the camera sees, as large as its range is in parts of 4 m."""
    geoms = ""
    for kind, size, place, turn, color in GEOMS:
        lengths = f'size="{_numbers(size, scale)}" pos="{_numbers(place, scale)}"'
        geoms += f'<geom type="{kind}" {lengths} euler="{turn}" rgba="{color}"/>'
    return LIGHT + geoms


def measured(name: str, device: wp.Device) -> np.ndarray:
    """Truth to the left, measured depth to the right; the scene has the size of the camera's range."""
    model: sensors.CameraModel = getattr(sensors, name)()
    scale, size = model.far / 4.0, min(SIZE, model.width)
    mjm = scenes.compile_xml(world(scale))
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    position = tuple(scale * number for number in EYE)
    rotation = scenes.looking(position, tuple(scale * number for number in TARGET))
    camera = model.camera("eye", position=position, rotation=rotation, width=size, height=size)
    rig = sensors.Rig(wc.Renderer(scene, [camera]), {"eye": model}, seed=1)
    both = [images["eye"]["depth"].cpu().numpy() for images in (rig.renderer.images, rig.read())]
    pictures = (
        visualize.picture("depth", np.concatenate(both)).repeat(SIZE // size, axis=1).repeat(SIZE // size, axis=2)
    )
    return np.concatenate(list(pictures), axis=1)


def matched(_: str, device: wp.Device) -> np.ndarray:
    """Infrared image, measured depth and truth of a stereo camera, from the left."""
    mjm = scenes.compile_xml(LIGHT + TABLE)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    position, lens = (0.0, -0.8, 0.75), wc.Pinhole(fovy=55.0)
    camera = wc.Camera(
        "eye", width=96, height=80, position=position, rotation=scenes.looking(position, (0, 0.3, 0.1)), lens=lens
    )
    matching = sensors.StereoMatching(max_disparity=32, block=(3, 3), subpixel="equiangular")
    stereo = sensors.StereoCamera(scene, camera, baseline=0.1, matching=matching, seed=1)
    images = stereo.read()
    both = np.concatenate([images["depth"].cpu().numpy(), stereo.truth.cpu().numpy()])
    infrared = images["infrared_left"][0].cpu().numpy().repeat(3, axis=-1)
    return np.concatenate([infrared, *visualize.picture("depth", both)], axis=1)
