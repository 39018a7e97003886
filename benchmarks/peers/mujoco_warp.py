"""MuJoCo-Warp's own renderer, with the settings it recommends: depth and segmentation, everything else off."""

import mujoco_warp as mjw
import numpy as np
from problem import Problem


class MujocoWarpPeer:
    variants = ("",)

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.context = mjw.create_render_context(
            problem.mjm,
            nworld=problem.worlds,
            cam_res=(problem.width, problem.height),
            render_rgb=False,
            render_depth=True,
            render_seg=True,
            use_textures=False,
            use_shadows=False,
            cam_active=list(problem.cameras),
        )

    def pull_poses(self) -> None:
        pass

    def frame(self, variant: str) -> None:
        mjw.refit_bvh(self.problem.m, self.problem.d, self.context)
        mjw.render(self.problem.m, self.problem.d, self.context)

    def images(self, worlds: int) -> list[tuple[np.ndarray, np.ndarray]]:
        # The getters clamp depth into [0, 1]: the buffers themselves hold metres, camera after camera by id.
        context, shape = self.context, (-1, self.problem.height, self.problem.width)
        pixels = self.problem.height * self.problem.width
        starts = zip(context.depth_adr.numpy(), context.seg_adr.numpy(), strict=True)
        by_camera = dict(zip(sorted(self.problem.camera_ids), starts, strict=True))
        all_depth, all_ids = context.depth_data[:worlds].numpy(), context.seg_data[:worlds].numpy()
        images = []
        for camera in self.problem.camera_ids:
            depth_start, ids_start = by_camera[camera]
            depth = all_depth[:, depth_start : depth_start + pixels].reshape(shape)
            ids = all_ids[:, ids_start : ids_start + pixels, 0].reshape(shape)
            images.append((np.where(ids < 0, np.inf, depth), ids))
        return images


create = MujocoWarpPeer
