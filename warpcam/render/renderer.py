"""The renderer: which stages make a frame, in what order, and their capture as a graph."""

import itertools
import threading
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Lens
from warpcam.camera.outputs import OUTPUTS
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.world_mask import Selection
from warpcam.kernels.passes.views import Tags, opening_of
from warpcam.kernels.runtime.launch import Frame, Group, Stage, bind
from warpcam.kernels.runtime.streams import context_kept, quiet_stream
from warpcam.kernels.scene_tables import Tables
from warpcam.kernels.types import HEIGHT_FIELD, MESH
from warpcam.render.camera_binding import CameraArrays, Mounted
from warpcam.render.camera_passes import Stages, Target
from warpcam.render.flow_history import ShapesPast
from warpcam.render.memory import check_cameras, estimate_memory, require_free
from warpcam.render.scratch_memory import Lenders, Portion, Scratch, Turns, cuts_in_waves
from warpcam.scene.scene import Scene

# A portion of so many pixels is drawn in so many parts side by side: one goes on while another's last pixels are waited
# for.
WORTH_PARTING = 2**22
PARTS = 3
TURNS = 2  # in which worlds of a group are coloured where that makes groups fewer
WALKED = {MESH, HEIGHT_FIELD}  # shapes that rays walk through

# While one thread records a graph, Warp counts its device as capturing: the others wait their turn.
_turns: defaultdict[str, threading.Lock] = defaultdict(threading.Lock)

Images = dict[str | int, dict[str, torch_interop.Tensor]]

MAX_RECORDINGS = 4  # states that a renderer goes to and fro between without recording anew


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames and their graphs, each of all worlds (True) or of those that were chosen."""

    frames: dict[bool, Frame]
    graphs: dict[bool, wp.Graph]


class Renderer:
    """Renders the cameras of a scene, all worlds at once.

    Building one allocates all memory and compiles all kernels; ``render`` does neither.

    Args:
        scene: What to look at.
        cameras: Each under its own name.
        graph: Replay each frame as a CUDA graph; False launches kernel by kernel. Images are the same.

    Attributes:
        images: The images of the last frame, by camera and output: tensors (world, height, width, channels) on the
            scene's device. The same tensors in every frame; they stay valid when the renderer is gone.
        faulty: uint8 tensor, (world,): 1 where, in the last frame that drew the world, a pose, size or lens was not a
            number or made no image. Such a world's images show the background; no other world is touched.
        frames: int32 tensor, (world,): how many frames have drawn the world. Counted on the device, so in graphs, too.
        times: float32 tensor, (world,): the simulation's time [s] in the last of them; NaN where it keeps none.
        memory: What was allocated for it all; ``estimate_memory`` tells before.

    Raises:
        WarpcamError: A camera does not fit the scene, or more memory is needed than the device has free.
    """

    @context_kept()
    def __init__(self, scene: Scene, cameras: Sequence[Camera], *, graph: bool = True):
        self._cameras = check_cameras(scene, cameras)
        self._shades = any(OUTPUTS[name].face for camera in self._cameras.values() for name in camera.outputs)
        if not isinstance(graph, bool | np.bool_):
            raise WarpcamError(f"Renderer: graph must be True or False, got {graph!r}")
        torch_interop.require_no_capture(scene.device, "Renderer")
        self._scene, self._device = scene, scene.device
        self.memory = estimate_memory(scene, cameras)
        require_free(self.memory, scene.device)
        self._graph = graph and scene.device.is_cuda
        self._turn = _turns[scene.device.alias] if scene.device.is_cuda else threading.Lock()
        tables = scene.tables()
        self._mounted = {key: Mounted(camera, scene) for key, camera in self._cameras.items()}
        self._targets = {
            key: Target(camera, self._mounted[key].projection, tables, scene.device)
            for key, camera in self._cameras.items()
        }
        self._selection = Selection(scene.num_worlds, scene.device)
        self._past = [(key, target.past) for key, target in self._targets.items() if target.past is not None]
        self._shapes_past = ShapesPast(scene, tables) if self._past else None
        self._scratch = Scratch(self._cameras, tables, scene.device)
        self._scratch.allocate()
        self._faults = wp.zeros(scene.num_worlds, dtype=wp.uint8, device=scene.device)
        self.faulty = torch_interop.to_torch(self._faults)
        self._tags = Tags.of(scene.num_worlds, scene.device)
        self.frames, self.times = torch_interop.to_torch(self._tags.frames), torch_interop.to_torch(self._tags.times)
        self.images: Images = {
            key: {name: torch_interop.to_torch(array) for name, array in target.images.items()}
            for key, target in self._targets.items()
        }
        self._arrays = {
            key: CameraArrays(self._cameras[key].where, mounted.arrays) for key, mounted in self._mounted.items()
        }
        self._tables: Tables | None = None
        # What is drawn by the scene's stages, the last used at the end.
        self._recordings: dict[tuple[Stage, ...], Recording] = {}
        self._record(tables)

    def render(self, worlds: Any = None, forward: bool = False) -> Images:
        """Render the state as it is now.

        On CUDA the work is queued, in order with what torch's and Warp's current streams hold, and nothing waits for
        it. Inside a capture it becomes part of the captured graph, for whose replays the renderer must be kept alive.

        Args:
            worlds: Which worlds to render; the others' images stay. Ids as a sequence or an integer tensor, or a mask
                (world,) as a bool or uint8 tensor or Warp array. A mask on the scene's device costs no wait for the
                device; a tensor of ids there does, to be checked, but for inside a capture, where ids out of range are
                passed over. None is all.
            forward: Have the simulator compute poses from its state first. After a step of MuJoCo poses are those
                before it.

        Returns:
            ``images``.
        """
        if not isinstance(forward, bool | np.bool_):
            raise WarpcamError(f"render: forward must be True or False, got {forward!r}")
        with self._turn, torch_interop.in_order(self._device) as capturing:
            if capturing and not self._scene.live_on_device:
                raise WarpcamError(
                    "render: a capture is under way, but this scene's poses come from the host and would not be copied "
                    "again when the graph is replayed; render outside of it, or use from_mujoco_warp"
                )
            if worlds is not None:
                self._selection.select(worlds, capturing)
            if forward:
                self._scene.forward()
            self._scene.refresh()
            tables = self._scene.tables()
            if tables is not self._tables or self._scene.clock() is not self._clock:
                self._record(tables)
            self._run(worlds is None, capturing)
        return self.images

    def reset(self, worlds: Any = None) -> None:
        """Forget the last frame of some worlds: where ``flow`` is 0 and ``flow_valid`` 0 at their next render.

        To be called when a world has jumped to another state. It is queued as ``render`` is, and may be part of a
        capture. Without a camera that has one of these outputs it does nothing.

        Args:
            worlds: As ``render`` takes them.
        """
        if self._shapes_past is None:
            return
        with self._turn, torch_interop.in_order(self._device) as capturing:
            if worlds is None:
                self._shapes_past.known.zero_()
                return
            self._selection.select(worlds, capturing, "reset")
            self._forget.launch()

    def array(self, camera: str | int, output: str) -> wp.array:
        """The Warp array behind ``images[camera][output]``: the same memory, (world, height, width, channels)."""
        target = self._targets[self._key(camera)]
        if output not in tuple(target.images):
            raise WarpcamError(f"Renderer.array: output {output!r} came, {camera!r} renders {', '.join(target.images)}")
        return target.images[output]

    def camera(self, camera: str | int) -> CameraArrays:
        """What of that camera may be written in place, seen at the next render: tensors on the scene's device."""
        return self._arrays[self._key(camera)]

    def set_lens(self, camera: str | int, lens: Lens) -> None:
        """Put another table of rays, a ``Fisheye``, ``Distorted`` or ``Rays``, in place of a camera's.

        It is seen at the next render. The table is made on the host and copied. Graphs stay valid, a captured one of
        the user's, too.

        Args:
            camera: Its name; it must have been built with such a lens.
            lens: One for all worlds, or, if the camera was built with one for each, one for each.
        """
        torch_interop.require_no_capture(self._device, "set_lens")
        with self._turn, torch_interop.in_order(self._device):
            self._mounted[self._key(camera)].set_table(lens)

    def __reduce__(self) -> Any:
        raise WarpcamError("Renderer: it cannot be copied or pickled, as it holds memory of a device; make another one")

    def _key(self, camera: str | int) -> str | int:
        if camera not in tuple(self._cameras):
            known = ", ".join(repr(key) for key in self._cameras)
            raise WarpcamError(f"Renderer: camera {camera!r} came, it renders {known}")
        return camera

    def _record(self, tables: Tables) -> None:
        """Bind every stage to the tables' arrays; loads and compiles whatever kernels that takes."""
        mask, faults, scratch = self._selection.mask, self._faults, self._scratch
        known = None
        if self._shapes_past is not None:
            known = self._shapes_past.known
            for number, (_, past) in enumerate(self._past):
                self._shapes_past.lend(past.trail, tables, keep=number == len(self._past) - 1)

        def record_views(opening: Any) -> Iterator[Stage]:
            for key, mounted in self._mounted.items():
                target = self._targets[key]
                yield mounted.record(mask, faults, target.views, tables, target.past, target.lists, opening)
                opening = None

        images = {key: target.images for key, target in self._targets.items()}
        clock = self._clock = self._scene.clock()
        frames: dict[bool, list[list[list[Stage]]]] = {}
        for everything in (True, False):
            opening = opening_of(everything, clock, self._tags, self._device, known)
            frames[everything] = [[list(record_views(opening))]]
            frames[everything] += self._record_motion(tables)
            phases: list[Turns] = [[portions] for portions in scratch.phases(images if everything else None)]
            chains = None
            if everything and len(phases) > 1 and self._is_large(self._pixels(phases[0])):
                chains = self._chains(tables, images)
                phases = phases if chains else self._fewer(phases, images)
            if everything:
                busiest = max(map(self._pixels, phases), default=0)
            if chains:
                frames[everything].append([self._record_chain(tables, chain, busiest) for chain in chains])
            else:
                for phase in phases:
                    frames[everything] += self._record_phase(tables, phase, busiest)
            frames[everything] += self._record_keeping(tables)
        self._phases, self._recordings = frames, {}
        if self._shapes_past is not None:
            self._forget = self._shapes_past.record_forget(mask)
            self._forget.bind()
        bind([stage for frame in self._recording().frames.values() for stage in frame.stages])
        self._tables = tables

    def _record_motion(self, tables: Tables) -> list[list[list[Stage]]]:
        """The phase before the trace that looks at what was, if some camera asks for flow."""
        if self._shapes_past is None:
            return []
        stages = []
        for number, (key, past) in enumerate(self._past):
            last = number == len(self._past) - 1
            views, projection = self._targets[key].views, self._mounted[key].projection
            if not self._shapes_past.composed:
                stages.append(past.record(tables, views, projection, self._selection.mask, keep=last))
        return [[stages]] if stages else []

    def _record_keeping(self, tables: Tables) -> list[list[list[Stage]]]:
        """The phase after it in which what is becomes what was, if that is not done yet."""
        if self._shapes_past is None:
            return []
        return [[stages]] if (stages := self._shapes_past.record_after(tables, self._selection.mask)) else []

    def _recording(self) -> Recording:
        """The frames for what the scene is bound to now."""
        stages = self._scene.stages()
        recording = self._recordings.pop(stages, None)
        if recording is None:
            if len(self._recordings) >= MAX_RECORDINGS:
                self._recordings.pop(next(iter(self._recordings)))
            needed = [stage for stage in stages if self._shades or not stage.shading]
            aside = [stage for stage in needed if stage.aside]
            rest = [stage for stage in needed if not stage.aside]
            frames = {}
            for everything, ((views,), *phases) in self._phases.items():
                head = [[[*rest, *views], aside]] if aside else [[rest], [views]]
                frames[everything] = Frame([*head, *phases], self._device)
            recording = Recording(frames, {})
        self._recordings[stages] = recording
        return recording

    def _is_large(self, pixels: int) -> bool:
        """Whether so many pixels at once are worth more than one launch of a stage."""
        return self._device.is_cuda and pixels >= WORTH_PARTING

    def _pixels(self, phase: Turns) -> int:
        portions = itertools.chain(*phase)
        return sum(len(each.worlds) * self._area(each) for each in portions)

    def _area(self, portion: Portion) -> int:
        camera = self._cameras[portion.camera]
        return camera.width * camera.height

    def _chains(self, tables: Tables, images: Lenders) -> list[list[list[Portion]]] | None:
        """Phases that need not wait for each other, where that is better than one after another.

        It is not where rays walk through meshes and terrain, which they do best while nothing else runs beside them.
        """
        return self._scratch.chains(images, PARTS) if WALKED.isdisjoint(tables.shape_types) else None

    def _fewer(self, phases: list[Turns], images: Lenders) -> list[Turns]:
        """The same phases or, if these are fewer, phases of several turns."""
        late = {key: target.late_images for key, target in self._targets.items()}
        in_turns = self._scratch.phases_of_turns(images, late, TURNS) if any(late.values()) else phases
        return in_turns if len(in_turns) < len(phases) else phases

    def _record_chain(self, tables: Tables, chain: list[list[Portion]], busiest: int) -> list[Stage]:
        """Stages one after another, of portions each of which waits for the one before."""
        return [
            stage
            for portion in itertools.chain(*chain)
            for stages in self._record_portion(tables, portion, 1, busiest)
            for stage in (*stages.first, *stages.last)
        ]

    def _record_phase(self, tables: Tables, phase: Turns, busiest: int) -> list[list[list[Stage]]]:
        """Chains of stages that may run side by side, and then the last stages of other turns than the first."""
        parts = -(-PARTS // len(phase[0])) if len(phase) == 1 else 1
        first, *others = (
            [stages for portion in portions for stages in self._record_portion(tables, portion, parts, busiest)]
            for portions in phase
        )
        together = [[*stages.first, *stages.last] for stages in first]
        together += [stages.first for turn in others for stages in turn]
        return [together, *([stages.last for stages in turn] for turn in others)]

    def _record_portion(self, tables: Tables, portion: Portion, parts: int, busiest: int) -> Iterator[Stages]:
        """Its stages, in parts that may run side by side where it is large.

        Args:
            tables: The scene.
            portion: What they draw.
            parts: How many are worth it.
            busiest: Pixels of the phase that has most.
        """
        key, area = portion.camera, self._area(portion)
        seen, projection = self._mounted[key].seen(tables), self._mounted[key].projection
        parts = parts if portion.buffers and self._is_large(len(portion.worlds) * area) else 1
        cuts = cuts_in_waves(len(portion.worlds), parts, self._scratch.wave(key) if parts > 1 else 1)
        bounds = [portion.worlds.start + cut for cut in cuts]
        for first, end in itertools.pairwise(bounds):
            group = Group(range(first, end), busiest // area)
            yield self._targets[key].record(
                seen, projection, group, portion.buffers, self._selection.mask, self._faults
            )

    def _run(self, everything: bool, capturing: bool) -> None:
        recording = self._recording()
        frame, graphs = recording.frames[everything], recording.graphs
        if not self._graph or capturing:
            frame.launch()
            return
        if everything in graphs:
            wp.capture_launch(graphs[everything], stream=self._device.stream)
            return
        frame.launch()  # the first time by itself: the driver may still have to load the kernels
        # On a stream that nobody else knows: what other threads launch meanwhile is none of this graph.
        stream = quiet_stream(self._device)
        with wp.ScopedCapture(stream=stream) as capture:
            frame.launch(stream)
        graphs[everything] = capture.graph
