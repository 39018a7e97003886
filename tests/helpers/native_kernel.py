"""Kernels around single functions of kernels/native, for tests of native code."""

from collections.abc import Callable
from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import native_module


def native_kernel(header: str) -> Callable[[Callable[..., Any]], wp.Kernel]:
    """Decorates a kernel whose ``wp.func_native`` functions use ``header``."""
    return wp.kernel(module="unique", enable_backward=False, module_options=native_module(header))
