"""One view as eight cameras measure it, each with another fault, side by side in sensor_colors.png."""

import mujoco
import mujoco_warp as mjw
import numpy as np
from PIL import Image

import warpcam as wc
from warpcam import sensors

SCENE = """
<mujoco>
  <asset>
    <texture name="squares" type="2d" builtin="checker" rgb1=".9 .9 .85" rgb2=".5 .55 .6" width="128" height="128"/>
    <texture name="noon" type="skybox" builtin="gradient" rgb1=".9 .95 1" rgb2=".4 .6 .9" width="64" height="384"/>
    <material name="table" texture="squares" texrepeat="6 6" specular=".3"/>
    <material name="paint" specular=".5" shininess=".6"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="0.6 -0.8 1.6" dir="-0.35 0.5 -1" cutoff="60" diffuse="0.8 0.8 0.8"/>
    <camera name="front" pos="0 -1.4 0.8" xyaxes="1 0 0 0 0.5 1" fovy="42"/>
    <geom name="table" type="box" size="0.9 0.6 0.03" material="table"/>
    <geom name="block" type="box" size=".12 .12 .12" pos="-.3 0 .15" euler="0 0 30" material="paint" rgba=".8 .3 .2 1"/>
    <geom name="ball" type="sphere" size="0.13" pos="0.05 0.1 0.16" material="paint" rgba=".2 .6 .4 1"/>
    <geom name="can" type="cylinder" size="0.09 0.15" pos="0.35 -0.05 0.18" material="paint" rgba=".3 .4 .8 1"/>
  </worldbody>
</mujoco>
"""
SENSOR = {"photons_at_white": 1500.0, "quantum_efficiency": 0.6, "full_well": 1200.0, "gain": 3.0, "dark_noise": 8.0}
CAMERAS = [
    [sensors.Exposure(stops=0.0)],
    [sensors.NaturalVignetting(), sensors.Exposure(stops=-0.5)],
    [sensors.ChromaticAberration(red=1.02, blue=0.98), sensors.Blur(sigma=0.7)],
    [sensors.Emva1288(**SENSOR, bits=12)],
    [sensors.Prnu(sigma=0.06), sensors.DeadPixels(dead=0.005, hot=0.005), sensors.BayerMosaic("RGGB", "bilinear")],
    [
        sensors.WhiteBalance.from_temperature(4000.0),
        sensors.ToneCurve([(0.0, 0.0), (0.1, 0.4), (0.5, 0.85), (1.0, 1.0)]),
    ],
    [sensors.Sharpening(amount=1.5), sensors.Quantization(bits=4)],
    [sensors.JpegArtifacts(quality=8)],
]

model = mujoco.MjModel.from_xml_string(SCENE)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
scene = wc.from_mujoco_warp(model, mjw.put_model(model), mjw.put_data(model, data))
camera = wc.Camera("front", width=160, height=120, outputs=("rgb",), shadows=True, antialiasing=4)
renderer = wc.Renderer(scene, [camera])

images = []
for effects in CAMERAS:
    rig = sensors.Rig(renderer, {"front": effects}, seed=0)
    images.append(rig.read()["front"]["rgb"][0].cpu().numpy())

rows = [np.concatenate(images[first : first + 4], axis=1) for first in (0, 4)]
Image.fromarray(np.concatenate(rows)).save("sensor_colors.png")
