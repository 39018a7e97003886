"""State kept from frame to frame for ``flow`` and ``flow_valid``."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Projection
from warpcam.kernels.passes import flow, vertex_history
from warpcam.kernels.plan import history as history_plan
from warpcam.kernels.runtime.flatten import flatten
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import View
from warpcam.scene.scene import Scene


def needs_history(camera: Camera) -> bool:
    """Return whether the camera needs the previous frame."""
    return not set(history_plan.OUTPUTS).isdisjoint(camera.outputs)


class CameraHistory:
    """History of one camera: each world's previous frame, and the arrays that the trace needs for it.

    Attributes:
        flow_history: ``FlowHistory``.
        views: View, (world,), of the last frame; not written for listed cameras, whose stage reads them in place.
    """

    def __init__(
        self, camera: Camera, tables: SceneTables, device: wp.Device, images: Mapping[str, wp.array], listed: bool
    ):
        worlds, self._device = tables.num_worlds, device
        self.views = wp.zeros(worlds, dtype=View, device=device)
        self.flow_history = flow.FlowHistory()
        for name in set(history_plan.OUTPUTS) & images.keys():
            setattr(self.flow_history, name, flatten(images[name]))
        kept = worlds * _history_words(camera, tables)
        self.flow_history.first_words = wp.zeros(kept, dtype=wp.uint32, device=device)
        self.flow_history.second_words = wp.zeros(kept, dtype=wp.uint32, device=device)
        parts = worlds * _floor_parts(camera, tables, device)
        self.flow_history.floor_first = wp.zeros(parts, dtype=wp.uint8, device=device)
        self.flow_history.floor_second = wp.zeros(parts, dtype=wp.uint8, device=device)
        rows = 0 if history_plan.composes(tables, device) and not listed else history_plan.motion_rows(tables)
        self.flow_history.motions = wp.zeros((worlds, rows), dtype=wp.vec4, device=device)
        self.flow_history.views_before = self.views
        self.flow_history.columns = tables.num_shapes
        self.flow_history.width, self.flow_history.height = camera.width, camera.height

    def bind(self, tables: SceneTables, views: wp.array, projection: Projection, mask: wp.array, keep: bool) -> Stage:
        """The stage before the trace; with ``keep`` the last of its kind in the frame."""
        return flow.bind_motions(
            tables, views, mask, lens=projection, keep=keep, history=self.flow_history, device=self._device
        )


class ShapeHistory:
    """History that all cameras share: previous poses of shapes and vertices of moving meshes.

    Attributes:
        frame_state: uint8, (world,): what is known of each world's last frame, see ``kernels/passes/views.py``.
        composed_by_trace: The traces, or the stages that list shapes, compose motions; else stages of their own do.
        poses: vec4, (world, 4 for each shape): ``FlowHistory.before``.
        next_poses: The same, ``FlowHistory.after``; empty where not ``composed_by_trace``.
        corners: ``VertexHistory``, or None where no mesh moves.
    """

    def __init__(self, scene: Scene, tables: SceneTables):
        device = scene.device
        self.frame_state = wp.zeros(tables.num_worlds, dtype=wp.uint8, device=device)
        self.composed_by_trace = history_plan.composes(tables, device)
        size = (tables.num_worlds, 4 * tables.num_shapes)
        self.poses = wp.zeros(size, dtype=wp.vec4, device=device)
        self.next_poses = wp.zeros(size if self.composed_by_trace else (0, 0), dtype=wp.vec4, device=device)
        self.corners = None
        if tables.moving:
            moving = np.asarray(tables.moving)
            counts, worlds = scene.moving_faces(), _worlds_of(scene, tables)
            self.corners = vertex_history.allocate_vertex_history(tables.meshes, moving, counts, worlds, device)
        self._device = device

    def share_with(self, flow_history: Any, tables: SceneTables, keep: bool) -> None:
        """Give a camera's trace what is shared; with ``keep`` it is the last of its kind in the frame."""
        flow_history.frame_state, flow_history.before, flow_history.after, flow_history.keep = (
            self.frame_state,
            self.poses,
            self.next_poses,
            int(keep),
        )
        if self.corners is not None:
            flow_history.corners, flow_history.corner_starts = self.corners.corners, self.corners.starts
            flow_history.faces, flow_history.face_start = tables.meshes.faces, tables.meshes.face_start

    def bind_after(self, tables: SceneTables, mask: wp.array) -> list[Stage]:
        """The stages after all traces."""
        return (
            []
            if self.corners is None
            else [vertex_history.bind_vertex_history(self.corners, tables.meshes, mask, self._device)]
        )


def history_bytes(
    cameras: Mapping[str | int, Camera], listed: Collection[str | int], scene: Scene, tables: SceneTables
) -> int:
    """Bytes that all of this takes; of the cameras that are ``listed`` the stage of views composes motions."""
    asking = {key: camera for key, camera in cameras.items() if needs_history(camera)}
    if not asking:
        return 0
    row = wp.types.type_size_in_bytes(wp.vec4)
    composed = history_plan.composes(tables, scene.device)
    view, motions = wp.types.type_size_in_bytes(View), history_plan.motion_rows(tables) * row
    each = sum(
        view
        + (0 if composed and key not in listed else motions)
        + 2 * (4 * _history_words(camera, tables) + _floor_parts(camera, tables, scene.device))
        for key, camera in asking.items()
    )
    total = tables.num_worlds * (1 + each + (2 if composed else 1) * 4 * row * tables.num_shapes)
    if tables.moving:
        total += vertex_history.vertex_history_bytes(tables.meshes, np.asarray(tables.moving), scene.moving_faces())
    return total


def _history_words(camera: Camera, tables: SceneTables) -> int:
    return history_plan.history_words(tables, camera.width, camera.height) if "flow_valid" in camera.outputs else 0


def _floor_parts(camera: Camera, tables: SceneTables, device: wp.Device) -> int:
    if "flow_valid" not in camera.outputs:
        return 0
    return history_plan.floor_parts(tables, device, camera.width, camera.height)


def _worlds_of(scene: Scene, tables: SceneTables) -> np.ndarray:
    """The one world that has a mesh, (mesh,) int32; -1 if several have it, or none."""
    assets = tables.shapes.assets.numpy()
    meshes = tables.meshes.face_start.shape[0]
    owners = np.full(meshes, -1, np.int32)
    if len(assets) < scene.num_worlds:
        return owners
    columns = scene.moving_columns()
    worlds, places = np.nonzero(assets[:, columns] >= 0)
    used = assets[worlds, np.asarray(columns)[places]]
    owners[used] = worlds
    several = np.bincount(np.unique(np.stack((used, worlds), axis=1), axis=0)[:, 0], minlength=meshes) > 1
    owners[several] = -1
    return owners
