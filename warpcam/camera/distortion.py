"""Distortion of a plane: radial, tangential and by a thin prism, and its inverse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from warpcam.camera.lens_tensors import Columns, nan_unless, with_gradient
from warpcam.core.torch_interop import torch

ROUNDS = 50  # of the search for a place without distortion
NEAR_ENOUGH = 1e-3  # pixels that it may lie aside
ON_THE_WAY = 0.1  # pixels aside at which a part of the way is done
FOUND = 1e-9  # pixels aside at which the search ends
# Columns of the numbers of a distortion: six radial coefficients above the line, three below, p1, p2, s1 to s4.
WIDTH = 15
BELOW, TANGENTIAL, PRISM = 6, 9, 11

Place = tuple["torch.Tensor", "torch.Tensor"]


def distortion_numbers(
    worlds: int,
    above: Sequence[np.ndarray],
    below: Sequence[np.ndarray] = (),
    tangential: Sequence[np.ndarray] = (),
    prism: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """Return the numbers of a distortion, (world, 15), of coefficients (world,); those that are left out are 0."""
    numbers = np.zeros((worlds, WIDTH))
    for first, given in ((0, above), (BELOW, below), (TANGENTIAL, tangential), (PRISM, prism)):
        for index, each in enumerate(given):
            numbers[:, first + index] = each
    return numbers


def radial_numbers(numbers: Columns) -> Columns:
    """Return the radial part of a distortion."""
    return [*numbers[:TANGENTIAL], *(0.0 for _ in numbers[TANGENTIAL:])]


def lateral_numbers(numbers: Columns) -> Columns:
    """Return the tangential part of a distortion and that of the thin prism."""
    return [*(0.0 for _ in numbers[:TANGENTIAL]), *numbers[TANGENTIAL:]]


def distorted(u: torch.Tensor, v: torch.Tensor, numbers: Columns) -> tuple[Place, tuple[Place, Place]]:
    """Distort places of a plane, u right and v down.

    With r = u^2 + v^2 the radial factor is (1 + k1 r + k2 r^2 + ...) over (1 + k4 r + k5 r^2 + k6 r^3); tangential and
    thin-prism terms are OpenCV's.

    Returns:
        The places, and the derivatives of each coordinate by u and by v.
    """
    uu, vv, uv = u * u, v * v, u * v
    r = uu + vv
    radial, rate = _series(r, numbers[:BELOW])  # the rate is over r
    if _some(numbers[BELOW:TANGENTIAL]):
        bottom, bottom_rate = _series(r, numbers[BELOW:TANGENTIAL])
        bottom = torch.where(bottom.abs() < 1e-9, 1e-9, bottom)
        radial = radial / bottom
        rate = (rate - radial * bottom_rate) / bottom
    rate = 2.0 * rate
    x, y, xy = u * radial, v * radial, rate * uv
    xx, yx, yy = radial + rate * uu, xy, radial + rate * vv
    if _some(numbers[TANGENTIAL:]):
        p1, p2, s1, s2, s3, s4 = numbers[TANGENTIAL:]
        x = x + 2.0 * p1 * uv + p2 * (r + 2.0 * uu) + s1 * r + s2 * r * r
        y = y + p1 * (r + 2.0 * vv) + 2.0 * p2 * uv + s3 * r + s4 * r * r
        prism_x, prism_y = 2.0 * s1 + 4.0 * s2 * r, 2.0 * s3 + 4.0 * s4 * r
        both = 2.0 * p1 * u + 2.0 * p2 * v
        xx, xy = xx + 2.0 * p1 * v + 6.0 * p2 * u + u * prism_x, xy + both + v * prism_x
        yx, yy = yx + both + u * prism_y, yy + 6.0 * p1 * v + 2.0 * p2 * u + v * prism_y
    return (x, y), ((xx, xy), (yx, yy))


def straightened(x: torch.Tensor, y: torch.Tensor, numbers: Columns, focal: torch.Tensor) -> Place:
    """Return the places that a distortion brings to (x, y), by Newton's method from the middle outwards.

    Args:
        x: Right.
        y: Down.
        numbers: Of the distortion.
        focal: Pixels for a unit of the plane.

    Returns:
        u and v; NaN where the distortion brings nothing, and where it has folded back.
    """
    given_x, given_y = x, y
    x, y = x.detach(), y.detach()
    u, v = torch.zeros_like(x), torch.zeros_like(x)
    for share, enough in ((0.25, ON_THE_WAY), (0.5, ON_THE_WAY), (0.75, ON_THE_WAY), (1.0, FOUND)):
        to_x, to_y = share * x, share * y
        for _ in range(ROUNDS):
            (at_x, at_y), slopes = distorted(u, v, numbers)
            off_x, off_y = at_x - to_x, at_y - to_y
            moving = torch.hypot(off_x, off_y) * focal > enough
            if not moving.any():
                break
            (xx, xy), (yx, yy) = slopes
            area = xx * yy - xy * yx
            area = torch.where(area.abs() < 1e-9, 1e-9, area)
            step_u, step_v = (yy * off_x - xy * off_y) / area, (xx * off_y - yx * off_x) / area
            length = torch.hypot(step_u, step_v)
            rate = torch.where(moving, (0.5 / length.clamp(min=1e-12)).clamp(max=1.0), 0.0)
            u, v = u - rate * step_u, v - rate * step_v
    (at_x, at_y), ((xx, xy), (yx, yy)) = distorted(u, v, numbers)
    # where the area is turned over, or all of it mirrored, the distortion has folded back: nothing comes from there
    known = (torch.hypot(at_x - x, at_y - y) * focal <= NEAR_ENOUGH) & (xx * yy - xy * yx > 0.0)
    known &= u * x + v * y >= 0.0
    area = torch.where(known, xx * yy - xy * yx, 1.0)
    u = with_gradient(u, (yy * given_x - xy * given_y) / area)
    v = with_gradient(v, (xx * given_y - yx * given_x) / area)
    return nan_unless(known, u), nan_unless(known, v)


def distorted_once(u: torch.Tensor, v: torch.Tensor, numbers: Columns, focal: torch.Tensor) -> Place:
    """Return where the distortion brings places; NaN for those that come to where others, nearer the middle, belong."""
    (x, y), _ = distorted(u, v, numbers)
    with torch.no_grad():
        back_u, back_v = straightened(x, y, numbers, focal)
        same = torch.hypot(back_u - u, back_v - v) <= 1e-4 * (1.0 + torch.hypot(u, v))
    return nan_unless(same, x), nan_unless(same, y)


def _series(r: torch.Tensor, coefficients: Columns) -> Place:
    """The value of 1 + c1 r + c2 r^2 + ..., and its derivative."""
    value, rate = torch.zeros_like(r), torch.zeros_like(r)
    for index in reversed(range(len(coefficients))):
        if _some(coefficients[index:]):
            raised = value + coefficients[index]
            rate = rate * r + raised
            value = raised * r
    return 1.0 + value, rate


def _some(numbers: Columns) -> bool:
    """True unless all are 0."""
    return any(isinstance(each, torch.Tensor) for each in numbers)
