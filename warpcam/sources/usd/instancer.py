"""Point instancers of a stage: which prototype is where."""

from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from warpcam.core.errors import WarpcamError
from warpcam.core.rotations import rotation_matrices
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.attributes import AttributeReader

TIMED = ("protoIndices", "positions", "orientations", "orientationsf", "scales", "invisibleIds")


@dataclass(frozen=True, eq=False)
class Placement:
    """Instances of a point instancer.

    Attributes:
        targets: Paths of the prototypes.
        indices: (instance,), prototype of each.
        matrices: (instance, 4, 4), to the instancer's frame.
        moves: Instances change with time.
    """

    targets: list[Sdf.Path]
    indices: np.ndarray
    matrices: np.ndarray
    moves: bool


class InstancerReader:
    """Reads point instancers."""

    def __init__(self, stage: Usd.Stage, source: str, attributes: AttributeReader, collector: WarningCollector):
        self._stage, self._source = stage, source
        self._attributes, self._collector = attributes, collector

    def place(self, instancer: UsdGeom.PointInstancer, time: Usd.TimeCode) -> Placement | None:
        """Return the instances; None if there are none, or if it is told that they cannot be read."""
        prim, path = instancer.GetPrim(), instancer.GetPath()
        indices = self._attributes.get(prim, "protoIndices", time)
        targets = self._attributes.targets(prim, "prototypes")
        if indices is None or len(indices) == 0 or self._attributes.refused(prim, "prototypes", "positions"):
            return None
        if indices.min() < 0 or indices.max() >= len(targets):
            worst = indices.min() if indices.min() < 0 else indices.max()
            raise WarpcamError(f"{self._source}: {path}: protoIndices has {worst}; there are {len(targets)} prototypes")
        matrices = self.matrices(instancer, indices, time)
        if self._attributes.refused(prim, "positions"):
            return None
        if matrices is None:
            raise WarpcamError(
                f"{self._source}: {path}: {len(indices)} protoIndices came, with positions, orientations or "
                "scales of another number"
            )
        attributes = [prim.GetAttribute(name) for name in TIMED]
        roots = [UsdGeom.Xformable(self._stage.GetPrimAtPath(target)) for target in targets]
        moves = any(attribute and attribute.ValueMightBeTimeVarying() for attribute in attributes) or any(
            root and root.TransformMightBeTimeVarying() for root in roots
        )
        return Placement(targets, indices, matrices, moves)

    def matrices(self, instancer: UsdGeom.PointInstancer, indices: np.ndarray, time: Usd.TimeCode) -> np.ndarray | None:
        """Return each instance's matrix, (instance, 4, 4), in the instancer's frame; None if they differ.

        It includes the prototype's own matrix.

        USD's own function leaves quaternions of half precision as long as they are, which is a stretch.
        """
        prim, get, count = instancer.GetPrim(), self._attributes.get, len(indices)
        positions = _array(get(prim, "positions", time), np.zeros((0, 3)))
        quaternions = _array(get(prim, "orientations", time), np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)))
        quaternions = _array(get(prim, "orientationsf", time), quaternions)
        scales = _array(get(prim, "scales", time), np.ones((count, 3)))
        if len(positions) != count or len(quaternions) != count or len(scales) != count:
            return None
        matrices = np.tile(np.eye(4), (count, 1, 1))
        matrices[:, :3, :3] = rotation_matrices(quaternions[:, [3, 0, 1, 2]]) * scales[:, None, :]
        matrices[:, :3, 3] = positions
        if not np.isfinite(matrices).all():
            self._attributes.tell(prim, "has instances whose poses are not finite, which are left out")
        own = [np.eye(4)]
        for target in self._attributes.targets(prim, "prototypes"):
            root = UsdGeom.Xformable(self._stage.GetPrimAtPath(target))
            own.append(self._attributes.transform(root, time) if root else np.eye(4))
        return matrices @ np.array(own[1:])[indices]

    def shown(self, instancer: UsdGeom.PointInstancer, count: int, time: Usd.TimeCode) -> np.ndarray:
        """Return which instances are visible, (count,) bool."""
        prim = instancer.GetPrim()
        self._attributes.get(prim, "invisibleIds", time)
        ids = self._attributes.get(prim, "ids", time)
        mask = instancer.ComputeMaskAtTime(time)
        if ids is not None and len(ids) not in (0, count):
            self._attributes.tell(prim, "has ids of another number than its instances, which are all shown")
        return np.array(mask, bool) if len(mask) == count else np.ones(count, bool)

    def colors(self, instancer: UsdGeom.PointInstancer, count: int, time: Usd.TimeCode) -> dict[str, np.ndarray]:
        """Display colours and opacities of instances, (count or 1, channels), as far as there are some."""
        found = {}
        for name, channels in (("displayColor", 3), ("displayOpacity", 1)):
            primvar = UsdGeom.PrimvarsAPI(instancer).FindPrimvarWithInheritance(name)
            values = self._attributes.primvar(primvar, time, channels) if primvar and primvar.HasValue() else None
            if values is not None:
                if len(values) in (1, count):
                    found[name] = values
                else:
                    self._collector.warn(f"has {name} of another number than its instances", str(instancer.GetPath()))
        return found


def _array(values: np.ndarray | None, default: np.ndarray) -> np.ndarray:
    return default if values is None or len(values) == 0 else values
