"""The images of one camera, and the stages that make them."""

import itertools
from collections.abc import Mapping

import warp as wp

from warpcam.camera import Camera
from warpcam.errors import WarpcamError
from warpcam.kernels import resolve, shadow, visibility
from warpcam.kernels.launch import Group, Stage
from warpcam.kernels.tables import Tables
from warpcam.kernels.types import View
from warpcam.lens import Projection
from warpcam.outputs import OUTPUTS

MAX_PIXELS = 2**31
PARTS = 3
WORTH_PARTING = 2**22  # pixels of a group


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
        self._traced = {OUTPUTS[name].trace: array for name, array in self.images.items() if OUTPUTS[name].trace}
        self._derived = {name: array for name, array in self.images.items() if OUTPUTS[name].trace is None}

    def side_by_side(self, worlds: range) -> list[range]:
        """Parts of a group that are drawn at the same time: one goes on while another's last pixels are waited for."""
        large = len(worlds) * self._camera.width * self._camera.height >= WORTH_PARTING
        parts = PARTS if large and self._derived and self._device.is_cuda else 1
        bounds = [worlds.start + len(worlds) * i // parts for i in range(parts + 1)]
        return [range(first, end) for first, end in itertools.pairwise(bounds)]

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
        depth, shape, face, shadows = (
            self._traced.get(name, buffers.get(name)) for name in ("depth", "shape", "face", "shadow")
        )
        hits: dict[str, wp.array] = {
            name: self._traced[name] for name in ("distance", "points", "bodies") if name in self._traced
        }
        if tables.ids_by_world and "shape" in self._traced:  # what is asked for are ids; the stages pass on columns
            shape, hits["ids"] = buffers.get("shape"), self._traced["shape"]
        stages = [
            visibility.record(
                tables, projection, views, mask, faults, width, height, depth, shape, face, hits, device, group
            )
        ]
        if shadows is not None:
            stages.append(
                shadow.record(
                    tables, projection, views, mask, depth, shape, face, width, height, shadows, device, group
                )
            )
        if self._derived:
            images = self._derived
            if face is None:
                face = wp.empty(0, dtype=wp.int32, device=device)
            stages.append(
                resolve.record(
                    images, projection, tables, views, mask, depth, shape, face, shadows, width, height, device, group
                )
            )
        return stages
