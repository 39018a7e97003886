"""Denoising by Open Image Denoise: less noise, the same light, arguments, and the command line."""

import re
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import judged_scenes as judged
import numpy as np
import pytest
import torch
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.core.color import linear_to_srgb, srgb_to_linear
from warpcam.render import denoise as module
from warpcam.sources.mujoco import batch_file
from warpcam.tools import cli

pytest.importorskip("pxr.Usd")
from judged_stages import CAMERA, judged_pixels, scene_of
from pbr_scenes import FOVY, add_ball, add_sun
from pxr import Usd, UsdLux
from usd_stages import add_material, add_square, bind

SIZE = 48
needs_library = pytest.mark.skipif(find_spec("pyoidn") is None, reason="pip install 'warpcam[denoise]'")


@pytest.fixture
def room(stage: Usd.Stage) -> Usd.Stage:
    """A rough ball before a wall, in a wide sun under a grey sky."""
    add_ball(stage, diffuseColor=(0.8, 0.4, 0.1), roughness=0.4)
    add_material(stage, "/Looks/wall", diffuseColor=(0.3, 0.5, 0.7))
    bind(add_square(stage, "/wall", -5.0, 4.0), stage, "/Looks/wall")
    add_sun(stage, (0.5, 0.3, 1.0), angle=20.0)
    UsdLux.DomeLight.Define(stage, "/sky").CreateIntensityAttr(0.4)
    return stage


def traced(scene: wc.Scene, samples: int, seed: Any) -> dict[str, torch.Tensor]:
    camera = wc.Camera(
        "c", width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=FOVY), position=(0.0, 0.0, 0.0),
        outputs=("hdr", "albedo", "normals"),
    )  # fmt: skip
    options = wc.PathOptions(samples=samples, seed=seed)
    return wc.Renderer(scene, [camera], look="path", path=options).render()["c"]


def relative_error(image: torch.Tensor, wanted: np.ndarray, chosen: np.ndarray) -> float:
    errors = image[0].cpu().numpy()[chosen] - wanted[chosen]
    return float(np.sqrt((errors**2).mean()) / wanted[chosen].mean())


@needs_library
def test_errors_fall_to_less_than_half(stage: Usd.Stage, device: wp.Device) -> None:
    """Of 16 paths a pixel beside Mitsuba's image of a room; light is neither added nor lost; the input stays."""
    name = "boxes and a ball in a room"
    wanted = np.load(Path(__file__).parent / "references" / judged.file_name(name)).astype(np.float64)
    camera = replace(CAMERA, outputs=(*CAMERA.outputs, "albedo", "normals"))
    options = wc.PathOptions(samples=16, seed=2)
    scene = scene_of(stage, judged.SCENES[name], device)
    noisy = wc.Renderer(scene, [camera], look="path", path=options).render()["c"]
    chosen = judged_pixels({output: image[0].cpu().numpy() for output, image in noisy.items()})
    before = noisy["hdr"].clone()
    for names in ((), ("albedo",), ("albedo", "normals")):
        seen = wc.denoise(noisy["hdr"], **{output: noisy[output] for output in names})
        assert (seen.shape, seen.dtype, seen.device) == (before.shape, torch.float32, before.device)
        assert torch.equal(noisy["hdr"], before)
        assert relative_error(seen, wanted, chosen) < 0.5 * relative_error(before, wanted, chosen)
        assert float(seen.mean() / before.mean()) == pytest.approx(1.0, abs=0.02)


@needs_library
def test_worlds_are_each_their_own(room: Usd.Stage, device: wp.Device) -> None:
    noisy = traced(wc.from_usd(room, num_worlds=2, device=device, exposure=0.0), 4, seed=(2, 3))
    both = wc.denoise(noisy["hdr"], albedo=noisy["albedo"], normals=noisy["normals"])
    for world in range(2):
        one = {name: image[world : world + 1] for name, image in noisy.items()}
        alone = wc.denoise(one["hdr"], albedo=one["albedo"], normals=one["normals"])
        torch.testing.assert_close(alone[0], both[world])


@needs_library
def test_bytes_are_display_values(device: wp.Device) -> None:
    """Base colours as bytes are those as floats, decoded; colours of a board of squares tell apart what light hides."""
    squares = np.indices((SIZE, SIZE)).sum(axis=0) // 8 % 2
    shown = torch.from_numpy(np.repeat(np.where(squares, 200, 60)[None, ..., None], 3, axis=-1).astype(np.uint8))
    light = torch.from_numpy(np.random.default_rng(0).exponential(size=(1, SIZE, SIZE, 3)).astype(np.float32))
    linear = torch.from_numpy(srgb_to_linear(shown.numpy() / 255.0).astype(np.float32))
    there = wp.device_to_torch(device)
    by_bytes = wc.denoise(light.to(there), albedo=shown.to(there))
    torch.testing.assert_close(by_bytes, wc.denoise(light.to(there), albedo=linear.to(there)))
    assert float((by_bytes - wc.denoise(light.to(there))).abs().max()) > 0.02


LIGHT = torch.zeros((1, 4, 5, 3))
REFUSED: list[tuple[Any, dict[str, Any], str]] = [
    (np.zeros((1, 4, 5, 3), np.float32), {}, "hdr must be a torch tensor, (world, height, width, 3) torch.float32, on"),
    (LIGHT[0], {}, "hdr must be a torch tensor, .* got (4, 5, 3) torch.float32 on cpu"),
    (LIGHT[..., :2], {}, "hdr must be a torch tensor, .* got (1, 4, 5, 2) torch.float32 on cpu"),
    (LIGHT[:0], {}, "hdr must be a torch tensor, .* got (0, 4, 5, 3) torch.float32 on cpu"),
    (LIGHT.double(), {}, "hdr must be a torch tensor, .* got (1, 4, 5, 3) torch.float64 on cpu"),
    (LIGHT.to("meta"), {}, "hdr must be a torch tensor, .* got (1, 4, 5, 3) torch.float32 on meta"),
    (
        LIGHT,
        {"albedo": LIGHT.half()},
        "albedo must be a torch tensor, .* torch.uint8 or torch.float32, .* torch.float16",
    ),
    (LIGHT, {"albedo": LIGHT[:, :3]}, "albedo must have the shape and device of hdr, (1, 4, 5, 3) .* got (1, 3, 5, 3)"),
    (LIGHT, {"albedo": LIGHT, "normals": LIGHT.byte()}, "normals must be a torch tensor, .* torch.uint8 on cpu"),
    (LIGHT, {"normals": LIGHT}, "normals came without albedo; give both, albedo alone, or neither"),
]


@pytest.mark.parametrize(("hdr", "more", "told"), REFUSED)
def test_what_is_no_image_is_refused(hdr: Any, more: dict[str, Any], told: str) -> None:
    with pytest.raises(wc.WarpcamError, match="denoise: " + re.escape(told).replace(r"\.\*", ".*").replace(r"\ ", " ")):
        wc.denoise(hdr, **more)


@pytest.mark.parametrize(("error", "told"), [
    (ModuleNotFoundError("no", name="pyoidn"), "pyoidn is not installed, and denoise needs it: pip install"),
    (OSError("libtbb.so: not found"), "Open Image Denoise cannot be loaded: libtbb.so: not found"),
])  # fmt: skip
def test_a_library_that_is_not_there(
    error: Exception, told: str, room: Usd.Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """Is told in one line, on the command line before paths are traced."""

    def missing(name: str) -> None:
        raise error

    monkeypatch.setattr(module, "import_module", missing)
    with pytest.raises(wc.WarpcamError, match=told):
        wc.denoise(LIGHT)
    room.GetRootLayer().Export(str(tmp_path / "room.usda"))
    assert cli.main(["render", str(tmp_path / "room.usda"), "--device", "cpu", "--look", "path", "--denoise"]) == 2
    assert told in capsys.readouterr().err


def test_the_command_line_refuses(capsys: pytest.CaptureFixture[str]) -> None:
    for more, told in (
        ((), "--denoise: it is of --look path alone"),
        (("--look", "path", "--outputs", "depth"), "--denoise: --outputs must have one of rgb, rgba, hdr, got depth"),
        (("--look", "path", "--tone-mapping", "agx"), "--denoise: --tone-mapping agx came, denoised light is shown by"),
    ):
        assert cli.main(["render", "--device", "cpu", "--denoise", *more]) == 2
        assert told in capsys.readouterr().err


@needs_library
def test_the_command_line_denoises(room: Usd.Stage, tmp_path: Path) -> None:
    """Its pictures are those of denoised light."""
    room.GetRootLayer().Export(str(tmp_path / "room.usda"))
    how = ("--device", "cpu", "--worlds", "1", "--size", "32x24", "--look", "path", "--samples", "4")
    out = ("--denoise", "--outputs", "rgb,rgba", "--out", str(tmp_path))
    assert cli.main(["render", str(tmp_path / "room.usda"), *how, *out]) == 0
    scene = wc.from_usd(tmp_path / "room.usda", device="cpu")
    lower, upper = scene.bounds()
    pose = batch_file.free_camera(None, lower, upper, 32 / 24)
    outputs = ("hdr", "albedo", "normals")
    camera = wc.Camera("free", width=32, height=24, outputs=outputs, shadows=True, **pose)
    images = wc.Renderer(scene, [camera], look="path", path=wc.PathOptions(samples=4)).render()["free"]
    light = wc.denoise(images["hdr"], albedo=images["albedo"], normals=images["normals"])[0].numpy()
    picture = np.asarray(Image.open(tmp_path / "free-rgb.png"))
    np.testing.assert_array_equal(picture, np.rint(255.0 * linear_to_srgb(light)))
    assert (picture != np.rint(255.0 * linear_to_srgb(images["hdr"][0].numpy()))).any()
    assert (tmp_path / "free-rgba.png").exists()
