"""Solids of a stage: what UsdGeom has beside meshes."""

import numpy as np
from pxr import Usd

from warpcam.kernels.types import BOX, CAPSULE, CONE, CYLINDER, PLANE, SPHERE
from warpcam.sources.common import tessellate
from warpcam.sources.common.geometry import Geometry, MeshGeometry, Primitive
from warpcam.sources.usd.attributes import AttributeReader

GPRIMS = ("Cube", "Sphere", "Cylinder", "Cylinder_1", "Capsule", "Capsule_1", "Cone", "Plane")

ROUND = {"Cylinder": CYLINDER, "Capsule": CAPSULE, "Cone": CONE}
# Columns are the solid's x, y and z in the prim's frame: proper rotations that take z to the axis.
TURNS = {
    "X": np.array(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))),
    "Y": np.array(((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))),
    "Z": np.eye(3),
}


def read_gprim(prim: Usd.Prim, time: Usd.TimeCode, double_sided: bool | None, attributes: AttributeReader) -> Geometry:
    kind, name = str(prim.GetTypeName()), str(prim.GetPath())
    turn = TURNS[attributes.get(prim, "axis", time) or "Z"]
    sizes = _sizes(prim, time, attributes)
    if kind == "Cube":
        return Primitive(name, BOX, sizes)
    if kind == "Sphere":
        return Primitive(name, SPHERE, sizes)
    if kind == "Plane":
        sides = attributes.get(prim, "doubleSided", time) if double_sided is None else double_sided
        if not sides:
            return Primitive(name, PLANE, sizes, turn)
        if min(sizes) <= 0.0:
            return Primitive(name, PLANE, sizes, turn)  # its back is another
        vertices, faces, normals = tessellate.rectangle(sizes[0], sizes[1])
        return MeshGeometry(name, vertices @ turn.T, faces, normals @ turn.T, two_sided=True)
    if len(sizes) == 3:  # of two radii
        cut = tessellate.cylinder if kind.startswith("Cylinder") else tessellate.capsule
        vertices, faces, normals = cut(*sizes)
        return MeshGeometry(name, vertices @ turn.T, faces, normals @ turn.T)
    return Primitive(name, ROUND[kind.removesuffix("_1")], sizes, turn)


def back_of(form: Geometry, prim: Usd.Prim, double_sided: bool | None, attributes: AttributeReader) -> Primitive | None:
    """The other side of an endless plane that has two; all else has its back in itself."""
    if not (isinstance(form, Primitive) and form.type == PLANE):
        return None
    if not (attributes.get(prim, "doubleSided") if double_sided is None else double_sided):
        return None
    return Primitive(form.name, PLANE, tuple(form.size), form.turn @ np.diag((1.0, -1.0, -1.0)))


def update_gprim(form: Geometry, prim: Usd.Prim, time: Usd.TimeCode, attributes: AttributeReader) -> None:
    """Give a solid the sizes of another time; those that are meshes keep theirs."""
    sizes = _sizes(prim, time, attributes)
    if isinstance(form, Primitive) and len(sizes) < 4:
        form.size = np.array((*sizes, 0.0, 0.0, 0.0)[:3], np.float64)


def _sizes(prim: Usd.Prim, time: Usd.TimeCode, attributes: AttributeReader) -> tuple[float, ...]:
    """Return the sizes as ``kernels/types.py`` defines them; three for solids of two different radii."""

    def value(name: str) -> float:
        return attributes.number(prim, name, time)

    kind = str(prim.GetTypeName())
    if kind == "Cube":
        return (0.5 * value("size"),) * 3
    if kind == "Sphere":
        return (value("radius"),)
    if kind == "Plane":
        axis = attributes.get(prim, "axis", time)
        # Width lies along x and length along y of a plane about z; of one about x or y see UsdGeomPlane.
        width, length = 0.5 * value("width"), 0.5 * value("length")
        return (length, width) if axis == "X" else (length, width) if axis == "Y" else (width, length)
    if kind in ("Cylinder_1", "Capsule_1"):
        bottom, top = value("radiusBottom"), value("radiusTop")
        if bottom != top:
            return bottom, top, 0.5 * value("height")
        return bottom, 0.5 * value("height")
    return value("radius"), 0.5 * value("height")
