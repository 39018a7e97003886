"""Images as observations of Gymnasium's vector envs: what they are of, and when. Gymnasium's own vector env judges."""

from typing import Any

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc
from warpcam import sensors

gymnasium = pytest.importorskip("gymnasium", reason="pip install 'warpcam[gymnasium]'")

from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv  # noqa: E402
from gymnasium.vector.utils import batch_space  # noqa: E402
from slider_env import END, HEIGHT, MODEL, MODES, WIDTH, Sliders, assert_same, judge, pixels, renderer_of  # noqa: E402

from warpcam.envs import OneWorld, PixelObservation  # noqa: E402


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
    """The image shows the ball where the observation has it, also in the last one of an episode."""
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


def test_one_worlds_action_may_have_parts() -> None:
    class Parts(Sliders):
        def step(self, actions: Any) -> Any:
            assert actions["arm"][0].shape == (1, 2) and actions["grip"].shape == (1,)
            return super().step(actions["arm"][1])

    env = OneWorld(Parts(1, AutoresetMode.DISABLED))
    env.reset(seed=1)
    before = env.step({"arm": (np.zeros(2), np.zeros(1, np.float32)), "grip": np.int64(1)})[0]
    after = env.step({"arm": (np.zeros(2), np.ones(1, np.float32)), "grip": np.int64(1)})[0]
    assert after != before


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


SMALL: dict[str, Any] = {"width": 4, "height": 4}


def own(name: str) -> wc.Camera:
    return wc.Camera(name, **SMALL, lens=wc.Pinhole(fovy=40.0), position=(0.0, 0.0, 3.0))


MISTAKES: dict[str, Any] = {
    "layout 'WHC' came, allowed are HWC, CHW": lambda: bad(layout="WHC"),
    "arrays 'jax' came, allowed are numpy, torch": lambda: bad(arrays="jax"),
    "the renderer's scene has 1 worlds, the env 2": lambda: PixelObservation(
        Sliders(2, AutoresetMode.DISABLED), renderer_of(Sliders(1, AutoresetMode.DISABLED))
    ),
    "renderer must be a Renderer or Rig, got Scene": lambda: PixelObservation(
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
    "PixelObservation: env must be a gymnasium.vector.VectorEnv, got Scene": lambda: PixelObservation(
        Sliders(1, AutoresetMode.DISABLED).scene, renderer_of(Sliders(1, AutoresetMode.DISABLED))
    ),
    "PixelObservation: state must be a key or None, got 5": lambda: bad(state=5),
    "PixelObservation: state must be a key or None, got ''": lambda: bad(state=""),
    "two images have one key '{camera}_{output}'; rename the cameras, which are 0, '0'": lambda: PixelObservation(
        (env := Sliders(1, AutoresetMode.DISABLED)), wc.Renderer(env.scene, [wc.Camera(0, **SMALL), own("0")])
    ),
    "OneWorld: env must be a gymnasium.vector.VectorEnv, got CartPoleEnv": lambda: OneWorld(
        gymnasium.make("CartPole-v1").unwrapped
    ),
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


def test_a_rig_gives_what_its_sensors_measure() -> None:
    """Outputs that no effect changes are the renderer's."""
    env = Sliders(2, AutoresetMode.DISABLED)
    rig = sensors.Rig(renderer_of(env), {"top": [sensors.RandomDropout(probability=1.0)]})
    seen = PixelObservation(env, rig, forward=True)
    observation, _ = seen.reset(seed=1)
    assert np.array_equal(observation["top_depth"], rig.images["top"]["depth"].cpu().numpy())
    hit = np.isfinite(rig.renderer.images["top"]["depth"].cpu().numpy())
    assert hit.any() and not observation["top_depth"][hit].any()
    assert np.array_equal(observation["top_rgb"], rig.renderer.images["top"]["rgb"].cpu().numpy())
