"""MuJoCo-Warp's own renderer, with the settings it recommends."""

from typing import Any

import mujoco_warp as mjw
import numpy as np
import warp as wp

from warpcam.benchmarks.cases import Wanted
from warpcam.benchmarks.compare import Images
from warpcam.benchmarks.problem import Problem


class MujocoWarpPeer:
    """Refits its scene tree and renders, both from MuJoCo-Warp's data as it is."""

    variants: tuple[str, ...] = ("",)
    lacks: tuple[str, ...] = ()
    on_host = False
    told_memory_mb: float | None = None

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.context: Any = None

    def release(self) -> None:
        self.context = None

    def prepare(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self.context = mjw.create_render_context(
            self.problem.mjm,
            use_textures=wanted.textures,
            use_shadows=wanted.shadows,
            shadow_light_fraction=0.0,
            **self.options(),
        )

    def options(self) -> dict[str, object]:
        """Return the options that this renderer shares with those built upon it."""
        return {
            "nworld": self.problem.worlds,
            "cam_res": (self.problem.width, self.problem.height),
            "cam_active": list(self.problem.cameras),
            "render_rgb": "rgb" in self.wanted.outputs,
            "render_depth": "depth" in self.wanted.outputs,
            "render_seg": "segmentation" in self.wanted.outputs,
        }

    def place(self, index: int) -> None:
        self.problem.place(index)

    def frame(self, variant: str) -> None:
        mjw.refit_bvh(self.problem.m, self.problem.d, self.context)
        mjw.render(self.problem.m, self.problem.d, self.context)

    def images(self, worlds: int) -> list[Images]:
        context, size = self.context, (worlds, self.problem.height, self.problem.width)
        by_id = np.argsort(np.argsort(self.problem.camera_ids))  # a context keeps its cameras in the model's order
        found = []
        for camera in (int(index) for index in by_id):
            images: Images = {}
            if "segmentation" in self.wanted.outputs:
                ids = wp.zeros(size, dtype=wp.vec2i)
                mjw.get_segmentation(context, camera, ids)
                images["segmentation"] = self.problem.one_id(*np.moveaxis(ids.numpy(), -1, 0))
            if "depth" in self.wanted.outputs:
                # The getter clamps depth into [0, 1]: the buffer itself holds metres, camera after camera.
                start, pixels = int(context.depth_adr.numpy()[camera]), size[1] * size[2]
                depth = context.depth_data[:worlds].numpy()[:, start : start + pixels].reshape(size)
                missed = images["segmentation"] < 0 if "segmentation" in images else depth <= 0.0
                images["depth"] = np.where(missed, np.inf, depth)
            if "rgb" in self.wanted.outputs:
                rgb = wp.zeros(size, dtype=wp.vec3)
                mjw.get_rgb(context, camera, rgb)
                images["rgb"] = np.rint(255.0 * rgb.numpy()).astype(np.uint8)
            found.append(images)
        return found


create = MujocoWarpPeer
