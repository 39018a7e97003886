"""Forces of a program's own on bodies, for one step."""

from collections.abc import Sequence
from typing import Any

import newton
import numpy as np
import warp as wp

from warpcam.compat.isaacgym.api.enums import CoordinateSpace
from warpcam.compat.isaacgym.api.math_types import Vec3
from warpcam.compat.isaacgym.api.tensors import take
from warpcam.compat.isaacgym.kernels import forces as kernels
from warpcam.compat.isaacgym.kernels.state import launch
from warpcam.compat.isaacgym.physics.environments import Env

SPACES = {
    CoordinateSpace.ENV_SPACE: kernels.ENVIRONMENT,
    CoordinateSpace.LOCAL_SPACE: kernels.LOCAL,
    CoordinateSpace.GLOBAL_SPACE: kernels.GLOBAL,
}


class AppliedForces:
    """What is to be added to the forces on a model's bodies in the next step.

    Args:
        model: What is simulated.
        envs: All environments.
    """

    def __init__(self, model: newton.Model, envs: Sequence[Env]):
        self._model, self._any = model, False
        device, count = model.device, model.body_count
        self._sum = wp.zeros(count, dtype=wp.spatial_vector, device=device)
        self._none = wp.zeros((count, 3), dtype=wp.float32, device=device)
        self._nowhere = wp.zeros((0, 3), dtype=wp.float32, device=device)
        self._all = wp.array(np.arange(count, dtype=np.int32), dtype=wp.int32, device=device)
        origins = np.repeat([tuple(env.origin) for env in envs], [env.counts.bodies for env in envs], axis=0)
        self._origins = wp.array(origins.astype(np.float32), dtype=wp.vec3, device=device)

    def add(self, state: newton.State, space: CoordinateSpace, where: str, **given: Any) -> None:
        """Of all bodies: ``forces``, ``torques`` and ``places``, descriptions of (body, 3), or None."""
        shape = (self._model.body_count, 3)
        arrays = {
            name: take(value, f"{where}: {name}", wp.float32, shape, self._model.device)
            for name, value in given.items()
            if value is not None
        }
        self._launch(state, space, self._all, arrays)

    def add_one(self, state: newton.State, space: CoordinateSpace, body: int, **given: Vec3 | None) -> None:
        """Of one body, the model's."""
        device = self._model.device
        arrays = {
            name: wp.array([tuple(value)], dtype=wp.float32, device=device)
            for name, value in given.items()
            if value is not None
        }
        self._launch(state, space, self._all[body : body + 1], arrays)

    def put(self, forces: wp.array) -> None:
        """Write them as forces on bodies; those that were there are gone."""
        if self._any:
            wp.copy(forces, self._sum)

    def clear(self) -> None:
        if self._any:
            self._sum.zero_()
            self._any = False

    def _launch(
        self, state: newton.State, space: CoordinateSpace, bodies: wp.array, given: dict[str, wp.array]
    ) -> None:
        model, none = self._model, self._none
        vectors = [given.get("forces", none), given.get("torques", none), given.get("places", self._nowhere)]
        inputs = [state.body_q, model.body_com, bodies, self._origins, *vectors, SPACES[space], self._sum]
        launch(kernels.add_pushes, len(bodies), inputs, model.device)
        self._any = True
