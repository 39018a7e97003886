"""Types of values: the kind of a value, the values that can stand for it, and their form for numpy."""

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from pxr import Sdf

FAMILIES = {
    **dict.fromkeys(("uchar", "int", "uint", "int64", "uint64"), "integer"),
    **dict.fromkeys(("half", "float", "double", "timecode"), "real"),
    **dict.fromkeys(("string", "token"), "text"),
    **dict.fromkeys(("quath", "quatf", "quatd"), "quaternion"),
    "bool": "boolean",
    "asset": "asset",
}
NAME = re.compile(r"(u?int64|[a-zA-Z]+)([234]?)(\[\])?")


@dataclass(frozen=True)
class ValueKind:
    """Kind of a value, without its precision and its role.

    Attributes:
        family: "integer", "real", "text", "quaternion", "boolean", "asset" or "other".
        width: Numbers of one element.
        array: The value is an array of elements.
    """

    family: str
    width: int = 1
    array: bool = False

    @property
    def numeric(self) -> bool:
        return self.family in ("integer", "real")


def kind_of(value: Any) -> ValueKind:
    return _named(str(Sdf.GetValueTypeNameForValue(value)))


def kind_of_type(name: Sdf.ValueTypeName) -> ValueKind:
    return kind_of(name.defaultValue)


@cache
def _named(name: str) -> ValueKind:
    found = NAME.fullmatch(name)
    if found is None or found[1] not in FAMILIES:
        return ValueKind("other", array=name.endswith("[]"))
    return ValueKind(FAMILIES[found[1]], int(found[2] or 1), found[3] is not None)


def fits(found: ValueKind, wanted: ValueKind) -> bool:
    """Return whether a value can be read as another kind: whole numbers can be read as real ones."""
    same = found.family == wanted.family or (found.family == "integer" and wanted.family == "real")
    return same and (found.width, found.array) == (wanted.width, wanted.array)


def plain(value: Any, kind: ValueKind) -> Any:
    """Return a value as numpy and Python have it.

    Arrays of numbers are (n,) or (n, width), quaternions (n, 4) in the order x y z w; single vectors are (width,).
    """
    if value is None or kind.family in ("asset", "other"):
        return value
    if kind.family == "text":
        return tuple(map(str, value)) if kind.array else str(value)
    if kind.family == "quaternion":
        if not kind.array:
            return np.array((*value.imaginary, value.real), np.float64)
        return np.asarray(value, np.float64).reshape(-1, 4)
    scalar: Any = {"integer": int, "real": float, "boolean": bool}[kind.family]
    if kind.array:
        array: np.ndarray = np.array(value, scalar)
        return array.reshape(-1, kind.width) if kind.width > 1 else array.reshape(-1)
    return np.array(value, np.float64) if kind.width > 1 else scalar(value)
