"""warpcam itself."""

from typing import Any

import numpy as np

import warpcam as wc
from warpcam.benchmarks.cases import Wanted
from warpcam.benchmarks.compare import Images
from warpcam.benchmarks.peers import Peer
from warpcam.benchmarks.problem import Problem


class WarpcamPeer:
    """Textures are always drawn, there is no switch; skies never, reflections only if asked for: peers have none."""

    variants: tuple[str, ...] = ("",)
    lacks: tuple[str, ...] = ()
    on_host = False
    told_memory_mb: float | None = None

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._drawn = {"reflections": False, "transparency": False}
        self.scene = self._scene(**self._drawn)
        self.renderer: wc.Renderer | None = None

    def _scene(self, *, reflections: bool, transparency: bool) -> wc.Scene:
        problem = self.problem
        draw = ("geoms", "flexes") if problem.case.flexes else ("geoms",)  # what peers draw
        return wc.from_mujoco_warp(
            problem.mjm, problem.m, problem.d, draw=draw, reflections=reflections, transparency=transparency
        )

    def release(self) -> None:
        self.renderer = None

    def prepare(self, wanted: Wanted) -> None:
        self.wanted = wanted
        drawn = {"reflections": wanted.reflections, "transparency": wanted.transparency}
        if self._drawn != drawn:
            self.scene = self._scene(**drawn)
            self._drawn = drawn
        cameras = [
            wc.Camera(
                name,
                width=self.problem.width,
                height=self.problem.height,
                outputs=wanted.outputs,
                shadows=wanted.shadows,
                antialiasing=wanted.antialiasing,
                background=(0.0, 0.0, 0.0),
                **self._own(index),
            )
            for name, index in zip(self.problem.cameras, self.problem.camera_ids, strict=True)
        ]
        self.told_memory_mb = 1e-6 * wc.estimate_memory(self.scene, cameras).total
        self.renderer = wc.Renderer(self.scene, cameras)

    def _own(self, index: int) -> dict[str, Any]:
        """Return camera arguments that the scene does not have."""
        return {}

    def place(self, index: int) -> None:
        self.problem.place(index)

    def frame(self, variant: str) -> None:
        self._renderer().render()

    def images(self, worlds: int) -> list[Images]:
        return [
            {name: self._image(camera, name)[:worlds] for name in self.wanted.outputs}
            for camera in self.problem.cameras
        ]

    def _image(self, camera: str, output: str) -> np.ndarray:
        image: np.ndarray = self._renderer().array(camera, output).numpy()
        if output == "segmentation" and self.problem.case.flexes:
            return self.problem.one_id(*np.moveaxis(self.scene.objects[image[..., 0]], -1, 0))
        return image[..., 0] if image.shape[-1] == 1 else image

    def _renderer(self) -> wc.Renderer:
        if self.renderer is None:
            raise RuntimeError("prepare was not called")
        return self.renderer


def create(problem: Problem) -> Peer:
    """Through the simulator that the case is about."""
    if not problem.case.newton:
        return WarpcamPeer(problem)
    from warpcam.benchmarks.peers.warpcam_newton import WarpcamOnNewton  # only where Newton is installed

    return WarpcamOnNewton(problem)
