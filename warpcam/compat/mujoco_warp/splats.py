"""Gaussians of ``create_render_context``, drawn as MuJoCo-Warp draws them."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import warp as wp

import warpcam as wc
from warpcam.compat.mujoco_warp.arguments import SPLATS, WHERE
from warpcam.core.errors import WarpcamError
from warpcam.core.torch_interop import to_numpy
from warpcam.kernels.update.refit_gaussians import GaussianArrays

ATTRIBUTES = {"splat_position": 3, "splat_rotation": 4, "splat_scale": 3, "splat_rgba": 4}  # numbers of a Gaussian


class ContextSplats(wc.Splats):
    """Groups of Gaussians that end at an alpha of 0.01 alone, and are a surface where they are opaque."""

    least_response: ClassVar[float] = 1e-6
    least_alpha: ClassVar[float] = 0.01
    opaque: ClassVar[bool] = True
    changes: ClassVar[bool] = True


def gaussians_of(splats: Sequence[wc.Splats]) -> Any:
    """The Gaussians as arrays of Warp's current device, ``GaussianArrays``, which a user may write."""
    clouds = [cloud for each in splats for cloud in each.listed()]
    arrays = GaussianArrays()
    empty = {"positions": 3, "rotations": 4, "scales": 3, "colors": 3, "opacities": 1}
    joined = {
        name: np.concatenate([np.zeros((0, width)), *(np.reshape(cloud[name], (-1, width)) for cloud in clouds)])
        for name, width in empty.items()
    }
    arrays.positions = wp.array(joined["positions"], dtype=wp.vec3)
    arrays.rotations = wp.array(joined["rotations"], dtype=wp.vec4)
    arrays.scales = wp.array(joined["scales"], dtype=wp.vec3)
    arrays.colors = wp.array(np.concatenate((joined["colors"], joined["opacities"]), axis=1), dtype=wp.vec4)
    arrays.least_alpha = ContextSplats.least_alpha
    return arrays


def read_splats(settings: dict[str, Any]) -> list[wc.Splats]:
    """The groups of the arguments ``splat_*``; none where there are no Gaussians."""
    given = [name for name in SPLATS if settings[name] is not None]
    missing = [name for name in ATTRIBUTES if name not in given]
    if not given:
        return []
    if missing:
        raise WarpcamError(
            f"{WHERE}: {', '.join(given)} came without {', '.join(missing)}; they are needed together, or all None"
        )
    arrays = {name: _array(name, settings[name], np.float32) for name in ATTRIBUTES}
    count = len(arrays["splat_position"]) if arrays["splat_position"].ndim else 0
    for name, width in ATTRIBUTES.items():
        if arrays[name].shape != (count, width):
            raise WarpcamError(f"{WHERE}: {name} must have shape ({count}, {width}), got {arrays[name].shape}")
    starts = _starts(settings["splat_adr"], count)
    groups = _array("splat_group_id", settings["splat_group_id"], np.int64, np.zeros(settings["nworld"], np.int64))
    last = len(starts) - 2
    if groups.shape != (settings["nworld"],) or not ((groups >= 0) & (groups <= last)).all():
        raise WarpcamError(
            f"{WHERE}: splat_group_id must have a group from 0 to {last} for each of {settings['nworld']} worlds, got "
            f"{settings['splat_group_id']!r}"
        )
    clouds = [
        {
            "positions": arrays["splat_position"][group],
            "rotations": arrays["splat_rotation"][group],
            "scales": arrays["splat_scale"][group],
            "colors": arrays["splat_rgba"][group, :3],
            "opacities": arrays["splat_rgba"][group, 3],
        }
        for group in (slice(start, end) for start, end in pairwise(starts))
    ]
    return [ContextSplats(clouds, choice=groups)]


def _starts(value: Any, count: int) -> list[int]:
    starts = _array("splat_adr", value, np.int64, np.array((0, count)))
    if starts.ndim != 1 or len(starts) < 2 or starts[0] != 0 or starts[-1] != count or (np.diff(starts) < 0).any():
        raise WarpcamError(f"{WHERE}: splat_adr must ascend from 0 to {count}, the number of Gaussians, got {value!r}")
    return [int(start) for start in starts]


def _array(name: str, value: Any, dtype: type, default: np.ndarray | None = None) -> np.ndarray:
    if value is None and default is not None:
        return default
    try:
        array = to_numpy(value)
        if array.dtype.kind not in ("iu" if dtype is np.int64 else "iuf"):
            raise TypeError
        with np.errstate(over="ignore"):  # what float32 cannot hold is not finite
            return array.astype(dtype)
    except (TypeError, ValueError, RuntimeError):
        needed = "whole numbers" if dtype is np.int64 else "numbers"
        raise WarpcamError(f"{WHERE}: {name} must be an array of {needed}, got {value!r}"[:300]) from None
