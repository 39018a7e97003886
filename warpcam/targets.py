"""The images of one camera, and the stages that make them."""

from collections.abc import Mapping

import warp as wp

from warpcam.camera import Camera
from warpcam.errors import WarpcamError
from warpcam.kernels import labels, resolve, shadow, splats, visibility
from warpcam.kernels.launch import Group, Stage
from warpcam.kernels.tables import Tables
from warpcam.kernels.types import View
from warpcam.lens import Projection
from warpcam.outputs import OUTPUTS, traced_as

MAX_PIXELS = 2**31


def check_size(camera: Camera, num_worlds: int) -> None:
    if num_worlds * camera.height * camera.width >= MAX_PIXELS:
        raise WarpcamError(
            f"{camera.where}: {num_worlds} worlds of {camera.width} x {camera.height} pixels are 2^31 "
            "pixels or more; fewer are allowed in one camera"
        )


class Target:
    """Only what the camera's outputs need is there.

    Attributes:
        views: View, (world,).
        images: Array of each output, (world, height, width, channels).
    """

    def __init__(self, camera: Camera, num_worlds: int, device: wp.Device):
        size = (num_worlds, camera.height, camera.width)
        self._camera, self._device = camera, device
        self.views = wp.zeros(num_worlds, dtype=View, device=device)
        self.images: dict[str, wp.array] = {
            name: wp.zeros((*size, OUTPUTS[name].channels), dtype=OUTPUTS[name].dtype, device=device)
            for name in camera.outputs
        }

    def record(
        self,
        tables: Tables,
        projection: Projection,
        group: Group,
        buffers: Mapping[str, wp.array],
        mask: wp.array,
        faults: wp.array,
    ) -> list[Stage]:
        """The stages that make the images of a group of worlds from their views, by way of ``buffers``."""
        device, views, width, height = self._device, self.views, self._camera.width, self._camera.height
        names = {name: traced_as(name, tables.shape_types) for name in self.images}
        traced = {trace: self.images[name] for name, trace in names.items() if trace is not None}
        derived = {name: self.images[name] for name, trace in names.items() if trace is None}
        if tables.ids_by_world and "shape" in traced:  # what is asked for are ids; the stages pass on columns
            traced["ids"] = traced.pop("shape")
        depth, shape, face, shadows = (
            traced.pop(name, buffers.get(name)) for name in ("depth", "shape", "face", "shadow")
        )
        stages = [
            visibility.record(
                tables, projection, views, mask, faults, width, height, depth, shape, face, traced, device, group
            )
        ]
        if shadows is not None:
            stages.append(
                shadow.record(
                    tables, projection, views, mask, depth, shape, face, width, height, shadows, device, group
                )
            )
        for name in [name for name in derived if OUTPUTS[name].label is not None]:
            image = derived.pop(name)
            stages.append(
                labels.record(tables.labels[name], OUTPUTS[name].label or 0, mask, shape, image, device, group)
            )
        if derived:
            if face is None:
                face = wp.empty(0, dtype=wp.int32, device=device)
            stages.append(
                resolve.record(
                    derived, projection, tables, views, mask, depth, shape, face, shadows, width, height, device, group
                )
            )
        if tables.splats is not None:
            stages.insert(0, splats.record_check(tables, views, mask, faults, device, group))
            stages.append(
                splats.record(self.images, projection, tables, views, mask, depth, shape, width, height, device, group)
            )
        return stages
