"""Episodes' colour images as mp4 files, and many such files as one."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from warpcam.core.errors import WarpcamError

try:
    import imageio_ffmpeg
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and videos of episodes need it: pip install 'warpcam[datasets]'"
    ) from error

# Each second frame is a whole one and none is of later ones: a loader finds any frame at once, by its time.
SEEKABLE = ("-g", "2", "-bf", "0")


def encode(path: Path, images: np.ndarray, fps: int, codec: str, crf: int) -> None:
    """Write images (frame, height, width, 3) uint8 with even sides."""
    height, width = images.shape[1:3]
    writer = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=fps, codec=codec, quality=None, macro_block_size=1, ffmpeg_log_level="error",
        output_params=["-crf", str(crf), *SEEKABLE],
    )  # fmt: skip
    writer.send(None)
    try:
        for image in images:
            writer.send(np.ascontiguousarray(image))
    finally:
        writer.close()
    _require_frames(path, len(images))


def concatenate(path: Path, videos: Sequence[Path], frames: int) -> None:
    """Write the frames of all videos, which are of one kind, without encoding them again."""
    listed = path.with_name(path.name + ".txt")
    try:
        listed.write_text("".join(f"file '{str(video.resolve()).replace(chr(39), _QUOTE)}'\n" for video in videos))
        command = [
            imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", "-f", "concat", "-safe", "0", "-i", str(listed),
            "-c", "copy", "-movflags", "+faststart", "-f", "mp4", str(path),
        ]  # fmt: skip
        done = subprocess.run(command, check=False, capture_output=True, text=True)
    finally:
        listed.unlink(missing_ok=True)
    if done.returncode != 0:
        raise OSError(f"ffmpeg: {done.stderr.strip()}")
    _require_frames(path, frames)


_QUOTE = "'\\''"  # an apostrophe within apostrophes, as ffmpeg's lists have it


def _require_frames(path: Path, frames: int) -> None:
    """Raise if ffmpeg, which does not always tell, has written fewer."""
    try:
        found = imageio_ffmpeg.count_frames_and_secs(str(path))[0]
    except RuntimeError:
        found = 0
    if found != frames:
        raise OSError(f"ffmpeg wrote {found} of {frames} frames")
