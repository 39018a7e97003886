"""Videos of batched envs: what is read back is what was added, tile by tile, and the loop does not wait."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="pip install 'warpcam[train]'")
cv2 = pytest.importorskip("cv2", reason="pip install opencv-python-headless")

from warpcam.core import torch_interop  # noqa: E402
from warpcam.errors import WarpcamError  # noqa: E402
from warpcam.train import Recorder  # noqa: E402

GREYS = (40, 90, 140, 190, 240)


def read(path: Path) -> np.ndarray:
    """Frames of a file, (frame, height, width, 3)."""
    film, frames = cv2.VideoCapture(str(path)), []
    while True:
        there, frame = film.read()
        if not there:
            return np.stack(frames)
        frames.append(frame)


def images_of(device: wp.Device, frame: int, worlds: int = 5) -> torch.Tensor:
    """Flat images whose greys tell the world and the frame."""
    greys = torch.tensor(GREYS[:worlds], dtype=torch.uint8, device=torch_interop.device_of(device)) - 3 * frame
    return greys.reshape(-1, 1, 1, 1).expand(-1, 16, 24, 3).contiguous()


def test_tiles_are_read_back(device: wp.Device, tmp_path: Path) -> None:
    path = tmp_path / "new" / "video.mp4"
    with Recorder(path, worlds=(4, 0, 2), fps=20.0, scale=2) as recorder:
        for frame in range(6):
            recorder.add(images_of(device, frame))
    frames = read(path)
    assert frames.shape == (6, 2 * 32 + 2, 2 * 48 + 2, 3)
    corners = ((0, 0), (0, 50), (34, 0))
    for number, frame in enumerate(frames.astype(float)):
        for world, (top, left) in zip((4, 0, 2), corners, strict=True):
            tile = frame[top + 8 : top + 24, left + 8 : left + 40]
            assert abs(tile.mean() - (GREYS[world] - 3 * number)) < 4.0
        assert frame[42:60, 60:90].max() < 20.0
    assert recorder.dropped == 0


def test_what_was_added_may_be_written_over(device: wp.Device, tmp_path: Path) -> None:
    """The renderer's memory is given, whose next frame follows at once."""
    path, memory = tmp_path / "video.mp4", images_of(device, 0)
    with Recorder(path, worlds=(1,)) as recorder:
        for frame in range(8):
            memory.copy_(images_of(device, frame))
            recorder.add(memory)
    means = read(path).mean((1, 2, 3))
    np.testing.assert_allclose(means, [GREYS[1] - 3 * frame for frame in range(8)], atol=4.0)


def test_episodes_of_the_first_world_are_files(device: wp.Device, tmp_path: Path) -> None:
    """Ends of other worlds are none; an episode that is not asked for has no file."""
    ends = {3: (0, 1, 0), 5: (1, 0, 0), 8: (0, 1, 1), 9: (0, 0, 1)}
    with Recorder(tmp_path / "run.mp4", worlds=(1, 2), episodes=lambda number: number != 1) as recorder:
        for frame in range(12):
            ended = torch.tensor(ends.get(frame, (0, 0, 0)), dtype=torch.bool, device=torch_interop.device_of(device))
            recorder.add(images_of(device, frame, worlds=3), ended)
    assert {path.name for path in tmp_path.iterdir()} == {"run-0.mp4", "run-2.mp4"}
    assert len(read(tmp_path / "run-0.mp4")) == 3
    assert len(read(tmp_path / "run-2.mp4")) == 4


@pytest.fixture
def go(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Encoders stand still until it is set."""
    go, write = threading.Event(), imageio_ffmpeg.write_frames

    def slow(*arguments: object, **options: object) -> object:
        assert go.wait(60.0)
        return write(*arguments, **options)

    monkeypatch.setattr(imageio_ffmpeg, "write_frames", slow)
    return go


def test_the_loop_does_not_wait_for_the_encoder(device: wp.Device, tmp_path: Path, go: threading.Event) -> None:
    """An encoder that stands still costs frames, which one warning tells, and no time."""
    recorder = Recorder(tmp_path / "video.mp4", worlds=(0,), pending=4)
    for frame in range(4):
        recorder.add(images_of(device, frame))
    with pytest.warns(UserWarning, match="video.mp4: frames are left out, the encoder is 4 frames behind"):
        recorder.add(images_of(device, 4))
    for frame in range(5, 10):  # without a warning, which would be an error
        recorder.add(images_of(device, frame))
    assert recorder.dropped == 6
    go.set()
    recorder.close()
    assert len(read(tmp_path / "video.mp4")) == 4


def test_ends_of_frames_that_are_left_out_are_ends(device: wp.Device, tmp_path: Path, go: threading.Event) -> None:
    recorder = Recorder(tmp_path / "run.mp4", worlds=(0,), pending=2, episodes=lambda number: True)
    ends = torch.ones(5, dtype=torch.bool, device=torch_interop.device_of(device))
    recorder.add(images_of(device, 0))
    recorder.add(images_of(device, 1))
    with pytest.warns(UserWarning, match="frames are left out"):
        recorder.add(images_of(device, 2), ends)
    recorder.add(images_of(device, 3), ends)
    go.set()
    deadline, dropped = time.monotonic() + 60.0, -1
    while recorder.dropped != dropped:  # until the encoder has gone on, and a frame is taken
        assert time.monotonic() < deadline
        time.sleep(0.01)
        dropped = recorder.dropped
        recorder.add(images_of(device, 4))
    recorder.close()
    assert {path.name for path in tmp_path.iterdir()} == {"run-0.mp4", "run-2.mp4"}


def test_an_error_of_the_choice_of_episodes_is_told(device: wp.Device, tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mp4", worlds=(0,), episodes=lambda number: number < 1 / 0)
    recorder.add(images_of(device, 0))
    with pytest.raises(WarpcamError, match=r"run.mp4' could not be written: division by zero"):
        recorder.close()


def test_a_file_that_cannot_be_written_is_told_at_the_end(
    device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object, **options: object) -> object:
        raise OSError("no space left")

    monkeypatch.setattr(imageio_ffmpeg, "write_frames", broken)
    recorder = Recorder(tmp_path / "video.mp4", worlds=(0,))
    for frame in range(3):
        recorder.add(images_of(device, frame))
        time.sleep(0.01)
    with pytest.raises(WarpcamError, match=r"video.mp4' could not be written: no space left"):
        recorder.close()
    recorder.close()


def test_mistakes_are_named(tmp_path: Path) -> None:
    path, images = tmp_path / "video.mp4", torch.zeros((2, 4, 4, 3), dtype=torch.uint8)
    for options, message in (
        ({"worlds": ()}, r"Recorder: worlds \(\) came, numbers of worlds are needed"),
        ({"worlds": (-1,)}, r"Recorder: worlds \(-1,\) came"),
        ({"worlds": (0,), "fps": 0.0}, "Recorder: fps 0.0 came, a positive number is needed"),
        ({"worlds": (0,), "scale": 0}, "Recorder: scale 0 came, a whole number of at least 1 is needed"),
    ):
        with pytest.raises(WarpcamError, match=message):
            Recorder(path, **options)  # type: ignore[arg-type]
    with pytest.raises(WarpcamError, match=r"video.gif' came, a file that ends in .mp4 is needed"):
        Recorder(tmp_path / "video.gif", worlds=(0,))
    recorder = Recorder(path, worlds=(2,))
    with pytest.raises(WarpcamError, match="Recorder: worlds has 2, the images are of 2 worlds"):
        recorder.add(images)
    recorder = Recorder(path, worlds=(1,))
    with pytest.raises(WarpcamError, match=r"Recorder: images must be \(world, height, width, 3\) uint8, got"):
        recorder.add(images.float())
    recorder.add(images)
    with pytest.raises(
        WarpcamError, match=r"Recorder: images must stay \(2, 4, 4, 3\) uint8 on cpu, got \(3, 4, 4, 3\)"
    ):
        recorder.add(torch.zeros((3, 4, 4, 3), dtype=torch.uint8))
    recorder.close()
    with pytest.raises(WarpcamError, match=r"Recorder: .*video.mp4' is closed"):
        recorder.add(images)
