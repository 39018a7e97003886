"""Gymnasium: images among the observations of a vector env whose worlds a renderer sees."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from warpcam.camera.lens_tables import RayTableLens
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.outputs import OUTPUTS
from warpcam.render.renderer import Renderer
from warpcam.sensors.rig import Rig

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and warpcam.envs needs it: pip install 'warpcam[gymnasium]'"
    ) from error

__all__ = ["OneWorld", "PixelObservation"]

LAYOUTS = ("HWC", "CHW")
KINDS = ("numpy", "torch")


class PixelObservation(VectorWrapper):  # type: ignore[misc]
    """Adds what cameras see to the observations of a vector env, rendered for all its worlds at once.

    Observations become a dictionary: the env's own under ``state``, or under its own keys if it is a dictionary
    already, and each image under ``"{camera}_{output}"``. Images are of the state that the observation is of: after a
    reset of the new episode, and where an episode ends of its last state, as the autoreset mode has it.

    - NEXT_STEP and DISABLED are the env's own: whatever ``step`` leaves is what is rendered.
    - SAME_STEP is made here, of an env that is DISABLED and resets what ``options["reset_mask"]`` says:
      ``infos["final_obs"]`` has the last observation with its images, the observation is the new episode's.

    Args:
        env: Its worlds are those of the renderer's scene, in that order.
        renderer: All its cameras and outputs become observations. A ``Rig`` of ``warpcam.sensors`` gives what its
            sensors measure.
        layout: Of each image: "HWC" or "CHW".
        concatenate: One image ``"pixels"`` of all channels, in the order of ``renderer.images``, in place of one for
            each output. They must be of one size and dtype.
        state: Key of the env's own observation; None leaves it out, and with ``concatenate`` the image alone is the
            observation.
        arrays: "numpy", or "torch" for tensors on the scene's device, rewards and ends of episodes included.
        copy: Whether observations stay as they are when the next are made. False gives the memory that the renderer
            writes in each frame: tensors on the device, or arrays where the scene is on the CPU.
        autoreset_mode: None is the env's own; SAME_STEP is made of DISABLED.
        forward: Have the simulator compute poses before each frame: see ``Renderer.render``.
        final_images: False accepts an env that is SAME_STEP by itself: there is no image of an episode's last state
            then, and ``infos["final_obs"]`` is what the env gives.
    """

    def __init__(
        self,
        env: VectorEnv,
        renderer: Renderer | Rig,
        *,
        layout: str = "HWC",
        concatenate: bool = False,
        state: str | None = "state",
        arrays: str = "numpy",
        copy: bool = True,
        autoreset_mode: Any = None,
        forward: bool = False,
        final_images: bool = True,
    ):
        _require_vector("PixelObservation", env)
        super().__init__(env)
        if not isinstance(renderer, Renderer | Rig):
            raise WarpcamError(f"PixelObservation: renderer must be a Renderer or Rig, got {type(renderer).__name__}")
        eyes = renderer.renderer if isinstance(renderer, Rig) else renderer
        for name, value, allowed in (("layout", layout, LAYOUTS), ("arrays", arrays, KINDS)):
            if value not in allowed:
                raise WarpcamError(f"PixelObservation: {name} {value!r} came, allowed are {', '.join(allowed)}")
        if state is not None and not (isinstance(state, str) and state):
            raise WarpcamError(f"PixelObservation: state must be a key or None, got {state!r}")
        switches = {"concatenate": concatenate, "copy": copy, "forward": forward, "final_images": final_images}
        for name, switch in switches.items():
            if not isinstance(switch, bool | np.bool_):
                raise WarpcamError(f"PixelObservation: {name} must be True or False, got {switch!r}")
        if len(eyes.faulty) != env.num_envs:
            raise WarpcamError(
                f"PixelObservation: the renderer's scene has {len(eyes.faulty)} worlds, the env {env.num_envs}; "
                "each env needs a world of its own"
            )
        self._renderer, self._forward = eyes, forward
        self._source = renderer
        self._layout, self._concatenate, self._state = layout, concatenate, state
        self._torch, self._copy = arrays == "torch", copy
        self._images = {
            f"{camera}_{output}": (output, tensor)
            for camera, by_output in renderer.images.items()
            for output, tensor in by_output.items()
            if tensor.ndim == 4  # a rig has ages of frames among them
        }
        if len(self._images) < sum(map(len, eyes.images.values())):
            cameras = ", ".join(map(repr, renderer.images))
            raise WarpcamError(
                "PixelObservation: two images have one key '{camera}_{output}'; rename the cameras, which are "
                + cameras
            )
        behind = [camera for camera, asked in eyes._cameras.items() if isinstance(asked.lens, RayTableLens)]
        self._behind = {f"{camera}_depth" for camera in behind}  # what is behind a camera has a negative depth
        own = _mode_of(env)
        self._mode = _check_mode(own, autoreset_mode, final_images)
        self._resets = self._mode is AutoresetMode.SAME_STEP and own is AutoresetMode.DISABLED
        self._ended: Any = None  # worlds that the env's next step begins anew
        flows = any(output.startswith("flow") for output, _ in self._images.values())
        self._forgets = flows or isinstance(renderer, Rig)
        self._frames = next((tensor for output, tensor in self._images.values() if output == "rgb"), None)
        more = {"autoreset_mode": self._mode}
        if env.render_mode is None and self._frames is not None:
            more["render_modes"] = ["rgb_array"]
        self.metadata = {**env.metadata, **more}
        self.single_observation_space = self._space(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset all worlds, or those of ``options["reset_mask"]`` (world,), and render them."""
        worlds = _mask((options or {}).get("reset_mask"))  # read first: envs take it out of the options
        observations, infos = self.env.reset(seed=seed, options=options)
        self._ended = None
        self._forget(worlds)
        self._render(worlds)
        return self._observe(observations), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        if self._mode is AutoresetMode.SAME_STEP and not self._resets:  # the env has reset them
            self._ended = terminations | truncations
        if self._ended is not None:
            self._forget(self._ended)
        if self._mode is AutoresetMode.NEXT_STEP:
            self._ended = terminations | truncations
        self._render()
        if self._resets:
            # What the env gives may be memory of its own, which the reset writes.
            observations, rewards, terminations, truncations, infos = map(
                copied, (observations, rewards, terminations, truncations, infos)
            )
            observed, infos = self._reset_ended(observations, terminations | truncations, infos)
        else:
            observed = self._observe(observations)
        return observed, self._array(rewards), self._array(terminations), self._array(truncations), infos

    @property
    def render_mode(self) -> str | None:
        """The env's, or "rgb_array" where it has none and a camera gives ``rgb``."""
        own = self.env.render_mode
        return "rgb_array" if own is None and self._frames is not None else own

    def render(self) -> Any:
        """Return the env's own picture, or each world's last ``rgb`` of the first camera with it, (H, W, 3) uint8."""
        if self.env.render_mode is not None or self._frames is None:
            return self.env.render()
        return tuple(torch_interop.to_numpy(self._frames).copy())

    def _render(self, worlds: Any = None) -> None:
        draw = self._source.read if isinstance(self._source, Rig) else self._source.render
        draw(worlds=worlds, forward=self._forward)

    def _forget(self, worlds: Any) -> None:
        """Clear the flow, and what sensors remember, of worlds that have jumped to another state."""
        if self._forgets:
            self._source.reset(worlds)

    def _reset_ended(self, last: Any, ended: Any, infos: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes in the worlds whose episodes have ended; the observation and infos of the step."""
        on_host = isinstance(ended, np.ndarray) or not ended.is_cuda
        if on_host and not ended.any():
            return self._observe(last), infos
        final = self._observe(last, copy=True)
        mask = ended.copy() if isinstance(ended, np.ndarray) else ended.clone()
        observations, begun = self.env.reset(options={"reset_mask": mask})
        self._forget(ended)
        self._render(ended)
        told = {**infos, **{key: _where(ended, value, infos.get(key)) for key, value in begun.items()}}
        ended = self._array(ended)
        if not self._torch:
            final = _rows(final, ended)
        told |= {"final_obs": final, "_final_obs": ended, "final_info": infos, "_final_info": ended}
        return self._observe(observations), told

    def _observe(self, own: Any, copy: bool | None = None) -> Any:
        images = self._now(self._copy if copy is None else copy)
        if self._state is None:
            return images["pixels"] if self._concatenate else images
        if isinstance(own, Mapping):
            return {**{key: self._array(value) for key, value in own.items()}, **images}
        return {self._state: self._array(own), **images}

    def _now(self, copy: bool) -> dict[str, Any]:
        """The images as they lie in the renderer's memory, as observations."""
        tensors = {
            key: tensor.permute(0, 3, 1, 2) if self._layout == "CHW" else tensor
            for key, (_, tensor) in self._images.items()
        }
        if self._concatenate:
            axis = 1 if self._layout == "CHW" else 3
            tensors = {"pixels": torch_interop.concatenate(list(tensors.values()), axis)}
        elif copy and (self._torch or not self._renderer.faulty.is_cuda):
            tensors = {key: torch_interop.copied(tensor) for key, tensor in tensors.items()}
        if self._torch:
            return tensors
        # What is copied to the host anyway is put in order on the device.
        return {key: torch_interop.to_numpy(one.contiguous() if one.is_cuda else one) for key, one in tensors.items()}

    def _array(self, values: Any) -> Any:
        """An array of the env in the form that was asked for."""
        if isinstance(values, Mapping):
            return {key: self._array(value) for key, value in values.items()}
        if isinstance(values, tuple):
            return tuple(map(self._array, values))
        if self._torch:
            return torch_interop.to_tensor(values, self._renderer.faulty.device)
        return torch_interop.to_numpy(values) if torch_interop.is_tensor(values) else values

    def _space(self, own: Any) -> Any:
        """Batch the values of one world."""
        images = {
            key: self._box(tensor, None if key in self._behind else OUTPUTS[output].span)
            for key, (output, tensor) in self._images.items()
        }
        if self._concatenate:
            images = {"pixels": self._box_of_all(images)}
        if self._state is None:
            return images["pixels"] if self._concatenate else gymnasium.spaces.Dict(images)
        beside = dict(own.spaces) if isinstance(own, gymnasium.spaces.Dict) else {self._state: own}
        twice = ", ".join(sorted(set(beside) & set(images)))
        if twice:
            raise WarpcamError(f"PixelObservation: the env's observations have {twice} already; rename the cameras")
        return gymnasium.spaces.Dict({**beside, **images})

    def _box(self, tensor: torch_interop.Tensor, span: tuple[float, float] | None) -> Any:
        dtype = torch_interop.to_numpy(tensor[:0]).dtype
        every = (-np.inf, np.inf) if dtype.kind == "f" else (np.iinfo(dtype).min, np.iinfo(dtype).max)
        low, high = span or every
        height, width, channels = tensor.shape[1:]
        shape = (channels, height, width) if self._layout == "CHW" else (height, width, channels)
        return gymnasium.spaces.Box(low, high, shape, dtype.type)

    def _box_of_all(self, images: Mapping[str, Any]) -> Any:
        boxes, axis = list(images.values()), 0 if self._layout == "CHW" else 2
        kinds = {(*box.shape[:axis], *box.shape[axis + 1 :], str(box.dtype)) for box in boxes}
        if len(kinds) > 1:
            each = ", ".join(f"{key} {box.dtype}{list(box.shape)}" for key, box in images.items())
            raise WarpcamError(f"PixelObservation: concatenate needs images of one size and dtype, got {each}")
        low, high = (np.concatenate([getattr(box, side) for box in boxes], axis) for side in ("low", "high"))
        return gymnasium.spaces.Box(low, high, dtype=boxes[0].dtype.type)


class OneWorld(gymnasium.Env):  # type: ignore[misc]
    """The only world of a vector env, as a plain env: for wrappers that know no vector envs, and for checkers.

    Args:
        env: Has one world, and resets it when it is told to, or in the step after an episode's last.
    """

    def __init__(self, env: VectorEnv):
        _require_vector("OneWorld", env)
        if env.num_envs != 1:
            raise WarpcamError(f"OneWorld: env has {env.num_envs} worlds, it must have 1")
        if _mode_of(env) is AutoresetMode.SAME_STEP:
            raise WarpcamError("OneWorld: env resets its world in the step that ends an episode; make it DISABLED")
        self.env = env
        self.observation_space, self.action_space = env.single_observation_space, env.single_action_space
        self.metadata, self.render_mode = env.metadata, env.render_mode

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        observations, infos = self.env.reset(seed=seed, options=options)
        return _row(observations, 0), _info(infos)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        observations, rewards, terminations, truncations, infos = self.env.step(_batched(action))
        ends = bool(terminations[0]), bool(truncations[0])
        return _row(observations, 0), float(rewards[0]), *ends, _info(infos)

    def render(self) -> Any:
        frames = self.env.render()
        return None if frames is None else frames[0]

    def close(self) -> None:
        self.env.close()


def _mask(worlds: Any) -> Any:
    """Return the mask that ``reset`` was given, which must not be taken for ids."""
    if worlds is None:
        return None
    array = torch_interop.as_array(worlds)
    dtype = np.asarray(worlds).dtype if array is None else array.dtype
    if dtype not in (np.dtype(bool), np.dtype(np.uint8), wp.bool, wp.uint8):
        name = getattr(dtype, "__name__", dtype)
        raise WarpcamError(f"reset: options['reset_mask'] must be of bool, one for each world, got {name}")
    return worlds


def _require_vector(whose: str, env: Any) -> None:
    if not isinstance(env, VectorEnv):
        raise WarpcamError(f"{whose}: env must be a gymnasium.vector.VectorEnv, got {type(env).__name__}")


def _mode_of(env: VectorEnv) -> Any:
    mode = env.metadata.get("autoreset_mode")
    if not isinstance(mode, AutoresetMode):
        raise WarpcamError(
            f"env.metadata['autoreset_mode'] must be a gymnasium.vector.AutoresetMode, got {mode!r}: without it nobody "
            "knows which observations are an episode's last"
        )
    return mode


def _check_mode(own: Any, wanted: Any, final_images: bool) -> Any:
    """The mode of the wrapped env."""
    same, disabled = AutoresetMode.SAME_STEP, AutoresetMode.DISABLED
    if wanted not in (None, own) and not (wanted is same and own is disabled):
        raise WarpcamError(
            f"PixelObservation: autoreset_mode {wanted!r} came, and the env has {own}; allowed are None, its own, and "
            f"{same} over {disabled}"
        )
    if own is same and final_images:
        raise WarpcamError(
            "PixelObservation: the env resets worlds inside its step, and their last states are gone before they can "
            f"be rendered. Give it the mode {disabled} and reset(options={{'reset_mask': ...}}), and say "
            f"autoreset_mode={same} here; or do without images of last states: final_images=False"
        )
    return own if wanted is None else wanted


def copied(values: Any) -> Any:
    if isinstance(values, Mapping):
        return {key: copied(value) for key, value in values.items()}
    if isinstance(values, tuple):
        return tuple(map(copied, values))
    if isinstance(values, np.ndarray):
        return values.copy()
    return torch_interop.copied(values) if torch_interop.is_tensor(values) else values


def _where(mask: Any, new: Any, old: Any) -> Any:
    """Rows of ``new`` where the mask has them, of ``old`` elsewhere, if both are arrays of rows for each world."""
    if isinstance(new, Mapping):
        return {key: _where(mask, value, (old or {}).get(key)) for key, value in new.items()}
    alike = type(new) is type(old) and getattr(new, "shape", None) == getattr(old, "shape", ())
    if not alike or type(new) is not type(mask) or new.shape[:1] != mask.shape:
        return new
    merged = new.copy() if isinstance(new, np.ndarray) else new.clone()
    merged[~mask] = old[~mask]
    return merged


def _row(observations: Any, world: int) -> Any:
    if isinstance(observations, Mapping):
        return {key: _row(value, world) for key, value in observations.items()}
    if isinstance(observations, tuple):
        return tuple(_row(value, world) for value in observations)
    return observations[world]


def _batched(action: Any) -> Any:
    """Return the space of one world."""
    if isinstance(action, Mapping):
        return {key: _batched(value) for key, value in action.items()}
    if isinstance(action, tuple):
        return tuple(map(_batched, action))
    return action[None] if torch_interop.is_tensor(action) else np.asarray(action)[None]


def _info(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Return the first world's infos. A mask ``_key`` tells which worlds have a ``key``."""
    masks = {key: value for key, value in infos.items() if key.startswith("_") and key[1:] in infos}
    told = {}
    for key, value in infos.items():
        if key in masks or (f"_{key}" in masks and not masks[f"_{key}"][0]):
            continue
        if isinstance(value, Mapping):
            told[key] = _info(value)
        else:
            told[key] = value[0] if len(getattr(value, "shape", ())) > 0 else value
    return told


def _rows(observations: Any, mask: np.ndarray) -> np.ndarray:
    """An observation for each world that the mask has, None for the others: as gymnasium's own vector envs give it."""
    rows = np.full(len(mask), None, dtype=object)
    for world in np.flatnonzero(mask):
        rows[world] = _row(observations, int(world))
    return rows
