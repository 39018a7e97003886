"""Robosuite's camera observations, with no graphics library behind them.

``install()`` before environments are made is all there is to change; ``observables(env)`` does it for one environment
and leaves robosuite as it is.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes.util import find_library
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import warp as wp

from warpcam.compat.mujoco.frame_renderer import FrameRenderer
from warpcam.compat.mujoco.gl_camera import depth_buffer, view_of
from warpcam.compat.mujoco.options import style_of
from warpcam.compat.mujoco.user_geoms import UserGeoms
from warpcam.compat.robosuite import shims
from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError
from warpcam.sources.mujoco.mjv_geoms import MjvGeoms

__all__ = ["OffscreenContext", "install", "observables", "uninstall"]

MAX_GEOM = 10_000
DRAWN = ("rgb", "depth", "objects")
SEGMENTATIONS = ("instance", "class", "element")

_chosen: list[Any] = [None]  # the device that install() was given
_originals: dict[Any, type] = {}  # robosuite's own contexts, by the modules that hold them


def install(device: Any = None) -> None:
    """Have every environment of robosuite render its cameras here from now on.

    Import robosuite before or after. With MuJoCo 3.10 or newer, which robosuite 1.5.2 does not know, what it misses
    is mended: see ``warpcam.compat.robosuite.shims``.

    Args:
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal. None: where an environment's
            ``render_gpu_device_id`` says, which counts the GPUs that this process sees; and if that is -1, on Warp's
            current device.
    """
    if device is not None:
        device_rule.resolve(device)
    _chosen[0] = device
    with _unguarded():
        from robosuite.environments import base
        from robosuite.models.grippers import gripper_tester
        from robosuite.utils import binding_utils, mjmod
    shims.mend()
    for module in (binding_utils, base, gripper_tester, mjmod):
        if hasattr(module, "MjRenderContextOffscreen"):  # robosuite 1.4's tester of grippers forgets it
            _originals.setdefault(module, module.MjRenderContextOffscreen)
            module.MjRenderContextOffscreen = _ModderContext if module is mjmod else OffscreenContext


def uninstall() -> None:
    """Give robosuite its own contexts back. Environments that have one of ours keep it until they are reset hard."""
    for module, original in _originals.items():
        module.MjRenderContextOffscreen = original
    _originals.clear()
    _chosen[0] = None


class OffscreenContext:
    """Context with the calls and images of robosuite's ``MjRenderContextOffscreen``.

    What is rendered is the state as it is: after a step the poses are those before it, as in robosuite.

    Args:
        sim: Robosuite's ``MjSim``, which keeps this context.
        device_id: CUDA ordinal among the GPUs that this process sees; -1 for what ``install`` was given.
        max_width: Robosuite's size of a buffer, which is not needed here.
        max_height: Likewise.
    """

    offscreen = True

    def __init__(self, sim: Any, device_id: int = -1, max_width: int = 640, max_height: int = 480):
        self.device_id = device_id
        self.device = _device(device_id)
        sim.forward()
        sim.add_render_context(self)
        # The context is the sim's own. Held the other way round as well, both would wait for the garbage collector.
        self.model, self.data = sim.model, sim.data
        self._pictures = _Pictures(sim.model._model, self.device)
        self.scn = mujoco.MjvScene(sim.model._model, maxgeom=MAX_GEOM)
        self.cam = mujoco.MjvCamera()
        self.cam.type, self.cam.fixedcamid = int(mujoco.mjtCamera.mjCAMERA_FIXED), 0
        self.vopt, self.pert = mujoco.MjvOption(), mujoco.MjvPerturb()
        limits = sim.model.vis.global_
        self.con = SimpleNamespace(offWidth=limits.offwidth, offHeight=limits.offheight, free=_nothing)
        self.gl_ctx = SimpleNamespace(make_current=_nothing, free=_nothing)
        self._own = UserGeoms(sim.model._model, self.scn)
        self._drawn: tuple[int, int, bool] | None = None

    def update_offscreen_size(self, width: int, height: int) -> None:
        limits = self.model.vis.global_
        limits.offwidth, limits.offheight = self.con.offWidth, self.con.offHeight = width, height

    def render(self, width: int, height: int, camera_id: int | None = None, segmentation: bool = False) -> None:
        """Take the state as it is.

        Args:
            width: Of the image [pixels].
            height: Of the image [pixels].
            camera_id: Of the model's cameras; -1 is the free camera, None the one of the call before.
            segmentation: Whether ids will be read.
        """
        if camera_id is not None:
            kind = mujoco.mjtCamera.mjCAMERA_FREE if camera_id == -1 else mujoco.mjtCamera.mjCAMERA_FIXED
            self.cam.type, self.cam.fixedcamid = int(kind), camera_id
        if width > self.con.offWidth or height > self.con.offHeight:
            self.update_offscreen_size(max(width, self.con.offWidth), max(height, self.con.offHeight))
        model, data, everything = self.model._model, self.data._data, int(mujoco.mjtCatBit.mjCAT_ALL)
        if self.cam.type == int(mujoco.mjtCamera.mjCAMERA_FIXED) and not 0 <= self.cam.fixedcamid < model.ncam:
            raise WarpcamError(f"camera_id {self.cam.fixedcamid} came; the model has cameras 0 to {model.ncam - 1}")
        mujoco.mjv_updateScene(model, data, self.vopt, self.pert, self.cam, everything, self.scn)
        self._own = UserGeoms(model, self.scn)
        self._pictures.take(data)
        self._drawn = (width, height, segmentation)

    def read_pixels(
        self, width: int, height: int, depth: bool = False, segmentation: bool = False
    ) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
        """The image of the state that was taken last, its bottom row first.

        Returns:
            uint8 (height, width, 3); with ``segmentation`` int32 (height, width, 2), ``mjtObj`` and id, -1 twice where
            nothing is hit. With ``depth`` a pair of that and float32 (height, width), what a depth buffer holds: 0 at
            the near plane, 1 at the far one and where nothing is hit.
        """
        if self._drawn != (width, height, segmentation):
            drawn = "nothing" if self._drawn is None else "width {}, height {}, segmentation {}".format(*self._drawn)
            raise WarpcamError(
                f"read_pixels: width {width}, height {height}, segmentation {segmentation} came, render had {drawn}"
            )
        view = view_of(self.scn, width, height)
        if view is None:
            raise WarpcamError("read_pixels: the camera has no field of view")
        wanted = ["objects" if segmentation else "rgb", *(["depth"] if depth else [])]
        style = style_of(self.model._model, self.vopt, self.scn.flags)
        camera, through = (self.cam.type, self.cam.fixedcamid), not (depth and segmentation)
        style, mjv_geoms = self._own.drawn(view, height, style, solid=segmentation)
        images = self._pictures.look(
            camera, view, style, width, height, outputs=wanted, through=through, mjv_geoms=mjv_geoms
        )
        image = images[wanted[0]]
        pixels = np.ascontiguousarray(image[::-1, :, ::-1] if segmentation else image[::-1])
        if not depth:
            return pixels
        return pixels, depth_buffer(images["depth"][::-1, :, 0], view)

    def upload_texture(self, tex_id: int) -> None:
        """Read the model's textures again at the next image."""
        self._pictures.reload()


class _ModderContext(OffscreenContext):
    """Context as robosuite's texture modder makes it if there is none yet: with device 0, which nobody chose."""

    def __init__(self, sim: Any, device_id: int = -1, max_width: int = 640, max_height: int = 480):
        super().__init__(sim, -1, max_width, max_height)


class _Pictures:
    """Images of one model: of each camera one trace a state, and of that the images that somebody has asked for."""

    def __init__(self, model: mujoco.MjModel, device: wp.Device):
        self._frame_renderer = FrameRenderer(model, device)
        self._asked: dict[Any, list[str]] = {}
        self._images: dict[Any, dict[str, np.ndarray]] = {}
        self._state = b""

    def take(self, data: mujoco.MjData) -> None:
        state = self._frame_renderer.content(data)
        if state != self._state:
            self._frame_renderer.take(data)
            self._state = state
            self._images.clear()

    def look(
        self,
        camera: Any,
        view: Any,
        style: Any,
        width: int,
        height: int,
        outputs: Sequence[str],
        through: bool = True,
        mjv_geoms: MjvGeoms | None = None,
    ) -> dict[str, np.ndarray]:
        if mjv_geoms is not None:  # which is another each time
            return self._frame_renderer.look(
                view, style, width, height, outputs, DRAWN, through=through, mjv_geoms=mjv_geoms
            )
        key = (camera, style, width, height, through)
        asked = self._asked.setdefault(key, [])
        asked.extend(name for name in outputs if name not in asked)
        place = (*key, view.content())
        images = self._images.get(place, {})
        if not all(name in images for name in outputs):
            images = self._images[place] = self._frame_renderer.look(
                view, style, width, height, asked, DRAWN, through=through
            )
        return images

    def reload(self) -> None:
        self._frame_renderer.reload()
        self._images.clear()


def observables(
    env: Any,
    camera_names: str | Sequence[str] | None = None,
    camera_heights: int | Sequence[int] | None = None,
    camera_widths: int | Sequence[int] | None = None,
    camera_depths: bool | Sequence[bool] | None = None,
    camera_segmentations: str | Sequence[str] | None = None,
    *,
    add: bool = True,
    device: Any = None,
) -> dict[str, Any]:
    """Camera observables for an environment made with ``use_camera_obs=False, has_offscreen_renderer=False``.

    They have the names and encodings of robosuite's own: ``{camera}_image``, ``{camera}_depth`` and
    ``{camera}_segmentation_{kind}``, and follow ``macros.IMAGE_CONVENTION``. They outlast hard resets.

    Args:
        env: Of robosuite.
        camera_names: One or more of the model's cameras; None is what the environment was made with, as for all below:
            for each camera its own, where it has it.
        camera_heights: Of the images [pixels], for all cameras or each.
        camera_widths: Of the images [pixels], for all cameras or each.
        camera_depths: Whether there is an image of depth, too, for all cameras or each.
        camera_segmentations: "instance", "class", "element" or several of these, for all cameras; None for none.
        add: Whether to add them to ``env``.
        device: As ``install`` has it.

    Returns:
        ``robosuite.utils.observables.Observable`` by name.
    """
    from robosuite import macros
    from robosuite.utils.mjcf_utils import IMAGE_CONVENTION_MAPPING
    from robosuite.utils.observables import Observable, sensor

    names = [camera_names] if isinstance(camera_names, str) else camera_names
    names = list(env.camera_names if names is None else names)
    heights = _each("camera_heights", camera_heights, env.camera_heights, names, env.camera_names)
    widths = _each("camera_widths", camera_widths, env.camera_widths, names, env.camera_names)
    depths = _each("camera_depths", camera_depths, env.camera_depths, names, env.camera_names)
    kinds = [camera_segmentations] if isinstance(camera_segmentations, str) else list(camera_segmentations or ())
    for kind in kinds:
        if kind not in SEGMENTATIONS:
            raise WarpcamError(f"camera_segmentations: {kind!r} came; allowed are {', '.join(SEGMENTATIONS)}")
    rows = IMAGE_CONVENTION_MAPPING[macros.IMAGE_CONVENTION]
    of_env = _OfEnvironment(env, _device(env.render_gpu_device_id) if device is None else device_rule.resolve(device))
    made: dict[str, Any] = {}
    for camera, height, width, depth in zip(names, heights, widths, depths, strict=True):
        outputs = ["rgb", *(["depth"] if depth else []), *(["objects"] if kinds else [])]
        sensors = {f"{camera}_image": of_env.sensor(camera, width, height, outputs, rows, "rgb")}
        if depth:
            sensors[f"{camera}_depth"] = of_env.sensor(camera, width, height, outputs, rows, "depth")
        for kind in kinds:
            sensors[f"{camera}_segmentation_{kind}"] = of_env.sensor(camera, width, height, outputs, rows, kind)
        for name, read in sensors.items():
            made[name] = Observable(name=name, sensor=sensor(modality="image")(read), sampling_rate=env.control_freq)
    if add:
        for observable in made.values():
            env.add_observable(observable)
    return made


class _OfEnvironment:
    """Reads an environment's cameras, whatever simulation it has made since."""

    def __init__(self, env: Any, device: wp.Device):
        self._env, self._device = env, device
        self._model: mujoco.MjModel | None = None
        self._pictures: _Pictures | None = None

    def sensor(self, camera: str, width: int, height: int, outputs: Sequence[str], rows: int, what: str) -> Any:
        """A function as robosuite's observables call it. ``rows`` is -1 where images begin at the top."""

        def read(_cache: Any) -> np.ndarray:
            images, view = self._look(camera, width, height, outputs)
            if what in SEGMENTATIONS:
                ids = self._grouped(images["objects"][..., 0], what)
                return np.ascontiguousarray(ids[::-rows, :, None])
            if what == "depth":
                return depth_buffer(images["depth"], view)[::-rows]
            return np.ascontiguousarray(images["rgb"][::-rows])

        return read

    def _look(self, camera: str, width: int, height: int, outputs: Sequence[str]) -> tuple[dict[str, np.ndarray], Any]:
        env, model = self._env, self._env.sim.model._model
        if self._model is not model or self._pictures is None:
            self._model, self._pictures = model, _Pictures(model, self._device)
            self._scene = mujoco.MjvScene(model, maxgeom=MAX_GEOM)
        option, eye = mujoco.MjvOption(), mujoco.MjvCamera()
        option.geomgroup[:2] = env.render_collision_mesh, env.render_visual_mesh
        eye.type, eye.fixedcamid = int(mujoco.mjtCamera.mjCAMERA_FIXED), env.sim.model.camera_name2id(camera)
        data = env.sim.data._data
        mujoco.mjv_updateCamera(model, data, eye, self._scene)
        view = view_of(self._scene, width, height)
        if view is None:
            raise WarpcamError(f"observables: camera {camera!r} has no field of view")
        style = style_of(model, option, self._scene.flags)
        self._pictures.take(data)
        return self._pictures.look(camera, view, style, width, height, outputs), view

    def _grouped(self, ids: np.ndarray, kind: str) -> np.ndarray:
        """Robosuite's numbers of what has geoms' ids: those themselves, or of instances and classes from 1 on."""
        if kind == "element":
            return ids
        model = self._env.model
        groups = model.instances_to_ids if kind == "instance" else model.classes_to_ids
        of_geoms = model.geom_ids_to_instances if kind == "instance" else model.geom_ids_to_classes
        numbers = {name: number for number, name in enumerate(groups)}
        highest = max([int(ids.max()), *of_geoms, 0])
        table = np.zeros(highest + 2, np.int32)  # the last one, which -1 finds, is nothing
        for geom, name in of_geoms.items():
            table[geom] = numbers[name] + 1
        return table[ids]


def _each(what: str, given: Any, own: Any, names: Sequence[str], known: Sequence[str]) -> list[Any]:
    """For each of the names what was given, or what the environment, whose cameras are ``known``, has for it."""
    values, count = own if given is None else given, len(names)
    values = list(values) if isinstance(values, list | tuple) else [values] * count
    if given is None and len(values) == len(known) and set(names) <= set(known):
        return [values[known.index(name)] for name in names]
    if len(set(values)) == 1:
        values = values[:1] * count
    if len(values) != count:
        raise WarpcamError(f"{what}: {len(values)} came for {count} cameras; one for all is allowed, or one for each")
    return values


def _device(device_id: int) -> wp.Device:
    """The one device that ``render_gpu_device_id`` and ``install`` mean together."""
    chosen = device_rule.resolve(_chosen[0])
    if device_id is None or device_id < 0:
        return chosen
    asked = device_rule.resolve(int(device_id))
    if _chosen[0] is not None and asked != chosen:
        raise WarpcamError(
            f"render_gpu_device_id is {device_id}, which is {asked.alias}, but install was given {chosen.alias}; both "
            "must mean one device, or one of them be left as it is by default"
        )
    return asked


@contextmanager
def _unguarded() -> Iterator[None]:
    """Robosuite looks at variables of OpenGL as it is imported, and sets one for all processes that are started later.

    Here they count for nothing: it does not see them, and finds them afterwards as they were. Robosuite 1.4 imports EGL
    with itself, whatever they say; where there is none it is made to import GLFW, which MuJoCo brings along.
    """
    names = ("MUJOCO_EGL_DEVICE_ID", "MUJOCO_GL")
    before = {name: os.environ.get(name) for name in names}
    os.environ.pop("MUJOCO_EGL_DEVICE_ID", None)
    if sys.platform == "linux" and before["MUJOCO_GL"] != "osmesa" and find_library("EGL") is None:
        os.environ["MUJOCO_GL"] = "glx"
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _nothing(*_: Any) -> None: ...
