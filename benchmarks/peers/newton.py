"""Newton's SensorCamera, in both its render orders; the faster counts."""

from typing import Any

import mujoco
import numpy as np
import warp as wp
from newton.sensors import SensorCamera

from warpcam.benchmarks.cases import Wanted
from warpcam.benchmarks.compare import Images
from warpcam.benchmarks.peers.newton_model import light_scene
from warpcam.benchmarks.peers.newton_worlds import MISSED, NewtonWorlds
from warpcam.benchmarks.problem import POSE_SETS, Problem


class NewtonPeer:
    """Renderer with its own poses: each set is converted to its own form beforehand, and `place` copies that."""

    variants: tuple[str, ...] = ("TILED 8x8", "PIXEL_PRIORITY")
    on_host = False
    told_memory_mb: float | None = None

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.worlds = NewtonWorlds(problem)
        self.built, self.model, self.state = self.worlds.built, self.worlds.model, self.worlds.state
        self.lacks: tuple[str, ...] = ()
        self.sensor: Any = None
        # Views that share a lens are rendered by one call.
        fovy = problem.mjm.cam_fovy[problem.camera_ids]
        self.batches = [Batch(problem, np.flatnonzero(fovy == value), float(value)) for value in np.unique(fovy)]
        self.place(0)

    def release(self) -> None:
        self.sensor = None
        for batch in self.batches:
            batch.images = {}

    def prepare(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self.sensor = SensorCamera(self.model, load_textures=wanted.textures)
        self.lacks = light_scene(self.sensor, self.problem) if "rgb" in wanted.outputs else ()
        if wanted.textures:
            self.lacks += self.built.lacks
            if len(self.built.checkered):
                self.sensor.assign_checkerboard_material(shape_indices=self.built.checkered)
        shown = {"enable_textures": wanted.textures, "enable_shadows": wanted.shadows}
        order = SensorCamera.RenderOrder
        self.configs = {
            "TILED 8x8": SensorCamera.RenderConfig(render_order=order.TILED, tile_width=8, tile_height=8, **shown),
            "PIXEL_PRIORITY": SensorCamera.RenderConfig(render_order=order.PIXEL_PRIORITY, **shown),
        }
        for batch in self.batches:
            batch.allocate(self.sensor, wanted)

    def place(self, index: int) -> None:
        self.worlds.place(index)
        for batch in self.batches:
            wp.copy(batch.transforms, batch.poses[index])

    def frame(self, variant: str) -> None:
        self.model.bvh_refit_shapes(self.state)
        for batch in self.batches:
            self.sensor.update(
                self.state,
                batch.transforms,
                batch.rays,
                forward_depth_image=batch.images.get("depth"),
                shape_index_image=batch.images.get("segmentation"),
                color_image=batch.images.get("rgb"),
                world_indices=batch.worlds,
                render_config=self.configs[variant],
            )

    def images(self, worlds: int) -> list[Images]:
        found: list[Images] = [{} for _ in self.problem.cameras]
        for batch in self.batches:
            for k, camera in enumerate(batch.cameras):
                views = slice(k * self.problem.worlds, k * self.problem.worlds + worlds)
                raw = {name: image[views].numpy() for name, image in batch.images.items()}
                found[camera] = self.converted(raw)
        return found

    def converted(self, raw: Images) -> Images:
        images: Images = {}
        if "segmentation" in raw:
            images["segmentation"] = self.worlds.ids(raw["segmentation"])
            images["depth"] = np.where(raw["segmentation"] == MISSED, np.inf, raw["depth"])
        elif "depth" in raw:
            images["depth"] = np.where(raw["depth"] == 0.0, np.inf, raw["depth"])
        if "rgb" in raw:
            images["rgb"] = np.ascontiguousarray(raw["rgb"]).view(np.uint8).reshape(*raw["rgb"].shape, 4)[..., :3]
        return images


class Batch:
    """Views of all worlds through cameras with one lens, camera by camera."""

    def __init__(self, problem: Problem, cameras: np.ndarray, fovy: float) -> None:
        self.problem, self.cameras, self.fovy = problem, cameras, fovy
        self.rays: Any = None
        self.worlds = wp.array(np.tile(np.arange(problem.worlds), len(cameras)), dtype=wp.int32)
        self.poses = [self.camera_poses(index) for index in range(POSE_SETS)]
        self.transforms = wp.clone(self.poses[0])
        self.images: dict[str, wp.array] = {}

    def allocate(self, sensor: SensorCamera, wanted: Wanted) -> None:
        makers = {
            "depth": sensor.allocate_image_depth_forward,
            "segmentation": sensor.allocate_image_shape_index,
            "rgb": sensor.allocate_image_color,
        }
        width, height = self.problem.width, self.problem.height
        self.rays = SensorCamera.compute_camera_rays_pinhole(
            width, height, camera_fov=np.radians(self.fovy), device=wp.get_device()
        )
        views = len(self.cameras) * self.problem.worlds
        self.images = {name: makers[name](views, width, height) for name in wanted.outputs}

    def camera_poses(self, index: int) -> wp.array:
        ids = np.asarray(self.problem.camera_ids)[self.cameras]
        poses = self.problem.poses[index]
        position = poses["cam_xpos"].numpy()[:, ids].swapaxes(0, 1).reshape(-1, 3)
        rotation = poses["cam_xmat"].numpy()[:, ids].swapaxes(0, 1).reshape(-1, 9)
        quaternion = np.empty((len(rotation), 4))
        for view, matrix in enumerate(rotation.astype(np.float64)):
            mujoco.mju_mat2Quat(quaternion[view], matrix)
        both = np.concatenate([position, quaternion[:, [1, 2, 3, 0]]], axis=1)
        return wp.array(both.astype(np.float32), dtype=wp.transformf)


create = NewtonPeer
