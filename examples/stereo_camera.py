"""What a stereo camera sees and measures of one table, with and without its projector, in stereo_camera.png."""

import mujoco
import numpy as np
from PIL import Image

import warpcam as wc
from warpcam import sensors, visualize

SCENE = """
<mujoco>
  <asset>
    <texture name="squares" type="2d" builtin="checker" rgb1=".9 .9 .85" rgb2=".4 .45 .5" width="128" height="128"/>
    <material name="cloth" texture="squares" texrepeat="9 7"/>
  </asset>
  <worldbody>
    <light pos="0.6 -0.8 1.6" dir="-0.35 0.5 -1"/>
    <geom type="plane" size="4 4 .1" pos="0 0 -.7" rgba=".6 .6 .6 1"/>
    <geom type="box" size="0.7 0.5 0.03" material="cloth"/>
    <geom type="box" size=".12 .12 .12" pos="-.35 0 .15" euler="0 0 30" rgba=".8 .3 .2 1"/>
    <geom type="sphere" size="0.13" pos="0.02 0.1 0.16" rgba=".9 .9 .9 1"/>
    <geom type="capsule" size="0.02 0.25" pos="0.2 -0.2 0.28" euler="10 20 0"/>
    <geom type="cylinder" size="0.09 0.15" pos="0.42 0.05 0.18" rgba=".02 .02 .02 1"/>
    <geom type="box" size="2.4 .05 1.2" pos="0 1.2 .5" rgba=".8 .8 .8 1"/>
  </worldbody>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(SCENE)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
scene = wc.from_mujoco(model, data)

# The imagers of a RealSense D435 at half their resolution, in a pose that looks at the table from above.
d435 = sensors.realsense_d435()
pose = {"position": (0.0, -1.0, 0.75), "rotation": (0.88, 0.475, 0.0, 0.0)}
camera = d435.camera("d435", width=424, height=240, **pose)
options = {"baseline": 0.05, "matching": sensors.StereoMatching(max_disparity=64, block=(5, 5)), "seed": 0}
active = sensors.StereoCamera(scene, camera, **options)
passive = sensors.StereoCamera(scene, camera, projector=None, ambient=1.0, **options)
seen, without = active.read(), passive.read()

infrared = [seen["infrared_left"], seen["infrared_right"], without["infrared_left"]]
depths = [seen["depth"], active.truth, without["depth"]]
grey, depth = (np.concatenate([image.cpu().numpy() for image in images]) for images in (infrared, depths))
columns = [grey.repeat(3, axis=-1), visualize.picture("depth", depth)]
Image.fromarray(np.concatenate([np.concatenate(list(column)) for column in columns], axis=1)).save("stereo_camera.png")
for name, images in (("with projector", seen), ("without", without)):
    valid = (images["depth"] > 0.0).float().mean().item()
    print(f"{name}: {100 * valid:.1f} % of the pixels are measured")
