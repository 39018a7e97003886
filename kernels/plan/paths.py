"""Kernels of the path tracer."""

from dataclasses import dataclass

import warp as wp

from warpcam.kernels.flags import Lens, ShadingFlag
from warpcam.kernels.plan import launches, shading
from warpcam.kernels.plan.launches import LENSES, SceneTypes, flag_if
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.scene_tables import SceneTables

LIST_THREADS = 1  # for each world: its shapes are listed one after another


@dataclass(frozen=True)
class PathListKey:
    """The kernel that lists the shapes and lights of each world: native/path/path_shapes.h."""

    types: SceneTypes
    lens: Lens  # of the camera; the list does not depend on it

    @property
    def blocks(self) -> int:
        """Blocks that a multiprocessor is to hold: bounds the registers of a thread."""
        return 8


@dataclass(frozen=True)
class PathKey:
    """The kernel that has a thread for each pixel: native/path/path_tracer.h."""

    types: SceneTypes
    lens: Lens
    flags: ShadingFlag

    @property
    def blocks(self) -> int:
        """Likewise; a path's surfaces, lights and reflection need many registers."""
        return 10


@dataclass(frozen=True)
class IndirectKey:
    """The kernel of the rays that find light from shapes: native/occlusion/indirect_rays.h."""

    types: SceneTypes
    lens: Lens
    flags: ShadingFlag

    @property
    def blocks(self) -> int:
        """Likewise, as a path's."""
        return 2


@dataclass(frozen=True)
class IndirectFilterKey:
    """The kernel of their filter: native/occlusion/indirect_filter.h."""

    lens: Lens

    @property
    def blocks(self) -> int:
        return 8


@dataclass(frozen=True)
class ReflectionKey:
    """The kernel that has a thread for each pixel: native/occlusion/reflection_rays.h."""

    types: SceneTypes
    lens: Lens
    flags: ShadingFlag

    @property
    def blocks(self) -> int:
        """Likewise, as a path's."""
        return 2


@dataclass(frozen=True)
class ReflectionFilterKey:
    """The kernel of their filter: native/occlusion/reflection_filter.h."""

    lens: Lens

    @property
    def blocks(self) -> int:
        return 8


def plan_list(tables: SceneTables, request: ImageRequest, device: wp.Device) -> PathListKey:
    return PathListKey(launches.scene_types(tables, device), LENSES[request.lens])


def plan_paths(tables: SceneTables, request: ImageRequest, device: wp.Device) -> PathKey:
    """The kernel that draws the lit images of a request."""
    flags = _flags(tables) | shading.tone_flag(request, request.outputs)
    return PathKey(launches.scene_types(tables, device, appearance=True), LENSES[request.lens], flags)


def plan_reflections(
    tables: SceneTables, request: ImageRequest, device: wp.Device
) -> tuple[ReflectionKey, ReflectionFilterKey]:
    """The kernels of the reflections of a request: of the rays, and of their filter."""
    types, lens = launches.scene_types(tables, device, appearance=True), LENSES[request.lens]
    return ReflectionKey(types, lens, _flags(tables) | _shadows(tables, request)), ReflectionFilterKey(lens)


def plan_indirect(
    tables: SceneTables, request: ImageRequest, device: wp.Device
) -> tuple[IndirectKey, IndirectFilterKey]:
    """The kernels that find light from shapes: of the rays, and of their filter."""
    types, lens = launches.scene_types(tables, device, appearance=True), LENSES[request.lens]
    return IndirectKey(types, lens, _flags(tables) | _shadows(tables, request)), IndirectFilterKey(lens)


def _shadows(tables: SceneTables, request: ImageRequest) -> ShadingFlag:
    """What rays meet has shadows where pixels have them."""
    return flag_if(ShadingFlag.HAS_SHADOWS, request.shadows and tables.num_lights > 0)


def _flags(tables: SceneTables) -> ShadingFlag:
    """Features of a scene as rays in any direction meet them."""
    layers = tables.layers
    return (
        flag_if(ShadingFlag.HAS_MATERIALS, tables.has_materials)
        | flag_if(ShadingFlag.HAS_TEXTURES, tables.has_textures)
        | flag_if(ShadingFlag.HAS_SKYBOX, tables.has_skybox)
        | flag_if(ShadingFlag.HAS_MAPS, tables.has_maps and tables.has_textures)
        | flag_if(ShadingFlag.HAS_TRANSPARENT, layers is not None and layers.has_transparent)
        | shading.override_flags(tables.world_overrides, tables.headlights)
        | shading.environment_flags(tables)
        | ShadingFlag.PHYSICAL
    )
