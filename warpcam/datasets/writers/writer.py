"""What every format has: frames are encoded by many threads, appended in order, and shards are merged at the end."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar
from zlib import crc32

from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.generate.object_models import ObjectModel
from warpcam.datasets.generate.shards import FinishedShard


@dataclass(frozen=True, eq=False)
class ShardLayout:
    """What a writer knows of a shard before its first frame.

    Attributes:
        folder: Temporary folder of the shard.
        index: Number of the shard.
        frames: How many there will be.
        first: Number of the first one.
        cameras: Names of the cameras.
        classes: Names of the classes.
        keypoint_names: Names of the keypoints, by class.
        models: Surfaces of what is labelled; none unless the writer needs them.
        width: Of an image [pixels].
        height: Of an image [pixels].
        image_format: "png" or "jpg" of colour images.
        quality: Of .jpg.
        options: Of the writer.
    """

    folder: Path
    index: int
    frames: int
    first: int
    cameras: tuple[str, ...]
    classes: tuple[str, ...]
    keypoint_names: tuple[tuple[str, ...], ...]
    models: tuple[ObjectModel, ...]
    width: int
    height: int
    image_format: str
    quality: int
    options: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Merge:
    """Finished shards that become one data set.

    Attributes:
        out: Folder of the data set.
        shards: All shards, by number.
        classes: Names of the classes.
        keypoint_names: Names of the keypoints, by class.
        width: Of an image [pixels].
        height: Of an image [pixels].
        cameras: Names of the cameras.
        validation: Share of the samples for validation.
        seed: Of the data set.
        options: Of the writer.
    """

    out: Path
    shards: Sequence[FinishedShard]
    classes: tuple[str, ...]
    keypoint_names: tuple[tuple[str, ...], ...]
    width: int
    height: int
    cameras: tuple[str, ...]
    validation: float
    seed: int
    options: Mapping[str, Any]

    def splits(self) -> tuple[str, ...]:
        """Names of the parts."""
        return ("train", "val") if self.validation else ("train",)

    def split_of(self, sample: int) -> str:
        """Part of a sample, which follows from the seed and its number: it stays when the data set grows."""
        share = crc32(f"{self.seed} {sample} validation".encode()) / 2**32
        return "val" if share < self.validation else "train"


class Writer(ABC):
    """Writer of one shard.

    Attributes:
        root: Name of the folder of the shards.
        pinhole: True if all cameras must have a pinhole lens.
        masks: True if frames need amodal masks.
        whole: True if frames need boxes and pixels beyond the image's edges.
        models: True if shards need the surfaces of what is labelled.
        options: Default of each option that the format takes.
    """

    root: ClassVar[str] = "shards"
    pinhole: ClassVar[bool] = False
    masks: ClassVar[bool] = False
    whole: ClassVar[bool] = False
    models: ClassVar[bool] = False
    options: ClassVar[Mapping[str, Any]] = {}

    def __init__(self, layout: ShardLayout):
        self.layout = layout

    @abstractmethod
    def encode(self, frame: Frame) -> Any:
        """Encode one frame, and write the files that are its alone; many threads call this at once.

        Returns:
            What ``append`` takes.
        """

    @abstractmethod
    def append(self, encoded: Any) -> None:
        """Add what ``encode`` returned; frame after frame, by one thread."""

    @abstractmethod
    def close(self) -> None:
        """Write what the shard's frames have in common."""

    @classmethod
    @abstractmethod
    def merge(cls, merge: Merge) -> None:
        """Write what the shards have in common; done again, it writes the same."""

    @classmethod
    def check_options(cls, options: Mapping[str, Any]) -> dict[str, Any]:
        """The options with defaults in place of those that were not given.

        Raises:
            WarpcamError: An option is not known, or not of its kind.
        """
        for name, value in options.items():
            if name not in cls.options:
                allowed = ", ".join(cls.options) or "none"
                raise WarpcamError(f"--option: {name!r} came; options of this writer are: {allowed}")
            wanted = cls.options[name]
            if type(value) is not type(wanted) and not (type(wanted) is float and type(value) is int):
                kind = {bool: "true or false", float: "a number", int: "a whole number"}[type(wanted)]
                raise WarpcamError(f"--option: {name} must be {kind}, got {value!r}")
        return {**cls.options, **options}
