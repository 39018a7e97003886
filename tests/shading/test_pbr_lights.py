"""Lights of physically based scenes: what arrives of points, of lights of a size, and of skies."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.core.color import linear_to_srgb, srgb_to_linear

pytest.importorskip("pxr.Usd")
from pbr_scenes import UPRIGHT, add_ball, add_sun, ball_normals, bind, dot, see, textured_floor, unit
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from usd_stages import add_square, image


def test_a_sky_of_one_colour(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """An image of one colour shows as that on a matt surface, times its own colour, whichever way it is turned."""
    Image.fromarray(np.full((8, 16, 3), (188, 137, 99), np.uint8)).save(tmp_path / "sky.png")
    dome = UsdLux.DomeLight.Define(stage, "/sky")
    dome.CreateTextureFileAttr("./sky.png")
    dome.CreateIntensityAttr(2.0)
    color = np.array((0.5, 0.25, 1.0))
    add_ball(stage, diffuseColor=tuple(color), ior=1.0)
    seen = see(stage, device, "hdr", "rgb")
    radiance = 2.0 * srgb_to_linear(np.array((188, 137, 99)) / 255.0)
    hit = ball_normals()[0]
    np.testing.assert_allclose(seen["hdr"][hit], np.broadcast_to(color * radiance, (hit.sum(), 3)), rtol=5e-3)
    # Behind it is the image, as bright as it lights.
    np.testing.assert_allclose(seen["hdr"][0, 0], radiance, rtol=5e-3)
    assert np.abs(seen["rgb"][0, 0] - 255.0 * linear_to_srgb(radiance)).max() <= 1.0


def test_a_sky_lights_from_where_it_is_bright(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """Radiance 1 + z is 1 + 2/3 n.z on a matt surface, and in a mirror what is there."""
    height, width = 64, 128
    up = np.sin(np.pi * (0.5 - (np.arange(height) + 0.5) / height))
    pixels = np.rint(255.0 * linear_to_srgb(0.5 * (1.0 + up)))[:, None, None].repeat(width, 1).repeat(3, 2)
    Image.fromarray(pixels.astype(np.uint8)).save(tmp_path / "sky.png")
    dome = UsdLux.DomeLight.Define(stage, "/sky")
    dome.CreateTextureFileAttr("./sky.png")
    dome.CreateIntensityAttr(2.0)
    UsdGeom.Xformable(dome).AddRotateXOp().Set(90.0)  # its top, +y, is +z
    add_ball(stage, diffuseColor=(1.0, 1.0, 1.0), ior=1.0)
    hit, normals, to_eye = ball_normals()
    wanted = 1.0 + 2.0 / 3.0 * normals[:, 2:]
    np.testing.assert_allclose(see(stage, device, "hdr")["hdr"][hit], np.repeat(wanted, 3, 1), atol=0.01)
    surface = UsdShade.Shader.Get(stage, "/Looks/m/surface")
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(1.0)
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.0)
    mirror = 2.0 * dot(normals, to_eye) * normals - to_eye
    facing = dot(normals, to_eye)[:, 0] > 0.3
    seen = see(stage, device, "hdr")["hdr"][hit][facing]
    np.testing.assert_allclose(seen, np.repeat(1.0 + mirror[facing, 2:], 3, 1), atol=0.04)


def test_a_mirror_shows_the_skys_image(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """Above the horizon it is white and below it black, which is no sum of few harmonics."""
    Image.fromarray(np.repeat((255, 0), 32)[:, None, None].repeat(128, 1).repeat(3, 2).astype(np.uint8)).save(
        tmp_path / "sky.png"
    )
    dome = UsdLux.DomeLight.Define(stage, "/sky")
    dome.CreateTextureFileAttr("./sky.png")
    UsdGeom.Xformable(dome).AddRotateXOp().Set(90.0)  # its top, +y, is +z
    add_ball(stage, diffuseColor=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.0)
    hit, normals, to_eye = ball_normals()
    mirrored = 2.0 * dot(normals, to_eye) * normals - to_eye
    away = (dot(normals, to_eye)[:, 0] > 0.3) & (np.abs(mirrored[:, 2]) > 0.1)
    assert 100 < np.count_nonzero(mirrored[away, 2] > 0.0) < np.count_nonzero(away) - 100
    wanted = np.repeat((mirrored[away, 2:] > 0.0).astype(float), 3, 1)
    np.testing.assert_allclose(see(stage, device, "hdr")["hdr"][hit][away], wanted, atol=0.05)


def floor_light(
    stage: Usd.Stage, device: wp.Device, at: tuple[float, float, float], tilt: float = 0.0, **inputs: Any
) -> float:
    """Radiance of a small white matt floor at a place, turned about x [degrees]."""
    square = UsdGeom.Mesh.Get(stage, "/floor")
    if not square:
        square = add_square(stage, "/floor", half=1e-3)
        square.CreateDoubleSidedAttr(True)
        bind(square, stage, **{"diffuseColor": (1.0, 1.0, 1.0), "ior": 1.0, **inputs})
        move, turn = UsdGeom.Xformable(square).AddTranslateOp(), UsdGeom.Xformable(square).AddRotateXOp()
    else:
        move, turn = UsdGeom.Xformable(square).GetOrderedXformOps()
    move.Set(Gf.Vec3d(*at))
    turn.Set(tilt)
    angle = np.radians(tilt)
    normal = np.array((0.0, -np.sin(angle), np.cos(angle)))
    camera = wc.Camera(
        "c", width=1, height=1, lens=wc.Orthographic(height=1e-4), position=tuple(np.array(at) + 0.01 * normal),
        rotation=(np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0, 0.0), outputs=("hdr",),
    )  # fmt: skip
    return float(image(wc.from_usd(stage, device=device, exposure=0.0), "hdr", camera)[0])


def test_a_point_fades_with_the_square_of_its_distance(stage: Usd.Stage, device: wp.Device) -> None:
    lamp = UsdLux.SphereLight.Define(stage, "/lamp")
    lamp.CreateTreatAsPointAttr(True)
    lamp.CreateIntensityAttr(7.0)
    for distance in (0.5, 1.0, 3.0):
        seen = floor_light(stage, device, (0.0, 0.0, -distance))
        assert seen == pytest.approx(7.0 / np.pi / distance**2, rel=1e-4)


def around(u: np.ndarray) -> np.ndarray:
    return np.stack((np.cos(2.0 * np.pi * u), np.sin(2.0 * np.pi * u), 0.0 * u), axis=-1)


def of_sphere(point: np.ndarray) -> np.ndarray:
    """Return the points, normals and areas of a sphere of radius 0.5 that see ``point``."""
    return surface_light(
        point,
        lambda u, v: 0.5 * np.sqrt(1 - (2 * v - 1) ** 2)[..., None] * around(u) + (v - 0.5)[..., None] * UPRIGHT,
        lambda p: unit(p), np.pi,
    )  # fmt: skip


def of_rectangle(point: np.ndarray) -> np.ndarray:
    return surface_light(
        point, lambda u, v: np.stack((u - 0.5, 2.0 * v - 1.0, 0.0 * u), -1),
        lambda p: np.broadcast_to((0.0, 0.0, -1.0), p.shape), 2.0,
    )  # fmt: skip


def of_disk(point: np.ndarray) -> np.ndarray:
    return surface_light(
        point, lambda u, v: 0.5 * np.sqrt(v)[..., None] * around(u),
        lambda p: np.broadcast_to((0.0, 0.0, -1.0), p.shape), np.pi / 4,
    )  # fmt: skip


def of_cylinder(point: np.ndarray) -> np.ndarray:
    radius = 0.02
    return surface_light(
        point, lambda u, v: (2.0 * v - 1.0)[..., None] * (1.0, 0.0, 0.0) + radius * around(u)[..., [2, 0, 1]],
        lambda p: unit(p * (0.0, 1.0, 1.0)), 4.0 * np.pi * radius,
    )  # fmt: skip


def surface_light(
    point: np.ndarray, place: Callable[..., np.ndarray], normal: Callable[..., np.ndarray], area: float
) -> np.ndarray:
    """Return the light of each small part of a surface of radiance 1 at a point, as vectors, over pi."""
    at = (np.arange(600) + 0.5) / 600
    u, v = (x.reshape(-1) for x in np.meshgrid(at, at))
    parts = place(u, v)
    way = parts - point
    square = dot(way, way)
    toward = way / np.sqrt(square)
    return toward * np.maximum(-dot(normal(parts), toward), 0.0) / square * area / len(u) / np.pi


LIGHTS = {"SphereLight": of_sphere, "RectLight": of_rectangle, "DiskLight": of_disk, "CylinderLight": of_cylinder}


PLACES = {  # place, tilt [degrees], and what may be amiss, of what arrives
    "below": ((0.0, 0.0, -1.5), 0.0, 1e-3),
    "tilted": ((0.0, 0.0, -1.5), 40.0, 1e-3),
    "aside": ((0.7, 0.3, -1.5), 20.0, 1e-3),
    "cut by the horizon": ((0.0, 0.0, -1.2), 85.0, 1e-3),
}


APPROXIMATE = {  # the horizon cuts all lights as it does spheres; cylinders are as thin as lines
    ("DiskLight", "aside"): 0.05,
    ("DiskLight", "cut by the horizon"): 0.02,
    ("RectLight", "cut by the horizon"): 0.25,
    **{("CylinderLight", where): 0.01 for where in PLACES},
}


@pytest.mark.parametrize("kind", LIGHTS)
@pytest.mark.parametrize("where", PLACES)
def test_what_arrives_of_a_light_of_a_size(stage: Usd.Stage, kind: str, where: str, device: wp.Device) -> None:
    """Against the sum over its surface: exact on the axis, near to it elsewhere."""
    at, tilt, tolerance = PLACES[where]
    tolerance = APPROXIMATE.get((kind, where), tolerance)
    lamp = getattr(UsdLux, kind).Define(stage, "/lamp")
    lamp.CreateIntensityAttr(3.0)
    if kind == "RectLight":
        lamp.CreateWidthAttr(1.0)
        lamp.CreateHeightAttr(2.0)
    else:
        lamp.CreateRadiusAttr(0.02 if kind == "CylinderLight" else 0.5)
    if kind == "CylinderLight":
        lamp.CreateLengthAttr(2.0)
    angle = np.radians(tilt)
    parts = LIGHTS[kind](np.array(at)) @ np.array((0.0, -np.sin(angle), np.cos(angle)))
    assert floor_light(stage, device, at, tilt) == pytest.approx(3.0 * np.maximum(parts, 0.0).sum(), rel=tolerance)


def test_a_light_is_as_bright_in_a_mirror_as_it_is(stage: Usd.Stage, device: wp.Device) -> None:
    """However smooth a surface: its highlight is no brighter than the light, and as wide."""
    lamp = UsdLux.SphereLight.Define(stage, "/lamp")
    lamp.CreateIntensityAttr(5.0)
    lamp.CreateRadiusAttr(0.2)
    for roughness, least in ((0.0, 0.99), (0.1, 0.95), (0.3, 0.2)):
        stage.RemovePrim("/floor")
        white = {"diffuseColor": (1.0, 1.0, 1.0), "metallic": 1.0, "roughness": roughness}
        assert least < floor_light(stage, device, (0.0, 0.0, -2.0), **white) / 5.0 < 1.0


def test_shadows_take_a_light_away(stage: Usd.Stage, device: wp.Device) -> None:
    """All of it but what comes from the sky."""
    textured_floor(stage)
    cover = add_square(stage, "/cover", half=0.2)
    cover.CreateDoubleSidedAttr(True)
    UsdGeom.Xformable(cover).AddTranslateOp().Set(Gf.Vec3d(0.5, 0.0, -1.0))
    add_sun(stage, (0.5, 0.0, 1.0))
    UsdLux.DomeLight.Define(stage, "/sky").CreateIntensityAttr(0.1)
    lit = see(stage, device, "hdr")["hdr"][24, 24]
    shaded = see(stage, device, "hdr", shadows=True)["hdr"][24, 24]
    np.testing.assert_allclose(lit, 0.1 + unit((0.5, 0.0, 1.0))[2], rtol=1e-3)
    np.testing.assert_allclose(shaded, 0.1, rtol=1e-3)
