"""The renderers that are measured side by side, one module each. `create` in each gives a `Peer`."""

import importlib
import importlib.util
from typing import Protocol, cast

from warpcam.benchmarks.cases import Setting, Wanted
from warpcam.benchmarks.compare import Images
from warpcam.benchmarks.problem import Problem
from warpcam.core.errors import WarpcamError

# Name, which is the package's, and module. The first that runs is what the others' images are compared with.
PEERS = {
    "mujoco_warp": "mujoco_warp",
    "warpcam": "warpcam_renderer",
    "newton": "newton",
    "mujoco_warp_pbr": "mujoco_warp_pbr",
    "mujoco": "mujoco_renderer",
}
INSTALL = {name: name.replace("_", "-") for name in PEERS}
# MuJoCo's own renderer draws one image after another: it is asked for few large ones.
FEW_WORLDS, LARGE_PIXELS = 16, 320 * 240
INSTALL["mujoco_warp_pbr"] += " (Python 3.12 or newer)"


COMPARED = frozenset(("rgb", "depth", "segmentation"))  # outputs whose images are compared


class Peer(Protocol):
    """A renderer set up for one problem; `frame` works on the poses it was placed in last."""

    variants: tuple[str, ...]  # ways to render the same frame; the fastest counts
    on_host: bool  # a frame is work of the host, which no graph can hold
    lacks: tuple[str, ...]  # what of the scene it cannot show in these outputs
    told_memory_mb: float | None  # what it said that it would take before it took it, if it says so

    def prepare(self, wanted: Wanted) -> None:
        """Set up for these outputs."""

    def release(self) -> None:
        """Let go of what was set up for outputs, and its memory."""

    def place(self, index: int) -> None:
        """Put every world into its pose of this set. Can be captured; not timed: a simulator does that."""

    def frame(self, variant: str) -> None:
        """Everything a new frame takes on the device, refitting included."""

    def images(self, worlds: int) -> list[Images]:
        """Return each camera's images of the first worlds: planar depth, inf = miss [m]; geom ids, -1 = miss; rgb."""


def installed() -> list[str]:
    return [name for name in PEERS if importlib.util.find_spec(name) is not None]


def draws(name: str, wanted: Wanted, worlds: int, setting: Setting) -> bool:
    """Return True if a renderer is asked for these outputs in so many worlds."""
    if name == "mujoco":
        few = worlds <= FEW_WORLDS and setting.width * setting.height >= LARGE_PIXELS
        return few and COMPARED.issuperset(wanted.outputs)
    return wanted.by_peers or name == "warpcam"


def create(name: str, problem: Problem) -> Peer:
    if name not in installed():
        raise WarpcamError(f"--peer: {name} is not installed; pip install {INSTALL[name]}")
    module = importlib.import_module(f"{__name__}.{PEERS[name]}")
    return cast(Peer, module.create(problem))
