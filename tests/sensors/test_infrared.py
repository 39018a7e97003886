"""Infrared images: light of scene and projector, shadows of the projector, noise, and the pattern of dots."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from stereo_scenes import BASELINE, FOCAL, PLAIN, SIZE, eye, read, scene_of, stereo_of, wall

import warpcam as wc
from warpcam import sensors
from warpcam.core.color import srgb_to_linear

LUMINANCE = float(srgb_to_linear(np.float64(204.0 / 255.0)))  # of the plain wall's albedo
EVEN = sensors.DotProjector(pattern=np.ones((1, 1)))
BOX = '<geom type="box" size=".1 .15 .05" pos=".05 0 -.85" rgba=".8 .8 .8 1"/>'
DARK = {"ambient": 0.0, "noise": None}


def rays() -> np.ndarray:
    """Directions (height, width, 3) of pixels, of length 1 along the view."""
    column, row = np.meshgrid(np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2, np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2)
    return np.stack([column / FOCAL, -row / FOCAL, -np.ones_like(row)], axis=-1)


@pytest.mark.parametrize("position", [None, (0.2, -0.1, 0.05)])
def test_light_of_a_projector_follows_its_formula(device: wp.Device, position: Any) -> None:
    projector = sensors.DotProjector(intensity=[1.0, 0.5], pattern=np.ones((2, 3)), position=position, fovx=80, fovy=70)
    images = read(stereo_of(wall(1.1, PLAIN, "0 25 0"), device, 2, projector=projector, **DARK))
    place = np.array((0.5 * BASELINE, 0.0, 0.0) if position is None else position)
    normal = np.array((np.sin(np.radians(25.0)), 0.0, np.cos(np.radians(25.0))))
    for name, origin in (("infrared_left", np.zeros(3)), ("infrared_right", np.array((BASELINE, 0.0, 0.0)))):
        along = ((np.array((0.0, 0.0, -1.1)) - origin) @ normal) / (rays() @ normal)
        away = origin + along[..., None] * rays() - place
        distance = np.linalg.norm(away, axis=-1)
        light = LUMINANCE * -(away @ normal) / distance**3
        local = np.abs(away[..., :2] / away[..., 2:])
        edges = np.tan(np.radians((40.0, 35.0)))
        inside, outside = (local < 0.99 * edges).all(axis=-1), (local > 1.01 * edges).any(axis=-1)
        for world, intensity in enumerate((1.0, 0.5)):
            image = images[name][world]
            assert np.abs(image - 255.0 * np.minimum(intensity * light, 1.0))[inside].max() < 1.01
            assert (image[outside] == 0).all()
        assert inside.mean() > 0.5


def test_what_stands_before_a_wall_keeps_dots_from_it(device: wp.Device) -> None:
    """Left of the box, seen from a projector to the right of it."""
    projector = sensors.DotProjector(pattern=np.ones((1, 1)), position=(0.35, 0.0, 0.0), fovx=100.0, fovy=80.0)
    stereo = stereo_of(wall(1.5, PLAIN) + BOX, device, projector=projector, **DARK)
    image, truth = read(stereo)["infrared_left"][0], stereo.truth.cpu().numpy()[0, ..., 0]
    points = truth[..., None] * rays()
    on_wall = truth > 1.4
    light = np.array((0.35, 0.0, 0.0))
    margins = {}
    for margin in (-0.02, 0.02):  # a box somewhat smaller, and somewhat larger
        low, high = np.array((-0.05, -0.15, -0.9)) - margin, np.array((0.15, 0.15, -0.8)) + margin
        with np.errstate(divide="ignore", invalid="ignore"):
            bounds = (np.stack([low, high])[:, None, None] - light) / (points - light)
        enter, leave = np.nanmax(bounds.min(axis=0), axis=-1), np.nanmin(bounds.max(axis=0), axis=-1)
        margins[margin] = on_wall & (enter < leave) & (enter > 0.0) & (enter < 1.0)
    assert margins[-0.02].sum() > 500
    assert (image[margins[-0.02]] == 0).all()
    assert (image[on_wall & ~margins[0.02]] > 0).all()
    assert (image[truth < 0.81] > 0).all()  # no surface shades itself


@pytest.mark.parametrize("turn", ["0 60 0", "70 0 0", "45 45 0"])
def test_slanted_surfaces_do_not_shade_themselves(device: wp.Device, turn: str) -> None:
    projector = sensors.DotProjector(intensity=9.0, pattern=np.ones((1, 1)), fovx=90.0, fovy=90.0)
    stereo = stereo_of(wall(1.0, PLAIN, turn), device, projector=projector, **DARK)
    image, truth = read(stereo)["infrared_left"], stereo.truth.cpu().numpy()[..., 0]
    assert (image[truth < 2.5] > 0).all() and (truth < 2.5).mean() > 0.5


def test_the_scenes_light_is_luminance(device: wp.Device) -> None:
    display = np.array((0.2, 0.6, 0.8))
    camera = eye(background=display)
    scene = scene_of('<geom size=".01" pos="0 0 9"/>', 2, device)
    stereo = sensors.StereoCamera(scene, camera, baseline=BASELINE, projector=None, noise=None, ambient=[1.0, 0.5])
    images = read(stereo)
    light = float(srgb_to_linear(np.rint(255.0 * display) / 255.0) @ (0.2126, 0.7152, 0.0722))
    for name in ("infrared_left", "infrared_right"):
        for world, share in enumerate((1.0, 0.5)):
            assert np.unique(images[name][world]).tolist() == [np.floor(255.0 * share * light + 0.5)]
    assert not images["depth"].any() and not images["disparity"].any()


@pytest.mark.parametrize(("speckle", "sigma", "offset"), [(1 / 1333.33, 0.25, 0.0), (0.0, 3.0, 5.0), (0.01, 1.0, -2.0)])
def test_noise_has_the_statistics_of_its_formula(
    device: wp.Device, speckle: float, sigma: float, offset: float
) -> None:
    """Of 1.2 million pixels of one level."""
    camera = wc.Camera(
        "eye", width=400, height=300, lens=wc.Pinhole(fovy=50.0), position=(0, 0, 0), background=(0.6, 0.6, 0.6)
    )
    scene = scene_of('<geom size=".01" pos="0 0 9"/>', 5, device)
    noise = sensors.InfraredNoise(speckle, sigma, offset)
    options = {"baseline": BASELINE, "projector": None, "ambient": 1.0, "noise": noise}
    matching = sensors.StereoMatching(max_disparity=16, block=(1, 1), census=(3, 1))
    images = read(sensors.StereoCamera(scene, camera, matching=matching, **options))
    values = np.stack([images["infrared_left"], images["infrared_right"]]).astype(np.float64)
    level = 255.0 * float(srgb_to_linear(np.float64(153.0 / 255.0)))
    variance = speckle * level**2 + sigma**2 + 1.0 / 12.0
    assert abs(values.mean() - level - offset) < 0.02
    assert abs(values.var() / variance - 1.0) < 0.02
    skewness = ((values - values.mean()) ** 3).mean() / values.std() ** 3
    assert abs(skewness - 2.0 * speckle**2 * level**3 / variance**1.5) < 0.02  # that of a gamma distribution
    left, right = (value - value.mean() for value in values)
    assert abs((left * right).mean()) < 0.01 * variance
    assert abs((left[:, :, 1:] * left[:, :, :-1]).mean()) < 0.01 * variance


def test_dots_are_as_many_and_as_large_as_asked() -> None:
    slide = sensors.DotProjector(dots=60, size=3.0).slide(160, 120)
    assert slide.shape == (240, 320) and slide.dtype == np.float32 and 0.9 < slide.max() <= 1.0
    peaks = slide[1:-1, 1:-1]
    around = np.stack([slide[1 + i : 239 + i, 1 + j : 319 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    assert 50 <= ((peaks == around.max(axis=0)) & (peaks > 0.8)).sum() <= 60
    single = sensors.DotProjector(dots=1, size=3.0).slide(40, 40)
    assert abs((single > 0.5).sum() - np.pi * 3.0**2) < 5.0  # two pixels of the slide for one of the camera
    assert (sensors.DotProjector(seed=1).slide(40, 30) == sensors.DotProjector(seed=1).slide(40, 30)).all()
    assert (sensors.DotProjector(seed=1).slide(40, 30) != sensors.DotProjector(seed=2).slide(40, 30)).any()


def test_a_pattern_of_ones_own_lies_over_the_cone(device: wp.Device) -> None:
    pattern = np.zeros((6, 8))
    pattern[0, 0] = 1.0
    projector = sensors.DotProjector(intensity=3.0, pattern=pattern, position=(0.0, 0.0, 0.0))
    image = read(stereo_of(wall(1.2, PLAIN), device, projector=projector, **DARK))["infrared_left"][0]
    assert image[: SIZE[1] // 6, : SIZE[0] // 8].min() > 0
    assert not image[SIZE[1] // 4 :].any() and not image[:, SIZE[0] // 4 :].any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dots": 0}, "dots must be a whole number of at least 1, or None, got 0"),
        ({"dots": 1.5}, "dots must be a whole number of at least 1, or None, got 1.5"),
        ({"seed": -1}, "seed must be a whole number of at least 0, got -1"),
        ({"size": 0.5}, "size must be a number of at least 1, got 0.5"),
        ({"fovx": 150.0}, r"fovx must be an angle in \(0, 150\) degrees, or None, got 150.0"),
        ({"fovy": "60"}, r"fovy must be an angle in \(0, 150\) degrees, or None, got '60'"),
        ({"position": (0.0, 1.0)}, r"position must be three numbers, or None, got \(0.0, 1.0\)"),
        ({"position": "left"}, "position must be three numbers, or None, got 'left'"),
        ({"pattern": np.ones(3)}, r"pattern must be \(rows, columns\) of numbers from 0 to 1, got shape \(3,\)"),
        ({"pattern": np.full((2, 2), 2.0)}, "pattern must be .* from 0 to 1, got 2"),
    ],
)
def test_projectors_that_cannot_be_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=f"DotProjector: {message}"):
        sensors.DotProjector(**options)
