"""Reflection by itself: reciprocal, no more light than came, and drawn with the density that it says."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels.build.facet_albedo import facet_albedo

NORMAL = np.array((0.36, -0.48, 0.8))  # of the surface
COUNT = 400_000


@wp.struct
class Surface:
    color: wp.vec3
    roughness: wp.float32
    metallic: wp.float32
    reflectance: wp.float32
    normal: wp.vec3


@wp.func_native("""
    const warpcam::Vec3 color = warpcam::as_vec3(surface.color), normal = warpcam::as_vec3(surface.normal);
    const warpcam::Reflector reflector(color, surface.roughness, surface.metallic, surface.reflectance,
                                       warpcam::AlbedoTable { albedo.data });
    const warpcam::Vec3 eye = warpcam::as_vec3(wp::index(eyes, i));
    const float share = reflector.facet_share(warpcam::dot(normal, eye));
    warpcam::Vec3 light = warpcam::as_vec3(wp::index(lights, i));
    if (draw) {
        light = reflector.sample(warpcam::FrameAxes(normal), eye, share, light.x, light.y, light.z);
        wp::index(lights, i) = wp::vec3(light.x, light.y, light.z);
    }
    const warpcam::ReflectedParts parts = reflector.value(normal, eye, light);
    const warpcam::Vec3 sum = parts.matt + parts.gloss;
    wp::index(values, i) = wp::vec4(sum.x, sum.y, sum.z, reflector.density(normal, eye, light, share));
""")
def reflect_one(
    surface: Surface,
    albedo: wp.array(dtype=wp.float32),
    eyes: wp.array(dtype=wp.vec3),
    lights: wp.array(dtype=wp.vec3),
    values: wp.array(dtype=wp.vec4),
    draw: int,
    i: int,
): ...


@native_kernel("path/reflection.h")
def reflect(
    surface: Surface,
    albedo: wp.array(dtype=wp.float32),
    eyes: wp.array(dtype=wp.vec3),
    lights: wp.array(dtype=wp.vec3),
    values: wp.array(dtype=wp.vec4),
    draw: wp.int32,
):
    reflect_one(surface, albedo, eyes, lights, values, draw, wp.tid())


def reflected(device: wp.Device, eyes: Any, lights: Any, draw: bool, **material: Any) -> tuple[np.ndarray, np.ndarray]:
    """Values [1/sr] with densities, (n, 4), and directions to the light; ``draw``: ``lights`` are random numbers."""
    surface: Any = Surface()
    surface.color = wp.vec3(*material.get("color", (1.0, 1.0, 1.0)))
    surface.roughness, surface.metallic = material["roughness"], material["metallic"]
    surface.reflectance, surface.normal = material.get("reflectance", 0.04), wp.vec3(*NORMAL)
    eyes, lights = (wp.array(np.asarray(v, np.float32), dtype=wp.vec3, device=device) for v in (eyes, lights))
    values = wp.zeros(len(lights), dtype=wp.vec4, device=device)
    albedo = wp.array(facet_albedo().ravel(), dtype=wp.float32, device=device)
    wp.launch(reflect, len(lights), [surface, albedo, eyes, lights, values, int(draw)], device=device)
    return values.numpy().astype(np.float64), lights.numpy().astype(np.float64)


def hemisphere(count: int, seed: int = 0) -> np.ndarray:
    """Directions that are even over the hemisphere about the normal, (count, 3)."""
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions * np.sign(directions @ NORMAL)[:, None]


def leaning(cosine: float) -> np.ndarray:
    """A direction with that cosine to the normal."""
    across = np.cross(NORMAL, (1.0, 0.0, 0.0))
    return cosine * NORMAL + np.sqrt(1.0 - cosine**2) * across / np.linalg.norm(across)


MATERIALS = [
    {"roughness": 0.3, "metallic": 0.0, "color": (0.8, 0.4, 0.1)},
    {"roughness": 0.8, "metallic": 1.0, "color": (0.9, 0.6, 0.3)},
    {"roughness": 0.5, "metallic": 0.4, "color": (0.5, 0.5, 0.9)},
    {"roughness": 0.2, "metallic": 0.0, "color": (0.0, 0.0, 0.0), "reflectance": 0.2},
    {"roughness": 1.0, "metallic": 0.0, "color": (1.0, 1.0, 1.0), "reflectance": 0.0},
]


@pytest.mark.parametrize("material", MATERIALS, ids=str)
def test_both_ways_are_alike(material: dict[str, Any], device: wp.Device) -> None:
    eyes, lights = hemisphere(5000), hemisphere(5000, seed=1)
    there, _ = reflected(device, eyes, lights, False, **material)
    back, _ = reflected(device, lights, eyes, False, **material)
    np.testing.assert_allclose(there[:, :3], back[:, :3], rtol=1e-3, atol=1e-6)
    assert (there >= 0.0).all()


@pytest.mark.parametrize("cosine", [0.05, 0.3, 0.7, 1.0])
@pytest.mark.parametrize("material", MATERIALS, ids=str)
def test_drawn_directions_have_their_density(material: dict[str, Any], cosine: float, device: wp.Device) -> None:
    """What drawn directions say is reflected, and what even ones do; the share of drawn ones in half of the space."""
    eyes = np.broadcast_to(leaning(cosine), (COUNT, 3))
    numbers = np.random.default_rng(2).random((COUNT, 3))
    drawn, toward = reflected(device, eyes, numbers, True, **material)
    even, lights = reflected(device, eyes, hemisphere(COUNT), False, **material)
    over = drawn[:, 3] > 0.0
    rates = np.where(over, toward @ NORMAL / np.where(over, drawn[:, 3], 1.0), 0.0)[:, None] * drawn[:, :3]
    wanted = 2.0 * np.pi * (lights @ NORMAL)[:, None] * even[:, :3]
    noise = 5.0 * np.sqrt((rates.var(axis=0) + wanted.var(axis=0)) / COUNT)
    assert (np.abs(rates.mean(axis=0) - wanted.mean(axis=0)) <= noise + 1e-3).all()
    side = np.cross(NORMAL, leaning(0.5))
    density = 2.0 * np.pi * even[:, 3] * (lights @ side > 0.0)
    share = (over & (toward @ side > 0.0)).mean()
    assert abs(share - density.mean()) <= 5.0 * density.std() / np.sqrt(COUNT) + 5e-3


@pytest.mark.parametrize("cosine", [0.02, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("roughness", [0.1, 0.4, 0.7, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
def test_white_reflects_all_that_comes(cosine: float, roughness: float, metallic: float, device: wp.Device) -> None:
    eyes = np.broadcast_to(leaning(cosine), (COUNT // 2, 3))
    numbers = np.random.default_rng(3).random((COUNT // 2, 3))
    drawn, toward = reflected(device, eyes, numbers, True, roughness=roughness, metallic=metallic)
    over = drawn[:, 3] > 0.0
    rates = np.where(over, toward @ NORMAL / np.where(over, drawn[:, 3], 1.0), 0.0) * drawn[:, 0]
    assert rates.mean() == pytest.approx(1.0, abs=0.01)
