"""Operations on images of all worlds, on the device they lie on, into memory that is allocated once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import torch

from warpcam.core.errors import WarpcamError

LUMA = (0.299, 0.587, 0.114)  # weights of red, green and blue in a grey of ITU-R BT.601
Shape = tuple[int, int, int]  # channels, height, width
Run = Callable[[torch.Tensor], torch.Tensor]


class ImageOperation(Protocol):
    """A step from images (world, channel, height, width) to others of the same worlds."""

    def prepare(self, images: torch.Tensor) -> tuple[torch.Tensor, Run]:
        """Allocate what the operation needs for images like these.

        Returns:
            Images like those that the operation gives, and the function that it is from then on. The function gives
            the same memory each time, or a view of the images that it is called with.
        """
        ...


@dataclass(frozen=True)
class Crop:
    """Cut a rectangle out of each image, without a copy.

    Args:
        top: First row.
        left: First column.
        height: Rows.
        width: Columns.
    """

    top: int
    left: int
    height: int
    width: int

    def __post_init__(self) -> None:
        _require_counts("Crop", 0, top=self.top, left=self.left)
        _require_counts("Crop", 1, height=self.height, width=self.width)

    def prepare(self, images: torch.Tensor) -> tuple[torch.Tensor, Run]:
        height, width = images.shape[2:]
        bottom, right = self.top + self.height, self.left + self.width
        if bottom > height or right > width:
            raise WarpcamError(
                f"Crop: rows {self.top} to {bottom} and columns {self.left} to {right} came, "
                f"the image has {height} rows and {width} columns"
            )

        def run(images: torch.Tensor) -> torch.Tensor:
            return images[:, :, self.top : bottom, self.left : right]

        return run(images), run


@dataclass(frozen=True)
class Grey:
    """One channel of three: 0.299 red + 0.587 green + 0.114 blue (ITU-R BT.601), of the values as they are stored."""

    def prepare(self, images: torch.Tensor) -> tuple[torch.Tensor, Run]:
        worlds, channels, height, width = images.shape
        if channels != 3:
            raise WarpcamError(f"Grey: the image has {channels} channels, red, green and blue are needed")
        grey = torch.empty((worlds, 1, height, width), dtype=torch.float32, device=images.device)

        def run(images: torch.Tensor) -> torch.Tensor:
            grey.copy_(images[:, :1]).mul_(LUMA[0])
            grey.add_(images[:, 1:2], alpha=LUMA[1])
            return grey.add_(images[:, 2:], alpha=LUMA[2])

        return grey, run


@dataclass(frozen=True)
class Resize:
    """Give each image another size: a new pixel is the mean of the area that it covers.

    Args:
        height: New rows.
        width: New columns.
    """

    height: int
    width: int

    def __post_init__(self) -> None:
        _require_counts("Resize", 1, height=self.height, width=self.width)

    def prepare(self, images: torch.Tensor) -> tuple[torch.Tensor, Run]:
        worlds, channels, height, width = images.shape
        device = images.device
        rows, columns = _areas(height, self.height).to(device), _areas(width, self.width).T.contiguous().to(device)
        numbers = torch.empty(images.shape, dtype=torch.float32, device=device)
        narrow = torch.empty((worlds, channels, height, self.width), dtype=torch.float32, device=device)
        resized = torch.empty((worlds, channels, self.height, self.width), dtype=torch.float32, device=device)

        def run(images: torch.Tensor) -> torch.Tensor:
            torch.matmul(numbers.copy_(images), columns, out=narrow)
            return torch.matmul(rows, narrow, out=resized)

        return resized, run


@dataclass(frozen=True)
class Normalize:
    """Numbers from 0 to 1, float32.

    Args:
        low: Value that becomes 0; values below become 0, too.
        high: Value that becomes 1; values above become 1, too, among them a miss's infinity, and what is not a number.
            The defaults are those of colours, (0, 255); depth needs the nearest and the farthest distance [m].
    """

    low: float = 0.0
    high: float = 255.0

    def __post_init__(self) -> None:
        if not -float("inf") < self.low < self.high < float("inf"):
            raise WarpcamError(f"Normalize: low {self.low!r} and high {self.high!r} came, low must be less than high")

    def prepare(self, images: torch.Tensor) -> tuple[torch.Tensor, Run]:
        numbers = torch.empty(images.shape, dtype=torch.float32, device=images.device)
        scale = 1.0 / (self.high - self.low)

        def run(images: torch.Tensor) -> torch.Tensor:
            numbers.copy_(images).nan_to_num_(nan=self.high, posinf=self.high, neginf=self.low)
            return numbers.clamp_(self.low, self.high).sub_(self.low).mul_(scale)

        return numbers, run


@dataclass(frozen=True)
class ImageTransform:
    """Operations one after another, and the last frames of them stacked.

    Args:
        operations: Each works on what the one before gives.
        stack: Frames whose channels an observation has, the oldest first. After a reset all are the first frame.

    Colours stay uint8, rounded, unless ``Normalize`` is among the operations.
    """

    operations: Sequence[ImageOperation] = ()
    stack: int = 1

    def __post_init__(self) -> None:
        _require_counts("ImageTransform", 1, stack=self.stack)
        for operation in self.operations:
            if not hasattr(operation, "prepare"):
                raise WarpcamError(f"ImageTransform: operations must be like Crop or Grey, got {operation!r}")

    def prepare(self, images: torch.Tensor) -> "Frames":
        """Allocate what the transform needs for images like these, (world, channel, height, width)."""
        if images.ndim != 4:
            raise WarpcamError(
                f"ImageTransform: images must be (world, channel, height, width), got {tuple(images.shape)}"
            )
        if images.dtype is not torch.uint8 and Normalize() in self.operations:
            raise WarpcamError(
                f"Normalize: low and high are those of uint8, the images are {images.dtype}: give a range"
            )
        stays = images.dtype is torch.uint8 and not any(isinstance(one, Normalize) for one in self.operations)
        dtype = images.dtype if stays or not self.operations else torch.float32
        runs = []
        # Outside inference mode, whose tensors could not be written later.
        with torch.inference_mode(False):
            images = torch.empty_strided(images.shape, images.stride(), dtype=images.dtype, device=images.device)
            for operation in self.operations:
                images, run = operation.prepare(images)
                runs.append(run)
        return Frames(images, self.stack, dtype, runs)


class Frames:
    """The last frames of each world, in two places in turn: what was given stays as it is until the frame after next.

    Learning code keeps an observation while the env makes the next one, so one place would not do.

    Args:
        like: One frame of all worlds after the operations, (world, channel, ...).
        count: Frames of an observation.
        dtype: Of the observation.
        runs: Operations, prepared.
    """

    def __init__(self, like: torch.Tensor, count: int = 1, dtype: torch.dtype | None = None, runs: Sequence[Run] = ()):
        self._channels, self._runs, self._rounds = like.shape[1], tuple(runs), False
        shape = (like.shape[0], count * self._channels, *like.shape[2:])
        # Outside inference mode, whose tensors could not be written later.
        with torch.inference_mode(False):
            self._places = [torch.zeros(shape, dtype=dtype or like.dtype, device=like.device) for _ in range(2)]
        self._rounds = self._places[0].dtype is torch.uint8 and like.dtype is not torch.uint8
        self._now = 0

    @property
    def now(self) -> torch.Tensor:
        """The observation: (world, stack * channel, ...)."""
        return self._places[self._now]

    def turn(self) -> None:
        """Have the other place be that of ``now``, which something else has written."""
        self._now = 1 - self._now

    @property
    def place(self) -> int:
        """Number of the place of ``now``: 0 or 1."""
        return self._now

    def push(self, images: torch.Tensor, begun: torch.Tensor | None = None) -> torch.Tensor:
        """Add a frame of every world, which is all of the observation in the worlds of the mask; returns it."""
        last, frame = self.now, self._run(images)
        self.turn()
        self.now[:, : -self._channels].copy_(last[:, self._channels :])
        self.now[:, -self._channels :].copy_(frame)
        if begun is not None:
            self._fill(frame, begun, self.now.shape[1] - self._channels)
        return self.now

    def restart(self, images: torch.Tensor, worlds: torch.Tensor | None = None) -> torch.Tensor:
        """Have the observation of the worlds of the mask, or of all, begin with this frame; returns the observation."""
        self._fill(self._run(images), worlds, self.now.shape[1])
        return self.now

    def _fill(self, frame: torch.Tensor, worlds: torch.Tensor | None, channels: int) -> None:
        """Put a frame in place of each of the frames that the first channels are, in the worlds of the mask."""
        for first in range(0, channels, self._channels):
            part = self.now[:, first : first + self._channels]
            if worlds is None:
                part.copy_(frame)
            else:
                mask = worlds.reshape(-1, *[1] * (part.ndim - 1))
                torch.where(mask, frame.to(part.dtype), part, out=part)

    def _run(self, images: torch.Tensor) -> torch.Tensor:
        for run in self._runs:
            images = run(images)
        return images.round_() if self._rounds else images


def _areas(old: int, new: int) -> torch.Tensor:
    """Share of each old pixel in each new one, (new, old): the overlap of their intervals."""
    edges = torch.linspace(0.0, old, new + 1, dtype=torch.float64)
    pixels = torch.arange(old, dtype=torch.float64)
    overlap = torch.minimum(edges[1:, None], pixels + 1.0) - torch.maximum(edges[:-1, None], pixels)
    return (overlap.clamp(min=0.0) * (new / old)).float()


def _require_counts(whose: str, least: int, **counts: int) -> None:
    for name, count in counts.items():
        if isinstance(count, bool) or not isinstance(count, int) or count < least:
            raise WarpcamError(f"{whose}: {name} {count!r} came, a whole number of at least {least} is needed")
