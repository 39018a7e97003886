"""Small scenes that reach every header of kernels/native, by name: pictures of one feature each, and more."""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam import sensors
from warpcam.compat.common import packing

sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers"))
import golden_scenes
import judged_scenes
import label_reference
import scenes
import shape_clusters
from path_scenes import traced

WORLDS = 2
IMAGES = ("rgb", "depth", "segmentation", "normals", "points", "albedo", "flow", "flow_valid")
EYE = (0.3, -2.6, 1.4)
LIGHTS = '<light pos="1 1 4" dir="-1 -1 -4"/><light directional="true" dir="0 1 -2"/>'
SHEER = """
  <texture name="sheer" type="2d" nchannel="4" file="{}"/>
  <material name="sheer" texture="sheer" rgba="1 1 1 .7"/>
"""
FLOOR = '<geom type="plane" size="0 0 1"/>'


def _scene(count: int, more: str = "") -> wc.Scene:
    """Shapes of all types in clouds, other ones in each world."""
    random = np.random.default_rng(3)
    mjm = shape_clusters.cluster("all", random, count, LIGHTS + FLOOR + more)
    m, d = scenes.put(mjm, WORLDS)
    d.mocap_pos.assign(random.uniform((-1.2, -1.0, 0.2), (1.2, 1.5, 2.0), (*d.mocap_pos.shape, 3)).astype(np.float32))
    turns = random.normal(size=(*d.mocap_quat.shape, 4))
    d.mocap_quat.assign((turns / np.linalg.norm(turns, axis=-1, keepdims=True)).astype(np.float32))
    scenes.mjw.kinematics(m, d)
    return wc.from_mujoco_warp(mjm, m, d)


def _clouds(count: int, more: str = "", **options: Any) -> Callable[[wp.Device], object]:
    """Two frames of many images of a size that is no multiple of a tile."""

    def draw(_device: wp.Device) -> object:
        settings = {"width": 45, "height": 37, "outputs": IMAGES, "shadows": True} | options
        turn = scenes.looking(EYE, (0.0, 0.3, 0.8))
        renderer = wc.Renderer(_scene(count, more), [scenes.own_camera(position=EYE, rotation=turn, **settings)])
        renderer.render()
        return scenes.on_host(renderer.render()["eye"])

    return draw


def _analytic(count: int, assets: str = "", **options: Any) -> Callable[[wp.Device], object]:
    """Two frames of shapes that have no faces."""

    def draw(_device: wp.Device) -> object:
        random = np.random.default_rng(5)
        shapes = ""
        for number in range(count):
            x, y, z = random.uniform((-1.5, -1.0, 0.1), (1.5, 2.0, 2.0))
            kind = ("sphere", "capsule", "ellipsoid", "cylinder", "box")[number % 5]
            more = f'pos="{x} {y} {z}" euler="{90 * x} {90 * y} 0"' + (
                ' material="sheer"' if assets and number % 2 else ""
            )
            shapes += scenes.geom_xml(kind, f"shape{number}", more, 0.3 * np.array(scenes.SIZES[kind]))
        with tempfile.NamedTemporaryFile(suffix=".png") as file:
            Image.new("RGBA", (8, 8), (230, 120, 50, 60)).save(file.name)
            mjm = scenes.compile_xml(LIGHTS + FLOOR + shapes, assets=assets.format(file.name))
        settings = {"width": 64, "height": 64, "shadows": "rgb" in options["outputs"]} | options
        turn = scenes.looking(EYE, (0.0, 0.3, 0.8))
        scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, WORLDS))
        renderer = wc.Renderer(scene, [scenes.own_camera(position=EYE, rotation=turn, **settings)])
        renderer.render()
        return scenes.on_host(renderer.render()["eye"])

    return draw


def _far_sides(device: wp.Device) -> object:
    mjm = scenes.compile_xml("".join(scenes.geom_xml(kind, more='pos=".05 -.1 .08"') for kind in scenes.TYPES[2:7]))
    directions = np.random.default_rng(1).normal(size=(9, 13, 3))
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    lidar = sensors.Lidar(scene, sensors.patterns.rays(directions), far_sides=True, outputs=("ranges", "normals"))
    return {name: image.cpu() for name, image in lidar.read().items()}


def _offset_rays(_device: wp.Device) -> object:
    columns = np.stack(np.meshgrid(np.linspace(-1, 1, 33), np.linspace(1, -1, 21), [-1.0])[:2], axis=-1)[:, :, 0]
    rays = np.concatenate((columns, -np.ones((*columns.shape[:2], 1))), axis=-1)
    lens = wc.Rays(rays, origins=0.1 * rays)
    return _clouds(9, width=33, height=21, lens=lens, outputs=("rgb", "depth", "normals", "points"))(_device)


def _paths(name: str) -> Callable[[wp.Device], object]:
    """A scene of the path tracer's tests, by few paths."""

    def draw(device: wp.Device) -> object:
        import judged_stages
        from pxr import Usd
        from usd_stages import metric

        with tempfile.TemporaryDirectory() as folder:
            stage = metric(Usd.Stage.CreateNew(f"{folder}/scene.usda"))
            scene = judged_stages.scene_of(stage, judged_scenes.SCENES[name], device)
            return traced(scene, judged_stages.CAMERA, 2)

    return draw


def _labels(_device: wp.Device) -> object:
    outputs = ("bodies", "segmentation", "depth")
    results = []
    for lens in (wc.Pinhole(fovy=60.0), wc.Fisheye(fovy=120.0)):
        turn = scenes.looking(EYE, (0.0, 0.3, 0.8))
        camera = scenes.own_camera(position=EYE, rotation=turn, width=45, height=37, outputs=outputs, lens=lens)
        renderer = wc.Renderer(_scene(16), [camera])
        renderer.render()
        keypoints = {"middle": (1, (0.0, 0.0, 0.0)), "far": (0, (9.0, 9.0, 9.0))}
        results.append(label_reference.on_host(wc.labels(renderer, keypoints=keypoints).read()["eye"]))
    return results


def _point_clouds(device: wp.Device) -> object:
    points = np.random.default_rng(0).normal(size=(WORLDS, 17, 40, 3)).astype(np.float32)
    points[0, 3:6] = np.inf
    given = torch.from_numpy(points).to(wp.device_to_torch(device))
    chosen: tuple[dict[str, Any], ...] = ({"method": "farthest"}, {"method": "first", "voxel_size": 0.4})
    return [sensors.PointClouds.of(given, num_points=90, **options).read()["points"].cpu() for options in chosen]


def _packed(device: wp.Device) -> object:
    """Images in buffers of others, of rows that no vector of pixels divides."""
    colors = wp.full((WORLDS, 3, 5, 3), 9, dtype=wp.uint8, device=device)
    out = wp.zeros((WORLDS, 17), dtype=wp.uint32, device=device)
    packing.bind_color(colors, packing.RGBA, out, 1, device).launch()
    return out.numpy()


def _newton(device: wp.Device) -> object:
    """Cloth, splats and shapes of Newton, in linear light, with lights of a size."""
    import newton_scenes
    import splat_scenes

    builder = newton_scenes.zoo()
    builder.add_shape_plane(None, width=0.0, length=0.0, xform=newton_scenes.pose(0.0, 0.0, 0.0))
    builder.add_shape_gaussian(body=-1, gaussian=splat_scenes.random_gaussians(20, 0))
    for row in range(3):
        builder.add_particles(
            pos=[(0.3 * x, 0.5, 0.3 * row + 1.0) for x in range(3)], vel=[(0.0,) * 3] * 3, mass=[1.0] * 3
        )
    builder.add_triangles([0, 1, 4, 0, 4], [1, 4, 5, 3, 7], [4, 5, 2, 6, 3])
    scene = wc.from_newton(*newton_scenes.finalize(builder, device))
    camera = newton_scenes.eye(width=45, height=37, outputs=("rgb", "depth", "normals"), shadows=True)
    renderer = wc.Renderer(scene, [camera])
    renderer.render()
    return scenes.on_host(renderer.render()["eye"])


SCENES: dict[str, Callable[[wp.Device], object]] = {
    **golden_scenes.PICTURES,
    "clouds": _clouds(16),
    "clouds_smooth": _clouds(16, antialiasing=4),
    "clouds_fisheye": _clouds(9, lens=wc.Fisheye(fovy=140.0), outputs=IMAGES[:-2]),
    "clouds_orthographic": _clouds(9, lens=wc.Orthographic(height=2.0)),
    "clouds_glass": _clouds(9, '<geom size=".4" pos="0 -1 1" rgba="1 1 1 .5"/>', outputs=("rgba", "depth")),
    "many": _clouds(260, outputs=("rgb", "depth")),
    "many_depth": _clouds(260, outputs=("depth", "segmentation", "points"), shadows=False),
    "triangles": _clouds(9, outputs=("faces", "barycentrics")),
    "albedo": _clouds(9, outputs=("depth", "albedo")),
    "few": _analytic(9, outputs=("depth", "segmentation", "normals")),
    "few_flow": _analytic(9, outputs=("depth", "flow", "flow_valid")),
    "few_lit": _analytic(9, outputs=("rgb", "depth"), antialiasing=4),
    "sheer": _analytic(9, SHEER, outputs=("rgb",)),
    "casters": _analytic(400, outputs=("rgb",)),
    "far_sides": _far_sides,
    "offset_rays": _offset_rays,
    **{f"paths_{number}": _paths(name) for number, name in enumerate(judged_scenes.SCENES)},
    "newton": _newton,
    "labels": _labels,
    "point_clouds": _point_clouds,
    "packed": _packed,
}

# On a GPU, where each is drawn under four tools: of each kernel that a GPU has, one of its kinds.
FEW = (
    "clouds", "clouds_smooth", "clouds_glass", "offset_rays", "many_depth", "triangles", "albedo", "few", "few_flow",
    "few_lit", "sheer", "casters", "reflection", "haze", "vary_texture", "newton", "paths_0", "paths_3", "labels",
    "point_clouds", "packed", "far_sides", "stereo_camera", "effect_jpeg_artifacts", "effect_chromatic_aberration",
)  # fmt: skip
