"""What is written between the stages of a frame and is nobody's image.

All cameras use one block of memory, and a camera that needs more than there is goes through it with one group of
worlds at a time. So a frame takes little more memory than its images. The block has a few slots: while the last pixels
of one group are waited for, others are under way.
"""

import itertools
from collections.abc import Iterable, Mapping
from typing import Any

import warp as wp

from warpcam.camera import Camera
from warpcam.errors import WarpcamError
from warpcam.kernels import shadow, visibility
from warpcam.kernels.launch import Group
from warpcam.kernels.tables import Tables
from warpcam.kernels.types import HEIGHT_FIELD, MESH
from warpcam.outputs import OUTPUTS

# The block is at most half as large as the images, or this where they are small: a group must fill the device [bytes].
ALWAYS_ALLOWED = 32 * 2**20
SLOTS = 4
ALIGNMENT = 256  # of a slot [bytes]
VALUE = 4  # bytes a pixel of each buffer

DTYPES: Mapping[str, Any] = {"depth": wp.float32, "shape": wp.int32, "face": wp.int32, "shadow": wp.int32}


def buffers_of(camera: Camera, tables: Tables) -> tuple[str, ...]:
    """Names of the buffers between the stages that this camera's outputs need, those aside that are outputs."""
    asked = [OUTPUTS[name] for name in camera.outputs]
    lit = camera.shadows and tables.num_lights > 0 and any(output.lit for output in asked)
    if lit and tables.num_lights > shadow.MAX_LIGHTS:
        raise WarpcamError(
            f"{camera.where}: shadows of {tables.num_lights} lights came; at most {shadow.MAX_LIGHTS} lights can "
            "cast shadows"
        )
    passes = tables.num_drawn > visibility.MAX_LISTED  # they go on from each other's depth and shape
    needed = passes or any(output.trace is None for output in asked)
    images = {output.trace for output in asked} - ({"shape"} if tables.ids_by_world else set())
    faces = bool(tables.shape_types & {MESH, HEIGHT_FIELD}) and any(output.face for output in asked)
    wanted = {
        "depth": needed and "depth" not in images,
        "shape": needed and "shape" not in images,
        "face": faces,
        "shadow": lit,
    }
    return tuple(name for name, there in wanted.items() if there)


def image_bytes(camera: Camera, tables: Tables) -> dict[str, int]:
    """Bytes of each image."""
    pixels = tables.num_worlds * camera.width * camera.height
    return {
        name: pixels * OUTPUTS[name].channels * wp.types.type_size_in_bytes(OUTPUTS[name].dtype)
        for name in camera.outputs
    }


class Scratch:
    """The block, and how it is shared out.

    Attributes:
        slots: Groups that have room side by side, and may be drawn at once.
        size: Of the block [bytes].
    """

    def __init__(self, cameras: Iterable[Camera], tables: Tables, device: wp.Device):
        self._tables, self._device = tables, device
        self._block = wp.empty(0, dtype=wp.uint8, device=device)
        cameras = list(cameras)
        allowed = max(sum(sum(image_bytes(c, tables).values()) for c in cameras) // 2, ALWAYS_ALLOWED)
        largest_world = max((self._world_bytes(camera) for camera in cameras), default=0)
        most = max(1, min(SLOTS, allowed // largest_world if largest_world else 1)) if device.is_cuda else 1
        self._counts = {camera.name: self._count_groups(camera, allowed // most) for camera in cameras}
        largest = max((self._group_size(c) * self._world_bytes(c) for c in cameras), default=0)
        self._slot = -(-largest // ALIGNMENT) * ALIGNMENT
        self.slots = min(most, max(sum(self._counts.values()), 1))
        self.size = self.slots * self._slot

    def allocate(self) -> None:
        self._block = wp.empty(self.size, dtype=wp.uint8, device=self._device)

    def groups(self, camera: Camera, slot: int) -> list[tuple[Group, dict[str, wp.array]]]:
        """The camera's groups, the first in that slot, the others in those that follow, round and round.

        With each come its buffers, arrays (world, height, width, 1) by name. Only the rows of the group's worlds are
        there: the others must not be touched.
        """
        worlds, count, pixels = self._tables.num_worlds, self._counts[camera.name], camera.width * camera.height
        size, names = self._group_size(camera), buffers_of(camera, self._tables)
        shape = (worlds, camera.height, camera.width, 1)
        at_once = min(self.slots * size, worlds * len(self._counts))
        groups: list[tuple[Group, dict[str, wp.array]]] = []
        for first, end in itertools.pairwise(worlds * i // count for i in range(count + 1)):
            start = (self._block.ptr or 0) + (slot + len(groups)) % self.slots * self._slot
            buffers = {
                name: wp.array(
                    ptr=start + (place * size - first) * pixels * VALUE,
                    shape=shape,
                    dtype=DTYPES[name],
                    device=self._device,
                )
                for place, name in enumerate(names)
            }
            groups.append((Group(range(first, end), at_once), buffers))
        return groups

    def _world_bytes(self, camera: Camera) -> int:
        return len(buffers_of(camera, self._tables)) * camera.width * camera.height * VALUE

    def _count_groups(self, camera: Camera, allowed: int) -> int:
        each = self._world_bytes(camera)
        return -(-self._tables.num_worlds // max(allowed // each, 1)) if each else 1

    def _group_size(self, camera: Camera) -> int:
        """Worlds in the largest; the smallest has at most one less."""
        return -(-self._tables.num_worlds // self._counts[camera.name])
