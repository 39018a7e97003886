"""Cameras of eight samples and more: means of finer images, whatever the lens, the scene and the groups of worlds."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import scenes
import torch
import warp as wp
from edge_scenes import LIT

import warpcam as wc
from warpcam.kernels.plan.request import SUPERSAMPLING
from warpcam.render import scratch_memory

WIDTH, HEIGHT = 26, 18
LIGHT = '<light pos="1 1 3" dir="-0.3 -0.3 -1"/>'
THINGS = """
  <geom type="plane" size="3 3 0.1" pos="0 0 -0.6" material="checked"/>
  <geom type="capsule" size="0.02 0.4" euler="20 60 0" rgba="1 0 0 1"/>
  <geom type="box" size="0.2 0.3 0.01" pos="0.3 0.1 0.1" euler="0 50 10"/>
  <geom type="mesh" mesh="mesh" pos="-0.5 0.1 -0.2" euler="20 10 70" rgba="0 0.6 1 1"/>
"""
LAYERS = """
  <geom type="plane" size="9 9 0.1" pos="0 0 -0.8" material="mirror"/>
  <geom type="sphere" size="0.2" pos="-0.3 -0.2 0.2" rgba="1 1 1 0.5"/>
"""
ASSETS = scenes.ASSETS.split("<hfield")[0] + (
    '<texture name="checks" type="2d" builtin="checker" rgb1="0.2 0.3 0.4" rgb2="0.8 0.8 0.8" width="64" height="64"/>'
    '<material name="checked" texture="checks" texrepeat="4 4"/><material name="mirror" reflectance="0.4"/>'
)
# A lens, and that of an image of so many times as many pixels across and down that has the same rays.
LENSES: dict[str, Any] = {
    "fovy": lambda across, down: wc.Pinhole(fovy=60.0),
    "intrinsics": lambda across, down: wc.Pinhole(fx=20.0 * across, fy=23.0 * down, cx=12.5 * across, cy=10.0 * down),
    "by world": lambda across, down: wc.Pinhole(
        fx=np.array([20.0, 30.0]) * across, fy=23.0 * down, cx=13.0 * across, cy=9.0 * down
    ),
    "orthographic": lambda across, down: wc.Orthographic(height=2.0),
    "fisheye": lambda across, down: wc.Fisheye(fx=10.0 * across, fy=10.0 * down, cx=12.0 * across, cy=10.0 * down),
}


def scene_of(device: wp.Device, num_worlds: int = 1, more: str = "") -> wc.Scene:
    mjm = scenes.compile_xml(LIGHT + THINGS + more, assets=ASSETS)
    with wp.ScopedDevice(device):
        return wc.from_mujoco_warp(mjm, *scenes.put(mjm, num_worlds))


def camera(samples: int, across: int = 1, down: int = 1, lens: Any = None, **changes: Any) -> wc.Camera:
    settings = {"outputs": ("rgb",), "position": (0.0, -1.5, 1.0), "rotation": scenes.looking((0, -1.5, 1), (0, 0, 0))}
    settings |= {"lens": lens or wc.Pinhole(fovy=60.0), "shadows": True}
    return scenes.own_camera(
        width=across * WIDTH, height=down * HEIGHT, antialiasing=samples, **{**settings, **changes}
    )


def means(image: torch.Tensor, across: int, down: int) -> np.ndarray:
    """Means of so many pixels of an image, (world, height, width, channels) float64."""
    fine = image.cpu().numpy().astype(np.float64)
    worlds, height, width, channels = fine.shape
    parts = fine.reshape(worlds, height // down, down, width // across, across, channels).mean(axis=(2, 4))
    return np.floor(parts + 0.5) if image.dtype == torch.uint8 else parts


def look(scene: wc.Scene, one: wc.Camera) -> Mapping[str, torch.Tensor]:
    return wc.Renderer(scene, [one]).render()["eye"]


@pytest.mark.parametrize(
    ("samples", "lens"), [(8, "intrinsics"), (8, "by world"), (64, "fovy"), *((16, lens) for lens in LENSES)]
)
def test_pixels_are_means_of_a_finer_image(samples: int, lens: str, device: wp.Device) -> None:
    across, down = SUPERSAMPLING[samples]
    scene = scene_of(device, 2)
    shown = look(scene, camera(samples, lens=LENSES[lens](1, 1)))["rgb"]
    fine = look(scene, camera(4, across, down, lens=LENSES[lens](across, down)))["rgb"]
    assert len(np.unique(shown.cpu().numpy())) > 20
    np.testing.assert_array_equal(shown.cpu().numpy(), means(fine, across, down))


@pytest.mark.parametrize("more", ["", LAYERS], ids=["plain", "layers"])
def test_all_lit_outputs_are_means_and_no_other_output_changes(more: str, device: wp.Device) -> None:
    scene = scene_of(device, 2, more)
    outputs = ("rgb", "rgba", "hdr", "depth", "segmentation", "normals", "albedo", "flow")
    shown = look(scene, camera(16, outputs=outputs))
    fine = look(scene, camera(4, 2, 2, outputs=("rgb", "rgba", "hdr")))
    sharp = look(scene, camera(1, outputs=outputs))
    for name in outputs:
        if name in fine:
            np.testing.assert_allclose(shown[name].cpu().numpy(), means(fine[name], 2, 2), rtol=1e-6)
        else:
            assert torch.equal(shown[name], sharp[name]), name


def test_the_lens_of_a_scenes_own_camera_is_kept(device: wp.Device) -> None:
    sensor = 'resolution="26 18" sensorsize="0.026 0.018" focal="0.02 0.022" principal="0.001 -0.002"'
    for lens in ('fovy="50"', 'fovy="1.5" projection="orthographic"', sensor):
        mjm = scenes.compile_xml(LIGHT + THINGS + f'<camera name="eye" pos="0 0 2" {lens}/>', assets=ASSETS)
        scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
        kept = {"outputs": ("rgb",), "shadows": True}
        shown = look(scene, wc.Camera("eye", width=WIDTH, height=HEIGHT, antialiasing=16, **kept))["rgb"]
        fine = look(scene, wc.Camera("eye", width=2 * WIDTH, height=2 * HEIGHT, antialiasing=4, **kept))["rgb"]
        np.testing.assert_array_equal(shown.cpu().numpy(), means(fine, 2, 2))


def test_groups_of_worlds_and_chosen_worlds(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(device, 7)
    asked = camera(16, outputs=("rgb", "depth"))
    whole = wc.Renderer(scene, [asked])
    expected = {name: image.clone() for name, image in whole.render()["eye"].items()}
    monkeypatch.setattr(scratch_memory, "ALWAYS_ALLOWED", WIDTH * HEIGHT * 60)
    grouped = wc.Renderer(scene, [asked])
    assert grouped.memory.scratch < whole.memory.scratch / 2
    for name, image in grouped.render()["eye"].items():
        assert torch.equal(image, expected[name]), name
        image.fill_(7)
    for name, image in grouped.render(worlds=[1, 6])["eye"].items():
        assert (image[[0, 2, 3, 4, 5]] == 7).all()
        assert torch.equal(image[[1, 6]], expected[name][[1, 6]]), name


@pytest.mark.parametrize(("thick", "too_few", "enough"), [(0.5, 4, 16), (0.3, 16, 64)])
def test_what_is_as_thick_as_a_part_of_a_pixel_has_no_gaps(
    thick: float, too_few: int, enough: int, device: wp.Device
) -> None:
    """A white rod, so many pixels thick, aslant on black: how much light comes to each column of pixels."""
    size, turn = 32, 4.0
    half = thick * np.tan(30.0 * scenes.DEGREE) * 2.0 / size  # of a pixel on the rod, times the thickness [m]
    mjm = scenes.compile_xml(f'<geom type="box" size="3 {half} {half}" euler="0 0 {turn}" rgba="1 1 1 1"/>', more=LIT)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    missed = {}
    for samples in (too_few, enough):
        asked = scenes.own_camera(outputs=("hdr",), position=(0.0, 0.0, 2.0), antialiasing=samples)
        columns = look(scene, asked)["hdr"][0, ..., 0].cpu().numpy().sum(axis=0)
        missed[samples] = float(np.abs(columns - thick / np.cos(turn * scenes.DEGREE)).mean())
    assert missed[enough] < 0.1 * thick and missed[too_few] > 0.3 * thick, missed


def test_set_lens_reaches_the_finer_image(device: wp.Device) -> None:
    scene = scene_of(device)
    renderer = wc.Renderer(scene, [camera(16, lens=wc.Fisheye(fovy=100.0))])
    renderer.render()
    renderer.set_lens("eye", wc.Fisheye(fovy=160.0))
    expected = look(scene, camera(16, lens=wc.Fisheye(fovy=160.0)))["rgb"]
    assert torch.equal(renderer.render()["eye"]["rgb"], expected)
    rays = wc.Rays(np.broadcast_to(np.array([0.0, 0.0, -1.0]), (HEIGHT, WIDTH, 3)))
    with pytest.raises(wc.WarpcamError, match=r"Rays, which has a ray for each pixel, and antialiasing=16 needs rays"):
        renderer.set_lens("eye", rays)
    with pytest.raises(wc.WarpcamError, match=r"antialiasing is 8; allowed are 1, 4 with Rays, which has a ray for"):
        camera(8, lens=rays)


def test_numbers_that_are_no_choice_and_images_that_are_too_large(device: wp.Device) -> None:
    for samples in (2, 16.0, True, "16"):
        with pytest.raises(wc.WarpcamError, match=r"antialiasing is .*; allowed are 1, 4, 8, 16, 64$"):
            camera(samples)  # type: ignore[arg-type]
    large = {"lens": wc.Pinhole(fovy=60.0), "position": (0.0, 0.0, 0.0)}
    with pytest.raises(wc.WarpcamError, match=r"of 30000 x 20000 pixels with antialiasing=16, of 4 parts each, are"):
        wc.Renderer(scene_of(device), [wc.Camera("eye", width=30000, height=20000, antialiasing=16, **large)])


def test_memory_is_told(device: wp.Device) -> None:
    scene = scene_of(device, 3)
    few, many = (wc.estimate_memory(scene, [camera(samples)]) for samples in (4, 16))
    assert many.images == few.images
    assert many.scratch > 3 * few.scratch
    assert many.worlds - few.worlds >= 3 * 76  # views of the finer image
    table = {samples: wc.Fisheye(fovy=90.0).bytes(*size, 1) for samples, size in ((4, (26, 18)), (16, (52, 36)))}
    few, many = (wc.estimate_memory(scene, [camera(n, lens=wc.Fisheye(fovy=90.0))]) for n in (4, 16))
    assert many.worlds - few.worlds == 3 * 76 + table[16]
    assert "finer image: trace" in str(wc.Renderer(scene, [camera(16)]).plan["eye"])


@pytest.mark.parametrize("outputs", [("depth",), ("segmentation", "normals")])
def test_without_lit_outputs_nothing_finer_is_drawn(outputs: tuple[str, ...], device: wp.Device) -> None:
    scene = scene_of(device)
    plan = wc.Renderer(scene, [camera(16, outputs=outputs)]).plan["eye"]
    assert plan.fine is None
    assert plan == wc.Renderer(scene, [camera(1, outputs=outputs)]).plan["eye"]
