"""Isaac Lab's ray casters, over any scene of warpcam; neither Isaac Lab nor a simulator of its own is needed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import torch
import warp as wp

import warpcam as wc
from warpcam import sensors
from warpcam.compat.common.rows import columns_of
from warpcam.compat.common.scalars import real
from warpcam.compat.isaaclab import kernels
from warpcam.compat.isaaclab.ray_caster_fields import Quaternions, body_of, check_fields, offset_numbers, offset_turn
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.sensors.lidar import ALIGNMENTS, Alignment
from warpcam.sensors.scan_renderer import CPU_RUN


@dataclass(frozen=True, eq=False)
class RayCasterData:
    """What a ray caster reports, the same tensors at every update, on the scene's device.

    Attributes:
        pos_w: (world, 3) position of the sensor [m].
        quat_w: (world, 4) its rotation, in the order of ``RayCaster``'s ``quaternions``.
        ray_hits_w: (world, ray, 3) where rays end, inf where nothing is hit [m].
        ray_distances: (world, ray) inf where nothing is hit [m].
        ray_normals_w: (world, ray, 3) unit, inf where nothing is hit.
    """

    pos_w: torch.Tensor
    quat_w: torch.Tensor
    ray_hits_w: torch.Tensor
    ray_distances: torch.Tensor
    ray_normals_w: torch.Tensor


class CasterRays(sensors.Lidar):
    """A lidar that stands where Isaac Lab's ray casters do, with what drifts.

    Args:
        scene: What rays meet.
        mount: ``CasterMount``, but for the arrays of the scene.
        pattern: The rays.
        **settings: Others of ``Lidar``.
    """

    def __init__(self, scene: wc.Scene, mount: Any, pattern: sensors.patterns.Pattern, **settings: Any):
        self._caster, self._scene_of_bodies = mount, scene
        super().__init__(scene, pattern, **settings)

    def _place(self, positions: wp.array, rotations: wp.array) -> Sequence[Stage]:
        mount, scene = self._caster, self._scene_of_bodies
        mount.body_positions, mount.body_rotations = scene.array("body_positions"), scene.array("body_rotations")
        inputs = [mount, self._poses, positions, rotations]
        return [bind_launch(kernels.place_caster, scene.num_worlds, inputs, scene.device)]


class RayCaster:
    """A ray caster, in every world, by a configuration in Isaac Lab's words.

    Args:
        cfg: ``RayCasterCfg``, ``MultiMeshRayCasterCfg`` or ``NewtonRaycastSensorCfg``, or any object with their fields:
            ``prim_path``, whose last part names a body of the scene, ``pattern_cfg``, and those that have defaults.
        scene: What rays meet: all of its shapes but those of ``exclude_bodies``.
        exclude_bodies: Bodies that rays do not meet; names or indices.
        quaternions: Order of ``offset.rot`` and ``data.quat_w``: that of Isaac Lab 3, or "wxyz", that of Isaac Lab 2.

    Attributes:
        cfg: As given.
        num_rays: Of each world.
        drift: (world, 3) of the sensor, in the world's frame [m]; may be written.
        ray_cast_drift: (world, 3): x and y of where rays begin, in their frame, and z of where they end [m]; may be
            written.

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
        self.cfg, self._order = cfg, quaternions
        check_fields(cfg, "RayCaster", quaternions)
        _check_pattern(cfg)
        body = body_of(cfg, scene, "RayCaster")
        device, worlds = scene.device, scene.num_worlds
        starts, directions = (
            torch_interop.to_numpy(table).astype(np.float32)
            for table in cfg.pattern_cfg.func(cfg.pattern_cfg, str(torch_interop.device_of(device)))
        )
        self.num_rays = len(directions)
        turn = np.array(wp.quat_to_matrix(offset_turn(cfg, quaternions, "RayCaster")), np.float32).reshape(3, 3)
        directions = directions @ turn.T
        alignment = getattr(cfg, "ray_alignment", "base")
        if alignment == "yaw" and np.abs(directions[:, :2]).max() > 1e-6 * np.abs(directions).max():
            raise WarpcamError(
                "RayCaster: ray_alignment='yaw' turns the starts of rays and not their directions in Isaac Lab, which "
                "is offered for rays along z; allowed are these, 'base' and 'world'"
            )
        rows = (self.num_rays // columns_of(starts, directions), -1, 3)
        far = real(getattr(cfg, "max_distance", 1e6))
        origins = starts.reshape(rows) if starts.any() else None
        mount = kernels.CasterMount()
        mount.body, mount.alignment = body, ALIGNMENTS[alignment]
        mount.offset = wp.vec3(*offset_numbers(cfg, "pos", (0.0, 0.0, 0.0), "RayCaster"))
        mount.drift, mount.ray_drift, mount.positions = (
            wp.zeros(worlds, dtype=wp.vec3, device=device) for _ in range(3)
        )
        mount.rotations = wp.zeros(worlds, dtype=wp.quat, device=device)
        self._lidar = CasterRays(
            scene,
            mount,
            sensors.patterns.rays(directions.reshape(rows), origins=origins, max_range=far),
            outputs=("ranges", "points", "normals"),
            frame="world",
            exclude_body=tuple(exclude_bodies),
            graph=bool(getattr(cfg, "use_cuda_graph", True)),
        )
        hits, normals = (wp.zeros((worlds, self.num_rays), dtype=wp.vec3, device=device) for _ in range(2))
        self.drift, self.ray_cast_drift = (torch_interop.to_torch(array) for array in (mount.drift, mount.ray_drift))
        self._device, scan = device, self._lidar.scan
        found = [wp.from_torch(scan[name].view(worlds, self.num_rays, 3), wp.vec3) for name in ("points", "normals")]
        distances = scan["ranges"].view(worlds, self.num_rays)
        inputs = [mount.ray_drift, found[0], wp.from_torch(distances), found[1], hits, normals]
        run = 1 if device.is_cuda else CPU_RUN
        threads = worlds * -(-self.num_rays // run)
        self._write = bind_launch(kernels.write_caster_hits, threads, [*inputs, run], device)
        self._write.prepare()
        self._rotations = torch_interop.to_torch(mount.rotations)
        self._data = RayCasterData(
            pos_w=torch_interop.to_torch(mount.positions),
            quat_w=self._rotations if quaternions == "xyzw" else self._rotations.clone(),
            ray_hits_w=torch_interop.to_torch(hits),
            ray_distances=distances,
            ray_normals_w=torch_interop.to_torch(normals),
        )
        self._is_read = False
        self.reset()

    @property
    def data(self) -> RayCasterData:
        """What the last ``update`` has found, or the first use of this."""
        if not self._is_read:
            self.update()
        return self._data

    def update(self, dt: float = 0.0, force_recompute: bool = True) -> None:
        """Send the rays into the state as it is now; both arguments are Isaac Lab's and change nothing."""
        with torch_interop.in_order(self._device):
            self._lidar.read()
            self._write.launch()
        if self._order == "wxyz":
            self._data.quat_w.copy_(self._rotations.roll(1, dims=-1))
        self._is_read = True

    def reset(self, env_ids: Any = None, env_mask: Any = None) -> None:
        """Draw the drifts of some worlds anew, by torch's random numbers.

        Args:
            env_ids: Which, as torch indexes; None: all, or those of the mask.
            env_mask: (world,) bool, in place of ids.
        """
        if env_ids is None:
            env_ids = slice(None) if env_mask is None else torch_interop.to_tensor(env_mask, self.drift.device).bool()
        count = len(self.drift[env_ids])
        low, high = getattr(self.cfg, "drift_range", (0.0, 0.0))
        self.drift[env_ids] = torch.empty(count, 3, device=self.drift.device).uniform_(low, high)
        ranges = getattr(self.cfg, "ray_cast_drift_range", {})
        for axis, name in enumerate("xyz"):
            low, high = ranges.get(name, (0.0, 0.0))
            drawn = torch.empty(count, device=self.drift.device).uniform_(low, high)
            self.ray_cast_drift[env_ids, axis] = drawn


def _check_pattern(cfg: Any) -> None:
    """Raise for a pattern or an alignment that gives no list of rays."""
    if hasattr(cfg.pattern_cfg, "focal_length"):
        raise WarpcamError("RayCaster: pattern_cfg is a pinhole camera's, which RayCasterCamera takes")
    if not callable(getattr(cfg.pattern_cfg, "func", None)):
        raise WarpcamError("RayCaster: pattern_cfg has no func, which gives starts and directions of rays")
    if getattr(cfg, "ray_alignment", "base") not in get_args(Alignment):
        allowed = ", ".join(map(repr, get_args(Alignment)))
        raise WarpcamError(f"RayCaster: ray_alignment is {cfg.ray_alignment!r}; allowed are {allowed}")
