"""Artefacts of JPEG, beside those of libjpeg by way of Pillow."""

import io
from typing import Any

import numpy as np
import pytest
import warp as wp
from measured_colors import measured, picture
from PIL import Image

import warpcam as wc
from warpcam import sensors

MODES = {"4:4:4": 0, "4:2:0": 2}  # Pillow's numbers


def bytes_of(image: np.ndarray) -> np.ndarray:
    return np.rint(255.0 * np.clip(image, 0.0, 1.0)).astype(np.uint8)


def coded_by_pillow(image: np.ndarray, quality: int, subsampling: str) -> np.ndarray:
    file = io.BytesIO()
    Image.fromarray(bytes_of(image)).save(file, "JPEG", quality=quality, subsampling=MODES[subsampling])
    return np.asarray(Image.open(file)) / 255.0


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10.0 * np.log10(((one - other) ** 2).mean()))


@pytest.mark.parametrize("quality", [5, 30, 50, 75, 95, 100])
def test_images_are_those_of_libjpeg(quality: int, device: wp.Device) -> None:
    """Blocks with chroma of full resolution are its own, but for rounding."""
    image = picture(64, 80, 1)
    found = measured(sensors.JpegArtifacts(quality, "4:4:4"), image, device)[0]
    expected = coded_by_pillow(image[0], quality, "4:4:4")
    assert psnr(found, expected) > 45.0
    assert abs(psnr(found, image[0]) - psnr(expected, image[0])) < (0.1 if quality < 100 else 0.8)
    assert np.abs(255.0 * found - np.rint(255.0 * found)).max() < 1e-3


@pytest.mark.parametrize("quality", [10, 50, 75, 95])
def test_chroma_of_half_resolution_is_as_good_as_that_of_libjpeg(quality: int, device: wp.Device) -> None:
    image = picture(64, 80, 1)
    found = measured(sensors.JpegArtifacts(quality, "4:2:0"), image, device)[0]
    expected = coded_by_pillow(image[0], quality, "4:2:0")
    assert psnr(found, expected) > 30.0
    assert abs(psnr(found, image[0]) - psnr(expected, image[0])) < 1.0
    luma = (0.299, 0.587, 0.114)
    assert psnr(found @ luma, expected @ luma) > 40.0


def doubled(chroma: np.ndarray, axis: int) -> np.ndarray:
    """Numbers at the middles of both halves of each, on lines between neighbours; the ends go on as they are."""
    padded = np.concatenate([chroma.take([0], axis), chroma, chroma.take([-1], axis)], axis)
    places = np.arange(2 * chroma.shape[axis]) / 2.0 + 0.75  # of the padded numbers
    low = places.astype(int)
    share = np.expand_dims(places - low, tuple(range(1, chroma.ndim - axis)))
    return (1.0 - share) * padded.take(low, axis) + share * padded.take(low + 1, axis)


@pytest.mark.parametrize("shape", [(24, 40), (21, 35)])
def test_chroma_of_half_resolution_is_interpolated(shape: tuple[int, int], device: wp.Device) -> None:
    """Chroma that differs from pair to pair of rows and columns comes back on lines across and down, as of libjpeg."""
    height, width = shape
    half = np.random.default_rng(5).uniform(-40.0, 40.0, (-(-height // 2), -(-width // 2), 2))
    to_blue, to_red = np.moveaxis(half.repeat(2, 0).repeat(2, 1)[:height, :width], 2, 0)
    grey = np.full(shape, 128.0)
    rgb = np.stack([grey + 1.402 * to_red, grey - 0.344136 * to_blue - 0.714136 * to_red, grey + 1.772 * to_blue], -1)
    image = (np.rint(rgb) / 255.0).astype(np.float32)
    expected = doubled(doubled(half, 0), 1)[:height, :width]
    found = measured(sensors.JpegArtifacts(100, "4:2:0"), image[None], device)[0]
    for decoded in (found, coded_by_pillow(image, 100, "4:2:0")):
        red, green, blue = np.moveaxis(255.0 * decoded, 2, 0)
        luma = 0.299 * red + 0.587 * green + 0.114 * blue
        chroma = np.stack([(blue - luma) / 1.772, (red - luma) / 1.402], -1)
        assert np.abs(chroma - expected).max() < 3.0


@pytest.mark.parametrize("shape", [(1, 1), (7, 9), (17, 33)])
@pytest.mark.parametrize("subsampling", ["4:4:4", "4:2:0"])
def test_images_end_within_blocks(shape: tuple[int, int], subsampling: Any, device: wp.Device) -> None:
    image = np.full((1, *shape, 3), 0.3, np.float32) if shape == (1, 1) else picture(*shape, 1)
    found = measured(sensors.JpegArtifacts(60, subsampling), image, device)[0]
    expected = coded_by_pillow(image[0], 60, subsampling)
    assert psnr(found, expected) > (38.0 if subsampling == "4:4:4" else 28.0)


def test_quality_is_of_each_world(device: wp.Device) -> None:
    image = np.repeat(picture(32, 32, 1), 3, axis=0)
    found = measured(sensors.JpegArtifacts([10, 50, 95]), image, device)
    errors = [psnr(each, image[0]) for each in found]
    assert errors[0] < errors[1] - 2.0 < errors[2] - 4.0


@pytest.mark.parametrize("subsampling", ["4:2:2", None, 2, np.array(["4:4:4", "4:2:0"])])
def test_other_subsampling_is_refused(subsampling: Any) -> None:
    with pytest.raises(wc.WarpcamError, match="subsampling must be '4:4:4', '4:2:0', got"):
        measured(sensors.JpegArtifacts(50, subsampling), picture(), wp.get_device("cpu"))
