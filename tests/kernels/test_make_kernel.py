"""Kernels that are made of native code."""

import numpy as np
import warp as wp

from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import bind_launch

OUT = {"factor": wp.float32, "out": wp.array(dtype=wp.float32)}
OPTIONS = native_module("core/vec3.h")


def run(kernel: wp.Kernel, device: wp.Device, size: int = 5, start: int = 0) -> np.ndarray:
    out = wp.zeros(8, dtype=wp.float32, device=device)
    bind_launch(kernel, size, [0.5, out], device, start=start).launch()
    return out.numpy()


def test_each_thread_runs_the_code_with_its_number(device: wp.Device) -> None:
    kernel = make_kernel("fill", "out.data[index] = factor * index;", OUT, OPTIONS)
    assert run(kernel, device).tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 0.0, 0.0, 0.0]
    assert run(kernel, device, size=2, start=3).tolist() == [0.0, 0.0, 0.0, 1.5, 2.0, 0.0, 0.0, 0.0]


def test_kernels_of_one_name_stay_apart(device: wp.Device) -> None:
    codes = ("out.data[index] = factor;", "out.data[index] = 2.0f * factor;")
    kernels = [make_kernel("fill", code, OUT, OPTIONS, bounds) for code in codes for bounds in (None, (128, 2))]
    other = make_kernel("fill", "out.data[index] = wp::float32(4.0 * factor);", OUT | {"factor": wp.float64}, OPTIONS)
    assert [run(kernel, device)[4] for kernel in (*kernels, other)] == [0.5, 0.5, 1.0, 1.0, 2.0]
