"""Inputs of shaders: constants of the type that is needed, or defaults, through connections."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pxr import Usd, UsdShade

from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.attributes import FIRST, AttributeReader
from warpcam.sources.usd.value_types import kind_of


class InputReader:
    """Reads inputs of shaders. Schemas of shaders say nothing of their types: readers do."""

    def __init__(self, attributes: AttributeReader, collector: WarningCollector):
        self.attributes, self.collector = attributes, collector

    def producing(self, given: UsdShade.Input) -> list[Usd.Attribute]:
        """Return the attributes that give an input its value: outputs of other shaders, or constants."""
        found = list(UsdShade.Utils.GetValueProducingAttributes(given))
        for path in () if found else given.GetAttr().GetConnections():
            if not given.GetPrim().GetStage().GetAttributeAtPath(path):
                self.refuse(given, f"connected to {path}, which is not there")
        return found

    def constant(self, shader: UsdShade.Shader, name: str) -> Any:
        """Return the constant of an input, of any type."""
        given = shader.GetInput(name)
        attributes = self.producing(given) if given else []
        return self.attributes.value(attributes[0], FIRST) if attributes else None

    def numbers(self, shader: UsdShade.Shader, name: str, default: tuple[float, ...]) -> np.ndarray:
        value = self.checked_numbers(shader.GetInput(name), self.constant(shader, name), len(default))
        return np.array(default if value is None else value, np.float64).reshape(len(default))

    def number(self, shader: UsdShade.Shader, name: str, default: float) -> float:
        return float(self.numbers(shader, name, (default,))[0])

    def checked_numbers(self, given: UsdShade.Input, value: Any, count: int) -> Any:
        """Return a constant, or None with a warning for anything but ``count`` finite numbers."""
        if value is None or is_numbers(value, count):
            return value
        self.refuse(given, f"that is not {f'{count} finite numbers' if count > 1 else 'a finite number'}")
        return None

    def flag(self, shader: UsdShade.Shader, name: str) -> bool:
        """Return a switch, off unless it is given."""
        value = self.constant(shader, name)
        if value is not None and not isinstance(value, bool):
            self.refuse(shader.GetInput(name), "that is neither true nor false")
            return False
        return bool(value)

    def text(self, shader: UsdShade.Shader, name: str, default: str = "", known: Sequence[str] = ()) -> str:
        """Return a name, one of those that are known if any are."""
        value = self.constant(shader, name)
        if value is None:
            return default
        if not isinstance(value, str):
            self.refuse(shader.GetInput(name), "that is no name")
            return default
        if known and value not in known:
            self.refuse(shader.GetInput(name), f"'{value}', known are {', '.join(known)}")
            return default
        return value

    def refuse(self, given: UsdShade.Input, what: str) -> None:
        where = str(given.GetPrim().GetPath())
        self.collector.warn(f"has {given.GetBaseName()} {what}, and is left out", where)


def is_numbers(value: Any, count: int) -> bool:
    """Return whether a value is one number, or one vector of ``count`` numbers, and finite."""
    kind = kind_of(value)
    return kind.numeric and not kind.array and kind.width == count and bool(np.isfinite(np.array(value)).all())
