"""Physically based surfaces, by the formulas of glTF's appendix and by what their maps say."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.core.color import linear_to_srgb, srgb_to_linear

pytest.importorskip("pxr.Usd")
from pbr_scenes import (
    FOVY,
    SIZE,
    UPRIGHT,
    add_ball,
    add_sun,
    ball_normals,
    bind,
    dot,
    see,
    textured_floor,
    unit,
)
from pxr import Usd, UsdLux, UsdShade
from usd_stages import add_mesh


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
    assert np.abs(seen["rgb"][hit].astype(int) - 255.0 * linear_to_srgb(wanted)).max() <= 1.0
    assert np.abs(seen["albedo"][hit] - 255.0 * linear_to_srgb(color)).max() <= 0.51


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
    glow = srgb_to_linear(np.array((188, 0, 99)) / 255.0)
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
    scene.set_colors(["/ball"], np.array([[linear_to_srgb(np.array((0.9, 0.5, 0.2)))]], np.float32))
    after = renderer.render()["c"]["hdr"][0].cpu().numpy()
    hit, normals, to_eye = ball_normals()
    toward = np.broadcast_to(UPRIGHT, normals.shape)
    for seen, color, rough, metal in ((before, (0.5, 0.5, 0.5), 0.3, 0.0), (after, (0.9, 0.5, 0.2), 0.6, 1.0)):
        wanted = gltf_brdf(normals, toward, to_eye, np.array(color), rough, metal)
        np.testing.assert_allclose(seen[hit], wanted, atol=2e-3)
