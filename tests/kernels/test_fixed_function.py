"""Lighting against closed forms, and the images that resolve writes."""

import functools

import numpy as np
import pytest
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels import types
from warpcam.kernels.layers import Mirror
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes import shading
from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.plan.buffers import BUFFER
from warpcam.kernels.plan.frame import PlannedPass
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.plan.shading import IMAGES, MAX_KEPT, plan_shading
from warpcam.kernels.runtime.launch import Group
from warpcam.kernels.scene_tables import SceneTables

DEVICES = [str(device) for device in wp.get_devices()]
DIRECTIONAL, SPOT, POINT = types.LIGHT_DIRECTIONAL, types.LIGHT_SPOT, 2
COLOR = np.array([0.8, 0.4, 0.2])


def light(kind=DIRECTIONAL, **changes):
    values = {
        "types": kind,
        "active": True,
        "casts_shadow": False,
        "positions": (0, 0, 2),
        "directions": (0, 0, -1),
        "attenuation": (1, 0, 0),
        "cutoff": 45.0,
        "exponent": 0.0,
        "ambient": (0, 0, 0),
        "diffuse": (0.5, 0.5, 0.5),
        "specular": (0, 0, 0),
    }
    return values | changes


def make_lights(lights, device, headlight=(0, 0, 0), everywhere=0.3):
    table = types.Lights()
    dtypes = {
        "types": wp.int32,
        "active": wp.bool,
        "casts_shadow": wp.bool,
        "positions": wp.vec3,
        "directions": wp.vec3,
        "attenuation": wp.vec3,
        "cutoff": wp.float32,
        "exponent": wp.float32,
        "ambient": wp.vec3,
        "diffuse": wp.vec3,
        "specular": wp.vec3,
    }
    for name, dtype in dtypes.items():
        if lights:
            values = np.array([[one[name] for one in lights]])
            values = values.astype(np.float32) if values.dtype == np.float64 else values
            setattr(table, name, wp.array(values, dtype=dtype, device=device))
        else:
            setattr(table, name, wp.empty((1, 0), dtype=dtype, device=device))
    table.headlight = wp.array(np.outer(headlight, np.ones(3)).astype(np.float32), dtype=wp.vec3, device=device)
    table.global_ambient = everywhere
    return table


@functools.cache
def light_patch(shadows):
    """Kernel of one warp: (linear, display) of a patch that faces +z, lit at its place and as a facet."""
    flag = "true" if shadows else "false"

    @wp.func_native(f"""
        using namespace warpcam;
        WARPCAM_SHARED LightList list;
        Camera camera {{}};
        camera.origin = as_vec3(eye);
        for (int k = 0; k < 3; ++k)
            camera.rotation.at[k][k] = 1.0f;
        gather_lights<{flag}>(lights, camera, 0, 0, thread, list);
        ResolvedMaterial material {{ make_float3_int(as_vec3(color), -1), {{ emission, specular, exponent, 0 }} }};
        GouraudTriangle gouraud {{}};
        for (int k = 0; k < 3; ++k) {{
            gouraud.place[k] = as_vec3(position) - as_vec3(eye);
            gouraud.normal[k] = {{ 0.0f, 0.0f, 1.0f }};
        }}
        const LitColor one = light_vertices<1, {flag}>(list, gouraud, material, shadow);
        gouraud.weight1 = 0.25f;
        gouraud.weight2 = 0.5f;
        const LitColor three = light_vertices<3, {flag}>(list, gouraud, material, shadow);
        if (thread == 0) {{
            wp::index(lit, 0) = wp::vec3(one.linear.x, one.linear.y, one.linear.z);
            wp::index(lit, 1) = wp::vec3(one.display.x, one.display.y, one.display.z);
            wp::index(lit, 2) = wp::vec3(three.linear.x, three.linear.y, three.linear.z);
            wp::index(lit, 3) = wp::vec3(three.display.x, three.display.y, three.display.z);
        }}
    """)
    def illuminate(
        lights: types.Lights,
        position: wp.vec3,
        eye: wp.vec3,
        color: wp.vec3,
        emission: wp.float32,
        specular: wp.float32,
        exponent: wp.float32,
        shadow: wp.int32,
        thread: wp.int32,
        lit: wp.array(dtype=wp.vec3),
    ): ...

    @native_kernel("shading_pass/shading_pass.h")
    def light(
        lights: types.Lights,
        position: wp.vec3,
        eye: wp.vec3,
        color: wp.vec3,
        emission: wp.float32,
        specular: wp.float32,
        exponent: wp.float32,
        shadow: wp.int32,
        lit: wp.array(dtype=wp.vec3),
    ):
        illuminate(lights, position, eye, color, emission, specular, exponent, shadow, wp.tid(), lit)

    return light


def shine(
    lights, device, *, headlight=(0, 0, 0), position=(0, 0, 0), eye=(0, 0, 5), shadow=None, everywhere=0.3,
    emission=0.0, specular=0.0, shininess=0.0,
):  # fmt: skip
    """(linear, display) colour of a patch that faces +z."""
    table = make_lights(lights, device, headlight, everywhere)
    lit = wp.zeros(4, dtype=wp.vec3, device=device)
    look = [wp.vec3(*COLOR), emission, specular, 128 * shininess]
    arguments = [table, wp.vec3(*position), wp.vec3(*eye), *look, shadow or 0, lit]
    threads = 32 if wp.get_device(device).is_cuda else 1
    wp.launch(light_patch(shadow is not None), threads, arguments, device=device, block_dim=threads)
    values = lit.numpy()
    np.testing.assert_allclose(values[2:], values[:2], rtol=1e-5)
    return values[0], values[1]


@pytest.mark.parametrize("device", DEVICES)
def test_without_lights_there_is_light_everywhere(device):
    np.testing.assert_allclose(shine([], device, emission=0.5)[0], 0.8 * COLOR, rtol=1e-6)
    np.testing.assert_allclose(shine([light(POINT)], device)[0], 0.3 * COLOR, rtol=1e-6)
    np.testing.assert_allclose(shine([light(active=False)], device)[0], 0.3 * COLOR, rtol=1e-6)
    np.testing.assert_allclose(shine([light(diffuse=(0, 0, 0))], device)[0], 0.0)
    np.testing.assert_allclose(shine([], device, headlight=(0.1, 0, 0))[0], 0.1 * COLOR, rtol=1e-6)


@pytest.mark.parametrize("device", DEVICES)
def test_lambert(device):
    tilted = light(directions=(0, -(0.75**0.5), -0.5), ambient=(0.1, 0.2, 0.3))
    np.testing.assert_allclose(shine([tilted], device)[0], (0.25 + np.array([0.1, 0.2, 0.3])) * COLOR, rtol=1e-5)
    behind = light(directions=(0, 0, 1), ambient=(0.1, 0.1, 0.1), specular=(1, 1, 1))
    np.testing.assert_allclose(shine([behind], device, specular=1.0)[0], 0.1 * COLOR, rtol=1e-5)
    np.testing.assert_allclose(shine([], device, headlight=(0.1, 0.4, 0))[0], 0.5 * COLOR, rtol=1e-5)


@pytest.mark.parametrize("device", DEVICES)
def test_highlight(device):
    lamp = light(diffuse=(0, 0, 0), specular=(1, 0.5, 0))
    mirror = shine([lamp], device, specular=0.5, shininess=0.5)[0]
    np.testing.assert_allclose(mirror, [0.5, 0.25, 0], rtol=1e-5)
    aside = shine([lamp], device, eye=(3, 0, 3), specular=1.0, shininess=4 / 128)[0]
    np.testing.assert_allclose(aside[0], np.cos(np.pi / 8) ** 4, rtol=1e-5)


@pytest.mark.parametrize("device", DEVICES)
def test_spot(device):
    lamp = light(SPOT, attenuation=(1, 0.5, 0.25), exponent=3.0)
    np.testing.assert_allclose(shine([lamp], device)[0], 0.5 / 3 * COLOR, rtol=1e-5)
    aside = shine([lamp], device, position=(1, 0, 0))[0]
    cosine = 2 / 5**0.5
    expected = 0.5 * cosine * cosine**3 / (1 + 0.5 * 5**0.5 + 0.25 * 5)
    np.testing.assert_allclose(aside, expected * COLOR, rtol=1e-5)
    np.testing.assert_allclose(shine([lamp], device, position=(2.01, 0, 0))[0], 0)
    wide = shine([lamp | {"cutoff": 180.0, "exponent": 0.0}], device, position=(20, 0, 0))[0]
    assert (wide > 0).all()


@pytest.mark.parametrize("device", DEVICES)
def test_shadow_takes_all_of_a_light(device):
    lamps = [light(ambient=(0.1, 0.1, 0.1), casts_shadow=True), light(diffuse=(0.2, 0.2, 0.2))]
    np.testing.assert_allclose(shine(lamps, device, shadow=0)[0], 0.8 * COLOR, rtol=1e-5)
    np.testing.assert_allclose(shine(lamps, device, shadow=1)[0], 0.2 * COLOR, rtol=1e-5)
    np.testing.assert_allclose(shine(lamps, device, shadow=2)[0], 0.6 * COLOR, rtol=1e-5)
    np.testing.assert_allclose(shine(lamps, device, shadow=3)[0], 0.0)


@pytest.mark.parametrize("device", DEVICES)
def test_the_display_clips_the_sum_and_linear_does_not(device):
    bright = light(diffuse=(3, 3, 3))
    linear, display = shine([bright], device)
    np.testing.assert_allclose(linear, 3 * COLOR, rtol=1e-5)
    np.testing.assert_allclose(display, np.minimum(3 * COLOR, 1), rtol=1e-5)
    _, drawn_apart = shine([bright, bright | {"casts_shadow": True}], device, shadow=0)
    np.testing.assert_allclose(drawn_apart, 2 * np.minimum(3 * COLOR, 1), rtol=1e-5)


@pytest.mark.parametrize("device", DEVICES)
def test_eight_lights_at_most(device):
    lamps = [light(diffuse=(0.1, 0.1, 0.1))] * 10
    np.testing.assert_allclose(shine(lamps, device)[0], 0.8 * COLOR, rtol=1e-5)
    np.testing.assert_allclose(shine(lamps, device, headlight=(0, 0.1, 0))[0], 0.8 * COLOR, rtol=1e-5)
    np.testing.assert_allclose(shine([light(active=False)] * 3 + lamps, device)[0], 0.8 * COLOR, rtol=1e-5)
    np.testing.assert_allclose(shine([light(POINT)] * 3 + lamps, device)[0], 0.5 * COLOR, rtol=1e-5)


EYE = np.array([0.5, -1.0, 3.0])


def ball_tables(device, worlds, count):
    """A red ball of radius 1 around the origin, on body 7, in a grey haze: the last of ``count`` shapes."""
    shapes = types.Shapes()
    shapes.drawn = wp.array(range(count), dtype=wp.int32, device=device)
    shapes.places = wp.array(range(count), dtype=wp.int32, device=device)
    shapes.types = wp.array([0] * (count - 1) + [types.SPHERE], dtype=wp.int32, device=device)
    shapes.bodies = wp.array([0] * (count - 1) + [7], dtype=wp.int32, device=device)
    shapes.positions = wp.zeros((worlds, count), dtype=wp.vec3, device=device)
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    shapes.rotations = wp.array(np.tile(turn, (worlds, count, 1, 1)), dtype=wp.mat33, device=device)
    shapes.sizes = wp.array(np.ones((1, count, 3), np.float32), dtype=wp.vec3, device=device)
    shapes.assets = wp.array(np.full((1, count), -1, np.int32), dtype=wp.int32, device=device)
    shapes.materials = wp.array(np.full((1, count), -1, np.int32), dtype=wp.int32, device=device)
    shapes.colors = wp.array(
        np.tile([[[1, 0.2, 0, 1]]], (1, count, 1)).astype(np.float32), dtype=wp.vec4, device=device
    )
    background = types.Background()
    background.color = wp.vec3(0.5, 0.25, 1.0)
    background.skybox = -1
    empty = (types.Meshes(), types.HeightFields(), types.Materials(), types.Textures())
    lights = make_lights([], device, everywhere=2.0)
    return SceneTables(
        shapes, *empty, lights, background, num_worlds=worlds, num_drawn=count, num_lights=0,
        num_shapes=count, num_faces=0, shape_types=frozenset([types.SPHERE]), has_materials=False, has_textures=False,
        has_skybox=False,
    )  # fmt: skip


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("lens", ["pinhole", "orthographic"])
@pytest.mark.parametrize(("width", "height", "count"), [(8, 6, 2), (20, 10, 2), (22, 9, 2), (24, 17, MAX_KEPT + 1)])
def test_images_of_a_ball(lens, width, height, count, device):
    """Two of three worlds are drawn; of all that is written the closed form is known."""
    worlds = 3
    scale = (1.2 if lens == "pinhole" else 3.2) / width
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    x, y = (column + 0.5 - width / 2) * scale, (height / 2 - row - 0.5) * scale
    if lens == "pinhole":
        rays, origins = np.stack([x, y, -np.ones_like(x)], -1), np.broadcast_to(EYE, (height, width, 3))
    else:
        rays, origins = np.broadcast_to([0.0, 0.0, -1.0], (height, width, 3)), EYE + np.stack([x, y, 0 * x], -1)
    a, b, c = (rays**2).sum(-1), (rays * origins).sum(-1), (origins**2).sum(-1) - 1
    inside = b * b - a * c
    hit = inside > 0
    assert 4 < hit.sum() < hit.size - 4
    depth = np.where(hit, (-b - np.sqrt(np.maximum(inside, 0))) / a, 9.0)
    places = origins + depth[..., None] * rays

    view = types.View()
    view.origin, view.rotation = wp.vec3(*EYE), wp.mat33(1, 0, 0, 0, 1, 0, 0, 0, 1)
    view.scale, view.center = wp.vec2(scale, scale), wp.vec2(width / 2, height / 2)
    shape = np.where(hit, count - 1, -1)

    def repeated(values, dtype):
        return wp.array(np.broadcast_to(values, (worlds, *values.shape)), dtype=dtype, device=device)

    images = {
        name: wp.full((worlds, height, width, OUTPUTS[name].channels), 9, dtype=OUTPUTS[name].dtype, device=device)
        for name in IMAGES
    }
    tables, card = ball_tables(device, worlds, count), wp.get_device(device)
    request = ImageRequest(width, height, lens, tuple(IMAGES))
    plan = plan_shading(tables, request, card, Group.of_all(worlds), outputs=IMAGES, shadows=False)
    seen = tuple((role, BUFFER + role) for role in ("depth", "shape", "face"))
    planned = PlannedPass("shading", plan.key, plan.threads, (*seen, *((name, name) for name in IMAGES)))
    buffers = {
        BUFFER + "depth": repeated(depth, wp.float32),
        BUFFER + "shape": repeated(shape, wp.int32),
        BUFFER + "face": repeated(shape, wp.int32),
    }
    frame = CameraFrame(
        tables=tables, width=width, height=height, lens=lens, images=images, buffers=buffers,
        views=wp.array([view] * worlds, dtype=types.View, device=device),
        mask=wp.array([1, 0, 1], dtype=wp.uint8, device=device), faults=wp.zeros(worlds, dtype=wp.uint8, device=device),
        mirrors=wp.empty(0, dtype=Mirror, device=device), mirrored=wp.empty(0, dtype=types.View, device=device),
        flow_history=None, lists=None, group=Group.of_all(worlds), device=card,
    )  # fmt: skip
    shading.bind(planned, frame).launch()

    images = {name: image.numpy() for name, image in images.items()}
    assert all((image[1] == 9).all() for image in images.values())
    for image in images.values():
        np.testing.assert_array_equal(image[0], image[2])
    got = {name: image[0] for name, image in images.items()}
    np.testing.assert_allclose(got["normals"], np.where(hit[..., None], places, 0), atol=2e-6)
    np.testing.assert_allclose(got["hdr"], np.where(hit[..., None], [2, 0.4, 0], [0.5, 0.25, 1.0]), rtol=1e-6)
    np.testing.assert_array_equal(got["rgb"], np.where(hit[..., None], [255, 102, 0], [128, 64, 255]))
    np.testing.assert_array_equal(got["rgba"][..., :3], got["rgb"])
    np.testing.assert_array_equal(got["rgba"][..., 3], np.where(hit, 255, 0))
    np.testing.assert_array_equal(got["albedo"], np.where(hit[..., None], [255, 51, 0], 0))
