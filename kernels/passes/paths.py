"""The path tracer: lists of shapes for rays in any direction, and the paths of each pixel."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.world_overrides import WorldOverrides, empty_overrides
from warpcam.kernels.plan.launches import SceneTypes
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.paths import PathKey, PathListKey
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.types import (
    Background,
    HeightFields,
    Materials,
    Meshes,
    Physical,
    Shapes,
    Textures,
    View,
)

IMAGES = ("rgb", "rgba", "hdr")
THREADS = 64  # of a CUDA block: paths are long or short, and a block waits for its longest
SHAPE_ROWS = 6  # PATH_SHAPE_ROWS of native/path/path_shapes.h
HEAD = 4  # FIRST_LAMP there


@wp.struct
class PathFrame:
    """Arrays of one camera that its paths read and write."""

    mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world's images alone
    faults: wp.array(dtype=wp.uint8)  # (world,) set to 1 where a pose or size is not finite or 0
    width: wp.int32
    height: wp.int32
    horizon: wp.float32  # see SceneTables
    overrides: WorldOverrides
    backs: wp.int32  # 1: all rays but the camera's meet meshes from behind, too
    most_bounces: wp.int32
    albedo: wp.array(dtype=wp.float32)  # build/facet_albedo.py, flat
    rows: wp.array2d(dtype=wp.vec4)  # (world, row) the shapes: native/path/path_shapes.h
    # (world, HEAD + light + shape) how many of them, of lights and of shapes that shine there are, and which
    heads: wp.array2d(dtype=wp.int32)
    face_starts: wp.array(dtype=wp.int32)  # (mesh + 1,) where the faces of each begin in `faces`; empty: none shines
    faces: wp.array(dtype=wp.int32)  # (face,) its row / 3 in the mesh's part of Meshes.faces
    # (face + mesh,) sums of the shares of the faces of each mesh, from 0 to 1: one more than faces, from
    # face_starts[mesh] + mesh
    face_sums: wp.array(dtype=wp.float32)
    face_shares: wp.array(dtype=wp.float32)  # (row / 3 of Meshes.faces,) of the face that stands there
    # (6 * sky_side^2 + 1,) sums of the shares of cells of the sky's image; empty where it is not drawn as a light
    sky_sums: wp.array(dtype=wp.float32)
    sky_side: wp.int32
    seeds: wp.array(dtype=wp.int32)  # (world,)
    begun: wp.array(dtype=wp.int32)  # (world,) paths of each pixel before this launch
    wanted: wp.array(dtype=wp.int32)  # (world,) and those that it adds
    sums: wp.array(dtype=wp.vec4)  # (pixel,) sum of their radiance, and bits of how many saw a surface


@wp.struct
class PathImages:
    """Images, channel after channel; empty if not asked for."""

    rgb: wp.array(dtype=OUTPUTS["rgb"].dtype)
    rgba: wp.array(dtype=OUTPUTS["rgba"].dtype)
    hdr: wp.array(dtype=OUTPUTS["hdr"].dtype)


@dataclass(frozen=True, eq=False)
class PathArrays:
    """What one camera keeps of its paths from frame to frame.

    Attributes:
        frame: The arrays of PathFrame that are not a frame's own.
        samples: Paths of each pixel in a frame.
        more: int32, (1,): those that are added to the last frame.
    """

    frame: Any
    samples: int
    more: wp.array


@functools.cache
def _list_kernel(types: SceneTypes, blocks: int) -> wp.Kernel:
    return make_kernel(
        "list_path_shapes",
        "warpcam::count_paths(frame, samples, more, fresh, index);"
        f"warpcam::list_path_shapes<{types.native}>"
        "(frame, shapes, casters, materials, physical, meshes, fields, views, index);",
        {
            "frame": PathFrame,
            "shapes": Shapes,
            "casters": Shapes,
            "materials": Materials,
            "physical": Physical,
            "meshes": Meshes,
            "fields": HeightFields,
            "views": wp.array(dtype=View),
            "samples": wp.int32,
            "more": wp.array(dtype=wp.int32),
            "fresh": wp.int32,
        },
        native_module("path/path_lists.h"),
        (THREADS, blocks),
    )


@functools.cache
def _path_kernel(key: PathKey) -> wp.Kernel:
    return make_kernel(
        "trace_paths",
        f"warpcam::trace_paths<{key.types.native}, {int(key.lens)}, {int(key.flags)}>("
        "warpcam::PhysicalScene { warpcam::Scene { frame, images, shapes, meshes, fields, materials, textures, "
        "background }, physical }, views, index);",
        {
            "frame": PathFrame,
            "images": PathImages,
            "shapes": Shapes,
            "meshes": Meshes,
            "fields": HeightFields,
            "materials": Materials,
            "textures": Textures,
            "physical": Physical,
            "background": Background,
            "views": wp.array(dtype=View),
        },
        native_module("path/path_tracer.h", THREADS),
        (THREADS, key.blocks),
    )


def _frame(frame: CameraFrame) -> Any:
    arrays: Any = PathFrame()
    arrays.assign(frame.paths.frame)
    tables = frame.tables
    arrays.mask, arrays.faults, arrays.horizon = frame.mask, frame.faults, tables.horizon
    arrays.width, arrays.height, arrays.backs = frame.width, frame.height, int(tables.backs_shade)
    overrides = tables.world_overrides
    arrays.overrides = empty_overrides(frame.device) if overrides is None else overrides
    return arrays


def bind_list(planned: PlannedPass[PathListKey], frame: CameraFrame, fresh: bool) -> Stage:
    """Bind the stage that lists shapes; ``fresh``: a frame begins, and what was added up is forgotten."""
    tables, paths = frame.tables, frame.paths
    casters = tables.shapes if tables.casters is None else tables.casters
    arguments = [_frame(frame), tables.shapes, casters, tables.materials, tables.physical, tables.meshes]
    arguments += [tables.height_fields, frame.views, paths.samples, paths.more, int(fresh)]
    return frame.launch(planned, _list_kernel(planned.key.types, planned.key.blocks), arguments, THREADS)


def bind_more(passes: Sequence[PlannedPass[Any]], frame: CameraFrame) -> list[Stage]:
    """Bind the stages that add paths to what the last frame has; ``passes``: the frame's."""
    by_name = {each.name: each for each in passes}
    return [bind_list(by_name["path shapes"], frame, fresh=False), bind_paths(by_name["paths"], frame)]


@register("path shapes")
def bind_shapes(planned: PlannedPass[PathListKey], frame: CameraFrame) -> Stage:
    """Bind the list of shapes of a new frame."""
    return bind_list(planned, frame, fresh=True)


@register("paths")
def bind_paths(planned: PlannedPass[PathKey], frame: CameraFrame) -> Stage:
    """Bind the paths of one camera's pixels, after the list of shapes."""
    tables = frame.tables
    images = frame.fill(planned, PathImages(), IMAGES)
    scene = (tables.shapes, tables.meshes, tables.height_fields, tables.materials, tables.textures)
    arguments = [_frame(frame), images, *scene, tables.physical, tables.background, frame.views]
    return frame.launch(planned, _path_kernel(planned.key), arguments, THREADS)
