"""Images of one feature each, against those that were kept: a change of appearance is seen, and told in the changelog.

WARPCAM_WRITE_GOLDENS=1 pytest tests/test_goldens.py        # keeps the images of today
"""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scenes
import warp as wp
from PIL import Image

import warpcam as wc

FOLDER = Path(__file__).parent / "goldens"
SIZE = 48
# What may differ, of 255, before it counts, and how much of a picture may; devices round differently.
LARGEST, FEW, MEAN, FLIP = 6, 0.004, 0.4, 0.01

SUN = '<light type="directional" pos="0 0 3" dir="-0.4 0.5 -1" diffuse="0.8 0.7 0.6" castshadow="{}"/>'
GREEN = '<light pos="1 -1 2" dir="-0.4 0.4 -1" diffuse="0.1 0.6 0.2"/>'
FLOOR = '<geom type="plane" size="2 2 0.5" rgba="0.4 0.5 0.6 1"/>'
OBJECT = '<body pos="0 0 0.6" euler="10 20 30">{}</body>'
CHECKER = '<texture name="t" type="{}" builtin="checker" rgb1="0.9 0.3 0.1" rgb2="0.1 0.3 0.9" width="{}" height="{}"/>'
MARBLE = '<material name="m" texture="t" texrepeat="2 2" specular="0.2"/>'
SKY = '<texture type="skybox" builtin="gradient" rgb1="0.3 0.5 0.7" rgb2="0 0 0" width="32" height="192"/>'


def shape(kind: str, more: str = 'rgba="0.8 0.4 0.3 1"') -> str:
    return OBJECT.format(scenes.geom_xml(kind, more=more))


# Behind the camera: all scenes share kernels, which takes a minute off the tests.
UNSEEN = "".join(scenes.geom_xml(kind, f"unseen {kind}", 'pos="0 -9 0"') for kind in scenes.TYPES)
UNSEEN_ASSETS = """
  <texture name="u" type="2d" builtin="flat" width="2" height="2"/><material name="u" texture="u"/>
"""
PLAIN = SUN.format("false")
# World and assets by feature.
FEATURES: dict[str, tuple[str, str]] = {
    **{kind: (PLAIN + shape(kind), "") for kind in scenes.TYPES},
    "headlight": (shape("capsule"), ""),
    "spot": ('<light pos="0.5 -0.5 2" dir="-0.2 0.2 -1" cutoff="30" castshadow="false"/>' + FLOOR, ""),
    "shadow": (SUN.format("true").replace("-0.4 0.5", "0.9 0.3") + FLOOR + shape("box"), ""),
    "two_lights": (
        PLAIN + '<light pos="1 -1 2" dir="-0.4 0.4 -1" diffuse="0.1 0.6 0.2"/>' + FLOOR + shape("sphere"),
        "",
    ),
    "texture": (PLAIN + '<geom type="plane" size="2 2 1" material="m"/>', CHECKER.format("2d", 60, 60) + MARBLE),
    "cube_texture": (PLAIN + shape("box", 'material="m"'), CHECKER.format("cube", 64, 384) + MARBLE),
    "round_texture": (PLAIN + shape("sphere", 'material="m"'), CHECKER.format("2d", 64, 64) + MARBLE),
    "emission": (FLOOR + shape("sphere", 'material="m"'), '<material name="m" emission="0.7" rgba="0.2 0.9 0.3 1"/>'),
    "gloss": (PLAIN + shape("sphere", 'material="m"'), '<material name="m" specular="1" shininess="0.9"/>'),
    "skybox": (PLAIN + shape("cylinder"), SKY),
    "smooth_edges": (PLAIN + FLOOR + shape("ellipsoid"), ""),
}


def render(feature: str, device: wp.Device) -> np.ndarray:
    world, assets = FEATURES[feature]
    mjm = scenes.compile_xml(world + UNSEEN, assets=assets + UNSEEN_ASSETS + scenes.ASSETS)
    eye = (1.2, -1.9, 2.0)
    camera = scenes.own_camera(
        width=SIZE,
        height=SIZE,
        outputs=("rgb",),
        shadows=feature == "shadow",
        antialiasing=4 if feature == "smooth_edges" else 1,
        position=eye,
        rotation=scenes.looking(eye, (0.0, 0.0, 0.5)),
    )
    return scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)["rgb"][0]


def complaints(reference: np.ndarray, image: np.ndarray) -> list[str]:
    """What tells two images apart, channel by channel."""
    found = []
    off = np.abs(reference.astype(np.float64) - image)
    for channel, name in enumerate(("red", "green", "blue")):
        many = (off[..., channel] > LARGEST).mean()
        if many > FEW:
            found.append(f"{name}: {many:.1%} of the pixels are off by more than {LARGEST}")
        if off[..., channel].mean() > MEAN:
            found.append(f"{name}: off by {off[..., channel].mean():.2f} in the mean")
    try:
        import flip_evaluator
    except ImportError:
        return found
    as_floats = (np.ascontiguousarray(picture, np.float32) / 255.0 for picture in (reference, image))
    flip = flip_evaluator.evaluate(*as_floats, "LDR", applyMagma=False)[1]
    return [*found, f"FLIP is {flip:.3f}"] if flip > FLIP else found


@pytest.mark.parametrize("feature", FEATURES)
def test_looks_as_it_did(device: wp.Device, feature: str) -> None:
    image, path = render(feature, device), FOLDER / f"{feature}.png"
    if os.environ.get("WARPCAM_WRITE_GOLDENS"):
        path.parent.mkdir(exist_ok=True)
        Image.fromarray(image).save(path, optimize=True)
    kept = np.asarray(Image.open(path).convert("RGB"))
    assert complaints(kept, image) == []


def zeroed(image: np.ndarray) -> np.ndarray:
    return image * np.array([0, 1, 1], np.uint8)


FAULTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "zeroed channel": zeroed,
    "swapped channels": lambda image: image[..., ::-1],
    "one-pixel shift": lambda image: np.roll(image, 1, axis=1),
    "flip": lambda image: image[:, ::-1],
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_seen(fault: str) -> None:
    kept = np.asarray(Image.open(FOLDER / "shadow.png").convert("RGB"))
    assert complaints(kept, kept) == []
    assert complaints(kept, FAULTS[fault](kept))


def test_a_missing_object_is_seen(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = np.asarray(Image.open(FOLDER / "two_lights.png").convert("RGB"))
    world, assets = FEATURES["two_lights"]
    monkeypatch.setitem(FEATURES, "two_lights", (world.replace(shape("sphere"), ""), assets))
    assert complaints(kept, render("two_lights", device))
