"""Per-world overrides: written in place, seen at the next render, nothing built or compiled again."""

from collections.abc import Callable
from typing import Any

import newton
import newton_scenes
import numpy as np
import pytest
import scenes
import torch
import usd_stages
import warp as wp
from pxr import Usd

import warpcam as wc
from warpcam.core.errors import WarpcamError
from warpcam.scene.world_overrides import override_names

WORLDS = 3
SIZE = 24
ASSETS = """
  <texture name="squares" type="2d" builtin="checker" rgb1=".9 .1 .1" rgb2=".1 .2 .9" width="64" height="64"/>
  <texture name="plain" type="2d" builtin="flat" rgb1=".2 .9 .3" width="16" height="16"/>
  <texture name="dusk" type="skybox" builtin="flat" rgb1=".6 .3 .2" rgb2=".6 .3 .2" width="16" height="96"/>
  <texture name="noon" type="skybox" builtin="flat" rgb1=".2 .4 .8" rgb2=".2 .4 .8" width="16" height="96"/>
  <material name="tiles" texture="squares" texrepeat="2 2"/><material name="paint" rgba=".6 .5 .4 1"/>
"""
WORLD = """
  <light pos="1 -1 3" dir="-.3 .3 -1" diffuse=".5 .5 .5" ambient=".05 .05 .05"/>
  <camera name="eye" pos="0 -2 2" xyaxes="1 0 0 0 1 1" fovy="60"/>
  <geom type="plane" size="1.5 1.5 .1" material="tiles"/>
  <geom type="box" size=".3 .3 .3" pos="0 0 .3" material="paint"/>
"""
# What needs kernels of its own: asked for in every test, so that all share one.
SPECIAL = ("material_texture_offset", "headlight", "background", "skybox")
TILES, PAINT, PLAIN, DUSK, NOON = 0, 1, 1, 2, 3


def camera(**options: Any) -> wc.Camera:
    return wc.Camera("eye", width=SIZE, height=SIZE, outputs=("rgb", "hdr"), shadows=True, **options)


def make(source: str, device: wp.Device) -> wc.Scene:
    mjm = scenes.compile_xml(WORLD, assets=ASSETS)
    if source == "mujoco":
        return wc.from_mujoco(mjm, [scenes.forward(mjm)] * WORLDS, device=device)
    batch = {"mat_rgba": WORLDS, "light_diffuse": WORLDS} if source == "mujoco_warp, batched" else None
    return wc.from_mujoco_warp(mjm, *scenes.put(mjm, WORLDS, batch=batch))


def check(renderer: wc.Renderer, change: Callable[[], None], loads: list[str]) -> None:
    """World 1 is changed, the others are not, and the frame is the one that was there before."""
    (images,) = renderer.render().values()
    before = images["rgb"].clone()
    (recording,) = renderer._recordings.values()
    loads.clear()
    change()
    after = renderer.render()[next(iter(renderer.images))]["rgb"]
    assert (before[0] == before[1]).all()
    assert [(before[world] != after[world]).any().item() for world in range(WORLDS)] == [False, True, False]
    assert loads == []
    assert list(renderer._recordings.values()) == [recording]


CHANGES: dict[str, Callable[[torch.Tensor], Any]] = {
    "shape_colors": lambda t: t[1, 1].copy_(torch.tensor((0.1, 0.9, 0.2, 1.0))),
    "shape_materials": lambda t: t[1, 1].fill_(TILES),
    "material_color": lambda t: t[1, PAINT, 0].fill_(0.1),
    "material_emission": lambda t: t[1, PAINT].fill_(0.4),
    "material_specular": lambda t: t[1].fill_(1.0),
    "material_shininess": lambda t: t[1].fill_(0.02),
    "material_texture": lambda t: t[1, TILES, 1].fill_(PLAIN),
    "material_texture_repeat": lambda t: t[1, TILES].fill_(3.0),
    "material_texture_offset": lambda t: t[1, TILES].fill_(0.3),
    "material_texture_uniform": lambda t: t[1, TILES].fill_(True),
    "light_active": lambda t: t[1].fill_(False),
    "light_casts_shadow": lambda t: t[1].fill_(False),
    "light_types": lambda t: t[1].fill_(1),
    "light_positions": lambda t: t[1].add_(0.4),
    "light_directions": lambda t: t[1, 0].copy_(torch.tensor((0.0, 0.0, -1.0))),
    "light_cutoff": lambda t: t[1].fill_(8.0),
    "light_exponent": lambda t: t[1].fill_(60.0),
    "light_attenuation": lambda t: t[1, 0, 1].fill_(0.5),
    "light_ambient": lambda t: t[1].fill_(0.3),
    "light_diffuse": lambda t: t[1, 0, 0].fill_(0.1),
    "light_specular": lambda t: t[1].fill_(1.0),
    "light_intensity": lambda t: t[1].fill_(0.5),
    "headlight": lambda t: t[1].fill_(0.05),
    "skybox": lambda t: t[1].fill_(NOON),
    "background": lambda t: t[1].fill_(0.5),
}


@pytest.mark.parametrize("name", CHANGES)
def test_one_world_of_mujoco_warp_differs(name: str, device: wp.Device, loads: list[str]) -> None:
    scene = make("mujoco_warp", device)
    special = {each: scene.vary(each) for each in SPECIAL}
    if name == "background":
        special["skybox"].fill_(-1)
    tensor = scene.vary(name)
    assert tensor.shape[0] == WORLDS
    assert scene.vary(name) is tensor
    check(wc.Renderer(scene, [camera()]), lambda: CHANGES[name](tensor), loads)


@pytest.mark.parametrize("name", ["shape_colors", "material_texture", "light_diffuse", "light_positions"])
def test_one_world_of_classic_mujoco_differs(name: str, device: wp.Device, loads: list[str]) -> None:
    scene = make("mujoco", device)
    for each in SPECIAL:
        scene.vary(each)
    tensor = scene.vary(name)
    check(wc.Renderer(scene, [camera()]), lambda: CHANGES[name](tensor), loads)


def test_arrays_of_the_simulator_that_have_all_worlds_are_taken_as_they_are(device: wp.Device) -> None:
    mjm = scenes.compile_xml(WORLD, assets=ASSETS)
    m, d = scenes.put(mjm, WORLDS, batch={"mat_rgba": WORLDS})
    scene = wc.from_mujoco_warp(mjm, m, d)
    assert scene.vary("material_color").data_ptr() == m.mat_rgba.ptr
    assert scene.vary("material_emission").data_ptr() != m.mat_emission.ptr
    assert scene.array("material_emission").ptr == scene.vary("material_emission").data_ptr()


def test_nothing_differs_before_it_is_written(device: wp.Device) -> None:
    """And a renderer made before goes on."""
    scene = make("mujoco_warp", device)
    renderer = wc.Renderer(scene, [camera()])
    before = renderer.render()["eye"]["rgb"].clone()
    for name in CHANGES:
        scene.vary(name)
    assert (renderer.render()["eye"]["rgb"] == before).all()
    scene.vary("light_intensity")[2] = 0.0
    renderer.render()
    assert (before[2] != renderer.images["eye"]["rgb"][2]).any()


def test_values_mean_what_they_say(device: wp.Device) -> None:
    scene = make("mujoco_warp", device)
    tensors = {name: scene.vary(name) for name in (*SPECIAL, "light_intensity", "light_active", "material_texture")}
    renderer = wc.Renderer(scene, [camera()])
    up = wc.Camera(
        "up", width=2, height=2, lens=wc.Pinhole(fovy=20.0), rotation=(0.0, 1.0, 0.0, 0.0), position=(0, 0, 4)
    )
    sky = wc.Renderer(scene, [up])
    tensors["light_intensity"][1] = 0.0
    tensors["light_active"][2] = False
    images = renderer.render()["eye"]["rgb"]
    assert (images[1] == images[2]).all()  # no light is like one that is off
    tensors["headlight"][1:] = 0.0
    images = renderer.render()["eye"]["rgb"]
    assert int(images[2, -4:].max()) == int(images[1, -4:].max()) == 0
    tensors["skybox"][1], tensors["skybox"][2] = NOON, -1
    tensors["background"][2] = torch.tensor((0.0, 1.0, 0.2))
    shown = sky.render()["up"]["rgb"][:, 0, 0].tolist()
    assert shown == [[153, 76, 51], [51, 102, 204], [0, 255, 51]]
    tensors["background"][1:] = torch.tensor((1.0, 0.2, 0.0))
    tensors["skybox"][1], tensors["skybox"][2] = 0, 99  # a texture that is no cube, and none at all
    assert sky.render()["up"]["rgb"][:, 0, 0].tolist() == [[153, 76, 51], [255, 51, 0], [255, 51, 0]]


def test_shininess_beyond_its_range_is_the_nearest(device: wp.Device) -> None:
    scene = make("mujoco_warp", device)
    for name in SPECIAL:
        scene.vary(name)
    shininess = scene.vary("material_shininess")
    renderer = wc.Renderer(scene, [camera()])
    seen = []
    for values in ((0.0, 1.0, 0.5), (-1.0, 3.0, 0.5)):
        shininess[:, :] = torch.tensor(values, device=shininess.device)[:, None]
        seen.append(renderer.render()["eye"]["hdr"].clone())
    assert (seen[0] == seen[1]).all() and seen[0].max() < 10.0
    assert len({image.sum().item() for image in seen[0]}) == WORLDS


def test_a_checker_moved_by_half_changes_its_colors(device: wp.Device) -> None:
    scene = make("mujoco_warp", device)
    for name in SPECIAL:
        scene.vary(name)
    down = wc.Camera(
        "down", width=9, height=9, outputs=("albedo",), lens=wc.Orthographic(height=0.09), position=(0.9, 0.6, 3)
    )
    renderer = wc.Renderer(scene, [down])
    first = renderer.render()["down"]["albedo"].clone()
    scene.vary("material_texture_offset")[1, TILES, 0] = 0.5
    scene.vary("material_texture_offset")[2, TILES] = 0.5
    second = renderer.render()["down"]["albedo"]
    assert first[0].tolist() == second[2].tolist() == second[0].tolist()
    assert (first[1, ..., 0].int() - second[1, ..., 0].int()).abs().min() > 150


def test_cameras_expose(device: wp.Device, loads: list[str]) -> None:
    scene = make("mujoco_warp", device)
    renderer = wc.Renderer(scene, [camera(exposure=0.0, gain=(1.0, 1.0, 1.0))])
    plain = wc.Renderer(scene, [camera()]).render()["eye"]
    images = renderer.render()["eye"]
    assert (plain["rgb"] == images["rgb"]).all()
    loads.clear()
    eye = renderer.camera("eye")
    eye.exposure[1] = -1.0
    eye.gain[2] = torch.tensor((2.0, 1.0, 0.0))
    renderer.render()
    hdr, factors = plain["hdr"], torch.tensor((2.0, 1.0, 0.0), device=eye.gain.device)
    torch.testing.assert_close(images["hdr"][0], hdr[0])
    torch.testing.assert_close(images["hdr"][1], 0.5 * hdr[1])
    torch.testing.assert_close(images["hdr"][2], factors * hdr[2])
    assert (images["rgb"][1].int() - 0.5 * plain["rgb"][1]).abs().max() <= 1.0
    assert images["rgb"][2, ..., 2].max() == 0
    assert loads == []


def test_cameras_have_backgrounds_for_each_world(device: wp.Device) -> None:
    colors = np.array([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    scene = make("mujoco_warp", device)
    renderer = wc.Renderer(scene, [camera(background=colors)])
    images = renderer.render()["eye"]["rgb"]
    assert (images[:, 0, 0].cpu().numpy() == 255 * colors).all()
    renderer.camera("eye").background[1] = 1.0
    assert renderer.render()["eye"]["rgb"][1, 0, 0].tolist() == [255, 255, 255]


def test_nothing_may_be_varied_that_is_not_tried_here(device: wp.Device) -> None:
    assert set(override_names(make("mujoco_warp", device)._parts)) == set(CHANGES)


@pytest.mark.parametrize("seen_through", [False, True])
def test_one_world_of_glass(seen_through: bool, device: wp.Device, loads: list[str]) -> None:
    """Opacity is the alpha of the colours: of glass, and of what was solid when the scene was made."""
    mjm = scenes.compile_xml(
        WORLD.replace('material="paint"', f'rgba=".6 .5 .4 {0.9 if seen_through else 1}"'), assets=ASSETS
    )
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, WORLDS), transparency=True)
    tensor = scene.vary("shape_colors")
    eye = wc.Camera("eye", width=SIZE, height=SIZE, outputs=("rgb",))
    check(wc.Renderer(scene, [eye]), lambda: tensor[1, 1, 3].fill_(0.3), loads)


NEWTON = {
    "shape_colors": lambda t: t[1].fill_(0.9),
    "material_reflectance": lambda t: t[1].fill_(0.9),
    "material_emissive": lambda t: t[1].fill_(0.2),
    "light_diffuse": lambda t: t[1, 0, 0].fill_(0.1),
    "light_active": lambda t: t[1].fill_(False),
    "sky": lambda t: t[1].fill_(0.3),
    "material_roughness": lambda t: t[1].fill_(0.1),
    "material_metallic": lambda t: t[1].fill_(1.0),
    "light_directions": lambda t: t[1, 0].copy_(torch.tensor((0.0, 0.6, -0.8))),
    "light_intensity": lambda t: t[1].fill_(2.0),
    "headlight": lambda t: t[1].fill_(0.6),
    "background": lambda t: t[1].fill_(0.5),
}


@pytest.mark.parametrize("name", NEWTON)
def test_one_world_of_newton_differs(name: str, device: wp.Device, loads: list[str]) -> None:
    builder, many = newton.ModelBuilder(), newton.ModelBuilder()
    builder.add_shape_sphere(-1, radius=0.6, label="ball")
    many.replicate(builder, WORLDS)
    model, state = newton_scenes.finalize(many, device)
    scene = wc.from_newton(model, state)
    scene.vary("headlight"), scene.vary("background")
    tensor = scene.vary(name)
    eye = wc.Camera("eye", width=16, height=16, lens=wc.Orthographic(height=2.0), position=(0.0, 0.0, 3.0))
    check(wc.Renderer(scene, [eye]), lambda: NEWTON[name](tensor), loads)


def test_newtons_textures_are_by_the_metre_anyway(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_sphere(-1, radius=0.6, label="ball")
    scene = wc.from_newton(*newton_scenes.finalize(builder, device), textures=[np.zeros((4, 4, 3), np.uint8)])
    with pytest.raises(WarpcamError, match="vary: 'material_texture_uniform' came"):  # no image would show it
        scene.vary("material_texture_uniform")


def test_what_newton_hides_stays_hidden(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_sphere(-1, radius=0.6, label="ball")
    model, state = newton_scenes.finalize(builder, device)
    scene = wc.from_newton(model, state)
    scene.vary("shape_colors").fill_(1.0)
    eye = wc.Camera("eye", width=8, height=8, lens=wc.Orthographic(height=2.0), position=(0, 0, 3), outputs=("depth",))
    renderer = wc.Renderer(scene, [eye])
    assert torch.isfinite(renderer.render()["eye"]["depth"]).any()
    model.shape_flags.zero_()
    assert torch.isinf(renderer.render()["eye"]["depth"]).all()


def test_one_world_of_a_stage_differs(device: wp.Device, loads: list[str]) -> None:
    stage = usd_stages.metric(Usd.Stage.CreateInMemory())
    usd_stages.add_square(stage, "/square")
    usd_stages.add_material(stage, "/paint", diffuseColor=(0.5, 0.2, 0.2), roughness=0.5)
    from pxr import UsdShade

    prim = stage.GetPrimAtPath("/square")
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(UsdShade.Material.Get(stage, "/paint"))
    scene = wc.from_usd(stage, WORLDS, device=device)
    tensors = {name: scene.vary(name) for name in ("shape_colors", "material_roughness", "material_metallic")}
    renderer = wc.Renderer(scene, [usd_stages.above(3.0, 16, 2.0, "rgb")])
    for tensor in tensors.values():
        check(renderer, lambda tensor=tensor: tensor[1].fill_(0.9), loads)
        tensor[:] = tensor[:1].clone()
    with pytest.raises(WarpcamError, match=r'set_colors: vary\("shape_colors"\) holds the colours now'):
        scene.set_colors(["/square"], np.ones((1, 1, 3), np.float32))


def test_what_a_stage_hides_later_stays_hidden(device: wp.Device) -> None:
    """The array has one colour for all worlds, until some of them hide the shape."""
    stage = usd_stages.metric(Usd.Stage.CreateInMemory())
    usd_stages.add_square(stage, "/square")
    scene = wc.from_usd(stage, WORLDS, device=device)
    renderer = wc.Renderer(scene, [eye := usd_stages.above(3.0, 8, 2.0, "depth")])
    scene.vary("shape_colors").fill_(1.0)
    assert torch.isfinite(renderer.render()[eye.name]["depth"]).all()
    scene.set_visible(["/square"], np.array([[True], [False], [True]]))
    depth = renderer.render()[eye.name]["depth"]
    assert [torch.isfinite(depth[world]).all().item() for world in range(WORLDS)] == [True, False, True]


def test_what_cannot_be_varied_is_named(device: wp.Device) -> None:
    scene = make("mujoco_warp", device)
    with pytest.raises(WarpcamError, match="vary: 'geom_rgba' came; in this scene it may be shape_colors, "):
        scene.vary("geom_rgba")
    wc.randomize(scene, seed=1, skybox=[-1, NOON])
    with pytest.raises(
        WarpcamError, match=r"randomize: skybox takes -1 for none and cube textures, 2, 3, got \[0, 2\]"
    ):
        wc.randomize(scene, seed=1, skybox=[0, 2])
    bare = wc.from_mujoco(mjm := scenes.compile_xml('<geom size="1"/>'), scenes.forward(mjm), device=device)
    with pytest.raises(WarpcamError, match="vary: 'skybox' came"):
        bare.vary("skybox")
    with pytest.raises(WarpcamError, match="vary: 'light_intensity' came"):
        bare.vary("light_intensity")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"exposure": "dark"}, r"Camera\('eye'\): exposure must be numbers"),
        ({"exposure": (0.0, 128.0, 0.0)}, r"Camera\('eye'\): exposure must be at most 127, got \(0.0, 128.0, 0.0\)"),
        ({"gain": (1.0, 2.0)}, r"Camera\('eye'\): gain must have shape"),
        ({"gain": -1.0}, r"Camera\('eye'\): gain must not be negative, got -1.0"),
        ({"background": np.zeros((2, 3))}, r"Camera\('eye'\): background must have shape \(3,\) or \(3, 3\)"),
    ],
)
def test_what_a_camera_cannot_have_is_named(options: dict[str, Any], message: str, device: wp.Device) -> None:
    with pytest.raises(WarpcamError, match=message):
        wc.Renderer(make("mujoco_warp", device), [camera(**options)])


def test_colors_hold_while_time_goes_on(device: wp.Device) -> None:
    """Colours that the simulator writes into its own array are no longer read; poses are."""
    mjm = scenes.compile_xml(WORLD, assets=ASSETS)
    m, d = scenes.put(mjm, WORLDS)
    scene = wc.from_mujoco_warp(mjm, m, d)
    scene.vary("material_color")
    renderer = wc.Renderer(scene, [camera()])
    before = renderer.render()["eye"]["rgb"].clone()
    m.mat_rgba.zero_()
    assert (renderer.render()["eye"]["rgb"] == before).all()
    d.geom_xpos.zero_()
    assert (renderer.render()["eye"]["rgb"] != before).any()
