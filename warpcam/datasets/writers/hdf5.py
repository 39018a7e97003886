"""HDF5: a file of each shard, and one that shows all of them as one."""

import json
from typing import Any, ClassVar

import h5py

from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.writers.labels_table import as_json
from warpcam.datasets.writers.writer import Merge, ShardLayout, Writer

LEVEL = 1  # of gzip: it is most of the time


class Hdf5Writer(Writer):
    """shards/NNNNNN/samples.h5, and dataset.h5 whose virtual datasets span all of them.

    Datasets: "rgb" uint8 (frame, height, width, 3); "depth" float32 (frame, height, width) [m], inf where nothing is
    hit; "ids" int32 (frame, height, width); "sample" int64 (frame,); "labels", JSON of each frame. The attributes are
    "classes" and "cameras".
    """

    options: ClassVar = {"compress": True}

    def __init__(self, layout: ShardLayout):
        super().__init__(layout)
        self._count = 0
        self._file = h5py.File(layout.folder / "samples.h5", "w", libver="latest")
        self._file.attrs["classes"], self._file.attrs["cameras"] = list(layout.classes), list(layout.cameras)
        size, packed = (layout.height, layout.width), {}
        if layout.options["compress"]:
            packed = {"compression": "gzip", "compression_opts": LEVEL, "shuffle": True}
        for name, dtype, shape in (("rgb", "u1", (*size, 3)), ("depth", "f4", size), ("ids", "i4", size)):
            self._file.create_dataset(name, (layout.frames, *shape), dtype, chunks=(1, *shape), **packed)
        self._file.create_dataset("sample", (layout.frames,), "i8")
        self._file.create_dataset("labels", (layout.frames,), h5py.string_dtype())

    def encode(self, frame: Frame) -> tuple[Frame, str]:
        return frame, json.dumps(as_json(frame), allow_nan=False)

    def append(self, encoded: tuple[Frame, str]) -> None:
        frame, labels = encoded
        for name, image in (("rgb", frame.colors), ("depth", frame.depth), ("ids", frame.ids)):
            self._file[name][self._count] = image
        self._file["sample"][self._count], self._file["labels"][self._count] = frame.sample, labels
        self._count += 1

    def close(self) -> None:
        self._file.close()

    @classmethod
    def merge(cls, merge: Merge) -> None:
        counts = [shard.record["statistics"]["frames"] for shard in merge.shards]
        total, size = sum(counts), (merge.height, merge.width)
        kinds: dict[str, tuple[Any, tuple[int, ...]]] = {
            "rgb": ("u1", (*size, 3)),
            "depth": ("f4", size),
            "ids": ("i4", size),
            "sample": ("i8", ()),
            "labels": (h5py.string_dtype(), ()),
        }
        temporary = merge.out / "dataset.h5.tmp"
        with h5py.File(temporary, "w", libver="latest") as file:
            file.attrs["classes"], file.attrs["cameras"] = list(merge.classes), list(merge.cameras)
            for name, (dtype, shape) in kinds.items():
                layout, first = h5py.VirtualLayout((total, *shape), dtype), 0
                for shard, count in zip(merge.shards, counts, strict=True):
                    path = f"{shard.path.relative_to(merge.out).as_posix()}/samples.h5"
                    layout[first : first + count] = h5py.VirtualSource(path, name, (count, *shape), dtype)
                    first += count
                file.create_virtual_dataset(name, layout)
        temporary.replace(merge.out / "dataset.h5")
