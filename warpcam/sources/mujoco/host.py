"""Classic MuJoCo: worlds whose state lies on the host, copied to the device before each frame."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.scene.layers import Transparency
from warpcam.scene.scene import Scene
from warpcam.scene.source import LIVE_ARRAYS
from warpcam.sources.common.splats import Splats
from warpcam.sources.common.with_splats import with_splats
from warpcam.sources.mujoco import model
from warpcam.sources.mujoco.layers import with_layers
from warpcam.sources.mujoco.mjv_geoms import MjvGeomSlots
from warpcam.sources.mujoco.shape_tables import DTYPES, ModelSource, VisualGeomArrays, names_of
from warpcam.sources.mujoco.visual_geoms import check_kinds, colors_of, with_visual_geoms

ALIGNMENT = 16  # of each array in the block [bytes]


class MujocoSource(ModelSource):
    """An MjModel and one MjData for each world.

    All arrays lie in one block of memory, once on the host and once on the device, so that a frame needs one copy.
    """

    live_on_device = False

    def __init__(
        self,
        mjm: mujoco.MjModel,
        mjds: Sequence[mujoco.MjData],
        groups: model.Groups,
        device: wp.Device,
        draw: Collection[str] = model.DRAWN,
        reflections: bool | None = None,
        transparency: Transparency = None,
        decor: MjvGeomSlots | None = None,
        planes_from_behind: bool = False,
    ):
        self.device = device
        self._mjm, self._mjds, self._decor = mjm, mjds, decor
        parts = model.read_description(mjm, len(mjds), groups)
        kinds = decor.kinds if decor is not None else ()
        self.parts, extras = with_visual_geoms(parts, mjm, groups, check_kinds(draw), kinds)
        self.parts = with_layers(
            self.parts, mjm, extras, reflections, transparency, decor=kinds, planes_from_behind=planes_from_behind
        )
        self._extras = extras
        self._tables = VisualGeomArrays(extras, len(mjds), len(parts.meshes), device) if extras is not None else None
        self._data_names = {**model.DATA_NAMES, **names_of(extras)}
        self._model_names = dict(model.MODEL_NAMES)
        if decor is not None and decor.lights:
            self.parts = replace(self.parts, num_lights=len(decor.lights["light_types"]))
            for names in (self._data_names, self._model_names):
                for name in names.keys() & decor.lights.keys():
                    del names[name]
        shapes = {name: self._shape(name) for name in LIVE_ARRAYS}
        dtypes = {name: LIVE_ARRAYS[name].dtype for name in LIVE_ARRAYS}
        for name in names_of(extras):
            size = wp.types.type_size_in_bytes(DTYPES[name]) // 4  # numbers
            shapes[name] = len(mjds), getattr(mjds[0], self._data_names[name]).size // size
            dtypes[name] = DTYPES[name]
        shapes["headlight"], dtypes["headlight"] = (3,), wp.vec3
        shapes["time"], dtypes["time"] = (len(mjds),), wp.float32
        starts, total = {}, 0
        for name, shape in shapes.items():
            starts[name] = total
            size = int(np.prod(shape)) * wp.empty(1, dtype=dtypes[name], device="cpu").strides[0]
            total += -(-size // ALIGNMENT) * ALIGNMENT
        with wp.ScopedDevice(device):  # pinned memory belongs to the current context, and makes one where there is none
            self._host = wp.zeros(total, dtype=wp.uint8, device="cpu", pinned=device.is_cuda)
        self._block = wp.zeros(total, dtype=wp.uint8, device=device)
        layout = [(name, starts[name], shapes[name], dtypes[name]) for name in shapes]
        self._staged = {name: shared(self._host, shape, dtype, start).numpy() for name, start, shape, dtype in layout}
        self._staged_decor: list[tuple[np.ndarray, np.ndarray]] = []  # where it goes, what does
        for name, array in {**decor.shapes, **decor.lights}.items() if decor is not None else ():
            own = self._staged[name].shape[1] - len(array)
            self._staged[name], more = np.split(self._staged[name], (own,), axis=1)
            self._staged_decor.append((more, array))
        self._live = list(self._pairs())
        self._arrays = {name: shared(self._block, shape, dtype, start) for name, start, shape, dtype in layout}
        self._clock = self._arrays.pop("time")
        self._copied = wp.Event(device) if device.is_cuda else None

    def arrays(self) -> Mapping[str, wp.array]:
        return self._arrays if self._tables is None else self._tables.arrays(self._arrays)

    def user_owned(self, field: str) -> bool:
        return False

    def user_name(self, field: str) -> str:
        return f"mjd.{model.DATA_NAMES[field]}" if field in model.DATA_NAMES else f"mjm.{model.MODEL_NAMES[field]}"

    def global_ambient(self) -> float:
        if self._decor is not None and self._decor.lights:
            return model.GLOBAL_AMBIENT
        return model.global_ambient(self._mjm)

    def clock(self) -> wp.array | None:
        return self._clock

    def refresh(self) -> None:
        """Copy poses and all else that may change to the device, in order with its current stream."""
        if self._copied is not None:
            wp.synchronize_event(self._copied)  # of the frame before: the staging block is free again
        self._stage()
        self._staged["time"][:] = [mjd.time for mjd in self._mjds]
        self._staged["headlight"][:] = model.headlight(self._mjm)
        if self._decor is not None:
            self._stage_decor(self._decor)
        wp.copy(self._block, self._host)
        if self._tables is not None and self._extras is not None:
            colors = colors_of(self._mjm, self._extras)
            if self._decor is not None:
                colors[np.isin(self._extras.rows, self._decor.hidden)] = 0.0
            self._tables.paint(colors)
        if self._copied is not None:
            self.device.stream.record_event(self._copied)

    def _stage(self) -> None:
        """Copy what may change to the host's block."""
        for staged, live in self._live:
            staged[...] = live

    def _pairs(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield each destination with MuJoCo's own array, which stays at its address."""
        yield from self._pairs_of(self._data_names, self._mjds)
        yield from self._pairs_of(self._model_names, (self._mjm,))

    def _pairs_of(self, names: Mapping[str, str], owners: Sequence[Any]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for field, name in names.items():
            for staged, owner in zip(self._staged[field], owners, strict=True):
                yield staged, getattr(owner, name).reshape(staged.shape)

    def _stage_decor(self, decor: MjvGeomSlots) -> None:
        for staged, array in self._staged_decor:
            staged[:] = array
        self._staged["shape_colors"][:, decor.hidden[decor.hidden < self._mjm.ngeom]] = 0.0
        if decor.lights:
            self._staged["headlight"][:] = 0.0

    def forward(self) -> None:
        for mjd in self._mjds:
            self._pose(mjd)

    def _pose(self, mjd: mujoco.MjData) -> None:
        """Compute what is drawn of a world from its joints."""
        mujoco.mj_kinematics(self._mjm, mjd)
        mujoco.mj_comPos(self._mjm, mjd)
        mujoco.mj_camlight(self._mjm, mjd)
        if self._tables is not None:
            mujoco.mj_flex(self._mjm, mjd)
            mujoco.mj_tendon(self._mjm, mjd)

    def _shape(self, name: str) -> tuple[int, ...]:
        more = 0
        if self._decor is not None:
            if name in self._decor.lights:
                return 1, *self._decor.lights[name].shape[:1]
            more = len(self._decor.kinds) if name in self._decor.shapes else 0
        if name in model.DATA_NAMES:
            return len(self._mjds), len(getattr(self._mjds[0], model.DATA_NAMES[name])) + more
        count, *rest = getattr(self._mjm, model.MODEL_NAMES[name]).shape[: 1 + len(LIVE_ARRAYS[name].more)]
        return (1, count + more, *rest)


def load(
    mjm: Any,
    mjd: Any,
    groups: model.Groups,
    device: Any,
    draw: Collection[str] = model.DRAWN,
    reflections: bool | None = None,
    transparency: Transparency = None,
    decor: MjvGeomSlots | None = None,
    planes_from_behind: bool = False,
    splats: Sequence[Splats] = (),
) -> Scene:
    model.check_model(mjm, "mjm")
    several = isinstance(mjd, list | tuple)
    mjds = list(mjd) if several else [mjd]
    if not mjds:
        raise WarpcamError("mjd is an empty list; one MjData, or one for each world, is needed")
    for world, data in enumerate(mjds):
        which = f"mjd[{world}]" if several else "mjd"
        if not isinstance(data, mujoco.MjData):
            raise WarpcamError(f"{which} must be a mujoco.MjData, got {type(data).__name__}")
        if data.geom_xpos.shape[0] != mjm.ngeom or data.xpos.shape[0] != mjm.nbody:
            raise WarpcamError(
                f"{which} was made from another model than mjm: it has {data.geom_xpos.shape[0]} geoms and "
                f"{data.xpos.shape[0]} bodies, mjm has {mjm.ngeom} and {mjm.nbody}"
            )
    resolved = device_rule.resolve(device)
    source = MujocoSource(
        mjm,
        mjds,
        groups=groups,
        device=resolved,
        draw=draw,
        reflections=reflections,
        transparency=transparency,
        decor=decor,
        planes_from_behind=planes_from_behind,
    )
    return Scene(with_splats(source, splats))
