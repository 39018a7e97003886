"""Bodies that are fixed to one another made one, with the inertia that they have together.

Newton 1.8 adds inertias up as if centres of mass lay at the bodies' origins, and makes a base that is held part of the
world, which no actor could be placed or known by.
"""

import warnings
from collections.abc import Sequence
from typing import Any

import newton
import numpy as np
import warp as wp


class Builder(newton.ModelBuilder):
    """Newton's, whose importers call this where fixed joints are to be collapsed."""

    def collapse_fixed_joints(
        self, verbose: bool = False, joints_to_keep: Sequence[str | int] | None = None
    ) -> dict[str, Any]:
        masses = np.array(self.body_mass, np.float64)
        centers = np.array([tuple(center) for center in self.body_com], np.float64).reshape(-1, 3)
        inertias = np.array([tuple(inertia) for inertia in self.body_inertia], np.float64).reshape(-1, 3, 3)
        holds = [
            joint
            for joint, (kind, parent) in enumerate(zip(self.joint_type, self.joint_parent, strict=True))
            if kind == newton.JointType.FIXED and parent < 0
        ]
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Skipped joint")  # a base that is held may weigh nothing
            found = super().collapse_fixed_joints(verbose, [*(joints_to_keep or ()), *holds])
        parts: dict[int, list[int]] = {}
        for body, kept in found["body_merged_parent"].items():
            parts.setdefault(kept, [kept]).append(body)
        for kept, bodies in parts.items():
            if masses[bodies].sum() > 0.0:
                poses = [found["body_merged_transform"].get(body, wp.transform()) for body in bodies]
                turns = [np.array(wp.quat_to_matrix(pose.q), np.float64).reshape(3, 3) for pose in poses]
                places = [turn @ centers[body] + pose.p for turn, body, pose in zip(turns, bodies, poses, strict=True)]
                turned = [turn @ inertias[body] @ turn.T for turn, body in zip(turns, bodies, strict=True)]
                self._set_inertia(found["body_remap"][kept], masses[bodies], np.array(places), np.array(turned))
        return found

    def _set_inertia(self, body: int, masses: np.ndarray, centers: np.ndarray, inertias: np.ndarray) -> None:
        """Set the inertia of several parts, along the body's axes, each about its own centre."""
        center = masses @ centers / masses.sum()
        levers = centers - center
        squares = (levers * levers).sum(axis=1)[:, None, None] * np.eye(3) - levers[:, :, None] * levers[:, None]
        inertia = (inertias + masses[:, None, None] * squares).sum(axis=0)
        self.body_com[body] = wp.vec3(*center)
        self.body_inertia[body] = wp.mat33(*inertia.reshape(-1))
        regular = np.linalg.matrix_rank(inertia) == 3
        self.body_inv_inertia[body] = wp.mat33(*(np.linalg.inv(inertia) if regular else np.zeros((3, 3))).reshape(-1))
