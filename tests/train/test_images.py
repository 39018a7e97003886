"""Image operations of training: their values, their memory, and stacks of frames across resets."""

import numpy as np
import pytest
import torch
import warp as wp

from warpcam.core import torch_interop
from warpcam.errors import WarpcamError
from warpcam.train import Crop, Grey, ImageTransform, Normalize, Resize


def colors(device: wp.Device, *shape: int, seed: int = 0) -> torch.Tensor:
    """Random images (world, channel, height, width) uint8, in memory that lies as a renderer's: HWC."""
    random = torch.Generator().manual_seed(seed)
    worlds, channels, height, width = shape
    images = torch.randint(256, (worlds, height, width, channels), generator=random, dtype=torch.uint8)
    return images.to(torch_interop.device_of(device)).permute(0, 3, 1, 2)


def test_nothing_but_a_copy(device: wp.Device) -> None:
    images = colors(device, 2, 3, 5, 4)
    frames = ImageTransform().prepare(images)
    found = frames.push(images)
    assert found.dtype is torch.uint8 and found.is_contiguous() and found.device == images.device
    assert torch.equal(found, images)


def test_crop(device: wp.Device) -> None:
    images = colors(device, 2, 3, 8, 9)
    found = ImageTransform((Crop(top=1, left=2, height=5, width=4),)).prepare(images).push(images)
    assert torch.equal(found, images[:, :, 1:6, 2:6])


def test_grey_is_opencvs(device: wp.Device) -> None:
    cv2 = pytest.importorskip("cv2")
    images = colors(device, 2, 3, 6, 7)
    found = ImageTransform((Grey(),)).prepare(images).push(images).cpu().numpy()
    assert found.shape == (2, 1, 6, 7) and found.dtype == np.uint8
    for world, image in enumerate(images.permute(0, 2, 3, 1).cpu().numpy()):
        expected = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
        assert np.abs(found[world, 0].astype(int) - expected).max() <= 1


@pytest.mark.parametrize("size", [(4, 6), (5, 4), (8, 12), (3, 11)])
def test_resize_is_opencvs_area(device: wp.Device, size: tuple[int, int]) -> None:
    """Also with sizes that do not divide the image's."""
    cv2 = pytest.importorskip("cv2")
    images = colors(device, 2, 3, 8, 12).float()
    found = ImageTransform((Resize(*size),)).prepare(images).push(images).cpu().numpy()
    for world, image in enumerate(images.permute(0, 2, 3, 1).cpu().numpy()):
        expected = cv2.resize(np.ascontiguousarray(image), size[::-1], interpolation=cv2.INTER_AREA)
        np.testing.assert_allclose(found[world].transpose(1, 2, 0), expected, atol=1e-3)


def test_resized_colors_are_rounded(device: wp.Device) -> None:
    images = torch.tensor([1, 2, 2, 2], dtype=torch.uint8, device=torch_interop.device_of(device)).reshape(1, 1, 2, 2)
    assert ImageTransform((Resize(1, 1),)).prepare(images).push(images).item() == 2


def test_normalized_colors(device: wp.Device) -> None:
    images = colors(device, 2, 3, 4, 4)
    found = ImageTransform((Normalize(),)).prepare(images).push(images)
    assert found.dtype is torch.float32
    torch.testing.assert_close(found, images.float() / 255.0)


def test_normalized_depth(device: wp.Device) -> None:
    """Distances are scaled by their range; misses and what is no number are as far as can be."""
    values = torch.tensor([0.0, 0.5, 1.0, 2.5, 9.0, float("inf"), float("nan"), -float("inf")])
    depth = values.to(torch_interop.device_of(device)).reshape(1, 1, 2, 4)
    found = ImageTransform((Normalize(0.5, 2.5),)).prepare(depth).push(depth)
    torch.testing.assert_close(found.flatten().cpu(), torch.tensor([0.0, 0.0, 0.25, 1.0, 1.0, 1.0, 1.0, 0.0]))


def test_operations_work_one_after_another(device: wp.Device) -> None:
    images = colors(device, 3, 3, 10, 12)
    operations = (Crop(1, 2, 8, 8), Grey(), Resize(4, 4), Normalize())
    found = ImageTransform(operations).prepare(images).push(images)
    numbers = images[:, :, 1:9, 2:10].float()
    grey = 0.299 * numbers[:, 0] + 0.587 * numbers[:, 1] + 0.114 * numbers[:, 2]
    expected = grey.reshape(3, 1, 4, 2, 4, 2).mean((3, 5)) / 255.0
    torch.testing.assert_close(found, expected)


def test_a_stack_is_reset_world_by_world(device: wp.Device) -> None:
    """Against stacks that each world keeps by itself."""
    worlds, count = 3, 3
    first = colors(device, worlds, 1, 2, 2)
    frames = ImageTransform(stack=count).prepare(first)
    kept = [[first[world]] * count for world in range(worlds)]
    frames.restart(first)
    for step in range(8):
        images = colors(device, worlds, 1, 2, 2, seed=step + 1)
        ended = torch.tensor([step == 2, step in (2, 3), step == 6], device=first.device)
        frames.push(images)
        kept = [[*stack[1:], images[world]] for world, stack in enumerate(kept)]
        assert torch.equal(frames.now, torch.stack([torch.cat(stack) for stack in kept]))
        begun = colors(device, worlds, 1, 2, 2, seed=100 + step)
        frames.restart(begun, ended)
        kept = [[begun[world]] * count if ended[world] else stack for world, stack in enumerate(kept)]
        assert torch.equal(frames.now, torch.stack([torch.cat(stack) for stack in kept]))


@pytest.mark.parametrize("stack", [1, 2])
def test_the_last_observation_stays_while_the_next_is_made(device: wp.Device, stack: int) -> None:
    images = [colors(device, 2, 3, 4, 4, seed=seed) for seed in range(3)]
    frames = ImageTransform((Grey(), Normalize()), stack=stack).prepare(images[0])
    held = frames.restart(images[0])
    before = held.clone()
    frames.push(images[1])
    frames.restart(images[2], torch.tensor([True, False], device=before.device))
    assert torch.equal(held, before)


def test_frames_lie_in_two_places_alone(device: wp.Device) -> None:
    images = colors(device, 2, 3, 8, 8)
    frames = ImageTransform((Grey(), Resize(4, 4), Normalize()), stack=3).prepare(images)
    assert len({frames.push(images).data_ptr() for _ in range(6)}) == 2


def test_frames_that_begin_in_inference_mode_are_written_outside(device: wp.Device) -> None:
    images = colors(device, 2, 3, 8, 8)
    with torch.inference_mode():
        frames = ImageTransform((Grey(), Resize(4, 4), Normalize()), stack=2).prepare(images)
        frames.push(images)
    frames.push(images)


@pytest.mark.parametrize(
    ("operation", "message"),
    [
        (lambda: Crop(0, 0, 0, 4), "Crop: height 0 came, a whole number of at least 1 is needed"),
        (lambda: Crop(-1, 0, 2, 4), "Crop: top -1 came, a whole number of at least 0 is needed"),
        (lambda: Resize(4, 2.5), "Resize: width 2.5 came"),  # type: ignore[arg-type]
        (lambda: Normalize(2.0, 1.0), "Normalize: low 2.0 and high 1.0 came, low must be less than high"),
        (lambda: Normalize(0.0, float("nan")), "Normalize: low 0.0 and high nan came"),
        (lambda: ImageTransform(stack=0), "ImageTransform: stack 0 came"),
        (lambda: ImageTransform(("grey",)), "ImageTransform: operations must be like Crop or Grey, got 'grey'"),  # type: ignore[arg-type]
        (lambda: Crop(2, 0, 3, 4).prepare(torch.zeros(1, 1, 4, 4)), "Crop: rows 2 to 5 and columns 0 to 4 came"),
        (lambda: Grey().prepare(torch.zeros(1, 1, 4, 4)), "Grey: the image has 1 channels"),
        (lambda: ImageTransform().prepare(torch.zeros(4, 4)), r"images must be \(world, channel, height, width\)"),
        (
            lambda: ImageTransform((Normalize(),)).prepare(torch.zeros(1, 1, 4, 4)),
            "Normalize: low and high are those of uint8, the images are torch.float32: give a range",
        ),
    ],
)
def test_mistakes_are_named(operation: object, message: str) -> None:
    with pytest.raises(WarpcamError, match=message):
        operation()  # type: ignore[operator]
