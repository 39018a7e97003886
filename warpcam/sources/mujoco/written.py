"""Worlds of a MuJoCo model whose state a program writes, array by array, before each frame."""

import math
from collections.abc import Collection, Mapping
from typing import Any

import mujoco
import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.scene.layers import Transparency
from warpcam.scene.scene import Scene
from warpcam.scene.source import LIVE_ARRAYS, SceneDescription
from warpcam.sources.mujoco import model
from warpcam.sources.mujoco.layers import with_layers
from warpcam.sources.mujoco.shape_tables import DTYPES, ModelSource, VisualGeomArrays, names_of
from warpcam.sources.mujoco.visual_geoms import VisualGeoms, check_kinds, with_visual_geoms

ELEMENTS: Mapping[Any, tuple[int, ...]] = {wp.vec2: (2,), wp.vec3: (3,), wp.vec4: (4,), wp.mat33: (3, 3)}


class WrittenSource(ModelSource):
    """Arrays of its own, on one device, that begin with the model's own state.

    Attributes:
        written: The arrays by MuJoCo's names, those of data and those of the model; (world, row), or (1, row) for what
            all worlds share.
    """

    live_on_device = True

    def __init__(
        self,
        mjm: mujoco.MjModel,
        num_worlds: int,
        device: wp.Device,
        groups: model.Groups,
        draw: Collection[str] = model.DRAWN,
        varied: Collection[str] = (),
        reflections: bool | None = None,
        transparency: Transparency = None,
        planes_from_behind: bool = False,
    ):
        self.device = device
        parts = model.read_description(mjm, num_worlds, groups)
        self.parts, extras = with_visual_geoms(parts, mjm, groups, check_kinds(draw))
        self.parts = with_layers(
            self.parts, mjm, extras, reflections, transparency, planes_from_behind=planes_from_behind
        )
        self._tables = VisualGeomArrays(extras, num_worlds, len(parts.meshes), device) if extras is not None else None
        self._ambient = model.global_ambient(mjm)
        mjd = mujoco.MjData(mjm)
        mujoco.mj_forward(mjm, mjd)
        self._live: dict[str, wp.array] = {}
        self.written: dict[str, wp.array] = {}
        for field, name in data_names(extras).items():
            self._add(field, name, getattr(mjd, name), num_worlds)
        for field, name in model.MODEL_NAMES.items():
            self._add(field, name, getattr(mjm, name), num_worlds if name in varied else 1)
        self._live["headlight"] = wp.array(model.headlight(mjm), dtype=wp.vec3, device=device)

    def arrays(self) -> Mapping[str, wp.array]:
        return self._live if self._tables is None else self._tables.arrays(self._live)

    def user_owned(self, field: str) -> bool:
        return False

    def user_name(self, field: str) -> str:
        return model.DATA_NAMES.get(field) or model.MODEL_NAMES.get(field, field)

    def global_ambient(self) -> float:
        return self._ambient

    def clock(self) -> wp.array | None:
        return None

    def refresh(self) -> None:
        pass

    def forward(self) -> None:
        raise WarpcamError("forward: this scene has no simulator; give poses that are up to date")

    def _add(self, field: str, name: str, values: Any, rows: int) -> None:
        dtype, host = dtype_of(field), np.asarray(values)
        shape, element = shape_of(field, host), element_shape(dtype)
        array = wp.empty((rows, *shape), dtype=dtype, device=self.device)
        if host.size:
            array.assign(np.broadcast_to(host.reshape(1, *shape, *element), (rows, *shape, *element)))
        self._live[field] = self.written[name] = array


def dtype_of(field: str) -> Any:
    """Warp's dtype of an element of a live array."""
    return DTYPES[field] if field in DTYPES else LIVE_ARRAYS[field].dtype


def element_shape(dtype: Any) -> tuple[int, ...]:
    """Shape of the numbers in an element: (3,) of a vec3, () of a float."""
    return ELEMENTS.get(dtype, ())


def shape_of(field: str, values: np.ndarray) -> tuple[int, ...]:
    """Shape in elements of one world's array."""
    numbers = math.prod(element_shape(dtype_of(field)))
    return values.shape if field in model.MODEL_NAMES and numbers == 1 else (values.size // numbers,)


def data_names(extras: VisualGeoms | None) -> dict[str, str]:
    """MuJoCo's arrays of a state that a frame reads, by our names."""
    return {**model.DATA_NAMES, **names_of(extras)}


def load(mjm: mujoco.MjModel, num_worlds: int, device: wp.Device, **options: Any) -> tuple[Scene, dict[str, wp.array]]:
    """Return a scene, and the arrays that are to be written, by MuJoCo's names."""
    source = WrittenSource(mjm, num_worlds, device, **options)
    return Scene(source), source.written


def describe(
    mjm: mujoco.MjModel, options: Mapping[str, Any]
) -> tuple[SceneDescription, dict[str, tuple[Any, tuple[int, ...]]]]:
    """The scene's parts, and Warp's dtype and the shape of one world's elements of each array, by MuJoCo's names."""
    parts = model.read_description(mjm, 1, options["groups"])
    _, extras = with_visual_geoms(parts, mjm, options["groups"], check_kinds(options["draw"]))
    mjd, arrays = mujoco.MjData(mjm), {}
    for field, name in {**data_names(extras), **model.MODEL_NAMES}.items():
        values = np.asarray(getattr(mjm if field in model.MODEL_NAMES else mjd, name))
        arrays[name] = dtype_of(field), shape_of(field, values)
    return parts, arrays
