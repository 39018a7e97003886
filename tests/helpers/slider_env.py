"""Worlds in which a ball slides, as a vector env of Gymnasium, and the same put together by Gymnasium itself."""

from typing import Any

import gymnasium
import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space

import warpcam as wc
from warpcam.envs import PixelObservation

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
    """Make such worlds with images; the wrapper makes SAME_STEP."""
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
    """Make the same worlds, each with a renderer of its own, put together by Gymnasium."""
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
