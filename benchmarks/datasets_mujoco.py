"""The loop of ``warpcam dataset --writer coco`` with ``mujoco.Renderer``: ``python -m warpcam.benchmarks.datasets``.

Poses, distractors and cameras are those of the same plan. Each sample takes a frame of colours and one of segmentation,
and what is visible is labelled, without amodal boxes; the labels and files are written by the same writer in as many
threads. The images are not the same: lights and fields of view stay as the scene has them.
"""

import dataclasses
import json
import sys
import tempfile
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp

from warpcam.benchmarks.datasets import RECIPES, pixels
from warpcam.core.rotations import rotation_matrices
from warpcam.datasets.generate import Plan, read_recipes
from warpcam.datasets.generate.cameras import shell_poses
from warpcam.datasets.generate.frames import Frame, Instance
from warpcam.datasets.generate.mujoco_scene import MujocoScene
from warpcam.datasets.generate.run import QUEUED, encoders
from warpcam.datasets.writers.coco import CocoWriter
from warpcam.datasets.writers.writer import ShardLayout

NOTHING = np.zeros(3)


class Loop:
    """A model, its renderer, and the writer."""

    def __init__(self, plan: Plan, folder: Path):
        self._plan = plan
        self._scene = MujocoScene(plan, wp.get_device("cpu"))
        self._host = self._scene.host
        self._host.vis.global_.offwidth, self._host.vis.global_.offheight = plan.width, plan.height
        self._data = mujoco.MjData(self._host)
        self._names = self._scene.names("body")
        self._renderer = mujoco.Renderer(self._host, plan.height, plan.width)
        folder.mkdir()
        self.writer = CocoWriter(
            ShardLayout(
                folder=folder, index=0, frames=plan.count, first=0, cameras=("orbit",),
                classes=tuple(self._names.values()), keypoint_names=((),) * len(self._names), models=(),
                width=plan.width, height=plan.height, image_format=plan.image_format, quality=plan.quality,
                options={"min_pixels": 1},
            )
        )  # fmt: skip
        assert plan.recipes.cameras is not None and plan.recipes.cameras[0][1].shell is not None
        self._shell = plan.recipes.cameras[0][1].shell

    def frame(self, sample: int) -> Frame:
        """Draw a sample."""
        host, data = self._host, self._data
        joints, positions, rotations = self._scene.states([sample])
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = joints[0], positions[0], rotations[0]
        host.geom_rgba[self._scene._pool_geoms] = self._scene._pool.colors(sample)
        mujoco.mj_forward(host, data)
        self._renderer.disable_segmentation_rendering()
        self._renderer.update_scene(data)
        self._place_camera(sample)
        colors = self._renderer.render()
        self._renderer.enable_segmentation_rendering()
        shown = self._renderer.render()
        geoms = np.where(shown[..., 1] == int(mujoco.mjtObj.mjOBJ_GEOM), shown[..., 0], -1)
        ids = np.append(host.geom_bodyid, -1)[geoms].astype(np.int32)
        return self._labelled(sample, colors, ids)

    def _place_camera(self, sample: int) -> None:
        position, rotation = shell_poses(self._plan, "orbit", self._shell, NOTHING, [sample])
        axes = rotation_matrices(rotation.astype(np.float64))[0]
        for camera in self._renderer.scene.camera:
            camera.pos, camera.forward, camera.up = position[0], -axes[:, 2], axes[:, 1]

    def _labelled(self, sample: int, colors: np.ndarray, ids: np.ndarray) -> Frame:
        instances = []
        for category, (body, name) in enumerate(self._names.items()):
            rows, columns = np.nonzero(ids == body)
            box = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1) if len(rows) else (0, 0, 0, 0)
            bounds: Any = tuple(map(int, box))
            instances.append(
                Instance(
                    id=body, name=name, category=category, model=-1, visible_box=bounds, visible_pixels=len(rows),
                    amodal_box=bounds, amodal_pixels=len(rows), visibility=1.0, truncated=False, position=NOTHING,
                    rotation=NOTHING, box_center=NOTHING, half_extents=NOTHING, corners=NOTHING, depth=0.0,
                    whole_box=bounds, whole_pixels=len(rows), amodal_mask=None, keypoints=np.zeros((0, 3)),
                )
            )  # fmt: skip
        return Frame(
            sample=sample, camera="orbit", number=sample, stem=f"{sample:08d}", colors=colors, jpeg=None,
            depth=NOTHING, depth_counts=NOTHING, ids=ids, intrinsics=None, camera_position=NOTHING,
            camera_rotation=np.eye(3), instances=tuple(instances), classes=tuple(self._names.values()),
            keypoint_names=((),) * len(self._names),
        )  # fmt: skip


def rate(plan: Plan, threads: int) -> dict[str, Any]:
    """Images a second, after the first ones."""
    loop, drawn = Loop(plan, Path(plan.out)), 0.0
    for sample in range(5):
        loop.frame(sample)
    start = time.perf_counter()
    with ThreadPoolExecutor(threads) as pool:
        queue: deque[Future[Any]] = deque()
        for sample in range(plan.count):
            begun = time.perf_counter()
            frame = loop.frame(sample)
            drawn += time.perf_counter() - begun
            queue.append(pool.submit(loop.writer.encode, frame))
            while len(queue) > QUEUED * threads:
                loop.writer.append(queue.popleft().result())
        for future in queue:
            loop.writer.append(future.result())
    loop.writer.close()
    seconds = time.perf_counter() - start
    return {"count": plan.count, "images_per_s": plan.count / seconds, "draw_ms": 1e3 * drawn / plan.count}


def main() -> None:
    scene, out, count, size, image_format = sys.argv[1:]
    width, height = pixels(size)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "recipes.yaml").write_text(RECIPES)
        recipes = read_recipes(Path(folder) / "recipes.yaml")
    plan = Plan(scene, out, "coco", int(count), width=width, height=height, recipes=recipes, worlds=1, device="cpu")
    plan = dataclasses.replace(plan, image_format=image_format)
    print(json.dumps(rate(plan, encoders())))


if __name__ == "__main__":
    main()
