"""Derivatives of ``project`` and ``unproject``: those of differences, on the axis too, and none of what is not seen."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from custom_ray_tables import HEIGHT, WIDTH
from lens_samples import LENSES

import warpcam as wc

SIZE = {"width": WIDTH, "height": HEIGHT}
STEP = 1e-6
TABLES = ("Rays", "Rays with origins")  # whose derivatives jump from pixel to pixel
AXIS = [(0.0, 0.0, -1.0), (0.0, 0.0, -3.0), (1e-12, 0.0, -1.0), (1e-8, -2e-8, -2.0), (1e-3, 2e-3, -1.0)]
ASIDE = [(0.3, -0.2, -1.0), (0.0, 0.2, -1.0), (0.2, 0.0, -1.0), (-0.9, 0.5, -1.0)]
NOWHERE = [(0.0, 0.0, 1.0), (1e-9, 0.0, 1.0), (0.0, 0.0, 0.0), (np.nan, 0.0, -1.0), (3.0, 1.0, 0.5), (1.0, 0.0, 0.0)]


def by_autograd(function: Callable[[torch.Tensor], torch.Tensor], place: torch.Tensor) -> torch.Tensor:
    return torch.autograd.functional.jacobian(lambda one: function(one[None])[0], place)


def by_differences(function: Callable[[torch.Tensor], torch.Tensor], place: torch.Tensor) -> torch.Tensor:
    steps = STEP * torch.eye(len(place), dtype=place.dtype)
    return ((function(place + steps) - function(place - steps)) / (2.0 * STEP)).T


def check(name: str, function: Callable[[torch.Tensor], torch.Tensor], place: torch.Tensor) -> None:
    expected, found = by_differences(function, place), by_autograd(function, place)
    assert found.isfinite().all(), (place, found)
    largest = expected.abs().max().item()
    torch.testing.assert_close(found, expected, rtol=0.0, atol=(0.01 if name in TABLES else 1e-5) * largest)


def edge_of(lens: wc.Lens, turn: float) -> float:
    """The greatest angle from the axis [rad] up to which all directions are seen, at a turn around the axis."""
    low, high = 0.0, np.pi
    for _ in range(3):
        angles = np.linspace(low, high, 500)
        unseen = lens.project(torch.stack([direction(angle, turn) for angle in angles]), **SIZE).isnan().any(dim=-1)
        first = int(unseen.int().argmax()) if unseen.any() else len(angles) - 1
        low, high = angles[max(first - 1, 0)], angles[first]
    return float(low)


def direction(angle: float, turn: float) -> torch.Tensor:
    across = np.sin(angle)
    return torch.tensor((across * np.cos(turn), across * np.sin(turn), -np.cos(angle)))


@pytest.mark.parametrize("name", LENSES)
def test_points_on_the_axis_and_aside(name: str) -> None:
    lens = LENSES[name]()
    for place in AXIS + ASIDE:
        check(name, lambda points: lens.project(points, **SIZE), torch.tensor(place, dtype=torch.float64))


@pytest.mark.parametrize("name", LENSES)
def test_points_at_the_edge_of_what_is_seen(name: str) -> None:
    """A hundredth before it they are those of differences, at the very edge they are finite."""
    lens = LENSES[name]()
    for turn in (0.3, 2.0, 4.5):
        edge = edge_of(lens, turn)
        assert by_autograd(lambda points: lens.project(points, **SIZE), direction(edge, turn)).isfinite().all()
        check(name, lambda points: lens.project(points, **SIZE), direction(0.99 * edge, turn))


@pytest.mark.parametrize("name", LENSES)
def test_pixels(name: str) -> None:
    """The pixel that looks straight ahead, neighbours of it, and those of corners that see something."""
    lens = LENSES[name]()
    (ahead,) = lens.project(torch.tensor([(0.0, 0.0, -1.0)], dtype=torch.float64), **SIZE).tolist()
    aside = 0.01 if name in TABLES else 0.0  # a table's slopes jump at the centres of pixels
    for column, row in ((0.0, 0.0), (1e-9, 0.0), (1e-4, -1e-4), (3.3, -2.7), (-10.1, 8.2)):
        place = torch.tensor((ahead[0] + column + aside, ahead[1] + row + aside), dtype=torch.float64)
        check(name, lambda pixels: lens.unproject(pixels, **SIZE), place)
        check(name, lambda pixels: lens.unproject(pixels, distance=torch.tensor(2.0), **SIZE), place)


@pytest.mark.parametrize("name", LENSES)
def test_what_is_not_seen_has_no_part_in_derivatives(name: str) -> None:
    """Points and pixels that come out as NaN, and are left out of a sum, leave the others' derivatives alone."""
    lens = LENSES[name]()
    points = torch.tensor([*NOWHERE, ASIDE[0]], dtype=torch.float64, requires_grad=True)
    pixels = lens.project(points, **SIZE)
    seen = ~pixels.isnan().any(dim=-1)
    assert seen[-1] and not seen.all()
    pixels[seen].sum().backward()
    assert points.grad is not None and points.grad.isfinite().all() and (points.grad[~seen] == 0.0).all()
    alone = torch.tensor([ASIDE[0]], dtype=torch.float64, requires_grad=True)
    lens.project(alone, **SIZE).sum().backward()
    torch.testing.assert_close(points.grad[-1:], alone.grad)

    places = torch.tensor([(-1e4, 2e4), (np.nan, 3.0), (21.3, 14.2)], dtype=torch.float64, requires_grad=True)
    depth = torch.tensor([2.0, 2.0, 2.0], dtype=torch.float64, requires_grad=True)
    ends = lens.unproject(places, depth, **SIZE)
    seen = ~ends.isnan().any(dim=-1)
    assert seen[-1] and not seen[1]
    ends[seen].sum().backward()
    for given in (places, depth):
        assert given.grad is not None and given.grad.isfinite().all() and (given.grad[~seen] == 0.0).all()


def test_a_table_beside_pixels_that_see_nothing() -> None:
    """Pixels' centres have derivatives there, too: from the side that sees something."""
    directions = wc.Fisheye(fovy=150.0).rays(WIDTH, HEIGHT, 1, "lens")[0].copy()
    directions[:, 30:] = 0.0
    lens = wc.Rays(directions)
    place = torch.tensor([(20.5, 10.5), (20.7, 10.9)], dtype=torch.float64, requires_grad=True)
    ends = lens.unproject(place)
    ends.sum().backward()
    assert place.grad is not None and place.grad.isfinite().all() and (place.grad != 0.0).all()
