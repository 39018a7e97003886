"""Scenes and cameras for lenses that are tables of rays."""

from typing import Any

import numpy as np
from custom_ray_tables import HEIGHT, WIDTH

import warpcam as wc

TURN = np.array([0.93, 0.19, -0.08, 0.3])
PLACE = (0.15, 0.1, 0.45)
ASSETS = (
    '<mesh name="tent" vertex="0 0 0 .4 0 0 0 .4 0 0 0 .4"/>'
    '<texture name="boards" type="2d" builtin="checker" rgb1="1 .2 .1" rgb2=".1 .6 1" width="64" height="64"/>'
    '<material name="boards" texture="boards" texrepeat="6 6"/>'
)
SCENE = """
<light pos="1 1 3" dir="-.3 -.3 -1"/>
<geom type="plane" size="5 5 .1" pos="0 0 -1" material="boards"/>
<geom type="sphere" size=".3" pos="0 0 -.2"/>
<geom type="box" size=".2 .1 .3" pos=".7 .3 0" euler="20 30 40"/>
<geom type="capsule" size=".1 .3" pos="-.6 .4 -.3" euler="70 0 20"/>
<geom type="cylinder" size=".15 .3" pos=".2 -.7 -.3" euler="30 50 0"/>
<geom type="ellipsoid" size=".3 .1 .2" pos="-.5 -.5 0"/>
<geom type="mesh" mesh="tent" pos=".1 .7 0"/>
<geom type="box" size=".1 .8 .05" pos=".3 0 1.2"/>
"""

BALLS = "".join(
    f'<geom type="sphere" size=".1" pos="{0.25 * (i % 17 - 8)} {0.25 * (i // 17 - 8)} {-0.3 * (i % 5)}"/>'
    for i in range(289)
)
HILLS = " ".join(str(round(0.5 + 0.5 * float(np.sin(i * 0.7) * np.cos(i * 0.13)), 3)) for i in range(400))
SKY = '<texture type="skybox" builtin="gradient" rgb1="1 1 1" rgb2=".1 .2 .6" width="32" height="32"/>'
WORLDS = {
    "haze": (
        SKY,
        '<geom type="plane" size="0 0 1" pos="0 0 -1" rgba=".3 .5 .3 1"/><geom size=".3" pos="1 .2 0"/>',
        '<visual><map haze=".4"/></visual>',
    ),
    "transparent": (
        ASSETS,
        SCENE
        + '<geom size=".4" pos=".3 .3 .4" rgba="1 1 0 .4"/>'
        + '<geom type="box" size=".2 .2 .2" rgba="0 1 1 .5" pos="-.5 0 .5"/>',
        "",
    ),
    "hills": (
        f'<hfield name="hills" nrow="20" ncol="20" size="3 3 .6 .1" elevation="{HILLS}"/>',
        '<geom type="hfield" hfield="hills" pos="0 0 -1"/><geom size=".3" pos=".4 .2 0"/>',
        "",
    ),
    "many": ("", '<light pos="0 0 3"/>' + BALLS, ""),
    "sky": (
        '<texture type="skybox" builtin="checker" rgb1="1 1 .2" rgb2=".1 .2 .6" width="128" height="128"'
        ' mark="random" markrgb="1 0 0" random=".3"/>',
        '<geom size=".3" pos=".4 .2 1"/>',
        "",
    ),
}


def camera(lens: wc.Lens, name: str = "own", **settings: Any) -> wc.Camera:
    chosen = {"width": WIDTH, "height": HEIGHT, "position": PLACE, "rotation": TURN} | settings
    return wc.Camera(name, lens=lens, **chosen)


def rendered(scene: wc.Scene, *cameras: wc.Camera) -> list[dict[str, np.ndarray]]:
    """Return the first world's image."""
    images = wc.Renderer(scene, cameras).render()
    return [{name: image[0].cpu().numpy() for name, image in images[one.name].items()} for one in cameras]
