"""The stage that keeps images of which each texel is the colour of one triangle."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def write_triangle_colors(
    colors: wp.array(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.int32),
    places: wp.array(dtype=wp.int32),
    texels: wp.array(dtype=wp.uint32),
    first: wp.int32,
):
    index = first + wp.tid()
    color = colors[triangles[index]]
    packed = wp.uint32(255)
    for channel in range(2, -1, -1):
        packed = (packed << wp.uint32(8)) | wp.uint32(255.0 * wp.clamp(color[channel], 0.0, 1.0) + 0.5)
    texels[places[index]] = packed


def bind_triangle_colors(
    colors: wp.array, triangles: wp.array, places: wp.array, texels: wp.array, device: wp.Device
) -> Stage:
    """Bind the stage.

    Args:
        colors: (triangle,) vec3, display colours; what lies beyond [0, 1] is cut off.
        triangles: (texel,) int32.
        places: (texel,) int32, in ``texels``.
        texels: As ``Textures`` has them.
        device: Where all of these lie.
    """
    return bind_launch(write_triangle_colors, triangles.shape[0], [colors, triangles, places, texels], device)
