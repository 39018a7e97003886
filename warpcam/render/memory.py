"""Memory that a renderer takes of its device, computed before any of it is allocated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import warp as wp

from warpcam.camera.camera import Camera
from warpcam.core.device import free_bytes
from warpcam.core.errors import OutOfMemoryError, WarpcamError
from warpcam.kernels.layers import Mirror
from warpcam.kernels.plan.frame import plan_frame
from warpcam.kernels.plan.occlusion import traces_occlusion
from warpcam.kernels.types import View
from warpcam.render.camera_binding import pose_bytes, projection_of, shared_bytes
from warpcam.render.camera_passes import check_size, request_of
from warpcam.render.flow_history import history_bytes
from warpcam.render.looks import Look, LookName
from warpcam.render.occlusion import occlusion_bytes
from warpcam.render.paths import list_bytes, path_bytes
from warpcam.render.scratch_memory import Scratch, image_bytes
from warpcam.scene.environments import Environments
from warpcam.scene.scene import Scene


@dataclass(frozen=True)
class Memory:
    """Bytes that a renderer allocates on the scene's device; the scene's own are not among them.

    Attributes:
        images: Of each image, by camera and output.
        scratch: What the cameras use between the stages of a frame, one after the other.
        worlds: Each camera's poses, lenses, views, lists of shapes and sums of paths, which worlds are drawn or
            faulty, and their frames and times.
        past: What is kept of the last frame for ``flow`` and ``flow_valid``.
    """

    images: Mapping[str | int, Mapping[str, int]]
    scratch: int
    worlds: int
    past: int = 0

    @property
    def total(self) -> int:
        """All of it."""
        return sum(sum(images.values()) for images in self.images.values()) + self.scratch + self.worlds + self.past

    def __str__(self) -> str:
        rows = [
            (f"{camera!r} {output}", count)
            for camera, images in self.images.items()
            for output, count in images.items()
        ]
        rows += [("scratch", self.scratch), ("poses and views", self.worlds)]
        rows += [("last frame", self.past)] * (self.past > 0) + [("total", self.total)]
        wide = max(len(name) for name, _ in rows)
        return "\n".join(f"{name:<{wide}} {count / 1e6:>12,.3f} MB" for name, count in rows)


def estimate_memory(
    scene: Scene,
    cameras: Sequence[Camera],
    *,
    look: LookName | None = None,
    ambient_occlusion: float | None = None,
    soft_shadows: bool = False,
    indirect_light: bool = False,
    reflections: bool = False,
    environments: Environments | None = None,
) -> Memory:
    """Estimate the memory that ``Renderer`` would allocate on the scene's device for these arguments [bytes].

    Allocates nothing.

    Beside this a process needs what CUDA takes for itself: a context, the code of the kernels, a graph.

    Args:
        scene: What to look at.
        cameras: Each under its own name.
        look: As the renderer takes it.
        ambient_occlusion: Likewise.
        soft_shadows: Likewise.
        indirect_light: Likewise.
        reflections: Likewise.
        environments: Likewise; their own memory is not among what is estimated.

    Raises:
        WarpcamError: The cameras are none of this scene, or their images too large. Not where the device has too
            little free: that is the renderer's to say.
    """
    by_key = check_cameras(scene, cameras)
    own = Look(look, None, scene, reflections=reflections)
    own.check_display(by_key.values())
    occlusion = own.occlusion(ambient_occlusion, soft_shadows, indirect_light, by_key.values())
    paths, tables, view = own.traces_paths, own.tables(scene.tables()), wp.types.type_size_in_bytes(View)
    if environments is not None and environments.has_suns() and not paths:
        tables = replace(tables, num_lights=tables.num_lights + 1)
    for camera in by_key.values():
        check_size(camera, scene.num_worlds, own.reflections)
    plans = {
        key: plan_frame(
            tables,
            request_of(camera, projection_of(camera, scene), paths, occlusion, own.reflections),
            scene.device,
        )
        for key, camera in by_key.items()
    }
    vector, mirror = (wp.types.type_size_in_bytes(dtype) for dtype in (wp.vec4, Mirror))
    drawn = {key: [plan] if plan.fine is None else [plan, plan.fine] for key, plan in plans.items()}
    planned = {
        key: sum(view + each.list_rows * vector + each.mirrors * (view + mirror) for each in those)
        for key, those in drawn.items()
    }
    return Memory(
        images={key: image_bytes(camera, scene.num_worlds) for key, camera in by_key.items()},
        scratch=Scratch(by_key, plans, scene.num_worlds, scene.device).size,
        worlds=scene.num_worlds * (10 + sum(pose_bytes(one) + planned[key] for key, one in by_key.items()))
        + sum(shared_bytes(one, scene, own.reflections) for one in by_key.values())
        + sum(path_bytes(tables, one.width * one.height) for key, one in by_key.items() if plans[key].paths)
        + sum(list_bytes(tables) for plan in plans.values() if plan.reflects)
        + sum(occlusion_bytes(tables) for plan in plans.values() if traces_occlusion(plan.keys))
        + 4 * paths,
        past=history_bytes(by_key, [key for key, plan in plans.items() if plan.lists is not None], scene, tables),
    )


def check_cameras(scene: Any, cameras: Any) -> Mapping[str | int, Camera]:
    """The cameras by their keys, or the error that says what is wrong with them."""
    if not isinstance(scene, Scene):
        raise WarpcamError(f"Renderer: scene must be made by from_mujoco_warp or the like, got {type(scene).__name__}")
    return cameras_by_key(cameras)


def cameras_by_key(cameras: Any) -> Mapping[str | int, Camera]:
    """The cameras by their names, or the error that says what is wrong with them."""
    if not isinstance(cameras, Sequence) or not all(isinstance(camera, Camera) for camera in cameras):
        raise WarpcamError(f"Renderer: cameras must be a sequence of Camera, got {cameras!r}")
    by_key: dict[str | int, Camera] = {}
    for camera in cameras:
        if camera.name in by_key:
            raise WarpcamError(f"Renderer: cameras has two called {camera.name!r}; each needs a name of its own")
        by_key[camera.name] = camera
    return by_key


def require_free(memory: Memory, device: wp.Device) -> None:
    """Raise if the device has less than that."""
    free = free_bytes(device)
    if free is not None and memory.total > free:
        raise OutOfMemoryError(
            f"Renderer: {memory.total:,} bytes are needed, {free:,} are free on {device.alias}; ask for fewer worlds, "
            f"pixels or outputs:\n{memory}"
        )
