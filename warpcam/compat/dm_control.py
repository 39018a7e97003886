"""dm_control's pictures, with no graphics library behind them.

``install()`` is all there is to change: pictures of ``physics.render(...)`` and of ``engine.Camera`` are made here.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any
from weakref import WeakSet

import mujoco
import numpy as np
from dm_control.mujoco import engine

from warpcam.compat.mujoco import mjv_scene
from warpcam.compat.mujoco.frame_renderer import FrameRenderer
from warpcam.compat.mujoco.gl_camera import view_of
from warpcam.compat.mujoco.options import style_of
from warpcam.compat.mujoco.upload_calls import UPLOADS
from warpcam.compat.mujoco.user_geoms import UserGeoms
from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError

__all__ = ["install", "uninstall"]

_chosen: list[Any] = [None]  # the device that install() was given
_originals: dict[str, Callable[..., Any]] = {}
_drawn: WeakSet[Any] = WeakSet()  # every Physics that was given contexts of ours


def install(device: Any = None) -> None:
    """Have every ``Physics`` whose pictures are asked for from now on render them here.

    Args:
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal; None is Warp's current device.
    """
    if device is not None:
        device_rule.resolve(device)
    _chosen[0] = device
    if not _originals:
        _originals.update(render=engine.Camera.render, contexts=engine.Physics._make_rendering_contexts)
    engine.Camera.render = _render
    engine.Physics._make_rendering_contexts = _make_contexts


def uninstall() -> None:
    """Give dm_control its own renderer back, for what is rendered from now on."""
    if _originals:
        engine.Camera.render = _originals["render"]
        engine.Physics._make_rendering_contexts = _originals["contexts"]
    for physics in _drawn:
        with physics._contexts_lock:
            if physics._contexts and isinstance(physics._contexts.gl, _Contexts):
                physics._free_rendering_contexts()  # it makes its own when it renders
    _drawn.clear()
    _originals.clear()
    _chosen[0] = None


class _Contexts:
    """Renderer of one ``Physics``, in place of dm_control's contexts of OpenGL and of MuJoCo."""

    ptr = None

    def __init__(self, physics: Any):
        self.frame_renderer = FrameRenderer(physics.model.ptr, _chosen[0])

    @contextmanager
    def make_current(self) -> Iterator["_Contexts"]:
        yield self

    def call(self, function: Callable[..., Any], *_: Any, **__: Any) -> None:
        """Have what was to be uploaded read again; other calls of OpenGL have nothing to do here."""
        if getattr(function, "__name__", "") in UPLOADS:
            self.frame_renderer.reload()

    def free(self) -> None: ...


def _make_contexts(physics: Any) -> None:
    own = _Contexts(physics)
    physics._contexts = engine.Contexts(gl=own, mujoco=own)
    _drawn.add(physics)


def _render(
    camera: Any,
    overlays: Sequence[Any] = (),
    depth: bool = False,
    segmentation: bool = False,
    scene_option: Any = None,
    render_flag_overrides: Mapping[Any, bool] | None = None,
) -> np.ndarray:
    """The picture of the state as it is: see ``engine.Camera.render``, whose arguments, values and errors it has.

    Raises:
        WarpcamError: Text, something of a scene callback or a flag was asked for that is not drawn here.
    """
    if overlays and (depth or segmentation):
        raise ValueError("Overlays are not supported with depth or segmentation rendering.")
    if render_flag_overrides and (depth or segmentation):
        raise ValueError("`render_flag_overrides` are not supported for depth or segmentation rendering.")
    if depth and segmentation:
        raise ValueError("`segmentation` and `depth` cannot both be `True`.")
    if overlays:
        raise WarpcamError(f"overlays: text is not drawn here, got {len(overlays)}")
    physics = camera._physics
    contexts = physics.contexts.gl
    if not isinstance(contexts, _Contexts):  # it has rendered before install()
        rendered: np.ndarray = _originals["render"](
            camera, overlays, depth, segmentation, scene_option, render_flag_overrides
        )
        return rendered
    camera.update(scene_option=scene_option)
    model, option = physics.model.ptr, scene_option or camera.option
    own = UserGeoms(model, _bare(camera.scene))
    if camera._scene_callback:
        camera._scene_callback(physics, camera.scene)
    mjv_scene.refuse_views(_bare(camera.scene))
    with camera.scene.override_flags(dict(render_flag_overrides or {})):
        style = style_of(model, _bare(option), camera.scene.flags)
        view = view_of(_bare(camera.scene), camera.width, camera.height)
    if view is None:
        raise WarpcamError("render: the camera has no field of view")
    contexts.frame_renderer.take(physics.data.ptr)
    output = "depth" if depth else "objects" if segmentation else "rgb"
    style, mjv_geoms = own.drawn(view, camera.height, style, solid=segmentation)
    look = contexts.frame_renderer.look
    image = look(view, style, camera.width, camera.height, (output,), through=True, mjv_geoms=mjv_geoms)[output]
    return image[..., 0] if depth else image


def _bare(wrapped: Any) -> Any:
    """MuJoCo's own struct, in dm_control's wrapper or without."""
    return wrapped if isinstance(wrapped, mujoco.MjvOption | mujoco.MjvScene) else getattr(wrapped, "ptr", wrapped)
