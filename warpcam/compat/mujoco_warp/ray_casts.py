"""Rays that are given in arrays, cast into the scene of a context."""

import weakref
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

import warpcam as wc
from warpcam.accel import ray_tables
from warpcam.compat.common.scalars import real
from warpcam.compat.mujoco_warp import kernels
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.runtime.streams import preserve_cuda_context
from warpcam.render.renderer import Renderer
from warpcam.sensors.kernels.far_sides import bind_table_far_sides
from warpcam.sensors.kernels.scan_measurement import TracedScan
from warpcam.sensors.scan_lens import ScanLens
from warpcam.sources.mujoco.device import load
from warpcam.sources.mujoco.model import NUM_GROUPS

if TYPE_CHECKING:
    from warpcam.compat.mujoco_warp.context import RenderContext

CAMERA = "rays"
OUTPUTS = ("distance", "segmentation", "normals")
MAX_BUNDLES = 16  # that a context keeps
MOST_RAYS = ray_tables.MOST_PIXELS * ray_tables.TILE_WIDTH


class RayRenderer(Renderer):
    """Traces some of the given rays, those that exclude the same body.

    Args:
        scene: What they may meet.
        given: ``GivenRays``.
        order: ``GivenRays.order`` on the host.
        hits: ``RayHits``; written.
        excluded: Ids of bodies that they do not meet.
    """

    def __init__(self, scene: wc.Scene, given: Any, order: np.ndarray, hits: Any, excluded: Sequence[int]):
        self._given, self._hits = given, hits
        directions = np.where(order[:, None] >= 0, (0.0, 0.0, -1.0), 0.0).astype(np.float32)
        table = directions.reshape(-1, ray_tables.TILE_WIDTH, 3)
        camera = wc.Camera(
            CAMERA,
            width=table.shape[1],
            height=table.shape[0],
            outputs=OUTPUTS,
            lens=ScanLens(table, np.zeros_like(table), per_world=True),
            position=(0.0, 0.0, 0.0),
            exclude_bodies=excluded,
        )
        super().__init__(scene, [camera])

    def _head(self, everything: bool) -> list[Stage]:
        given, table, worlds = self._given, self._bindings[CAMERA].table, self._scene.num_worlds
        rows = bind_launch(kernels.write_given_rays, worlds * given.tiles, [given, table], self._device)
        return [rows, bind_launch(kernels.write_whole_ball, worlds, [given.tiles, table], self._device)]

    def _tail(self) -> list[list[list[Stage]]]:
        given, images, device = self._given, self._passes[CAMERA].images, self._device
        worlds, places = self._scene.num_worlds, given.order.shape[0]
        traced = TracedScan()
        traced.distance = images["distance"].reshape((worlds, places))
        traced.shapes = images["segmentation"].reshape((worlds, places))
        traced.normals = images["normals"].reshape((worlds, places, 3))
        tables, binding = self._scene.tables(), self._bindings[CAMERA]
        shapes, first_row = binding.camera_tables(tables).shapes, 4 * (1 + 2 * given.tiles)
        exits = bind_table_far_sides(shapes, tables.materials, binding.table, first_row, traced, places, device)
        inputs = [given, traced, self._hits]
        return [[[exits, bind_launch(kernels.write_ray_hits, worlds * places, inputs, device)]]]


class RayBundle:
    """As many rays as came together, in every world, with arrays of their own.

    Args:
        scene: What they may meet.
        num_rays: How many.
        rows: 1, or the number of worlds.
        excludes: (ray,) body that each does not meet, or -1.
        others: Ids of bodies that none of them meets.
    """

    def __init__(self, scene: wc.Scene, num_rays: int, rows: int, excludes: np.ndarray, others: Sequence[int]):
        worlds, device = scene.num_worlds, scene.device
        self._device = device
        self._starts, self._vectors = (wp.zeros((rows, num_rays), dtype=wp.vec3, device=device) for _ in range(2))
        self._excludes = wp.array(excludes, dtype=wp.int32, device=device)
        self._hits = kernels.RayHits()
        self._hits.distances = wp.zeros((worlds, num_rays), dtype=wp.float32, device=device)
        self._hits.geoms = wp.zeros((worlds, num_rays), dtype=wp.int32, device=device)
        self._hits.normals = wp.zeros((worlds, num_rays), dtype=wp.vec3, device=device)
        self._renderers = [
            self._renderer(scene, int(body), np.flatnonzero(excludes == body), others) for body in np.unique(excludes)
        ]

    def cast(self, pnt: wp.array, vec: wp.array, bodyexclude: wp.array, outs: Sequence[wp.array]) -> None:
        """Cast rays into the state as it is now, and write distances, geom ids and normals to ``outs``."""
        with torch_interop.in_order(self._device):
            for mine, theirs in ((self._starts, pnt), (self._vectors, vec), (self._excludes, bodyexclude)):
                wp.copy(mine, theirs)
            for renderer in self._renderers:
                renderer.render()
            for mine, theirs in zip((self._hits.distances, self._hits.geoms, self._hits.normals), outs, strict=True):
                wp.copy(theirs, mine)

    def _renderer(self, scene: wc.Scene, body: int, rays: np.ndarray, others: Sequence[int]) -> RayRenderer:
        given = kernels.GivenRays()
        given.starts, given.vectors, given.excludes = self._starts, self._vectors, self._excludes
        given.tiles, given.excluded = -(-len(rays) // kernels.TILE), body
        order = np.full(given.tiles * kernels.TILE, -1, np.int32)
        order[: len(rays)] = rays
        given.order = wp.array(order, dtype=wp.int32, device=self._device)
        excluded = [*others] if body in others or not 0 <= body < scene_bodies(scene) else [*others, body]
        return RayRenderer(scene, given, order, self._hits, excluded)


class RayCasts:
    """All bundles of a context."""

    def __init__(self, context: "RenderContext"):
        self._context = context
        self._bundles: dict[tuple[Any, ...], RayBundle] = {}
        self._scenes: dict[tuple[Any, ...], wc.Scene] = {}
        self._excludes: dict[int, tuple[weakref.ref[wp.array], np.ndarray]] = {}

    def bundle(
        self, m: Any, d: Any, num_rays: int, rows: int, geoms: np.ndarray, flg_static: bool, bodyexclude: wp.array
    ) -> RayBundle:
        """The bundle of such rays, made for the first of them."""
        excludes = self._read(bodyexclude)
        key = (id(m), id(d), num_rays, rows, geoms.tobytes(), flg_static, excludes.tobytes())
        if key not in self._bundles:
            self._require_no_capture()
            while len(self._bundles) >= MAX_BUNDLES:
                self._bundles.pop(next(iter(self._bundles)))
            scene = self._scene(m, d, geoms)
            fixed = () if flg_static else tuple(np.flatnonzero(self._context._mjm.body_weldid == 0).tolist())
            self._bundles[key] = RayBundle(scene, num_rays, rows, excludes, fixed)
        return self._bundles[key]

    def _read(self, bodyexclude: wp.array) -> np.ndarray:
        """Contents of the array when it was seen first."""
        known = self._excludes.get(id(bodyexclude))
        if known is None or known[0]() is not bodyexclude:
            self._require_no_capture()
            while len(self._excludes) >= MAX_BUNDLES:
                self._excludes.pop(next(iter(self._excludes)))
            known = self._excludes[id(bodyexclude)] = (weakref.ref(bodyexclude), bodyexclude.numpy().copy())
        return known[1]

    def _scene(self, m: Any, d: Any, geoms: np.ndarray) -> wc.Scene:
        key = (id(m), id(d), geoms.tobytes())
        if key not in self._scenes:
            while len(self._scenes) >= MAX_BUNDLES:
                self._scenes.pop(next(iter(self._scenes)))
            with preserve_cuda_context():
                self._scenes[key] = load(
                    self._context._mjm, m, d, groups=range(NUM_GROUPS), draw=("geoms",), reflections=False,
                    transparency=False, geoms=geoms,
                )  # fmt: skip
        return self._scenes[key]

    def _require_no_capture(self) -> None:
        if torch_interop.is_capturing(self._context.device):
            raise WarpcamError(
                "rays: a capture is under way, and such rays have not been cast before; cast them once before the "
                "capture, with the same m, d, geomgroup, flg_static and bodyexclude"
            )


def scene_bodies(scene: wc.Scene) -> int:
    return int(scene.array("body_positions").shape[1])


def chosen_geoms(groups: np.ndarray, enabled: np.ndarray, geomgroup: Any) -> np.ndarray:
    """Ids of the geoms that rays may meet.

    Args:
        groups: (geom,) group of each.
        enabled: Ids of those that the context has.
        geomgroup: Six numbers, 0 for a group that is left out; six times -1, or None: no group is.
    """
    if geomgroup is None:
        return enabled
    flags = np.array([real(flag) for flag in geomgroup] if hasattr(geomgroup, "__len__") else [])
    if flags.shape != (NUM_GROUPS,) or np.isnan(flags).any():
        raise WarpcamError(f"rays: geomgroup must be {NUM_GROUPS} numbers or None, got {geomgroup!r}")
    kept = flags != 0.0
    chosen: np.ndarray = enabled[kept[np.clip(groups[enabled], 0, NUM_GROUPS - 1)]]
    return chosen


def check_arrays(device: wp.Device, **given: tuple[wp.array, Any, tuple[tuple[int, ...], ...]]) -> None:
    """Raise for arrays of another dtype, shape or device: by name, each with its dtype and the allowed shapes."""
    for name, (array, dtype, shapes) in given.items():
        fits = isinstance(array, wp.array) and array.dtype is dtype and array.shape in shapes
        if not fits or array.device != device:
            allowed = " or ".join(dict.fromkeys(map(str, shapes)))
            came = (
                f"{array.dtype.__name__} {array.shape} on {array.device.alias}"
                if isinstance(array, wp.array)
                else type(array).__name__
            )
            raise WarpcamError(
                f"rays: {name} must be a Warp array of {dtype.__name__} {allowed} on {device.alias}, got {came}"
            )
