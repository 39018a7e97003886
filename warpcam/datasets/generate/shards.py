"""Folder of a data set: shards that are there whole or not at all, and a manifest."""

import contextlib
import errno
import json
import os
import shutil
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate.plan import Plan, different

MANIFEST, LOCK, RECORD = "manifest.json", ".lock", "shard.json"
TEMPORARY = ".tmp"


@dataclass(frozen=True, eq=False)
class FinishedShard:
    """A shard that is there.

    Attributes:
        index: Its number.
        path: Its folder.
        record: What its shard.json says.
    """

    index: int
    path: Path
    record: dict[str, Any]


class ShardFolder:
    """Shards of a plan in its folder.

    Args:
        plan: What is made.
        root: Name of the folder in the data set that has the shards.
    """

    def __init__(self, plan: Plan, root: str):
        self._plan, self.out = plan, Path(plan.out)
        self.root = self.out / root

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """The plan's, with the digests of files as they were when they were first asked for."""
        return self._plan.parameters()

    def path(self, shard: int) -> Path:
        """Folder of a finished shard."""
        return self.root / f"{shard:06d}"

    def begin(self, shard: int) -> Path:
        """Make an empty temporary folder for a shard."""
        path = self.root / f".{shard:06d}-{_process()}{TEMPORARY}"
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir(parents=True)
        return path

    def commit(self, shard: int, temporary: Path, record: dict[str, Any]) -> None:
        """Write the shard's record, and give its folder the final name: from now on the shard is finished.

        Where another process has finished it meanwhile, its files stay, which are the same.
        """
        samples = self._plan.samples(shard)
        whole = {"shard": shard, "first": samples.start, "end": samples.stop, **record}
        write_json(temporary / RECORD, whole)
        if not self.is_finished(shard):
            shutil.rmtree(self.path(shard), ignore_errors=True)  # a last shard that was shorter
        try:
            temporary.rename(self.path(shard))
        except OSError:
            if not self.is_finished(shard):
                raise
            shutil.rmtree(temporary, ignore_errors=True)

    def finished(self) -> list[FinishedShard]:
        """Finished shards with all their samples, by number."""
        records = ((shard, self._record(shard)) for shard in range(self._plan.num_shards))
        return [FinishedShard(shard, self.path(shard), record) for shard, record in records if record is not None]

    def is_finished(self, shard: int) -> bool:
        """Whether a shard is there with all its samples."""
        return self._record(shard) is not None

    def remove_temporaries(self) -> None:
        for path in self.root.glob(f".*{TEMPORARY}"):
            shutil.rmtree(path, ignore_errors=True)

    @contextlib.contextmanager
    def locked(self, shared: bool = False) -> Iterator[None]:
        """Keep other runs out of the folder, which is made if need be, and check that it is this plan's.

        Args:
            shared: Whether other runs that share it may make other shards meanwhile.

        Raises:
            WarpcamError: The folder cannot be written, another run writes to it, or it is of another plan.
        """
        try:
            self.root.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.out / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise WarpcamError(f"dataset: folder {str(self.out)!r} cannot be written: {error.strerror}") from None
        try:
            _lock(handle, self.out, shared)
            self._check_manifest()
            if not shared:
                self.remove_temporaries()
            yield
        finally:
            os.close(handle)

    def write_manifest(self, more: dict[str, Any]) -> None:
        """Write the plan's parameters and more about the data set."""
        temporary = self.out / f"{MANIFEST}-{_process()}{TEMPORARY}"
        write_json(temporary, {**more, "count": self._plan.count, "parameters": self.parameters}, indent=1)
        temporary.replace(self.out / MANIFEST)

    def _record(self, shard: int) -> dict[str, Any] | None:
        """What the shard.json of a finished shard says."""
        samples = self._plan.samples(shard)
        try:
            record: dict[str, Any] = json.loads((self.path(shard) / RECORD).read_text())
            return record if (record["first"], record["end"]) == (samples.start, samples.stop) else None
        except (OSError, ValueError, KeyError):
            return None

    def _has_shards(self) -> bool:
        return any(self.root.glob("[0-9]*"))

    def _check_manifest(self) -> None:
        path = self.out / MANIFEST
        if not path.exists():
            others = (each for each in self.out.iterdir() if each.name != LOCK and not each.name.startswith(MANIFEST))
            if any(each != self.root for each in others) or self._has_shards():
                raise WarpcamError(f"dataset: folder {str(self.out)!r} has other files; give an empty or a new folder")
            return
        try:
            old = json.loads(path.read_text())
            parameters, count = old["parameters"], old["count"]
        except (ValueError, KeyError, TypeError) as error:
            raise WarpcamError(f"dataset: {str(path)!r} is no manifest: {error}") from None
        if not self._has_shards():  # a run that ended before its first shard
            return
        if names := different(parameters, self.parameters):
            raise WarpcamError(
                f"dataset: folder {str(self.out)!r} has another data set, made with other {', '.join(names)}; give the "
                "same parameters to go on with it, or another folder"
            )
        if count > self._plan.count:
            raise WarpcamError(
                f"dataset: folder {str(self.out)!r} has {count} samples, --count {self._plan.count} came"
            )


def write_json(path: Path, value: Any, indent: int | None = None) -> None:
    path.write_text(json.dumps(value, indent=indent, allow_nan=False) + "\n")


def explained(error: OSError, folder: Path) -> WarpcamError:
    """An error of the file system in words that say what to do."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return WarpcamError(
            f"dataset: no space left for {str(folder)!r}; finished shards are whole: free space and run the same "
            "command again to go on"
        )
    path = error.filename or folder
    return WarpcamError(f"dataset: {str(path)!r} cannot be written: {error.strerror or error}")


def _process() -> str:
    """A name that no other process has, here or on another machine."""
    return f"{socket.gethostname()}-{os.getpid()}"


def _lock(handle: int, folder: Path, shared: bool) -> None:
    try:
        import fcntl
    except ImportError:  # not on Windows, where nobody else is kept out
        return
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError:
        raise WarpcamError(f"dataset: another run writes to folder {str(folder)!r}") from None
