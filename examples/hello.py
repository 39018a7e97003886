"""The smallest whole program: two boxes and a ball in MuJoCo, seen by one camera, saved as hello.png."""

import mujoco
from PIL import Image

import warpcam as wc

SCENE = """
<mujoco>
  <worldbody>
    <light pos="1 -2 4" dir="-0.2 0.4 -1" directional="true"/>
    <camera name="front" pos="0 -2.2 1.1" xyaxes="1 0 0 0 0.4 1"/>
    <geom type="plane" size="0 0 1" rgba="0.8 0.8 0.75 1"/>
    <geom type="box" size="0.3 0.3 0.3" pos="-0.4 0.3 0.3" euler="0 0 30" rgba="0.9 0.5 0.1 1"/>
    <geom type="box" size="0.2 0.2 0.2" pos="-0.4 0.3 0.8" euler="0 0 60" rgba="0.1 0.5 0.6 1"/>
    <geom type="sphere" size="0.3" pos="0.5 -0.1 0.3" rgba="0.7 0.2 0.3 1"/>
  </worldbody>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(SCENE)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)

camera = wc.Camera("front", width=640, height=480, outputs=("rgb",))
images = wc.Renderer(wc.from_mujoco(model, data), [camera]).render()
Image.fromarray(images["front"]["rgb"][0].cpu().numpy()).save("hello.png")
