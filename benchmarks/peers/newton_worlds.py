"""A problem's worlds as Newton keeps them, and the sets of poses that they move through."""

from typing import Any

import newton
import numpy as np
import warp as wp

from warpcam.benchmarks.peers.newton_model import build_model
from warpcam.benchmarks.problem import POSE_SETS, Problem

MISSED = 0xFFFFFFFF
CLOTH = 0xFFFFFFFD  # what Newton's camera calls any deformable surface
CLOTH_ID = -3  # in images that are compared


class NewtonWorlds:
    """The model, and a state that `place` moves: each set is turned into Newton's form beforehand."""

    def __init__(self, problem: Problem, fields_as_meshes: bool = False) -> None:
        self.problem = problem
        self.built = build_model(problem, fields_as_meshes)
        self.model: newton.Model = self.built.model
        self.state = self.model.state()
        self.bodies = [self._body_poses(index) for index in range(POSE_SETS)]
        self.cloths = [self._waved(index) for index in range(POSE_SETS)] if self.model.particle_count else []

    def place(self, index: int) -> None:
        if len(self.built.moving):
            wp.copy(self.state.body_q, self.bodies[index])
        if self.cloths:
            wp.copy(self.state.particle_q, self.cloths[index])

    def ids(self, shapes: np.ndarray) -> np.ndarray:
        """Geom ids of what Newton's camera or ours tells, CLOTH_ID for cloth, -1 for a miss."""
        shapes = shapes.astype(np.int64) & 0xFFFFFFFF
        known = shapes < len(self.built.geoms)
        other = np.where(shapes == CLOTH, CLOTH_ID, -1)
        return np.where(known, self.built.geoms[np.where(known, shapes, 0)], other)

    def _body_poses(self, index: int) -> wp.array:
        poses, moving = self.problem.poses[index], self.built.moving
        positions, rotations = poses["xpos"].numpy()[:, moving], poses["xquat"].numpy()[:, moving]
        both = np.concatenate([positions, rotations[..., [1, 2, 3, 0]]], axis=-1).reshape(-1, 7)
        return wp.array(both.astype(np.float32), dtype=wp.transformf)

    def _waved(self, index: int) -> wp.array:
        """Particles moved up and down by waves, other ones in each world."""
        start: Any = self.model.particle_q
        moved = wp.empty_like(start)
        particles = self.model.particle_count // self.problem.worlds
        wp.launch(wave, len(start), inputs=[start, particles, 0.7 * index], outputs=[moved])
        return moved


@wp.kernel(enable_backward=False)  # type: ignore[untyped-decorator]
def wave(start: wp.array[wp.vec3], particles: wp.int32, time: wp.float32, moved: wp.array[wp.vec3]) -> None:
    index = wp.tid()
    place, phase = start[index], 1.7 * wp.float32(index // particles) + time
    rise = 0.07 * wp.sin(6.0 * place[0] + phase) + 0.05 * wp.cos(9.0 * place[1] - 1.3 * phase)
    moved[index] = place + wp.vec3(0.0, 0.0, rise)
