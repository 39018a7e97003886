"""Packing and sampling of textures against closed forms."""

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

from warpcam.core import errors
from warpcam.kernels.types import Textures
from warpcam.textures.pack import TextureImage, pack_textures

DEVICES = [str(device) for device in wp.get_devices()]


@wp.func_native("""
    using namespace warpcam;
    const Vec3 color = sample_2d(textures.texels.data, load_image(textures, 0), uv[0], uv[1], Float2 { ddx[0], ddx[1] },
                                Float2 { ddy[0], ddy[1] });
    wp::index(colors, i) = wp::vec3(color.x, color.y, color.z);
""")
def at_place(
    textures: Textures, uv: wp.vec2, ddx: wp.vec2, ddy: wp.vec2, i: wp.int32, colors: wp.array(dtype=wp.vec3)
): ...


@wp.func_native("""
    using namespace warpcam;
    const Vec3 color = sample_cube(textures.texels.data, load_image(textures, 0), as_vec3(direction), as_vec3(ddx),
                                  as_vec3(ddy));
    wp::index(colors, i) = wp::vec3(color.x, color.y, color.z);
""")
def in_direction(
    textures: Textures, direction: wp.vec3, ddx: wp.vec3, ddy: wp.vec3, i: wp.int32, colors: wp.array(dtype=wp.vec3)
): ...


@native_kernel("texture/sampler.h")
def look_up_2d(
    textures: Textures,
    uv: wp.array(dtype=wp.vec2),
    ddx: wp.array(dtype=wp.vec2),
    ddy: wp.array(dtype=wp.vec2),
    colors: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    at_place(textures, uv[i], ddx[i], ddy[i], i, colors)


@native_kernel("texture/sampler.h")
def look_up_cube(
    textures: Textures,
    direction: wp.array(dtype=wp.vec3),
    ddx: wp.array(dtype=wp.vec3),
    ddy: wp.array(dtype=wp.vec3),
    colors: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    in_direction(textures, direction[i], ddx[i], ddy[i], i, colors)


def look_up(pixels, places, device, step=0.0):
    """Colours, 0 to 255, of one texture at ``places``, with a footprint of ``step`` along each coordinate."""
    places = np.atleast_2d(np.asarray(places, np.float32))
    dims = places.shape[1]
    kind, kernel, vector = ("2d", look_up_2d, wp.vec2) if dims == 2 else ("cube", look_up_cube, wp.vec3)
    textures = pack_textures([TextureImage(kind, np.asarray(pixels, np.uint8))], device)
    steps = [np.tile(np.eye(dims, dtype=np.float32)[k] * step, (len(places), 1)) for k in range(2)]
    arrays = [wp.array(values, dtype=vector, device=device) for values in (places, *steps)]
    colors = wp.empty(len(places), dtype=wp.vec3, device=device)
    wp.launch(kernel, len(places), [textures, *arrays, colors], device=device)
    return 255.0 * colors.numpy()


@pytest.mark.parametrize("device", DEVICES)
def test_packing_lays_level_after_level(device):
    image = np.arange(4 * 2 * 3, dtype=np.uint8).reshape(2, 4, 3)
    cube = np.zeros((6, 2, 2, 1), np.uint8)
    cube[:, ...] = (10 * np.arange(6)).reshape(6, 1, 1, 1)
    textures = pack_textures([TextureImage("2d", image), TextureImage("cube", cube)], device)
    assert textures.kind.numpy().tolist() == [0, 1]
    assert textures.width.numpy().tolist() == [4, 2]
    assert textures.height.numpy().tolist() == [2, 2]
    assert textures.levels.numpy().tolist() == [3, 2]
    assert textures.start.numpy().tolist() == [0, 8 + 2 + 1]
    texels = textures.texels.numpy()
    assert texels.size == 11 + 24 + 6
    bytes_ = texels.view(np.uint8).reshape(-1, 4)
    np.testing.assert_array_equal(bytes_[:8, :3], image.reshape(-1, 3))
    np.testing.assert_array_equal(bytes_[:, 3], 255)
    means = image.reshape(2, 2, 2, 3).astype(float).mean(axis=(0, 2))
    np.testing.assert_allclose(bytes_[8:10, :3], means, atol=0.5)
    np.testing.assert_array_equal(bytes_[11 + 24 :, 0], 10 * np.arange(6))


def test_odd_sizes_are_looked_up_between_two():
    row = np.array([30, 60, 120, 0, 240], np.uint8)
    textures = pack_textures([TextureImage("2d", np.broadcast_to(row[None, :, None], (3, 5, 1)))], "cpu")
    level = textures.texels.numpy()[15:17] & 0xFF
    np.testing.assert_allclose(level, [0.25 * 30 + 0.75 * 60, 0.75 * 0 + 0.25 * 240], atol=0.5)


def test_every_level_keeps_the_mean():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (32, 64, 4), dtype=np.uint8)
    textures = pack_textures([TextureImage("2d", image)], "cpu")
    last = textures.texels.numpy()[-1:].view(np.uint8)
    np.testing.assert_allclose(last, image.reshape(-1, 4).mean(axis=0), atol=1.5)


def test_srgb_is_decoded():
    textures = pack_textures([TextureImage("2d", np.full((1, 1, 3), 188, np.uint8), srgb=True)], "cpu")
    assert textures.texels.numpy()[0] & 0xFF == pytest.approx(128, abs=1)


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (TextureImage("2d", np.zeros((2, 2, 3), np.float32)), "dtype float32; allowed is uint8"),
        (TextureImage("2d", np.zeros((2, 2, 2), np.uint8)), r"\(2, 2, 2\); allowed is \(height, width"),
        (TextureImage("cube", np.zeros((6, 2, 3, 3), np.uint8)), r"\(6, 2, 3, 3\); allowed is \(6, size, size"),
        (TextureImage("2d", np.zeros((0, 2, 3), np.uint8)), r"\(0, 2, 3\)"),
        (TextureImage("3d", np.zeros((2, 2, 3), np.uint8)), "'3d'; allowed are"),
    ],
)
def test_wrong_images_are_named(image, words):
    with pytest.raises(errors.WarpcamError, match=words):
        pack_textures([TextureImage("2d", np.zeros((1, 1, 3), np.uint8)), image], "cpu")


def test_too_many_texels_are_refused_before_they_are_made():
    image = TextureImage("2d", np.broadcast_to(np.zeros(3, np.uint8), (2**15, 2**16, 3)))
    with pytest.raises(errors.WarpcamError, match="texels; at most 2147483647 fit"):
        pack_textures([image], "cpu")


def test_no_images_make_empty_tables():
    assert pack_textures([], "cpu").kind.shape == (0,)


@pytest.mark.parametrize("device", DEVICES)
def test_a_texel_is_itself_at_its_middle(device):
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (3, 5, 3), dtype=np.uint8)
    j, i = np.mgrid[0:3, 0:5]
    places = np.stack([(i + 0.5) / 5, (j + 0.5) / 3], -1).reshape(-1, 2)
    for shift in ([0, 0], [2, -3]):  # images repeat
        np.testing.assert_allclose(look_up(image, places + shift, device), image.reshape(-1, 3), atol=0.02)


@pytest.mark.parametrize("device", DEVICES)
def test_between_texels_is_between_their_colours(device):
    image = np.array([[[0] * 3, [100] * 3], [[40] * 3, [200] * 3]], np.uint8)
    places = [[0.5, 0.25], [0.25, 0.5], [0.5, 0.5], [0.0, 0.25], [0.375, 0.25]]
    expected = [50, 20, 85, 50, 25]
    np.testing.assert_allclose(look_up(image, places, device)[:, 0], expected, atol=0.02)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("width", "height"), [(64, 64), (64, 16), (60, 36), (300, 300), (7, 33)])
def test_each_level_is_found(width, height, device):
    """Each mipmap level gets a colour of its own; a footprint of 2^k texels shows level k."""
    textures = pack_textures([TextureImage("2d", np.zeros((height, width, 3), np.uint8))], device)
    texels = textures.texels.numpy()
    levels = int(textures.levels.numpy()[0])
    start, w, h = 0, width, height
    for level in range(levels):
        texels[start : start + w * h] = 10 * level + 5
        start, w, h = start + w * h, max(w // 2, 1), max(h // 2, 1)
    textures.texels.assign(texels)
    size = np.array([width, height])
    steps = np.array([[2.0**level / size.max(), 0.0] for level in range(levels)]).astype(np.float32)
    if height > width:
        steps = steps[:, ::-1].copy()
    arrays = [np.full((levels, 2), 0.4), steps, np.zeros((levels, 2))]
    arrays = [wp.array(values.astype(np.float32), dtype=wp.vec2, device=device) for values in arrays]
    colors = wp.empty(levels, dtype=wp.vec3, device=device)
    wp.launch(look_up_2d, levels, [textures, *arrays, colors], device=device)
    np.testing.assert_allclose(255 * colors.numpy()[:, 0], 10 * np.arange(levels) + 5, atol=0.05)


@pytest.mark.parametrize("device", DEVICES)
def test_a_wide_footprint_sees_the_mean(device):
    checker = np.kron(np.indices((8, 8)).sum(0) % 2, np.ones((1, 1)))[..., None] * np.full(3, 255)
    np.testing.assert_allclose(look_up(checker, [[0.3, 0.6]], device, step=2.0), 127.5, atol=1.0)


@pytest.mark.parametrize("device", DEVICES)
def test_detail_blends_two_levels(device):
    image = np.zeros((4, 4, 3), np.uint8)
    image[::2, ::2] = 200  # mean 50 of each 2 x 2 block
    fine = look_up(image, [[0.125, 0.125]], device, step=0.25)[0, 0]
    coarse = look_up(image, [[0.125, 0.125]], device, step=0.5)[0, 0]
    middle = look_up(image, [[0.125, 0.125]], device, step=0.25 * 2**0.5)[0, 0]
    assert fine == pytest.approx(200, abs=0.02)
    assert coarse == pytest.approx(50, abs=0.02)
    assert middle == pytest.approx(125, abs=0.1)


AXES = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]


@pytest.mark.parametrize("device", DEVICES)
def test_cube_faces_lie_as_in_opengl(device):
    cube = np.zeros((6, 8, 8, 3), np.uint8)
    for face in range(6):
        cube[face, ..., 0] = np.arange(8)[None, :] * 10 + 5  # grows to the right
        cube[face, ..., 1] = np.arange(8)[:, None] * 10 + 5  # grows downwards
        cube[face, ..., 2] = face
    right = [[0, 0, -1], [0, 0, 1], [1, 0, 0], [1, 0, 0], [1, 0, 0], [-1, 0, 0]]
    down = [[0, -1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0, -1, 0], [0, -1, 0]]
    a, b = 0.25, -0.5  # of half a face: one texel right and two up of the middle
    places = np.array(AXES) + a * np.array(right) + b * np.array(down)
    colors = look_up(cube, 3.0 * places, device)
    np.testing.assert_allclose(colors[:, 0], 40 + 10 * 4 * a, atol=0.05)
    np.testing.assert_allclose(colors[:, 1], 40 + 10 * 4 * b, atol=0.05)
    np.testing.assert_allclose(colors[:, 2], np.arange(6), atol=0.02)


@pytest.mark.parametrize("device", DEVICES)
def test_cube_has_no_seams(device):
    rng = np.random.default_rng(2)
    cube = rng.integers(0, 256, (6, 4, 4, 3), dtype=np.uint8)
    edges = rng.uniform(-0.7, 0.7, (200, 3))  # away from the corners, where three faces meet
    which = rng.integers(0, 3, 200)
    for k in range(200):  # onto one of the cube's edges
        edges[k, which[k]], edges[k, which[k] - 1] = rng.choice([-1, 1], 2)
    step = np.zeros_like(edges)
    step[np.arange(200), which] = 1e-5 * np.sign(edges[np.arange(200), which])
    np.testing.assert_allclose(look_up(cube, edges - step, device), look_up(cube, edges + step, device), atol=0.1)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 3e38, -3e38])
def test_nonsense_reads_no_texel_outside(bad, device):
    """Nothing is promised of the colour; reading far outside the array would end the process."""
    assert look_up(np.zeros((3, 5, 3)), [[bad, 0.5], [0.5, bad]], device, step=1e30).shape == (2, 3)
    assert look_up(np.zeros((6, 2, 2, 3)), [[bad, bad, 0.5], [0.5, bad, 0.0]], device, step=1e30).shape == (2, 3)
    assert look_up(np.zeros((6, 2, 2, 3)), [[0.0, 0.0, 0.0]], device, step=1e30).shape == (1, 3)
