"""The memory of one camera: its images, and the buffers they are made from."""

from collections.abc import Mapping

import warp as wp

from warpcam.camera import Camera
from warpcam.errors import WarpcamError
from warpcam.kernels import resolve, shadow, visibility
from warpcam.kernels.launch import Stage
from warpcam.kernels.tables import Tables
from warpcam.kernels.types import HEIGHT_FIELD, MESH, View
from warpcam.lens import Projection
from warpcam.outputs import OUTPUTS
from warpcam.scene import MAX_SHADOW_LIGHTS

MAX_PIXELS = 2**31


class Target:
    """Only what the camera's outputs need is there.

    Attributes:
        views: View, (world,).
        images: Array of each output, (world, height, width, channels).
    """

    def __init__(self, camera: Camera, tables: Tables, device: wp.Device):
        size = (tables.num_worlds, camera.height, camera.width)
        if tables.num_worlds * camera.height * camera.width >= MAX_PIXELS:
            raise WarpcamError(
                f"{camera.where}: {tables.num_worlds} worlds of {camera.width} x {camera.height} pixels are 2^31 "
                "pixels or more; fewer are allowed in one camera"
            )
        asked = {name: OUTPUTS[name] for name in camera.outputs}
        self._camera, self._device = camera, device
        self._derived = [name for name, output in asked.items() if output.trace is None]
        passes = tables.num_drawn > visibility.MAX_LISTED  # they go on from each other's depth and shape
        faces = bool(tables.shape_types & {MESH, HEIGHT_FIELD}) and any(output.face for output in asked.values())
        shadows = camera.shadows and tables.num_lights > 0 and any(output.lit for output in asked.values())
        if shadows and tables.num_lights > MAX_SHADOW_LIGHTS:
            raise WarpcamError(
                f"{camera.where}: shadows of {tables.num_lights} lights came; at most {MAX_SHADOW_LIGHTS} lights can "
                "cast shadows"
            )

        def buffer(dtype: type, wanted: bool) -> wp.array | None:
            return wp.zeros((*size, 1), dtype=dtype, device=device) if wanted else None

        needed = bool(self._derived) or passes
        self.views = wp.zeros(tables.num_worlds, dtype=View, device=device)
        self._depth = buffer(wp.float32, needed or "depth" in asked)
        self._shape = buffer(wp.int32, needed or "segmentation" in asked)
        self._face = buffer(wp.int32, faces)
        self._shadow = buffer(wp.int32, shadows)
        traced: Mapping[str, wp.array | None] = {"depth": self._depth, "shape": self._shape}
        self.images: dict[str, wp.array] = {}
        for name, output in asked.items():
            array = None if output.trace is None else traced[output.trace]
            if array is None:
                array = wp.zeros((*size, output.channels), dtype=output.dtype, device=device)
            self.images[name] = array

    def record(self, tables: Tables, projection: Projection, mask: wp.array, faults: wp.array) -> list[Stage]:
        """The stages that make the images from the views."""
        width, height, device, views = self._camera.width, self._camera.height, self._device, self.views
        depth, shape, face, shadows = self._depth, self._shape, self._face, self._shadow
        stages = [visibility.record(tables, projection, views, mask, faults, width, height, depth, shape, face, device)]
        if shadows is not None:
            stages.append(
                shadow.record(tables, projection, views, mask, depth, shape, face, width, height, shadows, device)
            )
        if self._derived:
            derived = {name: self.images[name] for name in self._derived}
            if face is None:
                face = wp.empty(0, dtype=wp.int32, device=device)
            stages.append(
                resolve.record(
                    derived, projection, tables, views, mask, depth, shape, face, shadows, width, height, device
                )
            )
        return stages
