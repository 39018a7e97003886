"""The scene: what can be seen, on one device, and checked when it is made."""

import operator
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from warpcam.accel.gaussians import pack_gaussians
from warpcam.accel.heightfields import num_faces, pack_height_fields
from warpcam.accel.meshes import pack_masks, pack_meshes
from warpcam.core import device as device_rule
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.flags import SceneFlag
from warpcam.kernels.passes import views
from warpcam.kernels.passes.world_overrides import without_background
from warpcam.kernels.plan.shading import has_plane_path, has_strips
from warpcam.kernels.runtime.launch import BLOCK_DIM, Stage, run
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import HEIGHT_FIELD, MESH, SKY_TERMS, SPLATS, Background, Lights, Materials, Physical, Shapes
from warpcam.scene.bounds import Bounds, bounds_of
from warpcam.scene.planes import Planes
from warpcam.scene.source import LIVE_ARRAYS, PBR_LIVE_ARRAYS, SceneCamera, SceneDescription, Source, live_arrays_of
from warpcam.scene.validation import check_array, check_description, check_indices, find_body, find_index
from warpcam.scene.world_overrides import WorldOverrides
from warpcam.textures.hardware_mipmaps import pack_mips
from warpcam.textures.mip_atlas import pack_mip_atlases
from warpcam.textures.pack import pack_textures

FEW_MESHES = 2  # with more, occluder boxes of one seldom stop the light that a pixel asks for


class Scene:
    """Visible contents of many worlds. Made by ``from_mujoco_warp``, ``from_mujoco`` and the other loaders."""

    def __init__(self, source: Source):
        parts = source.parts
        self._source = source
        self._parts = parts
        self._device: wp.Device = device_rule.resolve(source.device)
        self._counts = {
            "shapes": len(parts.shape_types),
            "materials": parts.num_materials,
            "lights": parts.num_lights,
            "bodies": len(parts.bodies),
            "cameras": len(parts.cameras),
            "terms of the sky": SKY_TERMS + 1,
            "splats": len(parts.splat_counts),
        }
        self._fields = live_arrays_of(parts)
        check_description(parts, self._counts)
        self._own = WorldOverrides(parts, parts.num_worlds, self.device)
        self._arrays: Mapping[str, wp.array] = {}
        self._key: tuple[Any, ...] = ()
        self._ambient, self._last = -1.0, ()
        self._hiding: wp.array | None = None
        seen = [int(parts.shape_types[shape]) for shape in parts.drawn]
        shut = 0 < seen.count(MESH) <= FEW_MESHES and not parts.physical and not parts.scaled
        ahead = [(kernel, BLOCK_DIM) for kernel in source.kernels()]
        ahead += [views.LAUNCHED] if ahead or parts.meshes else []  # else compiled beside a renderer's other kernels
        self._meshes, self._num_faces = pack_meshes(parts.meshes, self.device, shut, ahead)
        self._moving = tuple(index for index, mesh in enumerate(parts.meshes) if mesh.moves)
        self._moving_faces = int(self._meshes.num_faces.numpy()[list(self._moving)].max(initial=0))
        self._height_fields = pack_height_fields(parts.height_fields, self.device)
        self._textures = pack_textures(parts.textures, self.device)
        types, spare = set(seen), has_plane_path(set(seen), len(seen))
        self._mips: list[wp.Texture2D] = []
        if spare or (has_strips(types, len(seen)) and not parts.physical):
            self._mip_atlases = pack_mip_atlases(parts.textures, self._textures, self.device, not spare)
            if types.isdisjoint((MESH, HEIGHT_FIELD)) and not (parts.physical or parts.clouds):
                self._mips = pack_mips(parts.textures, self._textures, self.device)
        parts.lend_textures(self._textures)
        self._masked = pack_masks(parts.meshes, self._textures, self._meshes, self.device)
        self._splats = pack_gaussians(parts.clouds, self._clouds(), self.device) if self._clouds() else None
        self._drawn, self._casting = (
            None if columns is None else self._ints(columns) for columns in (parts.drawn, parts.casting)
        )
        places = np.full(len(parts.shape_types), -1, np.int32)
        places[np.asarray(parts.drawn, np.int64)] = np.arange(len(parts.drawn))
        self._places, self._types, self._bodies, self._coincident = map(
            self._ints, (places, parts.shape_types, parts.shape_bodies, parts.coincident)
        )
        self._labels = {
            name: self._ints(np.atleast_2d(np.full(len(parts.shape_types), no) if values is None else values))
            for name, values, no in (("instances", parts.shape_instances, -1), ("semantics", parts.shape_semantics, 0))
        }
        self._ids, self._body_ids = (
            self._ints(np.zeros((0, 0), np.int32) if ids is None else ids) for ids in (parts.shape_ids, parts.body_ids)
        )
        self._layers, self._planes = parts.layers.tables(len(parts.shape_types), self.device), Planes(parts)
        source.refresh()
        source.arrays()
        run(self.stages())
        self._planes.look_at(source.arrays())
        self._tables = self.tables()
        check_indices(self._arrays, parts, self._seen(), source.user_name)

    def __reduce__(self) -> Any:
        raise WarpcamError("Scene: it cannot be copied or pickled, as it holds memory of a device; make another one")

    @property
    def device(self) -> wp.Device:
        """Device of all the scene's arrays."""
        return self._device

    @property
    def num_worlds(self) -> int:
        """Number of worlds."""
        return self._parts.num_worlds

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the source's cameras in their order, "" for one without a name."""
        return tuple(camera.name for camera in self._parts.cameras)

    @property
    def objects(self) -> np.ndarray:
        """Object of each id of ``segmentation``, (id + 1, 2) int32.

        ``objects[image]`` are the pairs of ``mujoco.Renderer``.

        The first number is the id that MuJoCo knows it by, the second its ``mjtObj``: a geom, site, tendon, flex or
        skin. The last row, which -1 finds, is (-1, -1). Only scenes of MuJoCo have this.
        """
        if self._parts.objects is None:
            raise WarpcamError("objects: only scenes of from_mujoco and from_mujoco_warp have objects of several kinds")
        return self._parts.objects

    @property
    def columns(self) -> np.ndarray:
        """Id, as in ``segmentation``, of each column of shapes, or -1, (world or 1, column) int32."""
        ids = self._parts.shape_ids
        return np.arange(self._counts["shapes"], dtype=np.int32)[None] if ids is None else ids.copy()

    def owners(self) -> np.ndarray:
        """The column of that of which each is a piece, (column,), its own but of ropes, tendons and the like."""
        return np.arange(self._counts["shapes"]) if self._parts.objects is None else self.columns[0]

    def count_of(self, name: str) -> int | None:
        """Return the number of values that the indices in an array of ``vary`` may take, None for other arrays."""
        parts, images = self._parts, len(self._parts.textures)
        counts = {"shape_materials": parts.num_materials, "material_texture": images, "skybox": images}
        return min(parts.splat_counts) if name == "splat_choice" else counts.get(name)

    def cubes(self) -> list[int]:
        """Textures that may be a skybox."""
        return [index for index, texture in enumerate(self._parts.textures) if texture.kind == "cube"]

    def bounds(self) -> Bounds:
        """Lowest and highest corner of what can be seen now, over all worlds, infinite planes aside.

        Two (3,) float32 arrays in the world frame [m]; zeros where there is nothing. Waits for the device.
        """
        self.refresh()
        self.tables()
        run(self.stages())
        host = {name: array.numpy() for name, array in self._arrays.items() if name.startswith(("shape", "material_c"))}
        parts, clouds = self._parts, self._splats
        corners = self._meshes.bounds_min.numpy(), self._meshes.bounds_max.numpy()
        splats = None if clouds is None else (clouds.lower, clouds.upper)
        return bounds_of(
            host,
            parts.shape_types,
            drawn=self._seen(),
            meshes=corners,
            height_fields=parts.height_fields,
            scaled=parts.scaled,
            clouds=splats,
        )

    @property
    def live_on_device(self) -> bool:
        """True if poses are read where the simulator writes them, with no copy from the host."""
        return self._source.live_on_device

    def refresh(self) -> None:
        """Bring the device's arrays up to date, where the simulator keeps its own on the host."""
        self._source.refresh()

    def stages(self) -> tuple[Stage, ...]:
        """Return the stages that update the arrays of ``tables`` on the device.

        It is the same tuple as long as they do the same.
        """
        stages = self._source.stages(self._meshes)
        return (*stages, *self._own.stages_over(self._source)) if self._own.stages else stages

    def tree_stages(self) -> tuple[Stage, ...]:
        """Those of them that frames may have left out, for what walks through scenes as they were drawn."""
        stages = tuple(stage for stage in self.stages() if stage.for_trees_only or stage.for_shading_only)
        return stages if any(stage.for_trees_only for stage in stages) else ()  # trees may be ordered in normals' room

    def clock(self) -> wp.array | None:
        """The simulator's own live array of its time in each world [s], (world,) float32; None where it keeps none."""
        return self._source.clock()

    def bind(self, state: Any) -> None:
        """Look at another state of the same simulation from the next render on; nothing is built again.

        Swapping states back and forth costs nothing once each has been rendered. Only scenes that read a state object
        have this: those of ``from_newton``.
        """
        self._source.bind(state)

    def forward(self) -> None:
        """Have the simulator compute poses from its state."""
        self._source.forward()

    def array(self, field: str) -> wp.array:
        """The live array of that name, (world or 1, row, ...) on the scene's device: what the next render reads.

        Names are those of ``LIVE_ARRAYS`` and ``PBR_LIVE_ARRAYS`` in ``warpcam/scene/source.py``, which say what each
        holds. Where nobody but you writes it, as Newton's lights, it may be written in place; see also ``vary``.
        """
        if not isinstance(field, str) or field not in self._arrays:
            raise WarpcamError(f"array: {field!r} came; this scene has {', '.join(self._arrays)}")
        return self._arrays[field]

    def vary(self, name: str) -> "torch_interop.Tensor":
        """Give every world its own value of something: a tensor (world, ...) on the scene's device.

        Write it in place, at any time; the next render shows it. It begins with what the scene has now, and from then
        on is read instead of what the simulator holds, unless that has an entry for each world already, which nobody
        else writes: then it is that very array. Calling it again gives the same tensor.

        The first call for a name makes room and has renderers bind their stages anew at their next frame; make them
        afterwards, for some names need kernels of their own.

        Args:
            name: "shape_colors", "shape_materials", "headlight", "background", "skybox", "splat_choice", or one that
                begins with "material_" or "light_": see docs/randomize.md.
        """
        if not isinstance(name, str) or name not in self._own:
            self.tables()
            self._own.make(name, self._source, self._arrays)
            self._ambient, self._key, self._last = -1.0, (), ()
            self.tables()
        return self._own.tensor(name)

    def camera(self, key: str | int, where: str) -> int:
        """Index of the source's camera of that name or index."""
        return find_index(key, self.cameras, where, "camera")

    def camera_kind(self, index: int) -> SceneCamera:
        return self._parts.cameras[index]

    def body(self, key: str | int, where: str) -> int:
        """Index of the source's body of that name or index."""
        return find_body(self._parts, key, where)

    def shape_bodies(self) -> np.ndarray:
        """Body of each shape, as ``body`` counts them, (world or 1, shape) int32; -1 for none, -2 for no shape."""
        return self._parts.bodies_of_shapes()

    def description(self) -> SceneDescription:
        return self._parts

    def tables(self) -> SceneTables:
        """The scene for the kernels: the same object until the source's arrays are others."""
        theirs = self._source.arrays()
        arrays = self._own.over(theirs)
        ambient, hiding = self._source.global_ambient(), theirs["shape_colors"]  # which hides what is painted, too
        if ambient == self._ambient and hiding is self._hiding and all(map(operator.is_, arrays.values(), self._last)):
            return self._tables
        key = (ambient, _identity(hiding), *map(_identity, arrays.values()))
        if key != self._key:
            for name, field in self._fields.items():
                rows, label = self._counts[field.rows], self._source.user_name(name)
                check_array(label, field, arrays[name], rows, self.num_worlds, self.device)
            self._arrays = arrays
            self._tables = self._build(arrays, ambient)
            self._key = key
        self._ambient, self._hiding, self._last = ambient, hiding, tuple(arrays.values())
        return self._tables

    def moving_faces(self) -> np.ndarray:
        """Number of faces, without backs of others, of each moving mesh, (moving,) int64."""
        return np.array([len(self._parts.meshes[index].fronts) for index in self._moving], np.int64)

    def moving_columns(self) -> list[int]:
        """Shapes that may be of a mesh that moves."""
        return [shape for shape in self._parts.drawn if self._parts.shape_types[shape] == MESH]

    def background(self, color: tuple[float, float, float]) -> Background:
        """A plain background."""
        background = Background()
        background.color = wp.vec3(*color)
        background.skybox = -1
        return background

    def tables_with(self, tables: SceneTables, color: tuple[float, float, float] | None) -> SceneTables:
        """The tables with a background of one colour instead of the scene's own, or as they are for None."""
        if color is None:
            return tables
        plain, variety = self.background(color), without_background(tables.world_overrides, self.device)
        return replace(tables, background=plain, has_skybox=False, shows_environment=False, world_overrides=variety)

    def _build(self, arrays: Mapping[str, wp.array], ambient: float) -> SceneTables:
        parts = self._parts
        arrays = self._own.finish(self._source, arrays)
        shapes, materials, lights = self._shapes(arrays, self._drawn), Materials(), Lights()
        for prefix, struct in (("material_", materials), ("light_", lights)):
            _fill(struct, prefix, arrays)
        lights.headlight = arrays["headlight"]
        lights.global_ambient = ambient
        lights.shadow_width, lights.shadow_near, lights.shadow_scale, lights.shadow_gap = parts.shadow_map
        physical = None
        if parts.physical:
            physical = Physical()
            physical.plain = lights
            for name in PBR_LIVE_ARRAYS:
                setattr(physical, name.removeprefix("material_").removeprefix("light_"), arrays[name])
        background = self.background((0.0, 0.0, 0.0))
        background.skybox = parts.skybox
        return SceneTables(
            shapes=shapes,
            meshes=self._meshes,
            height_fields=self._height_fields,
            materials=materials,
            textures=self._textures,
            lights=lights,
            background=background,
            num_worlds=self.num_worlds,
            num_drawn=len(parts.drawn),
            num_lights=parts.num_lights,
            num_shapes=self._counts["shapes"],
            num_faces=max([self._num_faces, *map(num_faces, parts.height_fields)]),
            shape_types=self._shape_types(),
            flags=self._flags(),
            has_materials=parts.num_materials > 0,
            has_textures=parts.num_materials > 0 and any(i != parts.skybox for i in range(len(parts.textures))),
            has_mips=len(self._mips) > 0,
            has_skybox=parts.skybox >= 0 or "skybox" in self._own,
            world_overrides=self._own.kernel_struct(),
            headlights=self._own.headlights,
            ids_by_world=parts.shape_ids is not None,
            horizon=parts.horizon,
            planes=self._planes.ids,
            general_planes=self._planes.general(self._own),
            physical=physical,
            has_maps=parts.physical and parts.maps,
            backs_shade=parts.backs_shade,
            moving=self._moving,
            moving_faces=self._moving_faces,
            layers=self._layers,
            splats=None if self._splats is None else self._splats.table,
            opaque_splats=parts.opaque_splats,
            splat_limits=parts.splat_limits,
            labels=self._labels,
            casters=None if self._casting is None else self._shapes(arrays, self._casting),
        )

    def _shapes(self, arrays: Mapping[str, wp.array], drawn: wp.array) -> Shapes:
        shapes = Shapes()
        shapes.drawn, shapes.places = drawn, self._places
        shapes.types, shapes.bodies, shapes.coincident = self._types, self._bodies, self._coincident
        shapes.ids, shapes.body_ids = self._ids, self._body_ids
        _fill(shapes, "shape_", arrays)
        return shapes

    def _ints(self, values: Any) -> wp.array:
        return wp.array(np.asarray(values, np.int32), dtype=wp.int32, device=self.device)

    def _clouds(self) -> list[int]:
        return [int(shape) for shape in np.flatnonzero(np.asarray(self._parts.shape_types) == SPLATS)]

    def _seen(self) -> list[int]:
        return [*self._parts.drawn, *self._clouds()]

    def _shape_types(self) -> frozenset[int]:
        return frozenset(int(self._parts.shape_types[shape]) for shape in self._parts.drawn)

    def _flags(self) -> SceneFlag:
        """The source's flags, and those that follow from the scene's meshes and sizes."""
        types, flags = self._shape_types(), self._parts.flags
        if self._parts.scaled and types & {MESH, HEIGHT_FIELD}:
            flags |= SceneFlag.PER_SHAPE_SCALE
        if MESH in types:
            sides = any(mesh.two_sided for mesh in self._parts.meshes)
            flags |= SceneFlag.TWO_SIDED if sides else SceneFlag(0)
            flags |= SceneFlag.DEFORMING_MESHES if self._moving else SceneFlag(0)
            flags |= SceneFlag.ALPHA_TESTED if self._masked else SceneFlag(0)
        return flags


def _fill(struct: Any, prefix: str, arrays: Mapping[str, wp.array]) -> None:
    """Give a struct the arrays of the fields whose names begin so."""
    for name in LIVE_ARRAYS:
        if name.startswith(prefix):
            setattr(struct, name.removeprefix(prefix), arrays[name])


def _identity(array: Any) -> tuple[Any, ...] | None:
    """Equal for arrays that are the same memory, seen alike."""
    return (array.ptr, array.shape, array.strides) if isinstance(array, wp.array) else None
