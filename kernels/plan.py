"""Choices of kernels that several passes share: which code a kernel is compiled with."""

from collections.abc import Set

import warp as wp

from .types import (
    BARREL,
    BOX,
    CAPSULE,
    CONE,
    CYLINDER,
    ELLIPSOID,
    LOOKS_ALONE,
    PLANE,
    SPHERE,
)

# Shape types that CPU kernels have together. With few sets scenes share kernels, and the loop over the shapes of a tile
# takes one branch for all its lanes.
CPU_SETS = (frozenset({PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX}), frozenset({CONE, BARREL}))


def type_bits(shape_types: Set[int], device: wp.Device, *, appearance: bool = False) -> int:
    """Return the bits of the shape types and marks that a kernel is compiled for.

    CUDA kernels have just the types of the scene, as further ones cost registers. CPU kernels have sets of types.

    Args:
        shape_types: Types and marks of the scene: constants of types.py.
        device: Device of the kernel.
        appearance: Whether the kernel shades, and needs the marks of textures and normals.
    """
    types = set(shape_types if appearance else shape_types - LOOKS_ALONE)
    if device.is_cpu:
        analytic, others = CPU_SETS
        if not others.isdisjoint(types):
            types |= analytic | others
        elif not analytic.isdisjoint(types):
            types |= analytic
    return sum(1 << each for each in types)
