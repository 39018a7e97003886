"""Images of a clear sky and its sun."""

import math
import re
from typing import Any

import numpy as np
import pytest
import sky_images
import warp as wp

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pbr_scenes import FOVY, SIZE, add_ball, ball_normals
from pxr import Usd

HEIGHT = 128
LUMINANCE = np.array((0.2126, 0.7152, 0.0722))
AREAS, AROUND = sky_images.angles(HEIGHT, 2 * HEIGHT), sky_images.directions(HEIGHT, 2 * HEIGHT)
UP = AROUND[..., 2] > 0.0


def toward(elevation: float, azimuth: float = 40.0) -> np.ndarray:
    e, a = np.radians(elevation), np.radians(azimuth)
    return np.array((np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)))


def test_luminance_of_the_sky() -> None:
    """With the paper's numbers for a turbidity of 3, place by place."""
    sun = toward(35.0)
    seen = wc.Environments.sky(7.0 * sun, 3.0, sun=False, height=HEIGHT) @ LUMINANCE * 30.0  # [kcd/m^2]
    theta = math.radians(55.0)
    zenith = (4.0453 * 3.0 - 4.9710) * math.tan((4 / 9 - 3 / 120) * (math.pi - 2.0 * theta)) - 0.2155 * 3.0 + 2.4192

    def perez(cosine: float, gamma: float) -> float:
        return (1.0 - 0.9269 * math.exp(-0.6387 / cosine)) * (
            1.0 + 5.257 * math.exp(-2.2153 * gamma) + 0.1693 * math.cos(gamma) ** 2
        )

    for row, column in ((0, 0), (20, 40), (30, 200), (45, 99), (60, 128)):
        cosine, gamma = AROUND[row, column, 2], math.acos(AROUND[row, column] @ sun)
        wanted = zenith * perez(cosine, gamma) / perez(1.0, theta)
        assert seen[row, column] == pytest.approx(wanted, rel=2e-3)  # the sRGB matrix has four digits


@pytest.mark.parametrize("turbidity", [2.0, 6.0])
@pytest.mark.parametrize("elevation", [80.0, 30.0, 5.0])
def test_the_sun(elevation: float, turbidity: float) -> None:
    """It is a disk around its direction, air makes it red, and the ground is as bright as what falls on it."""
    sun = toward(elevation)
    whole, sky = (
        wc.Environments.sky(sun, turbidity, albedo=0.5, sun=there, height=HEIGHT).astype(np.float64)
        for there in (True, False)
    )
    disk = np.where(UP[..., None], whole - sky, 0.0) * AREAS[..., None]
    beam = disk.sum(axis=(0, 1))
    middle = (AROUND * (disk @ LUMINANCE)[..., None]).sum(axis=(0, 1))
    middle /= np.linalg.norm(middle)
    assert np.degrees(np.arccos(middle @ sun)) < 0.7  # a texel has 1.4 degrees
    assert (disk[AROUND @ sun < np.cos(np.radians(3.0))] == 0.0).all()
    assert beam[0] > beam[1] > beam[2]
    for image, direct in ((whole, beam), (sky, 0.0)):
        own = np.where(UP[..., None], sky, 0.0)
        falling = (own * (AREAS * np.maximum(AROUND[..., 2], 0.0))[..., None]).sum(axis=(0, 1)) + direct * sun[2]
        np.testing.assert_allclose(image[-1, 0], 0.5 / np.pi * falling, rtol=2e-3)
    illuminance = beam @ LUMINANCE * 30.0  # [klx]
    assert illuminance < 133.0
    if turbidity == 2.0 and elevation == 80.0:
        assert illuminance == pytest.approx(110.0, abs=8.0)  # of a clear noon


def test_colours() -> None:
    """The zenith is blue; at dusk the horizon below the sun is red, and all is darker."""
    noon, dusk = (wc.Environments.sky(toward(e), 3.0, sun=False, height=HEIGHT) for e in (60.0, 3.0))
    assert noon[0, 0, 2] > 1.3 * noon[0, 0, 0]
    below = dusk[HEIGHT // 2 - 2, round(HEIGHT * (1.0 - 40.0 / 180.0))]
    assert below[0] > 2.0 * below[2]
    assert dusk[UP].mean() < 0.4 * noon[UP].mean()


@pytest.mark.parametrize("look", ["pbr", "path"])
@pytest.mark.usefixtures("small_maps")
def test_each_world_has_its_sky(stage: Usd.Stage, look: str, device: wp.Device) -> None:
    add_ball(stage, diffuseColor=(1.0, 1.0, 1.0), ior=1.0)
    scene = wc.from_usd(stage, 2, device=device, exposure=0.0)
    suns = np.array((0.3, 0.5, 0.8)), np.array((-0.9, 0.1, 0.4))
    skies = [wc.Environments.sky(sun, 3.0, sun=False, height=64) for sun in suns]
    environments = wc.Environments(scene, skies, index=[1, 0])
    camera = wc.Camera(
        "c", width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=FOVY), position=(0.0, 0.0, 0.0), outputs=("hdr",)
    )
    paths = wc.PathOptions(samples=32) if look == "path" else None
    renderer = wc.Renderer(scene, [camera], look=look, path=paths, environments=environments)
    hit, normals, _ = ball_normals()
    seen = renderer.render()["c"]["hdr"].cpu().numpy()[:, hit]
    for world, sky in enumerate(skies[::-1]):
        truth = sky_images.irradiance(sky, normals)
        assert seen[world].mean() == pytest.approx(truth.mean(), rel=0.02)
        assert np.abs(seen[world] - truth).mean() < 0.12 * truth.mean()


@pytest.mark.parametrize("length", [1e-200, 1e200])
def test_a_sun_direction_may_have_any_length(length: float) -> None:
    sky = wc.Environments.sky((0.6 * length, 0.0, 0.8 * length), height=16)
    np.testing.assert_allclose(sky, wc.Environments.sky((0.6, 0.0, 0.8), height=16), rtol=1e-6)


def test_refusals() -> None:
    cases: tuple[tuple[Any, dict[str, Any], str], ...] = (
        ((1.0, 0.0, 0.0), {}, "sun_direction must be above the horizon, +z is up, got (1.0, 0.0, 0.0)"),
        ((0.0, 0.0, 0.0), {}, "sun_direction must be three finite numbers, not all 0"),
        ((1.0, 1.0), {}, "sun_direction must be three finite numbers"),
        ((0.0, 0.0, np.nan), {}, "sun_direction must be three finite numbers"),
        ("noon", {}, "sun_direction must be three numbers, got 'noon'"),
        ((0, 0, 1), {"turbidity": 1.0}, "turbidity must be a number from 2 to 10, got 1.0"),
        ((0, 0, 1), {"albedo": 1.5}, "albedo must be a number from 0 to 1, got 1.5"),
        ((0, 0, 1), {"sun": "yes"}, "sun must be True or False, got 'yes'"),
        ((0, 0, 1), {"height": 5000}, "height must be a whole number from 8 to 4096, got 5000"),
        ((0, 0, 1), {"height": 64.0}, "height must be a whole number from 8 to 4096, got 64.0"),
    )
    for sun, options, says in cases:
        with pytest.raises(wc.WarpcamError, match=re.escape(f"Environments.sky: {says}")):
            wc.Environments.sky(sun, **options)
