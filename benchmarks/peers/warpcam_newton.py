"""warpcam looking at a Newton model."""

from typing import Any

import mujoco
import numpy as np

import warpcam as wc
from warpcam.benchmarks.peers.newton_worlds import NewtonWorlds
from warpcam.benchmarks.peers.warpcam_renderer import WarpcamPeer
from warpcam.benchmarks.problem import Problem


class WarpcamOnNewton(WarpcamPeer):
    """warpcam on the model and state that Newton's own camera gets, through `from_newton`."""

    lacks: tuple[str, ...] = ("the scene's own textures: plain colours stand in for them",)

    def __init__(self, problem: Problem) -> None:
        self.worlds = NewtonWorlds(problem)
        super().__init__(problem)
        self.place(0)

    def _scene(self, *, reflections: bool, transparency: bool) -> wc.Scene:
        if reflections:
            raise wc.WarpcamError("reflections: materials of Newton's have none that planes mirror")
        return wc.from_newton(
            self.worlds.model,
            self.worlds.state,
            lights=lights_of(self.problem),
            ambient=ambient_of(self.problem.mjm),
            transparency=transparency,
        )

    def _own(self, index: int) -> dict[str, Any]:
        poses = self.problem.poses[0]
        matrices = poses["cam_xmat"].numpy()[:, index].reshape(-1, 9).astype(np.float64)
        quaternions = np.empty((len(matrices), 4))
        for quaternion, matrix in zip(quaternions, matrices, strict=True):
            mujoco.mju_mat2Quat(quaternion, matrix)
        return {
            "lens": wc.Pinhole(fovy=float(self.problem.mjm.cam_fovy[index])),
            "position": poses["cam_xpos"].numpy()[:, index],
            "rotation": quaternions,
        }

    def place(self, index: int) -> None:
        self.worlds.place(index)

    def _image(self, camera: str, output: str) -> np.ndarray:
        image = super()._image(camera, output)
        return self.worlds.ids(image) if output == "segmentation" else image


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
