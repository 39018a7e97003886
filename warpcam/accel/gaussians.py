"""Clouds of Gaussians: checked, each with a tree, and packed into the few arrays that the kernels read."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from warpcam.accel.meshes import child_by_child
from warpcam.core.errors import WarpcamError
from warpcam.core.rotations import rotation_matrices
from warpcam.kernels.build import box_bvh4
from warpcam.kernels.types import Splats

MIN_ALPHA = 1.0 / 255.0  # what adds less is not drawn
MAX_CLOUDS = 128  # shapes of this type in a world
SMALLEST = 1e-12  # scale that Gaussians are taken to have at least [m]
MOST = 1e18  # that numbers of Gaussians are below
MAX_ROWS = 2**31 - 1
LINEAR = 16  # in the first row of a Gaussian's harmonics: see Splats in kernels/types.py


@dataclass(frozen=True, eq=False)
class GaussianCloud:
    """Gaussians as a source gives them.

    Attributes:
        name: For error messages.
        positions: (gaussian, 3) float32, centres in the frame that the shape's pose places [m].
        rotations: (gaussian, 4) float32, quaternions w x y z of any length but 0.
        scales: (gaussian, 3) float32, standard deviations along the axes [m].
        opacities: (gaussian,) float32, in [0, 1].
        colors: (gaussian, 3) float32, display colour, not below 0; with ``harmonics`` the part that is the same from
            all sides, any number.
        least_response: In (0, 1): where a Gaussian has fallen to this part of its peak it ends.
        least_alpha: In (0, 1): where its alpha falls to this it ends, too.
        harmonics: (gaussian, 3, 8 or 15, 3) float32, coefficients of real spherical harmonics of degrees 1, 2 and 3 in
            the direction of the ray in the cloud's frame, which add to the colour; None: it has none.
        changes: Whether its Gaussians may be written anew: then also those are kept that cannot be seen now.
        linear: Whether the sum of ``colors`` and ``harmonics`` is linear light, which is encoded for display.
    """

    name: str
    positions: np.ndarray
    rotations: np.ndarray
    scales: np.ndarray
    opacities: np.ndarray
    colors: np.ndarray
    least_response: float
    least_alpha: float = MIN_ALPHA
    harmonics: np.ndarray | None = None
    linear: bool = False
    changes: bool = False


@dataclass(frozen=True, eq=False)
class PackedGaussians:
    """Clouds on a device.

    Attributes:
        table: For the kernels.
        lower: (cloud, 3) float32, corner of the box [m].
        upper: (cloud, 3) float32; below ``lower`` where nothing can be seen.
    """

    table: Splats
    lower: np.ndarray
    upper: np.ndarray


def pack_gaussians(clouds: Sequence[GaussianCloud], columns: Sequence[int], device: wp.Device) -> PackedGaussians:
    """Build the tree of every cloud and put all of them on ``device``.

    Args:
        clouds: What ``shape_assets`` counts for shapes of type SPLATS.
        columns: The shapes of that type.
        device: Where the kernels run.

    Raises:
        WarpcamError: A cloud cannot be used; the message names it.
    """
    if len(columns) > MAX_CLOUDS:
        raise WarpcamError(f"splats: {len(columns)} shapes came, at most {MAX_CLOUDS} are allowed")
    heads, nodes, rows = np.zeros((len(clouds), 4), np.float32), [], []
    harmonic_rows = max([0, *(cloud.harmonics.shape[1] for cloud in clouds if cloud.harmonics is not None)])
    harmonics, places, given = [], [], 0
    lower, upper = np.zeros((len(clouds), 3), np.float32), np.full((len(clouds), 3), -1.0, np.float32)
    node_rows = num_gaussians = most = 0
    for index, cloud in enumerate(clouds):
        gaussians, low, high = _gaussians(cloud)
        order = np.zeros(0, np.int32)
        tree = np.zeros((8, 4), np.float32)
        tree[:, :3] = 1e30  # no children
        if len(gaussians):
            tree, order = box_bvh4.build(low, high)
            tree, gaussians = child_by_child(tree), gaussians[order]
            lower[index], upper[index] = low.min(axis=0), high.max(axis=0)
        heads[index].view(np.int32)[:2] = node_rows // 8, num_gaussians
        heads[index, 2] = max(np.abs(lower[index]).max(), np.abs(upper[index]).max())
        heads[index, 3] = -2.0 * np.log(cloud.least_response)
        nodes.append(tree)
        rows.append(gaussians.reshape(-1, 4))
        harmonics.append(_harmonics(cloud, order, harmonic_rows))
        places.append(order + given if cloud.changes else order[:0])
        given += len(cloud.positions)
        node_rows += len(tree)
        num_gaussians += len(gaussians)
        most = max(most, len(gaussians))
        if max(node_rows, max(4, harmonic_rows) * num_gaussians) > MAX_ROWS:
            raise WarpcamError(f"splats: up to '{cloud.name}' there are {num_gaussians} Gaussians; fewer are allowed")
    bits = max(most - 1, 0).bit_length()
    if bits + max(len(columns) - 1, 0).bit_length() > 32:
        raise WarpcamError(f"splats: {len(columns)} shapes of up to {most} Gaussians; product must be below 2^32")
    table = Splats()
    table.columns = wp.array(np.asarray(columns, np.int32), dtype=wp.int32, device=device)
    table.clouds = wp.array(heads, dtype=wp.vec4, device=device)
    table.nodes = wp.array(_joined(nodes), dtype=wp.vec4, device=device)
    table.gaussians = wp.array(_joined(rows), dtype=wp.vec4, device=device)
    table.harmonics = wp.array(_joined(harmonics), dtype=wp.vec4, device=device)
    table.order = wp.array(np.concatenate([np.zeros(0, np.int32), *places]), dtype=wp.int32, device=device)
    table.harmonic_rows, table.bits = harmonic_rows, bits
    return PackedGaussians(table, lower, upper)


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros((0, 4), np.float32), *parts])


def _gaussians(cloud: GaussianCloud) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows (gaussian, 4, 4) of those that can be seen, and corners of their boxes."""
    _check(cloud)
    seen = _seen(cloud)
    centers = cloud.positions[seen].astype(np.float64)
    opacities, scales = cloud.opacities[seen].astype(np.float64), cloud.scales[seen].astype(np.float64)
    opacities = np.maximum(opacities, (1.0 + 1e-6) * cloud.least_alpha)  # of those that are kept nevertheless
    reach = np.minimum(-2.0 * np.log(cloud.least_response), 2.0 * np.log(opacities / cloud.least_alpha))
    axes = rotation_matrices(cloud.rotations[seen].astype(np.float64))  # columns
    radii = np.maximum(scales, SMALLEST) * np.sqrt(reach)[:, None]
    rows = np.zeros((len(centers), 4, 4), np.float32)
    rows[:, :3, :3] = (axes / radii[:, None, :]).transpose(0, 2, 1)
    rows[:, :3, 3] = centers
    rows[:, 3, :3] = cloud.colors[seen]
    rows[:, 3, 3] = opacities
    half = np.sqrt(((axes * radii[:, None, :]) ** 2).sum(axis=2)) * (1.0 + 1e-6)
    margin = 1e-6 * (np.abs(centers) + half)
    return rows, (centers - half - margin).astype(np.float32), (centers + half + margin).astype(np.float32)


def _seen(cloud: GaussianCloud) -> np.ndarray:
    seen: np.ndarray = (cloud.opacities > cloud.least_alpha) & (cloud.scales > 0.0).all(axis=1)
    return seen | cloud.changes


def _harmonics(cloud: GaussianCloud, order: np.ndarray, rows: int) -> np.ndarray:
    """Rows (gaussian * rows, 4) of the Gaussians that can be seen, in leaf order: see Splats in kernels/types.py."""
    table = np.zeros((len(order), rows, 4), np.float32)
    if cloud.harmonics is not None and rows:
        count = cloud.harmonics.shape[1]
        table[:, :count, :3] = cloud.harmonics[_seen(cloud)][order]
        table.view(np.int32)[:, 0, 3] = count | (LINEAR if cloud.linear else 0)
    return table.reshape(-1, 4)


def _check(cloud: GaussianCloud) -> None:
    count = len(cloud.positions)
    shapes = {"positions": (count, 3), "rotations": (count, 4), "scales": (count, 3), "opacities": (count,)}
    if cloud.harmonics is not None:
        if cloud.harmonics.ndim != 3 or cloud.harmonics.shape[1] not in (3, 8, 15):
            raise WarpcamError(
                f"splats '{cloud.name}': harmonics must have shape ({count}, 3, 8 or 15, 3), got "
                f"{cloud.harmonics.shape}"
            )
        shapes["harmonics"] = (count, cloud.harmonics.shape[1], 3)
    for what, shape in {**shapes, "colors": (count, 3)}.items():
        values = getattr(cloud, what)
        if values.shape != shape:
            raise WarpcamError(f"splats '{cloud.name}': {what} must have shape {shape}, got {values.shape}")
        good = np.abs(values) < MOST
        if not good.all():
            row = int(np.argmin(good.reshape(count, -1).all(axis=1)))
            raise WarpcamError(
                f"splats '{cloud.name}': {what} must be finite and below {MOST:g}, got {values[row].tolist()} at "
                f"Gaussian {row}"
            )
    if not (np.linalg.norm(cloud.rotations, axis=1) > 0.0).all():
        raise WarpcamError(f"splats '{cloud.name}': rotations must be quaternions of any length but 0")
