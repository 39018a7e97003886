"""A camera bound to a scene: its own arrays, and the stage that turns them into views."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Lens, Projection
from warpcam.camera.lens_tables import RayTableLens
from warpcam.core import torch_interop
from warpcam.core.arrays import MAX_EXPOSURE, per_world
from warpcam.core.errors import WarpcamError
from warpcam.core.world_arrays import WorldArrays
from warpcam.kernels.passes import view_shape_lists
from warpcam.kernels.passes import views as views_stage
from warpcam.kernels.passes.film import FilmArrays, Metering
from warpcam.kernels.passes.views import CameraPose, LensParams
from warpcam.kernels.passes.world_overrides import copy_overrides, empty_overrides
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.scene_tables import SceneTables
from warpcam.render.camera_passes import CameraPasses, ViewArrays, parts_of
from warpcam.render.excluded_bodies import ExcludedBodies, kept_shapes
from warpcam.render.flow_history import CameraHistory
from warpcam.render.lens_table import LensTable
from warpcam.scene.scene import Scene

CLIPPING = {"none": views_stage.CLIP_NONE, "max": views_stage.CLIP_MAX, "zero": views_stage.CLIP_ZERO}


class CameraArrays(WorldArrays):
    """Arrays of one camera that may be written in place: tensors on the scene's device.

    They take effect at the next render.

    A camera of your own has ``position``, (world, 3) [m], and ``rotation``, (world, 4) w x y z. A lens of your own has
    ``fovy``, (world,) [degrees], ``intrinsics``, (world, 4) fx fy cx cy [pixels], or ``height``, (world,) [m]. Every
    camera has ``near`` and ``far``, (world,) [m]. One that was given an ``exposure`` or a ``gain`` has both, (world,)
    and (world, 3), as has one with ``AutoExposure`` or ``Bloom``. One with ``AutoExposure`` has ``auto_exposure``, too,
    (world,) [stops]: that of the last frame, from which the next frame's goes on; NaN is none. One whose ``background``
    was given for each world has that, (world, 3). What is the scene's own is written in the simulator's arrays.
    """

    def _instead(self, name: str) -> str:
        if name in ("exposure", "gain", "background"):
            return f"; {name} is there where Camera was given one{' for each world' if name == 'background' else ''}"
        return "; the rest is the simulator's to hold"


class CameraBinding:
    """One camera in a scene.

    Args:
        camera: The camera.
        scene: The scene.
        reflections: Of the renderer: a pixel has other parts then.

    Attributes:
        arrays: What may be written, by name.
        film: FilmArrays, where what is shown depends on the light of a whole image, else None.
    """

    def __init__(self, camera: Camera, scene: Scene, reflections: bool = False):
        self._scene = scene
        self._camera = camera
        self._index = -1 if camera.is_own else scene.camera(camera.name, "Renderer: cameras")
        self._parent = -1 if camera.parent is None else scene.body(camera.parent, f"{camera.where}: parent")
        self._excluded = ExcludedBodies(kept_shapes(camera, scene), scene.tables()) if camera.exclude_bodies else None
        self.arrays: dict[str, wp.array] = {}
        if camera.is_own:
            self._own("position", (0.0, 0.0, 0.0) if camera.position is None else camera.position, wp.vec3)
            self._own("rotation", (1.0, 0.0, 0.0, 0.0) if camera.rotation is None else camera.rotation, wp.vec4)
            rotations = self.arrays["rotation"].numpy().astype(np.float64)
            lengths = np.linalg.norm(rotations, axis=1, keepdims=True)
            if not lengths.all():
                raise WarpcamError(f"{camera.where}: rotation must not be of length 0, got {camera.rotation!r}")
            fit = (lengths > 1e-6) & (lengths < 1e6)  # to be squared
            self.arrays["rotation"].assign(np.where(fit, rotations, rotations / lengths).astype(np.float32))
        if camera.lens is not None:
            if isinstance(camera.lens, RayTableLens):
                self._tables = {
                    parts: LensTable(camera, camera.lens, scene.num_worlds, scene.device, parts)
                    for parts in dict.fromkeys([(1, 1), parts_of(camera, reflections)])
                }
            else:
                self._make_lens(camera.lens)
        clipping = None if camera.is_own else scene.camera_kind(self._index).clipping
        near, far = clipping or (0.0, math.inf)
        self._own("near", near if camera.near is None else camera.near, wp.float32)
        self._own("far", far if camera.far is None else camera.far, wp.float32, may_be_infinite=True)
        self._check_range()
        self._make_exposure()
        self.film = self._make_film() if camera.needs_film else None

    @property
    def projection(self) -> Projection:
        return projection_of(self._camera, self._scene)

    @property
    def table(self) -> wp.array:
        """Rays of a lens that is a table, float32 (1 or world, number), as native/camera/ray_table.h reads them."""
        return self._tables[1, 1].table

    def camera_tables(self, tables: SceneTables) -> SceneTables:
        """The scene as this camera has it: what it does not see, its background, its exposure."""
        background, arrays = self._camera.background, self.arrays
        tables = self._seen(tables)
        if not isinstance(background, np.ndarray):
            tables = self._scene.tables_with(tables, background)
        exposes = "exposure" in arrays and self.film is None  # film is exposed when all of its light is there
        if not (exposes or "background" in arrays):
            return tables
        overrides = (
            copy_overrides(tables.world_overrides)
            if tables.world_overrides is not None
            else empty_overrides(self._scene.device)
        )
        if exposes:
            overrides.exposures, overrides.gains = arrays["exposure"], arrays["gain"]
        if "background" in arrays:
            overrides.backgrounds, overrides.skyboxes = arrays["background"], self._no_skybox
            tables = replace(tables, has_skybox=False, shows_environment=False)
        return replace(tables, world_overrides=overrides)

    def bind(
        self,
        mask: wp.array,
        faults: wp.array,
        tables: SceneTables,
        passes: CameraPasses,
        frame_start: Any = None,
    ) -> Iterator[Stage]:
        """Yield the stages that write the camera's views, with the scene's arrays as of its last ``tables()``.

        If the camera has a history, the views there were go there. Where its plan lists shapes the stage does so, and
        composes how they have moved. With a ``frame_start`` the first is a frame's first.
        """
        yield self._bind(mask, faults, tables, passes.seen, passes.history, frame_start)
        if passes.finer is not None:
            yield self._bind(mask, faults, tables, passes.finer)

    def _bind(
        self,
        mask: wp.array,
        faults: wp.array,
        tables: SceneTables,
        seen: ViewArrays,
        history: CameraHistory | None = None,
        frame_start: Any = None,
    ) -> Stage:
        pose, lens, device = self.pose(), self._lens(seen.parts), self._scene.device
        views, key = seen.views, seen.plan.lists
        if key is None:
            before = None if history is None else history.views
            return views_stage.bind_views(
                pose, lens, mask, faults, views, device=device, before=before, frame_start=frame_start
            )
        flow_history = None if history is None else history.flow_history
        return view_shape_lists.bind_lists(
            key,
            frame_start=frame_start,
            pose=pose,
            lens=lens,
            mask=mask,
            faults=faults,
            views=views,
            tables=self._seen(tables),
            lists=seen.lists,
            history=flow_history,
            device=device,
        )

    def _seen(self, tables: SceneTables) -> SceneTables:
        return tables if self._excluded is None else self._excluded.without(tables)

    def pose(self) -> CameraPose:
        """Arrays that the camera's pose in each world comes from."""
        pose, scene = CameraPose(), self._scene
        pose.own = int(self._camera.is_own)
        pose.parent = self._parent
        if self._camera.is_own:
            pose.positions = self.arrays["position"].reshape((scene.num_worlds, 1))
            pose.quaternions = self.arrays["rotation"]
            pose.parent_positions = scene.array("body_positions")
            pose.parent_rotations = scene.array("body_rotations")
        else:
            pose.column = self._index
            pose.positions = scene.array("camera_positions")
            pose.rotations = scene.array("camera_rotations")
        return pose

    def _lens(self, parts: tuple[int, int]) -> LensParams:
        lens, scene, camera = LensParams(), self._scene, self._camera
        lens.near, lens.far = self.arrays["near"], self.arrays["far"]
        lens.clipping = CLIPPING[camera.depth_clipping]
        lens.width, lens.height, lens.parts = camera.width, camera.height, wp.vec2(*map(float, parts))
        if camera.lens is None:
            kind = scene.camera_kind(self._index)
            lens.column = self._index
            lens.angles = scene.array("camera_fovy")
            lens.intrinsics = scene.array("camera_intrinsics")
            if kind.sensor is not None:
                lens.kind = views_stage.SENSOR
                width, height = kind.sensor
                if kind.square:
                    height = width * camera.height / camera.width
                lens.sensor = wp.vec2(width, height)
            elif kind.projection == "orthographic":
                lens.kind = views_stage.HEIGHT
            else:
                lens.kind = views_stage.FOVY
            return lens
        if isinstance(camera.lens, RayTableLens):
            lens.kind, lens.intrinsics = views_stage.TABLE, self._tables[parts].handles
            return lens
        for name, kind_of_lens in (
            ("fovy", views_stage.FOVY),
            ("height", views_stage.HEIGHT),
            ("intrinsics", views_stage.INTRINSICS),
        ):
            if name in self.arrays:
                lens.kind = kind_of_lens
                values = self.arrays[name].reshape((scene.num_worlds, 1))
                setattr(lens, "intrinsics" if name == "intrinsics" else "angles", values)
        return lens

    def set_table(self, lens: Any) -> None:
        """Write another lens over the table there is."""
        camera, own = self._camera, self._camera.lens
        if not isinstance(own, RayTableLens) or not isinstance(lens, RayTableLens):
            raise WarpcamError(
                f"{camera.where}: set_lens puts a table of rays (Fisheye, Rays, ...) in place of another, got "
                f"{type(lens).__name__} in place of {type(own).__name__}; other lenses have arrays to write to"
            )
        if lens.has_origins and not own.has_origins:
            raise WarpcamError(
                f"{camera.where}: set_lens was given Rays with origins, and the renderer was built with a lens whose "
                "rays all begin at the camera's position; build it with Rays that have origins"
            )
        if not lens.has_parts and self._tables.keys() != {(1, 1)}:
            raise WarpcamError(
                f"{camera.where}: set_lens was given {type(lens).__name__}, which has a ray for each pixel, and "
                f"antialiasing={camera.antialiasing} needs rays of their parts; build it with antialiasing=4"
            )
        if lens.differs and not own.differs and self._scene.num_worlds > 1:
            raise WarpcamError(
                f"{camera.where}: set_lens was given a lens for each world, and the renderer was built with one for "
                "all; build it with a lens for each world"
            )
        for table in self._tables.values():
            table.assign(lens)

    def _make_lens(self, lens: Lens) -> None:
        camera, num_worlds = self._camera, self._scene.num_worlds
        kind = type(lens).__name__
        for name, values in lens.values(camera.width, camera.height).items():
            labels = ("fx", "fy", "cx", "cy") if name == "intrinsics" else (name,)
            columns = []
            for label, value in zip(labels, values, strict=True):
                where = f"{camera.where}: lens {kind}: {label}"
                numbers = per_world(value, where, num_worlds, ())
                lowest, highest = float(numbers.min()), float(numbers.max())
                if label == "fovy" and not 0.0 < lowest <= highest < 180.0:
                    raise WarpcamError(f"{where} must be in (0, 180) degrees, got {_worst(numbers, 0.0, 180.0)}")
                if label in ("fx", "fy", "height") and lowest <= 0.0:
                    raise WarpcamError(f"{where} must be positive, got {lowest}")
                columns.append(numbers)
            stacked = np.stack(columns, axis=-1)
            dtype = wp.vec4 if name == "intrinsics" else wp.float32
            data = stacked if name == "intrinsics" else stacked[:, 0]
            self.arrays[name] = wp.array(np.ascontiguousarray(data), dtype=dtype, device=self._scene.device)

    def _make_exposure(self) -> None:
        camera, device = self._camera, self._scene.device
        if isinstance(camera.background, np.ndarray):
            self._own("background", camera.background, wp.vec3)
            self._no_skybox = wp.full(1, -1, dtype=wp.int32, device=device)
        if not camera.has_exposure:
            return
        self._own("exposure", 0.0 if camera.exposure is None else camera.exposure, wp.float32)
        if self.arrays["exposure"].numpy().max() > MAX_EXPOSURE:
            raise WarpcamError(f"{camera.where}: exposure must be at most {MAX_EXPOSURE}, got {camera.exposure!r}")
        gain = 1.0 if camera.gain is None else camera.gain
        try:
            is_one = torch_interop.to_numpy(gain).ndim == 0
        except (TypeError, ValueError):
            is_one = False  # what it is instead, is told with the numbers
        self._own("gain", np.tile(torch_interop.to_numpy(gain), 3) if is_one else gain, wp.vec3)
        if self.arrays["gain"].numpy().min() < 0.0:
            raise WarpcamError(f"{camera.where}: gain must not be negative, got {camera.gain!r}")

    def _make_film(self) -> FilmArrays:
        camera, device, worlds = self._camera, self._scene.device, self._scene.num_worlds
        metering, automatic = None, wp.empty(0, dtype=wp.float32, device=device)
        if (auto := camera.auto_exposure) is not None:
            metering = Metering()
            metering.key, (metering.lowest, metering.highest), metering.rate = auto.key, auto.limits, auto.rate
            automatic = wp.full(worlds, math.nan, dtype=wp.float32, device=device)
            self.arrays["auto_exposure"] = automatic
        weights = np.zeros(0, np.float32) if camera.bloom is None else camera.bloom.weights(camera.height)
        return FilmArrays(
            exposures=self.arrays["exposure"],
            gains=self.arrays["gain"],
            metering=metering,
            automatic=automatic,
            before=wp.empty(automatic.size, dtype=wp.float32, device=device),
            weights=wp.array(weights, dtype=wp.float32, device=device),
            strength=0.0 if camera.bloom is None else camera.bloom.strength,
        )

    def _own(self, name: str, value: Any, dtype: Any, may_be_infinite: bool = False) -> None:
        width = {wp.vec3: (3,), wp.vec4: (4,)}.get(dtype, ())
        where = f"{self._camera.where}: {name}"
        numbers = per_world(value, where, self._scene.num_worlds, width, may_be_infinite=may_be_infinite)
        self.arrays[name] = wp.array(numbers, dtype=dtype, device=self._scene.device)

    def _check_range(self) -> None:
        near, far = self.arrays["near"].numpy(), self.arrays["far"].numpy()
        where = self._camera.where
        if near.min() < 0.0:
            raise WarpcamError(f"{where}: near must be at least 0, got {near.min()}")
        if not (far > near).all():
            world = int(np.argmin(far > near))
            raise WarpcamError(f"{where}: far must be beyond near, got near {near[world]} and far {far[world]}")
        if self._camera.depth_clipping == "max" and not np.isfinite(far).all():
            raise WarpcamError(f'{where}: depth_clipping="max" needs a finite far, got {far[~np.isfinite(far)][0]}')


def projection_of(camera: Camera, scene: Scene) -> Projection:
    """Return the kind of the camera's rays."""
    if camera.lens is not None:
        return camera.lens.projection
    return scene.camera_kind(scene.camera(camera.name, "Renderer: cameras")).projection


def pose_bytes(camera: Camera) -> int:
    """Bytes of a camera's own arrays in each world."""
    numbers = 2  # near and far
    if isinstance(camera.background, np.ndarray):
        numbers += 3
    if camera.has_exposure:
        numbers += 1 + 3
    if camera.auto_exposure is not None:
        numbers += 2  # the last frame's and that before
    if camera.is_own:
        numbers += 3 + 4  # position, rotation
    if camera.lens is not None:
        numbers += sum(len(values) for values in camera.lens.values(camera.width, camera.height).values())
    return 4 * numbers


def shared_bytes(camera: Camera, scene: Scene, reflections: bool = False) -> int:
    """Bytes of what a camera has beside, however many worlds there are.

    These are a lens's table, a bloom's weights, that there is no skybox, and which shapes it sees if not all.
    """
    table = 0
    if isinstance(camera.lens, RayTableLens):
        for across, down in dict.fromkeys([(1, 1), parts_of(camera, reflections)]):
            table += camera.lens.bytes(across * camera.width, down * camera.height, scene.num_worlds)
    seen = 4 * (len(kept_shapes(camera, scene)) + scene.tables().num_shapes) if camera.exclude_bodies else 0
    blur = 0 if camera.bloom is None else camera.bloom.weights(camera.height).nbytes
    return table + seen + blur + 4 * isinstance(camera.background, np.ndarray)


def _worst(numbers: np.ndarray, low: float, high: float) -> float:
    return float(numbers[(numbers <= low) | (numbers >= high)].flat[0])
