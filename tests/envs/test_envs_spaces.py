"""Images as observations of Gymnasium's vector envs: in which arrays, layouts and spaces, and under its own tools."""

from typing import Any

import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc

gymnasium = pytest.importorskip("gymnasium", reason="pip install 'warpcam[gymnasium]'")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402
from gymnasium.wrappers import FrameStackObservation  # noqa: E402
from gymnasium.wrappers.vector import FlattenObservation, RecordEpisodeStatistics  # noqa: E402
from slider_env import HEIGHT, LONGEST, WIDTH, Sliders, assert_same, pixels, renderer_of  # noqa: E402

from warpcam.envs import OneWorld, PixelObservation  # noqa: E402
from warpcam.outputs import OUTPUTS  # noqa: E402


def test_tensors_are_the_renderers_own_memory(device: wp.Device) -> None:
    own = Sliders(3, AutoresetMode.NEXT_STEP, device, tensors=True)
    renderer = renderer_of(own)
    env = PixelObservation(own, renderer, arrays="torch", copy=False, forward=True, layout="CHW")
    for _ in range(3):
        observations = env.reset(seed=2)[0]
        observations, rewards, terminations, truncations, _ = env.step(torch.zeros(3, 1))
        for output in ("rgb", "depth"):
            image = observations[f"top_{output}"]
            assert image.data_ptr() == renderer.array("top", output).ptr
            assert image.shape == (3, 3 if output == "rgb" else 1, HEIGHT, WIDTH)
        for values in (observations["state"], rewards, terminations, truncations):
            assert isinstance(values, torch.Tensor)
            assert values.device == renderer.faulty.device


def test_arrays_on_the_cpu_are_the_renderers_own_memory() -> None:
    own = Sliders(2, AutoresetMode.NEXT_STEP)
    renderer = renderer_of(own)
    env = PixelObservation(own, renderer, copy=False, forward=True)
    images = [env.reset(seed=seed)[0]["top_rgb"] for seed in (1, 2)]
    assert [image.ctypes.data for image in images] == [renderer.array("top", "rgb").ptr] * 2


@pytest.mark.parametrize("arrays", ["numpy", "torch"])
def test_copies_stay_as_they_are(arrays: str, device: wp.Device) -> None:
    env = pixels(2, AutoresetMode.NEXT_STEP, arrays=arrays, layout="CHW")
    first = env.reset(seed=1)[0]["top_rgb"]
    kept = first.copy() if arrays == "numpy" else first.clone()
    second = env.reset(seed=2)[0]["top_rgb"]
    assert (first == kept).all()
    assert (first != second).any()
    assert first.flags.c_contiguous if arrays == "numpy" else first.is_contiguous()


@pytest.mark.parametrize("tensors", [True, False], ids=["env of tensors", "env of numpy"])
def test_tensors_and_numpy_tell_the_same(tensors: bool, device: wp.Device) -> None:
    """Last observations of tensors are those of all worlds, and a mask."""
    one = pixels(3, AutoresetMode.SAME_STEP)
    other = pixels(3, AutoresetMode.SAME_STEP, tensors=tensors, arrays="torch")
    random, ends = np.random.default_rng(6), 0
    assert_same({key: value.cpu().numpy() for key, value in other.reset(seed=4)[0].items()}, one.reset(seed=4)[0])
    for _ in range(12):
        actions = random.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        (expected, *_, wanted), (found, *_, infos) = one.step(actions), other.step(torch.tensor(actions))
        assert_same({key: value.cpu().numpy() for key, value in found.items()}, expected)
        for world in np.flatnonzero(wanted.get("_final_obs", [])):
            assert infos["_final_obs"].device == found["state"].device
            assert bool(infos["_final_obs"][world])
            last = {key: value[world].cpu().numpy() for key, value in infos["final_obs"].items()}
            assert_same(last, wanted["final_obs"][world])
            ends += 1
    assert ends > 2


def two_cameras(env: Sliders, outputs: tuple[str, ...], width: int = WIDTH) -> wc.Renderer:
    own = {"position": (0.0, 0.0, 6.0), "lens": wc.Pinhole(fovy=60.0)}
    cameras = [
        wc.Camera("top", width=WIDTH, height=HEIGHT, outputs=outputs, shadows=True),
        wc.Camera("own", width=width, height=HEIGHT, outputs=outputs, shadows=True, **own),
    ]
    return wc.Renderer(env.scene, cameras)


def test_layouts_and_one_image_of_all_channels(device: wp.Device) -> None:
    env = Sliders(2, AutoresetMode.NEXT_STEP, device)
    renderer = two_cameras(env, ("rgb", "depth"))
    plain = PixelObservation(env, renderer, forward=True).reset(seed=3)[0]
    turned = PixelObservation(env, renderer, forward=True, layout="CHW").reset(seed=3)[0]
    assert list(plain) == list(turned) == ["state", "top_rgb", "top_depth", "own_rgb", "own_depth"]
    for key in list(plain)[1:]:
        np.testing.assert_array_equal(turned[key], np.moveaxis(plain[key], 3, 1))
    with pytest.raises(wc.WarpcamError, match=r"one size and dtype, got top_rgb uint8\[12, 16, 3\], top_depth float32"):
        PixelObservation(env, renderer, concatenate=True)
    with pytest.raises(wc.WarpcamError, match=r"top_rgb uint8\[12, 16, 3\], own_rgb uint8\[12, 17, 3\]"):
        PixelObservation(env, two_cameras(env, ("rgb",), width=17), concatenate=True)
    colours = two_cameras(env, ("rgb",))
    for layout, axis in (("HWC", 3), ("CHW", 1)):
        joined = PixelObservation(env, colours, forward=True, layout=layout, concatenate=True)
        observation = joined.reset(seed=3)[0]
        assert list(observation) == ["state", "pixels"]
        expected = np.concatenate((plain["top_rgb"], plain["own_rgb"]), 3)
        np.testing.assert_array_equal(observation["pixels"], np.moveaxis(expected, 3, axis))
        alone = PixelObservation(env, colours, forward=True, layout=layout, concatenate=True, state=None)
        assert isinstance(alone.single_observation_space, gymnasium.spaces.Box)
        np.testing.assert_array_equal(alone.reset(seed=3)[0], observation["pixels"])
        assert alone.step(np.zeros((2, 1), np.float32))[0] in alone.observation_space


def test_spaces_hold_every_output(device: wp.Device) -> None:
    env = Sliders(2, AutoresetMode.NEXT_STEP, device)
    mjm = scenes.compile_xml('<body><freejoint/><geom type="box" size="0.5 0.5 0.5"/></body><light/>')
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 2))
    camera = scenes.own_camera(width=6, height=5, outputs=tuple(OUTPUTS))
    seen = PixelObservation(env, wc.Renderer(scene, [camera]), state="position")
    observation = seen.reset(seed=1)[0]
    assert not np.isfinite(observation["eye_depth"]).all()
    assert observation in seen.observation_space
    assert set(observation) == {"position", *(f"eye_{name}" for name in OUTPUTS)}
    for key, space in seen.single_observation_space.spaces.items():
        assert observation[key].dtype == space.dtype
    assert seen.single_observation_space["eye_rgb"] == gymnasium.spaces.Box(0, 255, (5, 6, 3), np.uint8)
    assert (seen.single_observation_space["eye_depth"].low == 0.0).all()


def test_spaces_hold_what_is_behind_a_fisheye(device: wp.Device) -> None:
    env = Sliders(2, AutoresetMode.NEXT_STEP, device)
    camera = scenes.own_camera(
        width=16, height=16, outputs=("depth",), lens=wc.Fisheye(fovy=350.0), position=(0.0, 0.0, -2.0)
    )
    seen = PixelObservation(env, wc.Renderer(env.scene, [camera]))
    observation = seen.reset(seed=1)[0]
    assert observation["eye_depth"].min() < 0.0  # the table stands behind it
    assert observation in seen.observation_space


@pytest.mark.parametrize("name", ["forward", "copy", "concatenate", "final_images"])
def test_switches_are_on_or_off(name: str) -> None:
    env = Sliders(2, AutoresetMode.NEXT_STEP, "cpu")
    renderer = wc.Renderer(env.scene, [scenes.own_camera(width=4, height=4, outputs=("depth",))])
    with pytest.raises(wc.WarpcamError, match=f"PixelObservation: {name} must be True or False, got 'no'"):
        PixelObservation(env, renderer, **{name: "no"})


@pytest.mark.parametrize("as_tensor", [True, False], ids=["tensor", "numpy"])
def test_a_mask_of_whole_numbers_is_not_taken_for_ids(as_tensor: bool) -> None:
    env = pixels(3, AutoresetMode.DISABLED)
    env.reset(seed=1)
    mask = np.array([1, 0, 0])
    with pytest.raises(wc.WarpcamError, match=r"reset: options\['reset_mask'\] must be of bool, .* got int64"):
        env.reset(options={"reset_mask": torch.as_tensor(mask) if as_tensor else mask})
    for same in ([True, False, False], mask.astype(bool), mask.astype(np.uint8), torch.as_tensor(mask).bool()):
        env.reset(options={"reset_mask": same})


@pytest.mark.filterwarnings("ignore:.*A Box observation space (minimum|maximum) value is -?infinity")
@pytest.mark.parametrize("mode", [AutoresetMode.DISABLED, AutoresetMode.NEXT_STEP], ids=lambda mode: mode.name)
@pytest.mark.parametrize("options", [{}, {"layout": "CHW"}], ids=str)
def test_the_env_checker_is_content(mode: Any, options: dict[str, Any], device: wp.Device) -> None:
    check_env(OneWorld(pixels(1, mode, **options)), skip_render_check=True)


def test_gymnasiums_wrappers_go_on_top(device: wp.Device) -> None:
    flat = FlattenObservation(pixels(2, AutoresetMode.NEXT_STEP))
    assert flat.reset(seed=1)[0].shape == (2, 1 + WIDTH * HEIGHT * 4)
    counted = RecordEpisodeStatistics(pixels(2, AutoresetMode.NEXT_STEP))
    counted.reset(seed=1)
    lengths = []
    for _ in range(10):
        *_, infos = counted.step(np.zeros((2, 1), np.float32))
        lengths += list(infos["episode"]["l"]) if "episode" in infos else []
    assert lengths == [LONGEST, LONGEST]


def test_frames_are_stacked_by_gymnasium(device: wp.Device) -> None:
    env = OneWorld(pixels(1, AutoresetMode.DISABLED, state=None, concatenate=False))
    stacked = FrameStackObservation(env, 3)
    first, _ = stacked.reset(seed=1)
    second = stacked.step(np.ones(1, np.float32))[0]
    third = stacked.step(np.ones(1, np.float32))[0]
    images = third["top_rgb"]
    assert images.shape == (3, HEIGHT, WIDTH, 3)
    np.testing.assert_array_equal(images[:2], second["top_rgb"][1:])
    np.testing.assert_array_equal(images[0], first["top_rgb"][2])
    assert (images[1] != images[2]).any()


def test_frames_for_videos(device: wp.Device) -> None:
    env = pixels(3, AutoresetMode.NEXT_STEP, layout="CHW")
    image = env.reset(seed=1)[0]["top_rgb"]
    assert env.render_mode == "rgb_array"
    assert env.metadata["render_modes"] == ["rgb_array"]
    frames = env.render()
    assert isinstance(frames, tuple)
    np.testing.assert_array_equal(np.stack(frames), np.moveaxis(image, 1, 3))
    env.step(np.ones((3, 1), np.float32))
    assert (frames[0] != env.render()[0]).any()
