"""A kernel launch bound to its arguments, ready to be repeated every frame."""

import functools
import itertools
import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import warp as wp

from warpcam.kernels.runtime import cpu_pool
from warpcam.kernels.runtime.compile import building, load_modules
from warpcam.kernels.runtime.streams import nonblocking_stream

STREAMS = 4  # chains of stages that really run side by side
BLOCK_DIM = 128  # threads in a CUDA block of stages that do not say otherwise


@dataclass(frozen=True)
class Group:
    """Worlds that a camera's stages draw together.

    Attributes:
        worlds: Which.
        concurrent_worlds: How many worlds are under way on the device at the same time, in this and in other groups:
            regions are as large as leaves that many enough of them to fill it.
    """

    worlds: range
    concurrent_worlds: int

    @classmethod
    def of_all(cls, num_worlds: int) -> "Group":
        return cls(range(num_worlds), num_worlds)


class MeshReads(IntEnum):
    """What work reads of meshes that move; each has those before."""

    FACES = 0  # where faces are, and the boxes around whole meshes
    NORMALS = 1  # what is shaded
    TREES = 2


class Stage:
    """One launch of a kernel with its arguments. ``launch()`` neither allocates nor syncs, but for the first time.

    On a CPU device the launch is split over threads; Warp runs each part without holding the GIL. While a graph
    is being captured the parts run one after another on the calling thread, which is the one that records.

    Attributes:
        independent: Of a scene's stages those that wait for none that are not aside, and that cameras' poses do not
            need.
        for_shading_only: Of a scene's stages those that write what colours and normals alone need.
        for_trees_only: Of a scene's stages those that write what rays on their way through trees alone need.
        reads: Of meshes that move.
        key: That of kernels/plan, which the kernel was compiled for; None for kernels without variants.
    """

    independent = False
    for_shading_only = False
    for_trees_only = False
    reads = MeshReads.TREES
    key: Any = None

    def __init__(
        self, kernel: wp.Kernel, dim: int, inputs: Sequence[Any], device: wp.Device, start: int, block_dim: int
    ):
        self.module, self.block_dim, self.device = kernel.module, block_dim, device
        self._kernel, self._dim, self._inputs, self._start = kernel, dim, inputs, start
        self._parts: tuple[wp.Launch, ...] = ()
        self._whole: wp.Launch | None = None  # all parts as one, where there are several
        self._busy = math.inf  # seconds of all threads of a CPU at the last launch

    @property
    def is_ready(self) -> bool:
        """True if it is ready for launches."""
        return bool(self._parts)

    def prepare(self) -> None:
        """Make ready for launches; compiles and loads the kernel if nobody did."""
        count = min(self._dim, 1 if self.device.is_cuda else cpu_pool.cpu_chunks())
        bounds = [self._dim * i // max(count, 1) for i in range(count + 1)]
        with building:
            load_modules([(self.module, self.block_dim)], self.device)
            self._whole = self._bound(0, self._dim) if count > 1 else None
            self._parts = tuple(self._bound(first, end) for first, end in itertools.pairwise(bounds))

    def _bound(self, first: int, end: int) -> wp.Launch:
        """A launch of some of the threads."""
        block_dim = {"block_dim": self.block_dim} if self.device.is_cuda else {}
        inputs = [*self._inputs, self._start + first]
        return wp.launch(self._kernel, end - first, inputs, device=self.device, record_cmd=True, **block_dim)

    def launch(self, stream: wp.Stream | None = None) -> None:
        """Enqueue the work on a stream, the device's current one unless given (CUDA), or finish it (CPU)."""
        if not self._parts:
            self.prepare()
        if self._whole is not None and not self.device.is_capturing:
            self._launch_shared(self._whole)
        else:
            for part in self._parts:
                part.launch(stream)

    def _launch_shared(self, whole: wp.Launch) -> None:
        """Launch the parts on the calling thread and on others that come to help, or all as one if none is to come.

        Others are woken as far as the last launch was long enough for them to be worth it. What they did not begin
        before nothing was left is not waited for.
        """
        threads = min(cpu_pool.cpu_threads(), int(min(self._busy / cpu_pool.MIN_SECONDS_PER_THREAD, len(self._parts))))
        if threads < 2:
            self._busy = cpu_pool.drain(deque([whole]))
            return
        left = deque(self._parts)
        others = cpu_pool.submit_helpers(functools.partial(cpu_pool.drain, left), threads - 1)
        busy = cpu_pool.drain(left)
        self._busy = busy + sum(other.result() for other in others if not other.cancel())


class FrameGraph:
    """Stages in their order: phase after phase, each of chains that may run side by side.

    ``launch()`` neither allocates nor syncs. It may be part of a capture.

    Args:
        phases: Phases.
        device: Where they run.
        late: Stages that those wait for which read more of moving meshes than faces. They run beside the others.
        begin: The phase that they begin with.
    """

    def __init__(
        self,
        phases: Sequence[Sequence[Sequence[Stage]]],
        device: wp.Device,
        late: Sequence[Stage] = (),
        begin: int = 0,
    ):
        self.phases = tuple(
            tuple(tuple(itertools.chain(*chains[k::STREAMS])) for k in range(min(STREAMS, len(chains))))
            for chains in phases
        )
        self._device, self._late, self._begin = device, tuple(late), begin
        beside = max(map(len, self.phases), default=1) - 1 if device.is_cuda else 0
        self._streams = [nonblocking_stream(device) for _ in range(beside)]
        self._begun = wp.Event(device) if beside else None
        self._done = [wp.Event(device) for _ in range(beside)]
        apart = device.is_cuda and bool(late)
        self._late_stream = nonblocking_stream(device) if apart else None
        self._late_begun, self._late_done = (wp.Event(device) if apart else None for _ in range(2))
        self._waiting: set[int] = set()  # streams that do not know yet that the late stages are done

    @property
    def stages(self) -> Iterator[Stage]:
        yield from self._late
        for chains in self.phases:
            yield from itertools.chain(*chains)

    def launch(self, stream: wp.Stream | None = None) -> None:
        """Enqueue the frame on a stream, the device's current one unless given (CUDA), or finish it (CPU)."""
        if stream is None and self._device.is_cuda:
            stream = self._device.stream
        for number, chains in enumerate(self.phases):
            if number == self._begin:
                self._launch_late(stream)
            if len(chains) > 1 and stream is not None and self._streams:
                self._launch_together(chains, stream)
            else:
                for stage in itertools.chain(*chains):
                    self._launch(stage, stream)
        self._wait(stream)
        self._waiting.clear()  # the next frame's late stages are others, of a capture perhaps

    def _launch_late(self, stream: wp.Stream | None) -> None:
        if stream is not None and self._late_stream is not None:
            stream.record_event(self._late_begun)
            self._late_stream.wait_event(self._late_begun)
            self._waiting = {id(each) for each in (stream, *self._streams)}
        for stage in self._late:
            stage.launch(self._late_stream)
        if self._late_stream is not None:
            self._late_stream.record_event(self._late_done)

    def _launch(self, stage: Stage, stream: wp.Stream | None) -> None:
        if stage.reads > MeshReads.FACES:
            self._wait(stream)
        stage.launch(stream)

    def _wait(self, stream: wp.Stream | None) -> None:
        """Let a stream wait for the late stages, once."""
        if stream is not None and id(stream) in self._waiting:
            self._waiting.discard(id(stream))
            stream.wait_event(self._late_done)

    def _launch_together(self, chains: Sequence[Sequence[Stage]], stream: wp.Stream) -> None:
        beside = list(zip(self._streams, self._done, strict=True))[: len(chains) - 1]
        stream.record_event(self._begun)
        for side, _ in beside:
            side.wait_event(self._begun)
        # One stage of each chain in turn, so that none waits for the host.
        for stages in itertools.zip_longest(*chains):
            for stage, where in zip(stages, (stream, *(side for side, _ in beside)), strict=True):
                if stage is not None:
                    self._launch(stage, where)
        for side, done in beside:
            side.record_event(done)
            stream.wait_event(done)


def prepare(stages: Sequence[Stage]) -> None:
    """Make stages of one device ready for launches, compiling their kernels together.

    Those of last stages come first, as they take longest: CUDA's compiler reads one module at a time.
    """
    if stages:
        load_modules([(stage.module, stage.block_dim) for stage in reversed(stages)], stages[0].device)
    for stage in stages:
        stage.prepare()


def launch_kernel(
    kernel: wp.Kernel,
    dim: Any,
    inputs: Sequence[Any],
    outputs: Sequence[Any] = (),
    *,
    device: wp.Device,
    block_dim: int | None = None,
) -> None:
    """Launch a kernel on its device's current stream, in threads that may be the first to need it."""
    with building:
        wp.launch(kernel, dim, inputs, outputs, device=device, block_dim=block_dim)


def run(stages: Sequence[Stage]) -> None:
    """Launch stages of one device one after another; those that never were are made ready together."""
    prepare([stage for stage in stages if not stage.is_ready])
    for stage in stages:
        stage.launch()


def bind_launch(
    kernel: wp.Kernel,
    dim: int,
    inputs: Sequence[Any],
    device: wp.Device,
    *,
    start: int = 0,
    block_dim: int = BLOCK_DIM,
    key: Any = None,
) -> Stage:
    """A 1-D kernel with its arguments.

    Args:
        kernel: Its last parameter is ``first: wp.int32``; its index is ``first + wp.tid()``.
        dim: Number of threads, below 2^31.
        inputs: All arguments but ``first``.
        device: Where the arguments lie.
        start: The index of the first thread; ``start + dim`` is below 2^31.
        block_dim: Threads in a CUDA block.
        key: That of kernels/plan, which the kernel was compiled for.
    """
    stage = Stage(kernel, dim, inputs, device, start, block_dim)
    stage.key = key
    return stage
