"""Jacobians and mass matrices of actors, as Newton makes them of its articulations."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import newton
import numpy as np
import warp as wp

from warpcam.compat.isaacgym.kernels import forces as kernels
from warpcam.compat.isaacgym.kernels.state import launch
from warpcam.compat.isaacgym.physics.environments import Actor, Counts
from warpcam.core.errors import WarpcamError


@dataclass(frozen=True)
class ArticulationTrees:
    """Actors of one name.

    Attributes:
        chosen: (articulation,) bool, whether it is one of them.
        articulations: (actor,) int32.
        links: (link,) int32, places among an articulation's joints of those that move the links.
        speeds: Degrees of freedom of each, with the six of a base that floats, which come first.
    """

    chosen: wp.array
    articulations: wp.array
    links: wp.array
    speeds: int


class JacobianArrays:
    """Of the actors of a model, both along the world's axes and about bodies' centres of mass.

    Args:
        model: What is simulated.
        actors: All of them.
        start_of: What is before one.
    """

    def __init__(self, model: newton.Model, actors: Sequence[Actor], start_of: Callable[[Actor], Counts]):
        self._model, self._actors, self._start_of = model, actors, start_of
        self._trees: dict[str, ArticulationTrees] = {}
        self._scratch: dict[str, wp.array] = {}

    def jacobians(self, name: str) -> tuple[tuple[int, ...], Callable[[newton.State, wp.array], None]]:
        """Shape (actor, link, 6, speed), and what fills it: velocities of links by those of joints.

        Linear above angular; without the base where it is fixed.
        """
        trees = self._of(name, "acquire_jacobian_tensor")
        model = self._model
        rows = 6 * model.max_joints_per_articulation
        full = self._room("jacobians", (model.articulation_count, rows, model.max_dofs_per_articulation), wp.float32)
        axes = self._room("axes", (model.joint_dof_count,), wp.spatial_vector)

        def read(state: newton.State, out: wp.array) -> None:
            newton.eval_jacobian(model, state, full, axes, trees.chosen)
            inputs = [full, trees.articulations, trees.links, out]
            launch(kernels.gather_jacobians, out.shape, inputs, model.device)

        return (len(trees.articulations), len(trees.links), 6, trees.speeds), read

    def masses(self, name: str) -> tuple[tuple[int, ...], Callable[[newton.State, wp.array], None]]:
        """Shape (actor, speed, speed), and what fills it; armature counts."""
        trees = self._of(name, "acquire_mass_matrix_tensor")
        model, size = self._model, self._model.max_dofs_per_articulation
        full = self._room("masses", (model.articulation_count, size, size), wp.float32)
        inertias = self._room("inertias", (model.body_count,), wp.spatial_matrix)
        axes = self._room("axes", (model.joint_dof_count,), wp.spatial_vector)

        def read(state: newton.State, out: wp.array) -> None:
            newton.eval_mass_matrix(model, state, full, body_I_s=inertias, joint_S_s=axes, mask=trees.chosen)
            launch(kernels.gather_masses, out.shape, [full, trees.articulations, out], model.device)

        return (len(trees.articulations), trees.speeds, trees.speeds), read

    def _room(self, name: str, shape: tuple[int, ...], dtype: type) -> wp.array:
        """Memory that is there from the first request on."""
        if name not in self._scratch:
            self._scratch[name] = wp.zeros(shape, dtype=dtype, device=self._model.device)
        return self._scratch[name]

    def _of(self, name: str, where: str) -> ArticulationTrees:
        if name not in self._trees:
            self._trees[name] = self._find(name, where)
        return self._trees[name]

    def _find(self, name: str, where: str) -> ArticulationTrees:
        actors = [actor for actor in self._actors if actor.name == name]
        if not actors:
            known = ", ".join(sorted({repr(actor.name) for actor in self._actors}))
            raise WarpcamError(f"{where}: there is no actor {name!r}; there are {known or 'none'}")
        asset = actors[0].asset
        if any(actor.asset is not asset for actor in actors):
            raise WarpcamError(f"{where}: actors {name!r} are made of several assets; their matrices differ")
        builder = asset.builder
        if builder.articulation_count != 1 or builder.articulation_start[0] != 0:
            raise WarpcamError(f"{where}: actor {name!r} is not one tree of joints")
        firsts = self._model.articulation_start.numpy()
        found = np.searchsorted(firsts, [self._start_of(actor).joints for actor in actors])
        chosen = np.zeros(self._model.articulation_count, bool)
        chosen[found] = True
        joints = {body: joint for joint, body in reversed(list(enumerate(builder.joint_child)))}
        links = [joints[body] for body in range(builder.body_count)]
        if builder.joint_type[0] == newton.JointType.FIXED:
            links = [joint for joint in links if joint]
        device = self._model.device
        return ArticulationTrees(
            wp.array(chosen, dtype=wp.bool, device=device),
            wp.array(found.astype(np.int32), dtype=wp.int32, device=device),
            wp.array(np.array(links, np.int32), dtype=wp.int32, device=device),
            builder.joint_dof_count,
        )
