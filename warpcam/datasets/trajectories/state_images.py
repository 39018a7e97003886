"""Images of many states of one MuJoCo model in one frame: each state is a world."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.compat.mujoco.gl_camera import GlCamera, view_of
from warpcam.compat.mujoco.options import style_of
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.cpu_pool import cpu_threads

PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)


class StateImages:
    """Draws states as ``warpcam.compat.mujoco.Renderer`` draws each of them, bit for bit.

    Args:
        model: The ``mujoco.MjModel``.
        count: States of one frame.
        cameras: Names of cameras of the model.
        width: Of each image [pixels].
        height: Of each image [pixels].
        depth: Whether there is depth beside colours.
        geom_groups: Groups of geoms that are drawn.
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal; None is Warp's current device.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        count: int,
        cameras: Sequence[str],
        width: int,
        height: int,
        *,
        depth: bool = False,
        geom_groups: Sequence[int] = (0, 1, 2),
        device: Any = None,
    ):
        self._model, self._width, self._height = model, width, height
        self._names, self._device = tuple(cameras), device
        self._outputs = ("rgb", "depth") if depth else ("rgb",)
        self._ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name) for name in cameras]
        for name, number in zip(cameras, self._ids, strict=True):
            if number < 0:
                known = ", ".join(model.camera(camera).name for camera in range(model.ncam))
                raise WarpcamError(f"replay: cameras has {name!r}, the model has {known or 'none'}")
        self._datas = [mujoco.MjData(model) for _ in range(count)]
        self._mjv = mujoco.MjvScene(model, maxgeom=1)
        option = mujoco.MjvOption()
        option.geomgroup[:] = [group in geom_groups for group in range(len(option.geomgroup))]
        self._style = style_of(model, option, self._mjv.flags)
        planes = np.isin(model.geom_group, self._style.groups[0]) & (model.geom_rgba[:, 3] > 0.0)
        self._planes = np.flatnonzero((model.geom_type == PLANE) & planes)
        self._renderers: dict[tuple[bool, bool], wc.Renderer] = {}

    @property
    def count(self) -> int:
        return len(self._datas)

    @property
    def state_size(self) -> int:
        """Numbers of a state: time, positions and velocities."""
        return 1 + int(self._model.nq) + int(self._model.nv)

    def draw(self, states: np.ndarray, pool: ThreadPoolExecutor) -> dict[str, dict[str, np.ndarray]]:
        """Return images of states.

        Args:
            states: (state, number): time, positions and velocities of each, at most ``count``.
            pool: Threads that compute poses.

        Returns:
            By camera and output: rgb uint8 (state, height, width, 3), depth float32 (state, height, width, 1) [m], of
            the far plane where nothing is hit. Rows run from the top.
        """
        datas = self._datas[: len(states)]
        list(pool.map(self._pose, datas, states))
        views = {name: [self._view(data, number) for data in datas] for name, number in self._places()}
        behind = any(
            self._sees_behind(data, view) for each in views.values() for data, view in zip(datas, each, strict=True)
        )
        orthographic = any(view.orthographic for each in views.values() for view in each)
        renderer = self._renderer(behind, orthographic)
        for name, each in views.items():
            self._aim(renderer, name, each + each[-1:] * (self.count - len(each)))
        images = renderer.render()
        made = {}
        for name, each in views.items():
            made[name] = {output: images[name][output][: len(each)].cpu().numpy().copy() for output in self._outputs}
            if "depth" in made[name]:
                for image, view in zip(made[name]["depth"], each, strict=True):
                    image[image >= np.float32(view.reach)] = view.far
        return made

    def _places(self) -> Sequence[tuple[str, int]]:
        return list(zip(self._names, self._ids, strict=True))

    def _pose(self, data: mujoco.MjData, state: np.ndarray) -> None:
        """Set a state, and compute all that is drawn of it."""
        model = self._model
        data.time = state[0]
        data.qpos[:], data.qvel[:] = state[1 : 1 + model.nq], state[1 + model.nq :]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        mujoco.mj_flex(model, data)
        mujoco.mj_tendon(model, data)

    def _view(self, data: mujoco.MjData, number: int) -> GlCamera:
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = int(mujoco.mjtCamera.mjCAMERA_FIXED), number
        mujoco.mjv_updateCamera(self._model, data, camera, self._mjv)
        view = view_of(self._mjv, self._width, self._height)
        if view is None:
            raise WarpcamError(f"replay: camera {self._model.camera(number).name!r} has no field of view")
        return view

    def _sees_behind(self, data: mujoco.MjData, view: GlCamera) -> bool:
        normals = data.geom_xmat[self._planes, 2::3]
        return bool((((view.position - data.geom_xpos[self._planes]) * normals).sum(axis=1) < 0.0).any())

    def _renderer(self, behind: bool, orthographic: bool) -> wc.Renderer:
        if (behind, orthographic) not in self._renderers:
            style = self._style
            groups = dict(zip(("geoms", "sites", "tendons", "flexes", "skins"), style.groups, strict=True))
            scene = wc.from_mujoco(
                self._model, self._datas, groups=groups, draw=style.draw, device=self._device,
                reflections=None if style.reflections else False, planes_from_behind=behind,
            )  # fmt: skip
            cameras = [
                wc.Camera(
                    name, width=self._width, height=self._height, outputs=self._outputs, position=(0.0, 0.0, 0.0),
                    lens=wc.Orthographic(height=1.0) if orthographic else wc.Pinhole(fx=1.0), near=1.0, far=2.0,
                    depth_clipping="max", shadows=style.shadows, antialiasing=style.antialiasing,
                    background=None if style.sky else (0.0, 0.0, 0.0),
                )
                for name in self._names
            ]  # fmt: skip
            self._renderers[behind, orthographic] = wc.Renderer(scene, cameras)
        return self._renderers[behind, orthographic]

    def _aim(self, renderer: wc.Renderer, name: str, views: Sequence[GlCamera]) -> None:
        """Write a camera's arrays, for each world its own."""
        arrays = renderer.camera(name)
        values: dict[str, list[Any]] = {
            "position": [view.position for view in views],
            "rotation": [view.rotation for view in views],
            "near": [view.near for view in views],
            "far": [view.reach for view in views],
        }
        if views[0].orthographic:
            values["height"] = [view.top - view.bottom for view in views]
        else:
            values["intrinsics"] = [self._intrinsics(view) for view in views]
        for field, value in values.items():
            wp.from_torch(getattr(arrays, field)).assign(np.array(value, np.float32))

    def _intrinsics(self, view: GlCamera) -> tuple[float, float, float, float]:
        across, down = view.right - view.left, view.top - view.bottom
        return (
            view.near * self._width / across, view.near * self._height / down,
            -view.left * self._width / across, view.top * self._height / down,
        )  # fmt: skip


def threads() -> ThreadPoolExecutor:
    """Threads that compute poses."""
    return ThreadPoolExecutor(cpu_threads(), thread_name_prefix="replay")
