"""Partial opacity in physically based scenes: each surface is laid over what is behind it, in linear light."""

from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.core.color import linear_to_srgb

newton = pytest.importorskip("newton")
from newton_scenes import eye, finalize, pose, tetrahedron  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

OUTPUTS = ("hdr", "rgb", "rgba", "depth", "segmentation", "albedo", "normals")


def camera(**changes: Any) -> wc.Camera:
    return eye(position=(0.0, 0.0, 4.0), rotation=(1.0, 0.0, 0.0, 0.0), outputs=OUTPUTS, width=32, height=32, **changes)


def things(worlds: int, device: wp.Device) -> tuple[Any, Any]:
    """In each world a floor, and above it a ball that a board runs through, a tetrahedron and a pane over all."""
    robot = newton.ModelBuilder()
    robot.add_shape_box(-1, xform=pose(0, 0, 0), hx=2.0, hy=2.0, hz=0.1, color=(0.2, 0.5, 0.7))
    robot.add_shape_sphere(-1, xform=pose(-0.4, 0, 1.0), radius=0.7, color=(0.9, 0.3, 0.1), opacity=0.4)
    robot.add_shape_box(-1, xform=pose(-0.2, 0, 1.0), hx=0.9, hy=0.2, hz=0.5, color=(0.1, 0.8, 0.2), opacity=0.6)
    robot.add_shape_mesh(-1, xform=pose(0.6, 0.4, 1.2), mesh=tetrahedron(), color=(0.7, 0.7, 0.1), opacity=0.5)
    robot.add_shape_box(-1, xform=pose(0.3, 0.3, 2.5), hx=0.5, hy=0.7, hz=0.01, color=(0.9, 0.9, 0.9), opacity=0.2)
    builder = newton.ModelBuilder()
    builder.replicate(robot, worlds)
    return finalize(builder, device)


def frame(renderer: wc.Renderer) -> dict[str, np.ndarray]:
    (images,) = renderer.render().values()
    return {name: image.copy() for name, image in scenes.on_host(images).items()}


def over(layers: list[tuple[dict[str, np.ndarray], float]], world: int) -> np.ndarray:
    """Images of single shapes, each with its opacity, one over the other by depth; (height, width, 3)."""
    depth = np.stack([image["depth"][world] for image, _ in layers])
    total = np.zeros((*depth.shape[1:], 3))
    for place in np.argsort(-depth, axis=0, kind="stable"):  # from the farthest on
        color = np.take_along_axis(np.stack([image["hdr"][world] for image, _ in layers]), place[None, ..., None], 0)[0]
        alpha = np.array([alpha for _, alpha in layers])[place] * np.isfinite(
            np.take_along_axis(depth, place[None], 0)[0]
        )
        total += alpha[..., None] * (color - total)
    return total


def test_surfaces_lie_over_one_another_by_distance_in_every_world(device: wp.Device) -> None:
    model, state = things(2, device)
    scene = wc.from_newton(model, state, transparency=True)
    renderer = wc.Renderer(scene, [camera()])

    def draw(opacity: Any) -> dict[str, np.ndarray]:
        model.shape_opacity.assign(np.asarray(opacity, np.float32).reshape(-1))
        return frame(renderer)

    alone = [draw([np.eye(5)[k]] * 2) for k in range(5)]
    opacities = np.array([(1.0, 0.4, 0.6, 0.5, 0.2), (0.5, 0.9, 0.3, 0.0, 0.7)])
    seen = draw(opacities)
    for world in range(2):
        expected = over([(image, alpha) for image, alpha in zip(alone, opacities[world], strict=True)], world)
        np.testing.assert_allclose(seen["hdr"][world], expected, atol=2e-5)
    assert np.abs(seen["hdr"][0] - seen["hdr"][1]).max() > 0.1


def display(linear: np.ndarray) -> np.ndarray:
    return 255.0 * linear_to_srgb(linear)


def test_a_pane_is_laid_over_once_and_all_but_colours_are_those_of_a_solid_one(device: wp.Device) -> None:
    model, state = things(1, device)
    images = {}
    for alpha in (1.0, 0.3, 0.0):
        model.shape_opacity.assign(np.array((0.0, 0.0, 0.0, 0.0, alpha), np.float32))
        images[alpha] = frame(wc.Renderer(wc.from_newton(model, state, transparency=True), [camera()]))
    solid, pane, nothing = images[1.0], images[0.3], images[0.0]
    there = solid["segmentation"][0] == 4
    assert 20 < there.sum() < 900
    assert (nothing["segmentation"] == -1).all()
    assert (nothing["rgba"] == 0).all()
    np.testing.assert_allclose(pane["hdr"][0], 0.3 * solid["hdr"][0], atol=1e-6)
    np.testing.assert_allclose(pane["rgb"][0], display(pane["hdr"][0]), atol=1.0)
    np.testing.assert_array_equal(pane["rgba"][..., :3], pane["rgb"])
    np.testing.assert_allclose(pane["rgba"][0, ..., 3].astype(int), np.where(there, 0.3 * 255, 0), atol=0.51)
    for name in ("depth", "segmentation", "normals", "albedo"):
        np.testing.assert_array_equal(pane[name], solid[name])


def test_what_becomes_transparent_later(device: wp.Device) -> None:
    """The shape is seen through if the scene was told so, and solid otherwise: it never vanishes."""
    for wanted in (True, None, False):
        model, state = things(2, device)
        model.shape_opacity.fill_(1.0)
        renderer = wc.Renderer(wc.from_newton(model, state, transparency=wanted), [camera()])
        before = frame(renderer)
        scenes.write(model.shape_opacity, 9, 0.5)  # the second world's pane
        after = frame(renderer)
        assert (after["rgb"][1] != before["rgb"][1]).any() == (wanted is True)
        np.testing.assert_array_equal(after["rgb"][0], before["rgb"][0])
        np.testing.assert_array_equal(after["segmentation"], before["segmentation"])
    model, state = things(2, device)
    assert (frame(wc.Renderer(wc.from_newton(model, state), [camera()]))["rgb"] != before["rgb"]).any()


def test_what_is_transparent_casts_its_whole_shadow_and_receives_none(device: wp.Device) -> None:
    model, state = things(1, device)
    model.shape_opacity.assign(np.array((1.0, 0.0, 0.0, 0.0, 0.3), np.float32))
    sun = [wc.Light(direction=(-1.0, 0.0, -1.0))]
    lit, shaded = (
        frame(wc.Renderer(wc.from_newton(model, state, lights=sun, ambient=(0, 0, 0)), [camera(shadows=on)]))
        for on in (False, True)
    )
    dark = (shaded["hdr"][0] == 0.0).all(axis=-1) & (lit["hdr"][0] > 0.0).any(axis=-1)
    assert dark.sum() > 20
    assert (lit["segmentation"][0][dark] == 0).all()  # on the floor, where the pane is not before it
    pane = lit["segmentation"][0] == 4
    model.shape_opacity.assign(np.array((0.0, 0.0, 0.0, 0.0, 0.3), np.float32))
    alone = frame(wc.Renderer(wc.from_newton(model, state, lights=sun, ambient=(0, 0, 0)), [camera()]))
    assert (shaded["hdr"][0][pane] >= alone["hdr"][0][pane] - 1e-6).all()


def test_cloth_is_seen_through(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_box(-1, xform=pose(0, 0, 0), hx=2.0, hy=2.0, hz=0.1, color=(0.2, 0.5, 0.7))
    for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        builder.add_particle(pos=(x, y, 1.0), vel=(0, 0, 0), mass=1.0)
    builder.add_triangles([0, 0], [1, 2], [2, 3])
    model, state = finalize(builder, device)
    model.tri_opacity.fill_(0.25)
    seen, solid = (
        frame(wc.Renderer(wc.from_newton(model, state, transparency=on), [camera()])) for on in (None, False)
    )
    model.tri_opacity.fill_(0.0)
    floor = frame(wc.Renderer(wc.from_newton(model, state), [camera()]))
    assert (solid["segmentation"] == -3).mean() > 0.2
    np.testing.assert_allclose(seen["hdr"], 0.25 * solid["hdr"] + 0.75 * floor["hdr"], atol=1e-5)
