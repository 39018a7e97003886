"""What depth cameras measure of one table, the truth first, side by side in depth_cameras.png."""

import mujoco
import numpy as np
from PIL import Image

import warpcam as wc
from warpcam import sensors, visualize

SCENE = """
<mujoco>
  <worldbody>
    <light pos="0.6 -0.8 1.6" dir="-0.35 0.5 -1"/>
    <geom type="plane" size="4 4 .1" pos="0 0 -.7"/>
    <geom type="box" size="0.7 0.5 0.03"/>
    <geom type="box" size=".12 .12 .12" pos="-.35 0 .15" euler="0 0 30"/>
    <geom type="sphere" size="0.13" pos="0.02 0.1 0.16"/>
    <geom type="capsule" size="0.02 0.25" pos="0.2 -0.2 0.28" euler="10 20 0"/>
    <geom type="cylinder" size="0.09 0.15" pos="0.42 0.05 0.18" rgba=".02 .02 .02 1"/>
    <geom type="box" size="1.2 .05 1.2" pos="0 1.2 .5"/>
  </worldbody>
</mujoco>
"""
MODELS = [sensors.kinect_v1(), sensors.realsense_d415(), sensors.realsense_d435(), sensors.realsense_d455()]
MODELS += [sensors.azure_kinect(), sensors.zed_2(), sensors.oak_d()]
POSE = {"position": (0.0, -1.0, 0.75), "rotation": (0.88, 0.475, 0.0, 0.0)}  # looks at the table from above
WIDTH, HEIGHT = 240, 180

model = mujoco.MjModel.from_xml_string(SCENE)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
scene = wc.from_mujoco(model, data)

# One lens for all, so that the pictures can be compared; `model.camera(name)` has the model's own.
cameras, effects = [], {}
for each in MODELS:
    options = {"outputs": each.outputs, "lens": wc.Pinhole(fovy=55.0), **POSE}
    cameras.append(wc.Camera(each.name, width=WIDTH, height=HEIGHT, **options))
    effects[each.name] = list(each)

rig = sensors.Rig(wc.Renderer(scene, cameras), effects, seed=0)
measured = rig.read()
truth = rig.renderer.images[MODELS[0].name]["depth"]
images = np.concatenate([image.cpu().numpy() for image in (truth, *(measured[each.name]["depth"] for each in MODELS))])
pictures = visualize.picture("depth", images)

rows = [np.concatenate(list(pictures[first : first + 4]), axis=1) for first in (0, 4)]
Image.fromarray(np.concatenate(rows)).save("depth_cameras.png", optimize=True)
for each in MODELS:
    valid = (measured[each.name]["depth"] > 0).float().mean().item()
    print(f"{each.name}: {100 * valid:.1f} % of the pixels are measured")
