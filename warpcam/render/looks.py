"""Looks of a scene: how its lit images are made."""

from typing import Any, Literal, get_args

import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.render.paths import PathOptions, check_whole
from warpcam.scene.scene import Scene

LookName = Literal["mujoco", "pbr", "path"]


class Look:
    """What a renderer was asked for.

    Args:
        name: One of ``LookName``; None is the scene's own.
        options: Of paths; only with "path".
        scene: The scene.
    """

    def __init__(self, name: Any, options: Any, scene: Scene):
        own = "pbr" if scene.description().physical else "mujoco"
        if name is not None and name not in get_args(LookName):
            allowed = ", ".join(repr(each) for each in get_args(LookName))
            raise WarpcamError(f"Renderer: look is {name!r}; allowed are {allowed}, or None for the scene's own")
        self.name: LookName = next(each for each in get_args(LookName) if each == (own if name is None else name))
        if options is not None and not isinstance(options, PathOptions):
            raise WarpcamError(f"Renderer: path must be a PathOptions or None, got {options!r}")
        if options is not None and not self.traces_paths:
            raise WarpcamError(f"Renderer: path has options of look='path', and the look is {self.name!r}")
        if self.traces_paths and scene.tables().splats is not None:
            raise WarpcamError("Renderer: look='path' draws no clouds of Gaussians, which this scene has")
        self.options = (options or PathOptions()) if self.traces_paths else None  # of paths
        if self.name not in (own, "path") or (self.traces_paths and own == "mujoco"):
            raise WarpcamError(f"Renderer: look is {self.name!r}, which a scene whose own is {own!r} has not")

    def paths(self, device: wp.Device) -> tuple[PathOptions, wp.array] | None:
        """Options of paths and int32, (1,): how many ``accumulate`` adds; None where no paths are traced."""
        if self.options is None:
            return None
        self.more = wp.zeros(1, dtype=wp.int32, device=device)
        return self.options, self.more

    def check_more(self, samples: Any, has_drawn: bool) -> int:
        """The number of paths that are to be added, or the error that there is nothing to add to."""
        count = check_whole("accumulate: samples", samples, 1)
        if not (self.traces_paths and has_drawn):
            why = "render() comes first" if self.traces_paths else f"the look is {self.name!r}"
            raise WarpcamError(f"accumulate: there are no paths to add to, as {why}")
        return count

    @property
    def traces_paths(self) -> bool:
        return self.name == "path"
