"""Light on a surface: the fixed-function lighting that MuJoCo's renderer uses.

A light gives ``attenuation * spot * (ambient * colour + max(n.l, 0) * diffuse * colour + [n.l > 0] * max(n.h, 0)^e *
specular)``; h is halfway between the directions to the light and to the centre of projection. Emission and the
light that is everywhere come on top. A textured surface multiplies all of it, highlights included, by its texture.
"""

import functools
from typing import Any

import warp as wp

from .surface import Finish
from .types import LIGHT_DIRECTIONAL, LIGHT_SPOT, Lights

# OpenGL has this many lights, and so has MuJoCo's renderer: the headlight, where it shines, and the first active ones.
MAX_LIGHTS = 8


@wp.struct
class Lit:
    """What a surface sends to the camera, before its texture."""

    linear: wp.vec3  # all of it
    # What a display has of it: the sum clipped to [0, 1]. With shadows each light that casts one is drawn on its own:
    # it is clipped, textured and then added to the rest, so that the sum can pass 1 where the texture is dark.
    display: wp.vec3


@wp.func
def clip(color: wp.vec3) -> wp.vec3:
    """``color`` as far as a display shows it."""
    return wp.vec3(wp.clamp(color[0], 0.0, 1.0), wp.clamp(color[1], 0.0, 1.0), wp.clamp(color[2], 0.0, 1.0))


@wp.func
def reflect_light(
    finish: Finish,
    normal: wp.vec3,
    to_light: wp.vec3,
    to_eye: wp.vec3,
    ambient: wp.vec3,
    diffuse: wp.vec3,
    specular: wp.vec3,
) -> wp.vec3:
    """What a light of the given colours from the unit direction ``to_light`` adds."""
    color = wp.vec3(finish.color[0], finish.color[1], finish.color[2])
    facing = wp.dot(normal, to_light)
    result = wp.cw_mul(ambient, color)
    if facing > 0.0:
        result += facing * wp.cw_mul(diffuse, color)
        halfway = wp.max(wp.dot(normal, wp.normalize(to_light + to_eye)), 0.0)
        result += wp.pow(halfway, 128.0 * finish.shininess) * finish.specular * specular
    return result


@wp.func
def spot_strength(
    to_light: wp.vec3,
    distance: wp.float32,
    direction: wp.vec3,
    attenuation: wp.vec3,
    cutoff: wp.float32,
    exponent: wp.float32,
) -> wp.float32:
    """A spot light's strength at ``distance`` [m] in the direction from which it shines, ``-to_light``."""
    falloff = attenuation[0] + distance * (attenuation[1] + distance * attenuation[2])
    strength = 1.0 / wp.max(falloff, 1.0e-12)
    if cutoff < 180.0:
        along = -wp.dot(to_light, direction)
        if along < wp.cos(wp.radians(cutoff)):
            strength = 0.0
        else:
            strength *= wp.pow(wp.max(along, 0.0), exponent)
    return strength


@functools.cache
def make_illuminate(num_lights: int, shadows: bool) -> Any:
    """``(lights, world, position, normal, eye, forward, finish, shadow) -> Lit``, in the world frame.

    ``eye`` is the centre of projection and ``forward`` the camera's unit direction, along which its headlight shines.
    Bit l of ``shadow`` says that light l, of the first 32, does not reach ``position``; without ``shadows`` it is not
    looked at.
    """

    @wp.func
    def illuminate(
        lights: Lights,
        world: wp.int32,
        position: wp.vec3,
        normal: wp.vec3,
        eye: wp.vec3,
        forward: wp.vec3,
        finish: Finish,
        shadow: wp.int32,
    ):
        color = wp.vec3(finish.color[0], finish.color[1], finish.color[2])
        to_eye = wp.normalize(eye - position)
        steady = finish.emission * color
        steady += reflect_light(
            finish, normal, -forward, to_eye, lights.headlight[0], lights.headlight[1], lights.headlight[2]
        )
        # Light that is everywhere stands in for lights where there are none.
        everywhere = lights.global_ambient
        slots = wp.int32(MAX_LIGHTS)
        if wp.length_sq(lights.headlight[0] + lights.headlight[1] + lights.headlight[2]) > 0.0:
            everywhere = 0.0
            slots -= 1
        casting = wp.vec3()
        casting_display = wp.vec3()
        if wp.static(num_lights > 0):
            for light in range(lights.types.shape[1]):
                kind = lights.types[world % lights.types.shape[0], light]
                lit = lights.active[world % lights.active.shape[0], light]
                if lit:
                    slots -= 1
                if lit and (kind == LIGHT_DIRECTIONAL or kind == LIGHT_SPOT):
                    everywhere = 0.0
                    lit = slots >= 0
                    casts = wp.bool(False)
                    if wp.static(shadows):
                        casts = lights.casts_shadow[world % lights.casts_shadow.shape[0], light]
                        if light < 32:
                            lit = lit and (shadow & (1 << light)) == 0
                    if lit:
                        direction = lights.directions[world % lights.directions.shape[0], light]
                        to_light = -direction
                        strength = wp.float32(1.0)
                        if kind == LIGHT_SPOT:
                            offset = lights.positions[world % lights.positions.shape[0], light] - position
                            distance = wp.length(offset)
                            to_light = offset / wp.max(distance, 1.0e-12)
                            strength = spot_strength(
                                to_light,
                                distance,
                                direction,
                                lights.attenuation[world % lights.attenuation.shape[0], light],
                                lights.cutoff[world % lights.cutoff.shape[0], light],
                                lights.exponent[world % lights.exponent.shape[0], light],
                            )
                        if strength > 0.0:
                            added = strength * reflect_light(
                                finish,
                                normal,
                                to_light,
                                to_eye,
                                lights.ambient[world % lights.ambient.shape[0], light],
                                lights.diffuse[world % lights.diffuse.shape[0], light],
                                lights.specular[world % lights.specular.shape[0], light],
                            )
                            if casts:
                                casting += added
                                casting_display += clip(added)
                            else:
                                steady += added
        steady += everywhere * color
        result = Lit()
        result.linear = steady + casting
        result.display = clip(steady) + casting_display
        return result

    return illuminate
