"""Pictures of one feature each. Those of a kind have the same facts about their scenes, so that they share kernels."""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import color_pictures
import depth_pictures
import lidar_pictures
import numpy as np
import pytest
import scenes
import sensor_pictures
import shutter_pictures
import torch
import visual_geom_scenes
import warp as wp

import warpcam as wc

SIZE = 48
EYE = (1.2, -1.9, 2.0)
Picture = Callable[[wp.Device], np.ndarray]

SUN = '<light type="directional" pos="0 0 3" dir="-0.4 0.5 -1" diffuse="0.8 0.7 0.6" castshadow="{}"/>'
GREEN = '<light pos="1 -1 2" dir="-0.4 0.4 -1" diffuse="0.1 0.6 0.2"/>'
FLOOR = '<geom type="plane" size="2 2 0.5" rgba="0.4 0.5 0.6 1"/>'
OBJECT = '<body pos="0 0 0.6" euler="10 20 30">{}</body>'
CHECKER = '<texture name="t" type="{}" builtin="checker" rgb1="0.9 0.3 0.1" rgb2="0.1 0.3 0.9" width="{}" height="{}"/>'
MARBLE = '<material name="m" texture="t" texrepeat="2 2" specular="0.2"/>'
SKY = '<texture type="skybox" builtin="gradient" rgb1="0.3 0.5 0.7" rgb2="0 0 0" width="32" height="192"/>'


def shape(kind: str, more: str = 'rgba="0.8 0.4 0.3 1"') -> str:
    return OBJECT.format(scenes.geom_xml(kind, more=more))


def eye(**changes: Any) -> wc.Camera:
    settings = {
        "width": SIZE,
        "height": SIZE,
        "outputs": ("rgb",),
        "position": EYE,
        "rotation": scenes.looking(EYE, (0.0, 0.0, 0.5)),
    }
    return scenes.own_camera(**{**settings, **changes})


# Behind the camera: all scenes share kernels, which takes a minute off the tests.
UNSEEN = "".join(scenes.geom_xml(kind, f"unseen {kind}", 'pos="0 -9 0"') for kind in scenes.TYPES)
UNSEEN_ASSETS = """
  <texture name="u" type="2d" builtin="flat" width="2" height="2"/><material name="u" texture="u"/>
"""
PLAIN = SUN.format("false")
CAST = SUN.format("true").replace("-0.4 0.5", "0.9 0.3")
SHEET = '<mesh name="s" inertia="shell" vertex="-.5 -.5 0 .5 -.5 0 .5 .5 0 -.5 .5 0 0 0 .01" face="{}"/>'
# World and assets by feature.
FEATURES: dict[str, tuple[str, str]] = {
    **{kind: (PLAIN + shape(kind), "") for kind in scenes.TYPES},
    "headlight": (shape("capsule"), ""),
    "spot": ('<light pos="0.5 -0.5 2" dir="-0.2 0.2 -1" cutoff="30" castshadow="false"/>' + FLOOR, ""),
    "shadow": (CAST + FLOOR + shape("box"), ""),
    "own_shadow": (CAST.replace("/>", ' ambient="0.3 0.4 0.3"/>') + FLOOR + shape("cylinder"), ""),
    "sheet_shadow": (
        CAST + FLOOR + '<geom type="mesh" mesh="s" pos="0 0 0.7" euler="0 20 0"/>',
        SHEET.format("0 1 4 1 2 4 2 3 4 3 0 4"),
    ),
    "two_lights": (
        PLAIN + '<light pos="1 -1 2" dir="-0.4 0.4 -1" diffuse="0.1 0.6 0.2"/>' + FLOOR + shape("sphere"),
        "",
    ),
    "texture": (PLAIN + '<geom type="plane" size="2 2 1" material="m"/>', CHECKER.format("2d", 60, 60) + MARBLE),
    "cube_texture": (PLAIN + shape("box", 'material="m"'), CHECKER.format("cube", 64, 384) + MARBLE),
    "round_texture": (PLAIN + shape("sphere", 'material="m"'), CHECKER.format("2d", 64, 64) + MARBLE),
    "emission": (FLOOR + shape("sphere", 'material="m"'), '<material name="m" emission="0.7" rgba="0.2 0.9 0.3 1"/>'),
    "gloss": (PLAIN + shape("sphere", 'material="m"'), '<material name="m" specular="1" shininess="0.9"/>'),
    "skybox": (PLAIN + shape("cylinder"), SKY),
    "smooth_edges": (PLAIN + FLOOR + shape("ellipsoid"), ""),
    "site": (PLAIN + FLOOR + '<site type="box" size=".2 .3 .4" pos="0 0 .6" euler="10 20 30" rgba=".8 .4 .1 1"/>', ""),
}


def compiled(world: str, assets: str = "", more: str = "") -> Any:
    return scenes.compile_xml(world + UNSEEN, assets=assets + UNSEEN_ASSETS + scenes.ASSETS, more=more)


def plain(feature: str, device: wp.Device) -> np.ndarray:
    world, assets = FEATURES[feature]
    mjm = compiled(world, assets)
    camera = eye(shadows="shadow" in feature, antialiasing=4 if feature == "smooth_edges" else 1)
    return scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)["rgb"][0]


# What takes more than one layer. All have a transparent shape, a mirror and haze somewhere.
GLASS = '<geom type="box" size=".4 .3 .5" pos="0 0 .6" rgba=".2 .8 .3 {}"/>'
LAYERED: dict[str, str] = {
    "transparency": shape("sphere") + GLASS.format(0.4).replace('pos="0 0', 'pos=".4 -.6') + FLOOR,
    "reflection": GLASS.format(1) + '<geom type="plane" size="2 2 1" material="mirror"/>',
    "haze": GLASS.format(1) + '<geom type="plane" size="0 0 .1" rgba=".4 .5 .2 1"/>',
}
LAYERED_UNSEEN = """
  <geom type="sphere" size=".1" pos="0 -8 0" rgba="1 1 1 .5"/><geom type="plane" size="0 0 .1" pos="0 0 -5"/>
  <geom type="box" size=".1 .1 .1" pos="0 -8 1" material="mirror"/>
"""
LAYERED_ASSETS = SKY + '<material name="mirror" rgba=".3 .3 .3 1" reflectance=".6"/>'


def layered(feature: str, device: wp.Device) -> np.ndarray:
    more = '<statistic extent="1"/><visual><rgba haze=".9 .6 .3 1"/></visual>'
    mjm = compiled(PLAIN + LAYERED[feature] + LAYERED_UNSEEN, LAYERED_ASSETS, more)
    camera = eye(rotation=scenes.looking(EYE, (0.0, 0.5, 1.4))) if feature == "haze" else eye()
    return scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)["rgb"][0]


# What worlds have each for itself: the first as it is, the second changed, side by side.
VARIED: Mapping[str, tuple[str, Any]] = {
    "vary_color": ("material_color", (0.1, 0.8, 0.4, 1.0)),
    "vary_texture": ("material_texture_offset", (0.3, 0.2)),
    "vary_light": ("light_diffuse", (0.1, 0.2, 0.9)),
    "vary_headlight": ("headlight", 0.02),
    "vary_background": ("background", (0.2, 0.1, 0.5)),
    "exposure": ("exposure", -1.5),
    "gain": ("gain", (1.4, 0.9, 0.4)),
}
SPECIAL = ("material_texture_offset", "headlight", "background")


def varied(feature: str, device: wp.Device) -> np.ndarray:
    name, value = VARIED[feature]
    world = PLAIN + '<geom type="plane" size="2 2 1" material="m"/>' + shape("box", 'material="m"')
    mjm = compiled(world, CHECKER.format("2d", 60, 60) + MARBLE)
    scene = wc.from_mujoco(mjm, [scenes.forward(mjm)] * 2, device=device)
    for each in SPECIAL:
        scene.vary(each)
    renderer = wc.Renderer(scene, [eye(exposure=0.0, gain=1.0)])
    camera = renderer.camera("eye")
    array = getattr(camera, name) if name in ("exposure", "gain") else scene.vary(name)
    array[1] = torch.tensor(value)
    return np.concatenate(scenes.on_host(renderer.render()["eye"])["rgb"], axis=1)


def soft(feature: str, device: wp.Device) -> np.ndarray:
    """Build a scene of all that MuJoCo draws beside geoms and sites."""
    mjm, mjd = visual_geom_scenes.bent({"tendon": "tendons", "flex": "cloth", "skin": "skin"}[feature])
    position = (0.5, -1.6, 1.7) if feature != "tendon" else (0.3, -2.4, 0.7)
    camera = eye(
        position=position,
        rotation=scenes.looking(position, (0.0, 0.0, 0.0)),
        outputs=("rgb", "segmentation"),
        shadows=True,
    )
    return scenes.look(wc.from_mujoco(mjm, mjd, device=device), camera)["rgb"][0]


def flow(device: wp.Device) -> np.ndarray:
    """Right and down as red and green, a sixteenth of a pixel a step, and in blue where it means something."""
    mjm = compiled(PLAIN + FLOOR + shape("box").replace(">", "><freejoint/>", 1))
    mjd = scenes.forward(mjm)
    renderer = wc.Renderer(wc.from_mujoco(mjm, mjd, device=device), [eye(outputs=("flow", "flow_valid"))])
    renderer.render()
    mjd.qpos[:7] = (0.1, -0.1, 0.7, 0.95, 0.1, 0.2, 0.25)
    scenes.mujoco.mj_forward(mjm, mjd)
    seen = scenes.on_host(renderer.render()["eye"])
    steps = np.clip(np.rint(128.0 + 16.0 * seen["flow"][0]), 0.0, 255.0).astype(np.uint8)
    return np.concatenate([steps, 255 * seen["flow_valid"][0][..., None]], axis=-1)


def physical(feature: str, device: wp.Device) -> np.ndarray:
    """Scenes in linear light."""
    newton = pytest.importorskip("newton")
    from newton_scenes import finalize, pose
    from splat_scenes import gaussians

    builder = newton.ModelBuilder()
    opacity = {"opacity": 0.4}.get(feature, 1.0)
    builder.add_shape_box(-1, hx=2.0, hy=2.0, hz=0.1, xform=pose(0.0, 0.0, -0.1), color=(0.3, 0.4, 0.5))
    builder.add_shape_box(-1, hx=0.3, hy=0.5, hz=0.3, xform=pose(-0.5, 0.3, 0.3, (0, 0, 1, 2)), color=(0.9, 0.5, 0.1))
    builder.add_shape_sphere(-1, radius=0.5, xform=pose(0.2, 0.0, 0.6), color=(0.9, 0.3, 0.1), opacity=opacity)
    if feature == "splats":
        places, colors = [(0.3, -0.4, 0.9), (-0.4, -0.3, 0.5)], [(0.9, 0.1, 0.2), (0.1, 0.8, 0.3)]
        builder.add_shape_gaussian(-1, gaussian=gaussians(places, colors, scales=[(0.3, 0.1, 0.2), (0.2, 0.3, 0.2)]))
    scene = wc.from_newton(*finalize(builder, device))
    if feature == "metal":
        scene.vary("material_metallic")[:] = 1.0
        scene.vary("material_roughness")[:] = 0.2
    return scenes.look(scene, eye(shadows=True))["rgb"][0]


def _of(draw: Callable[[str, wp.Device], np.ndarray], names: Any) -> dict[str, Picture]:
    return {name: functools.partial(draw, name) for name in names}


PICTURES: dict[str, Picture] = {
    **_of(plain, FEATURES),
    **_of(layered, LAYERED),
    **_of(varied, VARIED),
    **_of(soft, ("tendon", "flex", "skin")),
    "flow": flow,
    **_of(physical, ("rough", "metal", "opacity", "splats")),
    **_of(sensor_pictures.measured, sensor_pictures.DEPTH_CAMERAS),
    **_of(color_pictures.colored, color_pictures.COLOR_EFFECTS),
    **_of(depth_pictures.measured, depth_pictures.DEPTH_EFFECTS),
    **_of(shutter_pictures.exposed, shutter_pictures.SHUTTERS),
    **_of(lidar_pictures.scanned, lidar_pictures.SCANS),
    **_of(sensor_pictures.matched, ("stereo_camera",)),
}
