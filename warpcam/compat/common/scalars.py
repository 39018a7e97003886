"""Numbers as simulators take them: of Python, and scalars and single elements of numpy, torch and Warp."""

import math
import operator
from typing import Any


def whole(value: Any) -> int | None:
    """The whole number that it is, or None."""
    try:
        return operator.index(getattr(value, "value", value))
    except TypeError:
        return None


def real(value: Any) -> float:
    """The number that it is, or NaN."""
    if isinstance(value, str | bytes):
        return math.nan
    try:
        return float(value.item() if hasattr(value, "item") else value)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        return math.nan
