"""Textures and lights of Newton's scenes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
import newton_scenes  # noqa: E402, newton may be missing
from newton_scenes import eye, finalize  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own


def test_textures_lie_as_newton_lays_them(device: wp.Device) -> None:
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[0, 0], pixels[0, 1], pixels[1, 0], pixels[1, 1] = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)
    corners = np.array(((-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)), np.float32)
    uvs = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32)

    def quadrants(**options: Any) -> list[tuple[int, ...]]:
        mesh = newton.Mesh(
            corners, np.array((0, 1, 2, 0, 2, 3)), uvs=uvs, texture=pixels, compute_inertia=False, **options
        )
        builder = newton.ModelBuilder()
        builder.add_shape_mesh(-1, mesh=mesh, color=(1.0, 1.0, 1.0))
        model, state = finalize(builder, device)
        camera = eye(width=64, outputs=("albedo",), position=(0, -3, 0), rotation=scenes.looking((0, -3, 0), (0, 0, 0)))
        image = scenes.look(wc.from_newton(model, state), camera)["albedo"][0]
        return [tuple(255 * int(x > 127) for x in image[row, column]) for row in (22, 42) for column in (22, 42)]

    red, green, blue, white = (tuple(int(x) for x in pixels[i, j]) for i in (0, 1) for j in (0, 1))
    assert quadrants() == [red, green, blue, white]
    assert quadrants(texture_transform=((1, 0, 0.5), (0, 1, 0))) == [green, red, white, blue]
    assert quadrants(texture_transform=((0, 1, 0), (1, 0, 0))) == [white, green, blue, red]
    assert quadrants(texture_transform=((0, 1, 0), (-1, 0, 0))) == [green, white, red, blue]


def test_lights_shine_where_they_are_put(device: wp.Device) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    camera = eye(outputs=("rgb",))

    def picture(*lights: wc.Light, **options: Any) -> np.ndarray:
        return scenes.look(wc.from_newton(model, state, lights=lights, **options), camera)["rgb"][0].astype(int)

    assert picture(ambient=(0, 0, 0)).max() == 0
    even = picture(ambient=(0.5, 0.5, 0.5))
    assert even.max() > 50
    sun = picture(wc.Light(direction=(0, 2, 0)), ambient=(0, 0, 0))
    assert (sun <= picture(wc.Light(direction=(0, 1, 0)))).all()
    assert (picture(wc.Light(direction=(0, 1, 0), intensity=0.5), ambient=(0, 0, 0)) <= sun).all()
    lamp = picture(wc.Light(kind="point", position=(0, -4, 1.6)), ambient=(0, 0, 0))
    spot = picture(
        wc.Light(kind="spot", position=(0, -4, 1.6), direction=(0, 1, 0), cutoff=5, exponent=0), ambient=(0, 0, 0)
    )
    assert (spot <= lamp).all() and 0 < (spot.max(-1) > 0).sum() < (lamp.max(-1) > 0).sum()
    scene = wc.from_newton(model, state)
    assert scene.array("light_directions").numpy()[0, 0] == pytest.approx(np.array((-1, 1, -1)) / np.sqrt(3.0))
    renderer = wc.Renderer(scene, [camera])
    before = renderer.render()["eye"]["rgb"].clone()
    scene.array("light_directions").fill_(wp.vec3(0.0, 1.0, 0.0))
    assert (renderer.render()["eye"]["rgb"] != before).any()


def test_lights_may_differ_between_worlds(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    model, state = finalize(builder, device)
    light = wc.Light(color=((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), direction=(0.0, 1.0, -0.5), intensity=(0.5, 1.0))
    seen = scenes.look(wc.from_newton(model, state, lights=[light], ambient=(0, 0, 0)), eye(outputs=("rgb",)))["rgb"]
    assert (seen[0, ..., 1:] == 0).all() and (seen[1, ..., :2] == 0).all()
    assert seen[0, ..., 0].max() > 20 and seen[1, ..., 2].max() > 20


def test_the_light_is_above_whichever_way_is_up(device: wp.Device) -> None:
    builder = newton.ModelBuilder(up_axis=newton.Axis.Y)
    builder.add_ground_plane()
    scene = wc.from_newton(*finalize(builder, device))
    assert scene.array("light_directions").numpy()[0, 0] == pytest.approx(-np.ones(3) / np.sqrt(3.0), abs=1e-6)


def test_a_missing_texture_is_named_and_its_colour_drawn(
    device: wp.Device, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "broken.png").write_bytes(b"no picture")
    corners = np.array(((-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)), np.float32)
    uvs = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32)
    for name in ("gone.png", "broken.png"):
        mesh = newton.Mesh(
            corners, np.array((0, 1, 2, 0, 2, 3)), uvs=uvs, texture=str(tmp_path / name), compute_inertia=False
        )
        builder = newton.ModelBuilder()
        builder.add_shape_mesh(-1, mesh=mesh, color=(1.0, 0.0, 0.0), label="wall")
        model, state = finalize(builder, device)
        caplog.clear()
        scene = wc.from_newton(model, state)
        assert "shape 'wall'" in caplog.text and name in caplog.text and "its colour is drawn" in caplog.text
        seen = scenes.look(scene, eye(outputs=("albedo", "segmentation")))
        assert (seen["albedo"][seen["segmentation"] == 0] == (255, 0, 0)).all()


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ({"kind": "sun"}, r"lights\[0\]: kind must be"),
        ({"direction": (0, 0, 0)}, r"lights\[0\]: direction must not be of length 0"),
        ({"kind": "spot", "cutoff": 100.0}, r"lights\[0\]: cutoff must be from 0 to 90"),
        ({"color": (1, 1)}, r"lights\[0\]: color must have shape"),
        ({"attenuation": (0, 0, 0)}, r"lights\[0\]: attenuation must not be"),
    ],
)
def test_bad_lights(device: wp.Device, light: dict[str, Any], message: str) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    with pytest.raises(wc.WarpcamError, match=message):
        wc.from_newton(model, state, lights=[wc.Light(**light)])
    with pytest.raises(wc.WarpcamError, match=r"lights must be a sequence of warpcam\.Light"):
        wc.from_newton(model, state, lights="sun")


def test_textures_of_ones_own_are_given_by_world(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_ground_plane()
    one = newton.ModelBuilder()
    one.add_shape_mesh(-1, mesh=newton.Mesh.create_box(0.5, compute_inertia=False), color=(1.0, 1.0, 1.0), label="box")
    builder.replicate(one, 3)
    model, state = finalize(builder, device)
    images = [np.full((4, 4, 3), color, np.uint8) for color in ((255, 0, 0), (0, 255, 0))]
    scene = wc.from_newton(model, state, lights=[], ambient=(1.0, 1.0, 1.0), textures=images)
    materials = wp.to_torch(scene.array("shape_materials"))
    last = scene.array("material_roughness").shape[1]
    renderer = wc.Renderer(scene, [eye(outputs=("albedo", "segmentation"))])
    for choice in ((0, 1, None), (1, None, 0)):
        for world, image in enumerate(choice):
            column = int(np.flatnonzero(scene.columns[world] == world + 1)[0])
            materials[world, column] = 0 if image is None else last - 2 + image
        seen = {name: output.cpu().numpy() for name, output in renderer.render()["eye"].items()}
        for world, image in enumerate(choice):
            box = seen["albedo"][world][seen["segmentation"][world, ..., 0] == world + 1]
            assert len(box) > 100
            assert (box == (255 if image is None else images[image][0, 0])).all()
    with pytest.raises(wc.WarpcamError, match=r"textures\[0\]: \(height, width, 3\) uint8 is needed, got float64"):
        wc.from_newton(model, state, textures=[np.zeros((4, 4, 3))])
