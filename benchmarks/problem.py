"""What all renderers of a case share: the model, its worlds on the device, and two sets of poses."""

from dataclasses import dataclass, field

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from cases import Case, compile_case

POSE_SETS = 2


@dataclass
class Problem:
    """A scene in many worlds, each in poses of its own, and the images that are wanted of it."""

    mjm: mujoco.MjModel
    m: mjw.Model
    d: mjw.Data
    cameras: tuple[str, ...]
    worlds: int
    width: int
    height: int
    scatter: tuple[float, float]  # see Case
    poses: dict[int, np.ndarray] = field(default_factory=dict)  # joint positions (world, nq) of each set used so far

    @property
    def camera_ids(self) -> list[int]:
        return [self.mjm.camera(name).id for name in self.cameras]

    @property
    def rays(self) -> int:
        """Rays in one frame, one a pixel."""
        return self.worlds * len(self.cameras) * self.width * self.height

    def drawn_geoms(self) -> np.ndarray:
        """Ids of the geoms all renderers draw: groups 0 to 2 that are not wholly transparent."""
        alpha = self.mjm.geom_rgba[:, 3].copy()
        with_material = (self.mjm.geom_matid >= 0) & (self.mjm.geom_rgba == (0.5, 0.5, 0.5, 1.0)).all(axis=1)
        alpha[with_material] = self.mjm.mat_rgba[self.mjm.geom_matid[with_material], 3]
        return np.flatnonzero((self.mjm.geom_group <= 2) & (alpha > 0.0))

    def set_poses(self, index: int) -> None:
        """Put every world into its pose of this set and bring geoms and cameras there."""
        if index not in self.poses:
            self.poses[index] = random_poses(self.mjm, self.worlds, self.scatter, seed=index)
        self.d.qpos.assign(self.poses[index])
        mjw.kinematics(self.m, self.d)
        mjw.com_pos(self.m, self.d)
        mjw.camlight(self.m, self.d)
        wp.synchronize_device(self.d.qpos.device)


def build(case: Case, worlds: int, width: int, height: int) -> Problem:
    mjm = compile_case(case)
    m = mjw.put_model(mjm)
    # Nothing is simulated: room for contacts and constraints would only take memory.
    d = mjw.make_data(mjm, nworld=worlds, naconmax=1, naccdmax=1, njmax=1)
    return Problem(mjm, m, d, case.cameras, worlds, width, height, case.scatter)


def random_poses(mjm: mujoco.MjModel, worlds: int, scatter: tuple[float, float], seed: int) -> np.ndarray:
    """Joint positions (world, nq) float32 around `qpos0`.

    Joints with a range move over half of it, others by 0.5 rad or 5 cm; free bodies by `scatter`.
    """
    random = np.random.default_rng(seed)
    qpos = np.tile(mjm.qpos0.astype(np.float32), (worlds, 1))
    for joint in range(mjm.njnt):
        start, kind = mjm.jnt_qposadr[joint], mjm.jnt_type[joint]
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            position, rotation = slice(start, start + 3), slice(start + 3, start + 7)
            qpos[:, position] += scatter[0] * random.uniform(-1.0, 1.0, (worlds, 3))
            qpos[:, rotation] = rotated(qpos[:, rotation], scatter[1] * random.uniform(-1.0, 1.0, (worlds, 3)))
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            rotation = slice(start, start + 4)
            qpos[:, rotation] = rotated(qpos[:, rotation], random.uniform(-0.5, 0.5, (worlds, 3)))
        else:
            amount = 0.5 if kind == mujoco.mjtJoint.mjJNT_HINGE else 0.05
            low, high = qpos[0, start] - amount, qpos[0, start] + amount
            if mjm.jnt_limited[joint]:
                low, high = 0.5 * (qpos[0, start] + mjm.jnt_range[joint])
            qpos[:, start] = random.uniform(low, high, worlds)
    return qpos


def rotated(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) wxyz turned by rotation vectors (n, 3) [rad]."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    axis = vectors / np.maximum(angle, 1e-9)
    w, v = quaternions[:, :1], quaternions[:, 1:]
    c, s = np.cos(0.5 * angle), np.sin(0.5 * angle) * axis
    return np.concatenate([w * c - (v * s).sum(1, keepdims=True), w * s + c * v + np.cross(v, s)], axis=1)
