"""Features of LeRobot datasets: their names, shapes and dtypes, and columns of tables."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image

from warpcam.core.errors import WarpcamError

try:
    import pyarrow as pa
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and LeRobot datasets need it: pip install 'warpcam[datasets]'"
    ) from error

Feature = dict[str, Any]
IMAGE_ENDINGS = ("_rgb", "_image")  # of names of colour images, which the dataset's names lack
COUNTERS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
NAMES = {"actions": "action", "rewards": "next.reward", "success": "next.success"}
DIMENSIONS = 5  # of a feature at most


def is_image(array: np.ndarray) -> bool:
    """Whether a column (frame, ...) has colour images."""
    return array.dtype == np.uint8 and array.ndim == 4 and array.shape[3] == 3


def named(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return an episode's columns under the names of LeRobot's features, each (frame, ...)."""
    made: dict[str, np.ndarray] = {}
    for name, array in columns.items():
        if name in ("terminated", "truncated"):
            continue
        if name in NAMES:
            target = NAMES[name]
        elif name.startswith("observations/"):
            target = _observation(name.removeprefix("observations/").replace("/", "."), is_image(array))
        else:
            raise WarpcamError(f"Writer: the format 'lerobot' has no place for {name.split('/')[0]}")
        if target in made:
            raise WarpcamError(f"Writer: two columns would be {target!r}; rename one of them")
        made[target] = array
    ends = [columns[name] for name in ("terminated", "truncated") if name in columns]
    if ends:
        made["next.done"] = np.logical_or.reduce(ends)
    return made


def features_of(columns: Mapping[str, np.ndarray], video: bool) -> dict[str, Feature]:
    """Return the features of an episode, and the counters that all datasets have."""
    made: dict[str, Feature] = {}
    for name, array in columns.items():
        if is_image(array):
            sides = array.shape[1:3]
            if video and (sides[0] % 2 or sides[1] % 2):
                raise WarpcamError(
                    f"Writer: {name} is {sides[1]}x{sides[0]}, videos need even sides; video=False keeps images as PNG"
                )
            dtype, names = "video" if video else "image", ["height", "width", "channels"]
            made[name] = {"dtype": dtype, "shape": [*sides, 3], "names": names}
            continue
        shape = list(array.shape[1:]) or [1]
        if len(shape) > DIMENSIONS:
            raise WarpcamError(f"Writer: {name} has {len(shape)} dimensions beside that of worlds, 5 are allowed")
        made[name] = {"dtype": str(array.dtype), "shape": shape, "names": None}
    for name, dtype in COUNTERS.items():
        made[name] = {"dtype": dtype, "shape": [1], "names": None}
    return made


def column(array: np.ndarray, feature: Feature) -> Any:
    """Return a feature of all frames as a column of a table; images become PNG files within it."""
    if feature["dtype"] == "image":
        return image_column([_png(image) for image in array])
    flat = pa.array(np.ascontiguousarray(array).reshape(-1))
    shape = feature["shape"]
    if shape == [1]:
        return flat
    if len(shape) == 1:
        return pa.FixedSizeListArray.from_arrays(flat, shape[0])
    for size in reversed(shape):
        offsets = pa.array(np.arange(0, len(flat) + 1, size, dtype=np.int32))
        flat = pa.ListArray.from_arrays(offsets, flat)
    return flat


def image_column(files: Sequence[bytes]) -> Any:
    """Return a column of images, each a PNG or JPEG file within the table."""
    return pa.array(
        [{"bytes": file, "path": None} for file in files], pa.struct({"bytes": pa.binary(), "path": pa.string()})
    )


def _observation(name: str, image: bool) -> str:
    if not image:
        return f"observation.{name}"
    for ending in IMAGE_ENDINGS:
        if len(name) > len(ending):
            name = name.removesuffix(ending)
    return f"observation.images.{name}"


def _png(image: np.ndarray) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "png", compress_level=1)
    return stream.getvalue()
