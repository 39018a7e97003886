"""Videos of chosen worlds as tiles, written by a thread while the loop goes on."""

import contextlib
import math
import queue
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from warpcam.core.errors import WarpcamError

try:
    import imageio_ffmpeg
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and warpcam.train.recorder needs it: pip install 'warpcam[train]'"
    ) from error

GAP = 2  # between tiles [pixels]
Place = tuple[torch.Tensor, torch.Tensor]  # on the host: images of one frame, and the number of its episode


class Recorder:
    """An mp4 file of images of chosen worlds, tiled, or one file for each episode of the first of them.

    ``add`` waits for no more than a copy: on a GPU it is asynchronous, and a thread waits for it and encodes. If the
    thread falls behind by ``pending`` frames, frames are left out and one warning says so.

    Args:
        path: Of the file; its folder is made. Files of episodes are ``{name}-{episode}.mp4``, from 0.
        worlds: Whose images are shown, from the upper left row by row.
        fps: Frames of a second of video.
        columns: Tiles in a row; None makes about as many as rows.
        scale: Pixels of the video for each pixel of an image, along both sides.
        pending: Frames that may wait for the encoder.
        episodes: Says of the number of an episode whether it gets a file; None makes one file of all frames.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        worlds: Sequence[int],
        fps: float = 30.0,
        columns: int | None = None,
        scale: int = 1,
        pending: int = 64,
        episodes: Callable[[int], bool] | None = None,
    ):
        for name, count in (("scale", scale), ("pending", pending), ("columns", 1 if columns is None else columns)):
            if isinstance(count, bool) or not isinstance(count, int) or count < 1:
                raise WarpcamError(f"Recorder: {name} {count!r} came, a whole number of at least 1 is needed")
        if not worlds or any(isinstance(one, bool) or not isinstance(one, int) or one < 0 for one in worlds):
            raise WarpcamError(f"Recorder: worlds {worlds!r} came, numbers of worlds are needed")
        if not 0.0 < fps < math.inf:
            raise WarpcamError(f"Recorder: fps {fps!r} came, a positive number is needed")
        self.path, self.dropped = Path(path), 0
        if self.path.suffix != ".mp4":
            raise WarpcamError(f"Recorder: path {str(path)!r} came, a file that ends in .mp4 is needed")
        self._worlds, self._fps, self._scale, self._pending = list(worlds), fps, scale, pending
        self._columns = columns or math.ceil(math.sqrt(len(self._worlds)))
        self._episodes = episodes
        self._free: queue.SimpleQueue[Place] = queue.SimpleQueue()
        self._full: queue.SimpleQueue[tuple[Place, Any] | None] = queue.SimpleQueue()
        self._made, self._which, self._episode = 0, torch.empty(0), torch.empty(0)
        self._shape: tuple[int, ...] = ()
        self._thread: threading.Thread | None = None
        self._fault: BaseException | None = None
        self._closed = False

    def add(self, images: torch.Tensor, ended: torch.Tensor | None = None) -> None:
        """Add a frame.

        Args:
            images: Of all worlds, (world, height, width, 3) uint8, on any device.
            ended: (world,) bool: where an episode ended in the step that led here, so that the frame is the first of
                the next one. Needed for files of episodes.
        """
        if self._closed:
            raise WarpcamError(f"Recorder: {str(self.path)!r} is closed")
        if self._thread is None:
            self._begin(images)
        self._check(images)
        if ended is not None:
            self._episode += ended[self._worlds[0]]
        place = self._place()
        if place is None:
            self.dropped += 1
            if self.dropped == 1:
                warnings.warn(
                    f"{self.path}: frames are left out, the encoder is {self._pending} frames behind", stacklevel=2
                )
            return
        done, (chosen, episode) = None, place
        episode.copy_(self._episode, non_blocking=images.is_cuda)
        if images.is_cuda:
            chosen.copy_(images.index_select(0, self._which), non_blocking=True)
            done = torch.cuda.Event()  # type: ignore[no-untyped-call]
            done.record(torch.cuda.current_stream(images.device))
        else:
            torch.index_select(images, 0, self._which, out=chosen)
        self._full.put((place, done))

    def close(self) -> None:
        """Write what is left, and end the file. Raises what kept the thread from writing."""
        if self._closed:
            return
        self._closed = True
        if self._thread is not None:
            self._full.put(None)
            self._thread.join()
        if self._fault is not None:
            raise WarpcamError(f"Recorder: {str(self.path)!r} could not be written: {self._fault}") from self._fault

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def _begin(self, images: torch.Tensor) -> None:
        if images.ndim != 4 or images.shape[3] != 3 or images.dtype is not torch.uint8:
            raise WarpcamError(
                f"Recorder: images must be (world, height, width, 3) uint8, got {tuple(images.shape)} {images.dtype}"
            )
        if max(self._worlds) >= len(images):
            raise WarpcamError(f"Recorder: worlds has {max(self._worlds)}, the images are of {len(images)} worlds")
        with torch.inference_mode(False):
            self._shape, self._which = tuple(images.shape), torch.tensor(self._worlds, device=images.device)
            self._episode = torch.zeros((), dtype=torch.long, device=images.device)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise WarpcamError(f"Recorder: {str(self.path.parent)!r} cannot be made: {error.strerror}") from None
        self._thread = threading.Thread(target=self._write, name=f"Recorder {self.path.name}", daemon=True)
        self._thread.start()

    def _check(self, images: torch.Tensor) -> None:
        if tuple(images.shape) != self._shape or images.dtype is not torch.uint8 or images.device != self._which.device:
            raise WarpcamError(
                f"Recorder: images must stay {self._shape} uint8 on {self._which.device}, "
                f"got {tuple(images.shape)} {images.dtype} on {images.device}"
            )

    def _place(self) -> Place | None:
        """Memory on the host for one frame; None if all is waiting for the encoder."""
        try:
            return self._free.get_nowait()
        except queue.Empty:
            if self._made == self._pending:
                return None
        self._made += 1
        with torch.inference_mode(False):
            pinned = self._which.is_cuda
            chosen = torch.empty((len(self._worlds), *self._shape[1:]), dtype=torch.uint8, pin_memory=pinned)
            return chosen, torch.zeros((), dtype=torch.long, pin_memory=pinned)

    def _write(self) -> None:
        sheet = _Sheet(len(self._worlds), self._columns, self._shape[1], self._shape[2], self._scale)
        file = _File(self.path, self._fps, sheet.size, self._episodes)
        while (frame := self._full.get()) is not None:
            (chosen, episode), done = frame
            with self._kept_for_close():
                if done is not None:
                    done.synchronize()
                file.add(chosen.numpy(), int(episode), sheet)
            self._free.put((chosen, episode))
        with self._kept_for_close():
            file.end()

    @contextlib.contextmanager
    def _kept_for_close(self) -> Iterator[None]:
        """Keep the first error for ``close``: the loop is not to end for a video."""
        try:
            yield
        except Exception as error:
            self._fault = self._fault or error


class _File:
    """The file that is being written: of all frames, or of the episode that runs."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int], episodes: Callable[[int], bool] | None):
        self._path, self._fps, self._size, self._episodes = path, fps, size, episodes
        self._episode, self._wanted = -1, False
        self._writer: Any = None

    def add(self, images: np.ndarray, episode: int, sheet: "_Sheet") -> None:
        if self._episodes is None:
            episode = 0
        if episode != self._episode:
            self.end()
            self._episode, self._wanted = episode, self._episodes is None or self._episodes(episode)
        if not self._wanted:
            return
        if self._writer is None:
            path = self._path
            if self._episodes is not None:
                path = path.with_stem(f"{path.stem}-{episode}")
            writer = imageio_ffmpeg.write_frames(
                str(path), self._size, fps=self._fps, macro_block_size=1, quality=7, ffmpeg_log_level="error"
            )
            writer.send(None)
            self._writer = writer
        self._writer.send(sheet.draw(images))

    def end(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()


class _Sheet:
    """Tiles beside each other, with sides of even length as encoders need them."""

    def __init__(self, count: int, columns: int, height: int, width: int, scale: int):
        self._height, self._width, self._scale = height * scale, width * scale, scale
        rows = math.ceil(count / columns)
        across, down = columns * (self._width + GAP) - GAP, rows * (self._height + GAP) - GAP
        self.size = across + across % 2, down + down % 2
        self._picture = np.zeros((self.size[1], self.size[0], 3), np.uint8)
        self._corners = [
            (tile // columns * (self._height + GAP), tile % columns * (self._width + GAP)) for tile in range(count)
        ]

    def draw(self, images: np.ndarray) -> np.ndarray:
        large = images.repeat(self._scale, 1).repeat(self._scale, 2)
        for (top, left), image in zip(self._corners, large, strict=True):
            self._picture[top : top + self._height, left : left + self._width] = image
        return self._picture
