"""Poses of geoms, sites, cameras and lights from those of bodies, as MuJoCo's ``mj_kinematics`` and ``mj_camlight``."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import mujoco
import numpy as np

from warpcam.core.errors import WarpcamError

Arrays = Mapping[str, Any]
MODE = mujoco.mjtCamLight
KINDS = {"geom_": "geom", "site_": "site", "cam_": "cam", "light_": "light"}


def rotation_matrix(quaternions: Any) -> Any:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) w x y z of any length."""
    w, x, y, z = jnp.moveaxis(quaternions / jnp.linalg.norm(quaternions, axis=-1, keepdims=True), -1, 0)
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def pose_of(name: str, mjm: mujoco.MjModel, state: Arrays, fields: Arrays) -> Any:
    """The array of that name, computed from those of bodies if the state lacks it.

    Args:
        name: MuJoCo's: ``geom_xpos``, ``light_xdir``, ``xmat`` and the like.
        mjm: The host's model.
        state: What there is: ``xpos`` (..., body, 3) [m], ``xquat`` (..., body, 4) w x y z or ``xmat``, and
            ``subtree_com`` where something follows a centre of mass.
        fields: The model's own values, (row, ...) or (..., row, ...), where they differ from the host's.

    Returns:
        (..., row, 3) or (..., row, 3, 3); None if it does not follow from bodies.
    """
    if name in state:
        return state[name]
    if name == "xmat":
        return rotation_matrix(state["xquat"]) if "xquat" in state else None
    kind = KINDS.get(name[: name.find("_") + 1])
    if kind is None or "xpos" not in state:
        return None
    rotations = pose_of("xmat", mjm, state, fields)
    if rotations is None:
        return None
    frames = _Frames(kind, mjm, {**state, "xmat": rotations}, fields)
    if kind == "light":
        return frames.light_positions() if name.endswith("xpos") else frames.light_directions()
    if kind == "cam":
        return frames.camera_positions() if name.endswith("xpos") else frames.camera_rotations()
    return frames.positions() if name.endswith("xpos") else frames.rotations()


class _Frames:
    """Frames that are fixed to bodies, or follow them."""

    def __init__(self, kind: str, mjm: mujoco.MjModel, state: Arrays, fields: Arrays):
        self._kind, self._mjm, self._state, self._fields = kind, mjm, state, fields
        self._bodies = np.asarray(getattr(mjm, f"{kind}_bodyid"))
        if kind in ("cam", "light"):
            self._targets = np.asarray(getattr(mjm, f"{kind}_targetbodyid"))
            looks = (MODE.mjCAMLIGHT_TARGETBODY, MODE.mjCAMLIGHT_TARGETBODYCOM)
            modes = np.asarray(getattr(mjm, f"{kind}_mode"))
            aimless = np.isin(modes, [int(mode) for mode in looks]) & (self._targets < 0)
            self._modes = np.where(aimless, int(MODE.mjCAMLIGHT_FIXED), modes)

    def positions(self) -> Any:
        local = self._field("pos")
        return self._of_bodies("xpos") + (self._of_bodies("xmat") @ local[..., None])[..., 0]

    def rotations(self) -> Any:
        return self._of_bodies("xmat") @ rotation_matrix(self._field("quat"))

    def camera_positions(self) -> Any:
        return self._followed(self.positions())

    def camera_rotations(self) -> Any:
        track, look = MODE.mjCAMLIGHT_TRACK, MODE.mjCAMLIGHT_TARGETBODY
        kept = self._is(track, MODE.mjCAMLIGHT_TRACKCOM)
        rotations = self.rotations()
        if kept.any():
            rotations = jnp.where(kept[:, None, None], self._mat0(), rotations)
        aimed = self._is(look, MODE.mjCAMLIGHT_TARGETBODYCOM)
        if aimed.any():
            back = _unit(self.camera_positions() - self._aims())
            right = _unit(jnp.cross(jnp.array([0.0, 0.0, 1.0]), back))
            frame = jnp.stack([right, _unit(jnp.cross(back, right)), back], axis=-1)
            rotations = jnp.where(aimed[:, None, None], frame, rotations)
        return rotations

    def _mat0(self) -> Any:
        """The host keeps 9 numbers of each, MJX 3 rows of 3."""
        matrices = self._field("mat0")
        return matrices.reshape(*matrices.shape[:-1], 3, 3) if matrices.shape[-1] == 9 else matrices

    def light_positions(self) -> Any:
        return self._followed(self.positions())

    def light_directions(self) -> Any:
        directions = (self._of_bodies("xmat") @ self._field("dir")[..., None])[..., 0]
        kept = self._is(MODE.mjCAMLIGHT_TRACK, MODE.mjCAMLIGHT_TRACKCOM)
        if kept.any():
            directions = jnp.where(kept[:, None], self._field("dir0"), directions)
        aimed = self._is(MODE.mjCAMLIGHT_TARGETBODY, MODE.mjCAMLIGHT_TARGETBODYCOM)
        if aimed.any():
            directions = jnp.where(aimed[:, None], self._aims() - self.light_positions(), directions)
        return _unit(directions)

    def _followed(self, fixed: Any) -> Any:
        tracks, centres = self._is(MODE.mjCAMLIGHT_TRACK), self._is(MODE.mjCAMLIGHT_TRACKCOM)
        if tracks.any():
            fixed = jnp.where(tracks[:, None], self._of_bodies("xpos") + self._field("pos0"), fixed)
        if centres.any():
            fixed = jnp.where(centres[:, None], self._centres(self._bodies) + self._field("poscom0"), fixed)
        return fixed

    def _aims(self) -> Any:
        aims = self._state["xpos"][..., self._targets, :]
        centres = self._is(MODE.mjCAMLIGHT_TARGETBODYCOM)
        return jnp.where(centres[:, None], self._centres(self._targets), aims) if centres.any() else aims

    def _centres(self, bodies: np.ndarray) -> Any:
        if "subtree_com" not in self._state:
            what = {"cam": "a camera", "light": "a light"}[self._kind]
            raise WarpcamError(f"render: {what} follows a centre of mass, and data has no subtree_com")
        return self._state["subtree_com"][..., bodies, :]

    def _is(self, *modes: Any) -> np.ndarray:
        return np.isin(self._modes, [int(mode) for mode in modes])

    def _of_bodies(self, name: str) -> Any:
        axis = -3 if name == "xmat" else -2
        return jnp.take(self._state[name], self._bodies, axis=axis)

    def _field(self, name: str) -> Any:
        full = f"{self._kind}_{name}"
        return jnp.asarray(self._fields.get(full, getattr(self._mjm, full)), jnp.float32)


def _unit(vectors: Any) -> Any:
    """Vectors (..., 3) of length 1; what has no length points to x, as ``mju_normalize3`` has it."""
    lengths = jnp.linalg.norm(vectors, axis=-1, keepdims=True)
    return jnp.where(lengths < 1e-15, jnp.array([1.0, 0.0, 0.0]), vectors / jnp.where(lengths < 1e-15, 1.0, lengths))
