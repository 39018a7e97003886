"""Isaac Lab's ray-caster cameras, over any scene of warpcam; neither Isaac Lab nor a simulator of its own is needed."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import torch
import warp as wp

import warpcam as wc
from warpcam.compat.common.scalars import real, whole
from warpcam.compat.isaaclab import kernels
from warpcam.compat.isaaclab.ray_caster_fields import Quaternions, body_of, check_fields, offset_numbers, offset_turn
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import Stage, bind_launch, launch_kernel, run

Convention = Literal["opengl", "ros", "world"]
WHERE = "RayCasterCamera"
CAMERA = "camera"
# From the frames that look along -z with y up, and along z with y down, to that which looks along x with z up: x y z w.
OPENGL, ROS, WORLD = (0.5, -0.5, -0.5, 0.5), (-0.5, 0.5, -0.5, 0.5), (0.0, 0.0, 0.0, 1.0)
TURNS: dict[str, tuple[float, ...]] = {"opengl": OPENGL, "ros": ROS, "world": WORLD}
# The output that each data type is made of.
SOURCES = {"distance_to_image_plane": "depth", "distance_to_camera": "distance", "normals": "normals"}
CLIPPING = ("max", "zero", "none")


@dataclass(eq=False)
class RayCasterCameraData:
    """What a ray-caster camera reports, the same tensors at every update, on the scene's device.

    Attributes:
        pos_w: (world, 3) position of the camera [m].
        quat_w_world: (world, 4) its rotation, as the frame with x ahead and z up, in the order of ``quaternions``.
        quat_w_ros: (world, 4) likewise, as the frame with z ahead and y down.
        quat_w_opengl: (world, 4) likewise, as the frame with -z ahead and y up.
        intrinsic_matrices: (world, 3, 3) [pixels]; written by ``set_intrinsic_matrices``.
        image_shape: Height and width [pixels].
        output: Images by data type, (world, height, width, channels) float32: distances [m], or unit normals in the
            world's frame that face the camera. Where nothing is hit they are inf, distances as
            ``depth_clipping_behavior`` says.
        info: None for each data type.
    """

    pos_w: torch.Tensor
    quat_w_world: torch.Tensor
    quat_w_ros: torch.Tensor
    quat_w_opengl: torch.Tensor
    intrinsic_matrices: torch.Tensor
    image_shape: tuple[int, int]
    output: dict[str, torch.Tensor]
    info: dict[str, Any]


class CasterCameraRenderer(wc.Renderer):
    """Renders one camera, which is placed before each frame and whose images are finished after it.

    Args:
        scene: What rays meet.
        camera: The camera.
        mount: ``CasterCameraMount``, but for the arrays of the scene.
        limit: What is farther is replaced in distances [m]; None: nothing is.
        beyond: By what.
        graph: As ``Renderer`` has it.
    """

    def __init__(
        self, scene: wc.Scene, camera: wc.Camera, mount: Any, limit: float | None, beyond: float, *, graph: bool
    ):
        self._mount, self._limit, self._beyond = mount, limit, beyond
        super().__init__(scene, [camera], graph=graph)

    def place(self) -> Stage:
        """The stage that places the camera by the bodies as they are now."""
        mount, scene = self._mount, self._scene
        mount.body_positions, mount.body_rotations = scene.array("body_positions"), scene.array("body_rotations")
        arrays = self._bindings[CAMERA].arrays
        inputs = [mount, arrays["position"], arrays["rotation"]]
        return bind_launch(kernels.place_caster_camera, scene.num_worlds, inputs, scene.device)

    def _head(self, everything: bool) -> list[Stage]:
        return [self.place()]

    def _tail(self) -> list[list[list[Stage]]]:
        stages, device = [], self._device
        for name, image in self._passes[CAMERA].images.items():
            if name == "normals":
                normals = shared(image, (image.size // 3,), wp.vec3)
                stages.append(bind_launch(kernels.mark_missing_normals, normals.size, [normals], device))
            elif self._limit is not None:
                inputs = [image.flatten(), self._limit, self._beyond]
                stages.append(bind_launch(kernels.clip_distances, image.size, inputs, device))
        return [[stages]] if stages else []


class RayCasterCamera:
    """A ray-caster camera, in every world, by a configuration in Isaac Lab's words.

    Args:
        cfg: ``RayCasterCameraCfg``, ``MultiMeshRayCasterCameraCfg`` or any object with their fields: ``prim_path``,
            whose last part names a body of the scene, ``pattern_cfg``, a pinhole camera's, and those with defaults.
        scene: What rays meet: all of its shapes but those of ``exclude_bodies``.
        exclude_bodies: Bodies that rays do not meet; names or indices.
        quaternions: Order of ``offset.rot``, of ``data`` and of ``set_world_poses``: that of Isaac Lab 3, or "wxyz",
            that of Isaac Lab 2.

    Attributes:
        cfg: As given.
        num_rays: Of each world.
        image_shape: Height and width [pixels].
        drift: (world, 3) of the camera, in the world's frame [m]; may be written.
        ray_cast_drift: (world, 3), of which x and y of the vector in the world's frame move where rays begin; in the
            camera's frame [m]; may be written.
        frame: (world,) int64, how often the world was updated since its last reset.

    Raises:
        WarpcamError: A field cannot be used, by its name.
    """

    def __init__(
        self,
        cfg: Any,
        scene: wc.Scene,
        *,
        exclude_bodies: Sequence[str | int] = (),
        quaternions: Quaternions = "xyzw",
    ):
        self.cfg, self._scene, self._w_first = cfg, scene, quaternions == "wxyz"
        check_fields(cfg, WHERE, quaternions)
        kinds = _check_camera(cfg)
        body, device, worlds = body_of(cfg, scene, WHERE), scene.device, scene.num_worlds
        lens, self.image_shape = _lens(cfg.pattern_cfg)
        self.num_rays = self.image_shape[0] * self.image_shape[1]
        self._mount = _mount(cfg, body, worlds, device, quaternions)
        behavior = getattr(cfg, "depth_clipping_behavior", "none")
        far = real(getattr(cfg, "max_distance", 1e6))
        self._renderer = CasterCameraRenderer(
            scene,
            wc.Camera(
                CAMERA,
                width=self.image_shape[1],
                height=self.image_shape[0],
                outputs=[SOURCES[kind] for kind in kinds],
                lens=wc.Pinhole(fx=lens[0], fy=lens[1], cx=lens[2], cy=lens[3]),
                position=(0.0, 0.0, 0.0),
                exclude_bodies=tuple(exclude_bodies),
            ),
            self._mount,
            None if behavior == "none" else far,
            far if behavior == "max" else 0.0,
            graph=bool(getattr(cfg, "use_cuda_graph", True)),
        )
        mount = self._mount
        self.drift, self.ray_cast_drift = torch_interop.to_torch(mount.drift), torch_interop.to_torch(mount.ray_drift)
        fx, fy, cx, cy = lens
        matrix = torch.tensor(((fx, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0)), device=self.drift.device)
        self.frame = torch.zeros(worlds, dtype=torch.int64, device=self.drift.device)
        images = self._renderer.images[CAMERA]
        self._data = RayCasterCameraData(
            pos_w=torch_interop.to_torch(mount.positions),
            quat_w_world=torch_interop.to_torch(mount.rotations_world),
            quat_w_ros=torch_interop.to_torch(mount.rotations_ros),
            quat_w_opengl=torch_interop.to_torch(mount.rotations_opengl),
            intrinsic_matrices=matrix.repeat(worlds, 1, 1),
            image_shape=self.image_shape,
            output={kind: images[SOURCES[kind]] for kind in kinds},
            info=dict.fromkeys(kinds),
        )
        self._is_read = False

    @property
    def data(self) -> RayCasterCameraData:
        """What the last ``update`` has found, or the first use of this."""
        if not self._is_read:
            self.update()
        return self._data

    def update(self, dt: float = 0.0, force_recompute: bool = True) -> None:
        """Send the rays into the state as it is now; both arguments are Isaac Lab's and change nothing."""
        self._renderer.render()
        self.frame += 1
        self._is_read = True

    def reset(self, env_ids: Any = None, env_mask: Any = None) -> None:
        """Count the frames of some worlds from 0 again, and place the cameras of all by the state as it is now.

        Args:
            env_ids: Which, as torch indexes; None: all, or those of the mask.
            env_mask: (world,) bool, in place of ids.
        """
        if env_ids is None:
            env_ids = slice(None) if env_mask is None else torch_interop.to_tensor(env_mask, self.frame.device).bool()
        self.frame[env_ids] = 0
        with self._renderer.lock, torch_interop.in_order(self._scene.device):
            self._update_bodies()
            self._renderer.place().launch()

    def set_intrinsic_matrices(self, matrices: Any, focal_length: float = 1.0, env_ids: Any = None) -> None:
        """Take other intrinsics from the next update on.

        Args:
            matrices: (N, 3, 3), or one for all of them [pixels]; without skew.
            focal_length: Isaac Lab's; what is seen does not depend on it.
            env_ids: The N worlds, as torch indexes; None: all.
        """
        matrices = torch.as_tensor(matrices, dtype=torch.float32, device=self.drift.device)
        if matrices.shape[-2:] != (3, 3):
            raise WarpcamError(f"{WHERE}: matrices must be (N, 3, 3), got {tuple(matrices.shape)}")
        fixed = matrices[..., (0, 1, 2, 2, 2), (1, 0, 0, 1, 2)] == torch.tensor((0.0, 0.0, 0.0, 0.0, 1.0)).to(matrices)
        if not (fixed.all() and (matrices[..., (0, 1), (0, 1)] > 0.0).all()):
            raise WarpcamError(
                f"{WHERE}: matrices must be fx 0 cx, 0 fy cy, 0 0 1 with positive fx and fy, got {matrices.tolist()}"
            )
        worlds = slice(None) if env_ids is None else env_ids
        self._data.intrinsic_matrices[worlds] = matrices
        self._renderer.camera(CAMERA).intrinsics[worlds] = matrices[..., (0, 1, 0, 1), (0, 1, 2, 2)]

    def set_world_poses(
        self, positions: Any = None, orientations: Any = None, env_ids: Any = None, convention: Convention = "ros"
    ) -> None:
        """Move the cameras of some worlds, which then follow their bodies from there.

        Args:
            positions: (N, 3), or one for all of them [m]; None leaves positions.
            orientations: (N, 4) quaternions in the order of ``quaternions``, or one; None leaves rotations.
            env_ids: The N worlds, as torch indexes; None: all.
            convention: Frame of the orientations: "ros" has z ahead and y down, "opengl" -z ahead and y up, "world" x
                ahead and z up.
        """
        if convention not in get_args(Convention):
            allowed = ", ".join(map(repr, get_args(Convention)))
            raise WarpcamError(f"{WHERE}: convention is {convention!r}; allowed are {allowed}")
        device, place = self._scene.device, self.drift.device
        worlds = torch.arange(self._scene.num_worlds, device=place)
        worlds = worlds if env_ids is None else worlds[env_ids].reshape(-1)
        turns = wp.empty(0, dtype=wp.quat, device=device)
        if orientations is not None:
            given = _rows(orientations, 4, len(worlds), "orientations", place)
            given = given.roll(-1, dims=-1) if self._w_first else given
            turns = wp.from_torch(_product(given, _inverse(TURNS[convention], place)).contiguous(), wp.quat)
        places = wp.empty(0, dtype=wp.vec3, device=device)
        if positions is not None:
            places = wp.from_torch(_rows(positions, 3, len(worlds), "positions", place), wp.vec3)
        with self._renderer.lock, torch_interop.in_order(device):
            self._update_bodies()
            stage = self._renderer.place()
            inputs = [self._mount, wp.from_torch(worlds, wp.int64), places, turns]
            launch_kernel(kernels.turn_caster_camera, len(worlds), inputs, device=device)
            stage.launch()

    def set_world_poses_from_view(self, eyes: Any, targets: Any, env_ids: Any = None) -> None:
        """Move the cameras of some worlds to ``eyes`` and have them look at ``targets``, z of the world upright.

        Args:
            eyes: (N, 3), or one for all of them [m].
            targets: (N, 3), or one for all of them [m]; elsewhere than ``eyes``.
            env_ids: The N worlds, as torch indexes; None: all.
        """
        worlds = torch.arange(self._scene.num_worlds, device=self.drift.device)
        count = self._scene.num_worlds if env_ids is None else worlds[env_ids].numel()
        eyes, targets = (
            _rows(given, 3, count, name, self.drift.device) for name, given in (("eyes", eyes), ("targets", targets))
        )
        ahead = targets - eyes
        length = ahead.norm(dim=-1, keepdim=True)
        if not (length > 0.0).all():
            raise WarpcamError(f"{WHERE}: targets must be elsewhere than eyes, got {targets.tolist()}")
        ahead = ahead / length
        yaw = torch.atan2(ahead[:, 1], ahead[:, 0])
        pitch = -torch.asin(ahead[:, 2].clamp(-1.0, 1.0))
        zero = torch.zeros_like(yaw)
        about_z = torch.stack((zero, zero, torch.sin(0.5 * yaw), torch.cos(0.5 * yaw)), dim=-1)
        about_y = torch.stack((zero, torch.sin(0.5 * pitch), zero, torch.cos(0.5 * pitch)), dim=-1)
        turns = _product(about_z, about_y)
        self.set_world_poses(eyes, turns.roll(1, dims=-1) if self._w_first else turns, env_ids, "world")

    def _update_bodies(self) -> None:
        """Bring the poses of bodies up to the state as it is now."""
        self._scene.refresh()
        self._scene.tables()
        run(self._scene.stages())


def _check_camera(cfg: Any) -> list[str]:
    """Raise for fields that a camera cannot use; return its data types."""
    kinds = list(dict.fromkeys(getattr(cfg, "data_types", ["distance_to_image_plane"])))
    for kind in kinds:
        if kind not in SOURCES:
            raise WarpcamError(f"{WHERE}: data_types has {kind!r}; allowed are {', '.join(SOURCES)}")
    if not kinds:
        raise WarpcamError(f"{WHERE}: data_types must have some of {', '.join(SOURCES)}")
    for name, default, allowed in (
        ("depth_clipping_behavior", "none", CLIPPING),
        ("ray_alignment", "base", ("base",)),
    ):
        if getattr(cfg, name, default) not in allowed:
            raise WarpcamError(
                f"{WHERE}: {name} is {getattr(cfg, name)!r}; allowed are {', '.join(map(repr, allowed))}"
            )
    convention = getattr(getattr(cfg, "offset", None), "convention", "ros")
    if convention not in TURNS:
        raise WarpcamError(f"{WHERE}: offset.convention is {convention!r}; allowed are {', '.join(map(repr, TURNS))}")
    ranges = getattr(cfg, "ray_cast_drift_range", {})
    if any(getattr(cfg, "drift_range", ())) or any(any(each) for each in ranges.values()):
        warnings.warn(
            f"{WHERE}: drift_range and ray_cast_drift_range are not read, as Isaac Lab's cameras do not: write drift "
            "and ray_cast_drift",
            stacklevel=3,
        )
    return kinds


def _lens(pattern: Any) -> tuple[tuple[float, float, float, float], tuple[int, int]]:
    """Focal lengths and principal point [pixels] of a pinhole camera's pattern, and its height and width."""
    if not hasattr(pattern, "focal_length"):
        raise WarpcamError(f"{WHERE}: pattern_cfg has no focal_length; allowed is that of a pinhole camera")
    size = {name: whole(getattr(pattern, name, None)) for name in ("width", "height")}
    for name, number in size.items():
        if number is None or number < 1:
            got = getattr(pattern, name, None)
            raise WarpcamError(f"{WHERE}: pattern_cfg.{name} must be a whole number of pixels, at least 1, got {got!r}")
    width, height = size["width"] or 1, size["height"] or 1
    across = getattr(pattern, "horizontal_aperture", 20.955)
    down = getattr(pattern, "vertical_aperture", None)
    lengths = {
        "focal_length": real(pattern.focal_length),
        "horizontal_aperture": real(across),
        "vertical_aperture": real(across) * height / width if down is None else real(down),
    }
    for name, value in lengths.items():
        if not 0.0 < value < np.inf:
            raise WarpcamError(f"{WHERE}: pattern_cfg.{name} must be positive, got {getattr(pattern, name)!r}")
    offsets = [real(getattr(pattern, f"{name}_aperture_offset", 0.0)) for name in ("horizontal", "vertical")]
    if not np.isfinite(offsets).all():
        raise WarpcamError(f"{WHERE}: pattern_cfg's aperture offsets must be numbers, got {offsets}")
    fx = width * lengths["focal_length"] / lengths["horizontal_aperture"]
    fy = height * lengths["focal_length"] / lengths["vertical_aperture"]
    return (fx, fy, offsets[0] * fx + 0.5 * width, offsets[1] * fy + 0.5 * height), (height, width)


def _mount(cfg: Any, body: int, worlds: int, device: wp.Device, quaternions: str) -> Any:
    mount = kernels.CasterCameraMount()
    mount.body, mount.w_first = body, int(quaternions == "wxyz")
    mount.opengl, mount.ros = wp.quat(*OPENGL), wp.quat(*ROS)
    convention = getattr(getattr(cfg, "offset", None), "convention", "ros")
    turn = offset_turn(cfg, quaternions, WHERE) * wp.quat_inverse(wp.quat(*TURNS[convention]))
    offset = offset_numbers(cfg, "pos", (0.0, 0.0, 0.0), WHERE)
    mount.offsets = wp.full(worlds, wp.vec3(*offset), dtype=wp.vec3, device=device)
    mount.turns = wp.full(worlds, turn, dtype=wp.quat, device=device)
    mount.drift, mount.ray_drift, mount.positions = (wp.zeros(worlds, dtype=wp.vec3, device=device) for _ in range(3))
    mount.rotations_world, mount.rotations_ros, mount.rotations_opengl = (
        wp.zeros(worlds, dtype=wp.vec4, device=device) for _ in range(3)
    )
    return mount


def _rows(given: Any, width: int, count: int, name: str, device: torch.device) -> torch.Tensor:
    """So many rows of numbers, or one row as often."""
    rows = torch.as_tensor(given, dtype=torch.float32, device=device)
    if rows.shape not in ((width,), (1, width), (count, width)):
        raise WarpcamError(f"{WHERE}: {name} must be ({count}, {width}), got {tuple(rows.shape)}")
    return rows.reshape(-1, width).expand(count, width).contiguous()


def _inverse(turn: Sequence[float], device: torch.device) -> torch.Tensor:
    return torch.tensor((*(-each for each in turn[:3]), turn[3]), device=device)


def _product(left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
    """Of quaternions x y z w, (..., 4)."""
    vector = left[..., 3:] * right[..., :3] + right[..., 3:] * left[..., :3]
    vector = vector + torch.linalg.cross(left[..., :3], right[..., :3].expand_as(left[..., :3]))
    real_part = left[..., 3] * right[..., 3] - (left[..., :3] * right[..., :3]).sum(dim=-1)
    return torch.cat((vector, real_part[..., None]), dim=-1)
