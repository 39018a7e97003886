"""Images of nearly 2^31 pixels and more than 2^32 bytes: their last pixels are those of small images.

Small ones of the same code run everywhere; the large ones need a GPU with that much memory free.
"""

from typing import Any

import pytest
import small_scene
import torch
import warp as wp

import warpcam as wc
from warpcam.render.memory import free_bytes

PIXELS = 2**31  # fewer are allowed in one camera
SETS: dict[str, dict[str, Any]] = {
    "lit": {"outputs": ("rgb", "depth", "segmentation"), "shadows": True},
    "smooth": {"outputs": ("rgb",), "antialiasing": 4},
    "traced": {"outputs": ("normals", "distance")},
    "placed": {"outputs": ("points", "bodies")},
    "textured": {"outputs": ("rgba", "albedo")},
    "moving": {"outputs": ("depth", "flow", "flow_valid")},
    "triangles": {"outputs": ("faces", "barycentrics")},
}
MANY, HIGH = (1024, 1024), (46336, 46336)  # of many worlds' images, and one image of its own
CROP = 96  # pixels of a small image at the end of a large one


def needs(scene: wc.Scene, camera: wc.Camera, device: wp.Device) -> None:
    """Skip where a renderer and copies of some of its images have no room."""
    needed, free = wc.estimate_memory(scene, [camera]).total + 2**30, free_bytes(device)
    if not device.is_cuda or free is None or free < needed:
        free_text = "a CPU would take hours" if not device.is_cuda else f"{(free or 0) / 2**30:.0f} GiB are free"
        pytest.skip(f"needs a GPU with {needed / 2**30:.0f} GiB of memory free: {free_text}")


def world_images(scene: wc.Scene, camera: wc.Camera, worlds: list[int]) -> dict[str, torch.Tensor]:
    """Images of some worlds, on the host, after two frames: (world of the list, height, width, channels)."""
    renderer = wc.Renderer(scene, [camera])
    renderer.render()
    images = renderer.render()[camera.name]
    assert renderer.frames.min() == 2
    return {name: image[worlds].cpu() for name, image in images.items()}


@pytest.mark.parametrize("size", ["small", "large"])
@pytest.mark.parametrize("outputs", SETS)
def test_last_worlds_of_many(outputs: str, size: str, device: wp.Device) -> None:
    """World by world as a scene of few worlds has them: the first two, two in the middle and the last two."""
    width, height = MANY if size == "large" else (24, 20)
    count = (PIXELS - 1) // (width * height) if size == "large" else 9
    chosen = [0, 1, count // 2, count // 2 + 1, count - 2, count - 1]
    camera = small_scene.camera(width=width, height=height, **SETS[outputs])
    scene = small_scene.scene_of(device, count)
    if size == "large":
        needs(scene, camera, device)
    found = world_images(scene, camera, chosen)
    for place, world in enumerate(chosen):
        alone = small_scene.scene_of(device, count, worlds=range(world, world + 1))
        wanted = world_images(alone, camera, [0])
        for name, image in wanted.items():
            assert torch.equal(found[name][place], image[0]), f"{name} of world {world} of {count}"


@pytest.mark.parametrize("size", ["small", "large"])
@pytest.mark.parametrize("outputs", ["lit", "traced", "moving"])
def test_corners_of_one_image(outputs: str, size: str, device: wp.Device) -> None:
    """The first pixels and the last, as small cameras have them whose principal point is far outside."""
    width, height = HIGH if size == "large" else (320, 288)
    scene = small_scene.scene_of(device, 1)
    focal, middle = 1.2 * width, (0.5 * width, 0.5 * height)
    lens = wc.Pinhole(fx=focal, cx=middle[0], cy=middle[1])
    camera = small_scene.camera(width=width, height=height, lens=lens, **SETS[outputs])
    if size == "large":
        needs(scene, camera, device)
    renderer = wc.Renderer(scene, [camera])
    renderer.render()
    images = renderer.render()["top"]
    for column, row in ((0, 0), (width - CROP, height - CROP)):
        seen = {name: image[0, row : row + CROP, column : column + CROP].cpu() for name, image in images.items()}
        part = wc.Pinhole(fx=focal, cx=middle[0] - column, cy=middle[1] - row)
        small = small_scene.camera(width=CROP, height=CROP, lens=part, **SETS[outputs])
        for name, image in world_images(scene, small, [0]).items():
            step = 2.0 if name == "rgb" else 2e-3
            differs = ((seen[name].double() - image[0].double()).abs() > step).any(dim=-1)
            assert differs.double().mean() < 0.02, f"{name} from column {column} on"
            assert torch.isfinite(seen[name]).all()


def test_one_pixel_more_is_refused(device: wp.Device) -> None:
    scene = small_scene.scene_of(device, 2)
    with pytest.raises(wc.WarpcamError, match=r"2 worlds of 32768 x 32768 pixels are 2\^31 pixels or more"):
        wc.Renderer(scene, [small_scene.camera(width=2**15, height=2**15, outputs=("depth",))])
