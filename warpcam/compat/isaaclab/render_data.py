"""One camera of Isaac Lab: its renderer, its buffers, and how images get into them."""

from collections.abc import Callable, Mapping
from typing import Any

import newton
import numpy as np
import warp as wp
from isaaclab.renderers.segmentation_colors import BACKGROUND_ID, UNLABELLED_ID, pack_rgba, random_color_from_id

import warpcam as wc
from warpcam import sensors
from warpcam.compat.common import packing
from warpcam.compat.isaaclab import isp, simple_shading
from warpcam.compat.isaaclab.lenses import lens_of
from warpcam.compat.isaaclab.tonemap import bind_tonemap
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import Stage, launch_kernel

# Isaac Lab's cameras look along +x with z up: this turns them to look along -z with y up. x y z w.
TURN = (0.5, -0.5, -0.5, 0.5)
WHITE = (1.0, 1.0, 1.0)
GRAY = 0xEE / 255.0  # what its renderers have behind everything unless told
# The output that each data type is made of. "rgb" is a view of "rgba".
SOURCES: Mapping[str, str] = {
    "rgba": "rgb",
    "rgb_hdr": "hdr",
    "albedo": "albedo",
    "depth": "depth",
    "distance_to_image_plane": "depth",
    "distance_to_camera": "distance",
    "normals": "normals",
    "motion_vectors": "flow",
    "semantic_segmentation": "segmentation",
    "instance_segmentation": "segmentation",
    "instance_id_segmentation_fast": "segmentation",
    **dict.fromkeys(simple_shading.LEVELS, "hdr"),
}
CLIPPING = ("none", "max", "zero")
LABELLED = ("semantic_segmentation", "instance_segmentation")
OPAQUE_BLACK = 0xFF000000


class RenderData:
    """One camera.

    Args:
        scene: What it looks at, lit as ``spec`` asks for.
        model: The Newton model that the scene was made of.
        spec: Isaac Lab's CameraRenderSpec.
        cfg: The renderer's configuration.
        mapper: Isaac Lab's mapper of labels to ids, if one of ``LABELLED`` may be asked for.

    Attributes:
        renderer: The ``warpcam.Renderer``, None until there are buffers.
        info: What goes to ``camera_data.info``, by data type.
    """

    def __init__(self, scene: wc.Scene, model: newton.Model, spec: Any, cfg: Any, mapper: Any = None):
        self._scene, self._model, self._spec, self._cfg, self._mapper = scene, model, spec, cfg, mapper
        spawn = spec.cfg.spawn
        self._lens = lens_of(spawn, spec.cfg.width, spec.cfg.height)
        self._isp = isp.effect_of(getattr(spec.cfg, "isp_cfg", None))
        if spec.view_count != scene.num_worlds:
            raise WarpcamError(
                f"the camera has {spec.view_count} views for {scene.num_worlds} environments; one each is allowed"
            )
        clipping = spawn.clipping_range if spawn is not None else (0.0, cfg.max_distance)
        self._near, self._far = float(clipping[0]), float(clipping[1])
        if not self._near < self._far:
            raise WarpcamError(
                f"CameraCfg.spawn.clipping_range is {tuple(clipping)}; allowed is a near plane before the far one"
            )
        if cfg.depth_clipping_behavior not in CLIPPING:
            raise WarpcamError(
                f"WarpcamRendererCfg.depth_clipping_behavior is {cfg.depth_clipping_behavior!r}; allowed are "
                f"{', '.join(CLIPPING)}"
            )
        color = spec.cfg.background_color
        color = None if color is None else tuple(min(max(float(part), 0.0), 1.0) for part in color)
        self._simple = simple_shading.chosen_from(spec.cfg.data_types)
        self._background: Any = (GRAY,) * 3 if color is None else color
        if self._simple is not None:
            self._background = (0.0, 0.0, 0.0) if color is None else np.tile(WHITE, (scene.num_worlds, 1))
        # Brighter than a background may be told to be: written in place, in the array that one for each world has.
        self._behind = None if self._simple is None or color is None else simple_shading.background_of(color)
        self.renderer: wc.Renderer | None = None
        self._rig: sensors.Rig | None = None  # where images are processed
        self.info: dict[str, Any] = {}
        self._pose: tuple[Any, ...] = ()
        self._after: list[Callable[[], Any]] = []
        self._targets: tuple[wp.array, ...] = ()

    def set_outputs(self, buffers: Mapping[str, wp.array]) -> None:
        """Have images written to ``buffers``, (world, height, width, channels) by data type."""
        kinds = [kind for kind in buffers if kind != "rgb"]
        for kind in kinds:
            if kind not in SOURCES:
                raise WarpcamError(f"data type {kind!r} is not offered; allowed are rgb, {', '.join(SOURCES)}")
            if kind in simple_shading.LEVELS and kind != self._simple:
                raise WarpcamError(f"{kind}: the camera was made without it in CameraCfg.data_types")
        if self._simple is not None:
            simple_shading.chosen_from((self._simple, *buffers))  # its scene is lit for that alone
        camera, pinhole = self._spec.cfg, isinstance(self._lens, wc.Pinhole)
        if "motion_vectors" in kinds and not pinhole:
            raise WarpcamError("motion_vectors are not offered for fisheye and distorted lenses")
        if not kinds:  # a camera for its pose alone
            self.renderer, self._rig, self._targets, self._after = None, None, (), []
            return
        outputs = list(dict.fromkeys(SOURCES[kind] for kind in kinds))
        if self._isp is not None:
            if "rgba" not in kinds:
                raise WarpcamError("CameraCfg.isp_cfg: processed images are rgb and rgba; ask for one in data_types")
            outputs = list(dict.fromkeys([*outputs, "hdr"]))
        self.renderer = wc.Renderer(
            self._scene,
            [
                wc.Camera(
                    "camera",
                    width=camera.width,
                    height=camera.height,
                    outputs=outputs,
                    lens=self._lens,
                    position=(0.0, 0.0, 0.0),
                    near=self._near,
                    far=self._far,
                    depth_clipping=self._cfg.depth_clipping_behavior,
                    shadows=bool(self._cfg.enable_shadows),
                    antialiasing=int(self._cfg.antialiasing),
                    background=self._background,
                )
            ],
        )
        self._rig = None if self._isp is None else sensors.Rig(self.renderer, {"camera": [self._isp]})
        arrays = self.renderer.camera("camera")
        if self._behind is not None:
            behind = np.tile(self._behind, (self._scene.num_worlds, 1))
            with torch_interop.in_order(self._scene.device):
                wp.from_torch(arrays.background).assign(behind)
        self._targets = (
            wp.from_torch(arrays.position, dtype=wp.vec3),
            wp.from_torch(arrays.rotation, dtype=wp.vec4),
            wp.from_torch(arrays.intrinsics, dtype=wp.vec4)
            if pinhole
            else wp.empty(self._scene.num_worlds, dtype=wp.vec4, device=self._scene.device),
        )
        self._after = [self._writer(kind, buffers[kind]) for kind in kinds]
        if self._pose:
            self.place(*self._pose)

    def place(self, positions: wp.array, orientations: wp.array, matrices: wp.array) -> None:
        """Take poses, positions vec3 [m] and orientations quat x y z w, and intrinsics, mat33: all (world,)."""
        self._pose = (positions, orientations, matrices)
        if not self._targets:
            return
        inputs = [positions, orientations, wp.quat(*TURN), matrices, *self._targets]
        with torch_interop.in_order(self._scene.device):
            launch_kernel(packing.place_cameras, self._scene.num_worlds, inputs, device=self._scene.device)

    def set_lens(self, matrices: wp.array) -> None:
        """Take intrinsics; every environment may have its own.

        Calibrated lenses keep theirs, which Isaac Lab itself warns of.
        """
        if not isinstance(self._lens, wc.Pinhole):
            spawn = self._spec.cfg.spawn
            if spawn.distortion is None:
                raise WarpcamError(
                    f"set_intrinsic_matrices: CameraCfg.spawn.projection_type is {spawn.projection_type!r}, whose "
                    "polynomial says where rays go; allowed is 'pinhole'"
                )
        elif self._pose:
            positions, orientations, _ = self._pose
            self.place(positions, orientations, matrices)

    def forget(self, worlds: Any = None) -> None:
        """These environments were reset: nothing moved from the frame before to their next."""
        if self.renderer is not None:
            self.renderer.reset(worlds)

    def bind(self, state: newton.State) -> None:
        """Look at this state from now on."""
        self._scene.bind(state)

    def render(self) -> None:
        if self.renderer is None:
            return
        with torch_interop.in_order(self._scene.device):
            if self._rig is None:
                self.renderer.render()
            else:
                self._rig.read()
            for write in self._after:
                write()

    def _writer(self, kind: str, buffer: wp.array) -> Callable[[], Any]:
        """Return the function that copies one image into its buffer."""
        assert self.renderer is not None
        image, device = self.renderer.array("camera", SOURCES[kind]), self._scene.device
        if kind == "rgba" and self._rig is not None:
            image = wp.from_torch(self._rig.images["camera"]["rgb"])
        shape = (*image.shape[:3], buffer.shape[3])
        if tuple(buffer.shape) != shape or not buffer.is_contiguous:
            raise WarpcamError(f"{kind}: a contiguous buffer {shape} is needed, got {tuple(buffer.shape)}")
        pixels = (image.shape[0], image.shape[1] * image.shape[2])
        if kind in ("rgba", "albedo"):
            return _bound(packing.bind_color(image, packing.RGBA, shared(buffer, pixels, wp.uint32), 0, device))
        if kind in simple_shading.LEVELS:
            return _bound(bind_tonemap(image, buffer, device))
        if kind == "distance_to_camera":
            beyond = {"max": self._far, "zero": 0.0, "none": np.inf}[self._cfg.depth_clipping_behavior]
            return _bound(packing.bind_clipped(image, beyond, shared(buffer, pixels, wp.float32), device))
        if kind == "motion_vectors":
            flat = (pixels[0], 2 * pixels[1])
            return _bound(packing.bind_negated(image, shared(buffer, flat, wp.float32), device))
        if kind == "instance_id_segmentation_fast":
            return _bound(self._shape_ids(image, buffer, pixels))
        if kind in LABELLED:
            return self._labels(kind, image, buffer)
        return lambda: wp.copy(buffer, image)

    def _labels(self, kind: str, image: wp.array, buffer: wp.array) -> Callable[[], Any]:
        """Ids or colours of labels, by Isaac Lab's own mapping of shapes."""
        if self._mapper is None:
            raise WarpcamError(f"{kind}: the camera was made without it in CameraCfg.data_types")
        colorize = bool(getattr(self._cfg, f"colorize_{kind}"))
        mapping = self._mapper.get_mapping(kind, colorize)
        self.info[kind] = mapping.info
        table = mapping.shape_to_color if colorize else mapping.shape_to_id
        shape = (image.shape[0], image.shape[1] * image.shape[2])
        ids = table if table is not None and table.size else wp.zeros(0, dtype=wp.uint32, device=self._scene.device)
        other = _signed(OPAQUE_BLACK) if colorize else UNLABELLED_ID
        miss = 0 if colorize else BACKGROUND_ID
        out = shared(buffer, shape, wp.int32)
        return _bound(packing.bind_look_up(image, ids.view(wp.int32), miss, other, out, self._scene.device))

    def _shape_ids(self, image: wp.array, buffer: wp.array, pixels: tuple[int, int]) -> Stage:
        """A number, or its colour, for each shape, whether it has a label or not."""
        labels = [str(label) for label in self._model.shape_label]
        first = UNLABELLED_ID + 1
        ids = np.arange(first, first + len(labels))
        colorize = bool(self._cfg.colorize_instance_id_segmentation)
        colors = [tuple(random_color_from_id(int(number))) for number in ids] if colorize else []
        names: dict[Any, str] = {
            (0, 0, 0, 0) if colorize else BACKGROUND_ID: "BACKGROUND",
            (0, 0, 0, 255) if colorize else UNLABELLED_ID: "UNLABELLED",  # cloth and particles, which are no shapes
            **dict(zip(colors if colorize else ids.tolist(), labels, strict=True)),
        }
        self.info["instance_id_segmentation_fast"] = {"idToLabels": names}
        values = [_signed(int(pack_rgba(color))) for color in colors] if colorize else ids.tolist()
        device = self._scene.device
        table = wp.array(np.asarray(values, np.int64).astype(np.int32), dtype=wp.int32, device=device)
        other = _signed(OPAQUE_BLACK) if colorize else UNLABELLED_ID
        miss = 0 if colorize else BACKGROUND_ID
        return packing.bind_look_up(image, table, miss, other, shared(buffer, pixels, wp.int32), device)


def _bound(stage: Stage) -> Callable[[], Any]:
    stage.prepare()
    return stage.launch


def _signed(number: int) -> int:
    return number - 2**32 if number >= 2**31 else number
