"""The images of one camera, and the stages that make them."""

from collections.abc import Mapping
from dataclasses import dataclass

import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Projection
from warpcam.core.errors import WarpcamError
from warpcam.kernels.layers import Mirror
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.plan.frame import FramePlan, plan_frame
from warpcam.kernels.plan.passes import PASSES
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.runtime.launch import Group, Stage
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import View
from warpcam.render.flow_history import CameraHistory, needs_history

MAX_PIXELS = 2**31


def check_size(camera: Camera, num_worlds: int) -> None:
    if num_worlds * camera.height * camera.width >= MAX_PIXELS:
        raise WarpcamError(
            f"{camera.where}: {num_worlds} worlds of {camera.width} x {camera.height} pixels are 2^31 "
            "pixels or more; fewer are allowed in one camera"
        )


def request_of(camera: Camera, projection: Projection) -> ImageRequest:
    """The images that a camera asks for."""
    return ImageRequest(
        camera.width,
        camera.height,
        projection,
        tuple(camera.outputs),
        shadows=camera.shadows,
        antialiasing=camera.antialiasing,
    )


@dataclass(frozen=True)
class Stages:
    """Stages that render one group of worlds.

    Attributes:
        visibility: Up to those that find what is seen and what lies in shadows.
        shading: The rest; nothing else writes ``FramePlan.late``.
    """

    visibility: list[Stage]
    shading: list[Stage]


class CameraPasses:
    """Arrays of one camera, as far as its outputs need them.

    Attributes:
        plan: Of all worlds drawn together.
        views: View, (world,).
        images: Array of each output, (world, height, width, channels).
        history: What is kept of the last frame; None where no output needs it.
        lists: vec4, (world, row): the shapes that its images may show, where a stage lists them; else None.
    """

    def __init__(self, camera: Camera, projection: Projection, tables: SceneTables, device: wp.Device):
        num_worlds = tables.num_worlds
        size = (num_worlds, camera.height, camera.width)
        self._request, self._device = request_of(camera, projection), device
        self.plan = plan_frame(tables, self._request, device)
        self.views = wp.zeros(num_worlds, dtype=View, device=device)
        behind = num_worlds if self.plan.mirrors else 0
        self._mirrored = wp.zeros(behind, dtype=View, device=device)  # views from behind the mirrors
        self._mirrors = wp.zeros(behind, dtype=Mirror, device=device)
        self.images: dict[str, wp.array] = {
            name: wp.zeros((*size, OUTPUTS[name].channels), dtype=OUTPUTS[name].dtype, device=device)
            for name in camera.outputs
        }
        rows = self.plan.list_rows
        self.lists = wp.zeros((num_worlds, rows), dtype=wp.vec4, device=device) if rows else None
        self.history = (
            CameraHistory(camera, tables, device, self.images, listed=rows > 0) if needs_history(camera) else None
        )

    def bind(
        self,
        tables: SceneTables,
        group: Group,
        buffers: Mapping[str, wp.array],
        mask: wp.array,
        faults: wp.array,
    ) -> tuple[FramePlan, Stages]:
        """Plan and bind the stages that make the images of a group of worlds, by way of ``buffers``."""
        request = self._request
        plan = plan_frame(tables, request, self._device, group)
        frame = CameraFrame(
            tables=tables,
            width=request.width,
            height=request.height,
            lens=request.lens,
            views=self.views,
            mask=mask,
            faults=faults,
            images=self.images,
            buffers=buffers,
            mirrors=self._mirrors,
            mirrored=self._mirrored,
            flow_history=None if self.history is None else self.history.flow_history,
            lists=self.lists,
            group=group,
            device=self._device,
        )
        bound = [[PASSES[each.name].bind(each, frame) for each in passes] for passes in (plan.visibility, plan.shading)]
        return plan, Stages(*bound)
