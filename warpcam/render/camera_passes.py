"""The images of one camera, and the stages that make them."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Projection
from warpcam.camera.lens_tables import RayTableLens
from warpcam.core.errors import WarpcamError
from warpcam.kernels.layers import Mirror
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.film import FilmArrays, bind_again
from warpcam.kernels.passes.paths import bind_more
from warpcam.kernels.plan.film import LIGHT
from warpcam.kernels.plan.frame import FINE, FramePlan, plan_frame
from warpcam.kernels.plan.occlusion import traces_occlusion
from warpcam.kernels.plan.passes import PASSES
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.runtime.launch import Group, Stage
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import View
from warpcam.render.flow_history import CameraHistory, needs_history
from warpcam.render.occlusion import NO_OCCLUSION, Occlusion, make_occlusion
from warpcam.render.paths import PathOptions, make_lists, make_paths

MAX_PIXELS = 2**31


def check_size(camera: Camera, num_worlds: int, reflections: bool = False) -> None:
    across, down = parts_of(camera, reflections)
    if across > 1 and isinstance(camera.lens, RayTableLens) and not camera.lens.has_parts:
        raise WarpcamError(
            f"{camera.where}: antialiasing is {camera.antialiasing} and the renderer has reflections, which takes rays "
            f"of a pixel's parts, and {type(camera.lens).__name__} has a ray for each pixel; 1 is allowed"
        )
    if num_worlds * camera.height * camera.width * across * down >= MAX_PIXELS:
        parts = f" with antialiasing={camera.antialiasing}, of {across * down} parts each," if across > 1 else ""
        raise WarpcamError(
            f"{camera.where}: {num_worlds} worlds of {camera.width} x {camera.height} pixels{parts} are 2^31 "
            "pixels or more; fewer are allowed in one camera"
        )


def parts_of(camera: Camera, reflections: bool = False) -> tuple[int, int]:
    """Parts of a pixel, across and down, that are drawn as pixels of a finer image; (1, 1) where none is."""
    return request_of(camera, "pinhole", reflections=reflections).parts


def request_of(
    camera: Camera,
    projection: Projection,
    paths: bool = False,
    occlusion: Occlusion = NO_OCCLUSION,
    reflections: bool = False,
) -> ImageRequest:
    """The images that a camera asks for.

    Args:
        camera: The camera.
        projection: Of its rays.
        paths: Lit images are traced by paths of light.
        occlusion: What hides light in them.
        reflections: Rays find what surfaces mirror, and what is seen through clear ones.
    """
    return ImageRequest(
        camera.width,
        camera.height,
        projection,
        tuple(camera.outputs),
        shadows=camera.shadows,
        antialiasing=camera.antialiasing,
        tone_mapping=camera.tone_mapping,
        paths=paths,
        metered=camera.auto_exposure is not None,
        bloom=camera.bloom is not None,
        reflections=reflections,
        ambient_occlusion=occlusion.radius is not None and not occlusion.indirect,
        indirect_light=occlusion.indirect,
        soft_shadows=occlusion.soft,
    )


@dataclass(frozen=True)
class Stages:
    """Stages that render one group of worlds.

    Attributes:
        visibility: Up to those that find what is seen and what lies in shadows.
        shading: The rest; nothing else writes ``FramePlan.late``.
        adding: Those that add paths to the last frame, where lit images are traced by paths of light.
    """

    visibility: list[Stage]
    shading: list[Stage]
    adding: list[Stage]


class ViewArrays:
    """A camera's views in all worlds, and what passes keep for each.

    Attributes:
        plan: Of the images that are drawn of these views.
        parts: Of a pixel of the camera, across and down, that are pixels of these images.
        views: View, (world,).
        lists: vec4, (world, row): the shapes that the images may show, where a stage or a pass lists them; else None.
        mirrors: Mirror, (world,); empty where no image shows mirrors.
        mirrored: View, (world,), likewise: the views from behind the mirrors.
    """

    def __init__(self, plan: FramePlan, parts: tuple[int, int], num_worlds: int, device: wp.Device):
        self.plan, self.parts = plan, parts
        self.views = wp.zeros(num_worlds, dtype=View, device=device)
        behind = num_worlds if plan.mirrors else 0
        self.mirrored = wp.zeros(behind, dtype=View, device=device)
        self.mirrors = wp.zeros(behind, dtype=Mirror, device=device)
        rows = plan.list_rows
        self.lists = wp.zeros((num_worlds, rows), dtype=wp.vec4, device=device) if rows else None


class CameraPasses:
    """Arrays of one camera, as far as its outputs need them.

    Args:
        camera: What it is asked for.
        projection: Of its rays.
        tables: The scene.
        device: Where the arrays lie.
        paths: Options of paths, where lit images are traced by paths of light, and int32, (1,): those that are added.
        occlusion: What hides light.
        reflections: Rays find what surfaces mirror, and what is seen through clear ones.
        film: FilmArrays, where what is shown depends on the light of a whole image.

    Attributes:
        plan: Of all worlds drawn together.
        seen: Views of the camera.
        finer: Views whose pixels are parts of the camera's; None where none are drawn.
        images: Array of each output, (world, height, width, channels).
        history: What is kept of the last frame; None where no output needs it.
    """

    def __init__(
        self,
        camera: Camera,
        projection: Projection,
        tables: SceneTables,
        device: wp.Device,
        paths: tuple[PathOptions, wp.array] | None = None,
        occlusion: Occlusion = NO_OCCLUSION,
        reflections: bool = False,
        film: FilmArrays | None = None,
    ):
        num_worlds = tables.num_worlds
        size = (num_worlds, camera.height, camera.width)
        self._request = request_of(camera, projection, paths is not None, occlusion, reflections)
        self._device = device
        self.plan = plan_frame(tables, self._request, device)
        plan, parts = self.plan, self._request.parts
        self.seen = ViewArrays(plan, (1, 1), num_worlds, device)
        self.finer = None if plan.fine is None else ViewArrays(plan.fine, parts, num_worlds, device)
        self.images: dict[str, wp.array] = {
            name: wp.zeros((*size, OUTPUTS[name].channels), dtype=OUTPUTS[name].dtype, device=device)
            for name in camera.outputs
        }
        self._paths, self._film = make_lists(tables, device) if plan.reflects else None, film
        if plan.paths and paths is not None:
            self._paths = make_paths(tables, camera.width * camera.height, *paths, device)
        self._occlusion = make_occlusion(tables, occlusion.radius, device) if traces_occlusion(plan.keys) else None
        listed = plan.lists is not None
        self.history = CameraHistory(camera, tables, device, self.images, listed) if needs_history(camera) else None

    @property
    def views(self) -> wp.array:
        """View, (world,), of the camera."""
        return self.seen.views

    @property
    def pixels(self) -> int:
        """Pixels that are drawn of each world."""
        return math.prod((self._request.width, self._request.height, *self._request.parts))

    def bind(
        self,
        tables: SceneTables,
        group: Group,
        buffers: Mapping[str, wp.array],
        mask: wp.array,
        faults: wp.array,
    ) -> tuple[FramePlan, Stages]:
        """Plan and bind the stages that make the images of a group of worlds, by way of ``buffers``."""
        seen, plan = self.seen, plan_frame(tables, self._request, self._device, group)
        request = self._request.undeveloped
        parts = {name.removeprefix(FINE): buffer for name, buffer in buffers.items() if name.startswith(FINE)}
        finer = {name: _as_image(parts[name], name) for name in request.fine.outputs if name in parts}
        images = self.images | {FINE + name: image for name, image in finer.items()}
        if LIGHT in buffers:
            images["hdr"] = _as_image(buffers[LIGHT], "hdr")
        frame = CameraFrame(
            tables=tables,
            width=request.width,
            height=request.height,
            lens=request.lens,
            views=seen.views,
            mask=mask,
            faults=faults,
            images=images,
            buffers=buffers,
            mirrors=seen.mirrors,
            mirrored=seen.mirrored,
            flow_history=None if self.history is None else self.history.flow_history,
            lists=seen.lists,
            group=group,
            device=self._device,
            parts=request.parts,
            paths=self._paths,
            film=self._film,
            occlusion=self._occlusion,
        )
        visibility, shading = _bound(plan, frame)
        if plan.fine is not None and self.finer is not None:
            first, second = _bound(plan.fine, self._finer_frame(frame, self.finer, finer, parts))
            visibility, shading = [*visibility, *first], [*second, *shading]  # means come last
        adding = [*bind_more(plan.shading, frame), *bind_again(plan.shading, frame)] if plan.paths else []
        return plan, Stages(visibility, shading, adding)

    def _finer_frame(
        self, frame: CameraFrame, finer: ViewArrays, images: Mapping[str, wp.array], buffers: Mapping[str, wp.array]
    ) -> CameraFrame:
        """The frame of images whose pixels are parts of the camera's."""
        request = self._request.fine
        return replace(
            frame,
            width=request.width,
            height=request.height,
            views=finer.views,
            images=images,
            buffers=buffers,
            mirrors=finer.mirrors,
            mirrored=finer.mirrored,
            flow_history=None,
            lists=finer.lists,
        )


def _bound(plan: FramePlan, frame: CameraFrame) -> Iterator[list[Stage]]:
    """Yield the stages of visibility, and those of shading."""
    for passes in (plan.visibility, plan.shading):
        stages = [PASSES[each.name].bind(each, frame) for each in passes]
        for stage, each in zip(stages, passes, strict=True):
            stage.reads = each.reads
        yield stages


def _as_image(pixels: wp.array, output: str) -> wp.array:
    """See pixels (world, height, width, 1) as the image (world, height, width, channels) of an output."""
    shape = (*pixels.shape[:3], OUTPUTS[output].channels)
    return wp.array(ptr=pixels.ptr, shape=shape, dtype=OUTPUTS[output].dtype, device=pixels.device)
