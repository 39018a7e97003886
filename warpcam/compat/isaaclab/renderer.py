"""The renderer that Isaac Lab asks for images."""

import logging
from collections.abc import Mapping
from typing import Any

import warp as wp
from isaaclab.renderers import BaseRenderer, RenderBufferKind, RenderBufferSpec

import warpcam as wc
from warpcam.compat.isaaclab import isp, lenses, simple_shading
from warpcam.compat.isaaclab.events import offer_shape_colors
from warpcam.compat.isaaclab.render_data import LABELLED, RenderData
from warpcam.compat.isaaclab.renderer_cfg import NAME, WarpcamRendererCfg
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.streams import preserve_cuda_context
from warpcam.sources.newton.options import NewtonOptions
from warpcam.sources.newton.source import load

AMBIENT = (0.2, 0.2, 0.2)


class WarpcamRenderer(BaseRenderer):
    """warpcam, over the Newton model that Isaac Lab builds for its own Newton renderer.

    Each camera's pose and intrinsics are its own in every environment. Frames follow the scene's transforms as the
    scene data provider publishes them, whichever physics moves it.
    """

    def __init__(self, cfg: WarpcamRendererCfg):
        self.cfg = cfg
        self.scene: wc.Scene | None = None
        self._stage: Any = None
        self._mapper: Any = None
        self._shaded: dict[str, wc.Scene] = {}
        self._choice = NewtonOptions(lit_normals=True, textures=bool(cfg.enable_textures))
        offer_shape_colors()
        sim = simulation()
        self._backend_cfg = _backend_cfg(sim)
        sim.requires_newton_model = True

    def initialize(self) -> None:
        """Read the model; physics is ready."""
        sim = simulation()
        self._backend = sim.get_or_create_backend(self._backend_cfg)
        self._provider = sim.get_scene_data_provider()
        model = self._backend.model
        self._mapping = self._provider.create_mapping(list(model.body_label))
        lights = None if self.cfg.create_default_light else ()
        ambient = AMBIENT if self.cfg.enable_ambient_lighting else (0.0, 0.0, 0.0)
        with preserve_cuda_context():
            self.scene = load(model, self._backend.state_0, lights, ambient, None, None, choice=self._choice)

    @property
    def visual_material_writer(self) -> Any:
        """Colours are written to the model, whose arrays are read in each frame."""
        return self._backend.create_visual_material_writer

    def supported_output_types(self) -> dict[RenderBufferKind, RenderBufferSpec]:
        return self.cfg.supported_output_types()

    def prepare_stage(self, stage: Any, num_envs: int) -> None:
        """Nothing to prepare."""

    def prepare_cameras(self, stage: Any, spec: Any) -> None:
        """Keep the stage, whose labels become ids, and tell what of the cameras' lenses is not drawn.

        Settings of image processing are completed, as Isaac Lab's own renderers do.
        """
        self._stage = stage
        paths = spec.camera_prim_paths
        spec.cfg.isp_cfg = isp.resolve(getattr(spec.cfg, "isp_cfg", None), stage, paths[0] if paths else None)
        log = logging.getLogger("warpcam")
        for path in spec.camera_prim_paths:
            if lens := lenses.unread_lens(stage.GetPrimAtPath(path), spec.cfg.spawn):
                log.warning(
                    "camera %s has the lens %s on the stage, which is not drawn: say it in CameraCfg.spawn", path, lens
                )
                break
        if f_stop := getattr(spec.cfg.spawn, "f_stop", 0.0):
            log.warning("CameraCfg.spawn.f_stop is %s, which is not drawn: everything is in focus", f_stop)

    def create_render_data(self, spec: Any) -> RenderData:
        if self.scene is None:
            raise WarpcamError("create_render_data: the renderer is not initialized; physics must be ready before")
        for kind in LABELLED:
            if kind in spec.cfg.data_types:
                self._labels().build_mapping(kind, bool(getattr(self.cfg, f"colorize_{kind}")))
        simple = simple_shading.chosen_from(spec.cfg.data_types)
        scene = self.scene if simple is None else self._simply_shaded(simple)
        return RenderData(scene, self._backend.model, spec, self.cfg, self._mapper)

    def set_outputs(self, render_data: RenderData, output_data: Mapping[str, Any]) -> None:
        render_data.set_outputs({str(name): proxy.warp for name, proxy in output_data.items()})

    def update_transforms(self) -> None:
        """``render`` follows the provider."""

    def update_geometries(self) -> None:
        """``render`` follows the provider."""

    def update_camera(self, render_data: RenderData, positions: Any, orientations: Any, intrinsics: Any) -> None:
        render_data.place(*map(_array, (positions, orientations, intrinsics)))

    def update_camera_intrinsics(self, render_data: RenderData, intrinsics: wp.array, parameters: wp.array) -> None:
        """Lenses may differ between environments."""
        render_data.set_lens(_array(intrinsics))

    def render(self, render_data: RenderData) -> None:
        self._follow()
        render_data.bind(self._backend.state_0)
        render_data.render()

    def read_output(self, render_data: RenderData, camera_data: Any) -> None:
        """Images are in the camera's buffers already; what their ids mean is published."""
        camera_data.info.update(render_data.info)

    def cleanup(self, render_data: RenderData | None) -> None:
        if render_data is not None:
            render_data.renderer = None

    def reset(self, render_data: RenderData, env_ids: Any = None) -> None:
        """Motion begins anew in these environments."""
        render_data.forget(env_ids)

    def close(self) -> None:
        self.scene = self._mapper = self._stage = None
        self._shaded.clear()

    def _simply_shaded(self, kind: str) -> wc.Scene:
        """The scene with the lights and materials that this data type has; cameras share it."""
        if kind not in self._shaded:
            backend = self._backend
            with preserve_cuda_context():
                self._shaded[kind] = simple_shading.shaded_scene(
                    backend.model, backend.state_0, self._stage, kind, self._choice
                )
        return self._shaded[kind]

    def _follow(self) -> None:
        """Bring the state to what the provider publishes."""
        from isaaclab.scene_data import SceneDataFormat

        backend, provider = self._backend, self._provider
        poses = SceneDataFormat.Transform()
        if provider.get_transforms(poses, mapping=self._mapping, count=backend.model.body_count):
            backend.state_0.body_q = poses.transforms
        if backend.geometry_offsets:
            provider.get_geometry_points(output=backend.state_0.particle_q, offsets=backend.geometry_offsets)

    def _labels(self) -> Any:
        if self._mapper is None:
            from isaaclab_newton.renderers.segmentation import NewtonSegmentationMapper

            plan = simulation().get_clone_plan()
            self._mapper = NewtonSegmentationMapper(self._backend.model, self._stage, self.cfg, plan)
        return self._mapper


def simulation() -> Any:
    """The one simulation of the process."""
    from isaaclab.sim import SimulationContext

    return SimulationContext.instance()


def _backend_cfg(sim: Any) -> Any:
    from isaaclab_newton.physics import NewtonBackendCfg

    return NewtonBackendCfg(physics_cfg=sim.cfg.physics, device=sim.device)


def _array(value: Any) -> wp.array:
    """Unwrap a ProxyArray."""
    return value if isinstance(value, wp.array) else value.warp


def register() -> None:
    """Let Isaac Lab know by the renderer's name that it needs a Newton model and no stage."""
    from isaaclab.scene_data import REQUIRES_STAGE_AND_MODEL

    REQUIRES_STAGE_AND_MODEL.setdefault(NAME, (False, True))


register()
