"""Labels of what a renderer has drawn, of all worlds and cameras at once."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.memory_errors import memory_told
from warpcam.core.world_mask import Selection
from warpcam.kernels.plan import launches
from warpcam.kernels.runtime.compile import building
from warpcam.kernels.runtime.launch import Stage, bind_launch, prepare
from warpcam.kernels.runtime.streams import nonblocking_stream, preserve_cuda_context
from warpcam.kernels.scene_tables import SceneTables
from warpcam.labeling import kernels
from warpcam.labeling.camera_labels import CameraLabels
from warpcam.labeling.camera_stages import CameraStages, SharedArrays, members_struct
from warpcam.labeling.instances import Grouping, Instances, find_instances
from warpcam.labeling.keypoints import find_keypoints
from warpcam.labeling.mesh_boxes import fit_meshes
from warpcam.render.drawn_cameras import DrawnCamera, drawn_cameras
from warpcam.render.excluded_bodies import kept_shapes
from warpcam.render.renderer import Renderer
from warpcam.scene.scene import Scene


class Labels:
    """Labels of a renderer's images; made by ``labels``.

    Attributes:
        ids: int32 tensor (world, instance): the ids of the instances in each world, as the image of ids shows them,
            ascending; -1 where a world has fewer than others.
        output: Name of that image.
        keypoints: Names of the keypoints.
        cameras: What ``read`` returns.
    """

    def __init__(
        self,
        renderer: Renderer,
        cameras: Sequence[str | int] | None,
        instances: Instances,
        keypoints: Any,
        amodal: bool,
        masks: bool,
        tolerance: float,
    ):
        scene, drawn = drawn_cameras(renderer, "labels")
        self._renderer, self._scene, self._device = renderer, scene, scene.device
        self._selection, self._instances = Selection(scene.num_worlds, scene.device), instances
        table = find_keypoints(scene, keypoints)
        chosen = _chosen(cameras, drawn)
        images = {key: _ids_of(renderer, key, drawn[key], instances.output) for key in chosen}
        ids = np.broadcast_to(instances.ids, (scene.num_worlds, instances.ids.shape[1]))
        self.output, self.keypoints = instances.output, table.names
        self.ids = torch_interop.to_torch(wp.array(ids, dtype=wp.int32, device=scene.device))
        places = kernels.Keypoints()
        places.bodies = wp.array(table.bodies, dtype=wp.int32, device=scene.device)
        places.offsets = wp.array(table.offsets, dtype=wp.vec3, device=scene.device)
        keys = np.where(instances.ids < 0, kernels.ABSENT, instances.ids)
        common = SharedArrays(
            instances=instances,
            boxes=self._make_boxes(scene.tables()),
            keys=wp.array(keys, dtype=wp.int32, device=scene.device),
            keypoints=places,
            num_keypoints=len(table.names),
            tolerance=tolerance,
            amodal=amodal,
            masks=masks,
        )
        self._boxes, self._walks = common.boxes, amodal or bool(table.names)
        self._cameras = {
            key: CameraStages(drawn[key], kept_shapes(drawn[key].camera, scene), images[key], common) for key in chosen
        }
        self.cameras: dict[str | int, CameraLabels] = {key: each.labels for key, each in self._cameras.items()}
        with building:
            self._bind(scene.tables())

    def read(self, worlds: Any = None) -> Mapping[str | int, CameraLabels]:
        """Label the images of the last ``render()``.

        Poses are not fetched anew, so call it before the simulation goes on.

        On CUDA the work is queued, in order with what torch's and Warp's current streams hold, and nothing waits for
        it. Inside a capture it becomes part of the captured graph, for whose replays the labels must be kept alive.

        Args:
            worlds: Which worlds, as ``Renderer.render`` takes them; the others' labels stay. None is all.

        Returns:
            ``cameras``: labels by camera.
        """
        with self._renderer.lock, torch_interop.in_order(self._device) as capturing:
            if worlds is None:
                self._selection.mask.fill_(1)
            else:
                self._selection.select(worlds, capturing, "Labels.read")
            tables = self._scene.tables()
            if tables is not self._tables:
                with building:
                    self._bind(tables)
            self._run(capturing)
        return self.cameras

    def __reduce__(self) -> Any:
        raise WarpcamError("Labels: it cannot be copied or pickled, as it holds memory of a device; make another one")

    def _make_boxes(self, tables: SceneTables) -> Any:
        instances, device, boxes = self._instances, self._device, kernels.Boxes()
        shape = (self._scene.num_worlds, instances.ids.shape[1])
        boxes.mask = self._selection.mask
        boxes.members = members_struct(*instances.members(tables.shapes.drawn.numpy()), device)
        boxes.meshes = fit_meshes(self._scene, instances)
        boxes.frame_bodies = wp.array(instances.frame_bodies, dtype=wp.int32, device=device)
        boxes.frame_shapes = wp.array(instances.frame_shapes, dtype=wp.int32, device=device)
        boxes.positions, boxes.centers, boxes.half_extents = (
            wp.zeros(shape, dtype=wp.vec3, device=device) for _ in range(3)
        )
        boxes.rotations = wp.zeros(shape, dtype=wp.mat33, device=device)
        return boxes

    def _bind(self, tables: SceneTables) -> None:
        """Bind every stage to the tables' arrays, and compile the kernels."""
        scene, boxes = self._scene, self._boxes
        boxes.body_positions, boxes.body_rotations = scene.array("body_positions"), scene.array("body_rotations")
        types = launches.scene_types(tables, self._device, lit=False)
        arguments = [tables.shapes, tables.materials, tables.meshes, tables.height_fields, boxes]
        self._stages: list[Stage] = [
            *(scene.tree_stages() if self._walks else ()),
            bind_launch(kernels.box_kernel(types), boxes.half_extents.size, arguments, self._device),
            *(stage for each in self._cameras.values() for stage in each.bind(tables)),
        ]
        self._tables, self._graphs = tables, list[wp.Graph]()
        prepare(self._stages)

    def _run(self, capturing: bool) -> None:
        if not capturing and self._graphs:
            wp.capture_launch(self._graphs[0], stream=self._device.stream)
            return
        for stage in self._stages:  # the first time by themselves: the driver may still have to load the kernels
            stage.launch()
        if capturing or not self._device.is_cuda:
            return
        stream = nonblocking_stream(self._device)
        with wp.ScopedCapture(stream=stream) as capture:
            for stage in self._stages:
                stage.launch(stream)
        self._graphs.append(capture.graph)


@preserve_cuda_context()
@memory_told("labels")
def labels(
    renderer: Renderer,
    cameras: Sequence[str | int] | None = None,
    *,
    by: Grouping = "body",
    ids: Sequence[int] | None = None,
    amodal: bool = True,
    masks: bool = False,
    keypoints: Mapping[str, tuple[str | int | None, Sequence[float]]] | None = None,
    tolerance: float = 0.01,
) -> Labels:
    """Labels of what a renderer draws: boxes, sizes of masks, visibility, poses and keypoints, on the device.

    ``read`` labels the images of the last ``render()``: call that first. Making labels allocates all memory and
    compiles all kernels; ``read`` does neither, waits for nothing, and may be part of a CUDA graph.

    Args:
        renderer: Its cameras need the output with the instances' ids: see ``by``.
        cameras: Names of the cameras to label; None is all.
        by: What an instance is: "body" (output ``bodies``), "shape" (``segmentation``), "instance" (``instances``) or
            "semantic" (``semantics``, all shapes of a label together). The frame of a body or shape is its own; that of
            another instance is its body's if all of it is on one body, else the world's.
        ids: Those to label, as the output has them; None is all but -1, and 0 of ``semantics``.
        amodal: Trace each instance alone for its amodal box and pixels, its visibility and truncation.
        masks: Keep the amodal masks, a byte for each pixel of each instance in each world.
        keypoints: Places to find in images, by name: a body, by name or index, or None for the world, and a place in
            its frame [m]. ``site_keypoints`` gives those of a MuJoCo model's sites.
        tolerance: By how much a surface may be nearer than a keypoint that it does not hide [m], at least 0: keypoints
            lie on or a little below surfaces.

    Raises:
        WarpcamError: An argument is none of these, a camera lacks an output, or the scene has Gaussian splats, which
            cannot be traced alone.
    """
    if not isinstance(renderer, Renderer):
        raise WarpcamError(f"labels: renderer must be a Renderer, got {type(renderer).__name__}")
    if not isinstance(amodal, bool | np.bool_):
        raise WarpcamError(f"labels: amodal must be True or False, got {amodal!r}")
    if not isinstance(masks, bool | np.bool_) or (masks and not amodal):
        allowed = "True or False" if amodal else "False where amodal is"
        raise WarpcamError(f"labels: masks must be {allowed}, got {masks!r}")
    is_number = isinstance(tolerance, int | float | np.number) and not isinstance(tolerance, bool)
    if not is_number or not 0.0 <= tolerance < math.inf:
        raise WarpcamError(f"labels: tolerance must be a finite number of at least 0 [m], got {tolerance!r}")
    scene: Scene = renderer.scene
    torch_interop.require_no_capture(scene.device, "labels")
    if scene.tables().splats is not None:
        raise WarpcamError("labels: the scene has Gaussian splats, of which there are no labels")
    instances = find_instances(scene, by, ids)
    return Labels(renderer, cameras, instances, keypoints, bool(amodal), bool(masks), float(tolerance))


def _chosen(cameras: Sequence[str | int] | None, drawn: Mapping[str | int, DrawnCamera]) -> list[str | int]:
    if cameras is None:
        return list(drawn)
    known = ", ".join(map(repr, drawn))
    if isinstance(cameras, str) or not isinstance(cameras, Sequence) or not cameras:
        raise WarpcamError(f"labels: cameras must be names of some of {known}, or None for all, got {cameras!r}")
    for key in cameras:
        if key not in tuple(drawn):
            raise WarpcamError(f"labels: cameras has {key!r}, the renderer has {known}")
        if cameras.count(key) > 1:
            raise WarpcamError(f"labels: cameras has {key!r} more than once")
    return list(cameras)


def _ids_of(renderer: Renderer, key: str | int, drawn: DrawnCamera, output: str) -> wp.array:
    """Image of a camera's ids."""
    if output not in drawn.images:
        raise WarpcamError(f"labels: camera {key!r} needs the output {output!r}, it has {', '.join(drawn.images)}")
    return renderer.rendered(key, output)
