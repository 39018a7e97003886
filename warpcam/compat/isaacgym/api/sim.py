"""Calls about the simulation as a whole, its environments and its ground."""

from copy import deepcopy
from typing import Any

import newton
import warp as wp

from warpcam.compat.common.scalars import whole
from warpcam.compat.isaacgym.api.enums import SimType, one_of
from warpcam.compat.isaacgym.api.math_types import Vec3
from warpcam.compat.isaacgym.api.params import HeightFieldParams, PlaneParams, SimParams, TriangleMeshParams, Version
from warpcam.compat.isaacgym.physics.environments import Env, handle_of
from warpcam.compat.isaacgym.physics.simulation import Sim, env_of, sim_of
from warpcam.compat.isaacgym.terrain.terrain import of_heights, of_triangles
from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError


class SimCalls:
    """See ``Gym``."""

    def get_version(self) -> Version:
        """The version of Isaac Gym whose calls these are: of Preview 4."""
        return Version(major=1, minor=0)

    def create_sim(
        self,
        compute_device: int = 0,
        graphics_device: int = 0,
        type: Any = SimType.SIM_PHYSX,
        params: SimParams | None = None,
        *,
        quirks: bool = False,
    ) -> Sim:
        """An empty simulation.

        Args:
            compute_device: CUDA ordinal, as Warp and torch count, of the GPU that all of it is on, its images too;
                -1 is the CPU. Without a GPU, and without ``use_gpu_pipeline``, the CPU is taken.
            graphics_device: The same, or -1: there is no graphics.
            type: Both kinds are simulated by Newton.
            params: None is the defaults.
            quirks: Whether ``get_camera_transform`` errs as Isaac Gym's does.
        """
        params = SimParams() if params is None else params
        if not isinstance(params, SimParams):
            raise WarpcamError(f"create_sim: params must be SimParams, got {params.__class__.__name__}")
        one_of(SimType, type, "create_sim: type")
        return Sim(_device(compute_device, graphics_device, params.use_gpu_pipeline), params, quirks)

    def destroy_sim(self, sim: Sim) -> None:
        sim = sim_of(sim, "destroy_sim")
        sim.alive = False
        sim.envs, sim._physics = [], None
        del sim.camera_batches

    def get_sim_params(self, sim: Sim) -> SimParams:
        """A copy."""
        return deepcopy(sim_of(sim, "get_sim_params").params)

    def set_sim_params(self, sim: Sim, params: SimParams) -> None:
        """Step, substeps and gravity from the next step on; the rest is held, which way is up stays."""
        sim = sim_of(sim, "set_sim_params")
        if not isinstance(params, SimParams):
            raise WarpcamError(f"set_sim_params: SimParams are needed, got {type(params).__name__}")
        sim.change(params)

    def get_sim_time(self, sim: Sim) -> float:
        """Simulated since the beginning [s]."""
        return sim_of(sim, "get_sim_time").time

    def get_elapsed_time(self, sim: Sim) -> float:
        return sim_of(sim, "get_elapsed_time").time

    def get_frame_count(self, sim: Sim) -> int:
        """Return the number of calls of ``simulate``."""
        return sim_of(sim, "get_frame_count").steps

    def prepare_sim(self, sim: Sim) -> bool:
        """Build it all. What needs it does so by itself."""
        return sim_of(sim, "prepare_sim").physics is not None

    def simulate(self, sim: Sim) -> None:
        """Move on by ``params.dt``."""
        sim = sim_of(sim, "simulate")
        sim.physics.simulate(float(sim.params.dt), max(int(sim.params.substeps), 1))
        sim.time, sim.steps = sim.time + float(sim.params.dt), sim.steps + 1
        sim.fetched = sim.shown = False

    def fetch_results(self, sim: Sim, wait: bool = True) -> None:
        """Have the results of ``simulate``: what reads them is in order with it, and nothing is waited for."""
        sim_of(sim, "fetch_results").fetched = True

    def add_ground(self, sim: Sim, params: PlaneParams) -> None:
        """An endless plane."""
        sim = sim_of(sim, "add_ground")
        sim.require_open("add_ground")
        if not isinstance(params, PlaneParams):
            raise WarpcamError(f"add_ground: PlaneParams are needed, got {type(params).__name__}")
        sim.grounds.planes.append(params)

    def add_triangle_mesh(self, sim: Sim, vertices: Any, triangles: Any, params: TriangleMeshParams) -> None:
        """A terrain. Where z is up it is collided with as seen from above, else, and where it is convex, as its hull.

        Args:
            sim: The simulation.
            vertices: (3 n,) or (n, 3) [m].
            triangles: (3 n,) or (n, 3), vertices of each.
            params: Where it stands; the numbers of vertices and triangles are not needed.
        """
        sim = sim_of(sim, "add_triangle_mesh")
        sim.require_open("add_triangle_mesh")
        if not isinstance(params, TriangleMeshParams):
            raise WarpcamError(f"add_triangle_mesh: TriangleMeshParams are needed, got {type(params).__name__}")
        terrain = of_triangles(vertices, triangles, params, sim.up == newton.Axis.Z)
        if terrain.told:
            sim.warn_once(f"add_triangle_mesh: {terrain.told}")
        sim.grounds.terrains.append(terrain)

    def add_heightfield(self, sim: Sim, samples: Any, params: HeightFieldParams) -> None:
        """A terrain of heights, where z is up. Column and row of a sample are its places along x and y.

        Args:
            sim: The simulation.
            samples: (column, row) or (nbColumns * nbRows,) int16, in units of ``vertical_scale``: an array's slower
                index in memory is along x. An array of two dimensions may have its rows along x instead, (row, column).
            params: Its sizes, and where its first sample stands.
        """
        sim = sim_of(sim, "add_heightfield")
        sim.require_open("add_heightfield")
        if sim.up != newton.Axis.Z:
            raise WarpcamError("add_heightfield: z must be up; where y is, add_triangle_mesh draws any terrain")
        if not isinstance(params, HeightFieldParams):
            raise WarpcamError(f"add_heightfield: HeightFieldParams are needed, got {type(params).__name__}")
        sim.grounds.terrains.append(of_heights(samples, params))

    def create_env(self, sim: Sim, lower: Vec3, upper: Vec3, num_per_row: int) -> Env:
        """A world of its own. The corners say how far apart the origins of two are, where any frame has both."""
        sim = sim_of(sim, "create_env")
        sim.require_open("create_env")
        for name, corner in (("lower", lower), ("upper", upper)):
            if not isinstance(corner, Vec3):
                raise WarpcamError(f"create_env: {name} must be a Vec3, got {corner.__class__.__name__}")
        per_row = whole(num_per_row)
        if per_row is None:
            raise WarpcamError(f"create_env: num_per_row must be a whole number, got {num_per_row!r}")
        index, per_row = len(sim.envs), max(per_row, 1)
        size, row, column = upper - lower, index // per_row, index % per_row
        if sim.up == newton.Axis.Z:
            origin = Vec3(column * size.x, row * size.y, 0.0)
        else:
            origin = Vec3(column * size.x, 0.0, row * size.z)
        env = Env(sim, index, origin)
        sim.envs.append(env)
        return env

    def get_env(self, sim: Sim, index: int) -> Env:
        envs = sim_of(sim, "get_env").envs
        place = handle_of(index, len(envs))
        if place is None:
            raise WarpcamError(f"get_env: environment {index!r} came, there are 0 to {len(envs) - 1}")
        return envs[place]

    def get_env_count(self, sim: Sim) -> int:
        return len(sim_of(sim, "get_env_count").envs)

    def get_env_origin(self, env: Env) -> Vec3:
        return Vec3(*env_of(env, "get_env_origin").origin)

    def begin_aggregate(self, env: Env, max_bodies: int, max_shapes: int, enable_self_collisions: bool) -> bool:
        """Nothing is to be done; what is not to collide is for ``create_actor`` to say."""
        env = env_of(env, "begin_aggregate")
        if not enable_self_collisions:
            env.sim.warn_once(
                "begin_aggregate: actors of an aggregate collide all the same; filter of create_actor keeps them apart"
            )
        return True

    def end_aggregate(self, env: Env) -> bool:
        """Nothing is to be done."""
        env_of(env, "end_aggregate")
        return True


def _device(compute: int, graphics: int, on_gpu: bool) -> wp.Device:
    """The one device that all is on."""
    for name, value in (("compute_device", compute), ("graphics_device", graphics)):
        if whole(value) is None:
            raise WarpcamError(f"create_sim: {name} must be a CUDA ordinal, or -1, got {value!r}")
    there = wp.get_cuda_devices()
    known = ", ".join(device.alias for device in there) or "none"
    if compute < 0 or (not there and not on_gpu):
        if on_gpu:
            raise WarpcamError(
                f"create_sim: use_gpu_pipeline is set, but compute_device is {compute}; there are the GPUs: {known}"
            )
        return wp.get_device("cpu")
    if compute >= len(there):
        raise WarpcamError(f"create_sim: compute_device {compute} came; there are the GPUs: {known}")
    if graphics not in (-1, compute):
        raise WarpcamError(
            f"create_sim: graphics_device is cuda:{graphics} and compute_device cuda:{compute}; images are made where "
            f"the simulation is: give {compute} for both, or -1 for graphics"
        )
    return device_rule.resolve(there[compute])
