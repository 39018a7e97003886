"""Arrays of one camera that its passes read and write."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.kernels.layers import LayerTables
from warpcam.kernels.plan.buffers import BUFFER
from warpcam.kernels.plan.frame import PlannedPass
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.runtime.flatten import flatten
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables


@dataclass(frozen=True)
class CameraFrame:
    """One camera's arrays for a group of worlds.

    Attributes:
        tables: The scene.
        width: Of the images [pixels].
        height: Of the images [pixels].
        lens: One of ``launches.LENSES``. With a table of rays, depth is the distance along the ray, and "distance" the
            planar depth.
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        faults: uint8, (world,); set to 1 where a pose or size is not finite or 0.
        images: Arrays (world, height, width, channels) of the outputs.
        buffers: Arrays (world, height, width, 1) of the plan's buffers; only the rows of the group are there.
        parts: Parts of a pixel, across and down, in the finer images that ``images`` has, too.
        mirrors: Mirror, (world,); empty where no image shows mirrors.
        mirrored: View, (world,), likewise: the views from behind the mirrors.
        flow_history: FlowHistory, where flow is wanted, else None.
        lists: vec4, (world, row): the shapes listed for these views, by view_shape_lists.py or shapes_in_view.py, if
            they are.
        group: Which worlds are drawn.
        device: Where all of these lie.
        paths: PathArrays of passes/paths.py, where lit images are traced by paths of light.
        occlusion: OcclusionArrays of passes/occlusion.py, where rays tell how much light reaches a pixel.
    """

    tables: SceneTables
    width: int
    height: int
    lens: str
    views: wp.array
    mask: wp.array
    faults: wp.array
    images: Mapping[str, wp.array]
    buffers: Mapping[str, wp.array]
    mirrors: wp.array
    mirrored: wp.array
    flow_history: Any
    lists: wp.array | None
    group: Group
    device: wp.Device
    parts: tuple[int, int] = (1, 1)
    paths: Any = None
    occlusion: Any = None

    @property
    def layers(self) -> LayerTables:
        """Tables of what one layer cannot show, for passes that are planned where there are some."""
        if self.tables.layers is None:
            raise ValueError("layers: this scene has none")
        return self.tables.layers

    def find(self, planned: PlannedPass[Any], role: str) -> wp.array | None:
        """The array that a pass knows by that name, of one dimension; None if it has none."""
        name = planned.name_of(role)
        if name is None:
            return None
        if not name.startswith(BUFFER):
            return flatten(self.images[name])
        buffer = self.buffers[name]
        if name.startswith(f"{BUFFER}lit "):
            image = self.images[name.removeprefix(f"{BUFFER}lit ")]
            buffer = wp.array(ptr=buffer.ptr, shape=image.shape, dtype=image.dtype, device=self.device)
        return flatten(buffer)

    def get(self, planned: PlannedPass[Any], role: str) -> wp.array:
        """The array that a pass must have."""
        found = self.find(planned, role)
        if found is None:
            raise ValueError(f"{planned.name}: no array is planned for {role!r}, there are {dict(planned.arrays)}")
        return found

    def fill(self, planned: PlannedPass[Any], struct: Any, roles: Iterable[str]) -> Any:
        """Set those fields of a struct whose array the pass has, and return the struct."""
        for role in roles:
            if (array := self.find(planned, role)) is not None:
                setattr(struct, role, array)
        return struct

    def visible(self, planned: PlannedPass[Any], struct_of: Callable[[Any, Any], Any]) -> tuple[Any, Any]:
        """A struct with the ``visible_fields`` of trace_target.py as the pass has them: its type, and the struct.

        Args:
            planned: The pass, with "depth" and "shape".
            struct_of: Gives the type for the dtypes of shape ids and faces.
        """
        shape, face = self.get(planned, "shape"), self.find(planned, "face")
        struct_type = struct_of(shape.dtype, dtype_of(face))
        struct = struct_type()
        struct.mask, struct.width, struct.height = self.mask, self.width, self.height
        return struct_type, self.fill(planned, struct, ("depth", "shape", "face"))

    def launch(
        self, planned: PlannedPass[Any], kernel: wp.Kernel, arguments: Sequence[Any], block_dim: int = THREADS
    ) -> Stage:
        """Bind a pass's kernel to its arguments, with the planned threads for each world of the group."""
        return bind_launch(
            kernel,
            len(self.group.worlds) * planned.threads,
            arguments,
            self.device,
            start=self.group.worlds.start * planned.threads,
            block_dim=block_dim,
            key=planned.key,
        )


def empty(dtype: Any, device: wp.Device) -> wp.array:
    """An array of nothing, for what was not asked for."""
    return wp.empty(0, dtype=dtype, device=device)


def dtype_of(array: wp.array | None, otherwise: Any = wp.int32) -> Any:
    """The type of an array's numbers, or another if there is no array."""
    return otherwise if array is None else array.dtype
