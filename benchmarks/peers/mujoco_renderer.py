"""MuJoCo's own renderer, as `mujoco.Renderer` uses it: OpenGL by EGL on a GPU, by Mesa on a CPU."""

import copy
import importlib
import os
from typing import Any

import mujoco
import numpy as np
import warp as wp

from warpcam.benchmarks.cases import Wanted
from warpcam.benchmarks.compare import Images
from warpcam.benchmarks.problem import POSE_SETS, Problem

FLAG = mujoco.mjtRndFlag
LEFT, READ = "left on the GPU", "read"
ROOM = 1000  # for what a scene shows beside its geoms
SAMPLES = 4  # of smooth edges


class MujocoPeer:
    """One image after another of worlds on the host; the images stay in the framebuffer, or are read to the host."""

    variants: tuple[str, ...] = (LEFT, READ)
    on_host = True
    told_memory_mb: float | None = None

    def __init__(self, problem: Problem) -> None:
        self.problem, self.index = problem, 0
        self.model = copy.deepcopy(problem.mjm)  # takes sizes and samples of images
        self.lacks: tuple[str, ...] = ()
        self.states = [self._states(index) for index in range(POSE_SETS)]
        groups = np.arange(6) <= 2
        self.options = mujoco.MjvOption()
        self.options.geomgroup[:] = groups
        for name in ("sitegroup", "tendongroup", "actuatorgroup", "skingroup", "jointgroup"):
            getattr(self.options, name)[:] = 0
        self.options.flexgroup[:] = groups if problem.case.flexes else 0
        self.gl: Any = None
        self.context: Any = None

    def _states(self, index: int) -> list[mujoco.MjData]:
        """State of each world in a set of poses."""
        states = []
        for positions in self.problem.positions(index):
            state = mujoco.MjData(self.model)
            state.qpos[:] = positions
            mujoco.mj_kinematics(self.model, state)
            mujoco.mj_comPos(self.model, state)
            mujoco.mj_camlight(self.model, state)
            mujoco.mj_flex(self.model, state)
            states.append(state)
        return states

    def release(self) -> None:
        if self.context is not None:
            self.gl.make_current()
            self.context.free()
            self.gl.free()
        self.gl = self.context = None

    def prepare(self, wanted: Wanted) -> None:
        self.wanted = wanted
        width, height = self.problem.width, self.problem.height
        screen, quality = self.model.vis.global_, self.model.vis.quality
        screen.offwidth, screen.offheight = width, height
        quality.offsamples = SAMPLES if wanted.antialiasing > 1 else 0
        backend = os.environ.get("MUJOCO_GL") or ("egl" if wp.get_device().is_cuda else "osmesa")
        self.gl = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
        self.gl.make_current()
        self.context = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.context)
        self.context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self.view = mujoco.MjrRect(0, 0, width, height)
        self.scene = mujoco.MjvScene(self.model, maxgeom=self.model.ngeom + ROOM)
        self.options.flags[mujoco.mjtVisFlag.mjVIS_TEXTURE] = wanted.textures
        self.scene.flags[FLAG.mjRND_SHADOW] = wanted.shadows
        self.scene.flags[FLAG.mjRND_REFLECTION] = wanted.reflections
        self.scene.flags[FLAG.mjRND_SKYBOX] = self.scene.flags[FLAG.mjRND_HAZE] = False
        self.pixels = np.empty((height, width, 3), dtype=np.uint8)
        self.depth = np.empty((height, width), dtype=np.float32)

    def place(self, index: int) -> None:
        self.index = index

    def frame(self, variant: str) -> None:
        self.gl.make_current()
        for state in self.states[self.index]:
            for camera in self.problem.camera_ids:
                self._update(state, camera)
                if "rgb" in self.wanted.outputs:
                    self._draw(ids=False, read=variant == READ)
                if self._needs_ids():
                    self._draw(ids=True, read=variant == READ)
        mujoco.mjr_finish()

    def _needs_ids(self) -> bool:
        return bool({"depth", "segmentation"} & set(self.wanted.outputs))

    def _update(self, state: mujoco.MjData, camera: int) -> None:
        eye = mujoco.MjvCamera()
        eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
        mujoco.mjv_updateScene(self.model, state, self.options, None, eye, mujoco.mjtCatBit.mjCAT_ALL, self.scene)

    def _draw(self, *, ids: bool, read: bool) -> None:
        """Draw colours, or ids, which depth comes with; read all that is wanted into the buffers."""
        self.scene.flags[FLAG.mjRND_SEGMENT] = self.scene.flags[FLAG.mjRND_IDCOLOR] = ids
        mujoco.mjr_render(self.view, self.scene, self.context)
        if read:
            pixels = self.pixels if not ids or "segmentation" in self.wanted.outputs else None
            depth = self.depth if ids and "depth" in self.wanted.outputs else None
            mujoco.mjr_readPixels(pixels, depth, self.view, self.context)

    def images(self, worlds: int) -> list[Images]:
        self.gl.make_current()
        found: list[Images] = []
        for camera in self.problem.camera_ids:
            each = [self._images_of(state, camera) for state in self.states[self.index][:worlds]]
            found.append({name: np.stack([one[name] for one in each]) for name in each[0]})
        return found

    def _images_of(self, state: mujoco.MjData, camera: int) -> Images:
        images: Images = {}
        self._update(state, camera)
        if "rgb" in self.wanted.outputs:
            self._draw(ids=False, read=True)
            images["rgb"] = self.pixels[::-1].copy()
        if self._needs_ids():
            self._draw(ids=True, read=True)
            if "segmentation" in self.wanted.outputs:
                images["segmentation"] = self._ids()[::-1]
            if "depth" in self.wanted.outputs:
                images["depth"] = self._meters()[::-1]
        return images

    def _ids(self) -> np.ndarray:
        """Ids of the objects that were read, -1 where there is none."""
        drawn = self.pixels.astype(np.int64) @ (1, 2**8, 2**16)
        known = np.full((self.scene.ngeom + 1, 2), -1)
        for geom in self.scene.geoms[: self.scene.ngeom]:
            if geom.segid >= 0:
                known[geom.segid + 1] = geom.objid, geom.objtype
        return self.problem.one_id(*np.moveaxis(known[drawn], -1, 0))

    def _meters(self) -> np.ndarray:
        """Planar depth that was read [m], inf where nothing is, from 1 at the near plane and 0 at the far plane."""
        extent, planes = self.model.stat.extent, self.model.vis.map
        near, far = planes.znear * extent, planes.zfar * extent
        read = self.depth.astype(np.float64)
        meters = near * far / (near + read * (far - near))
        return np.where(read > 0.0, meters, np.inf).astype(np.float32)


create = MujocoPeer
