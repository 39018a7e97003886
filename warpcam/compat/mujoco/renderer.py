"""``mujoco.Renderer``, with the same calls, encodings and errors, and with no graphics library behind it.

``from warpcam.compat.mujoco import Renderer`` in place of ``from mujoco import Renderer`` is all there is to change; or
``install()``, for packages that make a ``mujoco.Renderer`` by themselves.
"""

import sys
from typing import Any

import mujoco
import numpy as np

from warpcam.compat.mujoco import mjv_scene, upload_calls
from warpcam.compat.mujoco.frame_renderer import FrameRenderer
from warpcam.compat.mujoco.gl_camera import view_of
from warpcam.compat.mujoco.model_snapshot import Snapshot
from warpcam.compat.mujoco.options import style_of
from warpcam.compat.mujoco.user_geoms import UserGeoms, drawn_alone
from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError
from warpcam.sources.mujoco.mjv_geoms import MjvGeoms

__all__ = ["Renderer", "install", "uninstall"]

BEFORE_4 = mujoco.mj_version() < 4000000

_chosen: list[Any] = [None]  # the device that install() was given
_originals: list[type] = []  # MuJoCo's own renderer, while it is replaced


def install(device: Any = None) -> None:
    """Have every ``mujoco.Renderer`` that is made from now on be one of this module.

    Names that were imported before, by ``from mujoco import Renderer``, keep what they mean.

    Args:
        device: Where they render: a name, a Warp or torch device, a CUDA ordinal; None is Warp's current device.
    """
    if device is not None:
        device_rule.resolve(device)
    _chosen[0] = device
    if not _originals:
        _originals.append(mujoco.Renderer)
        _replace(mujoco.Renderer, Renderer)
    upload_calls.serve(__name__)


def uninstall() -> None:
    """Give MuJoCo its own renderer back. Those that were made here stay."""
    if _originals:
        _replace(Renderer, _originals.pop())
    upload_calls.leave(__name__)
    _chosen[0] = None


def _replace(old: type, new: type) -> None:
    """In all of MuJoCo's own modules."""
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] == "mujoco" and vars(module).get("Renderer") is old:
            vars(module)["Renderer"] = new


class Renderer:
    """Renders a MuJoCo model's states one by one.

    Args:
        model: The ``mujoco.MjModel``.
        height: Of the images [pixels].
        width: Of the images [pixels].
        max_geom: How many geoms ``scene`` has room for.
        font_scale: Of text, which is not drawn.
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal; None is what ``install`` was given,
            and else Warp's current device.

    Raises:
        ValueError: The image is larger than the model's ``vis.global_.offwidth`` and ``offheight``.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        height: int = 240,
        width: int = 320,
        max_geom: int = 10000,
        font_scale: Any = None,
        *,
        device: Any = None,
    ):
        self._frame_renderer: FrameRenderer | None = None
        # Programs know these by MuJoCo's names.
        self._mjr_context: upload_calls.Context | None = None
        self._gl_context: upload_calls.Context | None = None
        if not isinstance(model, mujoco.MjModel):
            raise TypeError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
        for side, pixels, most in (
            ("width", width, model.vis.global_.offwidth),
            ("height", height, model.vis.global_.offheight),
        ):
            if not hasattr(pixels, "__index__"):
                raise TypeError(f"Image {side} must be a whole number, got {pixels!r}")
            if pixels > most:
                raise ValueError(
                    f"Image {side} {pixels} > framebuffer {side} {most}. Ask for a smaller image, or for a larger "
                    f'framebuffer in the model: <visual><global off{side}="{pixels}"/></visual>'
                )
            if pixels < 1:
                raise ValueError(f"Image {side} must be at least 1, got {pixels}")
        self._model, self._height, self._width = model, int(height), int(width)
        self._scene = mujoco.MjvScene(model=model, maxgeom=max_geom)
        self._scene_option = mujoco.MjvOption()  # where none is given; programs write to it
        self._option = self._scene_option
        self._own: UserGeoms | None = None  # the scene as update_scene has made it; None before it has
        self._depth = self._segmentation = False
        self._taken = Snapshot(model)
        self._frame_renderer = FrameRenderer(self._taken.model, _chosen[0] if device is None else device)
        self._mjr_context = self._gl_context = upload_calls.Context(self._upload)

    @property
    def model(self) -> mujoco.MjModel:
        return self._model

    @property
    def scene(self) -> mujoco.MjvScene:
        """The abstract scene, from which pictures are drawn: its camera, its geoms, and flags of how it is drawn."""
        return self._scene

    @property
    def height(self) -> int:
        return self._height

    @property
    def width(self) -> int:
        return self._width

    def enable_depth_rendering(self) -> None:
        self._depth, self._segmentation = True, False

    def disable_depth_rendering(self) -> None:
        self._depth = False

    def enable_segmentation_rendering(self) -> None:
        self._depth, self._segmentation = False, True

    def disable_segmentation_rendering(self) -> None:
        self._segmentation = False

    def update_scene(
        self,
        data: mujoco.MjData,
        camera: int | str | mujoco.MjvCamera = -1,
        scene_option: mujoco.MjvOption | None = None,
    ) -> None:
        """Take the state as it is now.

        Args:
            data: The ``mujoco.MjData``, of the renderer's model. What happens to either afterwards is not seen.
            camera: Index or name of one of the model's cameras, -1 for the free camera as it is by default, or an
                ``MjvCamera`` of any type.
            scene_option: Groups and flags of what is drawn; None is MuJoCo's default.

        Raises:
            ValueError: There is no such camera.
            WarpcamError: ``scene_option`` asks for something that is not drawn here; it says what.
        """
        camera = self._camera(camera)
        option = self._scene_option if scene_option is None else scene_option
        if not isinstance(option, mujoco.MjvOption):
            raise TypeError(f"scene_option must be a mujoco.MjvOption or None, got {type(option).__name__}")
        style_of(self._model, option, self._scene.flags)  # refuse now what would be refused at the picture
        self._option = option
        if self._frame_renderer is not None:
            self._frame_renderer.take(data)
            self._taken.follow()
        everything = int(mujoco.mjtCatBit.mjCAT_ALL)
        mujoco.mjv_updateScene(self._model, data, self._option, None, camera, everything, self._scene)
        self._own = UserGeoms(self._model, self._scene)

    def render(self, *, out: np.ndarray | None = None) -> np.ndarray:
        """The picture of the state that was taken last.

        Args:
            out: Array to write to, of the picture's shape; its dtype may be another.

        Returns:
            ``out`` if it was given, else a new array: uint8 (height, width, 3) with rows from the top; with depth
            rendering float32 (height, width), planar depth [m], that of the far plane where nothing is hit; with
            segmentation rendering int32 (height, width, 2), id and ``mjtObj``, -1 twice where nothing is hit.

        Raises:
            RuntimeError: The renderer was closed.
            ValueError: ``out`` has another shape.
        """
        if self._frame_renderer is None:
            raise RuntimeError("render cannot be called after close.")
        shape: tuple[int, ...] = (self._height, self._width)
        shape += () if self._depth else (2,) if self._segmentation else (3,)
        # Before 4.0 mujoco.Renderer takes one for a coloured picture of ids, too, but returns another array.
        spare = BEFORE_4 and self._segmentation and out is not None and out.shape == (*shape[:2], 3)
        if out is not None and out.shape != shape and not spare:
            raise ValueError(
                f"Expected `out.shape == {shape}`. Got `out.shape={out.shape}` instead: out is (height, width) with "
                "depth rendering, (height, width, 2) with segmentation rendering and (height, width, 3) otherwise."
            )
        image = self._picture(self._frame_renderer)
        if out is None or spare:
            return image
        out[...] = image
        return out

    def close(self) -> None:
        """Let go of all memory. Closing twice does nothing."""
        self._frame_renderer = self._mjr_context = self._gl_context = None

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:  # programs call it
        self.close()

    def _picture(self, frame_renderer: FrameRenderer) -> np.ndarray:
        model, scene = self._taken.model, self._scene
        view = view_of(scene, self._width, self._height)
        if view is None:
            if scene.ngeom:
                raise WarpcamError(
                    f"scene has {scene.ngeom} geoms and a camera without a field of view; call update_scene, or "
                    "mujoco.mjv_updateScene or mjv_updateCamera with an MjvCamera, before render"
                )
            return self._empty()
        mjv_scene.refuse_views(scene)
        output = "depth" if self._depth else "objects" if self._segmentation else "rgb"
        solid = output != "rgb"
        mjv_geoms: MjvGeoms | None
        if self._own is None:  # what MjvOption chose is what its geoms are
            self._taken.follow()
            style = style_of(model, mujoco.MjvOption(), scene.flags)
            style, mjv_geoms = drawn_alone(model, scene, view, self._height, style, solid=solid)
        else:
            style = style_of(model, self._option, scene.flags)
            style, mjv_geoms = self._own.drawn(view, self._height, style, solid=solid)
        image = frame_renderer.look(view, style, self._width, self._height, (output,), mjv_geoms=mjv_geoms)[output]
        return image[..., 0] if self._depth else image

    def _upload(self) -> None:
        if self._frame_renderer is not None:
            self._taken.upload()
            self._frame_renderer.reload()

    def _empty(self) -> np.ndarray:
        size = (self._height, self._width)
        if self._depth:
            return np.full(size, self._model.vis.map.zfar * self._model.stat.extent, np.float32)
        return np.full((*size, 2), -1, np.int32) if self._segmentation else np.zeros((*size, 3), np.uint8)

    def _camera(self, camera: Any) -> mujoco.MjvCamera:
        model = self._model
        if isinstance(camera, mujoco.MjvCamera):
            fixed = camera.type == int(mujoco.mjtCamera.mjCAMERA_FIXED)
            tracking = camera.type == int(mujoco.mjtCamera.mjCAMERA_TRACKING)
            if fixed and not 0 <= camera.fixedcamid < model.ncam:
                raise ValueError(f"The camera id {camera.fixedcamid} is out of range [0, {model.ncam}).")
            if tracking and not 0 <= camera.trackbodyid < model.nbody:
                raise ValueError(f"The body id {camera.trackbodyid} is out of range [0, {model.nbody}).")
            return camera
        index = camera
        if isinstance(camera, str):
            index = mujoco.mj_name2id(model, int(mujoco.mjtObj.mjOBJ_CAMERA), camera)
            if index == -1:
                raise ValueError(f'The camera "{camera}" does not exist.')
        if index < -1 or index >= model.ncam:
            raise ValueError(f"The camera id {index} is out of range [-1, {model.ncam}).")
        found = mujoco.MjvCamera()
        if index == -1:
            mujoco.mjv_defaultFreeCamera(model, found)
        else:
            found.type, found.fixedcamid = int(mujoco.mjtCamera.mjCAMERA_FIXED), index
        return found
