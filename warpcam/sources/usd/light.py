"""Lights of a stage, in what they send to a surface."""

import math
from collections.abc import Callable

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux

from warpcam.sources.common import materials
from warpcam.sources.common.scene_graph import LightNode
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.attributes import AttributeReader

LOCAL = ("SphereLight", "DiskLight", "RectLight", "CylinderLight")
SUN = ("DistantLight",)
DOME = ("DomeLight", "DomeLight_1")


def is_light(prim: Usd.Prim) -> bool:
    return str(prim.GetTypeName()) in (*LOCAL, *SUN, *DOME, "GeometryLight", "PortalLight")


def pole_of(prim: Usd.Prim, attributes: AttributeReader) -> np.ndarray:
    """Return the orientation of a dome in its own frame, (3, 3).

    Its pole is y unless it says z, or the stage's up axis.
    """
    pole = attributes.get(prim, "poleAxis", expected=Sdf.ValueTypeNames.Token) or "Y"
    if pole == "scene":
        pole = UsdGeom.GetStageUpAxis(prim.GetStage())
    return np.array(((1, 0, 0), (0, 0, -1), (0, 1, 0)), np.float64) if pole == "Z" else np.eye(3)


def read_light(
    prim: Usd.Prim,
    node: int,
    name: str,
    time: Usd.TimeCode,
    scale: float,
    attributes: AttributeReader,
    collector: WarningCollector,
    mean_of: Callable[[Sdf.AssetPath, str], np.ndarray | None],
    sky_of: Callable[[Sdf.AssetPath, str], np.ndarray | None],
) -> LightNode:
    """The light at a time.

    Args:
        prim: The light.
        node: Its frame.
        name: Its path.
        time: When.
        scale: Metres in one unit of its own.
        attributes: Reader of the values.
        collector: Where approximations are told.
        mean_of: The mean linear colour of an image.
        sky_of: The terms of a dome's image, (SKY_TERMS, 3).
    """
    types = Sdf.ValueTypeNames

    def value(attribute: str, default: float, low: float = 0.0, high: float = math.inf) -> float:
        """A number by its name, or by the name it had before inputs had a prefix."""
        own = next((n for n in (f"inputs:{attribute}", attribute) if prim.GetAttribute(n)), f"inputs:{attribute}")
        return attributes.number(prim, own, time, default, low, high)

    def image_file() -> Sdf.AssetPath | None:
        asset: Sdf.AssetPath | None = attributes.get(prim, "inputs:texture:file", time, types.Asset)
        return asset if asset is not None and asset.path else None

    kind = str(prim.GetTypeName())
    color = attributes.get(prim, "inputs:color", time, types.Color3f)
    color = np.ones(3) if color is None else color
    if attributes.get(prim, "inputs:enableColorTemperature", time, types.Bool):
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(value("colorTemperature", 6500.0)))
    with np.errstate(over="ignore", invalid="ignore"):
        radiance = color * value("intensity", 1.0) * np.exp2(value("exposure", 0.0, -math.inf))
    if not np.isfinite(radiance).all():
        collector.warn("is of a brightness that is not finite, and gives no light", name)
        radiance = np.zeros(3)
    normalize = bool(attributes.get(prim, "inputs:normalize", time, types.Bool))
    casts = attributes.get(prim, "inputs:shadow:enable", time, types.Bool) is not False
    angle = value("shaping:cone:angle", 180.0, 0.0, 180.0)  # of a light with UsdLuxShapingAPI 90 unless it is given
    near, one_sided, shape, form, size, seen = 0.0, False, "local", "point", (0.0, 0.0, 0.0), 0.0
    terms: np.ndarray | None = None
    image_gain = np.zeros(3)
    if kind in SUN:
        shape = "distant"
        half = math.radians(0.5 * value("angle", 0.53, 0.0, 180.0))
        # A disk in the sky of this size gives its radiance times pi sin(half)^2 of irradiance.
        factor = 1.0 / math.pi if normalize or half == 0.0 else math.sin(half) ** 2
        size = (math.sin(half) ** 2, 0.0, 0.0)
    elif kind in DOME:
        shape, factor = "dome", 1.0
        texture = image_file()
        terms = materials.even_sky(radiance)
        if texture is not None:
            laid = attributes.get(prim, "inputs:texture:format", time)
            if laid not in ("automatic", "latlong"):
                collector.warn(f"is a dome whose image is laid as {laid}, which is read as latlong", name)
            image = sky_of(texture, name)
            if image is not None:
                image_gain, terms = radiance, radiance * image
                radiance = terms[0]
    elif kind in LOCAL:
        if kind == "SphereLight":
            radius = value("radius", 0.5)
            area, seen = 4.0 * math.pi * radius**2, math.pi * radius**2
            as_point = attributes.get(prim, "treatAsPoint", time)
            form, size = "sphere", (radius, 0.0, 0.0)
        elif kind == "CylinderLight":
            radius, length = value("radius", 0.5), value("length", 1.0)
            area, seen = 2.0 * math.pi * radius * length, 2.0 * radius * length
            as_point = attributes.get(prim, "treatAsLine", time)
            form, size = "cylinder", (radius, 0.5 * length, 0.0)
        elif kind == "DiskLight":
            radius = value("radius", 0.5)
            area = seen = math.pi * radius**2
            as_point, one_sided = False, True
            form, size = "disk", (radius, 0.0, 0.0)
        else:
            area = seen = value("width", 1.0) * value("height", 1.0)
            as_point, one_sided = False, True
            form, size = "rectangle", (0.5 * value("width", 1.0), 0.5 * value("height", 1.0), 0.0)
            texture = image_file()
            if texture is not None:
                mean = mean_of(texture, name)
                radiance = radiance * (mean if mean is not None else 1.0)
        area, seen = area * scale**2, seen * scale**2
        if normalize:
            factor = (seen / area if area > 0.0 else 1.0) / math.pi
        else:
            factor = seen / math.pi if not as_point else 1.0 / math.pi
        near = seen / math.pi if one_sided else 0.0
        size = (size[0] * scale, size[1] * scale, 0.0)
        if as_point or not seen > 0.0:
            form, size = "point", (0.0, 0.0, 0.0)
        else:
            collector.remark("casts hard shadows, as from its middle, where soft_shadows=True is not asked for", name)
    else:
        collector.warn(f"is a light of type {kind}, which gives no light here", name)
        return LightNode(name, node, "distant", (0.0, 0.0, 0.0), active=False)
    strength = np.maximum(np.nan_to_num(radiance * factor, posinf=0.0, neginf=0.0), 0.0)
    red, green, blue = (float(channel) for channel in strength)
    gain = [float(channel) for channel in np.nan_to_num(image_gain, posinf=0.0, neginf=0.0)]
    return LightNode(
        name,
        node,
        shape,
        strength=(red, green, blue),
        near=near,
        one_sided=one_sided,
        cone=angle,
        casts_shadow=casts,
        form=form,
        size=size,
        seen=seen,
        diffuse=value("diffuse", 1.0),
        specular=value("specular", 1.0),
        terms=terms,
        image_gain=(gain[0], gain[1], gain[2]),
    )
