"""Images as observations of Gymnasium's vector envs: what they are of, and when. Gymnasium's own vector env judges."""

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc

gymnasium = pytest.importorskip("gymnasium", reason="pip install 'warpcam[gymnasium]'")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv  # noqa: E402
from gymnasium.vector.utils import batch_space  # noqa: E402
from gymnasium.wrappers import FrameStackObservation  # noqa: E402
from gymnasium.wrappers.vector import FlattenObservation, RecordEpisodeStatistics  # noqa: E402

from warpcam.envs import OneWorld, PixelObservation  # noqa: E402
from warpcam.outputs import OUTPUTS  # noqa: E402

MODEL = """
<mujoco>
  <asset><material name="paint" rgba="0 0 1 1" shininess=".4"/></asset>
  <worldbody>
    <light pos="2 1 4" dir="-2 -1 -4" diffuse=".6 .6 .6"/>
    <camera name="top" pos="0 0 5" fovy="60"/>
    <body pos="0 0 1"><joint type="slide" axis="1 0 0"/><geom size=".6" rgba="1 0 0 1"/></body>
    <geom type="box" size="3 3 .1" pos="0 0 -.5" material="paint"/>
  </worldbody>
</mujoco>
"""
WIDTH, HEIGHT = 16, 12
LONGEST, END = 7, 1.0  # steps of an episode, and how far the ball may go [m]
MODES = list(AutoresetMode)


class Sliders(VectorEnv):
    """A ball in each world, pushed to and fro; each world has a random start of its own."""

    live = False  # whether observations are the env's own memory

    def __init__(self, num_envs: int, mode: Any, device: Any = "cpu", tensors: bool = False):
        self.num_envs, self.metadata = num_envs, {"autoreset_mode": mode}
        self.single_observation_space = gymnasium.spaces.Box(-9.0, 9.0, (1,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        mjm = mujoco.MjModel.from_xml_string(MODEL)
        mjd = mujoco.MjData(mjm)
        mujoco.mj_forward(mjm, mjd)
        with wp.ScopedDevice(device):
            m, self._d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=num_envs)
        self.scene = wc.from_mujoco_warp(mjm, m, self._d)
        self._tensors = tensors
        self._steps = np.zeros(num_envs, int)
        self._ended = np.zeros(num_envs, bool)
        self._random = [np.random.default_rng(world) for world in range(num_envs)]
        self._x = np.zeros((num_envs, 1), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, bool))
        self._begin(np.asarray(torch.as_tensor(mask).cpu()), seed)
        return self._x if self.live else self._out(self._x), {"begun": self._out(self._steps == 0)}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        actions = np.asarray(torch.as_tensor(actions).cpu())
        again = self._ended if self.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP else self._ended & False
        self._x += 0.5 * actions * ~again[:, None]
        self._steps += 1
        self._begin(again)
        self._put()
        terminations, truncations = np.abs(self._x[:, 0]) > END, self._steps >= LONGEST
        self._ended = terminations | truncations
        rewards = np.where(again, 0.0, self._x[:, 0].astype(np.float64))
        infos = {"begun": self._out(self._steps == 0)}
        values = tuple(map(self._out, (self._x, rewards, terminations, truncations)))
        return *((self._x, *values[1:]) if self.live else values), infos

    def _begin(self, mask: np.ndarray, seed: int | None = None) -> None:
        for world in np.flatnonzero(mask):
            if seed is not None:
                self._random[world] = np.random.default_rng(seed + world)
            self._x[world], self._steps[world] = self._random[world].uniform(-0.5, 0.5), 0
        self._ended = self._ended & ~mask
        self._put()

    def _put(self) -> None:
        self._d.qpos.assign(self._x)

    def _out(self, values: np.ndarray) -> Any:
        return torch.tensor(values, device=wp.device_to_torch(self.scene.device)) if self._tensors else values.copy()


def renderer_of(env: Sliders, outputs: tuple[str, ...] = ("rgb", "depth"), **options: Any) -> wc.Renderer:
    camera = wc.Camera("top", width=WIDTH, height=HEIGHT, outputs=outputs, shadows=True, **options)
    return wc.Renderer(env.scene, [camera])


def pixels(num_envs: int, mode: Any, tensors: bool = False, **options: Any) -> PixelObservation:
    """Such worlds with images; SAME_STEP is made by the wrapper."""
    own = AutoresetMode.DISABLED if mode is AutoresetMode.SAME_STEP else mode
    env = Sliders(num_envs, own, wp.get_device(), tensors)
    more = {"autoreset_mode": mode, "forward": True, **options}
    return PixelObservation(env, renderer_of(env), **more)


class Judge(gymnasium.Env):
    """One such world, whose images are rendered without any wrapper."""

    def __init__(self) -> None:
        self._one = Sliders(1, AutoresetMode.DISABLED, wp.get_device())
        self._renderer = renderer_of(self._one)
        self.action_space = self._one.single_action_space
        self.observation_space = gymnasium.spaces.Dict(
            {
                "state": self._one.single_observation_space,
                "top_rgb": gymnasium.spaces.Box(0, 255, (HEIGHT, WIDTH, 3), np.uint8),
                "top_depth": gymnasium.spaces.Box(0.0, np.inf, (HEIGHT, WIDTH, 1), np.float32),
            }
        )

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        states, infos = self._one.reset(seed=seed)
        return self._observe(states), {"begun": bool(infos["begun"][0])}

    def step(self, action: Any) -> Any:
        states, rewards, ends, limits, infos = self._one.step(action[None])
        told = {"begun": bool(infos["begun"][0])}
        return self._observe(states), float(rewards[0]), bool(ends[0]), bool(limits[0]), told

    def _observe(self, states: np.ndarray) -> dict[str, np.ndarray]:
        images = self._renderer.render(forward=True)["top"]
        return {"state": states[0], **{f"top_{name}": image[0].cpu().numpy().copy() for name, image in images.items()}}


def judge(num_envs: int, mode: Any) -> SyncVectorEnv:
    """The same worlds, each with a renderer of its own, put together by Gymnasium."""
    return SyncVectorEnv([Judge] * num_envs, autoreset_mode=mode)


def assert_same(found: Any, expected: Any, what: str = "") -> None:
    assert isinstance(found, dict) == isinstance(expected, dict), what
    if isinstance(expected, dict):
        assert set(found) == set(expected), what
        for key, value in expected.items():
            assert_same(found[key], value, f"{what} {key}")
    else:
        assert found.dtype == expected.dtype, what
        np.testing.assert_array_equal(found, expected, err_msg=what)


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_as_gymnasiums_own_vector_env(mode: Any, device: wp.Device) -> None:
    """Every observation and every last one, through many episodes that end at times of their own."""
    ours, theirs, random = pixels(3, mode), judge(3, mode), np.random.default_rng(5)
    assert ours.metadata["autoreset_mode"] is mode
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.observation_space == theirs.observation_space
    assert_same(ours.reset(seed=9)[0], theirs.reset(seed=9)[0])
    ends = 0
    for step in range(25):
        actions = random.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        found, expected = ours.step(actions), theirs.step(actions)
        assert found[0] in ours.observation_space
        for what, one, other in zip(("observation", "reward", "end", "limit"), found[:4], expected[:4], strict=True):
            assert_same(one, other, f"step {step}: {what}")
        ended = expected[2] | expected[3]
        ends += ended.sum()
        if mode is AutoresetMode.SAME_STEP:
            assert_ends_are_same(found[4], expected[4], ended)
        elif mode is AutoresetMode.DISABLED and ended.any():
            observations = [env.reset(options={"reset_mask": ended.copy()})[0] for env in (ours, theirs)]
            assert_same(*observations, f"step {step}: reset")
    assert ends > 6


def assert_ends_are_same(found: dict[str, Any], expected: dict[str, Any], ended: np.ndarray) -> None:
    assert ("final_obs" in found) == ended.any()
    if not ended.any():
        return
    np.testing.assert_array_equal(found["_final_obs"], expected["_final_obs"])
    np.testing.assert_array_equal(found["_final_info"], expected["_final_info"])
    for world, last in enumerate(expected["final_obs"]):
        if last is None:
            assert found["final_obs"][world] is None
        else:
            assert_same(found["final_obs"][world], last, f"last of world {world}")
    np.testing.assert_array_equal(found["begun"], expected["begun"])
    assert not found["final_info"]["begun"][ended].any()


def test_the_image_is_of_the_state_beside_it(device: wp.Device) -> None:
    """Where the ball is seen is where the observation says it is, also in the last one of an episode."""
    env = pixels(4, AutoresetMode.SAME_STEP)
    env.unwrapped.live = True
    observations, _ = env.reset(seed=1)
    checked = 0
    for _ in range(12):
        observations, _, terminations, truncations, infos = env.step(np.ones((4, 1), np.float32))
        rows = [(observations["state"][world], observations["top_rgb"][world]) for world in range(4)]
        for world in np.flatnonzero(terminations | truncations):
            last = infos["final_obs"][world]
            assert abs(last["state"][0]) > END
            rows.append((last["state"], last["top_rgb"]))
            checked += 1
        for state, image in rows:
            columns = np.nonzero((image[..., 0].astype(int) > image[..., 2]).any(axis=0))[0]
            seen = (columns.mean() + 0.5 - 0.5 * WIDTH) / HEIGHT * 2.0 * np.tan(np.radians(30.0)) * 4.0
            assert abs(seen - state[0]) < 0.35
    assert checked > 4


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


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_nothing_flows_from_one_episode_into_the_next(mode: Any, device: wp.Device) -> None:
    own = Sliders(3, AutoresetMode.DISABLED if mode is AutoresetMode.SAME_STEP else mode, device)
    env = PixelObservation(own, renderer_of(own, ("flow_valid",)), autoreset_mode=mode, forward=True)
    assert not env.reset(seed=1)[0]["top_flow_valid"].any()
    pushes = np.array([[1.0], [0.0], [-1.0]], np.float32)
    begun, ends = np.zeros(3, bool), 0
    for _ in range(10):
        observation, _, terminations, truncations, _ = env.step(pushes)
        ended = terminations | truncations
        ends += ended.sum()
        if mode is AutoresetMode.SAME_STEP:
            begun = ended
        known = observation["top_flow_valid"].any(axis=(1, 2, 3))
        np.testing.assert_array_equal(known, ~begun)
        begun = ended
        if mode is AutoresetMode.DISABLED and ended.any():
            observation, _ = env.reset(options={"reset_mask": ended.copy()})
            assert not observation["top_flow_valid"][ended].any()
            begun = np.zeros(3, bool)
    assert ends > 2


def test_one_world_tells_of_itself_alone(device: wp.Device) -> None:
    env = OneWorld(pixels(1, AutoresetMode.NEXT_STEP, tensors=True, arrays="torch"))
    observation, infos = env.reset(seed=1)
    assert observation["top_rgb"].shape == (HEIGHT, WIDTH, 3)
    assert bool(infos["begun"]) is True
    observation, reward, terminated, truncated, infos = env.step(torch.ones(1))
    assert type(reward) is float
    assert (terminated, truncated) == (False, False)
    assert bool(infos["begun"]) is False
    assert observation["state"].shape == (1,)


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


def test_classic_envs_in_gymnasiums_own_vector_env(device: wp.Device) -> None:
    """Worlds of classic MuJoCo, one for each env: their data are what is rendered, whoever steps them."""
    mjm = mujoco.MjModel.from_xml_string(MODEL)

    class Push(gymnasium.Env):
        observation_space = gymnasium.spaces.Box(-9.0, 9.0, (1,), np.float64)
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

        def __init__(self) -> None:
            self.data = mujoco.MjData(mjm)

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            super().reset(seed=seed)
            mujoco.mj_resetData(mjm, self.data)
            mujoco.mj_forward(mjm, self.data)
            return self.data.qpos.copy(), {}

        def step(self, action: Any) -> Any:
            self.data.qpos[0] += float(action[0])
            mujoco.mj_forward(mjm, self.data)
            return self.data.qpos.copy(), 0.0, False, False, {}

    envs = SyncVectorEnv([Push, Push])
    scene = wc.from_mujoco(mjm, [env.unwrapped.data for env in envs.envs], device=device)
    camera = wc.Camera("top", width=WIDTH, height=HEIGHT, outputs=("rgb", "depth"), shadows=True)
    env = PixelObservation(envs, wc.Renderer(scene, [camera]))
    start = env.reset(seed=1)[0]["top_depth"]
    moved = env.step(np.array([[0.0], [0.8]], np.float32))[0]["top_depth"]
    np.testing.assert_array_equal(moved[0], start[0])
    assert (moved[1] != start[1]).any()


def test_worlds_of_newton(device: wp.Device) -> None:
    """Two states that are swapped in every step, as Newton's solvers do."""
    newton = pytest.importorskip("newton", reason="pip install newton")
    template = newton.ModelBuilder()
    body = template.add_body(label="ball")
    template.add_shape_sphere(body, radius=0.5)
    builder = newton.ModelBuilder()
    builder.replicate(template, 3)
    model = builder.finalize(device=device)

    class Falling(VectorEnv):
        metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012
        num_envs = 3
        single_observation_space = gymnasium.spaces.Box(-9.0, 9.0, (7,), np.float32)
        observation_space = batch_space(single_observation_space, 3)
        single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        action_space = batch_space(single_action_space, 3)

        def __init__(self) -> None:
            self._now, self._next = model.state(), model.state()
            self.scene = wc.from_newton(model, self._now)

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            return self._move(np.zeros((3, 1))), {}

        def step(self, actions: Any) -> Any:
            observations = self._move(actions)
            return observations, np.zeros(3), np.zeros(3, bool), np.zeros(3, bool), {}

        def _move(self, height: Any) -> np.ndarray:
            poses = np.tile(np.array((0, 0, 0, 0, 0, 0, 1), np.float32), (3, 1))
            poses[:, 2] = np.asarray(height)[:, 0]
            self._next.body_q.assign(poses)
            self._now, self._next = self._next, self._now
            self.scene.bind(self._now)
            return poses

    own = Falling()
    camera = wc.Camera(
        "eye", width=9, height=9, outputs=("depth",), lens=wc.Pinhole(fovy=40.0), position=(0.0, 0.0, 3.0)
    )
    env = PixelObservation(own, wc.Renderer(own.scene, [camera]))
    assert env.reset()[0]["eye_depth"][:, 4, 4, 0] == pytest.approx(2.5, abs=1e-5)
    for height in (0.5, -0.25, 1.0):
        heights = np.array([[height], [0.0], [-height]])
        observation = env.step(heights)[0]
        assert observation["eye_depth"][:, 4, 4, 0] == pytest.approx(2.5 - heights[:, 0], abs=1e-5)
        np.testing.assert_array_equal(observation["state"][:, 2], heights[:, 0].astype(np.float32))


def bad(**options: Any) -> PixelObservation:
    return pixels(1, options.pop("mode", AutoresetMode.DISABLED), **options)


MISTAKES: dict[str, Any] = {
    "layout 'WHC' came, allowed are HWC, CHW": lambda: bad(layout="WHC"),
    "arrays 'jax' came, allowed are numpy, torch": lambda: bad(arrays="jax"),
    "the renderer's scene has 1 worlds, the env 2": lambda: PixelObservation(
        Sliders(2, AutoresetMode.DISABLED), renderer_of(Sliders(1, AutoresetMode.DISABLED))
    ),
    "renderer must be a Renderer, got Scene": lambda: PixelObservation(
        Sliders(1, AutoresetMode.DISABLED), Sliders(1, AutoresetMode.DISABLED).scene
    ),
    "autoreset_mode <AutoresetMode.NEXT_STEP: 'NextStep'> came, and the env has": lambda: bad(
        autoreset_mode=AutoresetMode.NEXT_STEP
    ),
    "their last states are gone before they can be rendered": lambda: PixelObservation(
        (env := Sliders(1, AutoresetMode.SAME_STEP)), renderer_of(env)
    ),
    "autoreset_mode'] must be a gymnasium.vector.AutoresetMode, got None": lambda: PixelObservation(
        (env := Sliders(1, None)), renderer_of(env)
    ),
    "have top_rgb already; rename the cameras": lambda: bad(state="top_rgb"),
    "OneWorld: env has 2 worlds, it must have 1": lambda: OneWorld(Sliders(2, AutoresetMode.DISABLED)),
    "OneWorld: env resets its world in the step": lambda: OneWorld(Sliders(1, AutoresetMode.SAME_STEP)),
}


@pytest.mark.parametrize("message", MISTAKES)
def test_mistakes(message: str) -> None:
    with pytest.raises(wc.WarpcamError) as caught:
        MISTAKES[message]()
    assert message in str(caught.value)


def test_an_env_that_resets_by_itself_may_go_without_last_images() -> None:
    env = Sliders(2, AutoresetMode.SAME_STEP)
    seen = PixelObservation(env, renderer_of(env), final_images=False, forward=True)
    assert seen.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert "top_rgb" in seen.reset(seed=1)[0]
