"""Segmentation and depth against ``mujoco.Renderer``, on scenes that come with installed packages."""

from pathlib import Path

import mujoco
import pytest
import scenes
import warp as wp
from mujoco_judge import compare_with, draw

import warpcam as wc

FINE = 120  # slices and stacks of what MuJoCo draws round; it draws 28 and 16 unless told
OURS = scenes.MUJOCO_WARP_MODELS
FROM_MUJOCO_WARP = (
    "humanoid/humanoid.xml",
    "humanoid/n_humanoid.xml",
    "primitives.xml",
    "aloha_pot/scene.xml",
    "mug/mug.xml",
    "pendula.xml",
    "ray.xml",
    "collision.xml",
    "constraints.xml",
    "hfield/hfield.xml",
    "convex_collision/box100.xml",
    "skybox/checker.xml",
    "flex/floppy.xml",
    "tendon/wrap.xml",
)
FROM_MJLAB = (
    "asset_zoo/robots/i2rt_yam/xmls/yam.xml",
    "asset_zoo/robots/unitree_g1/xmls/g1.xml",
    "asset_zoo/robots/unitree_go1/xmls/go1.xml",
)


def compare(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int, device: wp.Device, name: str) -> None:
    reference = draw(mjm, mjd, camera)
    scene = wc.from_mujoco(mjm, mjd, device=device)
    compare_with(reference, scene, name)


def cameras(mjm: mujoco.MjModel) -> list[int]:
    return [-1, *range(min(mjm.ncam, 3))]


def load(path: Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm = mujoco.MjModel.from_xml_path(str(path))
    mjm.vis.quality.numslices = mjm.vis.quality.numstacks = FINE
    return mjm, scenes.forward(mjm)


@pytest.mark.parametrize("name", FROM_MUJOCO_WARP)
def test_scenes_of_mujoco_warp(device: wp.Device, name: str) -> None:
    mjm, mjd = load(OURS / name)
    for camera in cameras(mjm):
        compare(mjm, mjd, camera, device, name)


@pytest.mark.parametrize("name", FROM_MJLAB)
def test_robots_of_mjlab(device: wp.Device, name: str) -> None:
    folder = scenes.package_folder("mjlab")
    if folder is None:
        pytest.skip("mjlab is not installed")
    mjm, mjd = load(folder / name)
    for camera in cameras(mjm):
        compare(mjm, mjd, camera, device, name)


@pytest.mark.parametrize(
    "lens",
    [
        'fovy="70"',
        'fovy="2" projection="orthographic"',
        'sensorsize="0.02 0.02" resolution="128 128" focal="0.018 0.018" principal="0.002 -0.003"',
        'sensorsize="0.02 0.02" resolution="128 128" focalpixel="100 100" principalpixel="20 -10"',
    ],
    ids=["fovy", "orthographic", "principal", "principalpixel"],
)
def test_lenses(device: wp.Device, lens: str) -> None:
    shapes = "".join(
        scenes.geom_xml(kind, more=f'pos="{0.8 * (index % 3) - 0.8} {0.8 * (index // 3) - 0.8} 0" euler="20 30 40"')
        for index, kind in enumerate(scenes.TYPES)
    )
    mjm = scenes.compile_xml(f'{shapes}<camera pos="0.1 0.2 3" {lens}/>', assets=scenes.ASSETS)
    mjm.vis.quality.numslices = mjm.vis.quality.numstacks = FINE
    compare(mjm, scenes.forward(mjm), 0, device, lens)
