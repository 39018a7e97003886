"""Points whose hull holds a mesh."""

import numpy as np
import pytest

from warpcam.accel.outlines import NUM_POINTS, outline

RANDOM = np.random.default_rng(11)
TURNED = np.linalg.qr(RANDOM.normal(size=(3, 3)))[0]
BOX = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-2.0, 2.0) for z in (-0.1, 0.1)])
ANGLES = np.linspace(0.0, 2.0 * np.pi, 64)
ROD = np.concatenate([np.stack([np.cos(ANGLES), np.sin(ANGLES), z + 0.0 * ANGLES], 1) for z in (-3.0, 3.0)])
SHAPES = {
    "cloud": RANDOM.normal(size=(500, 3)),
    "box": BOX,
    "turned box": BOX @ TURNED,
    "rod": ROD,
    "leaning rod": ROD @ TURNED + (5.0, -3.0, 2.0),
    "far": 1e-3 * ROD + 7.0,
    "square": np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]),
    "edge": np.array([(0.0, 0.0, 0.0), (1.0, 2.0, 3.0)]),
    "point": np.ones((3, 3)),
    "ball": RANDOM.normal(size=(2000, 3)),
}
SHAPES["ball"] /= np.linalg.norm(SHAPES["ball"], axis=1, keepdims=True)
WAYS = RANDOM.normal(size=(400, 3))
WAYS /= np.linalg.norm(WAYS, axis=1, keepdims=True)


@pytest.mark.parametrize("name", SHAPES)
def test_all_lies_within(name: str):
    points = SHAPES[name].astype(np.float32)
    corners = outline(points)
    assert corners.shape == (NUM_POINTS, 3)
    assert corners.dtype == np.float32
    reach, needed = (corners @ WAYS.T).max(axis=0), (points @ WAYS.T).max(axis=0)
    assert (reach >= needed - 2e-7 * np.abs(points).max()).all()


@pytest.mark.parametrize(("name", "most"), [("ball", 1.25), ("rod", 1.12), ("box", 1.0001), ("cloud", 1.7)])
def test_it_is_tight(name: str, most: float):
    points = SHAPES[name] - SHAPES[name].mean(axis=0)
    reach, needed = (outline(points) @ WAYS.T).max(axis=0), (points @ WAYS.T).max(axis=0)
    assert (reach < most * needed).all()


def test_a_ball_fills_it_better_than_its_box():
    ball = SHAPES["ball"]
    box = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    assert (outline(ball) @ WAYS.T).max(axis=0).mean() < 0.8 * (box @ WAYS.T).max(axis=0).mean()
