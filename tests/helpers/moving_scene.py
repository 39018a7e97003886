"""A scene whose camera and ball move as functions of time, so that any moment can be drawn by itself."""

from collections.abc import Callable
from typing import Any

import mujoco_warp as mjw
import numpy as np
import scenes
import torch

import warpcam as wc
from warpcam.core.color import srgb_to_linear

ASSETS = """
  <texture name="squares" type="2d" builtin="checker" width="64" height="64" rgb1=".9 .8 .3" rgb2=".1 .3 .5"/>
  <material name="squares" texture="squares" texrepeat=".8 .8" texuniform="true"/>
"""
SKY = """
  <texture name="sky" type="skybox" builtin="checker" width="64" height="384" rgb1=".9 .8 .3" rgb2=".1 .3 .5"
    mark="random" markrgb="1 1 1" random=".05"/>
"""
WORLD = """
  <light pos="0 0 3" dir="0 0 -1"/>
  <geom name="wall" type="box" size="9 9 .1" pos="0 0 -4.1" material="{material}" rgba="{color}"/>
  <body pos="0 0 -2.5"><freejoint/><geom name="ball" size=".4" rgba=".9 .1 .1 1"/></body>
"""
BALL = 1
Path = Callable[[float], Any]


def still(_: float) -> tuple[float, float, float]:
    return (0.0, 0.0, 0.0)


class MovingScene:
    """The scene in some worlds, all alike, at a time that is set."""

    def __init__(
        self,
        *,
        ball: Path = still,
        camera: Path = still,
        turn: Path = lambda _: 0.0,
        squares: bool = True,
        sky: bool = False,
        num_worlds: int = 1,
        size: tuple[int, int] = (64, 48),
        outputs: tuple[str, ...] = ("rgb", "depth", "flow", "flow_valid"),
    ):
        """Paths of the ball and the camera [m], and turn of the camera to the left [rad].

        With ``sky`` there is a skybox in place of the wall.
        """
        look = {"material": "squares", "color": "1 1 1 1"} if squares else {"material": "", "color": ".2 .3 .4 1"}
        world = WORLD.format(**look).replace('material=""', "")
        if sky:
            world = world.replace('pos="0 0 -4.1"', 'pos="0 0 99"')
        self.mjm = scenes.compile_xml(world, assets=ASSETS + (SKY if sky else ""))
        self.m: mjw.Model
        self.m, self.d = scenes.put(self.mjm, num_worlds)
        self.scene = wc.from_mujoco_warp(self.mjm, self.m, self.d)
        own = scenes.own_camera(lens=wc.Pinhole(fovy=60.0), outputs=outputs, width=size[0], height=size[1])
        self.renderer = wc.Renderer(self.scene, [own])
        self.paths = ball, camera, turn
        self.start = self.d.geom_xpos.numpy()[0, BALL].copy()

    def set(self, time: float) -> None:
        ball, camera, turn = (path(time) for path in self.paths)
        self.d.time.fill_(time)
        scenes.write(self.d.geom_xpos, (slice(None), BALL), self.start + np.asarray(ball))
        arrays = self.renderer.camera("eye")
        arrays.position[:] = torch.tensor(np.asarray(camera, np.float32), device=arrays.position.device)
        pose = (np.cos(turn / 2), 0.0, np.sin(turn / 2), 0.0)
        arrays.rotation[:] = torch.tensor(np.asarray(pose, np.float32), device=arrays.position.device)

    def truth(self, time: float, output: str = "rgb") -> np.ndarray:
        """Image of the first world at that time; colours in linear light."""
        self.set(time)
        return linear(self.renderer.render()["eye"][output])


def linear(image: Any) -> np.ndarray:
    """First world's image; colours in linear light."""
    pixels = image[0].cpu().numpy()
    return srgb_to_linear(pixels / 255.0) if pixels.dtype == np.uint8 else pixels.astype(np.float64)
