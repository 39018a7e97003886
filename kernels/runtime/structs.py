"""Structs of Warp made from a list of fields."""

from collections.abc import Mapping
from typing import Any

import warp as wp


def make_struct(name: str, fields: Mapping[str, Any]) -> Any:
    """Make a Warp struct.

    Args:
        name: Of the struct in native code.
        fields: Types by name, in the order of the struct's members.
    """
    return wp.struct(type(name, (), {"__annotations__": dict(fields), "__module__": __name__, "__qualname__": name}))
