"""Coordinates and numbers of lenses as torch tensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.torch_interop import torch

Columns = Sequence["torch.Tensor | float"]  # 0.0 where all numbers are 0


@dataclass(frozen=True)
class LensNumbers:
    """Numbers of a lens, of one for all worlds or of each.

    Attributes:
        matrix: (n, 3, 3) from the plane of the lens's formula, u right and v down, to homogeneous pixels.
        formula: Numbers of the formula by name, (n,) or (n, m).
    """

    matrix: np.ndarray
    formula: Mapping[str, np.ndarray]

    def of(self, world: int) -> LensNumbers:
        """Return the numbers of one world."""
        one = slice(world, world + 1)
        return LensNumbers(self.matrix[one], {name: values[one] for name, values in self.formula.items()})


def as_coordinates(value: Any, count: int, where: str) -> torch.Tensor:
    """Return (..., count) as a tensor of floats, in its own memory if it is one.

    Raises:
        WarpcamError: ``value`` has another shape, or is no array of real numbers.
    """
    tensor = _as_floats(value, where)
    if tensor.ndim == 0 or tensor.shape[-1] != count:
        raise WarpcamError(f"{where} must have shape (..., {count}), got {tuple(tensor.shape)}")
    return tensor


def worlds_of(differs: bool, given: torch.Tensor, where: str) -> int:
    """Return the number of worlds that coordinates are of, where a lens ``differs`` by world; else 1.

    Raises:
        WarpcamError: They have no dimension for worlds.
    """
    if differs and given.ndim < 2:
        raise WarpcamError(
            f"{where}: the lens differs by world, and needs the shape (world, ..., {given.shape[-1]}), got "
            f"{tuple(given.shape)}"
        )
    return given.shape[0] if differs else 1


def along_rays(
    rays: torch.Tensor, given: torch.Tensor, depth: Any, distance: Any, where: str, starts: torch.Tensor | None = None
) -> torch.Tensor | None:
    """Return how far along their rays points lie, (..., 1) [m], or None if neither depth nor distance came.

    Args:
        rays: (..., 3) of length 1, in the camera's frame.
        given: (..., 2) the pixels.
        depth: Planar depth, or None.
        distance: Distance along the ray, or None.
        where: Begins the text of an error.
        starts: (..., 3) where rays begin, in the camera's frame, or None: all at depth 0.

    Raises:
        WarpcamError: Both came, or one of another shape.
    """
    if depth is None and distance is None:
        return None
    if depth is not None and distance is not None:
        raise WarpcamError(f"{where}: both depth and distance came; give one of them")
    name, value = ("depth", depth) if distance is None else ("distance", distance)
    numbers = _as_floats(value, f"{where}: {name}").to(rays.device).double()
    shape = tuple(given.shape[:-1])
    if tuple(numbers.shape) == shape:
        numbers = numbers.unsqueeze(-1)
    try:
        np.broadcast_shapes(tuple(numbers.shape), (*shape, 1))
    except ValueError:
        fits = False
    else:
        fits = numbers.ndim == 0 or numbers.shape[-1] == 1
    if not fits:
        raise WarpcamError(
            f"{where}: {name} must have shape {shape}, or one that can be broadcast to {(*shape, 1)}, got "
            f"{tuple(numbers.shape)}"
        )
    length = numbers if depth is None else -(numbers + (0.0 if starts is None else starts[..., 2:])) / rays[..., 2:]
    return nan_unless((length >= 0.0) & length.isfinite(), length)


def _as_floats(value: Any, where: str) -> torch.Tensor:
    if isinstance(value, wp.array):
        value = torch_interop.to_torch(value)
    if not isinstance(value, torch.Tensor):
        try:
            value = torch.as_tensor(value, device="cpu")
        except (TypeError, ValueError, RuntimeError):
            raise WarpcamError(f"{where} must be a tensor of real numbers, got {value!r}") from None
    if value.dtype is torch.bool or value.is_complex():
        raise WarpcamError(f"{where} must be a tensor of real numbers, got {value.dtype}")
    return value if value.is_floating_point() else value.float()


def lens_tensors(
    numbers: LensNumbers, dimensions: int, device: torch.device
) -> tuple[Columns, Columns, dict[str, Any]]:
    """Return the nine numbers of the matrix, those of its inverse, and the formula's, with that many dimensions.

    Of the matrices and of what the formula has in columns, what is 0 everywhere is the number 0.0, which costs nothing.
    """

    def column(values: np.ndarray) -> torch.Tensor:
        tensor = torch.tensor(values, dtype=torch.float64, device=device)
        return tensor.reshape(() if dimensions == 0 else (-1, *(1 for _ in range(dimensions - 1))))

    def columns(values: np.ndarray) -> list[Any]:
        return [column(each) if each.any() else 0.0 for each in values.reshape(len(values), -1).T]

    formula = {name: columns(each) if each.ndim > 1 else column(each) for name, each in numbers.formula.items()}
    return columns(numbers.matrix), columns(np.linalg.inv(numbers.matrix)), formula


def mapped(matrix: Columns, x: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return where a homography leads to; NaN for places that come from behind."""
    over = matrix[6] * x + matrix[7] * y + matrix[8]
    over = nan_unless(over > 0.0, over)
    return (matrix[0] * x + matrix[1] * y + matrix[2]) / over, (matrix[3] * x + matrix[4] * y + matrix[5]) / over


def with_gradient(value: torch.Tensor, change: torch.Tensor) -> torch.Tensor:
    """Return a value that was found without derivatives, with those of ``change``, its first order."""
    return value + (change - change.detach()) if change.requires_grad else value


def seen_alone(
    compute: Callable[[torch.Tensor], torch.Tensor], given: torch.Tensor, instead: Callable[[], Columns]
) -> torch.Tensor:
    """Return what is computed of coordinates, NaN where that is NaN, with derivatives of 0 there.

    Derivatives of NaN are NaN, also of what a caller leaves out afterwards.

    Args:
        compute: Leads from (..., m) to (..., n).
        given: (..., m).
        instead: Gives the m coordinates of a place that is seen, which stands in for those that are not.
    """
    if not (given.requires_grad and torch.is_grad_enabled()):
        return compute(given)
    with torch.no_grad():
        seen = ~compute(given).isnan().any(dim=-1, keepdim=True)
        place = torch.stack([torch.zeros_like(given[..., 0]) + each for each in instead()], dim=-1)
    return nan_unless(seen, compute(torch.where(seen, given, place)))


def nan_unless(good: torch.Tensor, value: torch.Tensor) -> torch.Tensor:
    """Return the value where it is good, and NaN elsewhere."""
    return torch.where(good, value, math.nan)


# On a CPU, torch's own sine, cosine and square root of a thousand numbers and more wait for threads of MKL. A process
# that was forked has none, and a table of rays may be made there.


def sine_and_cosine(angle: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return sine and cosine of angles [rad]."""
    turn = torch.polar(torch.ones_like(angle), angle)
    return turn.imag, turn.real


def root(square: torch.Tensor) -> torch.Tensor:
    """Return square roots; NaN below 0."""
    return 1.0 / torch.rsqrt(square)
