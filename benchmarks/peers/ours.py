"""warpcam itself."""

import numpy as np
from warpcam.benchmarks.cases import Wanted
from warpcam.benchmarks.compare import Images
from warpcam.benchmarks.peers import Peer
from warpcam.benchmarks.problem import Problem

import warpcam as wc


class WarpcamPeer:
    """Textures are always drawn, there is no switch; skies and reflections are not, as the peers draw none here."""

    variants: tuple[str, ...] = ("",)
    lacks: tuple[str, ...] = ()

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.scene = wc.from_mujoco_warp(  # what peers draw
            problem.mjm, problem.m, problem.d, draw=("geoms",), reflections=False, transparency=False
        )
        self.renderer: wc.Renderer | None = None

    def release(self) -> None:
        self.renderer = None

    def prepare(self, wanted: Wanted) -> None:
        self.wanted = wanted
        cameras = [
            wc.Camera(
                name,
                width=self.problem.width,
                height=self.problem.height,
                outputs=wanted.outputs,
                shadows=wanted.shadows,
                background=(0.0, 0.0, 0.0),
            )
            for name in self.problem.cameras
        ]
        self.renderer = wc.Renderer(self.scene, cameras)

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
        return image[..., 0] if image.shape[-1] == 1 else image

    def _renderer(self) -> wc.Renderer:
        if self.renderer is None:
            raise RuntimeError("prepare was not called")
        return self.renderer


def create(problem: Problem) -> Peer:
    """Through the simulator that the case is about."""
    if not problem.case.newton:
        return WarpcamPeer(problem)
    from warpcam.benchmarks.peers.ours_newton import WarpcamOnNewton  # only where Newton is installed

    return WarpcamOnNewton(problem)
