"""Geoms in the same place, as of robots whose meshes are there to be seen and to collide, beside ``mujoco.Renderer``.

It draws the last of them, but adds the light of lights that cast shadows once for each.
"""

import color_reference
import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from golden_scenes import compiled

import warpcam as wc
from warpcam.kernels.plan import launches

DIM = '<visual><headlight ambient=".05 .05 .05" diffuse=".1 .1 .1" specular="0 0 0"/></visual>'
CASTING = (
    '<light type="directional" pos=".3 -.5 3" dir="-.2 .3 -1" ambient=".05 .05 .05" diffuse=".3 .28 .25" '
    'specular=".1 .1 .1"/>'
)
STEADY = '<light type="directional" pos="0 0 3" dir=".3 .2 -1" diffuse=".3 .3 .3" castshadow="false"/>'
ASSETS = """
  <mesh name="m" vertex="-.3 -.3 -.2 .3 -.3 -.2 .3 .3 -.2 -.3 .3 -.2 -.2 -.2 .2 .2 -.2 .2 .2 .2 .3 -.2 .2 .2"/>
  <texture name="t" type="2d" builtin="checker" width="64" height="64" rgb1=".4 .9 .9" rgb2=".9 .5 .4"/>
  <material name="m" texture="t" rgba=".6 .6 .6 1" specular=".3" shininess=".4"/>
  <material name="dull" texture="t" rgba=".3 .3 .3 1" specular="0" shininess=".4"/>
"""
CAMERA = '<camera pos=".4 -1.9 1.6" xyaxes="1 .2 0 -.1 .5 .86"/>'
FLOOR = '<geom type="plane" size="2 2 .5" rgba=".4 .5 .6 1"/>'
RED, GREEN, BLUE, CLEAR = "rgba='.6 .2 .2 1'", "rgba='.2 .5 .2 1'", "rgba='.1 .1 .4 1'", "rgba='.2 .5 .2 .5'"


def model(kind: str, *looks: str, lights: str = CASTING + STEADY) -> mujoco.MjModel:
    geoms = "".join(scenes.geom_xml(kind, str(place), look) for place, look in enumerate(looks))
    body = f'<body pos="0 0 .4" euler="10 -5 20">{geoms}</body>'
    mjm = compiled(lights + FLOOR + body + CAMERA, ASSETS, DIM)
    mjm.stat.extent, mjm.vis.map.shadowclip = 1.0, 3.0
    return mjm


@pytest.mark.parametrize(
    "looks",
    [(RED, GREEN), (GREEN, RED), (RED, RED), (RED, GREEN, BLUE), ("material='m'", "material='dull'")],
    ids=["red-green", "green-red", "red-red", "three", "materials"],
)
@pytest.mark.parametrize("kind", ["mesh", "box", "capsule"])
def test_as_mujoco_draws_them(device: wp.Device, kind: str, looks: tuple[str, ...]) -> None:
    mjm = model(kind, *looks)
    seen = color_reference.check(mjm, device, differs=False, most=0.005 if kind == "capsule" else 0.002)
    last = model(kind, looks[-1])
    once = color_reference.ours(last, scenes.forward(last), device)
    assert (seen.astype(int) - once).max() > 15


def same(mjm: mujoco.MjModel, other: mujoco.MjModel, device: wp.Device) -> bool:
    images = [color_reference.ours(each, scenes.forward(each), device) for each in (mjm, other)]
    return bool(np.array_equal(*images))


def test_lights_without_shadows_come_once(device: wp.Device) -> None:
    assert same(model("box", RED, GREEN, lights=STEADY), model("box", GREEN, lights=STEADY), device)


def test_what_is_seen_through_is_not_counted(device: wp.Device) -> None:
    color_reference.check(model("box", RED, CLEAR), device, differs=False)
    assert same(model("box", "rgba='.2 .5 .2 0'", RED), model("box", RED), device)


def test_what_is_not_drawn_is_not_counted(device: wp.Device) -> None:
    assert same(model("box", f"{RED} group='3'", GREEN), model("box", GREEN), device)


def test_colours_and_places_of_now(device: wp.Device) -> None:
    """Shapes that coincided when the scene was made have their present colours and places."""
    mjm = model("box", RED, GREEN)
    mjm.light_specular[:] = 0.0
    mjd = scenes.forward(mjm)
    camera = wc.Camera(0, width=64, height=64, outputs=("rgb",), shadows=True)
    renderer = wc.Renderer(wc.from_mujoco(mjm, mjd, device=device), [camera])

    def image() -> np.ndarray:
        return renderer.render()[0]["rgb"][0].cpu().numpy().astype(int)

    both = image()
    geom = mjm.geom("0").id
    mjm.geom_rgba[geom, :3] = 0.0
    black = image()
    assert (both[..., 0] - black[..., 0]).max() > 30
    assert (both[..., 1] - black[..., 1]).max() < 30
    mjd.geom_xpos[geom, 2] -= 5.0  # below the floor
    np.testing.assert_array_equal(image(), black)
    mjm.geom_rgba[geom, :3] = 1.0
    np.testing.assert_array_equal(image(), black)


@pytest.mark.parametrize("kind", ["box", "mesh", "capsule"])
def test_the_last_is_seen_where_more_than_one_pass_draws(
    device: wp.Device, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(launches, "MANY_LISTED", launches.MAX_LISTED)  # of a CPU, which else draws as many in one
    first, last = (scenes.geom_xml(kind, name, 'pos="0 0 -2"') for name in ("first", "last"))
    floors = "".join(f'<geom type="plane" size="0 0 1" pos="0 0 {-3 - 0.01 * k}"/>' for k in range(launches.MAX_LISTED))
    mjm = scenes.compile_xml(first + floors + last, assets=scenes.ASSETS)
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), scenes.own_camera())["segmentation"]
    assert (seen == mjm.geom("last").id).sum() > 50
    assert not (seen == mjm.geom("first").id).any()
