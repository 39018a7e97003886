"""Horizon maps of meshes: the sky that a mesh's own faces hide from each face. See native/accel/horizon_map.h."""

import functools

import numpy as np
import warp as wp

from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.launch import BLOCK_DIM, launch_kernel
from warpcam.kernels.types import Meshes


@functools.cache
def kernel() -> wp.Kernel:
    """Return the kernel that computes horizon maps, for CUDA."""

    @wp.func_native("warpcam::find_horizon(meshes, mesh, face);")
    def find(meshes: Meshes, mesh: int, face: int): ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        module_options=native_module("build/horizon_builder.h"),
    )
    def horizons(meshes: Meshes, owners: wp.array(dtype=wp.int32)):
        i = wp.tid()
        mesh = owners[i]
        find(meshes, mesh, i - meshes.face_start[mesh] // 3)

    return horizons


def uses_horizon_maps(device: wp.Device) -> bool:
    """Return whether scenes of the device have horizon maps.

    A CPU core takes longer to compute them than to build trees.
    """
    return bool(device.is_cuda)


def build_horizon_maps(meshes: Meshes, owners: np.ndarray, device: wp.Device) -> None:
    """Write the horizons of all faces of all meshes into ``meshes.faces``.

    Args:
        meshes: What lies on ``device``; none of it moves, and no face is seen from behind.
        owners: Index of the mesh that each face of ``meshes.faces`` belongs to, or of one that shares it, (face,).
        device: Where to.
    """
    if len(owners):
        inputs = [meshes, wp.array(owners, dtype=wp.int32, device=device)]
        launch_kernel(kernel(), len(owners), inputs, device=device, block_dim=BLOCK_DIM)
