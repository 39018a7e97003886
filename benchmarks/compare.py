"""Comparison of a renderer's images with another's."""

from collections.abc import Sequence

import numpy as np

# Of one camera: output and its pixels, (world, height, width) or, for rgb, (world, height, width, 3) uint8.
Images = dict[str, np.ndarray]

# A pixel's depths differ when they are further apart than this.
DEPTH_ABSOLUTE = 1e-3  # [m]
DEPTH_RELATIVE = 1e-3


def difference(images: Sequence[Images], reference: Sequence[Images]) -> dict[str, float]:
    """The differences of all cameras' images, over all their pixels together."""
    found: dict[str, float] = {}
    if "segmentation" in reference[0]:
        found |= geometry(images, reference)
    elif "depth" in reference[0]:
        found |= geometry(*map(hits_as_ids, (images, reference)))
    if "rgb" in reference[0]:
        found |= colors(images, reference)
    return found


def hits_as_ids(images: Sequence[Images]) -> list[Images]:
    """Convert hits to ids without ids: all hits are one object."""
    return [{**one, "segmentation": np.where(np.isfinite(one["depth"]), 0, -1)} for one in images]


def geometry(images: Sequence[Images], reference: Sequence[Images]) -> dict[str, float]:
    pixels = ids_differ = depth_differs = hits = 0
    largest = largest_same = 0.0
    for ours, theirs in zip(images, reference, strict=True):
        depth, ids, depth_ref, ids_ref = ours["depth"], ours["segmentation"], theirs["depth"], theirs["segmentation"]
        hit, hit_ref = ids != -1, ids_ref != -1
        both = hit & hit_ref
        gap = np.abs(np.where(both, depth, 0.0) - np.where(both, depth_ref, 0.0))
        tolerance = DEPTH_ABSOLUTE + DEPTH_RELATIVE * np.where(both, depth_ref, 0.0)
        pixels += ids.size
        hits += int(hit_ref.sum())
        ids_differ += int((ids != ids_ref).sum())
        depth_differs += int(((gap > tolerance) | (hit != hit_ref)).sum())
        largest = max(largest, float(gap.max(initial=0.0)))
        largest_same = max(largest_same, float(gap[both & (ids == ids_ref)].max(initial=0.0)))
    return {
        "pixels": pixels,
        "hit_fraction": hits / pixels,
        "ids_mismatch": ids_differ / pixels,
        "depth_mismatch": depth_differs / pixels,
        "depth_max_error_m": largest,
        "depth_max_error_same_id_m": largest_same,
    }


def colors(images: Sequence[Images], reference: Sequence[Images]) -> dict[str, float]:
    gap = np.concatenate(
        [(ours["rgb"].astype(np.int16) - theirs["rgb"]).ravel() for ours, theirs in zip(images, reference, strict=True)]
    )
    square = float(np.mean(gap.astype(np.float32) ** 2))
    return {
        "rgb_mean_difference": float(np.abs(gap).mean()),  # of 255
        "rgb_psnr_db": float(10.0 * np.log10(255.0**2 / max(square, 1e-6))),
    }
