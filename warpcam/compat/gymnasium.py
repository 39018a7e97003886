"""Gymnasium's pictures of MuJoCo environments, with no graphics library behind them.

``install()`` before environments are made is all there is to change: ``render_mode`` "rgb_array", "depth_array" and
"rgbd_tuple" are rendered here, and so is what ``RecordVideo`` records.
"""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from gymnasium.envs.mujoco import mujoco_rendering

from warpcam.compat.mujoco import upload_calls
from warpcam.compat.mujoco.frame_renderer import FrameRenderer
from warpcam.compat.mujoco.gl_camera import depth_buffer, view_of
from warpcam.compat.mujoco.options import style_of
from warpcam.compat.mujoco.user_geoms import UserGeoms
from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError

__all__ = ["OffScreenViewer", "install", "uninstall"]

MODES = ("rgb_array", "depth_array", "rgbd_tuple")

_chosen: list[Any] = [None]  # the device that install() was given
_original = mujoco_rendering.OffScreenViewer


def install(device: Any = None) -> None:
    """Have every MuJoCo environment of Gymnasium that is made from now on render its pictures here.

    Args:
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal; None is Warp's current device.
    """
    if device is not None:
        device_rule.resolve(device)
    _chosen[0] = device
    mujoco_rendering.OffScreenViewer = OffScreenViewer
    upload_calls.serve(__name__)


def uninstall() -> None:
    """Give Gymnasium its own viewer back. Environments that have one of ours keep it."""
    mujoco_rendering.OffScreenViewer = _original
    upload_calls.leave(__name__)
    _chosen[0] = None


class OffScreenViewer:
    """Viewer with the calls and pictures of Gymnasium's ``OffScreenViewer``.

    Args:
        model: The ``mujoco.MjModel``.
        data: The ``mujoco.MjData`` that is looked at.
        width: Of the pictures [pixels].
        height: Of the pictures [pixels].
        max_geom: How many geoms ``scn`` has room for.
        visual_options: Flags of ``vopt`` by their numbers in ``mjtVisFlag``.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        width: int,
        height: int,
        max_geom: int = 1000,
        visual_options: Mapping[int, bool] | None = None,
    ):
        self.model, self.data = model, data
        self.viewport = mujoco.MjrRect(0, 0, width, height)
        self.scn = mujoco.MjvScene(model, max_geom)
        self.vopt, self.pert, self.cam = mujoco.MjvOption(), mujoco.MjvPerturb(), mujoco.MjvCamera()
        for flag, value in (visual_options or {}).items():
            self.vopt.flags[int(flag)] = value
        self.cam.type, self.cam.fixedcamid = int(mujoco.mjtCamera.mjCAMERA_FREE), -1
        self.cam.lookat[:] = np.median(data.geom_xpos, axis=0) if model.ngeom else 0.0
        self.cam.distance = model.stat.extent
        self._markers: list[dict[str, Any]] = []
        self._device = _chosen[0]
        self._frame_renderer: FrameRenderer | None = FrameRenderer(model, self._device)
        self.con = self.opengl_context = upload_calls.Context(self._reload)
        self.backend = "warpcam"  # in place of a name of OpenGL's

    def render(
        self, render_mode: str | None, camera_id: int | None = None, segmentation: bool = False
    ) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
        """The picture of the state as it is, its rows from the top.

        Args:
            render_mode: "rgb_array": uint8 (height, width, 3). "depth_array": float32 (height, width), what a depth
                buffer holds: 0 at the near plane, 1 at the far one and where nothing is hit. "rgbd_tuple": both.
            camera_id: Of the model's cameras; -1 is the free camera, None the one of the call before.
            segmentation: Instead of colours int32 (height, width, 2), ``mjtObj`` and id, -1 twice for nothing.
        """
        if render_mode not in MODES:
            raise WarpcamError(f"render_mode is {render_mode!r}; allowed are {', '.join(MODES)}")
        if self._frame_renderer is None:  # freed, as an environment is that was closed, which can still be rendered
            self._frame_renderer = FrameRenderer(self.model, self._device)
        model, everything = self.model, int(mujoco.mjtCatBit.mjCAT_ALL)
        if camera_id is not None:
            if not -1 <= camera_id < model.ncam:
                raise WarpcamError(f"camera_id {camera_id} came; allowed are -1 to {model.ncam - 1}")
            kind = mujoco.mjtCamera.mjCAMERA_FREE if camera_id == -1 else mujoco.mjtCamera.mjCAMERA_FIXED
            self.cam.type, self.cam.fixedcamid = int(kind), camera_id
        mujoco.mjv_updateScene(model, self.data, self.vopt, self.pert, self.cam, everything, self.scn)
        own = UserGeoms(model, self.scn)
        for marker in self._markers:
            self._add_marker_to_scene(marker)
        self._frame_renderer.take(self.data)
        width, height = self.viewport.width, self.viewport.height
        view = view_of(self.scn, width, height)
        if view is None:
            raise WarpcamError("render: the camera has no field of view")
        style = style_of(model, self.vopt, self.scn.flags)
        colors = "objects" if segmentation else "rgb"
        outputs = {"rgb_array": (colors,), "depth_array": ("depth",), "rgbd_tuple": (colors, "depth")}[render_mode]
        style, mjv_geoms = own.drawn(view, height, style, solid=segmentation)
        images = self._frame_renderer.look(
            view, style, width, height, outputs, through=not segmentation, mjv_geoms=mjv_geoms
        )
        self._markers.clear()
        if "depth" in images:
            images["depth"] = depth_buffer(images["depth"][..., 0], view)
        if segmentation and colors in images:
            images[colors] = images[colors][..., ::-1]
        first, *more = (images[name] for name in outputs)
        return (first, more[0]) if more else first

    def add_marker(self, **marker: Any) -> None:
        """Draw a geom in the next picture: ``type``, ``size``, ``pos``, ``mat`` and ``rgba``, each of them or none."""
        self._markers.append(marker)

    def _add_marker_to_scene(self, marker: Mapping[str, Any]) -> None:
        if self.scn.ngeom >= self.scn.maxgeom:
            raise RuntimeError(f"Ran out of geoms. maxgeom: {self.scn.maxgeom}")
        mujoco.mjv_initGeom(
            self.scn.geoms[self.scn.ngeom],
            marker.get("type", mujoco.mjtGeom.mjGEOM_SPHERE),
            size=marker.get("size", np.array([0.01, 0.01, 0.01])),
            pos=marker.get("pos", np.zeros(3)),
            mat=marker.get("mat", np.eye(3).ravel()),
            rgba=marker.get("rgba", np.ones(4)),
        )
        self.scn.ngeom += 1

    def add_overlay(self, gridpos: int, text1: str, text2: str) -> None:
        raise WarpcamError(f"add_overlay: text is not drawn here, got {text1!r} and {text2!r} at {gridpos}")

    def make_context_current(self) -> None:
        """Nothing has to be made current here."""

    def free(self) -> None:
        """Let go of all memory. A later picture takes some again."""
        self._frame_renderer = None

    def close(self) -> None:
        self.free()

    def __del__(self) -> None:  # programs call it
        self.free()

    def _reload(self) -> None:
        if self._frame_renderer is not None:
            self._frame_renderer.reload()
