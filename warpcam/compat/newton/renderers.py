"""Views of a Newton model: renderers for the sizes and images that are asked for, and the way in and out of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import newton
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.compat.newton import kernels
from warpcam.compat.newton.lens_detection import RayBundle, RayBundles
from warpcam.compat.newton.render_config import (
    USUAL_LIMITS,
    RenderSettings,
    check_config,
    check_shapes,
    checkerboard,
    default_direction,
    linear_color,
    require_unchanged,
    splat_limits,
)
from warpcam.compat.newton.visibility_options import VisibilityState
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import bind_launch, launch_kernel
from warpcam.kernels.runtime.streams import preserve_cuda_context
from warpcam.kernels.types import ROLE_COLOR
from warpcam.sources.newton.options import NewtonOptions
from warpcam.sources.newton.source import load

MAX_RENDERERS = 8  # sizes and sets of images that a sensor goes to and fro between
# What is asked for: the field of Images, the outputs it is made of, and its dtype.
IMAGES: Mapping[str, tuple[str, str, Any]] = {
    "color_image": ("color", "rgb", wp.uint32),
    "hdr_color_image": ("hdr", "hdr", wp.vec3),
    "depth_image": ("depth", "depth", wp.float32),
    "forward_depth_image": ("forward", "depth", wp.float32),
    "shape_index_image": ("shape", "segmentation", wp.uint32),
    "normal_image": ("normal", "normals", wp.vec3),
    "albedo_image": ("albedo", "albedo", wp.uint32),
}
# Each output and the field of Sources that it is.
SOURCES: Mapping[str, str] = {
    "depth": "depth",
    "distance": "depth",
    "rgb": "color",
    "rgba": "color",
    "hdr": "hdr",
    "segmentation": "shape",
    "normals": "normal",
    "albedo": "albedo",
}
# Which setting says what of a model is drawn.
SETTINGS: Mapping[str, str] = {
    "backs": "enable_backface_culling",
    "particles": "enable_particles",
    "shared": "enable_global_world",
    "triplanar": "texture_projection_mode",
}


class Mapped:
    """World and camera of each view.

    Attributes:
        worlds: int32 (view,).
        cameras: int32 (view,).
        mask: uint8 (world,), or None for all.
        num_cameras: How many cameras there are; with 1, every camera sees all views.
    """

    def __init__(self, num_views: int, num_worlds: int, num_cameras: int, device: wp.Device):
        self.worlds = wp.zeros(num_views, dtype=wp.int32, device=device)
        self.cameras = wp.zeros(num_views, dtype=wp.int32, device=device)
        self.counts = wp.zeros(num_worlds, dtype=wp.int32, device=device)
        self.mask: wp.array | None = wp.zeros(num_worlds, dtype=wp.uint8, device=device)
        self.left_out = wp.zeros(1, dtype=wp.int32, device=device)
        self.num_cameras = num_cameras

    def choose(self, wanted: wp.array) -> None:
        """Read the worlds that the views are to be of."""
        assert self.mask is not None
        self.counts.zero_()
        self.mask.zero_()
        inputs = [wanted, self.num_cameras, self.counts, self.worlds, self.cameras, self.mask, self.left_out]
        launch_kernel(kernels.choose_cameras, len(wanted), inputs, device=self.worlds.device)


class RendererCache:
    """All views of a model, for the sensors.

    Attributes:
        scene: The ``warpcam.Scene``.
        looks: Its light and textures.
        bundles: The rays that have been seen.
    """

    def __init__(self, model: newton.Model, physical: bool, textures: bool, simulated: bool, visual: bool):
        self.model, self.device = model, model.device
        self.looks, self.bundles = RenderSettings(model, physical), RayBundles()
        self._board: np.ndarray | None = None
        self._checked: np.ndarray | None = None
        self._num_finishes, self._drawn = 0, VisibilityState(model, simulated, visual, textures)
        self._limits: tuple[float, float] | None = None  # of splats, as far as it is known
        self._captured = False  # whether graphs may write other limits whenever they are launched
        self._held: dict[tuple[int, int], Any] = {}  # what graphs use
        self._choice: NewtonOptions = self._drawn.usual
        self._build(self._choice)
        self._most_finishes = self._num_finishes  # other choices draw no more

    def assign_checkerboard(self, shape_indices: Any, resolution: Any, checker_size: Any) -> None:
        """Let these shapes alone show a checkerboard."""
        if torch_interop.is_capturing(self.device):
            raise WarpcamError("assign_checkerboard_material: a capture is under way; call it before")
        shapes, board = check_shapes(shape_indices, self.model), checkerboard(resolution, checker_size)
        with torch_interop.in_order(self.device):
            self._checked = shapes
            if self._board is None or not np.array_equal(board, self._board):
                self._board = board
                self._build(self._choice)
            else:
                self.looks.check(shapes, self._first_image)

    def _choose(self, config: Any) -> None:
        """Draw what the settings say; another scene draws something else."""
        choice = self._drawn.choice(config, self._choice.triplanar)
        if choice == self._choice:
            return
        changed = [name for name in vars(choice) if getattr(choice, name) != getattr(self._choice, name)]
        require_unchanged([SETTINGS[name] for name in changed], torch_interop.is_capturing(self.device))
        if changed != ["triplanar"] or self.looks.have_textures():
            self._build(choice)
        self._choice = choice

    def _limit_splats(self, limits: tuple[float, float]) -> None:
        source: Any = self.scene._source
        self._captured |= torch_interop.is_capturing(self.device)
        if source.parts.splat_limits is not None and (limits != self._limits or self._captured):
            source.parts.splat_limits.fill_(wp.vec2(*limits))
        self._limits = limits

    def _build(self, choice: NewtonOptions) -> None:
        """Make the scene, anew where the images that shapes may show are others, or lie another way."""
        model = self.model
        light = wc.Light(direction=default_direction(model))
        images = []
        if self._board is not None:  # for each of the model's materials one that shows it
            images = [self._board, *[np.zeros((1, 1, 3), np.uint8)] * (self._most_finishes - 1)]
        self._renderers: dict[tuple[Any, ...], _Traced] = {}  # their images make room
        with preserve_cuda_context():
            self.scene = load(
                model,
                model.state(),
                lights=[light] * 2,
                ambient=(0.0, 0.0, 0.0),
                semantics=None,
                transparency=None,
                textures=images,
                choice=choice,
            )
        self._choice = choice
        self._num_finishes = self.scene.array("material_roughness").shape[1] - len(images)
        first = self.scene.array("material_texture").numpy()[0, self._num_finishes :, ROLE_COLOR]
        self._first_image = int(first[0]) if len(first) else -1
        self.looks.take(self.scene, self._num_finishes)
        if self._checked is not None:
            self.looks.check(self._checked, self._first_image)
        self._limits = None
        self._limit_splats(USUAL_LIMITS)  # for renderers of the user's own, before the first update

    def render(
        self,
        state: newton.State,
        mapped: Mapped,
        views: "list[tuple[wp.array, wp.array, dict[str, wp.array]]]",
        clear_data: Any,
        config: Any,
        visuals: Any = None,
    ) -> None:
        """Draw views.

        Args:
            state: Of the model.
            mapped: Worlds and cameras of the views.
            views: For each camera the views' transforms, their rays and their images, (view, height, width).
            clear_data: Newton's ClearData.
            config: Newton's RenderConfig.
            visuals: Newton's DeformableVisuals that visual meshes are drawn from; None draws them from the state.
        """
        seen = [_Seen(number, self.bundles.find(view[1]), *view) for number, view in enumerate(views)]
        samples = max(each.bundle.samples for each in seen)
        check_config(config, samples)
        if not any(images for *_, images in views):
            return
        with torch_interop.in_order(self.device):
            self._choose(config)
            if self._drawn.splats:
                self._limit_splats(splat_limits(config))
            self.scene.bind(state)
            source: Any = self.scene._source
            source.bind_visual_points(None if visuals is None else visuals.points)
            self.looks.show(config, torch_interop.is_capturing(self.device))
            traced = self._traced(seen, clear_data, config)
            if torch_interop.is_capturing(self.device):
                self._held[id(traced), id(mapped)] = traced, mapped, [each.bundle for each in seen]
            for camera, each in enumerate(seen):
                traced.place(camera, mapped, each)
            traced.renderer.render(worlds=mapped.mask)
            for camera, each in enumerate(seen):
                traced.write(camera, mapped, each, clear_data, config)

    def _traced(self, seen: "list[_Seen]", clear_data: Any, config: Any) -> "_Traced":
        smooth = any(each.bundle.samples > 1 for each in seen)
        linear = config.output_color_space == newton.utils.ColorSpace.LINEAR
        asked = tuple(
            tuple(_outputs(each.images, smooth, linear, isinstance(each.bundle.lens, wc.Rays))) for each in seen
        )
        background = tuple((int(clear_data.clear_color) >> shift & 255) / 255.0 for shift in (0, 8, 16))
        kinds = tuple(each.bundle.kind for each in seen)
        key = (kinds, asked, smooth, bool(config.enable_shadows), background)
        traced = self._renderers.pop(key, None)
        if traced is None:
            if torch_interop.is_capturing(self.device):
                raise WarpcamError(
                    "update: a capture is under way, and images of this kind have not been asked for before; call "
                    "update likewise once before the capture"
                )
            if len(self._renderers) >= MAX_RENDERERS:
                self._renderers.pop(next(iter(self._renderers)))
            cameras = [
                wc.Camera(
                    f"view {number}",
                    width=each.bundle.size[0],
                    height=each.bundle.size[1],
                    outputs=outputs,
                    lens=each.bundle.lens,
                    position=(0.0, 0.0, 0.0),
                    shadows=bool(config.enable_shadows),
                    antialiasing=4 if smooth else 1,
                    background=background,
                )
                for number, (each, outputs) in enumerate(zip(seen, asked, strict=True))
            ]
            traced = _Traced(self.scene, cameras)
        self._renderers[key] = traced
        return traced


@dataclass(frozen=True, eq=False)
class _Seen:
    """Views by one camera of the user's.

    Attributes:
        number: Of the camera.
        bundle: What its rays are.
        transforms: Of the views.
        rays: Its rays.
        images: What is written.
    """

    number: int
    bundle: RayBundle
    transforms: wp.array
    rays: wp.array
    images: Mapping[str, wp.array]


class _Traced:
    """A renderer, with its arrays for the kernels."""

    def __init__(self, scene: wc.Scene, cameras: list[wc.Camera]):
        self.renderer, self._device = wc.Renderer(scene, cameras), scene.device
        self._poses, self._sources = [], []
        for camera in cameras:
            arrays = self.renderer.camera(camera.name)
            intrinsics, flat = isinstance(camera.lens, wc.Pinhole), isinstance(camera.lens, wc.Orthographic)
            self._poses.append(
                (
                    wp.from_torch(arrays.position, dtype=wp.vec3),
                    wp.from_torch(arrays.rotation, dtype=wp.vec4),
                    wp.from_torch(arrays.intrinsics, dtype=wp.vec4) if intrinsics else _none(1, wp.vec4, self._device),
                    wp.from_torch(arrays.height) if flat else _none(1, wp.float32, self._device),
                )
            )
            sources = kernels.RenderedImages()
            sources.along = int(isinstance(camera.lens, wc.Rays))
            for name, dtype in (("color", wp.uint8), ("albedo", wp.uint8), ("hdr", wp.float32)):
                setattr(sources, name, _none(4, dtype, self._device))
            sources.shape, sources.normal = _none(4, wp.int32, self._device), _none(4, wp.float32, self._device)
            for output in camera.outputs:
                setattr(sources, SOURCES[output], self.renderer.array(camera.name, output))
            self._sources.append(sources)
        self._empty = {field: _none(3, dtype, self._device) for field, _, dtype in IMAGES.values()}

    def place(self, camera: int, mapped: Mapped, seen: _Seen) -> None:
        bundle, transforms = seen.bundle, seen.transforms
        number = seen.number if mapped.num_cameras > 1 else 0
        inputs = [transforms, mapped.worlds, mapped.cameras, number, wp.vec3(*bundle.origin), wp.vec4(*bundle.numbers)]
        launch_kernel(kernels.place_views, len(transforms), [*inputs, *self._poses[camera]], device=self._device)

    def write(self, camera: int, mapped: Mapped, seen: _Seen, clear_data: Any, config: Any) -> None:
        clear, out = kernels.ClearValues(), kernels.SensorImages()
        linear = config.output_color_space == newton.utils.ColorSpace.LINEAR
        clear.color, clear.albedo = (
            wp.uint32(linear_color(packed) if linear else packed)
            for packed in (clear_data.clear_color, clear_data.clear_albedo)
        )
        clear.depth, clear.shape = float(clear_data.clear_depth), wp.uint32(clear_data.clear_shape_index)
        clear.normal = wp.vec3(*clear_data.clear_normal)
        for name, (field, _, _) in IMAGES.items():
            setattr(out, field, seen.images.get(name, self._empty[field]))
        number = seen.number if mapped.num_cameras > 1 else 0
        inputs = [mapped.worlds, mapped.cameras, number, seen.rays, float(config.max_distance), int(linear), clear]
        inputs += [self._sources[camera], out]
        count = len(mapped.worlds) * seen.rays.shape[0] * seen.rays.shape[1]
        bind_launch(kernels.write_views, count, inputs, self._device).launch()


def _outputs(images: Mapping[str, wp.array], smooth: bool, linear: bool, table: bool) -> list[str]:
    outputs = ["distance" if table else "depth"]
    for name in images:
        output = IMAGES[name][1]
        if name == "color_image":
            output = "hdr" if linear else "rgba" if smooth else "rgb"
        if table and output == "depth":
            output = "distance"
        if output not in outputs:
            outputs.append(output)
    return sorted(outputs)


def _none(ndim: int, dtype: Any, device: wp.Device) -> wp.array:
    return wp.empty((0,) * ndim, dtype=dtype, device=device)
