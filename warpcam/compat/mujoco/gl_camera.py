"""The camera of MuJoCo's abstract scene as OpenGL takes it, and depth as OpenGL keeps it."""

from dataclasses import dataclass

import mujoco
import numpy as np

from warpcam.core.errors import WarpcamError

FARTHEST = 1.0e30  # distance of a far plane that rounding has moved to infinity [m]


@dataclass(frozen=True, eq=False)
class GlCamera:
    """A camera as OpenGL has it.

    Attributes:
        position: (3,) [m].
        rotation: (4,) w x y z.
        left: Of the image's edges, where the optical axis crosses the near plane [m]; and so on.
        right: See ``left``.
        bottom: See ``left``.
        top: See ``left``.
        near: Distance of the near plane [m].
        far: Of the far plane [m].
        orthographic: Whether rays are parallel.
    """

    position: np.ndarray
    rotation: np.ndarray
    left: float
    right: float
    bottom: float
    top: float
    near: float
    far: float
    orthographic: bool

    @property
    def reach(self) -> float:
        """Nearest depth that is not seen any more [m]: what rounding makes of the far plane in OpenGL.

        A projection is four numbers of 32 bits there, and a point is seen whose depth under it is at least 0.
        """
        one, near, far = (np.float32(value) for value in (1.0, self.near, self.far))
        half, span = np.float32(0.5), far - near
        if self.orthographic:
            rate, start = one / span, half * (far + near) / span + half
        else:
            rate, start = half * ((far + near) / span) - half, far * near / span
        if not rate > 0.0:  # near planes that are next to nothing beside the far one: all is seen
            return FARTHEST
        return float(np.nextafter(np.float32(min(float(start) / float(rate), FARTHEST)), np.float32(np.inf)))

    def content(self) -> bytes:
        """Equal for equal views."""
        edges = (self.left, self.right, self.bottom, self.top, self.near, self.far, self.orthographic)
        return np.concatenate((self.position, self.rotation, edges)).tobytes()


def view_of(scene: mujoco.MjvScene, width: int, height: int) -> GlCamera | None:
    """Return the view of a MuJoCo scene's camera in an image of that size; None if none was set."""
    if min(width, height) < 1:
        raise WarpcamError(f"render: width and height must be at least 1 pixel, got {width} and {height}")
    one, two = scene.camera  # two eyes for a stereo picture; one that is none is taken from between them
    bottom, top = 0.5 * (one.frustum_bottom + two.frustum_bottom), 0.5 * (one.frustum_top + two.frustum_top)
    if top <= bottom:
        return None
    position, forward, up, right, rotation = (np.zeros(size) for size in (3, 3, 3, 3, 4))
    mujoco.mjv_cameraInRoom(position, forward, up, scene)
    mujoco.mju_cross(right, forward, up)
    mujoco.mju_mat2Quat(rotation, np.array((right, up, -forward)).T.ravel())
    center = 0.5 * (one.frustum_center + two.frustum_center)
    half = 0.5 * (one.frustum_width + two.frustum_width) or 0.5 * (top - bottom) * width / height
    return GlCamera(
        position=position, rotation=rotation, left=center - half, right=center + half,
        bottom=bottom, top=top, near=float(one.frustum_near), far=float(one.frustum_far),
        orthographic=bool(one.orthographic),
    )  # fmt: skip


def depth_buffer(depth: np.ndarray, view: GlCamera) -> np.ndarray:
    """Convert planar depth [m] to OpenGL's depth buffer, float32: 0 at the near plane, 1 at the far one."""
    if view.orthographic:
        return ((depth - view.near) / (view.far - view.near)).astype(np.float32)
    inverse = view.near / depth.astype(np.float64)
    return np.ascontiguousarray((1.0 - inverse) / (1.0 - view.near / view.far), np.float32)
