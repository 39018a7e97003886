"""Isaac Gym's programs in small."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
import warp as wp

from warpcam.compat.isaacgym import gymapi, gymtorch

GYM = gymapi.acquire_gym()
WIDTH, HEIGHT = 32, 24
KINDS = (gymapi.IMAGE_COLOR, gymapi.IMAGE_DEPTH, gymapi.IMAGE_SEGMENTATION)


@dataclass
class World:
    """A simulation, its environments, and one camera of each with tensors of its images."""

    sim: gymapi.Sim
    envs: list[gymapi.Env] = field(default_factory=list)
    actors: list[int] = field(default_factory=list)
    cameras: list[int] = field(default_factory=list)
    tensors: list[dict[Any, torch.Tensor]] = field(default_factory=list)

    def render(self) -> None:
        GYM.step_graphics(self.sim)
        GYM.render_all_camera_sensors(self.sim)

    def image(self, env: int, kind: Any) -> np.ndarray:
        return self.tensors[env][kind].cpu().numpy()


def ordinal(device: wp.Device) -> int:
    return device.ordinal if device.is_cuda else -1


def new_sim(device: wp.Device, *, up: Any = gymapi.UP_AXIS_Z, **changes: Any) -> gymapi.Sim:
    params = gymapi.SimParams(**{"up_axis": up, "use_gpu_pipeline": device.is_cuda, **changes})
    params.gravity = gymapi.Vec3(0, 0, -9.81) if up == gymapi.UP_AXIS_Z else gymapi.Vec3(0, -9.81, 0)
    return GYM.create_sim(ordinal(device), ordinal(device), gymapi.SIM_PHYSX, params)


def props(**changes: Any) -> gymapi.CameraProperties:
    return gymapi.CameraProperties(**{"width": WIDTH, "height": HEIGHT, "enable_tensors": True, **changes})


def at(x: float, y: float, z: float) -> gymapi.Transform:
    return gymapi.Transform(p=gymapi.Vec3(x, y, z))


def wrapped(tensor: gymapi.Tensor) -> torch.Tensor:
    return gymtorch.wrap_tensor(tensor)


def tensors_of(sim: gymapi.Sim, env: gymapi.Env, camera: int, kinds: Any = KINDS) -> dict[Any, torch.Tensor]:
    return {kind: gymtorch.wrap_tensor(GYM.get_camera_image_gpu_tensor(sim, env, camera, kind)) for kind in kinds}


def walls(
    device: wp.Device, count: int = 3, *, fixed: bool = True, spacing: float = 1.0, tensors: bool = True, **changes: Any
) -> World:
    """In front of the camera, which looks along x, a wall whose face is 2 m away, by 0.1 m more in each environment.

    ``tensors`` are requested before the first render.
    """
    world = World(new_sim(device))
    wall = GYM.create_box(world.sim, 1.0, 10.0, 10.0, gymapi.AssetOptions(fix_base_link=fixed, disable_gravity=True))
    for index in range(count):
        env = GYM.create_env(world.sim, gymapi.Vec3(-spacing, -spacing, 0), gymapi.Vec3(spacing, spacing, spacing), 2)
        world.envs.append(env)
        world.actors.append(GYM.create_actor(env, wall, at(2.5 + 0.1 * index, 0, 0), "wall", index, 0, 7 + index))
        camera = GYM.create_camera_sensor(env, props(**changes))
        GYM.set_camera_location(camera, env, gymapi.Vec3(0, 0, 0), gymapi.Vec3(1, 0, 0))
        world.cameras.append(camera)
        if tensors and changes.get("enable_tensors", True):
            world.tensors.append(tensors_of(world.sim, env, camera))
    GYM.prepare_sim(world.sim)
    return world
