"""Checks of the numbers that lenses are given, for all worlds or for each."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError


def shape_of(value: Any) -> tuple[int, ...]:
    """Return the shape of numbers in any form."""
    if isinstance(value, wp.array):  # whose vectors are no dimension
        return tuple(value.shape) + tuple(getattr(value.dtype, "_shape_", ()))
    return tuple(value.shape) if hasattr(value, "shape") else np.shape(value)


def any_differs(scalars: Sequence[Any], vectors: Sequence[Any] = ()) -> bool:
    """Return whether any of the numbers has a leading dimension (world,)."""
    return any(len(shape_of(value)) > 0 for value in scalars) or any(len(shape_of(value)) > 1 for value in vectors)


def finite_numbers(value: Any, where: str) -> np.ndarray:
    """Return a user's numbers as float64 on the host.

    Raises:
        WarpcamError: ``value`` is no array of finite numbers.
    """
    numbers = as_numbers(value, where).astype(np.float64)
    if not np.isfinite(numbers).all():
        raise WarpcamError(f"{where} must be finite, got {numbers[~np.isfinite(numbers)].flat[0]}")
    return numbers


def by_world(value: Any, where: str, worlds: int, width: tuple[int, ...] = ()) -> np.ndarray:
    """Return (world, *width) of numbers that were given for all worlds or for each.

    Raises:
        WarpcamError: ``value`` has another shape, or holds something else than finite numbers.
    """
    numbers = finite_numbers(value, where)
    if numbers.shape not in (width, (worlds, *width)):
        raise WarpcamError(f"{where} must have shape {width or 'a number'} or {(worlds, *width)}, got {numbers.shape}")
    return np.broadcast_to(numbers, (worlds, *width))


def coefficients_by_world(value: Any, where: str, worlds: int, lengths: Sequence[int], length: int) -> np.ndarray:
    """Return (world, length) of coefficients whose number is one of ``lengths``, filled up with zeros.

    Raises:
        WarpcamError: ``value`` has another shape, or holds something else than finite numbers.
    """
    given = finite_numbers(value, where)
    if given.shape[-1:] not in {(one,) for one in lengths} or given.shape[:-1] not in ((), (worlds,)):
        allowed = ", ".join(f"({one},)" for one in lengths)
        raise WarpcamError(f"{where} must have shape {allowed} or (world, ...), got {given.shape}")
    numbers = np.zeros((worlds, length))
    numbers[:, : given.shape[-1]] = given
    return numbers


def require(good: np.ndarray, values: np.ndarray, what: str) -> None:
    """Raise, with the first value that is not good."""
    if not good.all():
        raise WarpcamError(f"{what}, got {float(values[~good].flat[0])}")


def size_of(value: Any, where: str, reason: str) -> float:
    """Return a side of the image [pixels].

    Raises:
        WarpcamError: ``value`` is None, which needs the ``reason``, or no positive number.
    """
    if value is None:
        raise WarpcamError(f"{where} [pixels] was not given, and is needed {reason}")
    side = finite_numbers(value, where)
    if side.ndim or side <= 0:
        raise WarpcamError(f"{where} must be a positive number of pixels, got {value!r}")
    return float(side)


def centre_of(
    cx: Any, cy: Any, width: int | None, height: int | None, where: str, worlds: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the principal point, each (world,); the image's centre unless given."""
    if cx is None:
        cx = 0.5 * size_of(width, f"{where}: width", "without cx")
    if cy is None:
        cy = 0.5 * size_of(height, f"{where}: height", "without cy")
    return by_world(cx, f"{where}: cx", worlds), by_world(cy, f"{where}: cy", worlds)


def focal_matrix(lens: Any, width: int | None, height: int | None, where: str, worlds: int) -> np.ndarray:
    """Return the camera matrix of fx, fy, cx and cy, (world, 3, 3)."""
    fx = by_world(lens.fx, f"{where}: fx", worlds)
    fy = fx if lens.fy is None else by_world(lens.fy, f"{where}: fy", worlds)
    for name, value in (("fx", fx), ("fy", fy)):
        require(value > 0.0, value, f"{where}: {name} must be positive")
    return camera_matrix(fx, fy, *centre_of(lens.cx, lens.cy, width, height, where, worlds))


def camera_matrix(fx: np.ndarray, fy: np.ndarray, cx: np.ndarray, cy: np.ndarray) -> np.ndarray:
    """Return the matrix from a lens's plane to homogeneous pixels, (world, 3, 3), of numbers (world,)."""
    matrix = np.zeros((len(fx), 3, 3))
    matrix[:, 0, 0], matrix[:, 0, 2] = fx, cx
    matrix[:, 1, 1], matrix[:, 1, 2] = fy, cy
    matrix[:, 2, 2] = 1.0
    return matrix


def check_focal_choice(lens: str, fovy: Any, fx: Any, others: Sequence[Any], unit: str) -> None:
    """Raise unless either fovy, or fx with any of the others, was given."""
    pixels = [name for name, value in zip(("fx", "fy", "cx", "cy"), [fx, *others], strict=True) if value is not None]
    if fovy is None and fx is None:
        raise WarpcamError(
            f"{lens}: {', '.join(pixels) or 'nothing'} came; either fovy [degrees] or fx [{unit}] is needed"
        )
    if fovy is not None and pixels:
        raise WarpcamError(
            f"{lens}: fovy came together with {', '.join(pixels)}; give either fovy [degrees], or fx, fy, cx, cy "
            "[pixels]"
        )
