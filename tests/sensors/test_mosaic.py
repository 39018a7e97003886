"""Bayer mosaics: filters, and interpolation against numpy."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from measured_colors import measured, picture
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors

CROSS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4
# Filters of Malvar, He and Cutler, eight times each: green at red or blue; red in a row of reds; in a column of reds;
# red at blue.
GREEN = [[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]
IN_ROW = [[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]]
AT_OTHER = [[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]]


def filtered(mosaic: np.ndarray, weights: Any) -> np.ndarray:
    weights = np.asarray(weights, np.float64)
    reach = len(weights) // 2
    padded = np.pad(mosaic, reach, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, weights.shape)
    return np.einsum("yxij,ij->yx", windows, weights)


def channels(filters: str, height: int, width: int) -> np.ndarray:
    """Channel that each pixel measures, (height, width)."""
    y, x = np.mgrid[:height, :width]
    return np.array(["RGB".index(letter) for letter in filters])[2 * (y % 2) + x % 2]


def demosaiced(image: np.ndarray, filters: str, interpolation: str) -> np.ndarray:
    channel = channels(filters, *image.shape[:2])
    mosaic = np.take_along_axis(image, channel[..., None], axis=-1)[..., 0].astype(np.float64)
    result = np.empty_like(image, dtype=np.float64)
    red_rows = (channel == 0).any(axis=1)[:, None]
    if interpolation == "bilinear":
        green, at_other = filtered(mosaic, CROSS), filtered(mosaic, np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]]) / 4)
        in_row, in_column = filtered(mosaic, [[0, 0, 0], [0.5, 0, 0.5], [0, 0, 0]]), filtered(mosaic, CROSS)
        in_column = 2.0 * in_column - in_row
    else:
        green, at_other = filtered(mosaic, GREEN) / 8, filtered(mosaic, AT_OTHER) / 8
        in_row, in_column = filtered(mosaic, IN_ROW) / 8, filtered(mosaic, np.transpose(IN_ROW)) / 8
    result[..., 1] = np.where(channel == 1, mosaic, green)
    for own, rows in ((0, red_rows), (2, ~red_rows)):
        at_green = np.where(rows, in_row, in_column)
        result[..., own] = np.where(channel == own, mosaic, np.where(channel == 1, at_green, at_other))
    return np.maximum(result, 0.0) if interpolation == "malvar" else result


@pytest.mark.parametrize("filters", ["RGGB", "BGGR", "GRBG", "GBRG"])
@pytest.mark.parametrize("interpolation", ["bilinear", "malvar"])
def test_mosaics_are_interpolated(filters: Any, interpolation: Any, device: wp.Device) -> None:
    light = picture(17, 22)
    found = measured(sensors.BayerMosaic(filters, interpolation), light, device)
    for world in range(2):
        assert np.allclose(found[world], demosaiced(light[world], filters, interpolation), atol=1e-5)
    own = channels(filters, 17, 22)
    for channel in range(3):
        assert (found[:, own == channel, channel] == light[:, own == channel, channel]).all()


@pytest.mark.parametrize("interpolation", ["bilinear", "malvar"])
def test_gray_stays(interpolation: Any, device: wp.Device) -> None:
    gray = np.full((1, 8, 8, 3), 0.4, np.float32)
    assert np.allclose(measured(sensors.BayerMosaic("GRBG", interpolation), gray, device), gray, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"filters": "RGB"}, "filters must be 'RGGB', 'BGGR', 'GRBG', 'GBRG', got 'RGB'"),
        ({"interpolation": "cubic"}, "interpolation must be 'bilinear', 'malvar', got 'cubic'"),
        ({"filters": np.array(["RGGB", "BGGR"])}, "filters must be 'RGGB', .* got array"),
        ({"filters": ["R"]}, r"filters must be 'RGGB', .* got \['R'\]"),
    ],
)
def test_bad_input_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        measured(sensors.BayerMosaic(**options), picture(), wp.get_device("cpu"))


@pytest.mark.parametrize("size", [(2, 8), (8, 2)])
def test_small_images_are_refused(size: tuple[int, int]) -> None:
    renderer = wc.Renderer(scene_of("cpu", 1), [camera(outputs=("rgb",), width=size[0], height=size[1])])
    with pytest.raises(
        wc.WarpcamError,
        match=f"Rig: 'top': BayerMosaic needs images of at least 3 x 3 pixels, got {size[0]} x {size[1]}",
    ):
        sensors.Rig(renderer, {"top": [sensors.BayerMosaic()]})
