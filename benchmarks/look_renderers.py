"""Renderers of ``look_speed`` for one problem: looks of warpcam, tiers of mujoco_warp_pbr, and Mitsuba 3."""

import warnings
from typing import Any, Literal

import mujoco_warp as mjw
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.benchmarks import mitsuba_scene
from warpcam.benchmarks.problem import Problem
from warpcam.core.errors import WarpcamError

DEPTH = 4  # surfaces that reflect a path at most


class Warpcam:
    """A look of warpcam: ``"pbr"`` with shadows, or ``"path"``."""

    on_host = False

    def __init__(self, problem: Problem, look: Literal["pbr", "path"], samples: int) -> None:
        scene = wc.from_mujoco_warp(problem.mjm, problem.m, problem.d, draw=("geoms",))
        real_time: dict[str, Any] = {"shadows": True} if look == "pbr" else {}
        self.name = problem.cameras[0]
        camera = wc.Camera(self.name, width=problem.width, height=problem.height, outputs=("rgb",), **real_time)
        path = wc.PathOptions(samples=samples, bounces=DEPTH) if look == "path" else None
        self.renderer = wc.Renderer(scene, [camera], look=look, path=path)

    def frame(self) -> None:
        self.renderer.render()

    def image(self) -> np.ndarray:
        return np.array(self.renderer.array(self.name, "rgb").numpy()[0])


class MujocoWarpPbr:
    """A tier of mujoco_warp_pbr with lights as warpcam has them: the skybox shines, no tone mapping."""

    on_host = False

    def __init__(self, problem: Problem, tier: str, samples: int, traversal: str) -> None:
        import mujoco_warp_pbr as mjpbr

        self._render, self._get_rgb, self.problem = mjpbr.render, mjpbr.get_rgb, problem
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            self.context = mjpbr.create_render_context(
                problem.mjm,
                nworld=problem.worlds,
                cam_res=(problem.width, problem.height),
                cam_active=list(problem.cameras),
                render_rgb=True,
                render_depth=False,
                render_seg=False,
                tone_mapper=mjpbr.ToneMapper.CLAMP,
                tier=mjpbr.Tier[tier],
                path_samples=samples,
                max_depth=DEPTH,
                traversal=traversal,
            )
        if traversal == "optix" and told:  # it would go on in software
            raise WarpcamError("; ".join(str(warning.message) for warning in told))

    def frame(self) -> None:
        mjw.refit_bvh(self.problem.m, self.problem.d, self.context.base)
        self._render(self.problem.m, self.problem.d, self.context)

    def image(self) -> np.ndarray:
        rgb = wp.zeros((self.problem.worlds, self.problem.height, self.problem.width), dtype=wp.vec3)
        self._get_rgb(self.context, 0, rgb)
        return np.rint(255.0 * np.clip(rgb.numpy()[0], 0.0, 1.0)).astype(np.uint8)


class Mitsuba:
    """Mitsuba 3, which draws the first world alone, in the pose of the first set: its scene does not move."""

    on_host = True

    def __init__(self, problem: Problem, samples: int) -> None:
        self._loaded = mitsuba_scene.load(problem, samples, DEPTH)

    def frame(self) -> None:
        self._loaded.render()

    def image(self) -> np.ndarray:
        return self._loaded.picture()


def create(name: str, problem: Problem, samples: int) -> Warpcam | MujocoWarpPbr | Mitsuba:
    """The renderer of a name of ``look_speed.RENDERERS``."""
    if name == "mitsuba":
        return Mitsuba(problem, samples)
    if name in ("warpcam pbr", "warpcam path"):
        return Warpcam(problem, "path" if name.endswith("path") else "pbr", samples)
    tier = "PATH" if name.endswith("path") else "REALTIME"
    return MujocoWarpPbr(problem, tier, samples, "optix" if name.endswith("optix") else "software")
