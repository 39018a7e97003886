"""Frames that point clouds are in: the world, a camera or a body."""

from collections.abc import Mapping
from typing import Any

import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage
from warpcam.render.drawn_cameras import DrawnCamera
from warpcam.scene.scene import Scene
from warpcam.sensors.kernels import point_clouds as kernels


class CloudFrame:
    """The world's frame, which does not move.

    Attributes:
        crop: The struct that kernels read, without bounds.
    """

    def __init__(self) -> None:
        self.crop = kernels.Crop()

    @property
    def moves(self) -> bool:
        return False

    def stages(self) -> list[Stage]:
        """Return the stages that write the frame's pose as it is now."""
        return []


class _MovingFrame(CloudFrame):
    def __init__(self, num_worlds: int, device: wp.Device):
        super().__init__()
        self.crop.positions = wp.zeros(num_worlds, dtype=wp.vec3, device=device)
        self.crop.rotations = wp.zeros(num_worlds, dtype=wp.mat33, device=device)

    @property
    def moves(self) -> bool:
        return True


class _CameraFrame(_MovingFrame):
    def __init__(self, drawn: DrawnCamera, mask: wp.array):
        super().__init__(mask.shape[0], mask.device)
        self._stages = [kernels.bind_view_frames(mask, drawn.views, self.crop, mask.device)]

    def stages(self) -> list[Stage]:
        return self._stages


class _BodyFrame(_MovingFrame):
    def __init__(self, scene: Scene, body: int, mask: wp.array):
        super().__init__(mask.shape[0], mask.device)
        self._scene, self._body, self._mask = scene, body, mask
        self._poses: tuple[wp.array, ...] = ()
        self._stages: list[Stage] = []

    def stages(self) -> list[Stage]:
        poses = (self._scene.array("body_positions"), self._scene.array("body_rotations"))
        if [*map(id, poses)] != [*map(id, self._poses)]:  # another state was bound to the scene
            self._poses = poses
            self._stages = [kernels.bind_body_frames(self._mask, self._body, poses, self.crop, self._mask.device)]
        return self._stages


def frame_of(frame: Any, scene: Scene, drawn: Mapping[str | int, DrawnCamera], mask: wp.array) -> CloudFrame:
    """The frame that ``PointClouds`` was given.

    Raises:
        WarpcamError: There is no such camera or body, or the name is of both.
    """
    if isinstance(frame, str) and frame == "world":
        return CloudFrame()
    where = "PointClouds: frame"
    kind, key = frame if isinstance(frame, tuple) and len(frame) == 2 else (None, frame)
    is_key = isinstance(key, str | int) and not isinstance(key, bool)
    if kind not in (None, "camera", "body") or not is_key or (kind is None and not isinstance(key, str)):
        raise WarpcamError(
            f'{where} must be "world", the name of a camera or a body, ("camera", name) or ("body", name), '
            f"got {frame!r}"
        )
    if kind is None:
        kind = _kind_of(key, scene, drawn)
    if kind == "camera":
        if key not in tuple(drawn):
            raise WarpcamError(f"{where}: camera {key!r} came, the renderer has {', '.join(map(repr, drawn))}")
        return _CameraFrame(drawn[key], mask)
    return _BodyFrame(scene, scene.body(key, where), mask)


def _kind_of(name: str, scene: Scene, drawn: Mapping[str | int, DrawnCamera]) -> str:
    try:
        scene.body(name, "PointClouds: frame")
    except WarpcamError as error:
        if name in tuple(drawn):
            return "camera"
        cameras = ", ".join(map(repr, drawn))
        raise WarpcamError(f"{error}; the renderer has cameras {cameras}") from None
    if name in tuple(drawn):
        raise WarpcamError(
            f'PointClouds: frame: {name!r} is a camera and a body; give ("camera", {name!r}) or ("body", {name!r})'
        )
    return "body"
