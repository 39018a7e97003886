"""Recorded frames of a renderer, by what the scene is bound to."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import warp as wp

from warpcam.kernels.runtime.launch import FrameGraph, MeshReads, Stage
from warpcam.kernels.runtime.streams import nonblocking_stream

MAX_RECORDINGS = 4  # states that a renderer goes to and fro between without recording anew


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames and their graphs, each of all worlds (True) or of those that were chosen."""

    frames: dict[bool, FrameGraph]
    graphs: dict[bool, wp.Graph]

    def run(self, everything: bool, graph: bool, device: wp.Device) -> None:
        """Draw a frame, with ``graph`` as one that is replayed."""
        frame = self.frames[everything]
        if not graph:
            frame.launch()
            return
        if everything in self.graphs:
            wp.capture_launch(self.graphs[everything], stream=device.stream)
            return
        frame.launch()  # the first time by itself: the driver may still have to load the kernels
        # On a stream that nobody else knows: what other threads launch meanwhile is none of this graph.
        stream = nonblocking_stream(device)
        with wp.ScopedCapture(stream=stream) as capture:
            frame.launch(stream)
        self.graphs[everything] = capture.graph


class Recordings(dict[tuple[Stage, ...], Recording]):
    """Frames by the stages of the scene that they were recorded for, the last used at the end.

    Args:
        phases: Of a frame's own stages, of all worlds (True) and of those that are chosen.
        shades: Whether some stage shades.
        device: Where they run.
    """

    def __init__(self, phases: Mapping[bool, list[list[list[Stage]]]], shades: bool, device: wp.Device):
        super().__init__()
        self._phases, self._shades, self._device = phases, shades, device

    def after(self, stages: tuple[Stage, ...]) -> Recording:
        """The frames that follow the scene's own ``stages``."""
        recording = self.pop(stages, None)
        if recording is None:
            if len(self) >= MAX_RECORDINGS:
                self.pop(next(iter(self)))
            needed = [stage for stage in stages if self._shades or not stage.for_shading_only]
            frames = {everything: self._frame(needed, *phases) for everything, phases in self._phases.items()}
            recording = Recording(frames, {})
        self[stages] = recording
        return recording

    def _frame(self, scene: list[Stage], views: list[list[Stage]], *phases: list[list[Stage]]) -> FrameGraph:
        """One frame: the scene's stages, as far as they are needed, views, and what follows.

        Trees that nobody walks through stay as they are.
        """
        most = [max((stage.reads for stage in itertools.chain(*chains)), default=MeshReads.FACES) for chains in phases]
        needed = [stage for stage in scene if MeshReads.TREES in most or not stage.for_trees_only]
        reading = next((chains for chains, reads in zip(phases, most, strict=True) if reads > MeshReads.FACES), [])
        late = self._late(needed, reading)
        early = [stage for stage in needed if stage not in late]
        aside = [stage for stage in early if stage.independent]
        rest = [stage for stage in early if not stage.independent]
        head = [[[*rest, *views[0]], aside]] if aside else [[rest], views]
        return FrameGraph([*head, *phases], self._device, late, len(head))

    def _late(self, scene: list[Stage], reading: list[list[Stage]]) -> list[Stage]:
        """The scene's stages that may run beside others: all chains that wait for them begin with what does not."""
        ahead = all(chain[0].reads == MeshReads.FACES for chain in reading if chain)
        return [stage for stage in scene if ahead and (stage.for_trees_only or stage.for_shading_only)]
