"""Lights of a stage, in what they send to a surface."""

import math
from collections.abc import Callable

import numpy as np
from pxr import Sdf, Usd, UsdLux

from warpcam.sources.graph import Lamp
from warpcam.sources.notes import Notes

LOCAL = ("SphereLight", "DiskLight", "RectLight", "CylinderLight")
SUN = ("DistantLight",)
DOME = ("DomeLight", "DomeLight_1")


def is_light(prim: Usd.Prim) -> bool:
    return str(prim.GetTypeName()) in (*LOCAL, *SUN, *DOME, "GeometryLight", "PortalLight")


def read_light(
    prim: Usd.Prim,
    node: int,
    name: str,
    time: Usd.TimeCode,
    scale: float,
    notes: Notes,
    mean_of: Callable[[Sdf.AssetPath, str], np.ndarray | None],
) -> Lamp:
    """The light at a time.

    Args:
        prim: The light.
        node: Its frame.
        name: Its path.
        time: When.
        scale: Metres in one unit of its own.
        notes: Where approximations are told.
        mean_of: The mean linear colour of an image, for domes.
    """

    def value(attribute: str, default: float) -> float:
        found = prim.GetAttribute(f"inputs:{attribute}") or prim.GetAttribute(attribute)
        got = found.Get(time) if found else None
        return float(default if got is None else got)

    kind = str(prim.GetTypeName())
    api = UsdLux.LightAPI(prim)
    color = np.array(api.GetColorAttr().Get(time) or (1.0, 1.0, 1.0), np.float64)
    if api.GetEnableColorTemperatureAttr().Get(time):
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(value("colorTemperature", 6500.0)))
    radiance = color * value("intensity", 1.0) * 2.0 ** value("exposure", 0.0) * value("diffuse", 1.0)
    normalize = bool(api.GetNormalizeAttr().Get(time))
    shadow = prim.GetAttribute("inputs:shadow:enable")
    casts = not (shadow and shadow.Get(time) is False)
    cone = prim.GetAttribute("inputs:shaping:cone:angle")
    angle = float(cone.Get(time)) if cone and cone.HasAuthoredValue() else 180.0
    near, one_sided, shape = 0.0, False, "local"
    if kind in SUN:
        shape = "distant"
        half = math.radians(0.5 * min(max(value("angle", 0.53), 0.0), 180.0))
        # A disk in the sky of this size gives its radiance times pi sin(half)^2 of irradiance.
        factor = 1.0 / math.pi if normalize or half == 0.0 else math.sin(half) ** 2
    elif kind in DOME:
        shape, factor = "dome", 1.0
        texture = prim.GetAttribute("inputs:texture:file").Get(time)
        if texture is not None and texture.path:
            mean = mean_of(texture, name)
            radiance = radiance * (mean if mean is not None else 1.0)
    elif kind in LOCAL:
        if kind == "SphereLight":
            radius = value("radius", 0.5)
            area, seen = 4.0 * math.pi * radius**2, math.pi * radius**2
            as_point = prim.GetAttribute("treatAsPoint").Get(time)
        elif kind == "CylinderLight":
            radius, length = value("radius", 0.5), value("length", 1.0)
            area, seen = 2.0 * math.pi * radius * length, 2.0 * radius * length
            as_point = prim.GetAttribute("treatAsLine").Get(time)
        elif kind == "DiskLight":
            area = seen = math.pi * value("radius", 0.5) ** 2
            as_point, one_sided = False, True
        else:
            area = seen = value("width", 1.0) * value("height", 1.0)
            as_point, one_sided = False, True
            texture = prim.GetAttribute("inputs:texture:file")
            if texture and texture.Get(time) is not None and texture.Get(time).path:
                mean = mean_of(texture.Get(time), name)
                radiance = radiance * (mean if mean is not None else 1.0)
        area, seen = area * scale**2, seen * scale**2
        if normalize:
            factor = (seen / area if area > 0.0 else 1.0) / math.pi
        else:
            factor = seen / math.pi if not as_point else 1.0 / math.pi
        near = seen / math.pi if one_sided else 0.0
        notes.remark("lights as from a point, brighter and darker as its size has it, with hard shadows", name)
    else:
        notes.warn(f"is a light of type {kind}, which gives no light here", name)
        return Lamp(name, node, "distant", (0.0, 0.0, 0.0), active=False)
    strength = np.maximum(np.nan_to_num(radiance * factor, posinf=0.0, neginf=0.0), 0.0)
    red, green, blue = (float(channel) for channel in strength)
    return Lamp(name, node, shape, (red, green, blue), near, one_sided, angle, True, casts)
