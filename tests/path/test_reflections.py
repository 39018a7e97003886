"""Reflections and refraction of the real-time look: by mirrored cameras, Snell's law, what paths of light show."""

import gc
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from allocation_ledger import Ledger

import warpcam as wc

pytest.importorskip("pxr.Usd")
import judged_scenes as judged
from judged_scenes import Ball, Box, Judged, Look, Sun, quad
from judged_stages import CAMERA, judged_pixels, scene_of
from pxr import Sdf, Usd, UsdShade
from usd_stages import metric

MIRROR = Box((0.0, 0.0, -4.05), (3.0, 3.0, 0.05), look=Look(kind="metal"))  # its front is at z = -4
SHAPES = (
    Ball((1.6, 0.5, 1.5), 1.0, Look((0.7, 0.3, 0.2))),
    Box((-1.6, -0.3, 1.0), (0.8, 0.8, 0.5), 20.0, Look((0.2, 0.6, 0.3))),
    quad((-4, -1.4, 4), (4, -1.4, 4), (4, -1.4, -2.5), (-4, -1.4, -2.5), look=Look((0.5, 0.5, 0.6))),
)
SUN = Sun((0.3, 1.0, -0.3), 2.0)
SKY = (0.3, 0.4, 0.5)


def mirrored(look: Look, sky: Any = SKY, shapes: tuple[Any, ...] = SHAPES) -> Judged:
    """A mirror before the camera, in which shapes are seen that are behind it."""
    return Judged((replace(MIRROR, look=look), *shapes), (SUN,), sky=sky)


def drawn(scene: wc.Scene, camera: wc.Camera = CAMERA, **how: Any) -> dict[str, np.ndarray]:
    images = wc.Renderer(scene, [replace(camera, shadows=True)], **how).render()["c"]
    return {name: image.cpu().numpy().copy() for name, image in images.items()}


def reflected(scene: wc.Scene, camera: wc.Camera = CAMERA) -> dict[str, np.ndarray]:
    return {name: image[0] for name, image in drawn(scene, camera, reflections=True).items()}


def test_a_mirror_shows_what_the_mirrored_camera_sees(stage: Usd.Stage, device: wp.Device) -> None:
    """The picture from behind the mirror, without the mirror, the other way round; with its shadows."""
    seen = reflected(scene_of(stage, mirrored(Look(kind="metal")), device))
    behind = replace(CAMERA, position=(0.0, 0.0, -8.0), rotation=(0.0, 0.0, 1.0, 0.0))
    other = metric(Usd.Stage.CreateNew(stage.GetRootLayer().realPath.replace("scene", "other")))
    plain = drawn(scene_of(other, Judged(SHAPES, (SUN,), sky=SKY), device), behind)
    wanted = {name: image[0][:, ::-1] for name, image in plain.items()}
    there = judged_pixels(wanted) & (seen["segmentation"][..., 0] == 0)
    assert len(np.unique(wanted["segmentation"][there])) == 3
    np.testing.assert_allclose(seen["hdr"][there], wanted["hdr"][there], atol=2e-3)


def test_a_mirror_is_that_of_paths(stage: Usd.Stage, device: wp.Device) -> None:
    """To three levels of 255, outside of edges and of the few paths that facets send across them."""
    scene = scene_of(stage, mirrored(Look(kind="metal"), sky=None), device)
    camera = replace(CAMERA, outputs=("rgb", "rgba", "hdr", "segmentation"))
    seen = reflected(scene, camera)
    path = wc.PathOptions(samples=64, bounces=2)
    wanted = {name: image[0] for name, image in drawn(scene, camera, look="path", path=path).items()}
    gap = np.abs(seen["rgb"].astype(int) - wanted["rgb"]).max(axis=-1)
    there = judged_pixels(wanted) & (seen["segmentation"][..., 0] == 0)
    padded = np.pad(seen["rgb"][..., 1].astype(int), 3, mode="edge")
    around = [padded[j : 64 + j, i : 64 + i] for j in range(7) for i in range(7)]
    there &= np.ptp(around, axis=0) < 20
    assert there.sum() > 1000
    assert np.quantile(gap[there], 0.99) <= 3
    assert wanted["rgb"][there].max() > 60


@pytest.mark.parametrize("index", [1.3, 1.5])
def test_a_slab_shifts_by_snell(index: float, stage: Usd.Stage, device: wp.Device) -> None:
    """What is behind a tilted pane of thickness d is seen beside where it is; and dimmer, by Fresnel's equations."""
    thick, tilt = 1.0, np.radians(40.0)
    inner = np.arcsin(np.sin(tilt) / index)
    shift = thick * np.sin(tilt - inner) / np.cos(inner)
    black, bright = Look((0.0, 0.0, 0.0)), Look((0.0, 0.0, 0.0), emission=(1.0, 0.5, 0.25))
    halves = [quad((x, -4, -6), (x + 4, -4, -6), (x + 4, 4, -6), (x, 4, -6), look=look)
              for x, look in ((-4, black), (0, bright))]  # fmt: skip
    pane = Box((0.0, 0.0, -3.0), (3.0, 3.0, 0.5 * thick), 40.0, Look((1.0, 1.0, 1.0), kind="glass", index=index))
    scene = scene_of(stage, Judged((pane, *halves)), device)
    camera = replace(CAMERA, width=200, lens=wc.Orthographic(height=0.64))  # 1 cm a pixel
    row = reflected(scene, camera)["hdr"][32]
    cosines = np.cos(tilt), np.cos(inner)
    across = (cosines[0] - index * cosines[1]) / (cosines[0] + index * cosines[1])
    along = (index * cosines[0] - cosines[1]) / (index * cosines[0] + cosines[1])
    through = 1.0 - 0.5 * (across**2 + along**2)
    np.testing.assert_allclose(row.max(axis=0), through * np.array((1.0, 0.5, 0.25)), rtol=1e-3)
    edge = np.flatnonzero(row[:, 0] > 0.5 * through)[0]
    assert abs(0.01 * (edge - 100)) == pytest.approx(shift, abs=0.011)


@pytest.mark.parametrize("roughness", [0.0, 0.3])
def test_a_glass_ball_is_lost_in_an_even_sky(roughness: float, stage: Usd.Stage, device: wp.Device) -> None:
    """Nothing is lost and nothing is won on the way through."""
    look = Look((1.0, 1.0, 1.0), kind="glass", roughness=roughness)
    seen = reflected(scene_of(stage, Judged((Ball((0.0, 0.0, -4.0), 1.0, look),), sky=SKY), device))
    there = seen["segmentation"][..., 0] == 0
    np.testing.assert_allclose(seen["hdr"][there], np.broadcast_to(SKY, (there.sum(), 3)), rtol=5e-3)


@pytest.mark.parametrize("scene", ["a glass ball under an even sky", "metals under an even sky"])
def test_it_is_nearer_to_paths(scene: str, stage: Usd.Stage, device: wp.Device) -> None:
    """Mean error of the light that reaches the camera, beside the stored reference."""
    opened = scene_of(stage, judged.SCENES[scene], device)
    wanted = drawn(opened, look="path", path=wc.PathOptions(samples=64))["hdr"]
    errors = [np.abs(drawn(opened, reflections=on)["hdr"] - wanted).mean() for on in (False, True)]
    assert errors[1] < 0.45 * errors[0]


def test_roughness_blends_evenly(stage: Usd.Stage, device: wp.Device) -> None:
    """From a mirror to the sky alone, without a step; beyond, nothing is another."""
    scene = scene_of(stage, mirrored(Look(kind="metal", roughness=0.1)), device)
    renderers = [wc.Renderer(scene, [CAMERA], reflections=on) for on in (False, True)]

    def seen(roughness: float) -> list[np.ndarray]:
        scene.array("material_roughness").fill_(roughness)
        return [renderer.render()["c"]["hdr"].cpu().numpy().copy() for renderer in renderers]

    at = np.arange(0.18, 0.84, 0.02)
    steps = np.abs(np.diff([seen(roughness)[1] for roughness in at], axis=0)).max(axis=(1, 2, 3, 4))
    off, on = seen(0.2)
    assert np.abs(on - off).max() > 0.2
    assert steps.max() < 0.4 * np.abs(on - off).max()
    for image in (seen(0.8), seen(0.9)):
        np.testing.assert_array_equal(*image)


@pytest.mark.parametrize(("roughness", "most"), [(0.2, 0.11), (0.35, 0.1), (0.5, 0.08)])
def test_a_rough_mirror_is_blurred_as_paths_have_it(
    stage: Usd.Stage, roughness: float, most: float, device: wp.Device
) -> None:
    """The farther what it shows is, the more: root of the mean square beside paths, over the mean."""
    scene = scene_of(stage, mirrored(Look(kind="metal", roughness=roughness)), device)
    path = wc.PathOptions(samples=256, bounces=2)
    wanted = drawn(scene, look="path", path=path)["hdr"][0]
    seen = drawn(scene, replace(CAMERA, antialiasing=4), reflections=True)["hdr"][0]
    error = np.sqrt(((seen - wanted) ** 2).mean()) / wanted.mean()
    assert error < most


def test_partly_transparent_shapes_are_seen_through(stage: Usd.Stage, device: wp.Device) -> None:
    """In a mirror, too: half of the shape, half of what is behind it."""
    pane = quad((3, -3, 0.5), (-3, -3, 0.5), (-3, 3, 0.5), (3, 3, 0.5), look=Look((0.0, 0.0, 0.0), emission=SKY))
    wall = quad((5, -5, 3), (-5, -5, 3), (-5, 5, 3), (5, 5, 3), look=Look((0.0, 0.0, 0.0), emission=(1.0, 1.0, 1.0)))
    scene_of(stage, mirrored(Look(kind="metal"), shapes=(pane, wall), sky=None), device)
    UsdShade.Shader.Get(stage, "/Looks/m1/surface").CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(0.25)
    seen = reflected(wc.from_usd(stage, device=device, exposure=0.0))["hdr"][20:44, 20:44]
    np.testing.assert_allclose(seen, np.broadcast_to(0.25 * np.array(SKY) + 0.75, seen.shape), rtol=2e-3)


def test_what_hides_light_leaves_mirrors_alone(stage: Usd.Stage, device: wp.Device) -> None:
    """Rays find what hides the sky that a mirror would show; the rest of the picture is darker in corners."""
    scene = scene_of(stage, mirrored(Look(kind="metal")), device)
    wanted, seen = (
        drawn(scene, reflections=True, **how)["hdr"] for how in ({}, {"ambient_occlusion": 9.0, "soft_shadows": True})
    )
    np.testing.assert_allclose(seen, wanted, atol=0.02)
    hidden = drawn(scene, ambient_occlusion=9.0)["hdr"]
    assert np.abs(hidden - drawn(scene)["hdr"]).max() > 0.05


def worlds_of(stage: Usd.Stage, device: wp.Device) -> wc.Scene:
    """Three worlds, whose mirrored ball is red, green or blue."""
    scene_of(stage, mirrored(Look(kind="metal")), device)
    scene = wc.from_usd(stage, num_worlds=3, device=device, exposure=0.0)
    scene.array("material_reflectance").fill_(0.0)
    for world, color in enumerate(((1.0, 0.1, 0.1), (0.1, 1.0, 0.1), (0.1, 0.1, 1.0))):
        scene.vary("shape_colors")[world, 1, :3] = scene.vary("shape_colors").new_tensor(color)
    return scene


def test_worlds_mirror_their_own_shapes(stage: Usd.Stage, device: wp.Device) -> None:
    scene = worlds_of(stage, device)
    renderer = wc.Renderer(scene, [CAMERA], reflections=True)
    seen = renderer.render()["c"]["hdr"].cpu().numpy().copy()
    ball = np.abs(seen[0] - seen[1]).max(axis=-1) > 0.05
    assert ball.sum() > 50
    for world in range(3):
        assert (seen[world][ball].argmax(axis=-1) == world).all()
    renderer.images["c"]["hdr"].fill_(-1.0)
    again = renderer.render(worlds=[1])["c"]["hdr"].cpu().numpy()
    np.testing.assert_array_equal(again[1], seen[1])
    assert (again[[0, 2]] == -1.0).all()


@pytest.mark.parametrize("lens", [wc.Pinhole(fovy=40.0), wc.Fisheye(fovy=60.0)], ids=["pinhole", "fisheye"])
@pytest.mark.parametrize(("samples", "across", "down"), [(4, 2, 2), (8, 4, 2)])
def test_samples_are_finer_pixels(
    lens: Any, samples: int, across: int, down: int, stage: Usd.Stage, device: wp.Device
) -> None:
    """All over the image: edges run through what mirrors show, too."""
    scene = scene_of(stage, mirrored(Look(kind="metal")), device)
    camera = replace(CAMERA, lens=lens, outputs=("hdr",), width=32, height=32)
    seen = reflected(scene, replace(camera, antialiasing=samples))["hdr"]
    assert seen.shape == (32, 32, 3)
    if across == down:  # pixels stay square
        fine = reflected(scene, replace(camera, width=32 * across, height=32 * down))["hdr"]
        np.testing.assert_allclose(seen, fine.reshape(32, down, 32, across, 3).mean(axis=(1, 3)), atol=1e-5)
    sharp = reflected(scene, camera)["hdr"]
    assert np.abs(seen - sharp).max() > 0.05
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), sharp.mean(axis=(0, 1)), rtol=0.05)


def test_memory_is_what_was_estimated(stage: Usd.Stage, device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = worlds_of(stage, device)
    cameras = [replace(CAMERA, antialiasing=4, lens=wc.Fisheye(fovy=60.0))]
    told = wc.estimate_memory(scene, cameras, reflections=True)
    assert told.total > wc.estimate_memory(scene, cameras).total
    wc.Renderer(scene, cameras, reflections=True).render()  # what Warp loads once is loaded
    gc.collect()
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    ledger = Ledger(getattr(device, slot))
    monkeypatch.setattr(device, slot, ledger)
    renderer = wc.Renderer(scene, cameras, reflections=True)
    gc.collect()
    assert ledger.held == told.total == renderer.memory.total
    renderer.render()
    assert ledger.held == told.total


@pytest.mark.parametrize(("how", "text"), [
    ({"reflections": 1}, "Renderer: reflections must be True or False, got 1"),
    ({"reflections": True, "look": "path"},
     "Renderer: reflections is True, which is of look='pbr' alone; the look is 'path'"),
])  # fmt: skip
def test_errors(how: dict[str, Any], text: str, stage: Usd.Stage, device: wp.Device) -> None:
    scene = scene_of(stage, Judged(SHAPES), device)
    with pytest.raises(wc.WarpcamError, match=re.escape(text)):
        wc.Renderer(scene, [CAMERA], **how)


def test_rays_of_pixels_have_no_parts(stage: Usd.Stage, device: wp.Device) -> None:
    scene = scene_of(stage, Judged(SHAPES), device)
    rays = np.broadcast_to((0.0, 0.0, -1.0), (64, 64, 3))
    camera = replace(CAMERA, lens=wc.Rays(rays), antialiasing=4)
    with pytest.raises(wc.WarpcamError, match=r"antialiasing is 4 and the renderer has reflections.* 1 is allowed"):
        wc.Renderer(scene, [camera], reflections=True)
