"""The images of one camera, and the stages that make them."""

from collections.abc import Mapping
from dataclasses import dataclass

import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Projection
from warpcam.camera.outputs import OUTPUTS, smooth_outputs, traced_as
from warpcam.core.errors import WarpcamError
from warpcam.kernels.layers import LayerTables, Mirror
from warpcam.kernels.passes import antialiasing, mirrors, shading, shadow, splats, visibility
from warpcam.kernels.plan import launches
from warpcam.kernels.plan import trace as trace_plan
from warpcam.kernels.plan.shading import traced_albedo_facts
from warpcam.kernels.runtime.launch import Group, Stage
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import HEIGHT_FIELD, MESH, View
from warpcam.render.flow_history import CameraHistory, needs_history
from warpcam.scene.layers import shows_mirrors, shows_transparent

MAX_PIXELS = 2**31


def check_size(camera: Camera, num_worlds: int) -> None:
    if num_worlds * camera.height * camera.width >= MAX_PIXELS:
        raise WarpcamError(
            f"{camera.where}: {num_worlds} worlds of {camera.width} x {camera.height} pixels are 2^31 "
            "pixels or more; fewer are allowed in one camera"
        )


@dataclass(frozen=True)
class Stages:
    """Stages that render one group of worlds.

    Attributes:
        visibility: Up to those that find what is seen and what lies in shadows.
        shading: The rest; nothing else writes ``CameraPasses.written_by_last_stage``.
    """

    visibility: list[Stage]
    shading: list[Stage]


def list_rows(camera: Camera, projection: Projection, tables: SceneTables, device: wp.Device) -> int:
    """Rows of four words that a camera has in each world for the shapes its image may show."""
    if shows_transparent(camera, tables):  # a trace of its own leaves out what is transparent
        return 0
    capacity = trace_plan.capacity_of(tables, projection, camera.width, camera.height, camera.outputs, device)
    return trace_plan.rows_of(capacity, camera.outputs)


class CameraPasses:
    """Only what the camera's outputs need is there.

    Attributes:
        views: View, (world,).
        images: Array of each output, (world, height, width, channels).
        written_by_last_stage: Names of those that only the last stages write, where these may wait for other worlds.
        history: What is kept of the last frame; None where no output needs it.
        lists: vec4, (world, row): the shapes that its images may show, where a stage lists them; else None.
    """

    def __init__(self, camera: Camera, projection: Projection, tables: SceneTables, device: wp.Device):
        num_worlds = tables.num_worlds
        size = (num_worlds, camera.height, camera.width)
        self._camera, self._device = camera, device
        self.written_by_last_stage = _written_by_last_stage(camera, tables)
        self.views = wp.zeros(num_worlds, dtype=View, device=device)
        behind = num_worlds if shows_mirrors(camera, tables) else 0
        self._mirrored = wp.zeros(behind, dtype=View, device=device)  # views from behind the mirrors
        self._mirrors = wp.zeros(behind, dtype=Mirror, device=device)
        self.images: dict[str, wp.array] = {
            name: wp.zeros((*size, OUTPUTS[name].channels), dtype=OUTPUTS[name].dtype, device=device)
            for name in camera.outputs
        }
        rows = list_rows(camera, projection, tables, device)
        self.lists = wp.zeros((num_worlds, rows), dtype=wp.vec4, device=device) if rows else None
        self.history = (
            CameraHistory(camera, tables, device, self.images, listed=rows > 0) if needs_history(camera) else None
        )

    def bind(
        self,
        tables: SceneTables,
        projection: Projection,
        group: Group,
        buffers: Mapping[str, wp.array],
        mask: wp.array,
        faults: wp.array,
    ) -> Stages:
        """The stages that make the images of a group of worlds from their views, by way of ``buffers``."""
        lit = [name for name in self.images if OUTPUTS[name].lit]
        rest = [name for name in self.images if not OUTPUTS[name].lit]
        if shows_transparent(self._camera, tables):  # what is seen through is not where the other outputs have it
            sets = [(rest, False), (lit, True)] if rest else [(lit, True)]
            recorded = [
                self._bind(names, opaque, tables, projection, group, buffers, mask, faults) for names, opaque in sets
            ]
            return Stages([stage for stages in recorded for stage in (*stages.visibility, *stages.shading)], [])
        return self._bind([*lit, *rest], False, tables, projection, group, buffers, mask, faults)

    def _bind(
        self,
        outputs: list[str],
        opaque: bool,
        tables: SceneTables,
        projection: Projection,
        group: Group,
        buffers: Mapping[str, wp.array],
        mask: wp.array,
        faults: wp.array,
    ) -> Stages:
        """The stages of some of the outputs; ``opaque``: from what is seen without transparent shapes."""
        device, views, width, height = self._device, self.views, self._camera.width, self._camera.height
        layers = tables.layers
        names = {name: traced_as(name, tables.shape_types) for name in outputs}
        traced = {trace: self.images[name] for name, trace in names.items() if trace is not None}
        derived = {name: self.images[name] for name, trace in names.items() if trace is None}
        if tables.ids_by_world and "shape" in traced:  # what is asked for are ids; the stages pass on columns
            traced["ids"] = traced.pop("shape")
        smooth = [name for name in smooth_outputs(self._camera.outputs, self._camera.antialiasing) if name in derived]
        for name in smooth:  # is lit into a buffer first, if there is one
            image = self.images[name]
            if f"lit {name}" in buffers:
                derived[name] = wp.array(
                    ptr=buffers[f"lit {name}"].ptr, shape=image.shape, dtype=image.dtype, device=device
                )
        if "albedo" in derived and trace_plan.traces_albedo(
            tables, projection, width, height, group.concurrent_worlds, traced, device
        ):
            traced["albedo"] = derived.pop("albedo")
        lit = {name: image for name, image in derived.items() if OUTPUTS[name].lit}
        if projection in launches.TABLES:
            traced = _swapped(traced)
        depth, shape, face = (traced.pop(name, buffers.get(name)) for name in ("depth", "shape", "face"))
        shadows = buffers.get("shadow") if lit else None
        transparent_index = layers.transparent_index if opaque and layers is not None else None
        first = [
            visibility.bind(
                tables,
                projection,
                views,
                mask,
                faults,
                width,
                height,
                depth,
                shape,
                face,
                traced,
                device,
                group,
                transparent_index,
                flow_history=None if self.history is None else self.history.flow_history,
                facts=traced_albedo_facts(tables),
                lists=self.lists,
            )
        ]
        if shadows is not None:
            first.append(
                shadow.bind(tables, projection, views, mask, depth, shape, face, width, height, shadows, device, group)
            )
        last: list[Stage] = []
        if derived:
            reflecting = layers is not None and bool(lit) and self._mirrors.size > 0
            if layers is not None and reflecting:
                last += self._bind_mirrors(lit, tables, layers, projection, group, buffers, mask, faults, depth, shape)
            if face is None:
                face = wp.empty(0, dtype=wp.int32, device=device)
            last.append(
                shading.bind(
                    derived,
                    projection,
                    tables,
                    views,
                    mask,
                    depth,
                    shape,
                    face,
                    shadows,
                    width,
                    height,
                    device,
                    group,
                    layers,
                    self._mirrors if reflecting else None,
                    noted=bool(smooth) and opaque and tables.physical is None and tables.splats is None,
                )
            )
        if smooth:
            last.append(
                antialiasing.bind(
                    {name: self.images[name] for name in smooth},
                    {name: lit[name] for name in smooth},
                    tables,
                    projection,
                    views,
                    mask,
                    depth,
                    shape,
                    face,
                    device,
                    group,
                )
            )
        if tables.splats is not None:
            flow_history = None if self.history is None else self.history.flow_history
            first.insert(0, splats.bind_check(tables, views, mask, faults, device, group))
            blended = {name: self.images[name] for name in outputs}
            last.append(
                splats.bind(
                    _swapped(blended) if projection in launches.TABLES else blended,
                    projection,
                    tables,
                    views,
                    mask,
                    depth,
                    shape,
                    width,
                    height,
                    device,
                    group,
                    flow_history,
                )
            )
        return Stages(first, last)

    def _bind_mirrors(
        self,
        outputs: Mapping[str, wp.array],
        tables: SceneTables,
        layers: LayerTables,
        projection: Projection,
        group: Group,
        buffers: Mapping[str, wp.array],
        mask: wp.array,
        faults: wp.array,
        seen_depth: wp.array,
        seen_shape: wp.array,
    ) -> list[Stage]:
        """The stages that draw into the images what mirrors show; the mirrors' own colour comes on top."""
        device, width, height = self._device, self._camera.width, self._camera.height
        depth, shape, face = (buffers.get(f"mirror {name}") for name in ("depth", "shape", "face"))
        return [
            mirrors.bind_mirrors(tables, layers, self.views, mask, width, self._mirrors, self._mirrored, device, group),
            mirrors.bind_trace(
                tables,
                layers,
                projection,
                self._mirrored,
                self._mirrors,
                mask,
                faults,
                seen_depth,
                seen_shape,
                depth,
                shape,
                face,
                width,
                height,
                device,
                group,
            ),
            shading.bind(
                outputs,
                projection,
                tables,
                self._mirrored,
                mask,
                depth,
                shape,
                wp.empty(0, dtype=wp.int32, device=device) if face is None else face,
                None,
                width,
                height,
                device,
                group,
                layers,
                self._mirrors,
                True,
            ),
        ]


def _written_by_last_stage(camera: Camera, tables: SceneTables) -> set[str]:
    # With transparent shapes there are two traces, one after the other. The smoothing of edges is best beside the trace
    # of other worlds, and not after that of all.
    if shows_transparent(camera, tables) or smooth_outputs(camera.outputs, camera.antialiasing):
        return set()
    derived = {name for name in camera.outputs if traced_as(name, tables.shape_types) is None}
    # Without meshes and height fields the trace may paint albedo.
    return derived if tables.shape_types & {MESH, HEIGHT_FIELD} else derived - {"albedo"}


def _swapped(images: Mapping[str, wp.array]) -> dict[str, wp.array]:
    """Rename images for a trace by a ray table, whose depth is the distance along the ray."""
    names = {"depth": "distance", "distance": "depth"}
    return {names.get(name, name): image for name, image in images.items()}
