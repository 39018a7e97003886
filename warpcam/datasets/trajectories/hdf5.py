"""HDF5 files of demonstrations, as robomimic and as Isaac Lab lay them out."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.datasets.trajectories.episode import Episode
from warpcam.datasets.trajectories.hdf5_storage import check_compression, compressed
from warpcam.datasets.trajectories.parts import Parts, on_disk, replace, write_bytes

try:
    import h5py

    from warpcam.datasets.trajectories.hdf5_join import join
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and files of demonstrations need it: pip install 'warpcam[datasets]'"
    ) from error

Layout = dict[str, tuple[tuple[int, ...], str]]  # of datasets: shape of a row, dtype


class Hdf5File:
    """A file with a group ``data/demo_{number}`` for each episode.

    Each finished episode is a file of its own in ``{path}.parts`` until ``close`` makes the dataset of them.

    Args:
        path: Of the file.
        append: Whether to add to a file that is there, and to take up finished episodes of a recording that was not
            closed.
        env_args: JSON of the environment, in the attribute ``env_args`` of ``data``.
        attributes: Of each demonstration's group.
        compression: Level of gzip, 0 to 9; None is the format's own.
    """

    name: ClassVar[str] = ""
    own_compression: ClassVar[int | None] = None
    # What a recording may have, by its name there; and what it is called in a demonstration.
    names: ClassVar[Mapping[str, str]] = {}

    def __init__(
        self,
        path: Path,
        *,
        append: bool,
        env_args: Mapping[str, Any] | None,
        attributes: Mapping[str, Any] | None,
        compression: int | None,
    ):
        if path.suffix not in (".hdf5", ".h5"):
            raise WarpcamError(f"Writer: path {str(path)!r} came, a file that ends in .hdf5 or .h5 is needed")
        check_compression("Writer", compression)
        self.path, self._attributes = path, dict(attributes or {})
        self._env_args = self._whole_env_args(env_args)
        self._compression = self.own_compression if compression is None else compression
        if path.exists() and not append:
            raise WarpcamError(f"Writer: {str(path)!r} exists; append=True adds episodes to it")
        self._parts = Parts(path, suffix=path.suffix)
        left = self._parts.all()
        if left and not append:
            raise WarpcamError(
                f"Writer: {str(self._parts.folder)!r} has {len(left)} finished episodes of a recording that was not "
                "closed; append=True takes them up"
            )
        self._known, self._layout = self._read(path) if path.exists() else (0, None)
        for number, part in left:
            if number < self._known:  # of which the file has been made already
                part.unlink()
            elif self._layout is None:
                self._layout = self._read(part)[1]
        self.count = max([self._known, *(number + 1 for number, _ in left)])

    def check(self, columns: Mapping[str, np.ndarray]) -> None:
        """Raise for what the format lacks, and for what differs from the episodes that are there.

        Args:
            columns: (world, ...) by name.
        """
        for name in columns:
            if name.split("/")[0] not in self.names:
                raise WarpcamError(f"Writer: the format {self.name!r} has no place for {name.split('/')[0]}")
        layout = _layout(self.datasets(Episode({name: array[:1] for name, array in columns.items()})))
        if self._layout is None:
            self._layout = layout
        for name in sorted({*layout, *self._layout}):
            if layout.get(name) != self._layout.get(name):
                raise WarpcamError(
                    f"Writer: {name} is {_told(layout.get(name))} here, {_told(self._layout.get(name))} in the "
                    f"episodes of {str(self.path)!r}; episodes of one file must be alike"
                )

    def write(self, number: int, episode: Episode) -> None:
        """Write a finished episode to the disk."""
        attributes = {**self._attributes, "num_samples": len(episode)}
        if episode.success is not None:
            attributes["success"] = episode.success
        content = _content(f"demo_{number}", self.datasets(episode), attributes, self._compression)
        self._parts.add(number, lambda path: write_bytes(content, path))

    def close(self) -> None:
        """Make the file of all finished episodes."""
        parts = self._parts.all()
        before = self.path if self.path.exists() else None
        if parts or before is None:
            replace(
                self.path,
                lambda path: join(path, [part for _, part in parts], self._complete, before),
                f"{str(self.path)!r} could not be written, its episodes are in {str(self._parts.folder)!r}",
            )
        self._parts.remove()

    def datasets(self, episode: Episode) -> dict[str, np.ndarray]:
        """Return the datasets of a demonstration by name."""
        made = {}
        for name, target in self.names.items():
            if target:
                for key, array in episode.part(name).items():
                    made[f"{target}/{key}" if key else target] = array
        ends = [episode.columns[name] for name in ("terminated", "truncated") if name in episode.columns]
        done = np.logical_or.reduce(ends) if ends else np.zeros(len(episode), bool)
        return {**made, "dones": done.astype(np.int64)}

    def _whole_env_args(self, env_args: Mapping[str, Any] | None) -> dict[str, Any]:
        return dict(env_args or {})

    def _mark(self, file: Any) -> None:
        """Write attributes of the file itself."""

    def _read(self, path: Path) -> tuple[int, Layout | None]:
        """Return the number after the last demonstration's, and the layout of one of them."""
        with on_disk(f"Writer: {str(path)!r} cannot be read"), h5py.File(path, "r") as file:
            if "data" not in file:
                raise WarpcamError(f"Writer: {str(path)!r} has no group 'data', it is no file of demonstrations")
            numbers = sorted(int(name.removeprefix("demo_")) for name in file["data"])
            if not numbers:
                return 0, None
            arrays: dict[str, Any] = {}
            file[f"data/demo_{numbers[0]}"].visititems(
                lambda name, item: arrays.update({name: item}) if isinstance(item, h5py.Dataset) else None
            )
            return numbers[-1] + 1, _layout(arrays)

    def _complete(self, file: Any) -> None:
        """Write what a file has beside demonstrations."""
        self._mark(file)
        data = file["data"]
        if self._env_args or "env_args" not in data.attrs:
            data.attrs["env_args"] = json.dumps(self._env_args, indent=4)


class RobomimicFile(Hdf5File):
    """A file that robomimic's ``SequenceDataset`` reads."""

    name = "robomimic"
    names: ClassVar[Mapping[str, str]] = {
        "observations": "obs",
        "next_observations": "next_obs",
        "actions": "actions",
        "rewards": "rewards",
        "states": "states",
        "terminated": "",
        "truncated": "",
        "success": "",
    }

    def check(self, columns: Mapping[str, np.ndarray]) -> None:
        if any(name.startswith("states/") for name in columns):
            raise WarpcamError("Writer: states must be one array (world, number) for the format 'robomimic'")
        super().check(columns)


class IsaacLabFile(Hdf5File):
    """A file that Isaac Lab's ``HDF5DatasetFileHandler`` reads."""

    name = "isaaclab"
    own_compression = 2
    names: ClassVar[Mapping[str, str]] = {
        "observations": "obs",
        "actions": "actions",
        "rewards": "rewards",
        "states": "states",
        "initial_states": "initial_state",
        "terminated": "",
        "truncated": "",
        "success": "",
    }

    def datasets(self, episode: Episode) -> dict[str, np.ndarray]:
        made = super().datasets(episode)
        return {name: array[:1] if name.startswith("initial_state") else array for name, array in made.items()}

    def _whole_env_args(self, env_args: Mapping[str, Any] | None) -> dict[str, Any]:
        return {"env_name": "", "type": 2, **(env_args or {})}  # 2: an environment of Gymnasium, as robomimic counts

    def _mark(self, file: Any) -> None:
        file.attrs["format_version"] = 1  # quaternions are x y z w


def _content(group: str, datasets: Mapping[str, np.ndarray], attributes: Mapping[str, Any], level: int | None) -> bytes:
    """Return the bytes of a file with one demonstration, so that the disk's errors are the system's and not HDF5's."""
    with h5py.File(f"{group}.hdf5", "w", driver="core", backing_store=False) as file:
        demo = file.create_group(f"data/{group}")
        for name, array in datasets.items():
            demo.create_dataset(name, data=array, **compressed(array, level))
        for name, value in attributes.items():
            demo.attrs[name] = value
        file.flush()
        return bytes(file.id.get_file_image())


def _layout(datasets: Mapping[str, Any]) -> Layout:
    return {name: (tuple(array.shape[1:]), str(array.dtype)) for name, array in datasets.items()}


def _told(entry: tuple[tuple[int, ...], str] | None) -> str:
    return "absent" if entry is None else f"{entry[1]}{list(entry[0])}"
