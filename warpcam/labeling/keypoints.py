"""Keypoints: places on bodies that are looked for in images."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.scene.scene import Scene

FORM = "{name: (body, (x, y, z))}, a body by name or index, or None for the world"


@dataclass(frozen=True, eq=False)
class KeypointTable:
    """Keypoints in their order.

    Attributes:
        names: What the user calls them.
        bodies: (keypoint,) int32, or -1 for the world.
        offsets: (keypoint, 3) float32, in the body's frame [m].
    """

    names: tuple[str, ...]
    bodies: np.ndarray
    offsets: np.ndarray


def find_keypoints(scene: Scene, keypoints: Any) -> KeypointTable:
    """Keypoints as ``labels`` takes them.

    Raises:
        WarpcamError: They are not of that form, or the scene lacks a body.
    """
    given = {} if keypoints is None else keypoints
    if not isinstance(given, Mapping):
        raise WarpcamError(f"labels: keypoints must be {FORM}, got {keypoints!r}")
    bodies, offsets = [], []
    for name, value in given.items():
        where = f"labels: keypoints[{name!r}]"
        if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 2:
            raise WarpcamError(f"{where} must be (body, (x, y, z)), got {value!r}")
        body, offset = value
        bodies.append(-1 if body is None else scene.body(body, where))
        try:
            numbers = np.asarray(offset, np.float64)
        except (TypeError, ValueError):
            numbers = np.zeros(0)
        if numbers.shape != (3,) or not np.isfinite(numbers).all():
            raise WarpcamError(f"{where}: the place must be three finite numbers [m], got {offset!r}")
        offsets.append(numbers)
    return KeypointTable(
        tuple(given), np.array(bodies, np.int32), np.array(offsets, np.float32).reshape(len(bodies), 3)
    )


def site_keypoints(mjm: Any, sites: Sequence[str] | None = None) -> dict[str, tuple[int, tuple[float, float, float]]]:
    """Sites of a MuJoCo model as the keypoints of ``labels``: where the model has them on their bodies.

    Args:
        mjm: ``mujoco.MjModel``.
        sites: Names of the sites to take, in their order; None is all that have a name.

    Returns:
        By the site's name, its body's index and its place in the body's frame [m].

    Raises:
        WarpcamError: The model lacks a site.
    """
    known = {mjm.site(index).name: index for index in range(mjm.nsite)}
    known.pop("", None)
    if isinstance(sites, str) or not isinstance(sites, Sequence | None):
        raise WarpcamError(f"site_keypoints: sites must be names or None, got {sites!r}")
    chosen = known if sites is None else sites
    for name in chosen:
        if name not in tuple(known):
            raise WarpcamError(
                f"site_keypoints: sites has {name!r}, the model has {', '.join(map(repr, known)) or 'none'}"
            )
    found = {}
    for name in chosen:
        x, y, z = map(float, mjm.site_pos[known[name]])
        found[name] = (int(mjm.site_bodyid[known[name]]), (x, y, z))
    return found
