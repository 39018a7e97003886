"""warpcam looking at a Newton model."""

import mujoco
import numpy as np
from warpcam.benchmarks.cases import Wanted
from warpcam.benchmarks.compare import Images
from warpcam.benchmarks.peers.newton_worlds import NewtonWorlds
from warpcam.benchmarks.problem import Problem

import warpcam as wc


class WarpcamOnNewton:
    """The same model and state as Newton's own camera gets, through `from_newton`."""

    variants: tuple[str, ...] = ("",)

    def __init__(self, problem: Problem) -> None:
        self.problem, self.worlds = problem, NewtonWorlds(problem)
        self.scene = wc.from_newton(
            self.worlds.model, self.worlds.state, lights=lights_of(problem), ambient=ambient_of(problem.mjm)
        )
        self.lacks: tuple[str, ...] = ("the scene's own textures: plain colours stand in for them",)
        self.renderer: wc.Renderer | None = None
        self.place(0)

    def release(self) -> None:
        self.renderer = None

    def prepare(self, wanted: Wanted) -> None:
        self.wanted, poses, mjm = wanted, self.problem.poses[0], self.problem.mjm
        cameras = []
        for name, index in zip(self.problem.cameras, self.problem.camera_ids, strict=True):
            quaternions = np.empty((self.problem.worlds, 4))
            for world, matrix in enumerate(poses["cam_xmat"].numpy()[:, index].reshape(-1, 9).astype(np.float64)):
                mujoco.mju_mat2Quat(quaternions[world], matrix)
            cameras.append(
                wc.Camera(
                    name,
                    width=self.problem.width,
                    height=self.problem.height,
                    outputs=wanted.outputs,
                    shadows=wanted.shadows,
                    background=(0.0, 0.0, 0.0),
                    lens=wc.Pinhole(fovy=float(mjm.cam_fovy[index])),
                    position=poses["cam_xpos"].numpy()[:, index],
                    rotation=quaternions,
                )
            )
        self.renderer = wc.Renderer(self.scene, cameras)

    def place(self, index: int) -> None:
        self.worlds.place(index)

    def frame(self, variant: str) -> None:
        self._renderer().render()

    def images(self, worlds: int) -> list[Images]:
        return [
            {name: self._image(camera, name)[:worlds] for name in self.wanted.outputs}
            for camera in self.problem.cameras
        ]

    def _image(self, camera: str, output: str) -> np.ndarray:
        image: np.ndarray = self._renderer().array(camera, output).numpy()
        image = image[..., 0] if image.shape[-1] == 1 else image
        return self.worlds.ids(image) if output == "segmentation" else image

    def _renderer(self) -> wc.Renderer:
        if self.renderer is None:
            raise RuntimeError("prepare was not called")
        return self.renderer


def lights_of(problem: Problem) -> list[wc.Light]:
    """The scene's lights, as they are in the first set of poses."""
    mjm, pose = problem.mjm, problem.poses[0]
    directional = mjm.light_type == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    return [
        wc.Light(
            kind="directional" if directional[light] else "spot",
            direction=pose["light_xdir"].numpy()[:, light],
            position=pose["light_xpos"].numpy()[:, light],
            color=mjm.light_diffuse[light],
            cutoff=float(np.clip(mjm.light_cutoff[light], 0.0, 90.0)),
            exponent=float(mjm.light_exponent[light]),
            shadows=bool(mjm.light_castshadow[light]),
        )
        for light in np.flatnonzero(mjm.light_active)
    ]


def ambient_of(mjm: mujoco.MjModel) -> tuple[float, ...]:
    return tuple(mjm.vis.headlight.ambient) if mjm.vis.headlight.active else (0.0, 0.0, 0.0)
