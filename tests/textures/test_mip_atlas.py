"""Mip atlases, which the GPU's hardware filters, against the texels that they are made of."""

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels.types import Textures
from warpcam.textures import mip_atlas
from warpcam.textures.mip_atlas import cube_mip_atlas_of, mip_atlas_of, pack_mip_atlases
from warpcam.textures.pack import TextureImage, level_sizes, pack_textures

SIZES = [(1, 1), (64, 32), (7, 5), (1, 9), (300, 20)]


@wp.func_native("""
    using namespace warpcam;
    const Float3Int row = cube ? cube_level_in_atlas(width, level) : level_in_atlas({ 0, width, height, 0 }, level);
    wp::index(rows, level) = wp::vec4(row.x, row.y, row.z, as_float(row.w));
""")
def place_of_level(
    cube: wp.bool, width: wp.int32, height: wp.int32, level: wp.int32, rows: wp.array(dtype=wp.vec4)
): ...


@native_kernel("texture/sampler.h")
def places_of_levels(cube: wp.bool, width: wp.int32, height: wp.int32, rows: wp.array(dtype=wp.vec4)):
    place_of_level(cube, width, height, wp.tid(), rows)


@wp.func_native("""
    using namespace warpcam;
    const Image image = load_image(textures, 0);
    const Vec3 right { step[0], 0.0f, 0.0f }, down { 0.0f, step[1], 0.0f }, to = as_vec3(direction);
    const Float2 to_right { step[0], 0.0f }, to_below { 0.0f, step[1] };
    const Vec3 exact = cube ? sample_cube(textures.texels.data, image, to, right, down)
                           : sample_2d(textures.texels.data, image, to.x, to.y, to_right, to_below);
    Vec3 shown = exact;
#if defined(__CUDA_ARCH__)
    const unsigned long long atlas = atlas_of(textures, 0);
    shown = cube ? sample_cube_atlas(atlas, image, to, right, down)
                 : sample_2d_atlas(atlas, image, to.x, to.y, to_right, to_below);
#endif
    const Vec3 off = shown - exact;
    const float most = warpcam::max(warpcam::abs(off.x), warpcam::abs(off.y));
    wp::index(differences, i) = warpcam::max(most, warpcam::abs(off.z));
""")
def difference_at(
    cube: wp.bool,
    textures: Textures,
    direction: wp.vec3,
    step: wp.vec2,
    i: wp.int32,
    differences: wp.array(dtype=wp.float32),
): ...


@native_kernel("texture/sampler.h")
def compare(
    cube: wp.bool,
    textures: Textures,
    directions: wp.array(dtype=wp.vec3),
    steps: wp.array(dtype=wp.vec2),
    differences: wp.array(dtype=wp.float32),
):
    i = wp.tid()
    difference_at(cube, textures, directions[i], steps[i], i, differences)


def levels_of(image: TextureImage) -> list[np.ndarray]:
    """The packed levels, (face, row, column, 4) each."""
    texels, start, levels = pack_textures([image], "cpu").texels.numpy(), 0, []
    faces = 6 if image.kind == "cube" else 1
    for width, height in level_sizes(image.pixels.shape[-2], image.pixels.shape[-3]):
        count = faces * width * height
        levels.append(texels[start : start + count].view(np.uint8).reshape(faces, height, width, 4))
        start += count
    return levels


def places(cube: bool, width: int, height: int) -> np.ndarray:
    rows = wp.empty(len(level_sizes(width, height)), dtype=wp.vec4, device="cpu")
    wp.launch(places_of_levels, rows.shape[0], [cube, width, height, rows], device="cpu")
    return rows.numpy()


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_each_level_lies_where_kernels_look_with_its_other_side_around_it(width, height):
    pixels = np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)
    image = TextureImage("2d", pixels)
    levels = levels_of(image)
    atlas = mip_atlas_of(
        np.concatenate([level.reshape(-1, 4) for level in levels]).view(np.uint32)[:, 0], width, height
    )
    for (w, h, left, top), (level,) in zip(places(False, width, height).astype(int), levels, strict=True):
        assert (h, w) == level.shape[:2]
        around = np.pad(level, ((1, 1), (1, 1), (0, 0)), "wrap")
        assert (atlas[top - 1 : top + h + 1, left - 1 : left + w + 1] == around).all()


@pytest.mark.parametrize("size", [1, 2, 5, 16])
def test_around_each_face_of_a_cube_is_what_a_step_over_its_edge_shows(size):
    pixels = np.random.default_rng(1).integers(0, 256, (6, size, size, 3), np.uint8)
    image = TextureImage("cube", pixels)
    levels = levels_of(image)
    atlas = cube_mip_atlas_of(np.concatenate([level.reshape(-1, 4) for level in levels]).view(np.uint32)[:, 0], size)
    for (side, apart, left, top), level in zip(places(True, size, size).astype(int), levels, strict=True):
        for face in range(6):
            first = left + face * apart
            assert (atlas[top : top + side, first : first + side] == level[face]).all()
            # MuJoCo's OpenGL: +x's right edge (z = -1) meets -z's left one, its left edge +z's right one.
            if face == 0:
                assert (atlas[top : top + side, first + side] == level[5][:, 0]).all()
                assert (atlas[top : top + side, first - 1] == level[4][:, -1]).all()
            # Below +z lies -y, whose first row it meets; above it +y, whose last row.
            if face == 4:
                assert (atlas[top + side, first : first + side] == level[3][0]).all()
                assert (atlas[top - 1, first : first + side] == level[2][-1]).all()


@pytest.mark.parametrize("kind", ["2d", "cube"])
def test_the_hardware_shows_what_the_texels_do(device, kind):
    """The hardware rounds a place between two texels to 1/256; a CPU has no mip atlas.

    At the corners of a cube three texels meet where four are filtered: there the two may take another fourth.
    """
    rng = np.random.default_rng(2)
    shape = (6, 24, 24, 3) if kind == "cube" else (40, 24, 3)
    images = [TextureImage(kind, rng.integers(0, 256, shape, np.uint8))]
    textures = pack_textures(images, device)
    kept = pack_mip_atlases(images, textures, device)
    assert len(kept) == device.is_cuda
    count = 20_000
    directions = rng.normal(0.0, 2.0, (count, 3)).astype(np.float32)
    steps = np.exp(rng.uniform(-6.0, 1.0, (count, 2))).astype(np.float32)
    differences = wp.empty(count, dtype=wp.float32, device=device)
    inputs = [
        kind == "cube",
        textures,
        wp.array(directions, dtype=wp.vec3, device=device),
        wp.array(steps, dtype=wp.vec2, device=device),
        differences,
    ]
    wp.launch(compare, count, inputs, device=device)
    sizes = np.sort(np.abs(directions), axis=1)
    corners = (sizes[:, 0] > 0.75 * sizes[:, 2]) & (kind == "cube")
    assert differences.numpy()[~corners].max() < 1.5 / 255.0
    assert differences.numpy()[corners].max(initial=0.0) < 8.0 / 255.0


def test_images_too_large_have_no_atlas_and_leave_room_to_others(device, monkeypatch):
    monkeypatch.setattr(mip_atlas, "ROOM", 6 * 10 * 10)
    images = [TextureImage("2d", np.zeros((side, side, 3), np.uint8)) for side in (16, 8, 4)]
    textures = pack_textures(images, device)
    kept = pack_mip_atlases(images, textures, device)
    assert (textures.atlases.numpy() != 0).tolist() == [False, device.is_cuda, False]
    assert len(kept) == device.is_cuda
