"""Maps of images of light from all around: what lobes of microfacets see, and mipmaps, beside sums over all texels."""

import functools
from typing import Any

import numpy as np
import pytest
import sky_images
import warp as wp
from native_kernel import native_kernel

import warpcam as wc
from warpcam.kernels.types import EnvironmentMaps

pytest.importorskip("pxr.Usd")
from pbr_scenes import add_ball
from pxr import Usd

HEIGHT, WIDTH = 128, 256


@wp.func_native("""
    const warpcam::Environment environment = warpcam::load_environment(maps, 0);
    const warpcam::Vec3 d = warpcam::as_vec3(wp::index(directions, i));
    const warpcam::Vec3 none { 0.0f, 0.0f, 0.0f }, right { wide, 0.0f, 0.0f };
    const warpcam::Vec3 light = alpha < 0.0f ? warpcam::environment_behind(environment, d, right, none)
                                             : warpcam::lobe_of(environment, d, alpha);
    wp::index(seen, i) = wp::vec3(light.x, light.y, light.z);
""")
def look_up(
    maps: EnvironmentMaps,
    directions: wp.array(dtype=wp.vec3),
    seen: wp.array(dtype=wp.vec3),
    alpha: float,
    wide: float,
    i: int,
): ...


@native_kernel("shading/environment_map.h")
def look(
    maps: EnvironmentMaps,
    directions: wp.array(dtype=wp.vec3),
    seen: wp.array(dtype=wp.vec3),
    alpha: wp.float32,
    wide: wp.float32,
):
    look_up(maps, directions, seen, alpha, wide, wp.tid())


def seen_in(environments: wc.Environments, directions: np.ndarray, alpha: float, wide: float = 0.0) -> np.ndarray:
    struct: Any = environments.tables(paths=False)[0]
    environments.stage().launch()
    device = struct.texels.device
    places = wp.array(directions, dtype=wp.vec3, device=device)
    seen = wp.zeros(len(directions), dtype=wp.vec3, device=device)
    wp.launch(look, len(directions), [struct, places, seen, alpha, wide], device=device)
    return seen.numpy()


def lobes(directions: np.ndarray, alpha: float) -> np.ndarray:
    """Means over all texels, weighted by GGX's facets seen straight on and the cosine, (n, 3)."""
    texels = sky_images.directions(2 * HEIGHT, 2 * WIDTH).reshape(-1, 3)
    light = sky_images.bumpy_radiance(texels)
    areas = np.repeat(sky_images.angles(2 * HEIGHT, 2 * WIDTH)[:, 0], 2 * WIDTH)
    sums = []
    for direction in directions:
        cosine = np.maximum(texels @ direction, 0.0)
        half = 0.5 * (1.0 + cosine)  # squared cosine of the facet's angle, which is half of the light's
        weight = areas * cosine / (half * (alpha**2 - 1.0) + 1.0) ** 2 * (cosine > 0.0)
        sums.append(weight @ light / weight.sum())
    return np.array(sums)


@functools.cache
def environments_on(device: str) -> wc.Environments:
    """One for all tests: its maps take longer than what is read of them."""
    stage = Usd.Stage.CreateInMemory()
    add_ball(stage)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    return wc.Environments(scene, sky_images.image_of(sky_images.bumpy_radiance, HEIGHT, WIDTH))


@pytest.fixture
def environments(device: wp.Device) -> wc.Environments:
    return environments_on(device.alias)


def places(count: int) -> np.ndarray:
    """Directions all around, among them ones at the map's edges and corners."""
    drawn = np.random.default_rng(5).normal(size=(count - 6, 3))
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    return np.concatenate((np.eye(3), -np.eye(3), drawn))


@pytest.mark.parametrize("alpha", [1.0, 0.7, 0.5, 0.25, 0.125, 0.0625])
def test_lobes(environments: wc.Environments, alpha: float) -> None:
    directions = places(60)
    truth = lobes(directions, alpha)
    error = np.abs(seen_in(environments, directions, alpha) - truth)
    assert error.mean() < 0.015 * truth.mean()
    assert error.max() < 0.03 * truth.max()


def test_a_mirror(environments: wc.Environments) -> None:
    directions = places(200)
    np.testing.assert_allclose(seen_in(environments, directions, 0.0), sky_images.bumpy_radiance(directions), rtol=0.02)


def test_wide_pixels(environments: wc.Environments) -> None:
    """A pixel that covers much shows the mean of what it covers: with all around in one, that of everything."""
    directions = places(60)
    truth = sky_images.bumpy_radiance(directions)
    fine = seen_in(environments, 3.0 * directions, -1.0, 3.0 * 1e-4)
    np.testing.assert_allclose(fine, truth, rtol=0.02)
    wide = 0.1
    error = np.abs(seen_in(environments, 3.0 * directions, -1.0, 3.0 * wide) / truth - 1.0)
    assert 2e-3 < error.mean() < 0.05
    rough = seen_in(environments, directions, -1.0, 10.0).mean(axis=0)
    areas = sky_images.angles(HEIGHT, WIDTH)[..., None] / (4.0 * np.pi)
    mean = (areas * sky_images.bumpy_radiance(sky_images.directions(HEIGHT, WIDTH))).sum(axis=(0, 1))
    np.testing.assert_allclose(rough, mean, rtol=0.5)
