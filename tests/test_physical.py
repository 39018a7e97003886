"""Physically based shading against closed forms and a reference in numpy."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from stages import add_material, add_mesh, add_square, image, metric

FOVY, SIZE = 30.0, 48
UPRIGHT = np.array((0.0, 0.0, 1.0))
SPHERE_AT = np.array((0.0, 0.0, -4.0))  # of radius 1, seen from the origin along -z


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    return metric(Usd.Stage.CreateNew(str(tmp_path / "scene.usda")))


def bind(prim: Any, stage: Usd.Stage, **inputs: Any) -> UsdShade.Shader:
    surface = add_material(stage, "/Looks/m", **inputs)
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(stage, "/Looks/m"))
    return surface


def add_ball(stage: Usd.Stage, **inputs: Any) -> None:
    ball = UsdGeom.Sphere.Define(stage, "/ball")
    ball.CreateRadiusAttr(1.0)
    UsdGeom.Xformable(ball).AddTranslateOp().Set(Gf.Vec3d(*SPHERE_AT))
    bind(ball, stage, **inputs)


def add_sun(stage: Usd.Stage, toward: Any, color: Any = (1.0, 1.0, 1.0), angle: float = 0.0) -> None:
    """Shines from ``toward``; a white surface that faces it shows ``color``."""
    sun = UsdLux.DistantLight.Define(stage, "/sun")
    sun.CreateNormalizeAttr(True)
    sun.CreateAngleAttr(angle)
    sun.CreateIntensityAttr(np.pi)
    sun.CreateColorAttr(color)
    turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(*map(float, toward))).GetQuat()
    UsdGeom.Xformable(sun).AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(turn)


def see(stage: Usd.Stage, device: wp.Device, *outputs: str, exposure: float = 0.0, **more: Any) -> dict[str, Any]:
    camera = wc.Camera(
        "c", width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=FOVY), position=(0.0, 0.0, 0.0), outputs=outputs, **more
    )
    images = wc.Renderer(wc.from_usd(stage, device=device, exposure=exposure), [camera]).render()["c"]
    return {name: tensor[0].cpu().numpy() for name, tensor in images.items()}


def ball_normals() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where pixels see the ball, (row, column) bool; normals there and directions to the eye, (pixel, 3)."""
    half = np.tan(np.radians(0.5 * FOVY))
    at = ((np.arange(SIZE) + 0.5) / SIZE * 2.0 - 1.0) * half
    x, y = np.meshgrid(at, -at)
    ray = np.stack((x, y, -np.ones_like(x)), axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = ray @ SPHERE_AT
    rest = along**2 - (SPHERE_AT @ SPHERE_AT - 1.0)
    hit = rest > 1e-3
    place = (along[hit] - np.sqrt(rest[hit]))[:, None] * ray[hit]
    return hit, place - SPHERE_AT, -ray[hit]


def encoded(linear: np.ndarray) -> np.ndarray:
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=-1, keepdims=True)


def unit(a: Any) -> np.ndarray:
    a = np.asarray(a, np.float64)
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def gltf_brdf(
    n: np.ndarray, light: np.ndarray, v: np.ndarray, color: np.ndarray, roughness: float, metallic: float
) -> np.ndarray:
    """Appendix B of glTF 2.0, times pi and the cosine to the light."""
    alpha = roughness**2
    h = unit(light + v)
    nl, nv, nh, vh = (np.clip(dot(a, b), 0.0, 1.0) for a, b in ((n, light), (n, v), (n, h), (v, h)))
    straight = 0.04 * (1.0 - metallic) + metallic * color
    mirrored = straight + (1.0 - straight) * (1.0 - vh) ** 5
    facets = alpha**2 / (np.pi * (nh**2 * (alpha**2 - 1.0) + 1.0) ** 2)
    masked = nl * np.sqrt(nv**2 * (1.0 - alpha**2) + alpha**2)
    shadowed = nv * np.sqrt(nl**2 * (1.0 - alpha**2) + alpha**2)
    gloss = facets * 0.5 / np.maximum(masked + shadowed, 1e-12)
    return nl * ((1.0 - mirrored) * (1.0 - metallic) * color + np.pi * gloss * mirrored)


def test_a_matt_ball_under_the_sun(stage: Usd.Stage, device: wp.Device) -> None:
    """Albedo times cosine, linear, and encoded to within one level."""
    color, toward = np.array((0.8, 0.4, 0.1)), unit((0.5, 0.3, 1.0))
    add_ball(stage, diffuseColor=tuple(color), ior=1.0)
    add_sun(stage, toward, (1.0, 0.9, 0.7))
    seen = see(stage, device, "rgb", "hdr", "albedo")
    hit, normals, _ = ball_normals()
    wanted = color * np.array((1.0, 0.9, 0.7)) * np.maximum(normals @ toward, 0.0)[:, None]
    np.testing.assert_allclose(seen["hdr"][hit], wanted, atol=1e-3)
    assert np.abs(seen["rgb"][hit].astype(int) - 255.0 * encoded(wanted)).max() <= 1.0
    assert np.abs(seen["albedo"][hit] - 255.0 * encoded(color)).max() <= 0.51


@pytest.mark.parametrize("roughness", [0.15, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
def test_a_highlight_is_that_of_gltf(stage: Usd.Stage, roughness: float, metallic: float, device: wp.Device) -> None:
    color, toward = np.array((0.9, 0.5, 0.2)), unit((0.3, 0.4, 1.0))
    add_ball(stage, diffuseColor=tuple(color), roughness=roughness, metallic=metallic)
    add_sun(stage, toward)
    seen = see(stage, device, "hdr")["hdr"]
    hit, normals, to_eye = ball_normals()
    wanted = gltf_brdf(normals, np.broadcast_to(toward, normals.shape), to_eye, color, roughness, metallic)
    # A highlight's flank: to 1e-3 of what it is at most, as float32 normals are not better than its slope has it.
    np.testing.assert_allclose(seen[hit], wanted, atol=1e-3 * max(1.0, wanted.max()))


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_a_white_ball_is_lost_in_a_white_sky(
    stage: Usd.Stage, roughness: float, metallic: float, device: wp.Device
) -> None:
    """The white furnace: nothing is lost and nothing is won, on the way from the eye over any facet."""
    add_ball(stage, diffuseColor=(1.0, 1.0, 1.0), roughness=roughness, metallic=metallic)
    UsdLux.DomeLight.Define(stage, "/sky").CreateIntensityAttr(0.7)
    seen = see(stage, device, "hdr")["hdr"]
    np.testing.assert_allclose(seen[ball_normals()[0]], 0.7, rtol=1e-3)


def test_a_sky_of_one_colour(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """An image of one colour shows as that on a matt surface, times its own colour, whichever way it is turned."""
    Image.fromarray(np.full((8, 16, 3), (188, 137, 99), np.uint8)).save(tmp_path / "sky.png")
    dome = UsdLux.DomeLight.Define(stage, "/sky")
    dome.CreateTextureFileAttr("./sky.png")
    dome.CreateIntensityAttr(2.0)
    color = np.array((0.5, 0.25, 1.0))
    add_ball(stage, diffuseColor=tuple(color), ior=1.0)
    seen = see(stage, device, "hdr", "rgb")
    coded = np.array((188, 137, 99)) / 255.0
    radiance = 2.0 * ((coded + 0.055) / 1.055) ** 2.4
    hit = ball_normals()[0]
    np.testing.assert_allclose(seen["hdr"][hit], np.broadcast_to(color * radiance, (hit.sum(), 3)), rtol=5e-3)
    # Behind it is the image, as bright as it lights.
    np.testing.assert_allclose(seen["hdr"][0, 0], radiance, rtol=5e-3)
    assert np.abs(seen["rgb"][0, 0] - 255.0 * encoded(radiance)).max() <= 1.0


def test_a_sky_lights_from_where_it_is_bright(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """Radiance 1 + z is 1 + 2/3 n.z on a matt surface, and in a mirror what is there."""
    height, width = 64, 128
    up = np.sin(np.pi * (0.5 - (np.arange(height) + 0.5) / height))
    pixels = np.rint(255.0 * encoded(0.5 * (1.0 + up)))[:, None, None].repeat(width, 1).repeat(3, 2)
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
    """Of a sphere of radius 0.5 the points, normals, areas that see ``point``."""
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
    """What each of many small parts of a surface of radiance 1 sends to a point, as vectors, over pi."""
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


def textured_floor(stage: Usd.Stage, mirrored: bool = False, **files: tuple[str, str, str]) -> None:
    """A white matt floor of 2 m below the camera; input=(file, output, colour space)."""
    square = add_mesh(stage, "/floor", [(-1, -1, -2), (1, -1, -2), (1, 1, -2), (-1, 1, -2)], [(0, 1, 2, 3)])
    uvs = [(1, 0), (0, 0), (0, 1), (1, 1)] if mirrored else [(0, 0), (1, 0), (1, 1), (0, 1)]
    UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(uvs)
    surface = bind(square, stage, diffuseColor=(1.0, 1.0, 1.0), ior=1.0)
    for name, (file, output, space) in files.items():
        texture = UsdShade.Shader.Define(stage, f"/Looks/m/{name}")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        if name == "normal":
            texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set((2, 2, 2, 1))
            texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set((-1, -1, -1, 0))
        kind = Sdf.ValueTypeNames.Float if len(output) == 1 else Sdf.ValueTypeNames.Color3f
        given = surface.GetInput(name) or surface.CreateInput(name, kind)
        given.ConnectToSource(texture.ConnectableAPI(), output)


def uniform(path: Path, color: Any) -> None:
    Image.fromarray(np.full((4, 4, 3), color, np.uint8)).save(path)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_map_tilts_the_normal(stage: Usd.Stage, tmp_path: Path, axis: int, mirrored: bool, device: wp.Device) -> None:
    """Red is along u, green along v, which is up; a mirrored image tilts to the other side along u."""
    angle = np.radians(30.0)
    tilted = np.array((0.0, 0.0, np.cos(angle)))
    tilted[axis] = np.sin(angle)
    coded = np.rint(127.5 * (tilted + 1.0))
    uniform(tmp_path / "n.png", coded)
    textured_floor(stage, mirrored, normal=("./n.png", "rgb", "raw"))
    toward = unit((0.4, 0.5, 1.0))
    add_sun(stage, toward)
    really = unit(coded / 127.5 - 1.0)
    if mirrored:
        really[0] *= -1.0
    middle = see(stage, device, "hdr", "normals")
    np.testing.assert_allclose(middle["hdr"][SIZE // 2, SIZE // 2], really @ toward, atol=1e-3)
    np.testing.assert_allclose(middle["normals"][SIZE // 2, SIZE // 2], UPRIGHT, atol=1e-5)  # of the geometry


def test_roughness_and_metalness_by_the_pixel(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """glTF's packing: green is roughness, blue metalness."""
    uniform(tmp_path / "orm.png", (255, 102, 204))
    textured_floor(stage, roughness=("./orm.png", "g", "raw"), metallic=("./orm.png", "b", "raw"))
    UsdShade.Shader.Get(stage, "/Looks/m/surface").GetInput("ior").Set(1.5)
    UsdShade.Shader.Get(stage, "/Looks/m/surface").GetInput("diffuseColor").Set((0.9, 0.5, 0.2))
    toward = unit((0.1, 0.2, 1.0))
    add_sun(stage, toward)
    row = column = SIZE // 2
    half = np.tan(np.radians(0.5 * FOVY)) / SIZE
    to_eye = unit((-half, half, 1.0))
    wanted = gltf_brdf(UPRIGHT, toward, to_eye, np.array((0.9, 0.5, 0.2)), 0.4, 0.8)
    np.testing.assert_allclose(see(stage, device, "hdr")["hdr"][row, column], wanted, atol=1e-3)


def test_what_a_map_makes_shine(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    uniform(tmp_path / "glow.png", (188, 0, 99))
    textured_floor(stage, emissiveColor=("./glow.png", "rgb", "sRGB"))
    add_sun(stage, (0.0, 0.0, 1.0), (0.25, 0.25, 0.25))
    coded = np.array((188, 0, 99)) / 255.0
    glow = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(see(stage, device, "hdr")["hdr"][SIZE // 2, SIZE // 2], 0.25 + glow, atol=1e-3)


def test_occlusion_keeps_the_sky_off(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    uniform(tmp_path / "ao.png", (102, 255, 255))
    textured_floor(stage, occlusion=("./ao.png", "r", "raw"))
    UsdLux.DomeLight.Define(stage, "/sky")
    np.testing.assert_allclose(see(stage, device, "hdr")["hdr"][SIZE // 2, SIZE // 2], 0.4, atol=2e-3)


def test_smooth_normals_are_lit_by_the_pixel(stage: Usd.Stage, device: wp.Device) -> None:
    """One triangle whose corners' normals differ has a highlight in its middle."""
    mesh = add_mesh(stage, "/it", [(-1, -1, -3), (1, -1, -3), (0, 1, -3)], [(0, 1, 2)])
    corners = unit([(-0.5, -0.5, 1.0), (0.5, -0.5, 1.0), (0.0, 0.5, 1.0)])
    mesh.CreateNormalsAttr([tuple(map(float, normal)) for normal in corners])
    bind(mesh, stage, diffuseColor=(0.0, 0.0, 0.0), roughness=0.3)
    add_sun(stage, (0.0, 0.0, 1.0))
    row, column = 26, 24
    seen = see(stage, device, "hdr", "points")
    place = seen["points"][row, column].astype(np.float64)
    third = (place[1] + 1.0) / 2.0
    second = (place[0] + 1.0 - third) / 2.0
    normal = unit(np.array((1.0 - second - third, second, third)) @ corners)
    wanted = gltf_brdf(normal, UPRIGHT, unit(-place), np.zeros(3), 0.3, 0.0)
    assert wanted.min() > 0.2
    np.testing.assert_allclose(seen["hdr"][row, column], wanted, rtol=1e-3)


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


def test_materials_are_written_in_place(stage: Usd.Stage, device: wp.Device) -> None:
    add_ball(stage, diffuseColor=(0.5, 0.5, 0.5), roughness=0.3)
    add_sun(stage, (0.0, 0.0, 1.0))
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    renderer = wc.Renderer(scene, [wc.Camera("c", width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=FOVY),
                                             position=(0, 0, 0), outputs=("hdr",))])  # fmt: skip
    before = renderer.render()["c"]["hdr"][0].cpu().numpy().copy()
    assert scene.array("material_roughness").numpy().tolist() == [[pytest.approx(0.3)]]
    scene.array("material_roughness").fill_(0.6)
    scene.array("material_metallic").fill_(1.0)
    scene.set_colors(["/ball"], np.array([[encoded(np.array((0.9, 0.5, 0.2)))]], np.float32))
    after = renderer.render()["c"]["hdr"][0].cpu().numpy()
    hit, normals, to_eye = ball_normals()
    toward = np.broadcast_to(UPRIGHT, normals.shape)
    for seen, color, rough, metal in ((before, (0.5, 0.5, 0.5), 0.3, 0.0), (after, (0.9, 0.5, 0.2), 0.6, 1.0)):
        wanted = gltf_brdf(normals, toward, to_eye, np.array(color), rough, metal)
        np.testing.assert_allclose(seen[hit], wanted, atol=2e-3)
