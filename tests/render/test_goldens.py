"""Images of one feature each, against those that were kept: a change of appearance is seen, and told in the changelog.

WARPCAM_WRITE_GOLDENS=1 pytest tests/render/test_goldens.py        # keeps the images of today

An image that differs is left in the test's folder: what was kept, what came, and eight times their difference.
"""

import os
from collections.abc import Callable
from pathlib import Path

import color_pictures
import depth_pictures
import golden_scenes
import lidar_pictures
import numpy as np
import pytest
import shutter_pictures
import warp as wp
from golden_scenes import FEATURES, PICTURES
from PIL import Image

from warpcam import sensors

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

FOLDER = Path(__file__).parent / "goldens"
# What may differ, of 255, before it counts, and how much of a picture may; devices round differently.
LARGEST, FEW, MEAN, FLIP = 6, 0.004, 0.4, 0.01
LIDAR_ERRORS = ("lidar_noise", "lidar_dropout")


def kept(feature: str) -> np.ndarray:
    return np.asarray(Image.open(FOLDER / f"{feature}.png").convert("RGB"))


def complaints(reference: np.ndarray, image: np.ndarray) -> list[str]:
    """Describe the difference of two images, channel by channel."""
    found = []
    off = np.abs(reference.astype(np.float64) - image)
    for channel, name in enumerate(("red", "green", "blue")):
        many = (off[..., channel] > LARGEST).mean()
        if many > FEW:
            found.append(f"{name}: {many:.1%} of the pixels are off by more than {LARGEST}")
        if off[..., channel].mean() > MEAN:
            found.append(f"{name}: off by {off[..., channel].mean():.2f} in the mean")
    if found:
        return found  # FLIP, which takes longer than all else, has nothing to decide
    try:
        import flip_evaluator
    except ImportError:
        return found
    as_floats = (np.ascontiguousarray(picture, np.float32) / 255.0 for picture in (reference, image))
    flip = flip_evaluator.evaluate(*as_floats, "LDR", applyMagma=False)[1]
    return [f"FLIP is {flip:.3f}"] if flip > FLIP else []


@pytest.mark.parametrize("feature", PICTURES)
def test_looks_as_it_did(device: wp.Device, feature: str, tmp_path: Path) -> None:
    image, path = PICTURES[feature](device), FOLDER / f"{feature}.png"
    if os.environ.get("WARPCAM_WRITE_GOLDENS"):
        path.parent.mkdir(exist_ok=True)
        Image.fromarray(image).save(path, optimize=True)
    found = complaints(kept(feature), image)
    if found:
        found.append(f"see {keep_difference(kept(feature), image, tmp_path / f'{feature}.png')}")
    assert found == []


def keep_difference(reference: np.ndarray, image: np.ndarray, path: Path) -> Path:
    """Save the two beside each other, with eight times their difference."""
    off = np.clip(8 * np.abs(reference.astype(int) - image), 0, 255).astype(np.uint8)
    Image.fromarray(np.concatenate([reference, image, off], axis=1)).save(path)
    return path


def test_a_difference_is_left_to_look_at(tmp_path: Path) -> None:
    reference, image = np.full((4, 5, 3), 100, np.uint8), np.full((4, 5, 3), 97, np.uint8)
    image[2, 3] = 0
    three = np.asarray(Image.open(keep_difference(reference, image, tmp_path / "difference.png")))
    assert three.shape == (4, 15, 3) and (three[:, :5] == reference).all() and (three[:, 5:10] == image).all()
    assert three[0, 10, 0] == 24 and three[2, 13, 0] == 255


def test_each_picture_that_is_kept_is_compared() -> None:
    assert {path.stem for path in FOLDER.glob("*.png")} == set(PICTURES)


def test_each_effect_has_a_picture() -> None:
    """A delivery changes no image."""
    public = [getattr(sensors, name) for name in sensors.__all__]
    kinds = {each for each in public if isinstance(each, type) and issubclass(each, sensors.Effect)}
    pictures = (color_pictures.COLOR_EFFECTS, depth_pictures.DEPTH_EFFECTS, shutter_pictures.SHUTTERS)
    shown = [type(effect) for effects in pictures for effect in effects.values()]
    assert set(shown) == kinds - {sensors.Effect, sensors.Delivery}


FAULTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "zeroed red": lambda image: image * np.array([0, 1, 1], np.uint8),
    "zeroed green": lambda image: image * np.array([1, 0, 1], np.uint8),
    "zeroed blue": lambda image: image * np.array([1, 1, 0], np.uint8),
    "swapped channels": lambda image: image[..., ::-1],
    "one-pixel shift": lambda image: np.roll(image, 1, axis=1),
    "one-pixel shift down": lambda image: np.roll(image, 1, axis=0),
    "flip": lambda image: image[:, ::-1],
    "upside down": lambda image: image[::-1],
}


@pytest.mark.parametrize("feature", PICTURES)
def test_faults_are_seen_in_each_picture(feature: str) -> None:
    image = kept(feature)
    assert complaints(image, image) == []
    assert [fault for fault, plant in FAULTS.items() if not complaints(image, plant(image))] == []


@pytest.mark.parametrize("feature", ["two_lights", "shadow", "skybox", "texture"])
def test_a_missing_object_is_seen(device: wp.Device, monkeypatch: pytest.MonkeyPatch, feature: str) -> None:
    world, assets = FEATURES[feature]
    objects = [golden_scenes.shape(kind) for kind in ("sphere", "box", "cylinder")]
    objects.append('<geom type="plane" size="2 2 1" material="m"/>')
    (present,) = (one for one in objects if one in world)
    monkeypatch.setitem(FEATURES, feature, (world.replace(present, ""), assets))
    assert complaints(kept(feature), PICTURES[feature](device))


@pytest.mark.parametrize(
    "feature",
    [*color_pictures.COLOR_EFFECTS, *depth_pictures.DEPTH_EFFECTS, *shutter_pictures.SHUTTERS, *LIDAR_ERRORS],
)
def test_a_missing_effect_is_seen(device: wp.Device, feature: str) -> None:
    if feature in color_pictures.COLOR_EFFECTS:
        image = color_pictures.without(feature)
    elif feature in depth_pictures.DEPTH_EFFECTS:
        image = depth_pictures.without(feature, device)
    elif feature in LIDAR_ERRORS:
        image = lidar_pictures.without(feature, device)
    else:
        image = shutter_pictures.frozen(feature, device)
    assert complaints(kept(feature), image)
