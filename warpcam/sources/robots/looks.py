"""Materials of a URDF file: its own and those that shapes have, by name or in place."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from xml.etree import ElementTree


@dataclass(frozen=True)
class UrdfLook:
    """Appearance that a material of a URDF file gives.

    Attributes:
        rgba: Display colour, or None.
        texture: File of its image, or an empty string.
    """

    rgba: tuple[float, float, float, float] | None = None
    texture: str = ""


def looks_of(robot: ElementTree.Element) -> dict[str, UrdfLook]:
    """Return the materials that have names, of the robot first and of its shapes after those."""
    found: dict[str, UrdfLook] = {}
    for material in (*robot.findall("material"), *robot.findall("link/visual/material")):
        look = _look(material)
        if look != UrdfLook():
            found.setdefault(material.get("name", ""), look)
    return found


def look_of(visual: ElementTree.Element, named: Mapping[str, UrdfLook]) -> UrdfLook:
    """Return what a shape's material says, and where it says nothing the one of its name."""
    material = visual.find("material")
    if material is None:
        return UrdfLook()
    own, other = _look(material), named.get(material.get("name", ""), UrdfLook())
    return replace(own, rgba=own.rgba or other.rgba, texture=own.texture or other.texture)


def _look(material: ElementTree.Element) -> UrdfLook:
    color, texture = material.find("color"), material.find("texture")
    rgba = None
    try:
        values = [float(value) for value in (color.get("rgba", "") if color is not None else "").split()]
    except ValueError:
        values = []
    if len(values) in (3, 4):
        red, green, blue, alpha = (min(max(value, 0.0), 1.0) for value in [*values, 1.0][:4])
        rgba = red, green, blue, alpha
    return UrdfLook(rgba, texture.get("filename", "") if texture is not None else "")
