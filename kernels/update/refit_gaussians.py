"""Clouds of Gaussians that change in place: rows and boxes of all, and their trees from the leaves up."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.kernels.passes.views import rotation_of
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())
ABSENT = wp.constant(1.0e30)  # bounds of a child that is not there


@wp.struct
class GaussianArrays:
    """Gaussians in a user's order, of all clouds one after another."""

    positions: wp.array(dtype=wp.vec3)  # in their cloud's frame [m]
    rotations: wp.array(dtype=wp.vec4)  # quaternions w x y z of any length but 0
    scales: wp.array(dtype=wp.vec3)  # standard deviations along the axes [m]
    colors: wp.array(dtype=wp.vec4)  # display colour, opacity
    least_alpha: wp.float32  # where a Gaussian ends


@wp.struct
class GaussianTrees:
    """What is written: see Splats in kernels/types.py."""

    order: wp.array(dtype=wp.int32)
    gaussians: wp.array(dtype=wp.vec4)
    nodes: wp.array(dtype=wp.vec4)
    clouds: wp.array(dtype=wp.vec4)
    lower: wp.array(dtype=wp.vec3)  # (gaussian,) box, in leaf order
    upper: wp.array(dtype=wp.vec3)
    node_lower: wp.array(dtype=wp.vec3)  # (node,) box
    node_upper: wp.array(dtype=wp.vec3)
    ascending: wp.array(dtype=wp.int32)  # (node,) nodes, the deepest first
    codes: wp.array2d(dtype=wp.int32)  # (node, 4) children as nodes have them
    present: wp.array2d(dtype=wp.uint8)  # (node, 4) which of them are there
    first_nodes: wp.array(dtype=wp.int32)  # (node,) first node of the node's cloud
    first_gaussians: wp.array(dtype=wp.int32)  # (node,) first Gaussian of it


@wp.kernel(enable_backward=False)
def write_gaussians(live: GaussianArrays, out: GaussianTrees, first: wp.int32):
    row = first + wp.tid()
    i = out.order[row]
    center, turn, scale, color = live.positions[i], live.rotations[i], live.scales[i], live.colors[i]
    alpha = color[3]
    total = wp.dot(center, center) + wp.dot(scale, scale) + wp.dot(color, color) + wp.dot(turn, turn)
    empty = wp.vec3(ABSENT, ABSENT, ABSENT)
    if wp.min(scale) > 0.0 and wp.length(turn) > 0.0 and alpha > live.least_alpha and wp.isfinite(total):
        axes = rotation_of(turn)
        radii = scale * wp.sqrt(2.0 * wp.log(alpha / live.least_alpha))
        half = wp.vec3(0.0, 0.0, 0.0)
        for k in range(3):
            axis = wp.vec3(axes[0, k], axes[1, k], axes[2, k])
            scaled = axis / radii[k]
            out.gaussians[4 * row + k] = wp.vec4(scaled[0], scaled[1], scaled[2], center[k])
            half += wp.cw_mul(axis * radii[k], axis * radii[k])
        half = wp.vec3(wp.sqrt(half[0]), wp.sqrt(half[1]), wp.sqrt(half[2])) * (1.0 + 1.0e-6)
        half += 1.0e-6 * (wp.abs(center) + half)
        out.lower[row] = center - half
        out.upper[row] = center + half
    else:  # met by no ray
        for k in range(3):
            out.gaussians[4 * row + k] = wp.vec4(0.0, 0.0, 0.0, 0.0)
        out.lower[row] = empty
        out.upper[row] = -empty
    out.gaussians[4 * row + 3] = color


@wp.kernel(enable_backward=False)
def refit_nodes(out: GaussianTrees, first: wp.int32):
    """Write boxes of the nodes of one level, whose children are finished."""
    node = out.ascending[first + wp.tid()]
    whole_lower = wp.vec3(ABSENT, ABSENT, ABSENT)
    whole_upper = -whole_lower
    for k in range(4):
        if out.present[node, k] != wp.uint8(0):
            code = out.codes[node, k]
            low = wp.vec3(ABSENT, ABSENT, ABSENT)
            high = -low
            if code >= 0:
                low = out.node_lower[out.first_nodes[node] + code]
                high = out.node_upper[out.first_nodes[node] + code]
            else:
                leaf = -(code + 1)
                begin = out.first_gaussians[node] + (leaf >> 4)
                for i in range(begin, begin + (leaf & 15)):
                    low = wp.min(low, out.lower[i])
                    high = wp.max(high, out.upper[i])
            whole_lower = wp.min(whole_lower, low)
            whole_upper = wp.max(whole_upper, high)
            if low[0] > high[0]:
                high = low
            row = 8 * node + 2 * k
            out.nodes[row] = wp.vec4(low[0], low[1], low[2], out.nodes[row][3])
            out.nodes[row + 1] = wp.vec4(high[0], high[1], high[2], out.nodes[row + 1][3])
    out.node_lower[node] = whole_lower
    out.node_upper[node] = whole_upper


@wp.kernel(enable_backward=False)
def write_extents(roots: wp.array(dtype=wp.int32), out: GaussianTrees, first: wp.int32):
    cloud = first + wp.tid()
    low, high = out.node_lower[roots[cloud]], out.node_upper[roots[cloud]]
    head = out.clouds[cloud]
    extent = wp.where(low[0] > high[0], 0.0, wp.max(wp.max(wp.abs(low)), wp.max(wp.abs(high))))
    out.clouds[cloud] = wp.vec4(head[0], head[1], extent, head[3])


def bind_refit_gaussians(live: Any, splats: Any, device: wp.Device) -> list[Stage]:
    """Bind the stages that write clouds from changed Gaussians, all of which ``splats.order`` has.

    Args:
        live: ``GaussianArrays``.
        splats: The table of the clouds.
        device: Of both. This waits for it.
    """
    if splats.order.shape[0] == 0:
        return []
    heads = splats.clouds.numpy().view(np.int32)[:, :2]
    nodes = splats.nodes.numpy().reshape(-1, 4, 2, 4)
    codes = np.ascontiguousarray(nodes[:, :, 0, 3]).view(np.int32)
    present = nodes[:, :, 0, 0] < float(ABSENT)
    clouds = np.searchsorted(heads[:, 0], np.arange(len(nodes)), side="right") - 1
    levels = _levels(heads[:, 0], codes, present, clouds)
    out = GaussianTrees()
    out.order, out.gaussians, out.nodes, out.clouds = splats.order, splats.gaussians, splats.nodes, splats.clouds
    for name, count in (("", splats.order.shape[0]), ("node_", len(nodes))):
        for bound in ("lower", "upper"):
            setattr(out, name + bound, wp.zeros(count, dtype=wp.vec3, device=device))
    ascending = np.concatenate([*levels[::-1], np.zeros(0, np.int64)])
    for name, values in {
        "ascending": ascending,
        "codes": codes,
        "first_nodes": heads[clouds, 0],
        "first_gaussians": heads[clouds, 1],
    }.items():
        setattr(out, name, wp.array(np.ascontiguousarray(values, np.int32), dtype=wp.int32, device=device))
    out.present = wp.array(present.astype(np.uint8), dtype=wp.uint8, device=device)
    roots = wp.array(heads[:, 0], dtype=wp.int32, device=device)
    stages, start = [bind_launch(write_gaussians, splats.order.shape[0], [live, out], device)], 0
    for level in levels[::-1]:
        stages.append(bind_launch(refit_nodes, len(level), [out], device, start=start))
        start += len(level)
    return [*stages, bind_launch(write_extents, len(heads), [roots, out], device)]


def _levels(roots: np.ndarray, codes: np.ndarray, present: np.ndarray, clouds: np.ndarray) -> Sequence[np.ndarray]:
    """Nodes of all trees by their distance from the root."""
    levels = [roots.astype(np.int64)]
    while len(levels[-1]):
        here = levels[-1]
        children = roots[clouds[here], None] + codes[here]
        levels.append(children[present[here] & (codes[here] >= 0)])
    return levels[:-1]
