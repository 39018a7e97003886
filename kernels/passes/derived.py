"""Passes that derive outputs pixel by pixel from the surface that a pixel shows."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.camera_frame import CameraFrame, dtype_of
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.plan.derived import DerivedKey
from warpcam.kernels.plan.frame import PlannedPass
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.passes import register
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import HeightFields, Meshes, Shapes, View


@functools.cache
def _frame_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of what the trace has found in one camera's images."""
    fields = {
        "views": wp.array(dtype=View),  # (world,)
        "mask": wp.array(dtype=wp.uint8),  # (world,) 0 leaves the world's images alone
    }
    fields |= visible_fields(shape_dtype, face_dtype)
    return make_struct("SeenFrame", fields | {"width": wp.int32, "height": wp.int32})


@functools.cache
def _images_struct(outputs: tuple[str, ...]) -> Any:
    """Struct of the images that a pass writes, channel after channel; empty if not asked for."""
    return make_struct("DerivedImages", {name: wp.array(dtype=OUTPUTS[name].dtype) for name in outputs})


@functools.cache
def _kernel(key: DerivedKey, code: str, frame_type: Any, images_type: Any) -> wp.Kernel:
    @wp.func_native(
        f"using Types = {key.types.native};\n"
        f"warpcam::derive_pixel<Types, {int(key.lens)}>(frame, shapes, meshes, fields, index,\n"
        f"    [&](int pixel, const warpcam::SeenSurface& seen) {{{code}}});"
    )
    def derive(
        frame: frame_type,
        images: images_type,
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        index: int,
    ): ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        launch_bounds=(THREADS, key.blocks),
        module_options=native_module("shading_pass/derived_pixel.h"),
    )
    def derive_images(
        frame: frame_type,
        images: images_type,
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        first: wp.int32,
    ):
        derive(frame, images, shapes, meshes, fields, first + wp.tid())

    return derive_images


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
        shape, face = frame.get(planned, "shape"), frame.find(planned, "face")
        frame_type, images_type = _frame_struct(shape.dtype, dtype_of(face)), _images_struct(writes)
        seen, images = frame_type(), images_type()
        seen.views, seen.mask, seen.width, seen.height = frame.views, frame.mask, frame.width, frame.height
        seen.depth, seen.shape = frame.get(planned, "depth"), shape
        if face is not None:
            seen.face = face
        for output in writes:
            if (image := frame.find(planned, output)) is not None:
                setattr(images, output, image)
        arguments = [seen, images, tables.shapes, tables.meshes, tables.height_fields]
        return frame.launch(planned, _kernel(planned.key, code, frame_type, images_type), arguments)
