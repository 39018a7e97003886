"""``Writer``: episodes of batched worlds, written by a thread while the loop goes on."""

import queue
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Protocol

import numpy as np
import torch

from warpcam.core.errors import WarpcamError
from warpcam.datasets.trajectories.episode import Buffers, Episode
from warpcam.datasets.trajectories.rows import Columns, Rows, RowsPool, flattened

# Options that not all formats have.
OPTIONS = {
    "lerobot": ("fps", "task", "robot_type", "video", "codec", "crf"),
    "robomimic": ("env_args", "attributes", "compression"),
    "isaaclab": ("env_args", "attributes", "compression"),
}
FLAGS = ("terminated", "truncated", "success", "recorded")  # (world,) bool


class _Format(Protocol):
    """What the thread writes episodes to."""

    count: int

    def check(self, columns: Mapping[str, np.ndarray]) -> None: ...
    def write(self, number: int, episode: Episode) -> None: ...
    def close(self) -> None: ...


class Writer:
    """Episodes of many worlds at once, as a dataset for learning from demonstrations.

    A row of an episode is an observation, the action that was chosen on it, and the reward and the end that followed::

        with Writer("lift", format="lerobot", fps=20, task="lift the cube") as writer:
            for _ in range(1000):
                writer.observe(observations)
                actions = policy(observations)
                observations, rewards, terminated, truncated, _ = env.step(actions)
                writer.step(actions=actions, rewards=rewards, terminated=terminated, truncated=truncated)

    Each world has a buffer on the host. The loop enqueues copies and goes on; a thread appends the rows, and writes
    each episode when it ends. When ``pending`` steps wait for the thread, the loop waits for it, too: nothing is left
    out. What keeps the thread from writing is raised at the next call, and again by ``close``.

    Finished episodes lie in ``{path}.parts`` until ``close`` makes the dataset of them, which needs as much room once
    more. After a crash or a full disk they are intact there, and a writer with ``append=True`` takes them up.

    Args:
        path: Of the dataset: a folder for "lerobot", a file ``.hdf5`` for the others.
        format: "lerobot" (LeRobot dataset v3.0), "robomimic" or "isaaclab" (HDF5).
        append: Whether to add to a dataset that is there. Its features must be equal.
        only_success: Whether episodes without success at their last step are left out.
        keep_unfinished: Whether ``close`` also writes the episodes that have not ended.
        pending: Steps that may wait for the thread, each with memory on the host for all worlds.
        fps: Steps of a second, a whole number. Of "lerobot", as the next five are.
        task: What the robots were told to do: one sentence, or one for each world.
        robot_type: Name of the robot.
        video: Whether colour images become mp4 files; False keeps them lossless, as PNG within the tables.
        codec: An encoder of ffmpeg for yuv420p.
        crf: Its constant rate factor; lower is better.
        env_args: What the environment is made from again, as JSON in the file. Of "robomimic" and "isaaclab", as the
            next two are.
        attributes: Of each demonstration, such as ``model_file``, the XML of the model.
        compression: Level of gzip, 0 to 9; None is none for "robomimic" and 2 for "isaaclab".
    """

    def __init__(
        self,
        path: str | Path,
        *,
        format: Literal["lerobot", "robomimic", "isaaclab"],
        append: bool = False,
        only_success: bool = False,
        keep_unfinished: bool = False,
        pending: int = 4,
        fps: int | None = None,
        task: str | Sequence[str] | None = None,
        robot_type: str | None = None,
        video: bool | None = None,
        codec: str | None = None,
        crf: int | None = None,
        env_args: Mapping[str, Any] | None = None,
        attributes: Mapping[str, Any] | None = None,
        compression: int | None = None,
    ):
        if isinstance(pending, bool) or not isinstance(pending, int) or pending < 1:
            raise WarpcamError(f"Writer: pending {pending!r} came, a whole number of at least 1 is needed")
        options = {
            "fps": fps, "task": task, "robot_type": robot_type, "video": video, "codec": codec, "crf": crf,
            "env_args": env_args, "attributes": attributes, "compression": compression,
        }  # fmt: skip
        self.path = Path(path)
        self._format = _format_of(format, self.path, append, options)
        self._only_success, self._keep_unfinished = only_success, keep_unfinished
        self._task = task
        self._pool = RowsPool(pending, self._raise_fault)
        self._steps: queue.SimpleQueue[Rows | None] = queue.SimpleQueue()
        self._buffers = Buffers()
        self._signature: dict[str, Any] = {}
        self._observed: Rows | None = None
        self._thread: threading.Thread | None = None
        self._fault: BaseException | None = None
        self._closed = False
        self.written = 0

    @property
    def episodes(self) -> int:
        """Episodes of the dataset that are on the disk, those that were there before among them."""
        return self._format.count

    def observe(self, observations: Any) -> None:
        """Take the observations of the row that ``step`` completes, before their memory is written over."""
        self._require_open()
        if self._observed is not None:
            raise WarpcamError("Writer: observe came twice, each must be followed by step")
        columns = dict(_observations("observations", observations))
        self._check(columns, complete=False)
        rows = self._pool.take()
        rows.fill(columns)
        self._observed = rows

    def step(
        self,
        *,
        actions: Any,
        observations: Any = None,
        rewards: Any = None,
        terminated: Any = None,
        truncated: Any = None,
        success: Any = None,
        states: Any = None,
        initial_states: Any = None,
        next_observations: Any = None,
        worlds: Any = None,
    ) -> None:
        """Add a row to the episode of each world.

        Arrays are torch tensors or Warp arrays on any device, or NumPy arrays, each with a first dimension of worlds.
        They may be written over after the call. Shapes, dtypes and names stay those of the first call.

        Args:
            actions: (world, number).
            observations: Arrays by name, or one array, which is ``state`` then: what the actions were chosen on. Colour
                images are (world, height, width, 3) uint8. None: what ``observe`` took.
            rewards: (world,).
            terminated: (world,) bool: where the episode ends with this row, because the task has ended.
            truncated: (world,) bool: likewise, for another reason, such as its length.
            success: (world,) bool: an episode's success is that of its last row.
            states: The simulator's states, an array or arrays by name: for "robomimic" those that the observations are
                of, (world, number), for "isaaclab" those after the step.
            initial_states: For "isaaclab": arrays by name, of which those of each episode's first row are kept.
            next_observations: For "robomimic": the observations after the step.
            worlds: (world,) bool: worlds that get a row; None is all.
        """
        self._require_open()
        columns: Columns = {}
        for name, value in {"observations": observations, "next_observations": next_observations}.items():
            if value is not None:
                columns.update(_observations(name, value))
        flags = dict(zip(FLAGS, (terminated, truncated, success, worlds), strict=True))
        others = {"actions": actions, "rewards": rewards, "states": states, "initial_states": initial_states}
        for name, value in {**others, **flags}.items():
            if value is not None:
                columns.update(flattened(name, value))
        rows, self._observed = self._observed, None
        if rows is not None and observations is not None:
            self._observed = rows
            raise WarpcamError("Writer: observations came both to observe and to step")
        before = {} if rows is None else rows.columns
        try:
            self._check({**{name: before[name] for name in before if _is_observation(name)}, **columns}, complete=True)
        except WarpcamError:
            self._observed = rows
            raise
        rows = rows or self._pool.take()
        rows.fill(columns)
        self._steps.put(rows)

    def close(self) -> None:
        """Write what has finished, and make the dataset. Raises what kept the thread from writing."""
        if self._closed:
            return
        self._closed = True
        if self._thread is not None:
            self._steps.put(None)
            self._thread.join()
        try:
            self._format.close()
        finally:
            self._raise_fault()

    def __enter__(self) -> "Writer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, raised: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._keep_unfinished = False
        try:
            self.close()
        except WarpcamError:
            if kind is None:
                raise

    def _require_open(self) -> None:
        if self._closed:
            raise WarpcamError(f"Writer: {str(self.path)!r} is closed")
        self._raise_fault()

    def _raise_fault(self) -> None:
        if self._fault is not None:
            raise WarpcamError(f"Writer: {self._fault}") from self._fault

    def _check(self, columns: Columns, complete: bool) -> None:
        """Raise where arrays are not as those of the first step; of the first one, where the format lacks a place."""
        signature = {name: (tuple(tensor.shape), tensor.dtype) for name, tensor in columns.items()}
        if not self._signature:
            if not complete:
                return
            self._first(columns)
            self._signature = signature
            self._thread = threading.Thread(target=self._run, name=f"Writer {self.path.name}", daemon=True)
            self._thread.start()
            return
        known = {name: value for name, value in self._signature.items() if complete or name.startswith("observations/")}
        for name in sorted({*known, *signature}):
            if known.get(name) != signature.get(name):
                raise WarpcamError(
                    f"Writer: {name} is {_told(signature.get(name))}, in the first step it was {_told(known.get(name))}"
                )

    def _first(self, columns: Columns) -> None:
        if "actions" not in columns or columns["actions"].ndim != 2:
            raise WarpcamError("Writer: actions must be one array (world, number)")
        count = len(columns["actions"])
        if not any(map(_is_observation, columns)):
            raise WarpcamError("Writer: observations are missing; give them to step or, before it, to observe")
        for name, tensor in columns.items():
            if len(tensor) != count:
                raise WarpcamError(f"Writer: {name} has {len(tensor)} worlds, actions have {count}")
            if name in FLAGS and (tensor.dtype is not torch.bool or tensor.ndim != 1):
                name = "worlds" if name == "recorded" else name
                raise WarpcamError(f"Writer: {name} must be (world,) bool, got {_told((tensor.shape, tensor.dtype))}")
        if "rewards" in columns and columns["rewards"].ndim != 1:
            raise WarpcamError(f"Writer: rewards must be (world,), got {tuple(columns['rewards'].shape)}")
        if self._only_success and "success" not in columns:
            raise WarpcamError("Writer: only_success needs success, which no step has")
        if self._task is not None and not isinstance(self._task, str) and len(self._task) != count:
            raise WarpcamError(f"Writer: task has {len(self._task)} sentences, actions have {count} worlds")
        shapes = {
            name: np.zeros((1, *tensor.shape[1:]), torch.zeros(0, dtype=tensor.dtype).numpy().dtype)
            for name, tensor in columns.items()
            if name != "recorded"
        }
        self._format.check(shapes)

    def _run(self) -> None:
        """Append rows and write episodes until there is no next step."""
        while (rows := self._steps.get()) is not None:
            if self._fault is None:
                try:
                    self._add(rows.arrays())
                except Exception as error:
                    self._fault = error
            self._pool.give(rows)
        if self._keep_unfinished and self._fault is None:
            try:
                self._finish(self._buffers.running())
            except Exception as error:
                self._fault = error

    def _add(self, arrays: dict[str, np.ndarray]) -> None:
        count = len(arrays["actions"])
        recorded = arrays.get("recorded", np.ones(count, bool))
        ended = np.zeros(count, bool)
        for name in ("terminated", "truncated"):
            ended |= arrays.get(name, False)
        self._buffers.append(
            {name: array for name, array in arrays.items() if name != "recorded"}, np.flatnonzero(recorded)
        )
        self._finish(np.flatnonzero(ended & recorded))

    def _finish(self, worlds: np.ndarray) -> None:
        for world, columns in self._buffers.taken(worlds):
            success = bool(columns["success"][-1]) if "success" in columns else None
            if self._only_success and not success:
                continue
            task = self._task if isinstance(self._task, str) else self._task[world] if self._task else ""
            self._format.write(self._format.count, Episode(columns, success, task))
            self._format.count += 1
            self.written += 1


def _format_of(format: str, path: Path, append: bool, options: Mapping[str, Any]) -> _Format:
    if format not in OPTIONS:
        raise WarpcamError(f"Writer: format {format!r} came, allowed are {', '.join(OPTIONS)}")
    own = {name: options[name] for name in OPTIONS[format]}
    for name, value in options.items():
        if name not in own and value is not None:
            raise WarpcamError(f"Writer: {name} {value!r} came, the format {format!r} has {', '.join(own)}")
    if format == "lerobot":
        from warpcam.datasets.trajectories.lerobot import LeRobotFolder

        return LeRobotFolder(path, append=append, **own)
    from warpcam.datasets.trajectories.hdf5 import IsaacLabFile, RobomimicFile

    kind = RobomimicFile if format == "robomimic" else IsaacLabFile
    return kind(path, append=append, **own)


def _observations(name: str, value: Any) -> Any:
    return flattened(name, value if isinstance(value, Mapping) else {"state": value})


def _is_observation(name: str) -> bool:
    return name.startswith("observations/")


def _told(entry: tuple[Any, torch.dtype] | None) -> str:
    return "absent" if entry is None else f"{entry[1]}{list(entry[0])}".removeprefix("torch.")
