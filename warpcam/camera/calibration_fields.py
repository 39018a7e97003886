"""Fields of a calibration file, checked as they are read: errors name file, key, what came and what is allowed."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from warpcam.core.errors import WarpcamError


class Fields:
    """A mapping of a calibration file.

    Attributes:
        where: The file, and the key of the mapping in it.
    """

    def __init__(self, values: Mapping[Any, Any], where: str):
        self._values = values
        self.where = where

    def find(self, names: Sequence[str]) -> str | None:
        """Return the first of the names that is there with a value."""
        return next((name for name in names if self._values.get(name) is not None), None)

    def require(self, names: Sequence[str]) -> str:
        """Return the first of the names that is there.

        Raises:
            WarpcamError: None is.
        """
        if (name := self.find(names)) is None:
            raise WarpcamError(
                f"{self.where}: {' or '.join(names)} is missing; keys are {_listed(self._values) or 'none'}"
            )
        return name

    def text(self, name: str, allowed: Sequence[str]) -> str:
        """Return one of the texts that are allowed, whatever its case."""
        value = self._values[name]
        if not isinstance(value, str) or value.lower() not in allowed:
            raise WarpcamError(f"{self.where}: {name} must be one of {', '.join(map(repr, allowed))}, got {value!r}")
        return value.lower()

    def flag(self, name: str) -> bool:
        """Return a truth value, which OpenCV writes as 0 or 1."""
        value = self._values[name]
        if value not in (0, 1):
            raise WarpcamError(f"{self.where}: {name} must be 0 or 1, got {value!r}")
        return bool(value)

    def label(self, name: str) -> str:
        """Return a text."""
        value = self._values[name]
        if not isinstance(value, str):
            raise WarpcamError(f"{self.where}: {name} must be a text, got {value!r}")
        return value

    def pixels(self, name: str) -> int:
        """Return a side of the image."""
        return self._pixels(self._values[name], name)

    def size(self, name: str) -> tuple[int, int]:
        """Return width and height."""
        value = self._values[name]
        if not isinstance(value, list) or len(value) != 2:
            raise WarpcamError(f"{self.where}: {name} must be [width, height], got {value!r}")
        width, height = (self._pixels(each, name) for each in value)
        return width, height

    def number(self, name: str) -> float:
        return self._number(self._values[name], name)

    def numbers(self, name: str, counts: Sequence[int]) -> list[float]:
        """Return a list or a matrix of numbers in the order of its rows."""
        value = self._values[name]
        if isinstance(value, Mapping):
            inner = Fields(value, f"{self.where}: {name}")
            return inner.numbers(inner.require(("data",)), counts)
        rows = value if isinstance(value, list) else [value]
        flat = [each for row in rows for each in (row if isinstance(row, list) else [row])]
        if len(flat) not in counts:
            allowed = " or ".join(map(str, counts))
            raise WarpcamError(f"{self.where}: {name} must have {allowed} numbers, got {len(flat)}")
        return [self._number(each, name) for each in flat]

    def part(self, name: str) -> "Fields":
        """Return a mapping within this one."""
        value = self._values[name]
        if not isinstance(value, Mapping):
            raise WarpcamError(f"{self.where}: {name} must be a mapping, got {value!r}")
        return Fields(value, f"{self.where}: {name}")

    def parts(self, accepts: Callable[[Mapping[Any, Any]], bool]) -> list[str]:
        """Return the names of mappings within this one that are accepted."""
        return [
            name
            for name, value in self._values.items()
            if isinstance(name, str) and isinstance(value, Mapping) and accepts(value)
        ]

    def _number(self, value: Any, name: str) -> float:
        try:  # YAML 1.1 takes 1e-05 for a text
            number = math.nan if isinstance(value, bool) else float(value)
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not math.isfinite(number):
            raise WarpcamError(f"{self.where}: {name} must be of finite numbers, got {value!r}")
        return number

    def _pixels(self, value: Any, name: str) -> int:
        number = self._number(value, name)
        if number <= 0.0 or number != int(number):
            raise WarpcamError(f"{self.where}: {name} must be a positive whole number of pixels, got {value!r}")
        return int(number)


def _listed(values: Mapping[Any, Any]) -> str:
    names = [str(name) for name in values]
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
