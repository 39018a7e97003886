"""The renderers that are measured side by side, one file each. `create` in each gives a `Peer`."""

from typing import Protocol

import numpy as np

# Command-line name and module. The first that runs is what the others' images are compared with.
PEERS = {"mujoco_warp": "peers.mujoco_warp", "warpcam": "peers.ours", "newton": "peers.newton"}


class Peer(Protocol):
    """A renderer set up for one problem; `frame` works on the poses the problem's data holds now."""

    variants: tuple[str, ...]  # ways to render the same frame; the fastest counts

    def pull_poses(self) -> None:
        """Take the problem's poses over, for a renderer of another simulator. Not timed: it owns its poses."""

    def frame(self, variant: str) -> None:
        """Everything a new frame takes on the device, refitting included: depth and ids of every camera."""

    def images(self, worlds: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of each camera, for the first worlds: planar depth, inf = miss [m], and geom ids, -1 = miss."""
