"""Eight worlds of one kitchen table, each with looks of its own, side by side in randomize.png."""

import mujoco
import mujoco_warp as mjw
import numpy as np
from PIL import Image

import warpcam as wc

WORLDS = 8

SCENE = """
<mujoco>
  <asset>
    <texture name="squares" type="2d" builtin="checker" rgb1=".9 .9 .85" rgb2=".5 .55 .6" width="128" height="128"/>
    <texture name="waves" type="2d" builtin="gradient" rgb1=".75 .55 .35" rgb2=".4 .25 .15" width="128" height="128"/>
    <texture name="clay" type="2d" builtin="flat" rgb1=".8 .75 .7" rgb2="0 0 0" width="4" height="4"/>
    <texture name="noon" type="skybox" builtin="gradient" rgb1=".9 .95 1" rgb2=".4 .6 .9" width="64" height="384"/>
    <texture name="dusk" type="skybox" builtin="gradient" rgb1=".9 .6 .4" rgb2=".3 .25 .4" width="64" height="384"/>
    <material name="table" texture="squares" texrepeat="4 4" specular=".3"/>
    <material name="paint" specular=".5" shininess=".6"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="0.6 -0.8 1.6" dir="-0.35 0.5 -1" cutoff="60" diffuse="0.8 0.8 0.8"/>
    <camera name="front" pos="0 -1.7 1.0" xyaxes="1 0 0 0 0.5 1" fovy="45"/>
    <geom name="table" type="box" size="0.7 0.5 0.03" material="table"/>
    <geom name="block" type="box" size=".12 .12 .12" pos="-.3 0 .15" euler="0 0 30" material="paint" rgba=".8 .3 .2 1"/>
    <geom name="ball" type="sphere" size="0.13" pos="0.05 0.1 0.16" material="paint" rgba=".2 .6 .4 1"/>
    <geom name="can" type="cylinder" size="0.09 0.15" pos="0.35 -0.05 0.18" material="paint" rgba=".3 .4 .8 1"/>
  </worldbody>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(SCENE)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
m, d = mjw.put_model(model), mjw.put_data(model, data, nworld=WORLDS)
scene = wc.from_mujoco_warp(model, m, d)

things = [model.geom(name).id for name in ("block", "ball", "can")]
textures = [model.texture(name).id for name in ("squares", "waves", "clay")]
skies = [model.texture(name).id for name in ("noon", "dusk")]


def new_looks(seed: int) -> None:
    """Draw all worlds anew; ``worlds=`` would draw some."""
    wc.randomize(
        scene,
        seed=seed,
        shape_colors=wc.Uniform((0.1, 0.1, 0.1, 1.0), (0.9, 0.9, 0.9, 1.0), rows=things),
        material_texture=wc.Choice(textures, rows=[model.material("table").id]),
        material_texture_offset=(0.0, 1.0),
        light_directions=wc.Uniform(0.0, 25.0, of="turn"),
        light_diffuse=wc.Uniform((0.7, 0.7, 0.6), (1.2, 1.1, 1.2), of="factor"),
        headlight=wc.Uniform(0.5, 1.2, of="factor", linked=True),
        skybox=wc.Choice(skies),
    )


new_looks(seed=0)  # before the renderer is made: it is made for what is drawn
camera = wc.Camera("front", width=160, height=160, outputs=("rgb",), shadows=True, antialiasing=4, exposure=0.0)
renderer = wc.Renderer(scene, [camera])
new_looks(seed=3)
wc.randomize(renderer.camera("front"), seed=3, exposure=(-0.4, 0.4), gain=(0.9, 1.1))
images = renderer.render()["front"]["rgb"].cpu().numpy()

rows = [np.concatenate(images[first : first + WORLDS // 2], axis=1) for first in (0, WORLDS // 2)]
Image.fromarray(np.concatenate(rows)).save("randomize.png")
