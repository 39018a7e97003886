"""mjlab's camera sensor."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import torch
import warp as wp
from mjlab.sensor import CameraSensor as MjlabSensor
from mjlab.sensor import CameraSensorCfg as MjlabCfg
from mjlab.sensor.camera_sensor import CameraSensorData as MjlabData

import warpcam as wc
from warpcam.compat.common import packing
from warpcam.compat.mjlab.simulations import sensors_of
from warpcam.compat.mujoco_warp.arguments import read_groups
from warpcam.compat.mujoco_warp.context import CameraSettings, farthest_of, load_groups
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.streams import preserve_cuda_context


@dataclass
class CameraSensorCfg(MjlabCfg):
    """mjlab's, with more to choose.

    ``data_types`` may name every output of warpcam beside mjlab's own three. Sensors of one scene need not agree on
    textures, shadows or groups, and several may have one camera.
    """

    antialiasing: int = 1
    """Samples of a pixel that an edge runs through: 1 or 4."""

    reflections: bool | None = None
    """Whether planes and boxes reflect; None: those whose materials do now."""

    transparency: bool | None = None
    """Whether what is transparent is seen through; None: what is so now."""

    def __post_init__(self) -> None:
        if not self.data_types:
            raise WarpcamError(f"CameraSensorCfg({self.name!r}): data_types is empty; allowed are {', '.join(OUTPUTS)}")
        for kind in self.data_types:
            if kind not in OUTPUTS:
                raise WarpcamError(
                    f"CameraSensorCfg({self.name!r}): data_types has {kind!r}; allowed are {', '.join(OUTPUTS)}"
                )

    @classmethod
    def of(cls, cfg: MjlabCfg, **more: Any) -> "CameraSensorCfg":
        """Copy a configuration of mjlab's or ours, with these changes."""
        return cls(**{field.name: getattr(cfg, field.name) for field in fields(cfg)} | more)

    def build(self) -> "CameraSensor":
        return CameraSensor(self)


@dataclass
class CameraSensorData(MjlabData):
    """mjlab's three images, None where not asked for; ``depth`` is 0 where nothing is hit, as there."""

    images: Mapping[str, torch.Tensor] | None = None
    """All data types by name, (world, height, width, channels), on the simulation's device."""


class CameraSensor(MjlabSensor):
    """A camera of a scene; drawn with the others of its scene when ``sim.sense()`` is called."""

    requires_sensor_context = False  # of mjlab's renderer

    def __init__(self, cfg: CameraSensorCfg):
        super().__init__(cfg)
        self._cameras: Cameras | None = None
        self._images: dict[str, torch.Tensor] = {}

    def initialize(self, mj_model: mujoco.MjModel, model: Any, data: Any, device: str) -> None:
        super().initialize(mj_model, model, data, device)
        self._simulation = sensors_of(mj_model, model, data)
        self._cameras = self._simulation.part(Cameras)
        self._cameras.add(self)

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> None:
        super().reset(env_ids)
        if self._cameras is not None and not {"flow", "flow_valid"}.isdisjoint(self.cfg.data_types):
            self._cameras.forget(env_ids)

    def _compute_data(self) -> CameraSensorData:
        if self._cameras is None:
            raise RuntimeError("CameraSensor: it has no simulation yet; it must be part of a scene")
        if not self._images:  # nobody has called sense() yet
            self._cameras.render()
        images = {name: image.clone() for name, image in self._images.items()} if self.cfg.clone_data else self._images
        return CameraSensorData(
            rgb=images.get("rgb"), depth=images.get("depth"), segmentation=images.get("segmentation"), images=images
        )


@dataclass(frozen=True)
class _Kind:
    """Settings that sensors which share a scene have in common."""

    groups: tuple[int, ...]
    textures: bool
    reflections: bool | None
    transparency: bool | None


class Cameras:
    """All camera sensors of one simulation.

    Those that draw the same things share a scene, and a frame of it but for those of one camera.
    """

    def __init__(self, mjm: mujoco.MjModel, m: Any, d: Any):
        self.data = d
        self._mjm, self._m = mjm, m
        self._sensors: list[CameraSensor] = []
        self._frames: list[tuple[CameraSettings | None, wc.Renderer, list[Stage]]] | None = None

    def add(self, sensor: CameraSensor) -> None:
        self._sensors.append(sensor)
        self._frames = None

    def render(self) -> None:
        device = self.data.geom_xpos.device
        if self._frames is None:
            if torch_interop.is_capturing(device):
                raise WarpcamError("sense: a capture is under way before the first frame; call sim.sense() once before")
            self._frames = self._build()
        for look, renderer, stages in self._frames:
            if look is not None:
                look.follow(self._m)
            with torch_interop.in_order(device):
                renderer.render()
                for stage in stages:
                    stage.launch()
        for sensor in self._sensors:
            sensor._invalidate_cache()

    def forget(self, env_ids: Any) -> None:
        """Worlds that were reset: nothing moved from the frame before to their next."""
        if isinstance(env_ids, slice):
            env_ids = range(self.data.nworld)[env_ids]
        for _, renderer, _ in self._frames or ():
            renderer.reset(env_ids)

    def _build(self) -> list[tuple[CameraSettings | None, wc.Renderer, list[Stage]]]:
        kinds: dict[_Kind, list[dict[int, CameraSensor]]] = {}
        for sensor in self._sensors:
            cfg = sensor.cfg
            groups = set(read_groups(f"CameraSensorCfg({cfg.name!r})", cfg.enabled_geom_groups))
            kind = _Kind(tuple(sorted(groups)), cfg.use_textures, cfg.reflections, cfg.transparency)
            frames = kinds.setdefault(kind, [])
            # A renderer has a camera once.
            frame = next((frame for frame in frames if sensor.camera_idx not in frame), None)
            if frame is None:
                frames.append(frame := {})
            frame[sensor.camera_idx] = sensor
        built = []
        for kind, frames in kinds.items():
            look, scene = self._scene(kind)
            built += [(look, *self._frame(scene, list(frame.values()))) for frame in frames]
        return built

    def _scene(self, kind: _Kind) -> tuple[CameraSettings | None, wc.Scene]:
        look = None if kind.textures else CameraSettings(self._m, {"mat_texid": -1})
        m = self._m if look is None else look.model
        with preserve_cuda_context():
            scene = load_groups(
                self._mjm,
                m,
                self.data,
                groups=kind.groups,
                draw=("geoms", "flexes"),
                reflections=kind.reflections,
                transparency=kind.transparency,
            )
        return look, scene

    def _frame(self, scene: wc.Scene, sensors: list[CameraSensor]) -> tuple[wc.Renderer, list[Stage]]:
        far = farthest_of(self._mjm)
        cameras, stages = [], []
        for sensor in sensors:
            cfg = sensor.cfg
            cameras.append(
                wc.Camera(
                    sensor.camera_idx,
                    width=cfg.width,
                    height=cfg.height,
                    outputs=tuple(dict.fromkeys(cfg.data_types)),
                    far=far,
                    depth_clipping="zero",
                    shadows=cfg.use_shadows,
                    antialiasing=cfg.antialiasing,
                )
            )
        renderer = wc.Renderer(scene, cameras)
        objects = wp.array(scene.objects, dtype=wp.vec2i, device=scene.device)
        for sensor in sensors:
            sensor._images = dict(renderer.images[sensor.camera_idx])
            if "segmentation" in sensor._images:
                cfg = sensor.cfg
                pairs = wp.zeros((scene.num_worlds, cfg.height * cfg.width), dtype=wp.vec2i, device=scene.device)
                ids = renderer.array(sensor.camera_idx, "segmentation")
                stages.append(packing.bind_objects(ids, objects, pairs, 0, scene.device))
                shape = (scene.num_worlds, cfg.height, cfg.width, 2)
                sensor._images["segmentation"] = torch_interop.to_torch(pairs).view(shape)
        for stage in stages:
            stage.prepare()
        return renderer, stages
