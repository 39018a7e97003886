"""Kernels of the shading pass."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.kernels.flags import NO_SHADING_FLAGS, ImageFlag, Lens, ShadingFlag
from warpcam.kernels.plan import launches
from warpcam.kernels.plan.launches import LENSES, PlannedLaunch, SceneTypes, flag_if, region_size
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.runtime.launch import Group
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import PLANE

IMAGES = {
    "rgb": ImageFlag.RGB,
    "rgba": ImageFlag.RGBA,
    "hdr": ImageFlag.HDR,
    "normals": ImageFlag.NORMALS,
    "albedo": ImageFlag.ALBEDO,
}
LIT = ("rgb", "rgba", "hdr")  # what mirrors, transparent shapes and haze change
# From light to the display colours of physically based scenes.
TONE_CURVES = {
    "clip": ShadingFlag(0),
    "reinhard": ShadingFlag.REINHARD,
    "aces": ShadingFlag.ACES,
    "khronos_neutral": ShadingFlag.KHRONOS_NEUTRAL,
    "agx": ShadingFlag.AGX,
}
LIT_FLAGS = ImageFlag.RGB | ImageFlag.RGBA | ImageFlag.HDR
# native/shading_pass/store_quads.h
IN_QUADS = frozenset(map(frozenset, (("rgb",), ("rgba",), ("rgb", "rgba"), ("hdr",), ("albedo",))))
TRANSPARENT_BLOCKS = 4  # blocks that a multiprocessor is to hold where some shapes may be transparent
MAX_KEPT = 256  # shapes whose looks a block can keep
MAX_SEEN = 512  # shapes of which it can keep the looks of those that it sees; with more it sees too many
MAX_PLANE_PATH = 64  # shapes of a scene without meshes that leave room for SEPARATE_PLANE_PATH
MAX_STRIPS = 128  # shapes of a scene whose floors are drawn by strips
# lights of a scene whose corners keep a group of numbers: GREY_VERTEX_LIGHTS in native/shading/plane_vertex_lighting.h
MAX_CASTING = 3
LAYER_FLAGS = (
    ShadingFlag.MIRROR_VIEW
    | ShadingFlag.HAS_MIRROR
    | ShadingFlag.HAS_TRANSPARENT
    | ShadingFlag.HAS_HAZE
    | ShadingFlag.WRITE_BACK_TRANSPARENT
)
COVERING_FLAGS = ShadingFlag.HAS_TRANSPARENT | ShadingFlag.WRITE_BACK_TRANSPARENT  # what leaves floors beside it alone
# Shapes of scenes whose CPU kernels of colours are compiled for materials and, but where light is physical, a skybox
# whether these are there or not. Textures, too, would take up to 4 % longer in scenes without any.
FEW = 64
OVERRIDE_FLAGS = (
    ShadingFlag.HAS_OFFSETS | ShadingFlag.PER_WORLD_BACKGROUND | ShadingFlag.HEADLIGHTS | ShadingFlag.HAS_EXPOSURE
)


@dataclass(frozen=True)
class ShadingKey:
    """A kernel of the shading pass: shading_pass/shading_pass.h."""

    types: SceneTypes
    lens: Lens
    capacity: int  # shapes whose appearance a block keeps
    region: tuple[int, int]  # of a block [pixels]
    images: ImageFlag
    flags: ShadingFlag
    transparent: int  # transparent shapes that a pixel's block has room for; 0: there are none

    @property
    def blocks(self) -> int:
        """Blocks that a multiprocessor is to hold: bounds the registers of a thread."""
        if self.transparent:
            return TRANSPARENT_BLOCKS
        if self.images & LIT_FLAGS:
            apart = ShadingFlag.SEPARATE_PLANE_PATH | ShadingFlag.PLANE_STRIPS
            return 6 if self.flags & apart == apart else 5
        return 7 if self.images & ImageFlag.ALBEDO else 8


def plan_shading(
    tables: SceneTables,
    request: ImageRequest,
    device: wp.Device,
    group: Group,
    *,
    outputs: Collection[str],
    shadows: bool,
    shares: ShadingFlag = NO_SHADING_FLAGS,
    mirrors: bool = False,
    mirrored: bool = False,
    write_back: bool = False,
    reflections: bool = False,
    indirect: bool = False,
) -> PlannedLaunch[ShadingKey]:
    """The kernel that writes ``outputs``.

    Args:
        tables: The scene.
        request: Lens and size of the images.
        device: Where it runs.
        group: Worlds that are drawn.
        outputs: Names, those of IMAGES.
        shadows: There is an image of shadows.
        shares: Of SOFT_SHADOWS and AMBIENT_OCCLUSION: what there is an image of shares of.
        mirrors: The scene reflects.
        mirrored: The view is the one from behind the mirrors.
        write_back: Transparent shapes that cover most of a pixel replace what was found there.
        reflections: There is an image of what surfaces mirror.
        indirect: There is an image of light that comes from shapes.
    """
    width, height = request.width, request.height
    layers, layered = tables.layers, ShadingFlag(0)
    transparent = 0
    if layers is not None and not set(LIT).isdisjoint(outputs):
        layered |= flag_if(ShadingFlag.MIRROR_VIEW if mirrored else ShadingFlag.HAS_MIRROR, mirrors)
        if layers.has_transparent:
            layered |= ShadingFlag.HAS_TRANSPARENT | flag_if(ShadingFlag.WRITE_BACK_TRANSPARENT, write_back)
            transparent = launches.rounded_capacity(layers.transparent_shapes.size, 8, device)
        layered |= flag_if(ShadingFlag.HAS_HAZE, layers.haze is not None and tables.has_skybox and not mirrored)
    layered |= flag_if(ShadingFlag.HAS_REFLECTIONS, reflections)
    shares |= flag_if(ShadingFlag.INDIRECT_LIGHT, indirect)
    overrides = override_flags(tables.world_overrides, tables.headlights)
    region = region_size(tables, group.concurrent_worlds, width, height, device, quick=True, fitted=True)
    flags = appearance_flags(tables, shadows) | shares | layered | overrides | tone_flag(request, outputs)
    if device.is_cuda:
        whole = width % region[0] == 0 and height % region[1] == 0
        flags |= flag_if(ShadingFlag.STORE_QUADS, width % 4 == 0) | flag_if(ShadingFlag.WHOLE_REGIONS, whole)
        plain = frozenset(outputs) in IN_QUADS and request.lens == "pinhole" and tables.physical is None
        plain &= not layered & ~COVERING_FLAGS
        strips = has_strips(tables.shape_types, tables.num_drawn) and width % 4 == 0 and region[0] % 32 == 0
        strips = strips and plain
        general = tables.general_planes or bool(overrides & ShadingFlag.HAS_EXPOSURE)
        general |= shadows and tables.num_lights > MAX_CASTING
        flags |= flag_if(ShadingFlag.GENERAL_PLANES, strips and general)
        flags |= flag_if(ShadingFlag.PLANE_STRIPS, strips) | flag_if(ShadingFlag.HAS_MIPS, strips and tables.has_mips)
    capacity = _capacity(tables, device)
    if not device.is_cuda and 0 < capacity <= FEW:
        flags |= ShadingFlag.HAS_MATERIALS
        if not set(LIT).isdisjoint(outputs):
            flags |= flag_if(ShadingFlag.HAS_SKYBOX, tables.physical is None)
    images = ImageFlag(0)
    for name in outputs:
        images |= IMAGES[name]
    threads = launches.world_threads(launches.regions_of(width, height, region), device)
    lit = not set(LIT).isdisjoint(outputs)
    types = launches.scene_types(tables, device, appearance=True, lit=lit)
    types = launches.in_order(types, len(group.worlds) * threads, device)
    key = ShadingKey(
        types=types,
        lens=LENSES[request.lens],
        capacity=capacity,
        region=region,
        images=images,
        flags=flags,
        transparent=transparent,
    )
    return PlannedLaunch(key, threads)


def has_plane_path(shape_types: Collection[int], num_drawn: int) -> bool:
    """Return whether textures are looked up in mip atlases and planes shaded apart: see native/shading/appearance.h."""
    types = frozenset(shape_types)
    return PLANE in types and launches.is_analytic(types) and num_drawn <= MAX_PLANE_PATH


def has_strips(shape_types: Collection[int], num_drawn: int) -> bool:
    """Return whether planes may be shaded by strips, from mip atlases: native/shading_pass/plane_strips.h."""
    return PLANE in shape_types and num_drawn <= MAX_STRIPS


def appearance_flags(tables: SceneTables, shadows: bool = False) -> ShadingFlag:
    """Flags of a scene's materials, textures and lights."""
    plane_path = has_plane_path(tables.shape_types, tables.num_drawn)
    return (
        flag_if(ShadingFlag.HAS_MATERIALS, tables.has_materials)
        | flag_if(ShadingFlag.HAS_TEXTURES, tables.has_textures)
        | flag_if(ShadingFlag.HAS_SKYBOX, tables.has_skybox)
        | flag_if(ShadingFlag.HAS_SHADOWS, shadows)
        | flag_if(ShadingFlag.SEPARATE_PLANE_PATH, plane_path)
        | flag_if(ShadingFlag.PHYSICAL, tables.physical is not None)
        | flag_if(ShadingFlag.HAS_MAPS, tables.has_maps and tables.has_textures)
        | environment_flags(tables)
    )


def environment_flags(tables: SceneTables) -> ShadingFlag:
    """Flags of images in float that light a scene."""
    flags = flag_if(ShadingFlag.HAS_ENVIRONMENT, tables.has_environment)
    return flags | flag_if(ShadingFlag.SHOWS_ENVIRONMENT, tables.shows_environment)


def traced_albedo_flags(tables: SceneTables) -> ShadingFlag:
    """Flags for a trace that writes albedo."""
    return appearance_flags(tables) | flag_if(ShadingFlag.HAS_MIPS, tables.has_mips)


def override_flags(overrides: Any, headlights: bool) -> ShadingFlag:
    """Return the flags of what worlds have each for themselves."""
    flags = flag_if(ShadingFlag.HEADLIGHTS, headlights)
    if overrides is None:
        return flags
    flags |= flag_if(ShadingFlag.HAS_OFFSETS, overrides.texture_offsets.size > 0)
    flags |= flag_if(ShadingFlag.PER_WORLD_BACKGROUND, overrides.skyboxes.size > 0)
    return flags | flag_if(ShadingFlag.HAS_EXPOSURE, overrides.exposures.size > 0)


def tone_flag(request: ImageRequest, outputs: Collection[str]) -> ShadingFlag:
    """Return the flag of the curve of display colours; none where no output has them."""
    return ShadingFlag(0) if {"rgb", "rgba"}.isdisjoint(outputs) else TONE_CURVES[request.tone_mapping]


def _capacity(tables: SceneTables, device: wp.Device) -> int:
    """Shapes whose looks a block keeps, all or those that it sees, in few sizes; 0 for scenes too large for it."""
    if tables.num_drawn > MAX_KEPT:
        return MAX_SEEN if tables.num_drawn <= MAX_SEEN else 0
    if not device.is_cuda and tables.num_drawn <= FEW:
        return FEW
    return launches.rounded_capacity(tables.num_drawn, 16, device)
