"""warpcam itself."""

import numpy as np
from problem import Problem

import warpcam as wc


class WarpcamPeer:
    variants = ("",)

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        cameras = [
            wc.Camera(name, width=problem.width, height=problem.height, outputs=("depth", "segmentation"))
            for name in problem.cameras
        ]
        self.renderer = wc.Renderer(wc.from_mujoco_warp(problem.mjm, problem.m, problem.d), cameras)

    def pull_poses(self) -> None:
        pass

    def frame(self, variant: str) -> None:
        self.renderer.render()

    def images(self, worlds: int) -> list[tuple[np.ndarray, np.ndarray]]:
        shape = (-1, self.problem.height, self.problem.width)
        return [
            tuple(self.renderer.array(name, out).numpy().reshape(shape)[:worlds] for out in ("depth", "segmentation"))
            for name in self.problem.cameras
        ]


create = WarpcamPeer
