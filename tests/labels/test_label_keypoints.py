"""Keypoints: pixels, depths, and what hides them, against MuJoCo's rays."""

import re
from typing import Any

import label_reference
import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc

SIZE = 96
EYE = (0.0, -4.0, 1.2)
WORLD = """
<geom type="plane" size="5 5 1"/>
<body name="ball" pos="0 0 1"><geom size=".5"/><site name="front" pos="0 -.5 0"/><site name="back" pos="0 .5 0"/></body>
<body name="block" pos="1 1 .5" euler="0 0 30"><geom type="box" size=".3 .4 .5"/><site name="top" pos="0 0 .5"/></body>
<site name="beyond" pos="9 0 1"/>
<site pos="0 0 0"/>
"""


def says(text: str) -> Any:
    return pytest.raises(wc.WarpcamError, match=re.escape(text))


def renderer_of(mjm: mujoco.MjModel, device: wp.Device, **options: Any) -> wc.Renderer:
    rotation = scenes.looking(EYE, (0.0, 0.0, 0.8))
    settings = {"outputs": ("bodies",), "lens": wc.Pinhole(fovy=60.0), "rotation": rotation} | options
    camera = scenes.own_camera(width=SIZE, height=SIZE, position=EYE, **settings)
    renderer = wc.Renderer(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), [camera])
    renderer.render()
    return renderer


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return scenes.compile_xml(WORLD)


def read(renderer: wc.Renderer, keypoints: Any, **options: Any) -> dict[str, np.ndarray]:
    labels = wc.labels(renderer, amodal=False, keypoints=keypoints, **options)
    return label_reference.on_host(labels.read()["eye"])


def test_sites_of_a_model(model: mujoco.MjModel, device: wp.Device) -> None:
    keypoints = wc.site_keypoints(model)
    assert list(keypoints) == ["beyond", "front", "back", "top"]
    assert keypoints["back"] == (model.body("ball").id, (0.0, 0.5, 0.0))
    assert list(wc.site_keypoints(model, ["top", "front"])) == ["top", "front"]
    mjd = scenes.forward(model)
    turn = scenes.matrix(scenes.looking(EYE, (0.0, 0.0, 0.8)))
    for lens in (wc.Pinhole(fovy=60.0), wc.Orthographic(height=4.0), wc.Fisheye(fovy=120.0)):
        found = read(renderer_of(model, device, lens=lens), keypoints)
        local = (mjd.site_xpos[[model.site(name).id for name in keypoints]] - EYE) @ turn
        np.testing.assert_allclose(found["keypoint_depths"][0], -local[:, 2], atol=1e-5)
        expected = lens.project(torch.tensor(local), width=SIZE, height=SIZE).numpy()
        np.testing.assert_allclose(found["keypoints"][0, 1:], expected[1:], atol=0.02)
        assert found["keypoint_visibility"][0].tolist() == [0, 2, 1, 2]


@pytest.mark.parametrize("kind", ["pinhole", "orthographic", "rays", "origins"])
def test_visibility_is_that_of_mujocos_rays(model: mujoco.MjModel, kind: str, device: wp.Device) -> None:
    mjd = scenes.forward(model)
    places = np.random.default_rng(2).uniform((-3.0, -2.0, 0.05), (3.0, 3.0, 2.5), (400, 3))
    rays = np.stack(np.meshgrid(np.linspace(-0.6, 0.6, SIZE), np.linspace(0.6, -0.6, SIZE)), axis=-1)
    rays = np.concatenate([rays, np.full((SIZE, SIZE, 1), -1.0)], axis=-1)
    aside = np.array((0.3, 0.2, 0.1))
    lens: wc.Lens = {
        "pinhole": wc.Pinhole(fovy=60.0),
        "orthographic": wc.Orthographic(height=4.0),
        "rays": wc.Fisheye(fovy=70.0),
        "origins": wc.Rays(rays, origins=np.broadcast_to(aside, rays.shape)),
    }[kind]
    found = read(renderer_of(model, device, lens=lens), {str(k): (None, place) for k, place in enumerate(places)})
    turn = scenes.matrix(scenes.looking(EYE, (0.0, 0.0, 0.8)))
    pixels = lens.project(torch.tensor((places - EYE) @ turn), width=SIZE, height=SIZE).numpy()
    hit, expected, sure = np.zeros(1, np.int32), np.zeros(len(places), np.int64), np.ones(len(places), bool)
    for number, (place, pixel) in enumerate(zip(places, pixels, strict=True)):
        if not ((pixel >= 0.0) & (pixel < SIZE)).all():
            sure[number] = not (np.abs(pixel - SIZE / 2) < SIZE / 2 + 0.1).all()
            continue
        start = np.array(EYE)
        if kind == "origins":
            start = start + turn @ aside
        elif kind == "orthographic":
            start = place - turn[:, 2] * ((EYE - place) @ -turn[:, 2])
        length = np.linalg.norm(place - start)
        along = mujoco.mj_ray(model, mjd, start, (place - start) / length, None, 1, -1, hit)
        gap = np.inf if along < 0.0 else along - (length - 0.01)
        expected[number], sure[number] = (2 if gap > 0.0 else 1), abs(gap) > 1e-3
    visibility = found["keypoint_visibility"][0]
    wrong = sure & (visibility != expected)
    assert wrong.sum() <= 2, (places[wrong], visibility[wrong], expected[wrong])  # rays that graze an edge
    assert min(np.bincount(visibility, minlength=3)) >= 10 and sure.mean() > 0.95


def test_range_and_tolerance(model: mujoco.MjModel, device: wp.Device) -> None:
    inside = {"in the ball": ("ball", (0.0, -0.4, 0.0)), "far": (None, (0.5, 3.0, 2.0))}
    renderer = renderer_of(model, device, near=0.1, far=6.0)
    assert read(renderer, inside)["keypoint_visibility"].tolist() == [[1, 0]]
    assert read(renderer, inside, tolerance=0.2)["keypoint_visibility"].tolist() == [[2, 0]]
    behind = {"behind the ball": ("ball", (0.0, 0.9, 0.0))}
    assert read(renderer, behind)["keypoint_visibility"].tolist() == [[1]]
    assert read(renderer_of(model, device, near=4.7), behind)["keypoint_visibility"].tolist() == [[2]]
    unseen = renderer_of(model, device, exclude_bodies=("ball",))
    assert read(unseen, behind)["keypoint_visibility"].tolist() == [[2]]


def test_meshes_and_terrain_hide(device: wp.Device) -> None:
    mjm = scenes.compile_xml(
        '<geom type="mesh" mesh="mesh" pos="-.6 0 1"/><geom type="hfield" hfield="hfield" pos=".6 0 1"/>',
        assets=scenes.ASSETS,
    )
    mjd, random = scenes.forward(mjm), np.random.default_rng(1)
    places = random.uniform((-1.5, 0.8, 0.0), (1.5, 2.0, 2.0), (100, 3))
    found = read(renderer_of(mjm, device), {str(k): (None, place) for k, place in enumerate(places)})
    hit = np.zeros(1, np.int32)
    along = [mujoco.mj_ray(mjm, mjd, EYE, place - EYE, None, 1, -1, hit) for place in places]
    expected = np.where(np.array(along) < 0.0, 2, 1)
    assert min(np.bincount(expected, minlength=3)[1:]) > 20
    assert (found["keypoint_visibility"][0] != expected).sum() <= 1


def test_bad_keypoints(model: mujoco.MjModel, device: wp.Device) -> None:
    renderer = renderer_of(model, device)
    for keypoints, text in (
        ([1], "labels: keypoints must be {name: (body, (x, y, z))}, a body by name or index, or None for the world"),
        ({"a": 1}, "labels: keypoints['a'] must be (body, (x, y, z)), got 1"),
        ({"a": ("hand", (0, 0, 0))}, "labels: keypoints['a']: "),
        ({"a": (None, (0, np.nan, 0))}, "labels: keypoints['a']: the place must be three finite numbers [m], got"),
        ({"a": (None, "xyz")}, "labels: keypoints['a']: the place must be three finite numbers [m], got 'xyz'"),
    ):
        with says(text):
            wc.labels(renderer, keypoints=keypoints)  # type: ignore[arg-type]
    with says("site_keypoints: sites has 'hand', the model has 'beyond', 'front', 'back', 'top'"):
        wc.site_keypoints(model, ["hand"])
    with says("site_keypoints: sites must be names or None, got 'top'"):
        wc.site_keypoints(model, "top")
