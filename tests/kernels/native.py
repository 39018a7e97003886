"""Kernels around single functions of kernels/native, for the tests beside this file."""

from collections.abc import Callable
from typing import Any

import warp as wp
from warpcam.kernels.launch import native_options

# Poses in which the camera's frame is the shape's own.
HERE = """
inline CUDA_CALLABLE warpcam::Pose here(int type, int asset, const wp::vec3& size, const wp::vec3& eye)
{
    return { { 1.0f, 0.0f, 0.0f, warpcam::as_int(eye[0]) }, { 0.0f, 1.0f, 0.0f, warpcam::as_int(eye[1]) },
             { 0.0f, 0.0f, 1.0f, warpcam::as_int(eye[2]) }, warpcam::to_row(warpcam::to_vec(size), type + 8 * (asset + 1)) };
}
"""


def native_kernel(header: str) -> Callable[[Callable[..., Any]], wp.Kernel]:
    """Decorate a kernel that calls ``wp.func_native`` functions which use ``header``."""
    options = native_options(header)
    return wp.kernel(module="unique", enable_backward=False, module_options={"extra_build_options": options})
