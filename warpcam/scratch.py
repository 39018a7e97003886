"""What is written between the stages of a frame and is nobody's image.

A camera goes through it with one group of worlds after another, so that a frame takes little more memory than its
images. All cameras use one block. While all worlds are drawn, images that are not drawn yet lend their memory, too,
which makes groups large: the larger, the better they fill the device. Where only some worlds are drawn the others'
images must stay, and there is only the block.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.camera import Camera
from warpcam.errors import WarpcamError
from warpcam.kernels import shadow, visibility
from warpcam.kernels.tables import Tables
from warpcam.kernels.types import HEIGHT_FIELD, MESH
from warpcam.outputs import OUTPUTS

# The block is at most half as large as the images, or this where they are small: a group must fill the device [bytes].
ALWAYS_ALLOWED = 32 * 2**20
ALIGNMENT = 256  # of a buffer [bytes]


def buffers_of(camera: Camera, tables: Tables) -> dict[str, Any]:
    """The buffers between the stages that this camera's outputs need, those aside that are outputs: dtypes by name."""
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
    dtypes = {
        "depth": wp.float32,
        "shape": wp.int16 if tables.num_shapes <= 2**15 else wp.int32,
        "face": wp.uint16 if tables.num_faces <= 2**16 and HEIGHT_FIELD not in tables.shape_types else wp.int32,
        "shadow": wp.uint8 if tables.num_lights <= 8 else wp.int32,
    }
    return {name: dtypes[name] for name, there in wanted.items() if there}


def image_bytes(camera: Camera, tables: Tables) -> dict[str, int]:
    """Bytes of each image."""
    return {name: tables.num_worlds * count for name, count in _world_bytes(camera).items()}


def _world_bytes(camera: Camera) -> dict[str, int]:
    pixels = camera.width * camera.height
    return {
        name: pixels * OUTPUTS[name].channels * wp.types.type_size_in_bytes(OUTPUTS[name].dtype)
        for name in camera.outputs
    }


@dataclass(frozen=True)
class Piece:
    """Memory from one address to another."""

    start: int
    end: int

    def from_(self, address: int) -> "Piece":
        """What is left of it from the first aligned address on that is not below this one."""
        return Piece(min(_aligned(address), self.end), self.end)


Placed = tuple[range, dict[str, wp.array]]


class Scratch:
    """The block, and the groups of worlds that each camera is drawn in.

    Attributes:
        size: Of the block [bytes].
    """

    def __init__(self, cameras: Mapping[str | int, Camera], tables: Tables, device: wp.Device):
        self._cameras, self._tables, self._device = cameras, tables, device
        self._block = wp.empty(0, dtype=wp.uint8, device=device)
        images = sum(sum(image_bytes(camera, tables).values()) for camera in cameras.values())
        allowed = max(images // 2, ALWAYS_ALLOWED)
        self.size = max(
            (
                min(self._bytes(camera, tables.num_worlds), max(allowed, self._bytes(camera, 1)))
                for camera in cameras.values()
            ),
            default=0,
        )

    def allocate(self) -> None:
        self._block = wp.empty(self.size, dtype=wp.uint8, device=self._device)

    def groups(self, key: str | int) -> Iterator[Placed]:
        """The camera's groups while other images must stay.

        With each come its buffers, arrays (world, height, width, 1) by name. Only the rows of the group's worlds are
        there: the others must not be touched.
        """
        worlds = self._tables.num_worlds
        count = self._count_groups(self._cameras[key])
        for first, end in itertools.pairwise(worlds * i // count for i in range(count + 1)):
            yield self._placed(key, range(first, end), [self._piece(self._block)])

    def groups_of_all(self, key: str | int, images: Mapping[str | int, Iterable[wp.array]]) -> Iterator[Placed]:
        """The same while the images of all cameras are drawn, in this order."""
        worlds, first = self._tables.num_worlds, 0
        later = list(itertools.dropwhile(lambda other: other != key, images))[1:]
        whole = [self._piece(self._block), *(self._piece(image) for other in later for image in images[other])]
        own = [(self._piece(image), image.strides[0]) for image in images[key]]

        def lent(end: int) -> list[Piece]:
            return whole + [piece.from_(piece.start + end * stride) for piece, stride in own]

        while first < worlds:
            fits = first + 1  # the block has room for one world
            too_far = worlds + 1
            while too_far - fits > 1:
                end = (fits + too_far) // 2
                if _place(self._needed(self._cameras[key], end - first), lent(end)) is not None:
                    fits = end
                else:
                    too_far = end
            yield self._placed(key, range(first, fits), lent(fits))
            first = fits

    def _placed(self, key: str | int, worlds: range, pieces: Sequence[Piece]) -> Placed:
        camera = self._cameras[key]
        places = _place(self._needed(camera, len(worlds)), pieces)
        if places is None:
            raise AssertionError(f"scratch: {len(worlds)} worlds of {camera.where} do not fit")
        shape = (self._tables.num_worlds, camera.height, camera.width, 1)
        buffers = {}
        for name, dtype in buffers_of(camera, self._tables).items():
            stride = camera.height * camera.width * wp.types.type_size_in_bytes(dtype)
            start = places[name] - worlds.start * stride
            buffers[name] = wp.array(ptr=start, shape=shape, dtype=dtype, device=self._device)
        return worlds, buffers

    def _needed(self, camera: Camera, worlds: int) -> dict[str, int]:
        """Bytes of each buffer of a group."""
        pixels = worlds * camera.width * camera.height
        return {
            name: _aligned(pixels * wp.types.type_size_in_bytes(dtype))
            for name, dtype in buffers_of(camera, self._tables).items()
        }

    def _bytes(self, camera: Camera, worlds: int) -> int:
        return sum(self._needed(camera, worlds).values())

    def _count_groups(self, camera: Camera) -> int:
        """The fewest groups that the block has room for, as equal as they can be."""
        worlds = self._tables.num_worlds
        count = max(1, self._bytes(camera, worlds) // max(self.size, 1))
        while self._bytes(camera, -(-worlds // count)) > self.size:
            count += 1
        return count

    def _piece(self, array: wp.array) -> Piece:
        start = array.ptr or 0
        return Piece(start, start + array.size * wp.types.type_size_in_bytes(array.dtype))


def _aligned(count: int) -> int:
    return -(-count // ALIGNMENT) * ALIGNMENT


def _place(sizes: Mapping[str, int], pieces: Sequence[Piece]) -> dict[str, int] | None:
    """Addresses of buffers of these sizes, the largest first where the least is left; None if they do not fit."""
    free, places = list(pieces), {}
    for name in sorted(sizes, key=lambda name: -sizes[name]):
        fitting = [i for i, piece in enumerate(free) if piece.end - piece.start >= sizes[name]]
        if not fitting:
            return None
        best = min(fitting, key=lambda i: free[i].end - free[i].start)
        places[name] = free[best].start
        free[best] = Piece(free[best].start + sizes[name], free[best].end)
    return places
