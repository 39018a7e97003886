"""Vignetting, colour fringes, blur and sharpening against numpy."""

import numpy as np
import pytest
import torch
import warp as wp
from measured_colors import Bench, measured, picture
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors
from warpcam.kernels.types import View


def view(focal_length: float, center: tuple[float, float]) -> View:
    """A pinhole camera with square pixels; both in pixels."""
    result = View()
    result.scale, result.center = wp.vec2(1.0 / focal_length), wp.vec2(*center)
    return result


def blurred(image: np.ndarray, sigma: float) -> np.ndarray:
    """Separable Gaussian of one image (height, width, 3), the border repeated."""
    radius = int(np.ceil(3.0 * sigma))
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        widths = [(radius, radius) if each == axis else (0, 0) for each in range(3)]
        padded = np.pad(image, widths, mode="edge")
        image = np.apply_along_axis(np.convolve, axis, padded, weights, mode="valid")
    return image


def magnified(channel: np.ndarray, factor: float) -> np.ndarray:
    """One channel (height, width), magnified about its middle, bilinearly."""
    height, width = channel.shape
    rows, columns = (
        np.clip((size - 1) / 2 + (np.arange(size) - (size - 1) / 2) / factor, 0.0, size - 1) for size in (height, width)
    )
    across = np.stack([np.interp(columns, np.arange(width), line) for line in channel])
    return np.stack([np.interp(rows, np.arange(height), line) for line in across.T]).T


def test_light_falls_off_with_the_fourth_power_of_the_cosine(device: wp.Device) -> None:
    light = picture()
    height, width = light.shape[1:3]
    views = [view(15.0, (width / 2, height / 2)), view(40.0, (3.0, 7.0))]
    found = measured(sensors.NaturalVignetting([1.0, 0.5]), light, device, views=views)
    y, x = np.mgrid[:height, :width] + 0.5
    for world, (focal, cx, cy, strength) in enumerate(((15.0, width / 2, height / 2, 1.0), (40.0, 3.0, 7.0, 0.5))):
        cosine = np.cos(np.arctan(np.hypot(x - cx, y - cy) / focal))
        factor = 1.0 + strength * (cosine**4 - 1.0)
        assert np.allclose(found[world], factor[..., None] * light[world], atol=1e-6)


@pytest.mark.parametrize("lens", [wc.Orthographic(height=4.0), wc.Fisheye(fovy=100.0)], ids=["parallel", "fisheye"])
def test_natural_falloff_is_of_pinholes(lens: wc.Lens) -> None:
    eye = camera("eye", lens=lens, position=(0.0, 0.0, 5.0), outputs=("rgb",))
    renderer = wc.Renderer(scene_of("cpu", 1), [eye])
    with pytest.raises(wc.WarpcamError, match="NaturalVignetting needs a camera with a pinhole lens"):
        sensors.Rig(renderer, {"eye": [sensors.NaturalVignetting()]})
    sensors.Rig(renderer, {"eye": [sensors.Vignetting((-0.5, 0.0, 0.0))]}).read()


def test_falloff_by_a_polynomial(device: wp.Device) -> None:
    light = picture()
    height, width = light.shape[1:3]
    coefficients, centers = np.array([[-0.9, 0.3, -0.1], [-9.0, 1.0, 0.0]]), np.array([[0.0, 0.0], [0.1, -0.2]])
    found = measured(sensors.Vignetting(coefficients, centers), light, device)
    y, x = np.mgrid[:height, :width] + 0.5
    for world in range(2):
        dx, dy = (x - width / 2) / width - centers[world, 0], (y - height / 2) / width - centers[world, 1]
        square = dx * dx + dy * dy
        factor = np.clip(1.0 + np.polyval([*coefficients[world, ::-1], 0.0], square), 0.0, 1.0)
        assert np.allclose(found[world], factor[..., None] * light[world], atol=1e-6)
    assert (found[1] == 0.0).any()


def test_red_and_blue_are_magnified(device: wp.Device) -> None:
    light = picture()
    found = measured(sensors.ChromaticAberration([1.02, 0.9], [0.97, 1.3]), light, device)
    for world, (red, blue) in enumerate(((1.02, 0.97), (0.9, 1.3))):
        assert np.allclose(found[world, ..., 0], magnified(light[world, ..., 0], red), atol=1e-5)
        assert (found[world, ..., 1] == light[world, ..., 1]).all()
        assert np.allclose(found[world, ..., 2], magnified(light[world, ..., 2], blue), atol=1e-5)
    assert (measured(sensors.ChromaticAberration(), light, device) == light).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (2, 7)])
def test_small_images_have_neighbors_of_their_own(shape: tuple[int, int], device: wp.Device) -> None:
    light = picture(*shape, worlds=1) if max(shape) > 1 else np.full((1, 1, 1, 3), 0.3, np.float32)
    found = measured(sensors.ChromaticAberration(1.5, 0.6), light, device)
    assert np.allclose(found[0, ..., 0], magnified(light[0, ..., 0], 1.5), atol=1e-5)
    assert np.allclose(measured(sensors.Blur(1.0), light, device)[0], blurred(light[0], 1.0), atol=1e-5)


def test_a_blur_that_is_written_in_place_stays_bounded(device: wp.Device) -> None:
    """No thread goes through more pixels than the widest Gaussian has, whatever is written."""
    light = picture(worlds=5)
    sigma = torch.full((5,), 10.0, device=wp.device_to_torch(device))
    measure = Bench(sensors.Blur(sigma), light, device)
    widest = measure().copy()
    sigma[:] = torch.tensor([10.5, 300.0, 3000.0, float("nan"), -1.0])
    found = measure()
    assert (found[:3] == widest[:3]).all()
    assert (found[3:] == light[3:]).all() and (widest[3:] != light[3:]).any()


def test_blur_is_a_gaussian(device: wp.Device) -> None:
    """Narrow and wide ones side by side, in images that end within what a thread has."""
    light = picture(37, 21, worlds=5)
    found = measured(sensors.Blur([0.4, 1.0, 2.7, 9.0, 0.0]), light, device)
    for world, sigma in enumerate((0.4, 1.0, 2.7, 9.0)):
        assert np.allclose(found[world], blurred(light[world], sigma), atol=1e-5)
    assert (found[4] == light[4]).all()


def test_sharpening_adds_what_blur_takes(device: wp.Device) -> None:
    display = picture()
    found = measured(sensors.Sharpening([0.5, 2.0], [1.3, 0.6]), display, device)
    for world, (amount, sigma) in enumerate(((0.5, 1.3), (2.0, 0.6))):
        expected = display[world] + amount * (display[world] - blurred(display[world], sigma))
        assert np.allclose(found[world], expected, atol=2e-5)
