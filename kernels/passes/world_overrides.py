"""Per-world overrides beside the tables of types.py. Only scenes and cameras that ask for them pay."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())


@wp.struct
class WorldOverrides:
    """Arrays that are read where the scene or the camera has such a feature; else they may be empty."""

    texture_offsets: wp.array2d(dtype=wp.vec2)  # (world*, material) added to u and v, which is down [images]
    backgrounds: wp.array(dtype=wp.vec3)  # (world*,) display colour
    skyboxes: wp.array(dtype=wp.int32)  # (world*,) index of a cube texture, or -1
    exposures: wp.array(dtype=wp.float32)  # (world,) power of two that all light is multiplied by
    gains: wp.array(dtype=wp.vec3)  # (world,) factors of red, green and blue


def empty_overrides(device: wp.Device) -> WorldOverrides:
    overrides = WorldOverrides()
    overrides.texture_offsets = wp.empty((0, 0), dtype=wp.vec2, device=device)
    overrides.backgrounds = wp.empty(0, dtype=wp.vec3, device=device)
    overrides.skyboxes = wp.empty(0, dtype=wp.int32, device=device)
    overrides.exposures = wp.empty(0, dtype=wp.float32, device=device)
    overrides.gains = wp.empty(0, dtype=wp.vec3, device=device)
    return overrides


def copy_overrides(overrides: Any) -> WorldOverrides:
    """Another struct of the same arrays."""
    other = WorldOverrides()
    for name in ("texture_offsets", "backgrounds", "skyboxes", "exposures", "gains"):
        setattr(other, name, getattr(overrides, name))
    return other


def without_background(overrides: Any, device: wp.Device) -> Any:
    """Return the overrides with the scene's one background."""
    if overrides is None or not overrides.skyboxes.size:
        return overrides
    other, empty = copy_overrides(overrides), empty_overrides(device)
    other.backgrounds, other.skyboxes = empty.backgrounds, empty.skyboxes
    return other


@wp.kernel(enable_backward=False)
def scale_lights(
    colors: wp.array2d(dtype=wp.vec3),
    intensities: wp.array2d(dtype=wp.float32),
    dimmed: wp.array2d(dtype=wp.vec3),
    lights: wp.int32,
    first: wp.int32,
):
    world, light = row_and_column(first + wp.tid(), lights)
    dimmed[world, light] = intensities[world, light] * colors[world % colors.shape[0], light]


@wp.kernel(enable_backward=False)
def replace_shape_colors(
    source: wp.array2d(dtype=wp.vec4),
    own: wp.array2d(dtype=wp.vec4),
    painted: wp.array2d(dtype=wp.vec4),
    shapes: wp.int32,
    first: wp.int32,
):
    world, shape = row_and_column(first + wp.tid(), shapes)
    color = own[world, shape]
    if source[world % source.shape[0], shape][3] == 0.0:
        color[3] = 0.0
    painted[world, shape] = color


def bind_light_intensity(colors: wp.array, intensities: wp.array, dimmed: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that multiplies colours of lights by their intensities.

    Args:
        colors: vec3, (world*, light).
        intensities: float32, (world, light).
        dimmed: vec3, (world, light); written.
        device: Where all of these lie.
    """
    return bind_launch(scale_lights, dimmed.size, [colors, intensities, dimmed, dimmed.shape[1]], device)


def bind_shape_colors(source: wp.array, own: wp.array, painted: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that paints shapes, but for those that their source hides.

    Args:
        source: RGBA, vec4 (world*, shape), as the source has it.
        own: RGBA, vec4 (world, shape), in its place.
        painted: Likewise; written.
        device: Where all of these lie.
    """
    return bind_launch(replace_shape_colors, painted.size, [source, own, painted, painted.shape[1]], device)
