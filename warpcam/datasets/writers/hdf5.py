"""HDF5: a file of each shard, and one that shows all of them as one."""

import json
import zlib
from typing import Any, ClassVar

import h5py
import numpy as np

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
        self._file = h5py.File(layout.folder / "samples.h5", "w")
        self._file.attrs["classes"], self._file.attrs["cameras"] = list(layout.classes), list(layout.cameras)
        size, packed = (layout.height, layout.width), {}
        if layout.options["compress"]:
            packed = {"compression": "gzip", "compression_opts": LEVEL, "shuffle": True}
        for name, dtype, shape in (("rgb", "u1", (*size, 3)), ("depth", "f4", size), ("ids", "i4", size)):
            self._file.create_dataset(name, (layout.frames, *shape), dtype, chunks=(1, *shape), **packed)
        self._file.create_dataset("sample", (layout.frames,), "i8")
        self._file.create_dataset("labels", (layout.frames,), h5py.string_dtype())

    def encode(self, frame: Frame) -> tuple[int, dict[str, bytes], str]:
        images = {"rgb": frame.colors, "depth": frame.depth, "ids": frame.ids}
        chunks = {name: self._chunk(image) for name, image in images.items()}
        return frame.sample, chunks, json.dumps(as_json(frame), allow_nan=False)

    def append(self, encoded: tuple[int, dict[str, bytes], str]) -> None:
        sample, chunks, labels = encoded
        for name, chunk in chunks.items():
            dataset = self._file[name]
            dataset.id.write_direct_chunk((self._count, *(0 for _ in dataset.shape[1:])), chunk)
        self._file["sample"][self._count], self._file["labels"][self._count] = sample, labels
        self._count += 1

    def _chunk(self, image: np.ndarray) -> bytes:
        """An image as HDF5 stores it: bytes of numbers sorted by their place in the number, and deflated.

        HDF5 itself would do this frame after frame, as one thread alone may use it.
        """
        plain = np.ascontiguousarray(image)
        if not self.layout.options["compress"]:
            return plain.tobytes()
        sorted_bytes = plain.view(np.uint8).reshape(-1, plain.itemsize).T
        return zlib.compress(sorted_bytes.tobytes(), LEVEL)

    def close(self) -> None:
        self._file.close()

    @classmethod
    def merge(cls, merge: Merge) -> None:
        counts = [shard.record["statistics"]["frames"] for shard in merge.shards]
        size = (merge.height, merge.width)
        kinds: dict[str, tuple[Any, tuple[int, ...]]] = {
            "rgb": ("u1", (*size, 3)),
            "depth": ("f4", size),
            "ids": ("i4", size),
            "sample": ("i8", ()),
            "labels": (h5py.string_dtype(), ()),
        }
        temporary = merge.out / "dataset.h5.tmp"
        with h5py.File(temporary, "w") as file:
            file.attrs["classes"], file.attrs["cameras"] = list(merge.classes), list(merge.cameras)
            for name, (dtype, shape) in kinds.items():
                parts = [
                    (f"{shard.path.relative_to(merge.out).as_posix()}/samples.h5", count)
                    for shard, count in zip(merge.shards, counts, strict=True)
                ]
                _create_virtual(file, name, h5py.h5t.py_create(np.dtype(dtype), logical=True), shape, parts)
        temporary.replace(merge.out / "dataset.h5")


def _create_virtual(file: Any, name: str, kind: Any, shape: tuple[int, ...], parts: list[tuple[str, int]]) -> None:
    """Create a dataset that shows those of several files one after another, without the time when it was made.

    h5py's own function has no way to leave that away, and the same data set would never be the same file.
    """
    space = h5py.h5s.create_simple((sum(count for _, count in parts), *shape))
    settings = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    settings.set_obj_track_times(False)
    first = 0
    for path, count in parts:
        space.select_hyperslab((first, *(0 for _ in shape)), (count, *shape))
        source = h5py.h5s.create_simple((count, *shape))
        settings.set_virtual(space, path.encode(), name.encode(), source)
        first += count
    space.select_all()
    h5py.h5d.create(file.id, name.encode(), kind, space, settings)
