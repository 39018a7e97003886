"""Rays as Isaac Lab's sensor for Newton casts them: its kernel that moves rays, and Newton's query of the model's BVH.

``NewtonRaycastSensor`` refits the BVH of shapes, moves its rays by ``update_ray_caster_kernel``, and queries the BVH
with ``newton.intersect_ray`` for the ray's own world and that of all worlds, in a CUDA graph. So does this, without the
simulation around it. The sensor's first kernel, which makes its poses of bodies, and its last, which makes points of
distances, are left out: neither takes long.
"""

from typing import Any

import newton
import numpy as np
import torch
import warp as wp
from isaaclab.sensors.ray_caster import kernels

from warpcam.benchmarks.peers.newton_worlds import NewtonWorlds
from warpcam.benchmarks.problem import POSE_SETS, Problem

ALIGNMENTS = {"world": kernels.ALIGNMENT_WORLD, "yaw": kernels.ALIGNMENT_YAW, "base": kernels.ALIGNMENT_BASE}
MISS = -1.0


class Sensor:
    """One ray caster, in every world.

    Args:
        worlds: What rays meet.
        body: MuJoCo's index of the body that carries it.
        starts: (ray, 3) in its frame [m].
        directions: (ray, 3) unit.
        alignment: "base", "yaw" or "world".
        far: Greatest distance [m].
        ground: Rays meet what all worlds share, alone.
    """

    def __init__(
        self,
        worlds: NewtonWorlds,
        body: int,
        starts: torch.Tensor,
        directions: torch.Tensor,
        alignment: str,
        far: float,
        ground: bool,
    ):
        self._model, self._far, self._ground = worlds.model, far, ground
        count, self.num_rays = worlds.problem.worlds, len(directions)
        column, device = int(np.flatnonzero(worlds.built.moving == body)[0]), self._model.device
        shape, rays = (count, self.num_rays), count * self.num_rays
        self._poses = [
            wp.array(poses.numpy().reshape(count, -1, 7)[:, column], dtype=wp.transformf, device=device)
            for poses in worlds.bodies
        ]
        self._pose = wp.clone(self._poses[0])
        tables = [np.tile(table.cpu().numpy().astype(np.float32), (count, 1, 1)) for table in (starts, directions)]
        own = [wp.array(table, dtype=wp.vec3f, device=device) for table in tables]
        zeros = [wp.zeros(count, dtype=wp.vec3f, device=device) for _ in range(3)]
        identity = wp.full(count, wp.quat_identity(), dtype=wp.quatf, device=device)
        self._starts, self._directions = (wp.empty(shape, dtype=wp.vec3f, device=device) for _ in range(2))
        position, turn = wp.empty(count, dtype=wp.vec3f, device=device), wp.empty(count, dtype=wp.quatf, device=device)
        everything = wp.full(count, True, dtype=wp.bool, device=device)
        self._inputs = [
            self._pose,
            everything,
            zeros[0],
            identity,
            zeros[1],
            zeros[2],
            *own,
            int(ALIGNMENTS[alignment]),
        ]
        self._outputs, self._shape = [position, turn, self._starts, self._directions], shape
        numbers = np.full(rays, -1) if ground else np.repeat(np.arange(count), self.num_rays)
        self._worlds = wp.array(numbers.astype(np.int32), dtype=wp.int32, device=device)
        self._distances = wp.empty(rays, dtype=wp.float32, device=device)
        self._normals = wp.empty(rays, dtype=wp.vec3f, device=device)

    def place(self, index: int) -> None:
        wp.copy(self._pose, self._poses[index])

    def cast(self) -> None:
        wp.launch(kernels.update_ray_caster_kernel, self._shape, self._inputs, self._outputs, device=self._model.device)
        newton.intersect_ray(
            self._model,
            ray_origins=self._starts.flatten(),
            ray_directions=self._directions.flatten(),
            ray_worlds=self._worlds,
            enable_global_world=not self._ground,
            out_dist=self._distances,
            out_normal=self._normals,
        )

    @property
    def distances(self) -> torch.Tensor:
        """(world, ray) [m], -1 where nothing is met."""
        found = wp.to_torch(self._distances).view(self._shape)
        return torch.where(found > self._far, MISS, found)


class IsaacLab:
    """Sensors by mjlab's settings, on the same bodies and rays."""

    def __init__(self, shared: Problem, settings: dict[str, dict[str, Any]], device: str):
        self._worlds = NewtonWorlds(shared, fields_as_meshes=True)  # as Isaac Lab's terrains are
        model = self._worlds.model
        self.sensors, carriers = [], []
        for given in settings.values():
            body = shared.mjm.body(given["frame"].name).id
            starts, directions = given["pattern"].generate_rays(shared.mjm, device)
            ground = given.get("include_geom_groups") == (0,)
            alignment, far = given.get("ray_alignment", "base"), given["max_distance"]
            self.sensors.append(Sensor(self._worlds, body, starts, directions, alignment, far, ground))
            carriers += [] if ground else [body]
        # mjlab's and warpcam's rays do not meet the body that they start from.
        flags = model.shape_flags.numpy()
        flags[np.isin(shared.mjm.geom_bodyid[self._worlds.built.geoms], carriers)] = 0
        model.shape_flags.assign(flags)
        model.bvh_build_shapes(self._worlds.state, bvh_constructor="sah")
        self._cast()
        self._graph = None
        if model.device.is_cuda:
            with wp.ScopedCapture() as capture:
                self._cast()
            self._graph = capture.graph

    def place(self, index: int) -> None:
        self._worlds.place(index % POSE_SETS)
        for sensor in self.sensors:
            sensor.place(index % POSE_SETS)

    def read(self) -> None:
        if self._graph is None:
            self._cast()
        else:
            wp.capture_launch(self._graph)

    @property
    def distances(self) -> torch.Tensor:
        return torch.cat([sensor.distances for sensor in self.sensors], dim=1)

    def _cast(self) -> None:
        self._worlds.model.bvh_refit_shapes(self._worlds.state)
        for sensor in self.sensors:
            sensor.cast()
