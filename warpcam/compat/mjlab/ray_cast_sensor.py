"""mjlab's ray-cast sensors."""

from dataclasses import dataclass
from typing import Any, get_args

import mujoco
from mjlab.sensor import ObjRef
from mjlab.sensor import RayCastSensor as MjlabSensor
from mjlab.sensor import RayCastSensorCfg as MjlabCfg
from mjlab.sensor import TerrainHeightSensor as MjlabHeightSensor
from mjlab.sensor import TerrainHeightSensorCfg as MjlabHeightCfg
from mjlab.utils.lab_api.math import matrix_from_quat

import warpcam as wc
from warpcam.compat.common.scalars import real
from warpcam.compat.mjlab.ray_casts import PLACES, Frame, FrameRays, Hits, load_casters
from warpcam.compat.mjlab.simulations import sensors_of
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.sensors.lidar import Alignment

GROUPS = tuple(range(mujoco.mjNGROUP))
REDUCTIONS = ("min", "max", "mean", "none")


@dataclass
class RayCastSensorCfg(MjlabCfg):
    """mjlab's."""

    def build(self) -> "RayCastSensor":
        return RayCastSensor(self)


@dataclass
class TerrainHeightSensorCfg(MjlabHeightCfg):
    """mjlab's."""

    def build(self) -> "TerrainHeightSensor":
        return TerrainHeightSensor(self)


class RayCastSensor(MjlabSensor):
    """Rays of a scene; sent with the others of its scene when ``sim.sense()`` is called."""

    requires_sensor_context = False  # of mjlab's own rays

    def __init__(self, cfg: Any):
        super().__init__(cfg)
        self._casts: RayCasts | None = None

    def initialize(self, mj_model: mujoco.MjModel, model: Any, data: Any, device: str) -> None:
        cfg, where = self.cfg, f"{type(self.cfg).__name__}({self.cfg.name!r})"
        _check(cfg, where)
        frames = cfg.frame if isinstance(cfg.frame, tuple) else (cfg.frame,)
        self._frames = [_frame_of(mj_model, frame, where) for frame in frames]
        # mjlab's own names, which its drawing for debugging reads.
        self._model, self._data, self._mj_model = model, data, mj_model
        self._local_offsets, self._local_directions = cfg.pattern.generate_rays(mj_model, device)
        self._num_frames, self._num_rays_per_frame = len(frames), len(self._local_directions)
        self._num_rays = self._num_frames * self._num_rays_per_frame
        self._simulation = sensors_of(mj_model, model, data)
        self._casts = self._simulation.part(RayCasts)
        self._casts.add(self)

    def bind(self, scene: wc.Scene, d: Any) -> list[FrameRays]:
        """The rays of each frame in a scene, which write the sensor's data."""
        cfg = self.cfg
        hits = Hits.empty(scene.num_worlds, self._num_frames, self._num_rays, scene.device)
        offsets, directions = (table.cpu().numpy() for table in (self._local_offsets, self._local_directions))
        settings = (cfg.ray_alignment, cfg.max_distance, cfg.exclude_parent_body, hits)
        rays = [
            FrameRays(scene, d, frame, number, offsets, directions, *settings)
            for number, frame in enumerate(self._frames)
        ]
        self._distances = torch_interop.to_torch(hits.distances)
        self._normals_w, self._hit_pos_w = torch_interop.to_torch(hits.normals), torch_interop.to_torch(hits.positions)
        self._frame_pos_w = torch_interop.to_torch(hits.frame_positions)
        self._frame_quat_w = torch_interop.to_torch(hits.frame_rotations)
        self._pos_w, self._quat_w = self._frame_pos_w[:, 0], self._frame_quat_w[:, 0]
        return rays

    def _compute_data(self) -> Any:
        if self._casts is None:
            raise RuntimeError(f"{type(self).__name__}: it has no simulation yet; it must be part of a scene")
        self._casts.begin()
        self._ctx = self._casts  # all that mjlab's own asks of a context is whether there is one
        return super()._compute_data()

    def debug_vis(self, visualizer: Any) -> None:
        if self.cfg.debug_vis and self._casts is not None:
            self._casts.begin()
            self._cached_frame_pos = self._frame_pos_w
            self._cached_frame_mat = matrix_from_quat(self._frame_quat_w)
            super().debug_vis(visualizer)


class TerrainHeightSensor(MjlabHeightSensor, RayCastSensor):
    """mjlab's, of our rays."""


class RayCasts:
    """All ray-cast sensors of one simulation; those of the same geom groups share a scene."""

    def __init__(self, mjm: mujoco.MjModel, m: Any, d: Any):
        self._mjm, self._m, self._d = mjm, m, d
        self._sensors: list[RayCastSensor] = []
        self._rays: list[FrameRays] | None = None

    def add(self, sensor: RayCastSensor) -> None:
        self._sensors.append(sensor)
        self._rays = None

    def begin(self) -> None:
        """Read the sensors if nobody has called ``sense()`` yet."""
        if self._rays is None:
            self.render()

    def render(self) -> None:
        if self._rays is None:
            if torch_interop.is_capturing(self._d.geom_xpos.device):
                raise WarpcamError("sense: a capture is under way before the first read; call sim.sense() once before")
            self._rays = self._bind()
        for rays in self._rays:
            rays.cast()
        for sensor in self._sensors:
            sensor._invalidate_cache()

    def _bind(self) -> list[FrameRays]:
        scenes: dict[tuple[int, ...], wc.Scene] = {}
        bound = []
        for sensor in self._sensors:
            chosen = sensor.cfg.include_geom_groups
            groups = GROUPS if chosen is None else tuple(sorted(set(chosen)))
            if groups not in scenes:
                scenes[groups] = load_casters(self._mjm, self._m, self._d, groups)
            bound += sensor.bind(scenes[groups], self._d)
        return bound


def _check(cfg: Any, where: str) -> None:
    """Raise for values that mjlab has no meaning for."""
    if cfg.ray_alignment not in get_args(Alignment):
        allowed = ", ".join(map(repr, get_args(Alignment)))
        raise WarpcamError(f"{where}: ray_alignment is {cfg.ray_alignment!r}; allowed are {allowed}")
    if not real(cfg.max_distance) > 0.0:
        raise WarpcamError(f"{where}: max_distance must be a positive number [m], got {cfg.max_distance!r}")
    groups = () if cfg.include_geom_groups is None else cfg.include_geom_groups
    if not all(group in GROUPS for group in groups):
        raise WarpcamError(f"{where}: include_geom_groups must be some of 0 to {GROUPS[-1]}, or None, got {groups!r}")
    reduction = getattr(cfg, "reduction", "none")
    if reduction not in REDUCTIONS:
        raise WarpcamError(f"{where}: reduction is {reduction!r}; allowed are {', '.join(map(repr, REDUCTIONS))}")


def _frame_of(mjm: mujoco.MjModel, given: ObjRef, where: str) -> Frame:
    """The object of a model that a frame names."""
    if given.type not in PLACES:
        raise WarpcamError(f"{where}: frame is a {given.type}; allowed are {', '.join(PLACES)}")
    source = int(getattr(mjm, given.type)(given.prefixed_name()).id)
    bodies = {"body": range(mjm.nbody), "site": mjm.site_bodyid, "geom": mjm.geom_bodyid}
    return Frame(given.type, source, int(bodies[given.type][source]))
