"""WebDataset: a tar of each shard, with an image, depth, ids and labels of each frame."""

import io
import json
from typing import Any, ClassVar

import numpy as np
import webdataset

from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.generate.shards import write_json
from warpcam.datasets.writers.encode import encode_frame, encode_png, millimeters
from warpcam.datasets.writers.labels_table import as_json
from warpcam.datasets.writers.writer import Merge, ShardLayout, Writer


class WebDatasetWriter(Writer):
    """shards/NNNNNN/samples.tar; index.json lists them with their numbers of frames.

    Keys of a frame: "jpg" or "png"; "depth.png", mm as uint16, 0 for nothing, or with the option ``float_depth``
    "depth.npy", m as float32; "ids.npy", int32; "json", labels.
    """

    options: ClassVar = {"float_depth": False}

    def __init__(self, layout: ShardLayout):
        super().__init__(layout)
        self._file = (layout.folder / "samples.tar").open("wb")
        self._tar = webdataset.TarWriter(self._file, encoder=False, mtime=0)

    def encode(self, frame: Frame) -> dict[str, Any]:
        layout = self.layout
        depth = (
            {"depth.npy": _npy(frame.depth.astype(np.float32))}
            if layout.options["float_depth"]
            else {"depth.png": encode_png(millimeters(frame.depth))}
        )
        return {
            "__key__": frame.stem,
            layout.image_format: encode_frame(frame, layout),
            **depth,
            "ids.npy": _npy(frame.ids),
            "json": json.dumps(as_json(frame), allow_nan=False).encode(),
        }

    def append(self, encoded: dict[str, Any]) -> None:
        self._tar.write(encoded)

    def close(self) -> None:
        self._tar.close()
        self._file.close()

    @classmethod
    def merge(cls, merge: Merge) -> None:
        shards = [
            {
                "path": f"{shard.path.relative_to(merge.out).as_posix()}/samples.tar",
                "frames": shard.record["statistics"]["frames"],
            }
            for shard in merge.shards
        ]
        write_json(merge.out / "index.json", {"classes": merge.classes, "shards": shards}, indent=1)


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()
