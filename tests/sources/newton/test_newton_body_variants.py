"""Newton's body variants: what a body is in each world may change, and the next frame shows it."""

from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
from newton_scenes import eye, finalize, pose, tetrahedron  # noqa: E402

pytestmark = [
    pytest.mark.filterwarnings("ignore"),  # Newton's own
    pytest.mark.skipif(not hasattr(newton.ModelBuilder, "add_body_variants"), reason="this Newton has no variants"),
]
KINDS = ("box", "spheres", "tetrahedron", "rabbit-eared", "barrel")


def variant(kind: str) -> Any:
    builder = newton.ModelBuilder()
    body = builder.add_body(label=kind)
    if kind == "box":
        builder.add_shape_box(body, hx=0.3, hy=0.4, hz=0.2, color=(0.9, 0.1, 0.1))
    elif kind == "spheres":
        for x in (-0.4, 0.4):
            builder.add_shape_sphere(body, xform=pose(x, 0.0, 0.0), radius=0.25, color=(0.1, 0.9, 0.1))
    elif kind == "tetrahedron":
        builder.add_shape_mesh(body, mesh=tetrahedron((0.9, 0.8, 0.7)), color=(0.1, 0.1, 0.9))
    elif kind == "rabbit-eared":
        builder.add_shape_mesh(body, mesh=tetrahedron((0.3, 0.3, 1.2)), color=(0.9, 0.9, 0.1))
        builder.add_shape_capsule(body, xform=pose(-0.4, 0.0, 0.0), radius=0.1, half_height=0.3)
    else:
        builder.add_shape_cylinder(body, radius=0.2, half_height=0.3, barrel_radius=0.35, color=(0.5, 0.1, 0.9))
    return builder


def scene_of(worlds: int, device: wp.Device) -> tuple[Any, Any]:
    robot = newton.ModelBuilder()
    robot.add_shape_box(-1, xform=pose(1.0, 0.0, 0.8), hx=0.1, hy=0.1, hz=0.6)
    body = robot.add_body(xform=pose(-0.2, 0.0, 0.8, (0.3, 0.1, 0.2, 1.0)), label="object")
    robot.add_body_variants(body, [variant(kind) for kind in KINDS])
    builder = newton.ModelBuilder()
    builder.replicate(robot, worlds)
    return finalize(builder, device)


def alone(kind: str, device: wp.Device) -> Any:
    """Build the model with one of the variants alone."""
    builder = newton.ModelBuilder()
    builder.add_shape_box(-1, xform=pose(1.0, 0.0, 0.8), hx=0.1, hy=0.1, hz=0.6)
    builder.add_builder(variant(kind), xform=pose(-0.2, 0.0, 0.8, (0.3, 0.1, 0.2, 1.0)))
    return scenes.look(
        wc.from_newton(*finalize(builder, device)), eye(outputs=("depth", "albedo"), width=48, height=32)
    )


def test_what_is_selected_is_seen(device: wp.Device) -> None:
    model, state = scene_of(3, device)
    scene = wc.from_newton(model, state)
    renderer = wc.Renderer(scene, [eye(outputs=("depth", "albedo", "segmentation", "bodies"), width=48, height=32)])
    expected = {kind: alone(kind, device) for kind in KINDS}
    rows = {world: set() for world in range(3)}
    for selected in ((0, 0, 0), (1, 2, 3), (4, 3, 0), (2, 4, 1)):
        model.select_body_variants(wp.array(selected, dtype=wp.int32, device=device))
        seen = scenes.on_host(renderer.render()["eye"])
        for world, number in enumerate(selected):
            wanted = expected[KINDS[number]]
            np.testing.assert_allclose(seen["depth"][world], wanted["depth"][0], atol=2e-5)
            np.testing.assert_array_equal(seen["albedo"][world], wanted["albedo"][0])
            ids = np.unique(seen["segmentation"][world])
            assert set(model.shape_world.numpy()[ids[ids >= 0]]) == {world}
            rows[world] |= set(ids[ids >= 0].tolist())
            assert set(np.unique(seen["bodies"][world])) == {-1, world}
    assert sum(map(len, rows.values())) == model.shape_count
    assert len(scene._parts.meshes) == 2


def test_a_newton_that_keeps_variants_otherwise_shows_them_as_they_are(
    device: wp.Device, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, state = scene_of(1, device)
    monkeypatch.delattr(newton.Model, "_variant_row_options")
    scene = wc.from_newton(model, state)
    assert "body variants are drawn as they are now" in caplog.text
    seen = scenes.look(scene, eye(outputs=("depth", "albedo"), width=48, height=32))
    np.testing.assert_allclose(seen["depth"][0], alone("box", device)["depth"][0], atol=2e-5)
