"""All cameras: those of one size are one camera of many worlds, and each image has memory of its own that stays."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import newton
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.compat.isaacgym.api.enums import ImageType, one_of
from warpcam.compat.isaacgym.api.tensors import Tensor
from warpcam.compat.isaacgym.cameras.appearance import Appearance, EnvironmentScene
from warpcam.compat.isaacgym.cameras.sensor import SAMPLES, Sensor, axes, focal_length
from warpcam.compat.isaacgym.kernels import state as kernels
from warpcam.compat.isaacgym.physics.environments import Env, Grounds
from warpcam.compat.isaacgym.physics.physics import Physics
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import Stage, bind_launch

COLOR, DEPTH, SEGMENTATION, FLOW = ImageType
NEEDS = {COLOR: ("rgba",), DEPTH: ("depth",), SEGMENTATION: ("segmentation",), FLOW: ("flow", "flow_valid")}
DTYPES = {COLOR: wp.uint8, DEPTH: wp.float32, SEGMENTATION: wp.int32, FLOW: wp.int16}
CHANNELS = {COLOR: (4,), DEPTH: (), SEGMENTATION: (), FLOW: (2,)}
AT_ONCE = 2**28  # bytes of images that are copied to the host together


def check_kind(kind: Any, where: str) -> ImageType:
    found: ImageType = one_of(ImageType, kind, f"{where}: image type")
    return found


def shape_of(sensor: Sensor, kind: ImageType) -> tuple[int, ...]:
    return (sensor.props.height, sensor.props.width, *CHANNELS[kind])


class Batch:
    """Cameras of one size, one in each of some environments, and where they are.

    Attributes:
        moved: Whether one has been put elsewhere since they were last placed.
    """

    def __init__(self, name: str, view: EnvironmentScene, sensors: Sequence[Sensor], device: wp.Device, turn: wp.quat):
        self.name, self.view, self.sensors, self.device, self._turn = name, view, list(sensors), device, turn
        self.moved, self.alive = True, len(sensors)
        count = len(sensors)
        self._modes = wp.zeros(count, dtype=wp.int32, device=device)
        self._bodies = wp.zeros(count, dtype=wp.int32, device=device)
        self._offsets = wp.zeros(count, dtype=wp.transform, device=device)
        for world, sensor in enumerate(sensors):
            sensor.batch, sensor.world = self, world

    @property
    def props(self) -> Any:
        return self.sensors[0].props

    def camera(self, outputs: Sequence[str]) -> wc.Camera:
        props = self.props
        each = [sensor.props for sensor in self.sensors]
        return wc.Camera(
            self.name,
            width=props.width,
            height=props.height,
            outputs=outputs,
            lens=wc.Pinhole(fx=np.array([focal_length(one) for one in each])),
            position=(0.0, 0.0, 0.0),
            near=np.array([one.near_plane for one in each]),
            far=np.array([one.far_plane for one in each]),
            shadows=props.shadows,
            antialiasing=SAMPLES[props.supersampling_horizontal, props.supersampling_vertical],
        )

    def record(self, arrays: Any) -> Stage:
        """Return the stages that write camera poses into a renderer's arrays, from the poses of the view's bodies."""
        into = [torch_interop.as_array(arrays.position), torch_interop.as_array(arrays.rotation)]
        inputs = [self.view.poses, self._modes, self._bodies, self._offsets, self._turn, *into]
        return bind_launch(kernels.place_cameras, len(self.sensors), inputs, self.device)

    def settle(self) -> None:
        """Bring up to date what it is made of."""
        if self.moved:
            self._modes.assign(np.array([sensor.mode for sensor in self.sensors], np.int32))
            first = self.view.starts
            self._bodies.assign(
                np.array([max(sensor.body, 0) + first[w] for w, sensor in enumerate(self.sensors)], np.int32)
            )
            self._offsets.assign(np.array([sensor.pose.numbers() for sensor in self.sensors], np.float32))
            self.moved = False


class ImageBuffers:
    """Buffers of one image type of a batch's cameras.

    Attributes:
        images: (world, height, width, channels), or None where each camera has memory of its own.
    """

    def __init__(self, batch: Batch, kind: ImageType, together: bool):
        self.batch, self.kind, self.dirty = batch, kind, True
        self._addresses = wp.zeros(len(batch.sensors), dtype=wp.uint64, device=batch.device)
        self.images: torch_interop.Tensor | None = None
        self._host: np.ndarray | None = None
        self._reads = 0
        if together:
            shape = (len(batch.sensors), *shape_of(batch.sensors[0], kind))
            self.images = torch_interop.to_torch(wp.zeros(shape, dtype=DTYPES[kind], device=batch.device))

    def record(self, renderer: wc.Renderer) -> Stage:
        """Return the stages that fill the buffers from a renderer's images of the batch."""
        batch, kind, device = self.batch, self.kind, self.batch.device
        sources = [renderer.array(batch.name, name) for name in NEEDS[kind]]
        first = sources[0]
        worlds, height, width = first.shape[:3]
        pixels = height * width
        if kind == FLOW:
            flat = [first.reshape((worlds, pixels, 2)), sources[1].reshape((worlds, pixels))]
            inputs, kernel = [*flat, float(width), float(height)], kernels.write_flow
        elif kind == COLOR:
            packed = shared(first, (worlds, pixels), wp.uint32)
            inputs, kernel = [packed], kernels.write_colors
        elif kind == DEPTH:
            inputs, kernel = [first.reshape((worlds, pixels))], kernels.write_depth
        else:
            inputs, kernel = [first.reshape((worlds, pixels)), batch.view.ids], kernels.write_ids
        return bind_launch(kernel, worlds * pixels, [*inputs, self._addresses], device)

    def settle(self) -> None:
        """Forget what was read of the last render, and bring up to date where images go."""
        self._host, self._reads = None, 0
        if self.dirty:
            self._addresses.assign(np.array(self._where(), np.uint64))
            self.dirty = False

    def read(self, world: int) -> np.ndarray:
        """One image of the sheet on the host; all of them are fetched when a second one is asked for."""
        assert self.images is not None
        self._reads += 1
        if self._host is None and self._reads > 1 and self.images.nbytes <= AT_ONCE:
            self._host = torch_interop.to_numpy(self.images)
        if self._host is not None:
            return self._host[world].copy()
        return np.array(torch_interop.to_numpy(self.images[world]))

    def _where(self) -> list[int]:
        if self.images is not None:
            first, step = self.images.data_ptr(), self.images[0].nbytes
            return [first + world * step for world in range(len(self.batch.sensors))]
        found = [sensor.tensors.get(self.kind) if sensor.world >= 0 else None for sensor in self.batch.sensors]
        return [0 if tensor is None else tensor.data_ptr for tensor in found]


class BatchRenderer:
    """Batches that are drawn together by one renderer."""

    def __init__(self, view: EnvironmentScene, albums: Sequence[ImageBuffers]):
        self.view, self.buffers, self.frame = view, list(albums), -1
        self._device = albums[0].batch.device
        self._renderer: wc.Renderer | None = None
        self._version = -1
        self._before: list[Stage] = []
        self._after: list[Stage] = []

    def drop(self, batch: Batch) -> None:
        self.buffers = [album for album in self.buffers if album.batch is not batch]
        self._version = -1

    def draw(self, frame: int) -> None:
        renderer = self._renderer
        if renderer is None or self._version != self.view.version:
            renderer = self._build()
        with torch_interop.in_order(self._device):
            for batch in self._batches:
                batch.settle()
            for stage in self._before:
                stage.launch()
        renderer.render()
        with torch_interop.in_order(self._device):
            for album in self.buffers:
                album.settle()
            for stage in self._after:
                stage.launch()
        self.frame = frame

    def _build(self) -> wc.Renderer:
        self._batches = list(dict.fromkeys(album.batch for album in self.buffers))
        self._renderer = None  # its memory is free before another takes some
        self._before, self._after = [], []
        cameras = []
        for batch in self._batches:
            names = [name for album in self.buffers if album.batch is batch for name in NEEDS[album.kind]]
            cameras.append(batch.camera(names))
        renderer = self._renderer = wc.Renderer(self.view.scene, cameras)
        self._before = [batch.record(renderer.camera(batch.name)) for batch in self._batches]
        self._after = [album.record(renderer) for album in self.buffers]
        self._version = self.view.version
        return renderer


class CameraBatches:
    """The cameras of a simulation."""

    def __init__(self, appearance: Appearance, grounds: Grounds, up: newton.Axis):
        self._appearance, self._grounds, self._up = appearance, grounds, up
        self._new: list[Sensor] = []
        self._asked: list[tuple[Sensor, ImageType]] = []  # tensors that nothing draws yet
        self._views: dict[tuple[Any, ...], EnvironmentScene] = {}
        self._renderers: list[BatchRenderer] = []
        self._later: dict[tuple[Batch, ImageType], BatchRenderer] = {}  # drawn only when somebody looks
        self._first: dict[tuple[Batch, ImageType], BatchRenderer] = {}  # of tensors that the next render draws at last
        self._buffers: dict[tuple[Batch, ImageType], ImageBuffers] = {}
        self._batches: list[Batch] = []
        self._count = 0
        self.frame = 0

    def add(self, sensor: Sensor) -> None:
        self._new.append(sensor)

    def remove(self, sensor: Sensor) -> None:
        """Forget a camera; memory that nobody else holds is given back."""
        self._new = [other for other in self._new if other is not sensor]
        self._asked = [(other, kind) for other, kind in self._asked if other is not sensor]
        batch, sensor.batch, sensor.world = sensor.batch, None, -1
        sensor.tensors.clear()
        if batch is None:
            return
        batch.alive -= 1
        for album in self._buffers.values():
            album.dirty |= album.batch is batch
        if batch.alive:
            return
        for batch_renderer in self._renderers:
            batch_renderer.drop(batch)
        self._renderers = [batch_renderer for batch_renderer in self._renderers if batch_renderer.buffers]
        self._later = {key: batch_renderer for key, batch_renderer in self._later.items() if key[0] is not batch}
        self._first = {key: batch_renderer for key, batch_renderer in self._first.items() if key[0] is not batch}
        self._buffers = {key: album for key, album in self._buffers.items() if key[0] is not batch}
        self._batches.remove(batch)
        used = {id(other.view) for other in self._batches}
        self._views = {key: view for key, view in self._views.items() if id(view) in used}

    def tensor(self, sensor: Sensor, kind: ImageType, device: wp.Device) -> Tensor:
        """Memory of a camera's images, which holds that of the last render, and is written at each from now on."""
        if kind not in sensor.tensors:
            array = wp.zeros(shape_of(sensor, kind), dtype=DTYPES[kind], device=device)
            size = (sensor.props.height, sensor.props.width)
            image = torch_interop.to_torch(array)
            if self.frame > 0 and sensor.batch is not None:
                drawn = self._drawn(sensor.batch, kind, self._first).images
                assert drawn is not None
                image.copy_(drawn[sensor.world])
            sensor.tensors[kind] = Tensor(image, size if kind == FLOW else None)
            self._asked.append((sensor, kind))
        return sensor.tensors[kind]

    def render(self, physics: Physics, envs: Sequence[Env]) -> None:
        self._first.clear()
        self._settle(physics, envs)
        with torch_interop.in_order(physics.device):
            for view in self._views.values():
                view.update()
        self.frame += 1
        for batch_renderer in self._renderers:
            batch_renderer.draw(self.frame)

    def read(self, sensor: Sensor, kind: ImageType) -> np.ndarray:
        """A copy of a camera's image as of the last render."""
        if self.frame == 0 or sensor.batch is None:
            raise WarpcamError(
                f"get_camera_image: {sensor.where} has not been rendered yet; render_all_camera_sensors does"
            )
        if kind in sensor.tensors and (sensor.batch, kind) in self._buffers:
            return np.array(torch_interop.to_numpy(sensor.tensors[kind].torch))
        return self._drawn(sensor.batch, kind, self._later).read(sensor.world)

    def _drawn(self, batch: Batch, kind: ImageType, kept: dict[tuple[Batch, ImageType], BatchRenderer]) -> ImageBuffers:
        """Images of a batch as of the last render; what is made to draw them is kept there."""
        key = (batch, kind)
        renderer = self._later.get(key) or kept.get(key)
        if renderer is None:
            renderer = kept[key] = BatchRenderer(batch.view, [ImageBuffers(batch, kind, together=True)])
            if kind == FLOW and kept is self._later:  # since the render before, whoever looks
                self._renderers.append(renderer)
        if renderer.frame != self.frame:
            renderer.draw(self.frame)
        return renderer.buffers[0]

    def _settle(self, physics: Physics, envs: Sequence[Env]) -> None:
        """Give new cameras their batches, and new tensors what draws them."""
        groups: dict[tuple[Any, ...], list[Sensor]] = defaultdict(list)
        seen: dict[tuple[Any, ...], int] = defaultdict(int)
        for sensor in sorted(self._new, key=lambda one: (one.env.index, one.handle)):
            props = sensor.props
            samples = (props.supersampling_horizontal, props.supersampling_vertical)
            size = (props.width, props.height, samples, bool(props.use_collision_geometry), bool(props.shadows))
            groups[(*size, seen[(*size, sensor.env.index)])].append(sensor)
            seen[(*size, sensor.env.index)] += 1
        turn = wp.quat(*axes(self._up))
        for size, sensors in groups.items():
            view = self._view(physics, envs, [sensor.env for sensor in sensors], size[3])
            self._count += 1
            self._batches.append(Batch(f"camera {self._count}", view, sensors, physics.device, turn))
        self._new = []
        fresh: dict[int, tuple[EnvironmentScene, list[ImageBuffers]]] = {}
        for sensor, kind in self._asked:
            key = (sensor.batch, kind)
            if key not in self._buffers:
                self._buffers[key] = ImageBuffers(sensor.batch, kind, together=False)
                view = sensor.batch.view
                fresh.setdefault(id(view), (view, []))[1].append(self._buffers[key])
            self._buffers[key].dirty = True
        self._asked = []
        self._renderers += [BatchRenderer(view, albums) for view, albums in fresh.values()]

    def _view(
        self, physics: Physics, all_envs: Sequence[Env], envs: Sequence[Env], colliders: bool
    ) -> EnvironmentScene:
        key = (colliders, tuple(env.index for env in envs))
        if key not in self._views:
            self._views[key] = EnvironmentScene(physics, envs, self._grounds, self._appearance, self._up, colliders)
        return self._views[key]
