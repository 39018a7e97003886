"""Attributes and relationships of a stage: values of the type that is needed, or the defaults of their schemas.

All readers of this room get their values here, as files have any type under any name. An attribute that cannot be used
gives one warning by prim and name.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom

from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.value_types import ValueKind, fits, kind_of, kind_of_type, plain

FIRST = Usd.TimeCode.EarliestTime()


@dataclass(frozen=True)
class Expected:
    """Type of an attribute, by its schema or its reader.

    Attributes:
        type_name: Its name, for messages.
        kind: Its kind.
        fallback: Value that stands for one that is missing or cannot be used; None for none.
        tokens: Values that a token may have; empty for any.
    """

    type_name: str
    kind: ValueKind
    fallback: Any
    tokens: tuple[str, ...]


class AttributeReader:
    """Reads attributes of prims, and keeps which of them could not be used."""

    def __init__(self, collector: WarningCollector):
        self._collector = collector
        self._expected: dict[tuple[str, ...], Expected | None] = {}
        self._refused: set[tuple[Sdf.Path, str]] = set()
        self._told: set[tuple[Sdf.Path, str]] = set()

    def get(
        self,
        prim: Usd.Prim,
        name: str,
        time: Usd.TimeCode = FIRST,
        expected: Sdf.ValueTypeName | None = None,
        finite: bool = True,
        also: Sdf.ValueTypeName | None = None,
    ) -> Any:
        """Return the value of an attribute in the form of ``plain``, or its schema's default.

        Args:
            prim: The prim.
            name: Name of the attribute.
            time: Time of the value.
            expected: Type of an attribute that the prim's schemas do not have; without it such an attribute is None.
            finite: Single numbers and vectors must be finite.
            also: Another type that is read, in its own form: what files have had before there was a schema.
        """
        wanted = self._wanted(prim, name, expected)
        if wanted is None:
            return None
        attribute = prim.GetAttribute(name)
        if not attribute or not attribute.HasAuthoredValue():
            if (attribute.IsAuthored() and self._is_relationship(attribute)) or prim.HasRelationship(name):
                self._refuse(prim, name, f"has {name} that is a relationship instead of {wanted.type_name}", wanted)
            return wanted.fallback
        value = self.value(attribute, time)
        if value is None:
            return wanted.fallback
        if also is not None and fits(kind_of(value), kind_of_type(also)):
            return plain(value, kind_of_type(also))
        if not fits(kind_of(value), wanted.kind):
            found = _type_of(attribute, value)
            self._refuse(prim, name, f"has {name} of type {found} instead of {wanted.type_name}", wanted)
            return wanted.fallback
        result = plain(value, wanted.kind)
        if wanted.tokens and result not in wanted.tokens:
            known = ", ".join(wanted.tokens)
            self._refuse(prim, name, f"has {name} '{result}', known are {known}", wanted)
            return wanted.fallback
        if finite and wanted.kind.family == "real" and not wanted.kind.array and not np.isfinite(result).all():
            self._refuse(prim, name, f"has {name} that is not finite", wanted)
            return wanted.fallback
        return result

    def number(
        self,
        prim: Usd.Prim,
        name: str,
        time: Usd.TimeCode,
        default: float = 0.0,
        low: float = 0.0,
        high: float = math.inf,
        expected: Sdf.ValueTypeName = Sdf.ValueTypeNames.Float,
    ) -> float:
        """Return the number of an attribute; one outside its limits is brought to the nearer of them."""
        value = self.get(prim, name, time, expected)
        if value is None:
            return default
        kept = min(max(value, low), high)
        if kept != value:
            self.tell(prim, f"has {name} of {value:g}, and {kept:g} is taken", about=name)
        return float(kept)

    def refused(self, prim: Usd.Prim, *names: str) -> bool:
        """Return whether one of the attributes or relationships could not be used."""
        path = _path_of(prim)
        return any((path, name) in self._refused for name in names)

    def has_elements(self, prim: Usd.Prim, name: str) -> bool:
        """Return whether an attribute has a value of any type that is no empty array."""
        attribute = prim.GetAttribute(name)
        value = self.value(attribute, FIRST) if attribute else None
        return value is not None and np.size(value) > 0

    def primvar(
        self, primvar: UsdGeom.Primvar, time: Usd.TimeCode, width: int, wider: bool = False, indexed: bool = True
    ) -> np.ndarray | None:
        """Return the values of a primvar, (n, width) float64; None if it has none that can be used.

        Args:
            primvar: The primvar.
            time: Time of the values.
            width: Numbers of each element.
            wider: Elements may have more numbers, which are cut off.
            indexed: Each index has its element; else elements stand as they are stored.
        """
        attribute = primvar.GetAttr()
        prim, name = attribute.GetPrim(), str(attribute.GetName())
        value = self.value(attribute, time)
        if value is None:
            return None
        kind = kind_of(value)
        if not kind.numeric or not (kind.width == width or (wider and kind.width > width)):
            numbers = f"{width} {'numbers or more' if wider else 'numbers'}" if width > 1 else "one number"
            found = _type_of(attribute, value)
            self._refuse(prim, name, f"has {name} of type {found} instead of {numbers} for each element")
            return None
        if indexed and primvar.IsIndexed():
            indices = f"{name}:indices"
            self.get(prim, indices, time, Sdf.ValueTypeNames.IntArray)
            if self.refused(prim, indices):
                self._refused.add((_path_of(prim), name))
                return None
            try:
                value = primvar.ComputeFlattened(time)
            except Tf.ErrorException:
                value = None
            if value is None or np.size(value) == 0:
                what = primvar.GetPrimvarName()
                self.tell(prim, f"has {what} whose indices are out of range, which are left out")
                return None
        array = np.array(value, np.float64).reshape(-1, kind.width)[:, :width]
        return array if len(array) else None

    def targets(self, prim: Usd.Prim, name: str) -> list[Sdf.Path]:
        """Return the targets of a relationship; none, with a warning, if it is an attribute."""
        try:
            return list(prim.GetRelationship(name).GetForwardedTargets())
        except Tf.ErrorException:
            self._refuse(prim, name, f"has {name} that is no relationship")
            return []

    def transform(self, query: UsdGeom.Xformable, time: Usd.TimeCode) -> np.ndarray:
        """Return the matrix to the frame above, (4, 4), for column vectors; operations without a use are left out."""
        try:
            matrix = query.GetLocalTransformation(time)
        except Tf.ErrorException:
            matrix = Gf.Matrix4d(1.0)
            for operation in query.GetOrderedXformOps():
                try:
                    matrix = operation.GetOpTransform(time) * matrix
                except Tf.ErrorException:
                    attribute = operation.GetAttr()
                    name, found = str(attribute.GetName()), attribute.GetTypeName()
                    self._refuse(query.GetPrim(), name, f"has {name} of type {found} that USD cannot apply")
        return np.array(matrix, np.float64).T

    def check_transform(self, query: UsdGeom.Xformable) -> None:
        """Tell which operations of a prim's transform are not there."""
        order = self.get(query.GetPrim(), "xformOpOrder")
        if not order:
            return
        there = {str(operation.GetOpName()) for operation in query.GetOrderedXformOps()}
        missing = [name for name in order if name not in there and name != UsdGeom.XformOpTypes.resetXformStack]
        if missing:
            text = f"has an xformOpOrder with {missing[0]}, which is no transform of it, and is left out"
            self.tell(query.GetPrim(), text)

    def value(self, attribute: Usd.Attribute, time: Usd.TimeCode) -> Any:
        """Return what an attribute has, of any type; None for nothing."""
        try:
            return attribute.Get(time)
        except Tf.ErrorException:
            name = attribute.GetName()
            self._refuse(attribute.GetPrim(), name, f"has {name} that USD cannot read")
            return None

    def _wanted(self, prim: Usd.Prim, name: str, expected: Sdf.ValueTypeName | None) -> Expected | None:
        key = (name, str(expected), str(prim.GetTypeName()), *prim.GetAppliedSchemas())
        if key not in self._expected:
            definition = prim.GetPrimDefinition().GetAttributeDefinition(name)
            if definition:
                kind = kind_of_type(definition.GetTypeName())
                fallback = plain(definition.GetFallbackValue(), kind)
                tokens = tuple(map(str, definition.GetMetadata("allowedTokens") or ()))
                self._expected[key] = Expected(str(definition.GetTypeName()), kind, fallback, tokens)
            elif expected is not None:
                self._expected[key] = Expected(str(expected), kind_of_type(expected), None, ())
            else:
                self._expected[key] = None
        return self._expected[key]

    @staticmethod
    def _is_relationship(attribute: Usd.Attribute) -> bool:
        specs = attribute.GetPropertyStack(Usd.TimeCode.Default())
        return bool(specs) and isinstance(specs[0], Sdf.RelationshipSpec)

    def _refuse(self, prim: Usd.Prim, name: str, what: str, wanted: Expected | None = None) -> None:
        fallback = None if wanted is None else wanted.fallback
        if fallback is None or np.size(fallback) == 0:
            outcome = "which is left out"
        else:
            outcome = f"and its default, {_shown(fallback)}, is taken"
        self.tell(prim, f"{what}, {outcome}")
        self._refused.add((_path_of(prim), str(name)))

    def tell(self, prim: Usd.Prim, what: str, about: str = "") -> None:
        """Warn once of an attribute, however often it is read, or once of all that is wrong ``about`` it."""
        key = (_path_of(prim), about or what)
        if key not in self._told:
            self._told.add(key)
            self._collector.warn(what, str(prim.GetPath()))


def _path_of(prim: Usd.Prim) -> Sdf.Path:
    return prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()


def _type_of(attribute: Usd.Attribute, value: Any) -> str:
    """Return the type that was written, where that has been the one of the value."""
    kind = kind_of(value)
    for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()):
        if isinstance(spec, Sdf.AttributeSpec) and kind_of_type(spec.typeName) == kind:
            return str(spec.typeName)
    return str(Sdf.GetValueTypeNameForValue(value))


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"({', '.join(f'{number:g}' for number in value)})"
    return repr(value)
