"""Geoms of MuJoCo's abstract scene beside its model: their number changes from frame to frame.

A scene has room for so many of each kind; what is not used is not seen. Kinds tell apart what a scene must know when it
is made. They are further columns of the table, after those of ``mujoco_extras``, and each has a material of its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np

from warpcam.kernels.passes.mirrors import OPAQUE_ABOVE
from warpcam.kernels.types import HEIGHT_FIELD, MESH, PLANE

LEAST = 8  # places of a kind, and of lights
OF_ALL = ("hidden", "renamed", "lights")  # what of Decor has no rows
# Of a light: its shape and dtype.
LIGHTS: Mapping[str, tuple[tuple[int, ...], type]] = {
    "light_types": ((), np.int32),
    "light_active": ((), bool),
    "light_casts_shadow": ((), bool),
    "light_positions": ((3,), np.float32),
    "light_directions": ((3,), np.float32),
    "light_attenuation": ((3,), np.float32),
    "light_cutoff": ((), np.float32),
    "light_exponent": ((), np.float32),
    "light_ambient": ((3,), np.float32),
    "light_diffuse": ((3,), np.float32),
    "light_specular": ((3,), np.float32),
}

Pair = tuple[int, int]  # id and mjtObj


class MjvGeomClass(NamedTuple):
    """Properties that shapes of a kind share.

    Attributes:
        type: One of the shape types.
        transparent: Whether it is seen through, now or from behind.
        casts: Whether it casts shadows.
        reflectance: Of a plane or box that reflects, else 0.
    """

    type: int
    transparent: bool
    casts: bool
    reflectance: float


@dataclass(frozen=True, eq=False)
class MjvGeoms:
    """Shapes of one frame, each row one.

    Attributes:
        types: (shape,) int, of the shape types.
        positions: (shape, 3) world frame [m].
        rotations: (shape, 3, 3) columns are its axes.
        sizes: (shape, 3) as the scene's tables have them [m].
        assets: (shape,) index of the mesh or height field, or -1.
        colors: (shape, 4) RGBA.
        finishes: (shape, 3) emission, specular, shininess.
        reflectances: (shape,).
        textures: (shape,) index or -1.
        repeats: (shape, 2) and uniform, (shape,) bool: how often textures repeat.
        uniform: See ``repeats``.
        casts: (shape,) bool, whether it casts shadows.
        segments: (shape,) id in segmentation images, -1 for what these and depth leave out.
        objects: (shape, 2) what images of objects show there: id and ``mjtObj``.
        hidden: Geoms and sites of the model that stand there no more, or are among the shapes; sites are counted after
            the geoms.
        renamed: What such images show instead of other objects, id and ``mjtObj``: pairs of pairs.
        lights: (light,) with the fields of an ``MjvLight``: what lights the scene instead of all of the model's, its
            headlight among them; None: nothing else does.
    """

    types: np.ndarray
    positions: np.ndarray
    rotations: np.ndarray
    sizes: np.ndarray
    assets: np.ndarray
    colors: np.ndarray
    finishes: np.ndarray
    reflectances: np.ndarray
    textures: np.ndarray
    repeats: np.ndarray
    uniform: np.ndarray
    casts: np.ndarray
    segments: np.ndarray
    objects: np.ndarray
    hidden: np.ndarray
    renamed: Sequence[tuple[Pair, Pair]]
    lights: np.ndarray | None

    def solid(self) -> "MjvGeoms":
        """Return the geoms for images of depth and of objects, in which all are solid."""
        some = self.some(self.segments >= 0)
        return replace(some, colors=np.concatenate((some.colors[:, :3], np.ones((len(some.types), 1))), axis=1))

    def has_form(self) -> np.ndarray:
        """Return (shape,) bool, False where a rotation or a size of zeros leaves nothing to see."""
        sized = np.isin(self.types, (PLANE, MESH, HEIGHT_FIELD)) | ~(self.sizes <= 0.0).all(axis=1)
        return sized & (self.rotations != 0.0).any(axis=(1, 2))

    def opaque(self) -> "MjvGeoms":
        """Return the opaque geoms."""
        return self.some(self.colors[:, 3] >= OPAQUE_ABOVE)

    def facing(self, eye: np.ndarray) -> "MjvGeoms":
        """Return the geoms with all planes turned to face a place (3,) [m]; these very geoms if all do."""
        away = ((eye - self.positions) * self.rotations[:, :, 2]).sum(axis=1) < 0.0
        behind = (self.types == PLANE) & away
        if not behind.any():
            return self
        turns = np.where(behind[:, None], (1.0, -1.0, -1.0), 1.0)
        return replace(self, rotations=self.rotations * turns[:, None, :])

    def some(self, chosen: np.ndarray) -> "MjvGeoms":
        """Some of the shapes: (shape,) bool, or their numbers."""
        rows = {field.name: getattr(self, field.name) for field in fields(self)}
        return MjvGeoms(**{name: rows[name] if name in OF_ALL else rows[name][chosen] for name in rows})

    @property
    def transparent(self) -> bool:
        """True if a geom is transparent."""
        return bool((self.colors[:, 3] < OPAQUE_ABOVE).any())

    @cached_property
    def kinds(self) -> Mapping[MjvGeomClass, np.ndarray]:
        """The numbers of the shapes of each kind."""
        planes = self.types == PLANE
        transparent = (self.colors[:, 3] < OPAQUE_ABOVE) | planes
        rows = zip(
            self.types.tolist(), transparent.tolist(), self.casts.tolist(), self.reflectances.tolist(), strict=True
        )
        kinds: dict[MjvGeomClass, list[int]] = {}
        for number, row in enumerate(rows):
            kinds.setdefault(MjvGeomClass(*row), []).append(number)
        return {kind: np.array(numbers) for kind, numbers in kinds.items()}


@dataclass(frozen=True)
class MjvCapacity:
    """Capacity of a scene.

    Attributes:
        shapes: Of each kind.
        lights: Of these in place of the model's; None: the model's own light the scene.
    """

    shapes: tuple[tuple[MjvGeomClass, int], ...] = ()
    lights: int | None = None

    def holds(self, decor: MjvGeoms) -> bool:
        """Return whether these geoms fit, and the lights are the same."""
        shapes = dict(self.shapes)
        enough = all(shapes.get(kind, 0) >= len(numbers) for kind, numbers in decor.kinds.items())
        if self.lights is None or decor.lights is None:
            return enough and (decor.lights is None) == (self.lights is None)
        return enough and self.lights >= len(decor.lights)

    def grown(self, decor: MjvGeoms) -> "MjvCapacity":
        """Room for these, and no less than here: twice as much where that does not suffice."""
        shapes = dict(self.shapes)
        for kind, numbers in decor.kinds.items():
            shapes[kind] = _enough(shapes.get(kind, LEAST), len(numbers))
        lights = None if decor.lights is None else _enough(self.lights or LEAST, len(decor.lights))
        return MjvCapacity(tuple(shapes.items()), lights)


class MjvGeomSlots:
    """The room of a scene, and what stands there now.

    Args:
        mjm: The host's model.
        room: How many places there are.

    Attributes:
        room: See above.
        kinds: Of each place.
        shapes: What arrays of the scene hold behind the model's own, by the names of fields.
        lights: What they hold instead of the model's own.
        hidden: Geoms and sites of the model that are not seen; sites are counted after the geoms.
        objects: (place, 2) int32.
    """

    def __init__(self, mjm: mujoco.MjModel, room: MjvCapacity):
        self.room = room
        self.kinds = [kind for kind, count in room.shapes for _ in range(count)]
        counts = [count for _, count in room.shapes]
        self._starts = dict(zip((kind for kind, _ in room.shapes), np.cumsum([0, *counts]).tolist(), strict=False))
        count, rows = len(self.kinds), np.arange(len(self.kinds), dtype=np.int32)
        self.shapes: dict[str, np.ndarray] = {
            "shape_positions": np.zeros((count, 3), np.float32),
            "shape_rotations": np.tile(np.eye(3, dtype=np.float32), (count, 1, 1)),
            "shape_sizes": np.zeros((count, 3), np.float32),
            "shape_assets": np.full(count, -1, np.int32),
            "shape_materials": mjm.nmat + rows,
            "shape_colors": np.zeros((count, 4), np.float32),
            "material_color": np.zeros((count, 4), np.float32),
            "material_emission": np.zeros(count, np.float32),
            "material_specular": np.zeros(count, np.float32),
            "material_shininess": np.zeros(count, np.float32),
            "material_texture": np.full((count, mjm.mat_texid.shape[1]), -1, np.int32),
            "material_texture_repeat": np.ones((count, 2), np.float32),
            "material_texture_uniform": np.zeros(count, bool),
        }
        self.lights: dict[str, np.ndarray] = {}
        if room.lights is not None:
            self.lights = {name: np.zeros((room.lights, *shape), dtype) for name, (shape, dtype) in LIGHTS.items()}
        self.objects = np.full((count, 2), -1, np.int32)
        self.hidden = np.zeros(0, np.int64)

    def fill(self, decor: MjvGeoms) -> None:
        """Put shapes and lights into the places; all others are empty then."""
        shapes = self.shapes
        shapes["shape_colors"][:] = 0.0
        for kind, numbers in decor.kinds.items():
            first = self._starts[kind]
            there = slice(first, first + len(numbers))
            shapes["shape_positions"][there] = decor.positions[numbers]
            shapes["shape_rotations"][there] = decor.rotations[numbers]
            shapes["shape_sizes"][there] = decor.sizes[numbers]
            shapes["shape_assets"][there] = decor.assets[numbers]
            for name in ("shape_colors", "material_color"):  # the same, whether or not a colour of its own counts
                shapes[name][there] = decor.colors[numbers]
            for column, name in enumerate(("emission", "specular", "shininess")):
                shapes[f"material_{name}"][there] = decor.finishes[numbers, column]
            shapes["material_texture"][there, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = decor.textures[numbers]
            shapes["material_texture_repeat"][there] = decor.repeats[numbers]
            shapes["material_texture_uniform"][there] = decor.uniform[numbers]
            self.objects[there] = decor.objects[numbers]
        self.hidden = decor.hidden
        if decor.lights is not None:
            self._light(decor.lights)

    def _light(self, lights: np.ndarray) -> None:
        here, count = self.lights, len(lights)
        here["light_active"][:] = np.arange(len(here["light_active"])) < count
        here["light_types"][:count] = lights["type"]
        here["light_casts_shadow"][:count] = lights["castshadow"] != 0
        here["light_positions"][:count] = lights["pos"]
        lengths = np.linalg.norm(lights["dir"], axis=1, keepdims=True)
        here["light_directions"][:count] = lights["dir"] / np.maximum(lengths, 1e-12)
        for name in ("attenuation", "cutoff", "exponent", "ambient", "diffuse", "specular"):
            here[f"light_{name}"][:count] = lights[name]


def _enough(room: int, count: int) -> int:
    while room < count:
        room *= 2
    return room
