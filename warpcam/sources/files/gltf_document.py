"""glTF documents: the description, the buffers, and what their accessors hold (glTF 2.0, section 3.6.2)."""

import base64
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from warpcam.core.errors import RefusedError, WarpcamError
from warpcam.core.file_access import FileAccess

MAGIC = b"glTF"
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
COMPONENTS: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class Document:
    """A glTF file.

    Attributes:
        path: Of the file.
        tree: Its description.
        access: What it may open.

    Raises:
        RefusedError: A file lies outside of what may be opened, or something is too large.
        WarpcamError: The file is none, or a buffer of it cannot be read.
    """

    def __init__(self, path: Path, access: FileAccess):
        self.path, self.access = path, access
        data = access.read(path)
        self._binary = b""
        if data[:4] == MAGIC:
            data = self._chunks(data)
        try:
            tree = json.loads(data)
        except (ValueError, RecursionError) as error:
            raise WarpcamError(f"{path}: its description is not JSON: {str(error)[:200]}") from None
        if not isinstance(tree, dict):
            raise WarpcamError(f"{path}: its description must be a JSON object, got a {type(tree).__name__}")
        self.tree: dict[str, Any] = tree
        self._buffers: dict[int, bytes] = {}

    def listed(self, name: str) -> list[Any]:
        """A list of the description; empty if there is none."""
        found = self.tree.get(name)
        return found if isinstance(found, list) else []

    def buffer(self, index: int) -> bytes:
        """The bytes of a buffer."""
        if index not in self._buffers:
            uri = self._entry("buffers", index).get("uri")
            found = self._binary if uri is None and index == 0 else self.bytes_of(uri)
            if found is None:
                raise WarpcamError(f"{self.path}: buffer {index}: {str(uri)[:200]!r} cannot be read")
            self._buffers[index] = found
        return self._buffers[index]

    def bytes_of(self, uri: Any) -> bytes | None:
        """The content behind a URI: data, or a file beside this one, whose name is percent-encoded; None if none."""
        if not isinstance(uri, str):
            return None
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            self.access.take(len(body), f"{self.path}: a data URI")
            try:
                return base64.b64decode(unquote(body)) if head.endswith(";base64") else unquote_to_bytes(body)
            except ValueError:
                return None
        try:
            return self.access.read(self.access.find(self.path.parent, unquote(uri), uri))
        except RefusedError:
            raise
        except (OSError, ValueError):
            return None

    def view(self, index: Any) -> bytes:
        """The bytes of a view of a buffer."""
        view = self._entry("bufferViews", index)
        data, start, length = self.buffer(view.get("buffer", -1)), view.get("byteOffset", 0), view.get("byteLength", 0)
        if not all(isinstance(number, int) for number in (start, length)) or not 0 <= start <= start + length <= len(
            data
        ):
            raise WarpcamError(f"{self.path}: bufferViews[{index}]: its {length} bytes reach beyond the buffer's end")
        return data[start : start + length]

    def accessor(self, index: int) -> np.ndarray:
        """The elements of an accessor, (count, width): sparse ones in place, normalized integers as float32."""
        entry = self._entry("accessors", index)
        dtype, width = self._kind(entry, index)
        count = self._count(entry, index)
        if entry.get("bufferView") is None:
            self.access.take(count * width * dtype.itemsize, f"{self.path}: accessor {index}")
            values = np.zeros((count, width), dtype)
        else:
            values = self._elements(entry, index, count, dtype, width)
        sparse = entry.get("sparse")
        if isinstance(sparse, Mapping):
            few = self._count(sparse, index)
            places = sparse.get("indices", {})
            kind = COMPONENTS.get(places.get("componentType"), COMPONENTS[5125])
            rows = self._elements(places, index, few, kind, 1).reshape(-1).astype(np.int64)
            if few and rows.max() >= count:
                raise WarpcamError(
                    f"{self.path}: accessor {index}: a sparse index is {rows.max()}, it has {count} elements"
                )
            values = values.copy()
            values[rows] = self._elements(sparse.get("values", {}), index, few, dtype, width)
        return normalized(values) if entry.get("normalized") else values

    def _kind(self, entry: Mapping[str, Any], index: int) -> tuple[np.dtype[Any], int]:
        dtype, width = COMPONENTS.get(entry.get("componentType", 0)), WIDTHS.get(str(entry.get("type")))
        if dtype is None or width is None:
            raise WarpcamError(
                f"{self.path}: accessor {index}: componentType {entry.get('componentType')!r} and type "
                f"{entry.get('type')!r} came; allowed are {', '.join(map(str, COMPONENTS))} and {', '.join(WIDTHS)}"
            )
        return dtype, width

    def _count(self, entry: Mapping[str, Any], index: int) -> int:
        count = entry.get("count")
        if isinstance(count, bool) or not isinstance(count, int) or count < 0:
            raise WarpcamError(
                f"{self.path}: accessor {index}: count must be a whole number of at least 0, got {count!r}"
            )
        self.access.check("elements", count, f"{self.path}: accessor {index}")
        return count

    def _elements(
        self, entry: Mapping[str, Any], index: int, count: int, dtype: np.dtype[Any], width: int
    ) -> np.ndarray:
        """Elements of a view of a buffer, (count, width), without a copy."""
        view = self._entry("bufferViews", entry.get("bufferView", -1))
        data = self.buffer(view.get("buffer", -1))
        step = view.get("byteStride") or dtype.itemsize * width
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        if count and (start < 0 or start + step * (count - 1) + dtype.itemsize * width > len(data)):
            raise WarpcamError(f"{self.path}: accessor {index}: its {count} elements reach beyond the buffer's end")
        return (
            np.ndarray((count, width), dtype, data, start, (step, dtype.itemsize))
            if count
            else np.zeros((0, width), dtype)
        )

    def _entry(self, name: str, index: Any) -> Mapping[str, Any]:
        entries = self.listed(name)
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(entries):
            raise WarpcamError(f"{self.path}: {name} must be indices from 0 to {len(entries) - 1}, got {index!r}")
        entry = entries[index]
        if not isinstance(entry, dict):
            raise WarpcamError(f"{self.path}: {name}[{index}] must be a JSON object, got a {type(entry).__name__}")
        return entry

    def _chunks(self, data: bytes) -> bytes:
        """The description of a binary file; its binary chunk is kept."""
        start, description = 12, b""
        while start + 8 <= len(data):
            length, kind = (int.from_bytes(data[at : at + 4], "little") for at in (start, start + 4))
            body = data[start + 8 : start + 8 + length]
            if kind == JSON_CHUNK and not description:
                description = body
            elif kind == BINARY_CHUNK and not self._binary:
                self._binary = body
            start += 8 + length
        return description


def normalized(values: np.ndarray) -> np.ndarray:
    """Integers as the fractions that they stand for, float32: section 3.6.2.2 of the specification."""
    if values.dtype.kind == "f":
        return values
    most = np.float32(np.iinfo(values.dtype).max)
    return np.maximum(values.astype(np.float32) / most, np.float32(-1.0))
