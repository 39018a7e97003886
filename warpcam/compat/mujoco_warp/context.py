"""Contents of a context, and the render calls that fill its images."""

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.compat.common import packing
from warpcam.compat.common.scalars import whole
from warpcam.compat.mujoco_warp.arguments import FIXED, View, has_skybox
from warpcam.compat.mujoco_warp.ray_casts import MOST_RAYS, RayCasts, check_arrays, chosen_geoms
from warpcam.compat.mujoco_warp.splats import gaussians_of, read_splats
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.streams import preserve_cuda_context
from warpcam.kernels.update.refit_gaussians import bind_refit_gaussians
from warpcam.scene.layers import check_tristate
from warpcam.sources.mujoco.device import load
from warpcam.sources.mujoco.model import NUM_GROUPS

MAX_SCENES = 4  # Models and Datas that a context goes to and fro between without reading them anew


class RenderContext:
    """Settings and images, for ``render``. Made by ``create_render_context``.

    Attributes:
        nrender: How many cameras are rendered; all that follows counts these.
        cam_res: vec2i (camera,), width and height [pixels].
        cam_id_map: int32 (camera,), the camera's id in the model.
        render_rgb: bool (camera,), and likewise ``render_depth`` and ``render_seg``.
        rgb_data: uint32 (world, pixel), bytes B G R A; the cameras' images one after another.
        rgb_adr: int32 (camera,), where in a row each camera's image begins, -1 for none.
        depth_data: float32 (world, pixel), planar depth [m], 0 where nothing is hit.
        depth_adr: int32 (camera,).
        seg_data: vec2i (world, pixel), id and ``mjtObj``, (-1, -1) where nothing is hit.
        seg_adr: int32 (camera,).
        znear: Of the model [m]. Nothing is cut off before it.
        zfar: Of the model [m]; what lies there is seen, and nothing beyond it.
        splat_count: Gaussians of all groups.
        splat_position: vec3 (splat,) [m]; what is written here is seen after ``refit_splat_bvh``, and likewise quat
            ``splat_rotation``, whose numbers are w x y z, vec3 ``splat_scale`` and vec4 ``splat_rgba``.
        total_rays: Pixels of all cameras.
        views: The cameras on the host.
        starts: ``rgb_adr`` and so on, on the host: by "rgb", "depth", "segmentation".
        renderer: The ``warpcam.Renderer`` behind it, of the model and data that were seen last; None before any were.
    """

    def __init__(self, mjm: mujoco.MjModel, num_worlds: int, views: Sequence[View], settings: dict[str, Any]):
        self.nworld, self.nrender = num_worlds, len(views)
        self.device = wp.get_device()
        self.renderer: wc.Renderer | None = None
        self._mjm, self._settings = mjm, settings
        self.views, self._splats = tuple(views), read_splats(settings)
        self.splat_count = sum(len(cloud["positions"]) for each in self._splats for cloud in each.listed())
        self.starts: dict[str, list[int]] = {}
        for name in ("use_textures", "use_shadows", "use_ambient_lighting", "use_fast_math", "use_precomputed_rays"):
            setattr(self, name, settings[name])
        for name in ("enable_specular", "enable_emission", "enable_per_light_ambient", *FIXED):
            setattr(self, name, settings[name])
        self.shadow_light_fraction = settings["shadow_light_fraction"]
        self.samples_per_pixel = settings["samples_per_pixel"]
        self.render_skybox = bool(settings["render_skybox"] and has_skybox(mjm))
        self.headlight_active = bool(mjm.vis.headlight.active)
        self.znear = float(mjm.vis.map.znear * mjm.stat.extent)
        self.zfar = float(mjm.vis.map.zfar * mjm.stat.extent)
        red, green, blue, self._miss_alpha = (int(255.0 * value) for value in settings["background_color"])
        self.background_color = np.uint32(self._miss_alpha << 24 | red << 16 | green << 8 | blue)
        self._enabled = geoms_of(mjm, settings["enabled_geom_groups"])
        self.bvh_ngeom = len(self._enabled)
        with wp.ScopedDevice(self.device):
            self.enabled_geom_ids = wp.array(self._enabled, dtype=int)
            self.cam_res = wp.array([view.size for view in views], dtype=wp.vec2i)
            self.cam_id_map = wp.array([view.camera for view in views], dtype=int)
            self.total_rays = sum(view.pixels for view in views)
            self.rgb_adr, self.render_rgb, rgb = self._rows("rgb")
            self.depth_adr, self.render_depth, depth = self._rows("depth")
            self.seg_adr, self.render_seg, seg = self._rows("segmentation")
            self.rgb_data = wp.zeros((num_worlds, rgb), dtype=wp.uint32)
            self.depth_data = wp.zeros((num_worlds, depth), dtype=wp.float32)
            gaussians = self._gaussians = gaussians_of(self._splats)
            self.splat_position, self.splat_rotation = gaussians.positions, gaussians.rotations.view(wp.quat)
            self.splat_scale, self.splat_rgba = gaussians.scales, gaussians.colors
            self.seg_data = wp.full((num_worlds, max(seg, 1)), wp.vec2i(-1, -1), dtype=wp.vec2i)
        self._scenes: dict[tuple[int, int], _Bound] = {}
        self._ray_casts, self._excludes = RayCasts(self), dict[int, wp.array]()
        self._made = True

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse attributes whose change would have no effect.

        MuJoCo-Warp reads its context's settings again in each frame.
        """
        if getattr(self, "_made", False) and not name.startswith("_") and name != "renderer":
            raise WarpcamError(
                f"RenderContext.{name} cannot be set: settings are read when the context is made; make another with "
                "create_render_context"
            )
        super().__setattr__(name, value)

    def bind(self, m: Any, d: Any) -> None:
        """Read a Model and a Data ahead of the first frame, which would else do it: needed before a capture.

        After this and until others come nothing is allocated or compiled.
        """
        self._bound(m, d)

    def refit_splats(self) -> None:
        """Draw Gaussians as ``splat_position`` and the others have them now, whichever Model and Data are rendered."""
        with torch_interop.in_order(self.device):
            for bound in self._scenes.values():
                for stage in bound.refit:
                    stage.launch()

    def cast_rays(
        self,
        m: Any,
        d: Any,
        pnt: wp.array,
        vec: wp.array,
        geomgroup: Any,
        flg_static: bool,
        bodyexclude: wp.array,
        dist: wp.array,
        geomid: wp.array,
        normal: wp.array,
    ) -> None:
        """Cast rays as ``warpcam.compat.mujoco_warp.rays`` does."""
        self._check_worlds(d, "rays")
        geoms = chosen_geoms(self._mjm.geom_group, self._enabled, geomgroup)
        count = pnt.shape[-1] if isinstance(pnt, wp.array) and pnt.ndim == 2 else 0
        if not 0 < count <= MOST_RAYS:
            raise WarpcamError(f"rays: pnt must have shape (1 or {self.nworld}, ray), of 1 to {MOST_RAYS} rays")
        out = (self.nworld, count)
        check_arrays(
            self.device,
            pnt=(pnt, wp.vec3, ((1, count), out)),
            vec=(vec, wp.vec3, (pnt.shape,)),
            bodyexclude=(bodyexclude, wp.int32, ((count,),)),
            dist=(dist, wp.float32, (out,)),
            geomid=(geomid, wp.int32, (out,)),
            normal=(normal, wp.vec3, (out,)),
        )
        bundle = self._ray_casts.bundle(m, d, count, pnt.shape[0], geoms, bool(flg_static), bodyexclude)
        bundle.cast(pnt, vec, bodyexclude, (dist, geomid, normal))

    def cast_ray(
        self, m: Any, d: Any, pnt: wp.array, vec: wp.array, geomgroup: Any, flg_static: bool, bodyexclude: int
    ) -> tuple[wp.array, wp.array, wp.array]:
        """Cast one ray in every world as ``warpcam.compat.mujoco_warp.ray`` does."""
        if not isinstance(pnt, wp.array) or pnt.ndim != 2 or pnt.shape[1] != 1:
            came = pnt.shape if isinstance(pnt, wp.array) else type(pnt).__name__
            raise WarpcamError(f"ray: pnt must have shape (1 or {self.nworld}, 1), got {came}; rays takes several")
        body = whole(bodyexclude)
        if body is None:
            raise WarpcamError(f"ray: bodyexclude must be the id of a body or -1, got {bodyexclude!r}")
        if body not in self._excludes:
            self._excludes[body] = wp.full(1, body, dtype=wp.int32, device=self.device)
        outs = tuple(
            wp.empty((self.nworld, 1), dtype=dtype, device=self.device) for dtype in (wp.float32, wp.int32, wp.vec3)
        )
        self.cast_rays(m, d, pnt, vec, geomgroup, flg_static, self._excludes[body], *outs)
        return outs

    def _check_worlds(self, d: Any, where: str) -> None:
        if not hasattr(d, "nworld"):
            raise WarpcamError(f"{where}: d must be a mujoco_warp.Data, got {type(d).__name__}")
        if d.nworld != self.nworld:
            raise WarpcamError(f"{where}: d has {d.nworld} worlds, the context was made for {self.nworld}")

    def _bound(self, m: Any, d: Any) -> "_Bound":
        key = (id(m), id(d))
        bound = self._scenes.get(key)
        if bound is None:
            self._check_worlds(d, "render")
            if torch_interop.is_capturing(self.device):
                raise WarpcamError(
                    "render: a capture is under way, and this Model and Data have not been seen before; call "
                    "refit_bvh(m, d, rc) once before the capture"
                )
            while len(self._scenes) >= MAX_SCENES:
                self._scenes.pop(next(iter(self._scenes)))
            bound = self._scenes[key] = _Bound(self, m, d)
        if self.renderer is not bound.renderer:
            self.renderer = bound.renderer
        return bound

    def _rows(self, output: str) -> tuple[wp.array, wp.array, int]:
        """Return the start of each camera's image, whether it has one, and the length of a row."""
        starts, end = [], 0
        for view in self.views:
            starts.append(end if output in view.outputs else -1)
            end += view.pixels if output in view.outputs else 0
        self.starts[output] = starts
        rendered = [output in view.outputs for view in self.views]
        return wp.array(starts, dtype=int), wp.array(rendered, dtype=bool), end

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise AttributeError(
            f"warpcam's render context has no {name!r}: there is no bounding volume hierarchy of the scene and there "
            "are no precomputed rays. mujoco_warp.rays needs a context of mujoco_warp; that of this module takes both"
        )


class _Bound:
    """A context's renderer of one Model and Data, and the stages that pack its images."""

    def __init__(self, context: RenderContext, m: Any, d: Any):
        settings = context._settings
        self._m, self._d, self._device = m, d, context.device
        mjm, self._look = camera_settings_of(context, m)
        with preserve_cuda_context():
            scene = load_groups(
                mjm,
                m if self._look is None else self._look.model,
                d,
                groups=settings["enabled_geom_groups"],
                draw=settings["draw"],
                reflections=settings["reflections"],
                transparency=settings["transparency"],
                splats=context._splats,
            )
        if scene.device != context.device:
            raise WarpcamError(
                f"device: d is on {scene.device.alias}, but the render context on {context.device.alias}, which was "
                "Warp's current device when it was made; both must be on one"
            )
        splats = scene.tables().splats
        refit = bind_refit_gaussians(context._gaussians, splats, scene.device) if context._splats else []
        self.refit = tuple(refit)
        for stage in refit:
            stage.launch()
        cameras, color = cameras_of(context.views, mjm, settings)
        self.renderer = wc.Renderer(scene, cameras) if cameras else None
        self._stages = self._pack(context, color, scene) if self.renderer is not None else []
        for stage in self._stages:
            stage.prepare()

    def render(self) -> None:
        if self._look is not None:
            self._look.follow(self._m)
        if self.renderer is None:
            return
        with torch_interop.in_order(self._device):
            self.renderer.render()
            for stage in self._stages:
                stage.launch()

    def _pack(self, context: RenderContext, color: str, scene: wc.Scene) -> list[Stage]:
        stages, device = [], self._device
        objects = wp.array(scene.objects, dtype=wp.vec2i, device=device)
        assert self.renderer is not None
        for place, view in enumerate(context.views):
            for name in view.outputs:
                start = context.starts[name][place]
                image = self.renderer.array(view.camera, color if name == "rgb" else name)
                if name == "rgb":
                    out, alpha = context.rgb_data, context._miss_alpha
                    stages.append(packing.bind_color(image, packing.BGRA, out, start, device, alpha))
                elif name == "depth":
                    stages.append(packing.bind_values(image, context.depth_data, start, device))
                else:
                    stages.append(packing.bind_objects(image, objects, context.seg_data, start, device))
        return stages


def cameras_of(views: Sequence[View], mjm: mujoco.MjModel, settings: Mapping[str, Any]) -> tuple[list[wc.Camera], str]:
    """The cameras that have images, and the output that is their colour."""
    # As context.background_color has it, which a pixel is compared with: cut, where a camera's own is rounded.
    skybox = settings["render_skybox"] and has_skybox(mjm)
    *parts, alpha = (int(255.0 * value) / 255.0 for value in settings["background_color"])
    plain = None if skybox else (parts[0], parts[1], parts[2])
    color, far = "rgb" if plain is None or alpha == 1.0 else "rgba", farthest_of(mjm)
    cameras = [
        wc.Camera(
            view.camera,
            width=view.size[0],
            height=view.size[1],
            outputs=[color if name == "rgb" else name for name in view.outputs],
            far=far,
            depth_clipping="zero",
            shadows=bool(settings["use_shadows"]),
            antialiasing=settings["samples_per_pixel"] ** 2 if "rgb" in view.outputs else 1,
            background=plain,
        )
        for view in views
        if view.outputs
    ]
    return cameras, color


def farthest_of(mjm: mujoco.MjModel) -> float | None:
    """Return the nearest depth that is not seen any more: what lies at ``zfar`` is; None if all is seen [m]."""
    zfar = np.float32(mjm.vis.map.zfar * mjm.stat.extent)
    return float(np.nextafter(zfar, np.float32(np.inf))) if zfar > 0.0 else None


def geoms_of(mjm: mujoco.MjModel, groups: Sequence[int]) -> np.ndarray:
    """Ids of geoms of these very groups, where MuJoCo's renderer takes what is beyond 0 to 5 for the nearest."""
    return np.flatnonzero(np.isin(mjm.geom_group, groups))


def load_groups(
    mjm: mujoco.MjModel,
    m: Any,
    d: Any,
    groups: Sequence[int],
    draw: Sequence[str],
    reflections: bool | None,
    transparency: bool | None,
    splats: Sequence[wc.Splats] = (),
) -> wc.Scene:
    """The scene of ``warpcam.from_mujoco_warp``, with the geoms of ``geoms_of``."""
    others = [group for group in groups if 0 <= group < NUM_GROUPS]
    chosen = check_tristate("transparency", transparency)
    geoms = geoms_of(mjm, groups)
    return load(
        mjm,
        m,
        d,
        groups=others,
        draw=draw,
        reflections=reflections,
        transparency=chosen,
        geoms=geoms,
        splats=splats,
    )


class CameraSettings:
    """A Model that shares all but some looks with the user's, and follows it when its arrays are replaced."""

    def __init__(self, m: Any, blank: dict[str, int]):
        self.model = copy.copy(m)
        self._blank, self._arrays = blank, dict[str, wp.array]()
        self.follow(m)

    def follow(self, m: Any) -> None:
        attributes = vars(self.model)
        attributes.update(vars(m))
        for name, value in self._blank.items():
            theirs = getattr(m, name)
            mine = self._arrays.get(name)
            if mine is None or mine.shape != theirs.shape:
                mine = self._arrays[name] = wp.empty(theirs.shape, dtype=theirs.dtype, device=theirs.device)
                mine.fill_(theirs.dtype(value))
            attributes[name] = mine


def camera_settings_of(context: RenderContext, m: Any) -> tuple[mujoco.MjModel, CameraSettings | None]:
    """The models to read: the user's own unless the settings leave out some of their looks."""
    mjm, blank = without_looks(context._mjm, context._settings)
    return mjm, CameraSettings(m, blank) if blank else None


def without_looks(mjm: mujoco.MjModel, settings: Mapping[str, Any]) -> tuple[mujoco.MjModel, dict[str, int]]:
    """The host's model with another headlight if the settings ask for it, and what fields of a model are to be."""
    blank: dict[str, int] = {}
    colors = []
    if not settings["use_textures"]:
        blank["mat_texid"] = -1
    if not settings["enable_emission"]:
        blank["mat_emission"] = 0
    if not settings["enable_specular"]:
        blank["light_specular"] = 0
        colors.append("specular")
    if not settings["use_ambient_lighting"]:
        colors.append("ambient")
    if not (settings["use_ambient_lighting"] and settings["enable_per_light_ambient"]):
        blank["light_ambient"] = 0
    if colors:
        mjm = copy.copy(mjm)
        headlight = mjm.vis.headlight
        if not headlight.active and "ambient" in colors:  # on but black: else MuJoCo lights evenly what has no light
            headlight.active, colors = 1, ["ambient", "diffuse", "specular"]
        for name in colors:
            getattr(headlight, name)[:] = 0.0
    return mjm, blank
