"""Numbers that came from a file or a user."""

import math
from typing import Any

import numpy as np


def is_finite_number(value: Any) -> bool:
    """Return whether it is a number that a float can hold, no truth value: whole ones of a file may be any length."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False
