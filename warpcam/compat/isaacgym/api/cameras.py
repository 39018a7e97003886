"""Calls about cameras and their images."""

from typing import Any

import numpy as np
from PIL import Image

from warpcam import visualize
from warpcam.compat.isaacgym.api.enums import CameraFollowMode, ImageType, one_of
from warpcam.compat.isaacgym.api.math_types import Transform, Vec3
from warpcam.compat.isaacgym.api.params import CameraProperties
from warpcam.compat.isaacgym.api.tensors import Tensor
from warpcam.compat.isaacgym.cameras.camera_batches import check_kind
from warpcam.compat.isaacgym.cameras.sensor import MODES, Sensor, aimed, checked, projection_matrix, view_matrix
from warpcam.compat.isaacgym.kernels import state as kernels
from warpcam.compat.isaacgym.physics.environments import Env, handle_of
from warpcam.compat.isaacgym.physics.simulation import Sim, env_of, sim_of
from warpcam.core.errors import WarpcamError


class CameraCalls:
    """See ``Gym``."""

    def create_camera_sensor(self, env: Env, props: CameraProperties | None = None) -> int:
        """A camera; its handle counts those of its environment, and none is given twice."""
        env = env_of(env, "create_camera_sensor")
        sensor = Sensor(env, env.next_camera, checked(props))
        env.cameras[sensor.handle] = sensor
        env.next_camera += 1
        env.sim.camera_batches.add(sensor)
        return sensor.handle

    def destroy_camera_sensor(self, sim: Sim, env: Env, camera: int) -> None:
        """Forget a camera. Tensors of its images stay as they are."""
        sensor = _sensor(env, camera, "destroy_camera_sensor", sim)
        del env.cameras[sensor.handle]
        env.sim.camera_batches.remove(sensor)

    def set_camera_location(self, camera: int, env: Env, position: Vec3, target: Vec3) -> None:
        """Put a camera somewhere, in its environment's frame; it follows no body any more."""
        sensor = _sensor(env, camera, "set_camera_location")
        eye, goal = _place(position, "set_camera_location: position"), _place(target, "set_camera_location: target")
        sensor.put(aimed(eye, goal, env.sim.up), kernels.FREE, -1)

    def set_camera_transform(self, camera: int, env: Env, transform: Transform) -> None:
        """Put a camera somewhere, in its environment's frame; it follows no body any more.

        Where z is up, it looks along x of the transform, and its z is up; where y is up, along -z, and y is up.
        """
        where = "set_camera_transform"
        _sensor(env, camera, where).put(_placed(transform, f"{where}: transform"), kernels.FREE, -1)

    def attach_camera_to_body(
        self, camera: int, env: Env, body: int, local_transform: Transform, mode: CameraFollowMode
    ) -> None:
        """Fix a camera to a body.

        Args:
            camera: Its handle.
            env: Its environment.
            body: The body's handle in the environment.
            local_transform: From the camera to the body's frame; with ``FOLLOW_POSITION`` the camera stays that far
                from the body, along the environment's axes, and turned as it is.
            mode: Of ``CameraFollowMode``.
        """
        where = "attach_camera_to_body"
        sensor = _sensor(env, camera, where)
        place = env.body(body, where)
        follow = MODES[one_of(CameraFollowMode, mode, f"{where}: mode")]
        sensor.put(_placed(local_transform, f"{where}: local_transform"), follow, place)

    def get_camera_transform(self, sim: Sim, env: Env, camera: int, *, quirks: bool | None = None) -> Transform:
        """Where a camera is now, in its environment's frame.

        Args:
            sim: The simulation.
            env: The camera's environment.
            camera: Its handle.
            quirks: For a camera that is attached to a body, where it is as seen from there, as Isaac Gym has it. None
                is what ``create_sim`` was told.
        """
        sensor = _sensor(env, camera, "get_camera_transform", sim)
        if sim.quirks if quirks is None else quirks:
            return Transform(sensor.pose.p, sensor.pose.r)
        return _pose(sensor)

    def get_camera_view_matrix(self, sim: Sim, env: Env, camera: int) -> np.ndarray:
        """(4, 4) float32: [x, y, z, 1] of the frame that all environments share, times it, is the eye's, OpenGL's."""
        pose = _pose(_sensor(env, camera, "get_camera_view_matrix", sim))
        return view_matrix(Transform(pose.p + env.origin, pose.r), sim.up)

    def get_camera_proj_matrix(self, sim: Sim, env: Env, camera: int) -> np.ndarray:
        """(4, 4) float32: rows of the eye's frame, times it, are OpenGL's clip coordinates."""
        return projection_matrix(_sensor(env, camera, "get_camera_proj_matrix", sim).props)

    def step_graphics(self, sim: Sim) -> None:
        """Nothing is to be done: images show states as they are when they are rendered."""
        sim_of(sim, "step_graphics").shown = True

    def render_all_camera_sensors(self, sim: Sim) -> None:
        """Draw all cameras of all environments."""
        sim = sim_of(sim, "render_all_camera_sensors")
        if sim.accessing:
            raise WarpcamError(
                "render_all_camera_sensors: images are being read; call end_access_image_tensors before the next render"
            )
        if not sim.fetched:
            sim.warn_once(
                "render_all_camera_sensors: fetch_results was not called after simulate; here it is not needed"
            )
        if not sim.shown:
            sim.warn_once(
                "render_all_camera_sensors: step_graphics was not called after simulate; here it is not needed"
            )
        sim.camera_batches.render(sim.physics, sim.envs)

    def get_camera_image(self, sim: Sim, env: Env, camera: int, image_type: ImageType) -> np.ndarray:
        """A copy of an image on the host, as of the last render.

        Returns:
            Colour (height, 4 width) uint8, RGBA; depth (height, width) float32, negative planar [m], -inf at a miss;
            segmentation (height, width) uint32; flow (height, 2 width) int16.
        """
        kind = check_kind(image_type, "get_camera_image")
        sensor = _sensor(env, camera, "get_camera_image", sim)
        image = sim.camera_batches.read(sensor, kind)
        if kind == ImageType.IMAGE_SEGMENTATION:
            return image.view(np.uint32)
        return image.reshape(image.shape[0], -1)

    def get_camera_image_gpu_tensor(self, sim: Sim, env: Env, camera: int, image_type: ImageType) -> Tensor:
        """Memory that has an image after each render: the same for as long as the camera is there.

        Returns:
            Colour (height, width, 4) uint8, depth (height, width) float32, segmentation (height, width) int32, flow
            (height, width, 2) int16, whose ``shape`` is (height, width) as there, on the simulation's device.
        """
        where = "get_camera_image_gpu_tensor"
        kind = check_kind(image_type, where)
        sensor = _sensor(env, camera, where, sim)
        if not sensor.props.enable_tensors:
            raise WarpcamError(f"{where}: {sensor.where} was created with enable_tensors False; set it True before")
        return sim.camera_batches.tensor(sensor, kind, sim.device)

    def start_access_image_tensors(self, sim: Sim) -> None:
        """From here on images are read; they are in order with torch's current stream."""
        sim = sim_of(sim, "start_access_image_tensors")
        if sim.accessing:
            raise WarpcamError("start_access_image_tensors: called twice; end_access_image_tensors comes between")
        sim.accessing = True

    def end_access_image_tensors(self, sim: Sim) -> None:
        sim = sim_of(sim, "end_access_image_tensors")
        if not sim.accessing:
            raise WarpcamError("end_access_image_tensors: start_access_image_tensors was not called")
        sim.accessing = False

    def write_camera_image_to_file(self, sim: Sim, env: Env, camera: int, image_type: ImageType, path: str) -> None:
        """Save an image as a PNG: colours, or depth, ids and flow in false colours."""
        kind = check_kind(image_type, "write_camera_image_to_file")
        image = self.get_camera_image(sim, env, camera, kind)
        if kind == ImageType.IMAGE_COLOR:
            pixels = image.reshape(image.shape[0], -1, 4)[..., :3]
        elif kind == ImageType.IMAGE_DEPTH:
            pixels = visualize.from_lengths(-image[None, ..., None])[0]
        elif kind == ImageType.IMAGE_OPTICAL_FLOW:
            parts = image.reshape(1, image.shape[0], -1, 2) / 2.0**15
            pixels = visualize.from_flow(parts * (parts.shape[2], parts.shape[1]))[0]
        else:
            pixels = visualize.from_ids(np.where(image == 0, -1, image.astype(np.int64))[None, ..., None])[0]
        try:
            Image.fromarray(np.ascontiguousarray(pixels)).save(path, format="png")
        except OSError as error:
            raise WarpcamError(
                f"write_camera_image_to_file: {str(path)!r} cannot be written: {error.strerror}"
            ) from None


def _sensor(env: Any, handle: Any, where: str, sim: Any = None) -> Sensor:
    """The camera of that handle, of an environment that is of the simulation if one is given."""
    env = env_of(env, where)
    if sim is not None and env.sim is not sim_of(sim, where):
        raise WarpcamError(f"{where}: environment {env.index} is of another simulation")
    number = handle_of(handle, env.next_camera)
    if number is None or number not in env.cameras:
        gone = number is not None
        known = ", ".join(map(str, env.cameras)) or "none"
        what = f"camera {handle} has been destroyed" if gone else f"camera {handle!r} came"
        raise WarpcamError(f"{where}: {what}; environment {env.index} has {known}")
    return env.cameras[number]


def _place(value: Any, where: str) -> Vec3:
    try:
        place = Vec3(*value)
    except (TypeError, ValueError):
        raise WarpcamError(f"{where} must be a Vec3, got {value!r}") from None
    if not np.isfinite(tuple(place)).all():
        raise WarpcamError(f"{where} must be finite, got {value!r}")
    return place


def _placed(value: Any, where: str) -> Transform:
    """A pose that a camera can have."""
    if not isinstance(value, Transform):
        raise WarpcamError(f"{where} must be a Transform, got {type(value).__name__}")
    numbers = np.array((*value.p, *value.r))
    if not np.isfinite(numbers).all() or not numbers[3:].any():
        raise WarpcamError(f"{where} must be finite, its rotation not of length 0, got {value!r}")
    return value


def _pose(sensor: Sensor) -> Transform:
    """Where it is now, in its environment's frame; waits for the device if it follows a body."""
    if sensor.mode == kernels.FREE:
        return Transform(sensor.pose.p, sensor.pose.r)
    body = sensor.env.place(sensor.body)
    if sensor.mode == kernels.POSITION:
        return Transform(body.p + sensor.pose.p, sensor.pose.r)
    return body * sensor.pose
