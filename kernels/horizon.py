"""What a mesh's own faces hide of the sky from each of them: see native/horizon.h."""

import functools

import warp as wp

from .launch import native_module
from .types import Meshes


@functools.cache
def _kernel() -> wp.Kernel:
    @wp.func_native("warpcam::find_horizon(meshes, mesh, face);")
    def find(meshes: Meshes, mesh: int, face: int): ...

    @wp.kernel(
        module="unique", enable_backward=False, grid_stride=False, module_options=native_module("horizon_build.h")
    )
    def horizons(meshes: Meshes, mesh: wp.int32):
        find(meshes, mesh, wp.tid())

    return horizons


def are_kept(device: wp.Device) -> bool:
    """Whether scenes of the device have horizons: finding them takes a core of a CPU longer than building trees."""
    return bool(device.is_cuda)


def find_horizons(meshes: Meshes, mesh: int, num_faces: int, device: wp.Device) -> None:
    """Write the horizons of all faces of a mesh into ``meshes.faces``.

    Args:
        meshes: What lies on ``device``; none of it moves, and no face is seen from behind.
        mesh: Index of the mesh. Others that share its faces share their horizons.
        num_faces: Those in its leaves.
        device: Where to.
    """
    wp.launch(_kernel(), num_faces, [meshes, mesh], device=device)
