"""Frames of the path tracer: seeds, samples that are added, worlds that are left alone, outputs and errors."""

import gc
import re
from typing import Any

import numpy as np
import pytest
import warp as wp
from allocation_ledger import Ledger
from path_scenes import blocks, traced

import warpcam as wc
from warpcam.core.color import linear_to_srgb

pytest.importorskip("pxr.Usd")
from pbr_scenes import FOVY, add_ball, add_sun
from pxr import Usd, UsdLux

OUTPUTS = ("hdr", "rgb", "rgba", "depth")


def camera(size: int = 16, **more: Any) -> wc.Camera:
    own = {"lens": wc.Pinhole(fovy=FOVY), "position": (0.0, 0.0, 0.0), "outputs": OUTPUTS, **more}
    return wc.Camera("c", width=size, height=size, **own)


@pytest.fixture
def worlds(stage: Usd.Stage, device: wp.Device) -> wc.Scene:
    """Three worlds of a rough ball in the sun, under a grey sky."""
    add_ball(stage, diffuseColor=(0.8, 0.4, 0.1), roughness=0.4)
    add_sun(stage, (0.5, 0.3, 1.0), angle=2.0)
    UsdLux.DomeLight.Define(stage, "/sky").CreateIntensityAttr(0.2)
    return wc.from_usd(stage, num_worlds=3, device=device, exposure=0.0)


def drawn(renderer: wc.Renderer, **how: Any) -> np.ndarray:
    return renderer.render(**how)["c"]["hdr"].cpu().numpy().copy()


def test_a_seed_gives_the_same_bits(worlds: wc.Scene) -> None:
    """To any world, in any frame; another one gives others."""
    renderer = wc.Renderer(worlds, [camera()], look="path", path=wc.PathOptions(samples=4, seed=(7, 8, 7)))
    first, again = drawn(renderer), drawn(renderer)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[0], first[2])
    assert (first[0] != first[1]).any()


def test_added_paths_go_on_where_the_frame_ended(worlds: wc.Scene) -> None:
    few = wc.Renderer(worlds, [camera()], look="path", path=wc.PathOptions(samples=8))
    many = wc.Renderer(worlds, [camera()], look="path", path=wc.PathOptions(samples=32))
    begun, wanted = drawn(few), drawn(many)
    few.accumulate(20)
    seen = few.accumulate(4)["c"]["hdr"].cpu().numpy()
    np.testing.assert_allclose(seen, wanted, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(drawn(few), begun)  # a new frame forgets them
    np.testing.assert_allclose(few.accumulate(24)["c"]["rgba"].cpu().numpy(), many.images["c"]["rgba"].cpu(), atol=1)


def test_noise_falls_with_the_root_of_the_samples(worlds: wc.Scene) -> None:
    def error(samples: int) -> float:
        options = wc.PathOptions(samples=samples, seed=1)
        seen = drawn(wc.Renderer(worlds, [camera()], look="path", path=options))[0]
        return float(np.sqrt(((seen - wanted) ** 2).mean()))

    wanted = drawn(wc.Renderer(worlds, [camera()], look="path", path=wc.PathOptions(samples=1024)))[0]
    assert error(2) / error(32) == pytest.approx(4.0, rel=0.25)


def test_other_worlds_are_left_alone(worlds: wc.Scene) -> None:
    renderer = wc.Renderer(worlds, [camera()], look="path", path=wc.PathOptions(samples=2))
    before = drawn(renderer)
    renderer.images["c"]["hdr"].fill_(-1.0)
    after = drawn(renderer, worlds=[1])
    np.testing.assert_array_equal(after[1], before[1])
    assert (after[[0, 2]] == -1.0).all()
    assert (renderer.accumulate(3)["c"]["hdr"].cpu().numpy()[[0, 2]] == -1.0).all()


def test_one_world_may_be_of_glass(worlds: wc.Scene) -> None:
    worlds.vary("material_transmission")[1] = 1.0
    images = drawn(wc.Renderer(worlds, [camera()], look="path", path=wc.PathOptions(samples=4)))
    np.testing.assert_array_equal(images[0], images[2])
    assert np.abs(images[1] - images[0]).max() > 0.05


def test_outputs(worlds: wc.Scene) -> None:
    """Colours are the light, coded; what is not lit is what it always is; alpha is how much of a pixel is covered."""
    renderer = wc.Renderer(worlds, [camera()], look="path", path=wc.PathOptions(samples=64))
    seen = {name: image[0].cpu().numpy() for name, image in renderer.render()["c"].items()}
    plain = wc.Renderer(worlds, [camera()]).render()["c"]
    np.testing.assert_array_equal(seen["depth"], plain["depth"][0].cpu())
    assert np.abs(seen["rgb"] - 255.0 * linear_to_srgb(np.clip(seen["hdr"], 0.0, 1.0))).max() <= 0.51
    np.testing.assert_array_equal(seen["rgba"][..., :3], seen["rgb"])
    hit = np.isfinite(seen["depth"][..., 0])
    covered = seen["rgba"][..., 3] / 255.0
    assert covered[0, 0] == 0.0
    assert covered[8, 8] == 1.0
    assert covered.mean() == pytest.approx(hit.mean(), abs=0.02)


ACROSS = np.meshgrid(np.linspace(-0.3, 0.3, 32), np.linspace(0.3, -0.3, 32))
LENSES = {
    "orthographic": wc.Orthographic(height=2.4),
    "fisheye": wc.Fisheye(fovy=40.0),
    "rays": wc.Rays(np.stack((*ACROSS, np.full((32, 32), -1.0)), axis=-1)),
    "rays with origins": wc.Rays(
        np.broadcast_to((0.0, 0.0, -1.0), (32, 32, 3)), origins=np.stack((*ACROSS, np.zeros((32, 32))), axis=-1)
    ),
}


@pytest.mark.parametrize("lens", LENSES)
def test_lenses(stage: Usd.Stage, lens: str, device: wp.Device) -> None:
    """Each lens sees what it sees in the real-time look, where that is exact."""
    add_ball(stage, diffuseColor=(0.8, 0.4, 0.1), ior=1.0)
    add_sun(stage, (0.5, 0.3, 1.0))
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    one = camera(32, lens=LENSES[lens], outputs=("hdr",), antialiasing=4)
    wanted = blocks(wc.Renderer(scene, [one]).render()["c"]["hdr"][0].cpu().numpy())
    seen = blocks(traced(scene, one, 16)["hdr"])
    assert wanted.max() > 0.1
    np.testing.assert_allclose(seen, wanted, atol=0.02 * wanted.max())


def test_memory_is_what_was_estimated(worlds: wc.Scene, device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    told = wc.estimate_memory(worlds, [camera()], look="path")
    renderer_of(worlds, look="path").render()  # what Warp loads once is loaded
    gc.collect()
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    ledger = Ledger(getattr(device, slot))
    monkeypatch.setattr(device, slot, ledger)
    renderer = renderer_of(worlds, look="path")
    gc.collect()
    assert ledger.held == told.total == renderer.memory.total
    renderer.render()
    renderer.accumulate(2)
    assert ledger.held == told.total


def renderer_of(scene: wc.Scene, **how: Any) -> wc.Renderer:
    return wc.Renderer(scene, [camera()], **how)


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda scene: renderer_of(scene, look="toon"), "look is 'toon'; allowed are 'mujoco', 'pbr', 'path'"),
        (lambda scene: renderer_of(scene, look=np.array(["pbr", "path"])), "look is array(['pbr', 'path']"),
        (
            lambda scene: renderer_of(scene, path=wc.PathOptions()),
            "path has options of look='path', and the look is 'pbr'",
        ),
        (lambda scene: renderer_of(scene, look="path", path=3), "path must be a PathOptions or None, got 3"),
        (lambda scene: renderer_of(scene, look="path", path=wc.PathOptions(seed=(1, 2))), "PathOptions: seed must be"),
        (lambda scene: renderer_of(scene, look="path").accumulate(4), "as render() comes first"),
        (lambda scene: renderer_of(scene, look="path").accumulate(True), "accumulate: samples must be a whole number"),
        (lambda scene: renderer_of(scene).accumulate(4), "as the look is 'pbr'"),
        (lambda scene: wc.PathOptions(samples=0), "samples must be a whole number from 1 to 1073741824, got 0"),
        (lambda scene: wc.PathOptions(bounces=-1), "bounces must be a whole number from 0 to 1073741824, got -1"),
    ],
)
def test_errors(worlds: wc.Scene, make: Any, error: str) -> None:
    with pytest.raises(wc.WarpcamError, match=re.escape(error)):
        make(worlds)
