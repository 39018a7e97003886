"""Passes that derive outputs pixel by pixel from the surface that a pixel shows."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.plan.derived import DerivedKey
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import HeightFields, Meshes, Shapes, View


@functools.cache
def _frame_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of what the trace has found in one camera's images."""
    fields = {"views": wp.array(dtype=View)}  # (world,)
    return make_struct("SeenFrame", fields | visible_fields(shape_dtype, face_dtype))


@functools.cache
def _images_struct(outputs: tuple[str, ...]) -> Any:
    """Struct of the images that a pass writes, channel after channel; empty if not asked for."""
    return make_struct("DerivedImages", {name: wp.array(dtype=OUTPUTS[name].dtype) for name in outputs})


@functools.cache
def _kernel(key: DerivedKey, code: str, frame_type: Any, images_type: Any) -> wp.Kernel:
    return make_kernel(
        "derive_images",
        f"using Types = {key.types.native};\n"
        f"warpcam::derive_pixel<Types, {int(key.lens)}>(frame, shapes, meshes, fields, index,\n"
        f"    [&](int pixel, const warpcam::SeenSurface& seen) {{{code}}});",
        {"frame": frame_type, "images": images_type, "shapes": Shapes, "meshes": Meshes, "fields": HeightFields},
        native_module("shading_pass/derived_pixel.h"),
        (THREADS, key.blocks),
    )


def register_derived(name: str, writes: tuple[str, ...], code: str) -> None:
    """Register a pass that derives outputs from the surface that each pixel shows.

    Args:
        name: Of the pass.
        writes: Its outputs, rows of ``OUTPUTS``.
        code: C++ that writes one pixel: into ``images.<output>.data``, which is null where the output was not asked
            for, at ``pixel`` times its channels. ``seen`` is a ``SeenSurface`` of
            native/shading_pass/derived_pixel.h; ``shapes``, ``meshes`` and ``fields`` are the structs of types.py, and
            ``Types`` is the scene's ``SceneTypes``, a template parameter of many functions.
    """

    @register(name, needs=("depth", "shape", "face"), writes=writes)
    def bind(planned: PlannedPass[DerivedKey], frame: CameraFrame) -> Stage:
        tables = frame.tables
        frame_type, seen = frame.visible(planned, _frame_struct)
        seen.views = frame.views
        images_type = _images_struct(writes)
        images = frame.fill(planned, images_type(), writes)
        arguments = [seen, images, tables.shapes, tables.meshes, tables.height_fields]
        return frame.launch(planned, _kernel(planned.key, code, frame_type, images_type), arguments)
