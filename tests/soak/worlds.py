"""What a soak draws: worlds whose shapes move with the number of the frame, and that are randomised in place."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
import warp as wp

import warpcam as wc

sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers"))
import mujoco
import mujoco_warp as mjw
import small_scene

VARIED = ("material_color", "light_diffuse", "background")
OUTPUTS = ("rgb", "depth", "segmentation", "normals", "flow", "flow_valid")


class Worlds:
    """Worlds of a small scene, and a renderer that stays.

    Attributes:
        scene: Theirs.
        renderer: Two cameras: one with shadows and flow, and one with smooth edges.
    """

    def __init__(self, device: wp.Device, count: int, size: int):
        self.device, self.size = device, size
        xml = small_scene.MODEL.replace("</worldbody>", small_scene.MIRROR + small_scene.GLASS + "</worldbody>")
        self._model = mujoco.MjModel.from_xml_string(xml)
        host = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, host)
        with wp.ScopedDevice(device):
            self._m = mjw.put_model(self._model)
            self._d = mjw.put_data(self._model, host, nworld=count, nconmax=64, njmax=256)
        self.scene = self._new_scene()
        self._shapes = wp.to_torch(self._d.geom_xpos)
        self._start = self._shapes.clone()
        random = torch.from_numpy(np.random.default_rng(0).normal(size=self._shapes.shape).astype(np.float32))
        self._speeds = random.to(self._shapes.device)
        self.renderer = self.new_renderer(self.scene)

    def _new_scene(self) -> wc.Scene:
        scene = wc.from_mujoco_warp(self._model, self._m, self._d)
        for name in VARIED:
            scene.vary(name)
        return scene

    def new_renderer(self, scene: wc.Scene, size: int | None = None) -> wc.Renderer:
        width = size or self.size
        settings: dict[str, Any] = {"width": width, "height": width - 3}
        return wc.Renderer(
            scene,
            [
                small_scene.camera("top", outputs=OUTPUTS, shadows=True, **settings),
                small_scene.camera("side", outputs=("rgb", "depth"), antialiasing=4, **settings),
            ],
        )

    def move(self, frame: int) -> None:
        """Put the shapes where that frame has them; the floor and the mirror stay."""
        torch.add(self._start, torch.sin(self._speeds * (0.01 * frame)), alpha=0.3, out=self._shapes)

    def randomize(self, seed: int, worlds: Any) -> None:
        """Draw colours anew in some worlds."""
        wc.randomize(
            self.scene,
            seed=seed,
            worlds=worlds,
            material_color=wc.Uniform((0.1, 0.1, 0.1, 1.0), (1.0, 1.0, 1.0, 1.0)),
            light_diffuse=wc.Uniform(0.2, 0.9, linked=True),
            background=wc.Uniform(0.0, 1.0),
        )

    def differences(self, frame: int) -> list[str]:
        """Images of the frame that was drawn last which a new scene and renderer draw otherwise, in any bit.

        They draw the frame before, too, which flow is since.
        """
        scene = self._new_scene()
        for name in VARIED:
            scene.vary(name).copy_(self.scene.vary(name))
        fresh = self.new_renderer(scene)
        for each in (frame - 1, frame):
            self.move(each)
            images = fresh.render()
        return [
            f"frame {frame}: {camera} {output}"
            for camera, own in self.renderer.images.items()
            for output, image in own.items()
            if not torch.equal(image, images[camera][output])
        ]
