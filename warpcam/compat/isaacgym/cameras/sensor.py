"""One camera of one environment, and the conventions of its numbers."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import newton
import numpy as np

from warpcam.compat.common.scalars import real
from warpcam.compat.isaacgym.api.enums import CameraFollowMode, ImageType
from warpcam.compat.isaacgym.api.math_types import Quat, Transform, Vec3, looking, matrix_of
from warpcam.compat.isaacgym.api.params import CameraProperties
from warpcam.compat.isaacgym.api.tensors import Tensor
from warpcam.compat.isaacgym.kernels import state as kernels
from warpcam.compat.isaacgym.physics.environments import Env
from warpcam.core.errors import WarpcamError

# From our camera's axes, x right, y up, z backwards, to x forwards, y left, z up.
TURNED = Quat(0.5, -0.5, -0.5, 0.5)
SAMPLES = {(1, 1): 1, (2, 2): 4, (4, 2): 8, (4, 4): 16, (8, 8): 64}
MODES = {CameraFollowMode.FOLLOW_POSITION: kernels.POSITION, CameraFollowMode.FOLLOW_TRANSFORM: kernels.TRANSFORM}


@dataclass(eq=False)
class Sensor:
    """A camera.

    Attributes:
        mode: How it follows a body, of ``warpcam/compat/isaacgym/kernels/state.py``.
        body: Its place in the environment, or -1.
        pose: In its environment's frame, or as seen from the body.
        tensors: Memory of its images, made when it is first asked for.
    """

    env: Env
    handle: int
    props: CameraProperties
    mode: int = kernels.FREE
    body: int = -1
    pose: Transform = field(default_factory=Transform)
    tensors: dict[ImageType, Tensor] = field(default_factory=dict)
    batch: Any = None
    world: int = -1  # its place in the batch

    @property
    def where(self) -> str:
        return f"camera {self.handle} of environment {self.env.index}"

    def put(self, pose: Transform, mode: int, body: int) -> None:
        self.pose, self.mode, self.body = Transform(pose.p, pose.r), mode, body
        if self.batch is not None:
            self.batch.moved = True


def checked(props: Any) -> CameraProperties:
    """A copy of properties that a camera can have."""
    if props is None:
        props = CameraProperties()
    if not isinstance(props, CameraProperties):
        raise WarpcamError(f"create_camera_sensor: CameraProperties are needed, got {type(props).__name__}")
    for name in ("width", "height"):
        value = getattr(props, name)
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
            raise WarpcamError(f"CameraProperties.{name} must be a whole number of pixels, at least 1, got {value!r}")
    numbers: dict[str, Any] = {}
    for name in ("horizontal_fov", "near_plane", "far_plane"):
        value = getattr(props, name)
        numbers[name] = real(value)
        if math.isnan(numbers[name]):
            raise WarpcamError(f"CameraProperties.{name} must be a number, got {value!r}")
    props = replace(props, **numbers)
    if not 0.0 < props.horizontal_fov < 180.0:
        raise WarpcamError(f"CameraProperties.horizontal_fov must be in (0, 180) degrees, got {props.horizontal_fov!r}")
    if not 0.0 <= props.near_plane < props.far_plane:
        raise WarpcamError(
            "CameraProperties: near_plane must be at least 0 and far_plane beyond it, got "
            f"{props.near_plane!r} and {props.far_plane!r}"
        )
    samples = (props.supersampling_horizontal, props.supersampling_vertical)
    if samples not in SAMPLES:
        allowed = " or ".join(f"{a} x {b}" for a, b in SAMPLES)
        raise WarpcamError(f"CameraProperties: supersampling of {samples[0]} x {samples[1]} came; allowed is {allowed}")
    return props


def axes(up: newton.Axis) -> Quat:
    """From our camera's axes to those that a camera has where this axis is up."""
    return TURNED if up == newton.Axis.Z else Quat()


def aimed(position: Vec3, target: Vec3, up: newton.Axis) -> Transform:
    upward = Vec3(0.0, 0.0, 1.0) if up == newton.Axis.Z else Vec3(0.0, 1.0, 0.0)
    return Transform(position, looking(position, target, upward, up == newton.Axis.Z))


def focal_length(props: CameraProperties) -> float:
    """[pixels]."""
    return 0.5 * props.width / math.tan(math.radians(0.5 * props.horizontal_fov))


def view_matrix(pose: Transform, up: newton.Axis) -> np.ndarray:
    """(4, 4) float32: rows times it go from the frame of the pose to the eye's, which is OpenGL's."""
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_of(pose.r * axes(up))
    matrix[:3, 3] = tuple(pose.p)
    return np.linalg.inv(matrix).T.astype(np.float32)


def projection_matrix(props: CameraProperties) -> np.ndarray:
    """(4, 4) float32: rows of the eye's frame times it are OpenGL's clip coordinates."""
    near, far = float(props.near_plane), float(props.far_plane)
    along = 2.0 * focal_length(props)
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = along / props.width, along / props.height
    matrix[2, 2] = -1.0 if math.isinf(far) else -(far + near) / (far - near)
    matrix[3, 2] = -2.0 * near if math.isinf(far) else -2.0 * far * near / (far - near)
    matrix[2, 3] = -1.0
    return matrix.astype(np.float32)
