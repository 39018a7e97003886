"""Rays between the pixels of a table, and the search for the pixel whose ray meets a point."""

from __future__ import annotations

import math

import numpy as np

from warpcam.camera.lens_tensors import nan_unless, with_gradient
from warpcam.core.torch_interop import torch

SCORES = 1 << 22  # of points and rays that are compared at a time
ROUNDS = 10  # of the search between pixels
NEAR_ENOUGH = 1e-4  # pixels that a ray may pass a point aside


class RayLookup:
    """A table of rays on a device, for one world or each.

    Attributes:
        directions: (n, height, width, 3) of length 1; NaN sees nothing.
        starts: Of the same shape: where rays begin [m].
    """

    def __init__(self, directions: np.ndarray, starts: np.ndarray, device: torch.device):
        rays = torch.tensor(directions, dtype=torch.float64, device=device)
        length = rays.norm(dim=-1, keepdim=True)
        begin = torch.tensor(starts, dtype=torch.float64, device=device)
        shape = np.broadcast_shapes(rays.shape, begin.shape)
        self.directions = (rays / nan_unless(length > 0.0, length)).expand(shape)
        self.starts = begin.expand(shape)

    def at(self, world: torch.Tensor, column: torch.Tensor, row: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return directions and starts at pixels, both (..., 3), linearly between centres.

        NaN outside the image, and beside pixels that see nothing.
        """
        _, height, width, _ = self.directions.shape
        inside = (column >= 0.0) & (column <= width) & (row >= 0.0) & (row <= height)
        left, across = _cell(column, width)
        top, down = _cell(row, height)
        direction, start = torch.zeros_like(column)[..., None], torch.zeros_like(column)[..., None]
        for below in (0, 1):
            for right in (0, 1):
                weight = (across if right else 1.0 - across) * (down if below else 1.0 - down)
                rows, columns = (top + below).clamp(max=height - 1), (left + right).clamp(max=width - 1)
                ray = self.directions[world, rows, columns]
                used = (weight != 0.0)[..., None] | ray.isfinite()
                direction = direction + torch.where(used, weight[..., None] * ray, 0.0)
                start = start + weight[..., None] * self.starts[world, rows, columns]
        direction = direction / direction.norm(dim=-1, keepdim=True)
        return nan_unless(inside[..., None], direction), nan_unless(inside[..., None], start)

    def pixels_of(self, world: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
        """Return where rays meet points, (n, 2) of points (n, 3) and their worlds (n,); NaN where none does."""
        given, points = points, points.detach()
        _, height, width, _ = self.directions.shape
        nearest = self._nearest(world, points)
        column, row = (nearest % width) + 0.5, torch.div(nearest, width, rounding_mode="floor") + 0.5
        least_column, least_row = column - 1.0, row - 1.0
        off, slope_column, slope_row = self._slopes(world, column, row, points)
        for _ in range(ROUNDS):
            cc, rr, cr = (
                (a * b).sum(-1)
                for a, b in ((slope_column, slope_column), (slope_row, slope_row), (slope_column, slope_row))
            )
            to_column, to_row = (slope_column * off).sum(-1), (slope_row * off).sum(-1)
            area = cc * rr - cr * cr
            area = torch.where(area > 1e-12 * cc * rr, area, math.inf)  # parallel rays along one side: no way to tell
            column = torch.clamp(column - (rr * to_column - cr * to_row) / area, min=0.0, max=float(width))
            row = torch.clamp(row - (cc * to_row - cr * to_column) / area, min=0.0, max=float(height))
            column = torch.minimum(torch.maximum(column, least_column), least_column + 2.0)
            row = torch.minimum(torch.maximum(row, least_row), least_row + 2.0)
            off, slope_column, slope_row = self._slopes(world, column, row, points)
        pixel = torch.maximum(slope_column.norm(dim=-1), slope_row.norm(dim=-1))
        met = off.norm(dim=-1) <= NEAR_ENOUGH * pixel
        given = torch.where(met[..., None], given, math.inf)
        column, row = self._follow(world, column, row, given, slope_column, slope_row)
        return nan_unless(met[..., None], torch.stack([column, row], dim=-1))

    def _follow(
        self,
        world: torch.Tensor,
        column: torch.Tensor,
        row: torch.Tensor,
        points: torch.Tensor,
        slope_column: torch.Tensor,
        slope_row: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return pixels that were found with their derivatives by the points: rays go on to meet these."""
        if not points.requires_grad:
            return column, row
        towards = torch.nan_to_num(points - self.at(world, column, row)[1], nan=1.0, posinf=1.0)
        towards = towards / towards.norm(dim=-1, keepdim=True)
        slopes = torch.nan_to_num(torch.stack([slope_column, slope_row], dim=-1))
        change = (torch.linalg.pinv(slopes) @ towards[..., None])[..., 0]
        return with_gradient(column, change[..., 0]), with_gradient(row, change[..., 1])

    def _nearest(self, world: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
        """The number of the pixel whose ray passes each point at the smallest angle."""
        nearest = torch.zeros(len(points), dtype=torch.int64, device=points.device)
        for each in range(len(self.directions)):
            rays, starts = self.directions[each].reshape(-1, 3), self.starts[each].reshape(-1, 3)
            rays = torch.nan_to_num(rays, nan=0.0)
            blind, before = ~rays.any(dim=-1), (rays * starts).sum(-1)
            chosen = (world == each).nonzero()[:, 0]
            step = max(1, SCORES // len(rays))
            for first in range(0, len(chosen), step):
                some = chosen[first : first + step]
                part = points[some]
                square = (part * part).sum(-1, keepdim=True) - 2.0 * part @ starts.T + (starts * starts).sum(-1)
                score = (part @ rays.T - before) / square.clamp(min=1e-30).sqrt()
                nearest[some] = torch.where(blind, -math.inf, score).argmax(dim=-1)
        return nearest

    def _slopes(
        self, world: torch.Tensor, column: torch.Tensor, row: torch.Tensor, points: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """How far rays pass points, in the direction from the ray's start, and the derivatives by column and row."""
        _, height, width, _ = self.directions.shape
        step = 1e-4

        def off(column: torch.Tensor, row: torch.Tensor) -> torch.Tensor:
            direction, start = self.at(world, column, row)
            towards = points - start
            return direction - towards / towards.norm(dim=-1, keepdim=True)

        here = off(column, row)
        right = torch.where(column + step <= width, step, -step)
        below = torch.where(row + step <= height, step, -step)
        by_column = (off(column + right, row) - here) / right[..., None]
        return here, by_column, (off(column, row + below) - here) / below[..., None]


def _cell(place: torch.Tensor, count: int) -> tuple[torch.Tensor, torch.Tensor]:
    """The pixel whose centre is before a place, and the place's share of the way to the next; beyond 1 at an edge."""
    first = torch.nan_to_num(place - 0.5).floor().clamp(min=0, max=max(count - 2, 0))
    return first.long(), (place - 0.5 - first) if count > 1 else torch.zeros_like(place)
