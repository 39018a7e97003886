"""Newton: worlds whose state already lies in Warp arrays, one list over all worlds."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import newton
import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core.arrays import per_world
from warpcam.core.errors import WarpcamError
from warpcam.kernels import types
from warpcam.kernels.flags import SceneFlag
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.update.refit import DeformingTree, kernels_of
from warpcam.kernels.update.skinning import offset_vertices
from warpcam.scene.layers import transparent_layers
from warpcam.scene.light import Light, light_arrays
from warpcam.scene.scene import Scene
from warpcam.scene.source import LIVE_ARRAYS, PBR_LIVE_ARRAYS, SceneDescription
from warpcam.sources.newton.collada_units import tell_huge_meshes
from warpcam.sources.newton.columns import Columns
from warpcam.sources.newton.deformables import read_deformables
from warpcam.sources.newton.kernels.gather import WHITE, FlatShapes, WorldShapes, bind_gather, write_worlds
from warpcam.sources.newton.labels import read_labels
from warpcam.sources.newton.model import PLAIN, Layout, read_layout
from warpcam.sources.newton.options import NewtonOptions
from warpcam.sources.newton.triangle_colors import TriangleColors
from warpcam.sources.newton.visual_meshes import AttachedVertices, VisualMesh, read_visuals, with_visuals
from warpcam.textures.pack import TextureImage

EVERYTHING = NewtonOptions()
MAX_BOUND = 8  # states whose stages are kept
# The arrays of a model that are read each frame: field of FlatShapes, dtype.
LIVE: Mapping[str, tuple[str, Any]] = {
    "shape_transform": ("transforms", wp.transform),
    "shape_body": ("bodies", wp.int32),
    "shape_scale": ("scales", wp.vec3),
    "shape_color": ("colors", wp.vec3),
    "shape_opacity": ("opacities", wp.float32),
    "shape_flags": ("flags", wp.int32),
}
LIVE_VARIANTS: Mapping[str, tuple[str, Any]] = {
    "shape_type": ("types", wp.int32),
    "shape_source_ptr": ("sources", wp.uint64),
}
LIVE_SOFT: Mapping[str, tuple[str, Any]] = {
    "tri_color": ("face_colors", wp.vec3),
    "tri_opacity": ("face_opacities", wp.float32),
    "particle_radius": ("radii", wp.float32),
    "particle_flags": ("point_flags", wp.int32),
}
DOWN = (-0.57735026, 0.57735026, -0.57735026)  # where Newton's own light shines where z is up
AMBIENT = (0.2, 0.2, 0.2)
REFLECTANCE = 0.04  # of what is no metal, where light falls straight


class NewtonSource:
    """A Newton model, its tables by world, and the state that is looked at."""

    live_on_device = True
    color_blend = None

    def __init__(
        self,
        model: newton.Model,
        state: newton.State,
        lights: Sequence[Light] | None,
        ambient: Any,
        semantics: Mapping[str, int] | None,
        transparency: bool | None = None,
        textures: Sequence[Any] = (),
        choice: NewtonOptions = EVERYTHING,
    ):
        self.device: wp.Device = model.device
        self._model = model
        self._check_state(state)
        layout = read_layout(model, choice)
        visuals = read_visuals(model, choice)
        soft = with_visuals(read_deformables(model, visuals.particles, choice), visuals)
        more = [_image(pixels, index) for index, pixels in enumerate(textures)]
        first_finish, first_texture = len(layout.finishes), len(layout.textures)
        images = [*layout.textures, *visuals.textures, *more]
        self.tints = TriangleColors(soft.parts, len(images), first_finish + len(visuals.textures), self.device)
        of_visuals, of_more = (
            [(*PLAIN[:2], start + index) for index in range(len(group))]
            for start, group in ((first_texture, visuals.textures), (len(images) - len(more), more))
        )
        layout = replace(
            layout,
            textures=[*images, *self.tints.images],
            finishes=[*layout.finishes, *of_visuals, *([PLAIN] * len(self.tints.parts)), *of_more],
        )
        num_worlds = model.world_count
        if lights is None:
            lights = (default_light(model),)
        tables = Columns(layout, soft, first_finish, self.tints)
        instances, marks = read_labels(model, tables.ids, tables.bodies, semantics)
        if more:  # each world may have its own
            tables.materials = np.array(np.broadcast_to(tables.materials, (num_worlds, len(tables.kinds))))
        self._arrays = _tables(layout, tables, num_worlds, self.device)
        self.tints.choose(self._arrays["material_texture"])
        self._arrays.update(light_arrays(lights, num_worlds, self.device))
        headlight = np.zeros((3, 3), np.float32)
        headlight[0] = per_world(ambient, "ambient", 1, (3,))[0]
        if headlight[0].min() < 0.0:
            raise WarpcamError(f"ambient must not be negative, got {ambient!r}")
        self._arrays["headlight"] = wp.array(headlight, dtype=wp.vec3, device=self.device)
        drawn = np.flatnonzero(tables.kinds != types.SPLATS).tolist()
        self.parts = SceneDescription(
            num_worlds=num_worlds,
            shape_types=tables.kinds,
            shape_bodies=np.full(len(tables.kinds), -1, np.int32),
            drawn=drawn,
            bodies=layout.body_names,
            cameras=(),
            num_materials=len(layout.finishes),
            num_lights=len(lights),
            meshes=[*layout.meshes, *soft.meshes()],
            height_fields=layout.height_fields,
            textures=layout.textures,
            shape_instances=instances,
            shape_semantics=marks,
            shape_ids=tables.ids,
            body_ids=tables.bodies,
            body_labels=model.body_label,
            body_places=layout.body_places,
            scaled=True,
            flags=_flags(choice, layout),
            physical=True,
            backs_shade=True,  # as in Newton's own camera, whichever faces that leaves out
            clouds=layout.clouds,
            splat_limits=wp.zeros(1, dtype=wp.vec2, device=self.device) if choice.solid and layout.clouds else None,
            lend_textures=self.tints.lend,
            layers=transparent_layers(tables.kinds, drawn, _opacity(model, tables), transparency),
        )
        self._out = WorldShapes()
        self._out.ids = wp.array(layout.ids, dtype=wp.int32, ndim=2, device=self.device)
        self._live = LIVE if layout.variants is None else {**LIVE, **LIVE_VARIANTS}
        if layout.variants is not None:
            wanted, pointers = layout.variants
            self._out.wanted = wp.array(wanted, dtype=wp.int32, ndim=2, device=self.device)
            self._out.pointers = wp.array(pointers, dtype=wp.uint64, ndim=2, device=self.device)
        self._out.faces = wp.array(tables.faces, dtype=wp.int32, ndim=2, device=self.device)
        self._out.particles = wp.array(soft.particles, dtype=wp.int32, ndim=2, device=self.device)
        self._out.types = wp.array(tables.kinds, dtype=wp.int32, device=self.device)
        self._out.bodies = wp.array(layout.bodies, dtype=wp.int32, ndim=2, device=self.device)
        for ours, theirs in (
            ("positions", "shape_positions"),
            ("rotations", "shape_rotations"),
            ("sizes", "shape_sizes"),
            ("colors", "shape_colors"),
            ("body_positions", "body_positions"),
            ("body_rotations", "body_rotations"),
        ):
            setattr(self._out, ours, self._arrays[theirs])
        self._state = state
        self._given: wp.array | None = None
        self._stages: dict[tuple[Any, ...], tuple[Stage, ...]] = {}
        self._read: tuple[Any, ...] = ()
        self._bound: tuple[Stage, ...] = ()
        self._soft, self._first_soft = soft, len(layout.meshes)
        self._visual = {
            part: AttachedVertices(part, self.device) for part in soft.parts if isinstance(part, VisualMesh)
        }
        self._trees: list[DeformingTree] | None = None

    def arrays(self) -> Mapping[str, wp.array]:
        return self._arrays

    def user_owned(self, field: str) -> bool:
        return field.startswith(("material_", "light_"))

    def user_name(self, field: str) -> str:
        return f"scene.array({field!r})"

    def global_ambient(self) -> float:
        return 0.0

    def clock(self) -> wp.array | None:
        return None

    def refresh(self) -> None:
        pass

    def kernels(self) -> list[wp.Kernel]:
        kernels = [write_worlds]
        if self._soft.parts:
            backs = not self._visual and all(part.backs for part in self._soft.parts)
            kernels += kernels_of(backs, self.device)
        return [*kernels, offset_vertices] if self._visual else kernels

    def stages(self, meshes: types.Meshes) -> tuple[Stage, ...]:
        model = self._model
        read = (
            self._state.body_q,
            self._state.particle_q,
            self._given,
            *(getattr(model, name, None) for name in (*self._live, *LIVE_SOFT)),
        )
        if len(read) == len(self._read) and all(a is b for a, b in zip(read, self._read, strict=True)):
            return self._bound
        key = tuple(None if array is None else (array.ptr, array.shape, array.strides) for array in read)
        stages = self._stages.pop(key, None)
        if stages is None:
            if len(self._stages) >= MAX_BOUND:
                self._stages.pop(next(iter(self._stages)))
            flat = self._flat()
            gathered = bind_gather(flat, self._out, self.device)
            stages = (gathered, *self.tints.record(flat.face_colors), *self._record_soft(meshes, flat))
        self._stages[key] = stages
        self._read, self._bound = read, stages
        return stages

    def bind(self, state: Any) -> None:
        self._check_state(state)
        self._state = state

    def bind_visual_points(self, points: wp.array | None) -> None:
        """Draw visual meshes with these vertices, (point,) vec3 of all of the model [m]; None makes them of the state.

        A front end calls this; the array is read at each frame.
        """
        self._given = points

    def forward(self) -> None:
        newton.eval_fk(self._model, self._state.joint_q, self._state.joint_qd, self._state)

    def _record_soft(self, meshes: types.Meshes, flat: FlatShapes) -> list[Stage]:
        stages = []
        for part, tree in zip(self._soft.parts, self._move(meshes), strict=True):
            if not isinstance(part, VisualMesh):
                stages += tree.record(flat.points, aside=True)
            else:
                moves = self._visual[part]
                stages += moves.record(flat.points, flat.body_transforms, self._given)
                stages += tree.record(moves.points, moves.normals)
        return stages

    def _move(self, meshes: types.Meshes) -> list[DeformingTree]:
        """The trees of the surfaces that move, made when the scene's meshes are there."""
        if self._trees is None:
            self._trees, first = [], self._first_soft
            for part in self._soft.parts:
                assets = np.arange(first, first + len(part.worlds))
                bases = np.asarray(part.bases)
                shading, both = (part.shading, False) if isinstance(part, VisualMesh) else (None, part.backs)
                self._trees.append(
                    DeformingTree(
                        meshes, assets, bases, part.faces, device=self.device, shading=shading, two_sided=both
                    )
                )
                first += len(part.worlds)
        return self._trees

    def _flat(self) -> FlatShapes:
        self._check_state(self._state)  # its arrays may be others by now
        flat = FlatShapes()
        for name, (field, dtype) in self._live.items():
            array = getattr(self._model, name, None)
            rows = 0 if array is None else array.shape[0]
            if rows != self._model.shape_count and not (name == "shape_opacity" and rows == 0):
                raise WarpcamError(f"model.{name}: {self._model.shape_count} rows are needed, got {rows}")
            self._set(flat, field, array, dtype, f"model.{name}")
        for name, (field, dtype) in LIVE_SOFT.items():
            self._set(flat, field, getattr(self._model, name, None), dtype, f"model.{name}")
        self._set(flat, "body_transforms", self._state.body_q, wp.transform, "state.body_q")
        self._set(flat, "points", self._state.particle_q, wp.vec3, "state.particle_q")
        return flat

    def _set(self, flat: FlatShapes, field: str, array: Any, dtype: Any, what: str) -> None:
        if array is None:
            array = wp.empty(0, dtype=dtype, device=self.device)
        device_rule.require_same(self.device, "model is", array.device, what)
        setattr(flat, field, array)

    def _check_state(self, state: Any) -> None:
        if not isinstance(state, newton.State):
            raise WarpcamError(f"state must be a newton.State, got {type(state).__name__}")
        model = self._model
        for what, count, array, needed in (
            ("bodies", model.body_count, state.body_q, True),
            ("particles", model.particle_count, state.particle_q, True),
            ("joint coordinates", model.joint_coord_count, state.joint_q, False),
            ("joint degrees of freedom", model.joint_dof_count, state.joint_qd, False),
        ):
            found = 0 if array is None else array.shape[0]
            if found != count and (needed or array is not None):
                raise WarpcamError(
                    f"state was made from another model: it has {found} {what}, model has {count}; model.state() makes "
                    "one"
                )
            if array is not None:
                device_rule.require_same(self.device, "model is", array.device, "state")


def default_light(model: newton.Model) -> Light:
    """The one light that Newton's own renderer has: from behind, the left and above."""
    turn = newton.Axis.Z.quat_between_axes(newton.Axis.from_any(model.up_axis))
    return Light(kind="directional", direction=tuple(wp.quat_rotate(turn, wp.vec3(*DOWN))))


def _tables(layout: Layout, tables: Columns, num_worlds: int, device: wp.Device) -> dict[str, wp.array]:
    """The live arrays but those of lights, with what the gathering does not write."""
    columns, places, materials = len(tables.kinds), len(layout.body_names), len(layout.finishes)
    widths = {"shapes": columns, "bodies": places, "cameras": 0, "materials": materials}
    arrays = {
        name: wp.zeros((num_worlds, widths[field.rows], *field.more), dtype=field.dtype, device=device)
        for name, field in {**LIVE_ARRAYS, **PBR_LIVE_ARRAYS}.items()
        if field.rows in widths and name not in ("shape_assets", "shape_materials")
    }
    arrays["shape_assets"] = wp.array(tables.assets, dtype=wp.int32, ndim=2, device=device)
    arrays["shape_materials"] = wp.array(tables.materials, dtype=wp.int32, ndim=2, device=device)
    # A colour of exactly this is what a material's own may stand in for; so it says the same.
    arrays["material_color"].fill_(wp.vec4(0.5, 0.5, 0.5, 1.0))
    arrays["material_texture_repeat"].fill_(wp.vec2(1.0, 1.0))
    textures = np.full((num_worlds, materials, 2), -1, np.int32)
    rough, metal, images = zip(*layout.finishes, strict=True)
    textures[:, :, types.ROLE_COLOR] = images
    arrays["material_texture"].assign(textures)
    for name, values in (("roughness", rough), ("metallic", metal)):
        arrays[f"material_{name}"].assign(np.tile(np.asarray(values, np.float32), (num_worlds, 1)))
    arrays["material_reflectance"].fill_(REFLECTANCE)
    arrays["sky"] = wp.zeros((1, types.SKY_TERMS + 1), dtype=wp.vec3, device=device)
    return arrays


def _opacity(model: newton.Model, tables: Columns) -> np.ndarray:
    """Return the present opacity of each drawn shape, (world, column)."""
    opacity = np.ones(tables.ids.shape, np.float32)
    shapes, soft = model.shape_opacity, model.tri_opacity
    if shapes is not None and shapes.shape[0]:
        opacity = np.where(tables.ids >= 0, np.append(shapes.numpy(), 1.0)[np.maximum(tables.ids, -1)], opacity)
    if soft is not None and soft.shape[0]:
        first = tables.first_soft
        faces = opacity[:, first : first + tables.faces.shape[1]]
        triangles = np.where(tables.faces <= WHITE, WHITE - tables.faces, tables.faces)
        faces[:] = np.where(triangles >= 0, np.append(soft.numpy(), 1.0)[np.maximum(triangles, -1)], faces)
    return opacity


def _image(pixels: Any, index: int) -> TextureImage:
    image = np.asarray(pixels)
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
        raise WarpcamError(
            f"textures[{index}]: (height, width, 3) uint8 is needed, got {image.dtype} of shape {image.shape}"
        )
    return TextureImage("2d", np.ascontiguousarray(image), blend_light=True)


def _flags(choice: NewtonOptions, layout: Layout) -> SceneFlag:
    """Return the flags of texture mapping without texture coordinates, and of the normals that are written."""
    flags = SceneFlag.PROJECTED if layout.textures else SceneFlag(0)
    if layout.textures and choice.triplanar:
        flags |= SceneFlag.TRIPLANAR
    if layout.meshes and choice.lit_normals:
        flags |= SceneFlag.LIT_NORMALS
    return flags


def load(
    model: Any,
    state: Any,
    lights: Any,
    ambient: Any,
    semantics: Any,
    transparency: Any,
    textures: Sequence[Any] = (),
    choice: NewtonOptions = EVERYTHING,
) -> Scene:
    if not isinstance(model, newton.Model):
        raise WarpcamError(f"model must be a newton.Model, got {type(model).__name__}")
    tell_huge_meshes(model)
    return Scene(
        NewtonSource(
            model,
            state,
            lights=lights,
            ambient=ambient,
            semantics=semantics,
            transparency=transparency,
            textures=textures,
            choice=choice,
        )
    )
