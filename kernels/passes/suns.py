"""The stage that adds the suns of images of light from all around to a scene's lights, once a frame."""

from typing import Any

import numpy as np
import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import LIGHT_DIRECTIONAL, Lights, Physical

wp.set_module_options(compiler_flags())

DIRECTIONAL = wp.constant(LIGHT_DIRECTIONAL)
LIGHT_ARRAYS = ("types", "active", "casts_shadow", "positions", "directions", "attenuation", "cutoff", "exponent",
                "ambient", "diffuse", "specular")  # fmt: skip
SIZE_ARRAYS = ("forms", "sizes", "rotations")  # of Physical


@wp.struct
class EnvironmentSuns:
    """The sun of each image, in the image's axes."""

    directions: wp.array(dtype=wp.vec3)  # (image,) towards it, unit
    colors: wp.array(dtype=wp.vec3)  # (image,) what a white surface that faces it shows; 0: the image has none
    sizes: wp.array(dtype=wp.float32)  # (image,) squared sine of the angle from its middle to its edge


@wp.func
def put_sun(suns: EnvironmentSuns, rows: wp.array2d(dtype=wp.vec4), lit: Physical, world: wp.int32):
    """Write a world's sun; `rows`: EnvironmentMaps.rows."""
    first, second, third, gain = rows[world, 0], rows[world, 1], rows[world, 2], rows[world, 3]
    image = int(first[3])
    shines = image >= 0
    direction = wp.vec3(0.0, 0.0, -1.0)
    color = wp.vec3(0.0)
    size = wp.float32(0.0)
    if shines:
        d = suns.directions[image]
        direction = -wp.vec3(
            d[0] * first[0] + d[1] * second[0] + d[2] * third[0],
            d[0] * first[1] + d[1] * second[1] + d[2] * third[1],
            d[0] * first[2] + d[1] * second[2] + d[2] * third[2],
        )
        color = wp.cw_mul(wp.vec3(gain[0], gain[1], gain[2]), suns.colors[image])
        size = suns.sizes[image]
    lit.plain.types[world, 0] = DIRECTIONAL
    lit.plain.active[world, 0] = wp.length(color) > 0.0
    lit.plain.casts_shadow[world, 0] = True
    lit.plain.positions[world, 0] = wp.vec3(0.0)
    lit.plain.directions[world, 0] = direction
    lit.plain.attenuation[world, 0] = wp.vec3(1.0, 0.0, 0.0)
    lit.plain.cutoff[world, 0] = 180.0
    lit.plain.exponent[world, 0] = 0.0
    lit.plain.ambient[world, 0] = wp.vec3(0.0)
    lit.plain.diffuse[world, 0] = color
    lit.plain.specular[world, 0] = color
    lit.forms[world, 0] = 0
    lit.sizes[world, 0] = wp.vec3(size, 0.0, 0.0)
    lit.rotations[world, 0] = wp.identity(n=3, dtype=wp.float32)


@wp.kernel(enable_backward=False)
def place_suns(scene: Physical, suns: EnvironmentSuns, rows: wp.array2d(dtype=wp.vec4), lit: Physical, first: wp.int32):
    """The sun comes first, so that it has a slot whatever the number of lights is."""
    number = first + wp.tid()
    count = lit.plain.types.shape[1]
    world = number // count
    to = number - world * count
    light = to - 1
    if to == 0:
        put_sun(suns, rows, lit, world)
        return
    lights = scene.plain
    lit.plain.types[world, to] = lights.types[world % lights.types.shape[0], light]
    lit.plain.active[world, to] = lights.active[world % lights.active.shape[0], light]
    lit.plain.casts_shadow[world, to] = lights.casts_shadow[world % lights.casts_shadow.shape[0], light]
    lit.plain.positions[world, to] = lights.positions[world % lights.positions.shape[0], light]
    lit.plain.directions[world, to] = lights.directions[world % lights.directions.shape[0], light]
    lit.plain.attenuation[world, to] = lights.attenuation[world % lights.attenuation.shape[0], light]
    lit.plain.cutoff[world, to] = lights.cutoff[world % lights.cutoff.shape[0], light]
    lit.plain.exponent[world, to] = lights.exponent[world % lights.exponent.shape[0], light]
    lit.plain.ambient[world, to] = lights.ambient[world % lights.ambient.shape[0], light]
    lit.plain.diffuse[world, to] = lights.diffuse[world % lights.diffuse.shape[0], light]
    lit.plain.specular[world, to] = lights.specular[world % lights.specular.shape[0], light]
    lit.forms[world, to] = scene.forms[world % scene.forms.shape[0], light]
    lit.sizes[world, to] = scene.sizes[world % scene.sizes.shape[0], light]
    lit.rotations[world, to] = scene.rotations[world % scene.rotations.shape[0], light]


def make_suns(directions: np.ndarray, colors: np.ndarray, sizes: np.ndarray, device: wp.Device) -> Any:
    """EnvironmentSuns of arrays on the host."""
    suns: Any = EnvironmentSuns()
    suns.directions = wp.array(directions, dtype=wp.vec3, device=device)
    suns.colors = wp.array(colors, dtype=wp.vec3, device=device)
    suns.sizes = wp.array(sizes, dtype=wp.float32, device=device)
    return suns


def with_suns(physical: Any, worlds: int, device: wp.Device) -> Any:
    """Physical whose lights have room for a sun before all others; shadows of all of them reach everywhere."""
    lights: Any = Lights()
    lights.assign(physical.plain)
    lit: Any = Physical()
    lit.assign(physical)
    shape = (worlds, physical.plain.types.shape[1] + 1)
    for struct, scene, names in ((lights, physical.plain, LIGHT_ARRAYS), (lit, physical, SIZE_ARRAYS)):
        for name in names:
            setattr(struct, name, wp.zeros(shape, dtype=getattr(scene, name).dtype, device=device))
    lights.shadow_width = lights.shadow_near = lights.shadow_gap = 0.0
    lit.plain = lights
    return lit


def bind_suns(physical: Any, suns: Any, rows: wp.array, lit: Any, device: wp.Device) -> Stage:
    """Bind the stage, after that which places the images.

    Args:
        physical: Physical of the scene, whose lights are read.
        suns: EnvironmentSuns.
        rows: vec4, (world, ROWS): EnvironmentMaps.rows.
        lit: Physical of ``with_suns``; written.
        device: Where all of these lie.
    """
    worlds, count = lit.plain.types.shape
    return bind_launch(place_suns, worlds * count, [physical, suns, rows, lit], device)
