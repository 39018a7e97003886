"""Mipmapped textures of the GPU's own, against the texels that they are made of."""

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels.types import Textures
from warpcam.textures import hardware_mipmaps
from warpcam.textures.hardware_mipmaps import are_halved, pack_mips
from warpcam.textures.pack import TextureImage, pack_textures


@wp.func_native("""
    using namespace warpcam;
    const Image image = load_image(textures, 0);
    const Vec3 exact = sample_level(textures.texels.data, image, place[0], place[1], step * step, 0.0f);
    Vec3 shown = exact;
#if defined(__CUDA_ARCH__)
    if (wp::index(textures.mips, 0))
        shown = look_up(wp::index(textures.mips, 0), place[0], place[1], ::log2f(step));
#endif
    const Vec3 off = shown - exact;
    const float most = warpcam::max(warpcam::abs(off.x), warpcam::abs(off.y));
    wp::index(differences, i) = warpcam::max(most, warpcam::abs(off.z));
""")
def difference_at(
    textures: Textures, place: wp.vec2, step: wp.float32, i: wp.int32, differences: wp.array(dtype=wp.float32)
): ...


@native_kernel("texture/sampler.h")
def compare(
    textures: Textures,
    places: wp.array(dtype=wp.vec2),
    steps: wp.array(dtype=wp.float32),
    differences: wp.array(dtype=wp.float32),
):
    i = wp.tid()
    difference_at(textures, places[i], steps[i], i, differences)


def image(height: int, width: int, *, kind: str = "2d", **options: bool) -> TextureImage:
    shape = (6, height, width, 3) if kind == "cube" else (height, width, 3)
    return TextureImage(kind, np.random.default_rng(3).integers(0, 256, shape, np.uint8), **options)


@pytest.mark.parametrize(
    ("one", "expected"),
    [
        (image(64, 16), True),
        (image(1, 1), True),
        (image(24, 16), False),
        (image(16, 15), False),
        (image(16, 16, blend_light=True), False),
    ],
)
def test_levels_are_told_that_warp_makes_by_itself(one: TextureImage, expected: bool) -> None:
    textures = pack_textures([one], wp.get_device("cpu"))
    height, width = one.pixels.shape[:2]
    assert are_halved(textures.texels.numpy(), width, height) == expected


@pytest.mark.parametrize(
    ("images", "expected"),
    [
        ([image(32, 16), image(16, 16, kind="cube"), image(8, 8)], [True, False, True]),
        ([image(32, 16), image(24, 16)], [False, False]),
        ([image(16, 16, kind="cube")], [False]),
        ([], []),
    ],
)
def test_each_image_but_cubes_has_one_or_none_has(
    images: list[TextureImage], expected: list[bool], device: wp.Device
) -> None:
    textures = pack_textures(images, device)
    made = pack_mips(images, textures, device)
    there = device.is_cuda and hardware_mipmaps.CAN_MAKE
    assert (textures.mips.numpy() != 0).tolist() == [one and there for one in expected]
    assert len(made) == there * sum(expected)


def test_the_hardware_shows_what_the_texels_do(device: wp.Device) -> None:
    """The hardware rounds places between two texels and between two levels to 1/256; a CPU has none."""
    images = [image(64, 32)]
    textures = pack_textures(images, device)
    made = pack_mips(images, textures, device)
    rng, count = np.random.default_rng(2), 20_000
    places = wp.array(rng.normal(0.0, 3.0, (count, 2)).astype(np.float32), dtype=wp.vec2, device=device)
    steps = wp.array(np.exp(rng.uniform(-2.0, 6.0, count)).astype(np.float32), dtype=wp.float32, device=device)
    differences = wp.empty(count, dtype=wp.float32, device=device)
    wp.launch(compare, count, [textures, places, steps, differences], device=device)
    assert differences.numpy().max() < 2.5 / 255.0
    assert len(made) == (device.is_cuda and hardware_mipmaps.CAN_MAKE)
