"""The renderer: which stages make a frame, in what order, and their capture as a graph."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Lens
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.memory_errors import memory_told
from warpcam.core.world_mask import Selection
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.views import FrameCounters, make_frame_start
from warpcam.kernels.plan.frame import FramePlan, merged
from warpcam.kernels.runtime.compile import building
from warpcam.kernels.runtime.launch import Group, Stage, prepare
from warpcam.kernels.runtime.streams import preserve_cuda_context, recording_lock
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import HEIGHT_FIELD, MESH
from warpcam.render.camera_binding import CameraArrays, CameraBinding
from warpcam.render.camera_passes import CameraPasses, Stages
from warpcam.render.faults import tell_faults
from warpcam.render.flow_history import ShapeHistory
from warpcam.render.last_frame import LastFrame
from warpcam.render.looks import Look, LookName
from warpcam.render.memory import check_cameras, estimate_memory, require_free
from warpcam.render.paths import PathOptions
from warpcam.render.recordings import Recording, Recordings
from warpcam.render.rendered_tensors import Images, RenderedTensors
from warpcam.render.scratch_memory import Batch, LentImages, Rounds, Scratch, cuts_in_waves
from warpcam.scene.environments import Environments
from warpcam.scene.scene import Scene

# A portion of so many pixels is drawn in parts side by side: one goes on while another's last pixels are waited for.
SPLIT_ABOVE_PIXELS = 2**22
CHAINS = 3
ROUNDS = 2  # in which worlds of a group are coloured where that makes groups fewer
TRAVERSED = {MESH, HEIGHT_FIELD}  # shapes that rays walk through


class Renderer(RenderedTensors):
    """Renders the cameras of a scene, all worlds at once.

    Building one allocates all memory and compiles all kernels; ``render`` does neither.

    Args:
        scene: What to look at.
        cameras: Each under its own name.
        graph: Replay each frame as a CUDA graph; False launches kernel by kernel. Images are the same.
        look: How ``rgb``, ``rgba`` and ``hdr`` are lit: "mujoco" as in MuJoCo's renderer; "pbr", physically based in
            real time; "path", by paths of light. None is the scene's own: "mujoco" for MuJoCo's, else "pbr".
        path: How paths are traced; only with look="path".
        environments: Light from all around, from images in float; not with look="mujoco".
        ambient_occlusion: Radius, above 0, within which shapes hide light from all around [m]; only with look="pbr".
        soft_shadows: Cameras with shadows show those of lights as large as they are; only with look="pbr".
        indirect_light: Surfaces are lit by what they see of others, by one bounce of light; only with look="pbr".
        reflections: Rays find what smooth surfaces mirror and clear ones let through; only with look="pbr".

    Attributes:
        images: The images of the last frame, by camera and output: tensors (world, height, width, channels) on the
            scene's device. The same tensors in every frame; they stay valid when the renderer is gone.
        faulty: uint8 tensor, (world,): 1 where, in the last frame that drew the world, a pose, size or lens was not
            finite or made no image. A world with a shape that is not finite shows the background, and so does a camera
            that is not or whose rotation is 0; a shape whose rotation or size is 0 is missing. The first are told.
        frames: int32 tensor, (world,): how many frames have drawn the world. Counted on the device, so in graphs, too.
        times: float32 tensor, (world,): the simulation's time [s] in the last of them; NaN where it keeps none.
        memory: What was allocated for it all; ``estimate_memory`` tells before.
        lock: Held while a frame is queued, drawn on a CPU; a thread holds it on to use images before others draw again.

    Raises:
        WarpcamError: A camera does not fit the scene; ``OutOfMemoryError`` if the device has too little memory free.
    """

    @preserve_cuda_context()
    @memory_told("Renderer")
    def __init__(
        self,
        scene: Scene,
        cameras: Sequence[Camera],
        *,
        graph: bool = True,
        look: LookName | None = None,
        path: PathOptions | None = None,
        environments: Environments | None = None,
        ambient_occlusion: float | None = None,
        soft_shadows: bool = False,
        indirect_light: bool = False,
        reflections: bool = False,
    ):
        self._cameras = check_cameras(scene, cameras)
        self._shades = any(OUTPUTS[name].trace is None for camera in self._cameras.values() for name in camera.outputs)
        if not isinstance(graph, bool | np.bool_):
            raise WarpcamError(f"Renderer: graph must be True or False, got {graph!r}")
        torch_interop.require_no_capture(scene.device, "Renderer")
        self._scene, self._device = scene, scene.device
        self._look = Look(look, path, scene, environments, reflections)
        occlusion = self._look.occlusion(ambient_occlusion, soft_shadows, indirect_light, self._cameras.values())
        more = {"look": look, "reflections": reflections, "environments": environments, **occlusion.arguments}
        self.memory = estimate_memory(scene, cameras, **more)
        require_free(self.memory, scene.device)
        self._graph, self.lock = graph and scene.device.is_cuda, recording_lock(scene.device)
        tables = self._look.tables(scene.tables())
        self._bindings = {key: CameraBinding(camera, scene, reflections) for key, camera in self._cameras.items()}
        options = (tables, scene.device, self._look.paths(scene.device), occlusion, reflections)
        self._passes = {
            key: CameraPasses(camera, binding.projection, *options, binding.film)
            for (key, camera), binding in zip(self._cameras.items(), self._bindings.values(), strict=True)
        }
        self._selection = Selection(scene.num_worlds, scene.device)
        self._histories = [(key, target.history) for key, target in self._passes.items() if target.history is not None]
        self._shape_history = ShapeHistory(scene, tables) if self._histories else None
        self._last_frame = LastFrame(self._shape_history, self._bindings.values(), scene.device)
        plans = {key: target.plan for key, target in self._passes.items()}
        self._scratch = Scratch(self._cameras, plans, scene.num_worlds, scene.device)
        self._scratch.allocate()
        self._faults = wp.zeros(scene.num_worlds, dtype=wp.uint8, device=scene.device)
        self._counters = FrameCounters.of(scene.num_worlds, scene.device)
        images = {key: target.images for key, target in self._passes.items()}
        super().__init__(images, self._faults, self._counters, scene.device)
        self._arrays = {
            key: CameraArrays(self._cameras[key].where, binding.arrays, scene.num_worlds, scene.device)
            for key, binding in self._bindings.items()
        }
        self._tables: SceneTables | None = None
        self._is_checked = self._has_drawn = False  # the first frame's faults have been told; there was a frame
        with building:
            self._bind(scene.tables())

    def render(self, worlds: Any = None, forward: bool = False) -> Images:
        """Render the state as it is now.

        On CUDA the work is queued, in order with what torch's and Warp's current streams hold, and nothing waits for
        it. Inside a capture it becomes part of the captured graph, for whose replays the renderer must be kept alive.

        Args:
            worlds: Which worlds to render; the others' images stay. Ids as a sequence or an integer tensor, or a mask
                (world,) as a bool or uint8 tensor or Warp array. A mask on the scene's device costs no wait for the
                device; a tensor of ids there does, to be checked, but for inside a capture, where ids out of range are
                passed over. None is all.
            forward: Have the simulator compute poses first. After a step of MuJoCo poses are those before it.

        Returns:
            ``images``.
        """
        self.draw(worlds, forward, "render")
        return self.images

    def draw(self, worlds: Any, forward: bool, call: str) -> None:
        """Render for a sensor or a command, whose ``call`` begins the texts of errors; makes no tensors."""
        if not isinstance(forward, bool | np.bool_):
            raise WarpcamError(f"{call}: forward must be True or False, got {forward!r}")
        with self.lock, memory_told(call), torch_interop.in_order(self._device) as capturing:
            if capturing and not self._scene.live_on_device:
                raise WarpcamError(
                    f"{call}: a capture is under way, but this scene's poses come from the host and would not be "
                    "copied again when the graph is replayed; render outside of it, or use from_mujoco_warp"
                )
            if worlds is not None:
                self._selection.select(worlds, capturing, call)
            if forward:
                self._scene.forward()
            self._scene.refresh()
            tables = self._scene.tables()
            if tables is not self._tables or self._scene.clock() is not self._clock:
                with building:
                    self._bind(tables)
            self._recording().run(worlds is None, self._graph and not capturing, self._device)
            if not (self._is_checked or capturing):
                self._is_checked = True
                tell_faults(self._faults)
        self._has_drawn = True

    def accumulate(self, samples: int) -> Images:
        """Add paths to each pixel of the last frame, in the worlds that it drew, and show the mean of all.

        The scene must be as it was then: its shapes, lights and materials are read anew.

        Args:
            samples: Paths of each pixel that are added, at least 1.

        Returns:
            ``images``.
        """
        count = self._look.check_more(samples, self._has_drawn)
        with self.lock, torch_interop.in_order(self._device):
            self._look.more.fill_(count)
            for stage in (*self._scene.tree_stages(), *self._adding):
                stage.launch()
        return self.images

    def reset(self, worlds: Any = None) -> None:
        """Forget the last frame of some worlds: ``flow`` and ``flow_valid`` are 0 at their next render.

        Automatic exposure adapts anew: it is NaN, and then that of the next frame alone. To be called when a world has
        jumped to another state. It is queued as ``render`` is, and may be part of a capture. Without a camera that has
        one of these outputs or ``auto_exposure`` it does nothing.

        Args:
            worlds: As ``render`` takes them.
        """
        if self._last_frame.is_empty:
            return
        with self.lock, torch_interop.in_order(self._device) as capturing:
            if worlds is not None:
                self._selection.select(worlds, capturing, "reset")
            self._last_frame.forget(everywhere=worlds is None)

    def array(self, camera: str | int, output: str) -> wp.array:
        """The Warp array behind ``images[camera][output]``: the same memory, (world, height, width, channels)."""
        return self.rendered(camera, output)

    def rendered(self, camera: str | int, output: str) -> wp.array:
        """The same, as it was drawn: sensors may have measurements in ``images``."""
        images = self._passes[self._key(camera)].images
        if output not in tuple(images):
            raise WarpcamError(f"Renderer.array: output {output!r} came, {camera!r} renders {', '.join(images)}")
        return images[output]

    def views(self, camera: str | int) -> wp.array:
        """Pose and lens of a camera as the last frame had them: ``warpcam.kernels.types.View``, (world,)."""
        return self._passes[self._key(camera)].views

    def camera(self, camera: str | int) -> CameraArrays:
        """Arrays of a camera that may be written in place, seen at the next render: tensors on the scene's device."""
        return self._arrays[self._key(camera)]

    def set_lens(self, camera: str | int, lens: Lens) -> None:
        """Put another table of rays, any lens but ``Pinhole`` and ``Orthographic``, in place of a camera's.

        It is seen at the next render. The table is made on the host and copied. All graphs stay valid.

        Args:
            camera: Its name; it must have been built with such a lens.
            lens: One for all worlds, or, if the camera was built with one for each, one for each.
        """
        torch_interop.require_no_capture(self._device, "set_lens")
        with self.lock, torch_interop.in_order(self._device):
            self._bindings[self._key(camera)].set_table(lens)

    @property
    def scene(self) -> Scene:
        """Scene that is drawn."""
        return self._scene

    @property
    def drawn(self) -> wp.array:
        """Mask of the worlds that the last frame drew: uint8, (world,), on the scene's device."""
        return self._selection.mask

    @property
    def plan(self) -> Mapping[str | int, FramePlan]:
        """Kernels that draw each camera, by its name; ``str()`` of a plan has them in words."""
        return {key: merged(plans) for key, plans in self._plans.items()}

    def __reduce__(self) -> Any:
        raise WarpcamError("Renderer: it cannot be copied or pickled, as it holds memory of a device; make another one")

    def _key(self, camera: str | int) -> str | int:
        if camera not in tuple(self._cameras):
            raise WarpcamError(f"Renderer: camera {camera!r} came, it renders {', '.join(map(repr, self._cameras))}")
        return camera

    def _bind(self, scene_tables: SceneTables) -> None:
        """Bind every stage to the tables' arrays; loads and compiles whatever kernels that takes."""
        tables = self._look.tables(scene_tables)
        mask, faults, scratch = self._selection.mask, self._faults, self._scratch
        self._plans: dict[str | int, list[FramePlan]] = {key: [] for key in self._cameras}
        known = None
        if self._shape_history is not None:
            known = self._shape_history.frame_state
            for number, (_, history) in enumerate(self._histories):
                self._shape_history.share_with(history.flow_history, tables, keep=number == len(self._histories) - 1)

        def record_views(frame_start: Any) -> Iterator[Stage]:
            yield from self._look.stages()
            for key, binding in self._bindings.items():
                yield from binding.bind(mask, faults, tables, self._passes[key], frame_start)
                frame_start = None

        images = {key: target.images for key, target in self._passes.items()}
        clock = self._clock = self._scene.clock()
        frames: dict[bool, list[list[list[Stage]]]] = {}
        for everything in (True, False):
            self._adding: list[Stage] = []
            frame_start = make_frame_start(everything, clock, self._counters, self._device, known)
            frames[everything] = [[[*self._head(everything), *record_views(frame_start)]]]
            frames[everything] += self._bind_motion(tables)
            phases: list[Rounds] = [[batches] for batches in scratch.phases(images if everything else None)]
            chains = None
            if everything and len(phases) > 1 and self._is_large(self._pixels(phases[0])):
                chains = self._chains(tables, images)
                phases = phases if chains else self._fewer(phases, images)
            if everything:
                busiest = max(map(self._pixels, phases), default=0)
            if chains:
                frames[everything].append([self._bind_chain(tables, chain, busiest) for chain in chains])
            else:
                for phase in phases:
                    frames[everything] += self._bind_phase(tables, phase, busiest)
            frames[everything] += [*self._bind_history(tables), *self._tail()]
        self._recordings = Recordings(frames, self._shades, self._device)
        self._last_frame.bind(mask)
        recorded = (stage for frame in self._recording().frames.values() for stage in frame.stages)
        prepare([*recorded, *self._adding])
        self._tables = scene_tables

    def _head(self, everything: bool) -> Sequence[Stage]:
        """Stages of a subclass before a frame's views; until then the mask says nothing of ``everything``."""
        return ()

    def _tail(self) -> list[list[list[Stage]]]:
        """Phases of a subclass at the end of a frame."""
        return []

    def _bind_motion(self, tables: SceneTables) -> list[list[list[Stage]]]:
        """The phase before the trace that looks at what was, if some camera asks for flow."""
        if self._shape_history is None:
            return []
        stages = []
        for number, (key, history) in enumerate(self._histories):
            last = number == len(self._histories) - 1
            views, projection = self._passes[key].views, self._bindings[key].projection
            if not self._shape_history.composed_by_trace:
                stages.append(history.bind(tables, views, projection, self._selection.mask, keep=last))
        return [[stages]] if stages else []

    def _bind_history(self, tables: SceneTables) -> list[list[list[Stage]]]:
        """The phase after it in which what is becomes what was, if that is not done yet."""
        if self._shape_history is None:
            return []
        return [[stages]] if (stages := self._shape_history.bind_after(tables, self._selection.mask)) else []

    def _is_large(self, pixels: int) -> bool:
        """Return whether so many pixels at once are worth more than one launch of a stage."""
        return self._device.is_cuda and pixels >= SPLIT_ABOVE_PIXELS

    def _pixels(self, phase: Rounds) -> int:
        return sum(len(each.worlds) * self._passes[each.camera].pixels for each in itertools.chain(*phase))

    def _chains(self, tables: SceneTables, images: LentImages) -> list[list[list[Batch]]] | None:
        """Phases that need not wait for each other, where that is better than one after another.

        It is not where rays walk through meshes and terrain, which they do best while nothing else runs beside them.
        """
        return self._scratch.chains(images, CHAINS) if TRAVERSED.isdisjoint(tables.shape_types) else None

    def _fewer(self, phases: list[Rounds], images: LentImages) -> list[Rounds]:
        """Return the phases, or phases of several rounds if these are fewer."""
        late = {key: target.plan.late for key, target in self._passes.items()}
        in_turns = self._scratch.phases_of_rounds(images, late, ROUNDS) if any(late.values()) else phases
        return in_turns if len(in_turns) < len(phases) else phases

    def _bind_chain(self, tables: SceneTables, chain: list[list[Batch]], busiest: int) -> list[Stage]:
        """Stages one after another, of portions each of which waits for the one before."""
        return [
            stage
            for batch in itertools.chain(*chain)
            for stages in self._bind_batch(tables, batch, 1, busiest)
            for stage in (*stages.visibility, *stages.shading)
        ]

    def _bind_phase(self, tables: SceneTables, phase: Rounds, busiest: int) -> list[list[list[Stage]]]:
        """Chains of stages that may run side by side, and then the last stages of other turns than the first."""
        parts = -(-CHAINS // len(phase[0])) if len(phase) == 1 else 1
        first, *others = (
            [stages for batch in batches for stages in self._bind_batch(tables, batch, parts, busiest)]
            for batches in phase
        )
        together = [[*stages.visibility, *stages.shading] for stages in first]
        together += [stages.visibility for turn in others for stages in turn]
        return [together, *([stages.shading for stages in turn] for turn in others)]

    def _bind_batch(self, tables: SceneTables, batch: Batch, parts: int, busiest: int) -> Iterator[Stages]:
        """Its stages, in parts that may run side by side where it is large.

        Args:
            tables: The scene.
            batch: What they draw.
            parts: How many are worth it.
            busiest: Pixels of the phase that has most.
        """
        key, passes, mask = batch.camera, self._passes[batch.camera], self._selection.mask
        seen, area = self._bindings[key].camera_tables(tables), passes.pixels
        parts = parts if batch.buffers and self._is_large(len(batch.worlds) * area) else 1
        cuts = cuts_in_waves(len(batch.worlds), parts, self._scratch.wave(key) if parts > 1 else 1)
        for first, end in itertools.pairwise(batch.worlds.start + cut for cut in cuts):
            group = Group(range(first, end), busiest // area)
            plan, stages = passes.bind(seen, group, batch.buffers, mask, self._faults)
            self._plans[key].append(plan)
            self._adding += stages.adding
            yield stages

    def _recording(self) -> Recording:
        """The frames for what the scene is bound to now."""
        return self._recordings.after(self._scene.stages())
