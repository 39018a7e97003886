"""The renderer that is called with a state inside of a program of JAX."""

import copy
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import jax
import mujoco
import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError
from warpcam.jax import poses, primitive, state
from warpcam.jax.calls import Calls
from warpcam.jax.drawing import MODEL_FIELDS, Input, Recipe
from warpcam.kernels.outputs import OUTPUTS
from warpcam.render.memory import cameras_by_key
from warpcam.scene.layers import check_planes
from warpcam.scene.source import SceneDescription
from warpcam.scene.validation import find_body, find_index
from warpcam.sources.mujoco import model as mujoco_model
from warpcam.sources.mujoco import written

PAST = ("flow", "flow_valid")  # outputs of more than one state
# Fields of a model that poses of other things than bodies follow from.
PLACES = frozenset(
    f"{kind}_{name}"
    for kind, names in {
        "geom": ("pos", "quat"),
        "site": ("pos", "quat"),
        "cam": ("pos", "quat", "mat0", "pos0", "poscom0"),
        "light": ("pos", "dir", "dir0", "pos0", "poscom0"),
    }.items()
    for name in names
)
CAMERA_ARRAYS = {"position": 3, "rotation": 4}

Images = dict[str | int, dict[str, jax.Array]]


class Renderer:
    """Renders the cameras of a MuJoCo model for a state that is given as JAX arrays, inside ``jax.jit`` or outside.

    ``images = render(data)`` draws one world, ``jax.vmap(render)(data)`` all worlds of a batch at once. What is drawn
    follows from the arguments alone.

    The first program with another number of worlds, or other inputs, allocates images and scratch memory and compiles
    kernels, when XLA compiles it. A frame copies its inputs into the renderer's arrays, and the images into the buffers
    that XLA gives; both copies stay on the device.

    Args:
        model: The host's ``mujoco.MjModel``, as it is now.
        cameras: As ``warpcam.Renderer`` takes them. Outputs ``flow`` and ``flow_valid`` are refused.
        worlds: How many worlds a call has; another number raises. None: any, each with memory of its own.
        device: Where to allocate when a program is compiled: a name, a Warp or torch device, a CUDA ordinal. None is
            JAX's default device. A program that runs on another device allocates there at its first run.
        graph: Replay each frame as a CUDA graph, as ``warpcam.Renderer`` does.
        groups: As ``from_mujoco_warp`` has them, and so are all that follow.
        draw: Kinds of objects that are drawn.
        reflections: Which planes and boxes may reflect.
        transparency: Which geoms may be transparent.
        planes_from_behind: Planes are seen from behind, too.

    Raises:
        WarpcamError: A camera does not fit the model.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        cameras: Sequence[Camera],
        *,
        worlds: int | None = None,
        device: Any = None,
        graph: bool = True,
        groups: Collection[int] | Mapping[str, Collection[int]] = (0, 1, 2),
        draw: Collection[str] = mujoco_model.DRAWN,
        reflections: bool | None = None,
        transparency: bool | None = None,
        planes_from_behind: bool = False,
    ):
        mujoco_model.check_model(model, "model")
        if worlds is not None and (not isinstance(worlds, int | np.integer) or isinstance(worlds, bool) or worlds < 1):
            raise WarpcamError(f"warpcam.jax.Renderer: worlds must be a whole number from 1 on or None, got {worlds!r}")
        self._cameras = cameras_by_key(cameras)
        for camera in cameras:
            for name in PAST:
                if name in camera.outputs:
                    raise WarpcamError(
                        f"{camera.where}: outputs has {name!r}, which needs the frame before; images of "
                        "warpcam.jax.Renderer follow from one state"
                    )
        options = {
            "groups": groups,
            "draw": draw,
            "reflections": reflections,
            "transparency": check_planes(transparency, planes_from_behind),
            "planes_from_behind": bool(planes_from_behind),
        }
        self._mjm = copy.copy(model)
        recipe = Recipe(self._mjm, tuple(cameras), options, graph)
        self._calls = Calls(recipe, None if worlds is None else int(worlds), self._resolved(device))
        parts, arrays = written.describe(self._mjm, options)
        self._check_places(parts)
        self._state = {name: Input(name, *arrays[name]) for name in arrays if name not in MODEL_FIELDS}
        self._fields = {name: Input(name, *arrays[name]) for name in arrays if name in MODEL_FIELDS}
        self._read = self._needed()

    @staticmethod
    def _resolved(device: Any) -> wp.Device | None:
        return None if device is None else device_rule.resolve(device)

    def __call__(
        self, data: Any, model: Any = None, *, cameras: Mapping[str | int, Mapping[str, Any]] | None = None
    ) -> Images:
        """Render a state.

        Args:
            data: An ``mjx.Data`` of either implementation, or a mapping of arrays by MuJoCo's names: ``geom_xpos``,
                ``geom_xmat``, ``cam_xpos``, ``cam_xmat``, ``light_xpos``, ``light_xdir``, ``xpos``, ``xmat`` and so on,
                of one world or with leading dimensions. Poses of geoms, sites, cameras and lights that are not given
                are computed from ``xpos`` and ``xquat``, or ``xmat``. Poses are drawn as they are: after ``mjx.step``
                they are those before it.
            model: An ``mjx.Model``, or a mapping of its fields: what differs from the host's model, as domain
                randomisation has it: ``geom_rgba``, ``geom_size``, ``geom_matid``, ``mat_*``, ``light_*``,
                ``cam_fovy``. Places in a body's frame, as ``cam_pos`` and ``light_pos``, count where poses are computed
                here.
            cameras: ``position`` (..., 3) [m] and ``rotation`` (..., 4) w x y z of cameras of your own, by the camera's
                name.

        Returns:
            Images by camera and output, (..., height, width, channels), with the leading dimensions of the arguments.

        Raises:
            WarpcamError: An array is missing, or has another shape. The number of worlds is another one than
                ``worlds``. Images are differentiated: they have no gradients.
        """
        given = self._given(data, model, cameras)
        shapes = {each: state.leading(array, each.dims, each.name) for each, array in given.items()}
        try:
            worlds = np.broadcast_shapes(*shapes.values())
        except ValueError:
            told = ", ".join(f"{each.name} {shape}" for each, shape in shapes.items() if shape)
            raise WarpcamError(f"render: the arrays have different numbers of worlds: {told}") from None
        count = math.prod(worlds)
        if count == 0:
            raise WarpcamError(f"render: there must be at least one world, got leading dimensions {worlds}")
        arrays = [state.arranged(array, each, worlds, shapes[each], count) for each, array in given.items()]
        images: Images = {key: {} for key in self._cameras}
        drawn = primitive.render(arrays, self._calls, tuple(given))
        for (camera, name, shape), image in zip(self._calls.recipe.outputs, drawn, strict=True):
            images[camera][name] = image.reshape(*worlds, *shape)
        return images

    def _given(self, data: Any, model: Any, cameras: Any) -> dict[Input, Any]:
        """The inputs of a call and their numbers."""
        fields = self._changed(model)
        known = {*self._state, *state.BODIES}
        found = state.read(data, "data", known, known)
        for name, shape in state.BODIES.items():
            if name in found:
                found[name] = self._flat(found[name], self._state[name]) if name in self._state else found[name]
                state.leading(found[name], (self._mjm.nbody, *shape), name)
        given: dict[Input, Any] = {}
        for name in self._read:
            array = poses.pose_of(name, self._mjm, found, fields)
            if array is None:
                raise WarpcamError(
                    f"render: data has no {name}, which is drawn with, and no xpos and xquat that it follows from"
                )
            each = self._state[name]
            given[each] = state.numbers(self._flat(array, each), each.scalar, name)
        for name, array in fields.items():
            if name in self._fields:
                each = self._fields[name]
                given[each] = state.numbers(array, each.scalar, name)
        given.update(self._moved(cameras))
        return given

    def _changed(self, model: Any) -> dict[str, Any]:
        """Fields of a model that are not the host's."""
        if model is None:
            return {}
        known = {*self._fields, *PLACES}
        found = state.read(model, "model", known, known)
        return {name: array for name, array in found.items() if state.differs(array, getattr(self._mjm, name))}

    def _moved(self, cameras: Any) -> dict[Input, Any]:
        """Inputs that move cameras of one's own."""
        moved: dict[Input, Any] = {}
        for key, arrays in (cameras or {}).items():
            if key not in self._cameras or not self._cameras[key].is_own:
                own = ", ".join(repr(name) for name, camera in self._cameras.items() if camera.is_own) or "none"
                raise WarpcamError(f"render: cameras has {key!r}; cameras of your own are {own}")
            for name, array in arrays.items():
                if name not in CAMERA_ARRAYS:
                    raise WarpcamError(f"render: cameras[{key!r}] has {name!r}; position and rotation may be given")
                each = Input(name, wp.float32, (CAMERA_ARRAYS[name],), key)
                moved[each] = state.numbers(array, each.scalar, name)
        return moved

    def _check_places(self, parts: SceneDescription) -> None:
        """Raise for cameras and bodies that the model has not."""
        names = tuple(camera.name for camera in parts.cameras)
        for camera in self._cameras.values():
            if not camera.is_own:
                find_index(camera.name, names, "Renderer: cameras", "camera")
            elif camera.parent is not None:
                find_body(parts, camera.parent, f"{camera.where}: parent")

    def _flat(self, array: Any, each: Input) -> Any:
        """Rows that hold several elements, as those of ``wrap_xpos``, one by one; 9 numbers as a matrix."""
        shape, own = np.shape(array), getattr(self._example, each.name).shape
        rest = len(shape) - len(own)
        if rest >= 0 and shape[rest:] == own and own != each.dims:
            return array.reshape(*shape[:rest], *each.dims)
        return array

    def _needed(self) -> list[str]:
        """Arrays of a state without which no frame can be drawn."""
        self._example = mujoco.MjData(self._mjm)
        cameras, options = self._cameras.values(), self._calls.recipe.options
        lit = any(OUTPUTS[name].lit for camera in cameras for name in camera.outputs)
        rides = any(camera.parent is not None for camera in cameras) or (self._mjm.nskin and "skins" in options["draw"])
        unused = set() if lit else {"light_xpos", "light_xdir"}
        unused |= set() if rides else {"xpos", "xmat"}
        unused |= {"cam_xpos", "cam_xmat"} if all(camera.is_own for camera in cameras) else set()
        return [name for name, each in self._state.items() if name not in unused and 0 not in each.dims]
