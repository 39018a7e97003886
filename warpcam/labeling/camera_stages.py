"""Stages that label the images of one camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.plan import launches
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables
from warpcam.labeling import kernels
from warpcam.labeling.camera_labels import CameraLabels
from warpcam.labeling.instances import Instances
from warpcam.render.drawn_cameras import DrawnCamera

RUN = 32  # pixels that a CUDA thread reads
FILLING = 20  # blocks for each multiprocessor that keep it busy
MAX_THREADS = 2**31  # of a launch, and one more


@dataclass(frozen=True, eq=False)
class SharedArrays:
    """What the labels of all cameras have in common.

    Attributes:
        instances: Which there are.
        boxes: ``kernels.Boxes``.
        keys: (row, instance) int32: their ids, ABSENT where a world lacks one.
        keypoints: ``kernels.Keypoints``, without what is a camera's own.
        num_keypoints: How many.
        tolerance: Of keypoints [m].
        amodal: Instances are traced alone.
        masks: Their masks are written.
    """

    instances: Instances
    boxes: Any
    keys: wp.array
    keypoints: Any
    num_keypoints: int
    tolerance: float
    amodal: bool
    masks: bool


class CameraStages:
    """Arrays of one camera's labels, and the stages that write them.

    Attributes:
        labels: Tensors over these arrays.
    """

    def __init__(self, drawn: DrawnCamera, shapes: np.ndarray, ids: wp.array, common: SharedArrays):
        """Allocate the arrays.

        Args:
            drawn: The camera.
            shapes: Those that it sees, ascending.
            ids: Image of the instances' ids, (world, height, width, 1).
            common: What all cameras have.
        """
        self._drawn, self._common, self._ids = drawn, common, ids
        self._worlds, self._count = ids.shape[0], common.keys.shape[1]
        self._device = ids.device
        worlds, count, room = self._worlds, self._count, max(common.num_keypoints, 1)
        self._lens = launches.LENSES[drawn.projection]
        extents = self._extents = kernels.ImageExtents()
        extents.visible = self._zeros((worlds, count, kernels.EXTENT_NUMBERS), wp.int32)
        extents.visible_boxes = self._zeros((worlds, count, 4), wp.int32)
        extents.visible_pixels = self._zeros((worlds, count), wp.int32)
        extents.amodal_boxes = self._zeros((worlds, count, 4), wp.int32)
        extents.amodal_pixels = self._zeros((worlds, count), wp.int32)
        extents.visibility = self._zeros((worlds, count), wp.float32)
        extents.truncated = self._zeros((worlds, count), wp.uint8)
        if common.amodal:
            extents.amodal = self._zeros((worlds, count, kernels.EXTENT_NUMBERS), wp.int32)
        else:
            extents.amodal_boxes.fill_(-1)
            extents.amodal_pixels.fill_(-1)
            extents.visibility.fill_(np.nan)
        poses = self._poses = kernels.Poses()
        poses.positions, poses.rotations = self._zeros((worlds, count), wp.vec3), self._zeros((worlds, count), wp.vec4)
        poses.corners = self._zeros((worlds, kernels.CORNERS * count), wp.vec3)
        poses.centers, poses.depths = self._zeros((worlds, count), wp.vec3), self._zeros((worlds, count), wp.float32)
        keypoints = self._keypoints = kernels.Keypoints()
        keypoints.bodies, keypoints.offsets = common.keypoints.bodies, common.keypoints.offsets
        keypoints.projection = self._projection(self._zeros((worlds, room), wp.vec3), starts=True)
        keypoints.depths = self._zeros((worlds, room), wp.float32)
        keypoints.visibility = self._zeros((worlds, room), wp.uint8)
        keypoints.tolerance = common.tolerance
        keypoints.height, keypoints.width = ids.shape[1:3]
        keypoints.shapes = wp.array(shapes, dtype=wp.int32, device=self._device)
        columns, starts = common.instances.members(shapes)
        self._largest = int(np.diff(starts, axis=1).max())  # shapes of an instance
        cover = self._cover = kernels.Cover()
        cover.mask, cover.extents = common.boxes.mask, extents.amodal
        cover.members = members_struct(columns, starts, self._device)
        cover.height, cover.width = ids.shape[1:3]
        if common.masks:
            shape = (worlds, count, cover.height, cover.width)
            if np.prod(shape, dtype=np.int64) >= MAX_THREADS:
                raise WarpcamError(
                    f"labels: masks of {worlds} worlds, {count} instances and {cover.width}x{cover.height} pixels have "
                    "2^31 pixels or more; choose some instances by ids, or draw fewer worlds"
                )
            cover.masks = self._zeros(shape, wp.uint8)
        self._corners, self._centers = self._projection(poses.corners), self._projection(poses.centers)
        self.labels = self._tensors()

    def bind(self, tables: SceneTables) -> list[Stage]:
        """Bind the stages of a frame, after those that write ``boxes``."""
        mask, extents, instances = self._common.boxes.mask, self._extents, self._worlds * self._count
        height, width = self._ids.shape[1:3]
        run = RUN if self._device.is_cuda else width * height
        image = self._ids.reshape((self._worlds, height, width))
        runs = self._worlds * -(-width * height // run)
        stages = [
            self._launch(kernels.clear_extents, instances, [mask, extents]),
            self._launch(kernels.count_visible, runs, [mask, self._common.keys, image, run, extents]),
        ]
        if self._common.masks:
            masks = self._cover.masks
            rows = instances * height
            stages.append(self._launch(kernels.clear_masks, rows, [mask, masks]))
        if self._common.amodal:
            stages.append(self._bind_cover(tables))
        stages += [
            self._launch(kernels.write_extents, instances, [mask, width, height, extents]),
            self._launch(kernels.place_instances, instances, [self._drawn.views, self._common.boxes, self._poses]),
            self._bind_projection(self._corners),
            self._bind_projection(self._centers),
        ]
        return stages + (self._bind_keypoints(tables) if self._common.num_keypoints else [])

    def _bind_cover(self, tables: SceneTables) -> Stage:
        """The stage that traces each instance alone."""
        device, cover = self._device, self._cover
        most = launches.MAX_LISTED if device.is_cuda else launches.MANY_LISTED
        types = launches.scene_types(tables, device, lit=False)
        key = kernels.CoverKey(
            types, self._lens, launches.list_capacity(self._largest, device, most), self._common.masks
        )
        regions = launches.regions_of(cover.width, cover.height, (kernels.REGION, kernels.REGION))
        threads = launches.world_threads(self._count, device) * self._worlds
        wanted = -(-FILLING * device.sm_count // (self._worlds * self._count)) if device.is_cuda else 1
        cover.parts = max(1, min(regions, wanted, (MAX_THREADS - 1) // threads))
        arguments = [tables.shapes, tables.materials, tables.meshes, tables.height_fields, self._drawn.views, cover]
        return self._launch(kernels.cover_kernel(key), threads * cover.parts, arguments, launches.THREADS)

    def _bind_projection(self, projection: Any) -> Stage:
        return self._launch(
            kernels.projection_kernel(self._lens), projection.points.size, [self._drawn.views, projection]
        )

    def _bind_keypoints(self, tables: SceneTables) -> list[Stage]:
        """Stages that project keypoints and trace the rays to them."""
        views, keypoints = self._drawn.views, self._keypoints
        count = keypoints.depths.size
        types = launches.scene_types(tables, self._device, lit=False)
        kernel = kernels.keypoint_kernel(types, self._drawn.projection in launches.TABLES)
        arguments = [tables.shapes, tables.materials, tables.meshes, tables.height_fields, views, keypoints]
        return [
            self._launch(kernels.place_keypoints, count, [views, self._common.boxes, keypoints]),
            self._bind_projection(keypoints.projection),
            self._launch(kernel, launches.world_threads(count, self._device, kernels.LANES), arguments),
        ]

    def _launch(self, kernel: wp.Kernel, dim: int, arguments: list[Any], block_dim: int | None = None) -> Stage:
        if dim >= MAX_THREADS:
            raise WarpcamError(
                f"labels: {self._count} instances in {self._worlds} worlds need {dim} threads, below 2^31 are allowed; "
                "choose some by ids"
            )
        more = {} if block_dim is None else {"block_dim": block_dim}
        return bind_launch(kernel, dim, arguments, self._device, **more)

    def _projection(self, points: wp.array, starts: bool = False) -> Any:
        projection = kernels.Projection()
        projection.mask, projection.points = self._common.boxes.mask, points
        projection.pixels = self._zeros(points.shape, wp.vec2)
        projection.starts = self._zeros(points.shape if starts else (0, 0), wp.vec3)
        return projection

    def _tensors(self) -> CameraLabels:
        extents, poses, keypoints, boxes = self._extents, self._poses, self._keypoints, self._common.boxes
        worlds, count, points = self._worlds, self._count, self._common.num_keypoints

        def tensor(array: wp.array, *shape: int) -> torch_interop.Tensor:
            """The array's numbers in a shape."""
            return torch_interop.to_torch(shared(array, shape, wp.float32))

        return CameraLabels(
            visible_boxes=torch_interop.to_torch(extents.visible_boxes),
            visible_pixels=torch_interop.to_torch(extents.visible_pixels),
            amodal_boxes=torch_interop.to_torch(extents.amodal_boxes),
            amodal_pixels=torch_interop.to_torch(extents.amodal_pixels),
            visibility=torch_interop.to_torch(extents.visibility),
            truncated=torch_interop.to_torch(extents.truncated),
            positions=tensor(poses.positions, worlds, count, 3),
            rotations=tensor(poses.rotations, worlds, count, 4),
            box_centers=tensor(boxes.centers, worlds, count, 3),
            half_extents=tensor(boxes.half_extents, worlds, count, 3),
            corners=tensor(self._corners.pixels, worlds, count, kernels.CORNERS, 2),
            centers=tensor(self._centers.pixels, worlds, count, 2),
            depths=torch_interop.to_torch(poses.depths),
            keypoints=tensor(keypoints.projection.pixels, worlds, keypoints.depths.shape[1], 2)[:, :points],
            keypoint_depths=torch_interop.to_torch(keypoints.depths)[:, :points],
            keypoint_visibility=torch_interop.to_torch(keypoints.visibility)[:, :points],
            amodal_masks=torch_interop.to_torch(self._cover.masks) if self._common.masks else None,
        )

    def _zeros(self, shape: Any, dtype: Any) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self._device)


def members_struct(columns: np.ndarray, starts: np.ndarray, device: wp.Device) -> Any:
    """``kernels.Members`` of what ``Instances.members`` returns."""
    members = kernels.Members()
    members.columns = wp.array(columns, dtype=wp.int32, device=device)
    members.starts = wp.array(starts, dtype=wp.int32, device=device)
    return members
