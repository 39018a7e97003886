"""A rig: chains of effects, random numbers, masks, parameters and errors."""

import copy
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors
from warpcam.core.color import linear_to_srgb, srgb_to_linear
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.kernels.random import Randomness, element_state

OUTPUTS = ("depth", "rgb", "hdr")


@wp.kernel(enable_backward=False)
def add_noise(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    scale: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] != wp.uint8(0):
        target[world, pixel] = source[world, pixel] + scale[world] * wp.randn(element_state(randomness, world, pixel))


@wp.kernel(enable_backward=False)
def shift(
    mask: wp.array(dtype=wp.uint8),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] != wp.uint8(0):
        target[world, pixel] = source[world, wp.max(pixel - 1, 0)]


@wp.kernel(enable_backward=False)
def scale_light(
    mask: wp.array(dtype=wp.uint8),
    factor: wp.array2d(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] != wp.uint8(0):
        row = wp.vec3(factor[world, 0], factor[world, 1], factor[world, 2])
        target[world, pixel] = wp.cw_mul(row, source[world, pixel])


@wp.kernel(enable_backward=False)
def add_up(
    mask: wp.array(dtype=wp.uint8),
    source: wp.array2d(dtype=wp.float32),
    sums: wp.array(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    if pixel == 0:
        sums[world] = sums[world] + 1.0
    target[world, pixel] = source[world, pixel]


@dataclass(frozen=True, eq=False)
class Noise(sensors.Effect):
    scale: Any = sensors.parameter(0.1, low=0.0, high=2.0)
    kind = "depth"

    def bind(self, frame: sensors.EffectFrame) -> Sequence[Stage]:
        inputs = [frame.mask, frame.randomness, frame.params.scale, frame.source, frame.target]
        return [frame.per_pixel(add_noise, inputs)]


@dataclass(frozen=True, eq=False)
class Shift(sensors.Effect):
    kind, in_place = "depth", False

    def bind(self, frame: sensors.EffectFrame) -> Sequence[Stage]:
        assert frame.source.ptr != frame.target.ptr
        return [frame.per_pixel(shift, [frame.mask, frame.source, frame.target])]


@dataclass(frozen=True, eq=False)
class Count(sensors.Effect):
    kind = "depth"

    def bind(self, frame: sensors.EffectFrame) -> Sequence[Stage]:
        return [frame.per_pixel(add_up, [frame.mask, frame.source, frame.keep("sums", ()), frame.target])]


@dataclass(frozen=True, eq=False)
class Gains(sensors.Effect):
    factor: Any = sensors.parameter((1.0, 1.0, 1.0), low=0.0, width=(3,))
    kind = "linear"

    def bind(self, frame: sensors.EffectFrame) -> Sequence[Stage]:
        return [frame.per_pixel(scale_light, [frame.mask, frame.params.factor, frame.source, frame.target])]


@dataclass(frozen=True, eq=False)
class Tint(Gains):
    kind = "display"


def rig_of(device: wp.Device, *effects: Any, num_worlds: int = 3, seed: Any = 0, **options: Any) -> sensors.Rig:
    options = {"outputs": OUTPUTS, **options}
    renderer = wc.Renderer(scene_of(device, num_worlds), [camera(**options)])
    return sensors.Rig(renderer, {"top": effects}, seed=seed)


def depth_of(rig: sensors.Rig, **options: Any) -> np.ndarray:
    return rig.read(**options)["top"]["depth"].cpu().numpy().copy()


def noise_of(rig: sensors.Rig) -> np.ndarray:
    """Measured depth without the truth, NaN where nothing is hit."""
    truth = rig.renderer.images["top"]["depth"].cpu().numpy()
    return np.subtract(rig.images["top"]["depth"].cpu().numpy(), np.where(np.isfinite(truth), truth, np.nan))


def test_effects_are_composed_in_their_order(device: wp.Device) -> None:
    for effects in ((Shift(),), (Shift(), Shift()), (Shift(), Count(), Shift(), Count()), (Count(), Shift())):
        rig = rig_of(device, *effects)
        measured = depth_of(rig).reshape(3, -1)
        truth = rig.renderer.images["top"]["depth"].cpu().numpy().reshape(3, -1)
        shifts = sum(isinstance(effect, Shift) for effect in effects)
        assert (measured[:, shifts:] == truth[:, :-shifts]).all()
        assert rig.images["top"]["rgb"].data_ptr() == rig.renderer.images["top"]["rgb"].data_ptr()


def test_noise_follows_seed_world_and_frame_alone(device: wp.Device) -> None:
    few, many, other = rig_of(device, Noise()), rig_of(device, Noise(), num_worlds=5), rig_of(device, Noise(), seed=1)
    first, second = depth_of(few), depth_of(few)
    again = depth_of(many)[:3], depth_of(many)[:3]
    truths = [rig.renderer.images["top"]["depth"].cpu().numpy()[:3] for rig in (few, many)]
    same = truths[0] == truths[1]  # the ball of a world is elsewhere where there are more worlds
    assert same.mean() > 0.8 and (first == again[0])[same].all() and (second == again[1])[same].all()
    assert not (first == second).any(where=np.isfinite(first))
    assert not (first == depth_of(other)).any(where=np.isfinite(first))
    assert few.frames.tolist() == [2, 2, 2]
    noise = noise_of(few)
    seen = np.isfinite(noise)
    assert abs(noise[seen].std() - 0.1) < 0.01 and abs(noise[seen].mean()) < 0.01
    correlation = np.corrcoef(noise[0][seen[0] & seen[1]], noise[1][seen[0] & seen[1]])[0, 1]
    assert abs(correlation) < 0.15


def test_noise_of_worlds_with_the_same_seed(device: wp.Device) -> None:
    renderer = wc.Renderer(scene_of(device, 3), [camera(outputs=("depth",))])
    rig = sensors.Rig(renderer, {"top": [Noise()]}, seed=[4, 7, 4], by_world=False)
    rig.read()
    first, second, third = noise_of(rig)
    both = np.isfinite([first, second, third]).all(axis=0)
    np.testing.assert_allclose(first[both], third[both], atol=1e-5)  # of noise on other depths
    assert np.abs(first - second)[both].max() > 0.1
    rig.seeds.copy_(rig.seeds.roll(1))
    rig.frames.zero_()
    rig.read()
    np.testing.assert_allclose(noise_of(rig)[2][both], second[both], atol=1e-5)
    with pytest.raises(wc.WarpcamError, match="Rig: by_world must be True or False, got 0"):
        sensors.Rig(renderer, {"top": [Noise()]}, by_world=0)


def test_each_effect_of_a_chain_has_its_own_random_numbers(device: wp.Device) -> None:
    rig = rig_of(device, Noise(0.1), Noise(0.1))
    rig.read()
    noise = noise_of(rig)
    assert abs(noise[np.isfinite(noise)].std() - 0.1 * 2**0.5) < 0.015


def test_worlds_that_are_not_read_stay(device: wp.Device) -> None:
    rig = rig_of(device, Noise())
    before = depth_of(rig)
    after = depth_of(rig, worlds=[1])
    assert (after[[0, 2]] == before[[0, 2]]).all() and not (after[1] == before[1]).any(where=np.isfinite(before[1]))
    assert rig.frames.tolist() == [1, 2, 1]


def test_parameters_are_written_in_place_and_drawn(device: wp.Device) -> None:
    given = torch.zeros(3, device=wp.device_to_torch(device))
    rig = rig_of(device, Noise(given), Noise(np.array([0.0, 0.0, 0.0])))
    truth = rig.renderer.images["top"]["depth"]
    assert (depth_of(rig) == truth.cpu().numpy()).all()
    given[1] = 0.5
    changed = depth_of(rig) != truth.cpu().numpy()
    assert changed[1].any() and not changed[[0, 2]].any()
    given[:] = 0.0
    rig.parameters("top").noise_2_scale[2] = 0.5
    changed = depth_of(rig) != truth.cpu().numpy()
    assert changed[2].any() and not changed[:2].any()
    wc.randomize(rig.parameters("top"), noise_scale=(0.2, 0.4), seed=3)
    assert ((given >= 0.2) & (given <= 0.4)).all() and len(set(given.tolist())) == 3
    with pytest.raises(wc.WarpcamError, match="noise_scale: values must be from 0 to 2"):
        wc.randomize(rig.parameters("top"), noise_scale=(0.2, 2.4))
    with pytest.raises(wc.WarpcamError, match="has no array 'noise_size' of its own, it has noise_scale"):
        rig.parameters("top").noise_size  # noqa: B018


def test_what_an_effect_keeps_is_forgotten_at_a_reset(device: wp.Device) -> None:
    rig = rig_of(device, Count())
    for _ in range(3):
        rig.read()
    (memory,) = rig._measurements["top"]._memories.values()
    assert memory["sums"].numpy().tolist() == [3.0, 3.0, 3.0]
    rig.reset([1])
    assert memory["sums"].numpy().tolist() == [3.0, 0.0, 3.0]
    rig.reset()
    assert memory["sums"].numpy().tolist() == [0.0, 0.0, 0.0] and rig.frames.tolist() == [3, 3, 3]


CHAINS: list[tuple[sensors.Effect, ...]] = [
    (sensors.Gain(1.3),),
    (sensors.Gain(0.7), sensors.Blur(0.6), sensors.Exposure(0.5)),
    (sensors.Quantization(3.0),),
    (sensors.Gain(1.2), sensors.ToneCurve()),
    (sensors.Sharpening(0.5), sensors.Quantization(5.0)),
    (sensors.Gain(1.2), sensors.Sharpening(0.5)),
    (sensors.Blur(0.6), sensors.Sharpening(0.5)),
    (sensors.Gain(1.2), sensors.Blur(1.4)),
    (sensors.ChromaticAberration(1.1, 0.9),),
    (sensors.BayerMosaic(),),
    (sensors.JpegArtifacts(40.0),),
]


@pytest.mark.parametrize("output", ["rgb", "rgba"])
@pytest.mark.parametrize("chain", CHAINS, ids=lambda chain: "-".join(type(effect).__name__ for effect in chain))
def test_effects_read_and_write_bytes_as_light(chain: Any, output: str, device: wp.Device) -> None:
    # The same images as between effects that take numbers.
    ends = Gains() if rig_of(device, *chain)._measurements["top"]._ends_linear else Tint()
    images = []
    for effects in (chain, (Gains(), *chain, ends)):
        rig = rig_of(device, *effects, outputs=(output,))
        rig.read()
        images.append(rig.read(worlds=[0, 2])["top"][output].cpu().numpy())
    assert (images[0] == images[1]).all() and (images[0] != 0).any()
    assert (images[0][..., 3:] == rig.renderer.images["top"][output].cpu().numpy()[..., 3:]).all()


def test_one_effect_of_bytes_needs_no_image_of_numbers(device: wp.Device) -> None:
    for outputs, count in ((("rgb",), 0), (("rgb", "rgba"), 1)):
        assert len(rig_of(device, sensors.Gain(1.3), outputs=outputs)._measurements["top"]._buffers[0]) == count


@pytest.mark.parametrize("outputs", [("rgb", "rgba"), ("rgb", "rgba", "hdr")])
def test_colors_go_through_linear_light(device: wp.Device, outputs: tuple[str, ...]) -> None:
    rig = rig_of(device, Gains((0.5, 1.0, 0.0)), outputs=outputs)
    measured, truth = rig.read()["top"], rig.renderer.images["top"]
    expected = linear_to_srgb(srgb_to_linear(truth["rgb"].cpu().numpy() / 255.0) * (0.5, 1.0, 0.0))
    below_white = truth["rgb"].cpu().numpy() < 255
    assert np.abs(measured["rgb"].cpu().numpy() - 255.0 * expected)[below_white].max() <= 1.01
    assert (measured["rgb"] == measured["rgba"][..., :3]).all()
    assert (measured["rgba"][..., 3] == truth["rgba"][..., 3]).all() and not (measured["rgb"] == truth["rgb"]).all()


def test_light_above_white_is_kept_until_the_end(device: wp.Device) -> None:
    bright = camera(outputs=("rgb", "hdr"), gain=3.0)
    renderer = wc.Renderer(scene_of(device, 2), [bright])
    rig = sensors.Rig(renderer, {"top": [Gains((0.1, 0.1, 0.1))]})
    measured, truth = rig.read()["top"]["rgb"].cpu().numpy(), renderer.images["top"]["hdr"].cpu().numpy()
    assert truth.max() > 1.5
    assert np.abs(measured - 255.0 * linear_to_srgb(0.1 * srgb_to_linear(truth))).max() <= 0.51


@pytest.mark.parametrize("outputs", [("rgb",), ("rgb", "hdr")])
def test_display_effects_change_display_values(device: wp.Device, outputs: tuple[str, ...]) -> None:
    rig = rig_of(device, Tint((0.5, 1.0, 1.0)), outputs=outputs)
    measured, truth = rig.read()["top"]["rgb"].cpu().numpy(), rig.renderer.images["top"]["rgb"].cpu().numpy()
    assert np.abs(measured - truth * (0.5, 1.0, 1.0)).max() <= 1.0
    if "hdr" in outputs:
        assert rig.images["top"]["hdr"].data_ptr() == rig.renderer.images["top"]["hdr"].data_ptr()


def test_a_frame_allocates_nothing(device: wp.Device) -> None:
    rig = rig_of(device, Noise(), Shift(), Gains())
    pointers = {name: tensor.data_ptr() for name, tensor in rig.read()["top"].items()}
    rig.reset()
    assert pointers == {name: tensor.data_ptr() for name, tensor in rig.read([0])["top"].items()}


def test_a_rig_may_be_captured(device: wp.Device) -> None:
    rig, other = rig_of(device, Noise()), rig_of(device, Noise())
    rig.read()
    with wp.ScopedCapture(device) as capture:
        rig.read()
    expected = [depth_of(other) for _ in range(4)]
    wp.capture_launch(capture.graph)
    counted = rig.frames.tolist()[0]
    assert (rig.images["top"]["depth"].cpu().numpy() == expected[counted - 1]).all()


@pytest.mark.parametrize(
    ("effects", "options", "message"),
    [
        ((Noise(-1.0),), {}, "'top': Noise: scale must be from 0 to 2, got -1"),
        ((Noise(float("nan")),), {}, "Noise: scale must be finite"),
        ((Noise([0.1, 0.2]),), {}, r"Noise: scale must have shape a number or \(3,\), got \(2,\)"),
        ((Gains((1.0, 2.0)),), {}, "Gains: factor must have shape"),
        ((Noise(),), {"outputs": ("rgb",)}, "Noise needs 'depth' among the camera's outputs, which are 'rgb'"),
        ((Gains(),), {"outputs": ("depth",)}, "Gains needs 'rgb' among the camera's outputs"),
        ((Tint(), Gains()), {}, "Gains changes linear light and must come before Tint"),
        (("noise",), {}, "effects of warpcam.sensors are allowed, got 'noise'"),
        ((Noise(),), {"seed": 0.5}, "seed must be a whole number of 32 bits"),
        ((Noise(),), {"seed": 2**40}, "seed must be a whole number of 32 bits"),
        ((Noise(),), {"seed": [1, [2, 3]]}, "seed must be a whole number of 32 bits"),
        ((Noise(),), {"seed": torch.zeros(3, dtype=torch.int32, device="meta")}, "seed must be a whole number of"),
    ],
)
def test_bad_input_is_refused(effects: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        rig_of(wp.get_device("cpu"), *effects, **options)


def test_unknown_cameras_are_refused() -> None:
    renderer = wc.Renderer(scene_of("cpu", 1), [camera(outputs=("depth",))])
    with pytest.raises(wc.WarpcamError, match="camera 'front' came, the renderer draws 'top'"):
        sensors.Rig(renderer, {"front": [Noise()]})
    with pytest.raises(wc.WarpcamError, match="sensors must be a dict of effects by camera"):
        sensors.Rig(renderer, {})
    with pytest.raises(wc.WarpcamError, match=r"renderer must be a warpcam\.Renderer"):
        sensors.Rig(None, {"top": [Noise()]})
    with pytest.raises(wc.WarpcamError, match="camera 'front' came, it measures 'top'"):
        sensors.Rig(renderer, {"top": [Noise()]}).parameters("front")


@pytest.mark.parametrize("effects", [Noise(), None, 3, "noise"])
def test_effects_that_are_no_list_are_refused(effects: Any) -> None:
    renderer = wc.Renderer(scene_of("cpu", 1), [camera(outputs=("depth",))])
    with pytest.raises(wc.WarpcamError, match="Rig: 'top': effects must be a list of effects, got"):
        sensors.Rig(renderer, {"top": effects})


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_rig_is_not_copied(copied: Any) -> None:
    with pytest.raises(wc.WarpcamError, match="Rig: it cannot be copied or pickled"):
        copied(rig_of(wp.get_device("cpu"), Noise()))


class Plain(sensors.Effect):
    kind = "depth"


@dataclass(frozen=True, eq=False)
class Kindless(sensors.Effect):
    pass


@dataclass(frozen=True, eq=False)
class Colorful(sensors.Effect):
    kind = "colors"  # type: ignore[assignment]


@dataclass(frozen=True, eq=False)
class Keeping(sensors.Effect):
    dtype: Any = wp.float32
    kind = "depth"

    def bind(self, frame: sensors.EffectFrame) -> Sequence[Stage]:
        frame.keep("memory", (3,), self.dtype).fill_(7)
        return []


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (Plain(), "'top': Plain must be a dataclass"),
        (Kindless(), "'top': Kindless: kind must be one of 'depth', .* got None"),
        (Colorful(), "'top': Colorful: kind must be one of 'depth', .* got 'colors'"),
        (Keeping(wp.uint8), "keep: dtype of 'memory' must have 4 bytes or a multiple"),
        (Keeping(wp.float16), "keep: dtype of 'memory' must have 4 bytes or a multiple"),
    ],
)
def test_effects_of_ones_own_that_cannot_be_are_refused(effect: sensors.Effect, message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        rig_of(wp.get_device("cpu"), effect)


@pytest.mark.parametrize("dtype", [wp.float32, wp.int64, wp.float64, wp.vec3, wp.mat33d])
def test_memory_of_any_wide_dtype_is_forgotten(device: wp.Device, dtype: Any) -> None:
    rig = rig_of(device, Keeping(dtype))
    (memory,) = (arrays["memory"] for arrays in rig._measurements["top"]._memories.values())
    rig.reset([1])
    assert (memory.numpy()[1] == 0).all() and (memory.numpy()[[0, 2]] == 7).all()
