"""Scratch memory: buffers between the stages of a frame that are no user's image.

A camera goes through it with one group of worlds after another, so that a frame takes little more memory than its
images. All cameras use one block. While all worlds are drawn, images that are not drawn yet lend their memory, too,
which makes groups large: the larger, the better they fill the device. Where only some worlds are drawn the others'
images must stay, and there is only the block.

Images that only the last stages write can lend to worlds of their own group, too: the group is then coloured in turns,
and what is needed for one turn lies where later turns' images will be.
"""

import itertools
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeVar

import warp as wp

from warpcam.camera.camera import Camera
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.plan import edges
from warpcam.kernels.plan.frame import FramePlan

# The block is at most half as large as the images, or this where they are small: a group must fill the device [bytes].
ALWAYS_ALLOWED = 32 * 2**20
# Where they are small and all worlds have room then, so many times that: a last group of few worlds takes long for what
# it draws.
FOR_ALL = 1.25
ALIGNMENT = 256  # of a buffer [bytes]

Name = TypeVar("Name", bound=Hashable)
LentImages = Mapping[str | int, Mapping[str, wp.array]]  # images by camera and name
Buffer = tuple[str | int, int, str]  # camera, first world and name


def image_bytes(camera: Camera, num_worlds: int) -> dict[str, int]:
    """Bytes of each image."""
    return {name: num_worlds * count for name, count in _world_bytes(camera).items()}


def _world_bytes(camera: Camera) -> dict[str, int]:
    pixels = camera.width * camera.height
    return {
        name: pixels * OUTPUTS[name].channels * wp.types.type_size_in_bytes(OUTPUTS[name].dtype)
        for name in camera.outputs
    }


@dataclass(frozen=True)
class Block:
    """Memory from one address to another."""

    start: int
    end: int


@dataclass(frozen=True)
class Batch:
    """Worlds that one camera draws together.

    With them come the camera's buffers, arrays (world, height, width, 1) by name, of which only the rows of these
    worlds are there: the others must not be touched.
    """

    camera: str | int
    worlds: range
    buffers: Mapping[str, wp.array]


Rounds = list[list[Batch]]  # of a phase


class Scratch:
    """The block, and the portions that the cameras are drawn in.

    Attributes:
        size: Of the block [bytes].
    """

    def __init__(
        self,
        cameras: Mapping[str | int, Camera],
        plans: Mapping[str | int, FramePlan],
        num_worlds: int,
        device: wp.Device,
    ):
        self._cameras, self._plans, self._num_worlds, self._device = cameras, plans, num_worlds, device
        self._block = wp.empty((0, ALIGNMENT), dtype=wp.uint8, device=device)
        images = sum(sum(image_bytes(camera, num_worlds).values()) for camera in cameras.values())
        self.size = max((self._room(key, images // 2) for key in cameras), default=0)

    def allocate(self) -> None:
        rows = -(-self.size // ALIGNMENT)  # of one dimension it could not have 2^31 bytes
        self._block = wp.empty((rows, ALIGNMENT), dtype=wp.uint8, device=self._device)

    def phases(self, images: LentImages | None) -> Iterator[list[Batch]]:
        """Yield the groups that are drawn together, phase after phase, as many in each as fit.

        Args:
            images: Of all cameras, in the order of drawing, where all worlds are drawn; None where other worlds' images
                must stay.
        """
        found = list(self._phases(0, self._total, self._whole, images))
        if images is not None and any(self.wave(key) > 1 for key in self._cameras):
            in_waves = list(self._phases(0, self._total, self._whole, images, in_waves=True))
            found = in_waves if len(in_waves) <= len(found) else found
        for rounds in found:
            yield rounds[0]

    def wave(self, key: str | int) -> int:
        """Worlds of a camera are drawn together in multiples of this many: their last blocks fill the device, too."""
        plan = self._plans[key]
        return edges.wave(self._device) if (plan.fine or plan).in_place else 1

    def phases_of_rounds(
        self, images: LentImages, late: Mapping[str | int, Collection[str]], rounds: int
    ) -> list[Rounds]:
        """Return larger phases, each of several rounds.

        The last stages of a turn must wait for all stages of the turns before, which may have buffers where they write.

        Args:
            images: As above.
            late: Names of the images that nothing but the last stages writes.
            rounds: How many.
        """
        return list(self._phases(0, self._total, self._whole, images, late, rounds))

    def chains(self, images: LentImages, count: int) -> list[list[list[Batch]]] | None:
        """Return the phases in chains that need not wait for each other; None if the block is too small for that.

        Each chain has worlds of its own, lent memory of these alone, and a share of the block.

        Args:
            images: As above.
            count: How many chains.
        """
        start, total = self._whole.start, self._total
        share = self.size // count // ALIGNMENT * ALIGNMENT
        if any(self._bytes(key, 1) > share for key in self._cameras):
            return None
        return [
            [
                rounds[0]
                for rounds in self._phases(
                    total * number // count,
                    total * (number + 1) // count,
                    Block(start + number * share, start + (number + 1) * share),
                    images,
                )
            ]
            for number in range(count)
        ]

    @property
    def _whole(self) -> Block:
        start = self._block.ptr or 0
        return Block(start, start + self.size)

    @property
    def _total(self) -> int:
        return len(self._cameras) * self._num_worlds

    def _phases(
        self,
        first: int,
        last: int,
        block: Block,
        images: LentImages | None,
        late: Mapping[str | int, Collection[str]] = MappingProxyType({}),
        rounds: int = 1,
        in_waves: bool = False,
    ) -> Iterator[Rounds]:
        """Yield the groups from one pixel to another, phase after phase, in a block and in lent images."""
        while first < last:
            fits, too_far = first + 1, last + 1  # the block has room for one world
            while too_far - fits > 1:
                end = (fits + too_far) // 2
                if self._places(_cuts(first, end, rounds), last, block, images, late) is None:
                    too_far = end
                else:
                    fits = end
            if in_waves and fits < last:
                worlds = fits - first
                step = max(self.wave(key) for key, _ in self._share(first, fits))
                fits -= worlds % step if worlds > step else 0
            cuts = _cuts(first, fits, rounds)
            places = self._places(cuts, last, block, images, late)
            if places is None:
                raise AssertionError(f"scratch: {self.size} bytes have no room for one world")
            yield [
                [Batch(key, worlds, self._buffers(key, worlds, places)) for key, worlds in self._share(begin, end)]
                for begin, end in itertools.pairwise(cuts)
                if begin < end
            ]
            first = fits

    def _share(self, first: int, end: int) -> Iterator[tuple[str | int, range]]:
        """The cameras and worlds from one place to another, counted in worlds of one camera after another."""
        num_worlds = self._num_worlds
        for place, key in enumerate(self._cameras):
            begin, stop = (min(max(at - place * num_worlds, 0), num_worlds) for at in (first, end))
            if begin < stop:
                yield key, range(begin, stop)

    def _places(
        self,
        cuts: Sequence[int],
        last: int,
        block: Block,
        images: LentImages | None,
        late: Mapping[str | int, Collection[str]],
    ) -> dict[Buffer, int] | None:
        """Addresses of all buffers of a phase; None if there is no room for them.

        Images beyond the phase lend their memory until ``last``, late ones also of the turns after a buffer's own.

        Args:
            cuts: Where the turns begin, and where the last one ends.
            last: Where what is drawn in this block ends.
            block: Memory that is nobody's image.
            images: Those that may lend.
            late: Names of the late ones.
        """
        free: list[Block] = [block]
        places: dict[Buffer, int] = {}
        if images is not None:
            for key, worlds in self._share(cuts[1], last):
                free += [_rows(image, worlds) for name, image in images[key].items() if name in late.get(key, ())]
            for key, worlds in self._share(cuts[-1], last):
                free += [_rows(image, worlds) for name, image in images[key].items() if name not in late.get(key, ())]
        # The last turn has least to choose from.
        for begin, end in reversed(list(itertools.pairwise(cuts))):
            closed = [
                _rows(image, worlds)
                for key, worlds in self._share(cuts[1], end)
                for name, image in (images or {}).get(key, {}).items()
                if name in late.get(key, ())
            ]
            sizes = {
                (key, worlds.start, name): size
                for key, worlds in self._share(begin, end)
                for name, size in self._needed(key, len(worlds)).items()
            }
            found = _place(sizes, free, closed)
            if found is None:
                return None
            places |= found
        return places

    def _buffers(self, key: str | int, worlds: range, places: Mapping[Buffer, int]) -> dict[str, wp.array]:
        camera = self._cameras[key]
        buffers = {}
        for name, dtype, (height, width) in self._plans[key].scratch(camera.width, camera.height):
            stride = height * width * wp.types.type_size_in_bytes(dtype)
            start = places[key, worlds.start, name] - worlds.start * stride
            shape = (self._num_worlds, height, width, 1)
            buffers[name] = wp.array(ptr=start, shape=shape, dtype=dtype, device=self._device)
        return buffers

    def _needed(self, key: str | int, worlds: int) -> dict[str, int]:
        """Bytes of each buffer of a group."""
        camera = self._cameras[key]
        return {
            name: _aligned(worlds * height * width * wp.types.type_size_in_bytes(dtype))
            for name, dtype, (height, width) in self._plans[key].scratch(camera.width, camera.height)
        }

    def _room(self, key: str | int, half: int) -> int:
        """Bytes for all worlds of a camera, or for as many as the half of the images allows."""
        everything = self._bytes(key, self._num_worlds)
        if half <= ALWAYS_ALLOWED and everything <= FOR_ALL * ALWAYS_ALLOWED:
            return everything
        return min(everything, max(half, ALWAYS_ALLOWED, self._bytes(key, 1)))

    def _bytes(self, key: str | int, worlds: int) -> int:
        return sum(self._needed(key, worlds).values())


def _cuts(first: int, end: int, rounds: int) -> list[int]:
    """Return the start of each round, and the end of the last one."""
    return [first + (end - first) * turn // rounds for turn in range(rounds + 1)]


def cuts_in_waves(count: int, parts: int, wave: int) -> list[int]:
    """Return the starts of at most ``parts`` parts of about as many worlds, and the end.

    Each part but the last has whole waves.
    """
    return sorted({min(-(-count * part // (parts * wave)) * wave, count) for part in range(parts + 1)})


def _rows(image: wp.array, worlds: range) -> Block:
    """The memory of some worlds of an image."""
    start = image.ptr or 0
    end = start + worlds.stop * image.strides[0]
    return Block(min(_aligned(start + worlds.start * image.strides[0]), end), end)


def _aligned(count: int) -> int:
    return -(-count // ALIGNMENT) * ALIGNMENT


def _place(sizes: Mapping[Name, int], free: list[Block], closed: Iterable[Block]) -> dict[Name, int] | None:
    """Addresses of buffers of these sizes, the largest first where the least is left; None if they do not fit.

    Args:
        sizes: In bytes, by name.
        free: What is free; what is used is taken from it.
        closed: Where no buffer may begin; none of it begins within what is free.
    """
    places = {}
    for name in sorted(sizes, key=lambda name: -sizes[name]):
        open_from = [
            max([piece.start, *(_aligned(shut.end) for shut in closed if shut.start <= piece.start < shut.end)])
            for piece in free
        ]
        fitting = [i for i, piece in enumerate(free) if piece.end - open_from[i] >= sizes[name]]
        if not fitting:
            return None
        best = min(fitting, key=lambda i: free[i].end - open_from[i])
        start, piece = open_from[best], free.pop(best)
        places[name] = start
        rest = (Block(piece.start, start), Block(start + sizes[name], piece.end))
        free += [each for each in rest if each.start < each.end]
    return places
