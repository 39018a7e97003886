"""The stage that takes vertices of visual meshes from an array of all, in place of skinning them."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def copy_visual_points(
    points: wp.array(dtype=wp.vec3),
    starts: wp.array(dtype=wp.int32),
    vertices: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    mesh, vertex = row_and_column(first + wp.tid(), vertices.shape[1])
    vertices[mesh, vertex] = points[starts[mesh] + vertex]


def bind_visual_points(points: wp.array, starts: wp.array, vertices: wp.array, device: wp.Device) -> Stage:
    """Bind the stage.

    Args:
        points: (point,) vec3, of all visual meshes of a model [m].
        starts: (mesh,) int32, the first point of each mesh.
        vertices: (mesh, vertex) vec3, where they go.
        device: Where all of these lie.
    """
    return bind_launch(copy_visual_points, vertices.size, [points, starts, vertices], device)
