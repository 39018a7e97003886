"""Packets of eight pixels on a CPU, against closed forms and against single pixels."""

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels.types import Textures
from warpcam.textures.pack import TextureImage, pack_textures

EIGHT = 8


@wp.func_native("""
    using namespace warpcam;
    Float8 base;
    for (int k = 0; k < SIMD_WIDTH; ++k)
        base[k] = wp::index(bases, SIMD_WIDTH * i + k);
    const Float8 result = pow(base, exponent);
    for (int k = 0; k < SIMD_WIDTH; ++k)
        wp::index(powers, SIMD_WIDTH * i + k) = result[k];
""")
def power_of_eight(
    bases: wp.array(dtype=wp.float32), exponent: wp.float32, i: wp.int32, powers: wp.array(dtype=wp.float32)
): ...


@wp.func_native("""
    using namespace warpcam;
    const Image image = load_image(textures, 0);
    const unsigned* const texels = textures.texels.data;
    Vec3x8 place, right, down, many;
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        set_lane(place, k, as_vec3(wp::index(places, SIMD_WIDTH * i + k)));
        set_lane(right, k, as_vec3(wp::index(rights, SIMD_WIDTH * i + k)));
        set_lane(down, k, as_vec3(wp::index(downs, SIMD_WIDTH * i + k)));
    }
    if (cube)
        sample_cubes(texels, Levels(image, 6), place, right, down, many);
    else
        many = sample_2d(texels, Levels(image, 1), Footprints { place.x, place.y, right.x, right.y, down.x, down.y });
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        const Vec3 p = get_lane(place, k), x = get_lane(right, k), y = get_lane(down, k), color = get_lane(many, k);
        const Vec3 one = cube ? sample_cube(texels, image, p, x, y)
                             : sample_2d(texels, image, p.x, p.y, Float2 { x.x, x.y }, Float2 { y.x, y.y });
        wp::index(eight, SIMD_WIDTH * i + k) = wp::vec3(color.x, color.y, color.z);
        wp::index(single, SIMD_WIDTH * i + k) = wp::vec3(one.x, one.y, one.z);
    }
""")
def sample_eight(
    textures: Textures,
    cube: wp.int32,
    places: wp.array(dtype=wp.vec3),
    rights: wp.array(dtype=wp.vec3),
    downs: wp.array(dtype=wp.vec3),
    i: wp.int32,
    eight: wp.array(dtype=wp.vec3),
    single: wp.array(dtype=wp.vec3),
): ...


@native_kernel("core/simd8.h")
def powers_of(bases: wp.array(dtype=wp.float32), exponent: wp.float32, powers: wp.array(dtype=wp.float32)):
    power_of_eight(bases, exponent, wp.tid(), powers)


@native_kernel("shading/texture_simd.h")
def look_up(
    textures: Textures,
    cube: wp.int32,
    places: wp.array(dtype=wp.vec3),
    rights: wp.array(dtype=wp.vec3),
    downs: wp.array(dtype=wp.vec3),
    eight: wp.array(dtype=wp.vec3),
    single: wp.array(dtype=wp.vec3),
):
    sample_eight(textures, cube, places, rights, downs, wp.tid(), eight, single)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 7.5, 64.0, 128.0])
def test_powers_are_right_far_below_a_level(exponent):
    base = np.concatenate([[1e-37, 1.0, 0.5, 0.25], np.linspace(0.001, 1.0, 1020)]).astype(np.float32)
    powers = wp.zeros(base.size, dtype=wp.float32, device="cpu")
    wp.launch(powers_of, base.size // EIGHT, [wp.array(base, device="cpu"), exponent, powers], device="cpu")
    np.testing.assert_allclose(powers.numpy(), base.astype(np.float64) ** exponent, rtol=0, atol=1e-5)
    assert powers.numpy()[1] == 1.0


@pytest.mark.parametrize("cube", [False, True])
@pytest.mark.parametrize("reach", [1e-4, 0.02, 0.3, 3.0])
def test_eight_lookups_are_eight_times_one(cube, reach):
    random = np.random.default_rng(0)
    size = (16, 16) if cube else (12, 20)
    pixels = random.integers(0, 256, (6 if cube else 1, *size, 3), dtype=np.uint8)
    textures = pack_textures([TextureImage("cube" if cube else "2d", pixels if cube else pixels[0])], "cpu")
    places = random.uniform(-1.0, 1.0, (2048, 3)).astype(np.float32)
    places[:8] = [[0, 0, 1], [0, 1, 0], [1, 0, 0], [1, 1, 1], [1, 1, -1], [-1, 1, 0], [0, -1, -1], [0.5, 0.5, 0.5]]
    steps = (reach * random.uniform(-1.0, 1.0, (2, 2048, 3))).astype(np.float32)
    eight, single = (wp.zeros(2048, dtype=wp.vec3, device="cpu") for _ in range(2))
    inputs = [wp.array(a, dtype=wp.vec3, device="cpu") for a in (places, *steps)]
    wp.launch(look_up, 2048 // EIGHT, [textures, int(cube), *inputs, eight, single], device="cpu")
    np.testing.assert_allclose(eight.numpy(), single.numpy(), rtol=0, atol=2e-4)
    assert single.numpy().std() > 0.01
