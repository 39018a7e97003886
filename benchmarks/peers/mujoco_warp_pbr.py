"""mujoco_warp_pbr: its real-time tier in software, with MuJoCo's lights, and without tone mapping or mirrors."""

from typing import Any

import mujoco_warp as mjw
import mujoco_warp_pbr as mjpbr

from warpcam.benchmarks.cases import Wanted
from warpcam.benchmarks.peers.mujoco_warp import MujocoWarpPeer


class PbrPeer(MujocoWarpPeer):
    """Renderer on a context of MuJoCo-Warp's, which holds the scene tree and the images."""

    pbr: Any = None

    def release(self) -> None:
        self.context = self.pbr = None

    def prepare(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self.pbr = mjpbr.create_render_context(
            self.problem.mjm,
            use_textures=wanted.textures,
            use_shadows=wanted.shadows,
            use_skybox=False,
            enable_reflections=False,
            light_model=mjpbr.LightModel.MUJOCO,
            tone_mapper=mjpbr.ToneMapper.CLAMP,
            **self.options(),
        )
        self.context = self.pbr.base

    def frame(self, variant: str) -> None:
        mjw.refit_bvh(self.problem.m, self.problem.d, self.context)
        mjpbr.render(self.problem.m, self.problem.d, self.pbr)


create = PbrPeer
