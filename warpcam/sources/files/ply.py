"""PLY files whose faces trimesh does not read: of different numbers of corners in binary files, and strips."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
INDICES = ("vertex_indices", "vertex_index")
STRIPS, COORDINATES = "tristrips", "texcoord"


@dataclass
class _Element:
    """An element of a header, and properties by name: the type, and that of the length if it is a list."""

    name: str
    count: int
    properties: dict[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def has_lists(self) -> bool:
        return any(length for _, length in self.properties.values())


def readable(path: Path, data: bytes, access: FileAccess) -> bytes:
    """A file's bytes, with triangles for its faces where trimesh needs that.

    Raises:
        RefusedError: The header says of more elements than there may be.
        WarpcamError: The file ends too early, or has no vertices.
    """
    end = data.find(b"end_header")
    lines = [line.split() for line in data[: max(end, 0)].decode("latin-1").splitlines()]
    form = next((words[1] for words in lines if words[:1] == ["format"] and len(words) > 1), "")
    elements = _elements(lines)
    for words in lines:
        if words[:1] == ["element"] and len(words) == 3 and words[2].isdigit():
            access.check("elements", int(words[2]), f"{path}: its header says of {words[1]!r} that it")
    if any(element.name == "vertex" and element.count == 0 for element in elements):
        raise WarpcamError(f"{path}: has 0 vertices: neither Gaussian splats nor triangles to draw")
    faces = next((element for element in elements if element.name in ("face", STRIPS)), None)
    if form not in ORDERS or faces is None or not set(INDICES) & set(faces.properties):
        return data
    try:
        tables = _tables(elements, data[data.index(b"\n", end) + 1 :], ORDERS[form])
    except (ValueError, StopIteration, struct.error):
        raise WarpcamError(f"{path}: is cut off, or is no PLY file: it ends before its header says") from None
    rows = tables[faces.name]
    name = next(name for name in INDICES if name in faces.properties)
    counts = {len(row[name]) for row in rows}
    plain = len(counts) <= 1 if form != "ascii" else len(faces.properties) == 1
    if faces.name == "face" and (counts <= {3} or (plain and counts <= {3, 4})):
        return data
    comments = [" ".join(words) for words in lines if words[:1] == ["comment"]]
    return _written(comments, elements, tables, faces, name)


def _elements(lines: list[list[str]]) -> list[_Element]:
    elements: list[_Element] = []
    for words in lines:
        if words[:1] == ["element"] and len(words) == 3 and words[2].isdigit():
            elements.append(_Element(words[1], int(words[2])))
        elif words[:2] == ["property", "list"] and len(words) == 5 and elements:
            elements[-1].properties[words[4]] = TYPES.get(words[3], ""), TYPES.get(words[2], "")
        elif words[:1] == ["property"] and len(words) == 3 and elements:
            elements[-1].properties[words[2]] = TYPES.get(words[1], ""), ""
    known = all(kind for element in elements for kind, _ in element.properties.values())
    return elements if known else []


def _tables(elements: list[_Element], body: bytes, order: str) -> dict[str, Any]:
    """Structured arrays of elements without lists, and rows, properties by name, of the others."""
    tables: dict[str, Any] = {}
    words, at = iter(body.split() if not order else ()), 0
    for element in elements:
        kinds = [(name, (order or "<") + kind) for name, (kind, _) in element.properties.items()]
        if element.has_lists:
            rows: list[dict[str, Any]] = []
            for _ in range(element.count):
                row = {}
                for name, (kind, length) in element.properties.items():
                    count, at = _numbers(words, body, at, order, length, 1) if length else ((1,), at)
                    values, at = _numbers(words, body, at, order, kind, int(count[0]))
                    row[name] = values if length else values[0]
                rows.append(row)
            tables[element.name] = rows
        elif order:
            tables[element.name] = np.frombuffer(body, np.dtype(kinds), element.count, at)
            at += tables[element.name].nbytes
        else:
            taken = list(islice(words, element.count * len(kinds)))
            columns = np.array(taken, np.float64).reshape(element.count, len(kinds))
            tables[element.name] = np.zeros(element.count, np.dtype(kinds))
            for place, (name, _) in enumerate(kinds):
                tables[element.name][name] = columns[:, place]
    return tables


def _numbers(
    words: Iterator[bytes], body: bytes, at: int, order: str, kind: str, count: int
) -> tuple[tuple[Any, ...], int]:
    """Numbers of one type, and where the next begin."""
    if not order:
        return tuple(float(next(words)) for _ in range(count)), at
    reader = struct.Struct(f"{order}{count}{np.dtype(kind).char}")
    return reader.unpack_from(body, at), at + reader.size


def _triangles(corners: tuple[Any, ...], strip: bool) -> list[tuple[int, int, int]]:
    """Places of a face's or a strip's corners; a corner of -1 begins another strip."""
    if not strip:
        return [(0, place, place + 1) for place in range(1, len(corners) - 1)]
    found, begun = [], 0
    for place, corner in enumerate(corners):
        if corner < 0:
            begun = place + 1
        elif place >= begun + 2:
            turned = (place - begun) % 2
            found.append((place - 2, place - 1 + turned, place - turned))
    return found


def _written(
    comments: list[str], elements: list[_Element], tables: dict[str, Any], faces: _Element, indices: str
) -> bytes:
    """The file again, with triangles."""
    words = {kind: name for name, kind in TYPES.items() if not name[-1].isdigit()}
    head, body = ["ply", "format binary_little_endian 1.0", *comments], b""
    for element in elements:
        if element is not faces and not element.has_lists:
            kinds = [(name, f"<{kind}") for name, (kind, _) in element.properties.items()]
            head.append(f"element {element.name} {element.count}")
            head += [f"property {words[kind]} {name}" for name, (kind, _) in element.properties.items()]
            body += tables[element.name].astype(np.dtype(kinds)).tobytes()
    cut = [(row, places) for row in tables[faces.name] for places in _triangles(row[indices], faces.name == STRIPS)]
    scalars = [(name, kind) for name, (kind, length) in faces.properties.items() if not length]
    laid = COORDINATES in faces.properties
    dtype = [("count", "u1"), ("corners", "<i4", 3), *((name, f"<{kind}") for name, kind in scalars)]
    rows = np.zeros(len(cut), np.dtype([*dtype, *([("size", "u1"), (COORDINATES, "<f4", 6)] if laid else [])]))
    rows["count"] = 3
    if laid:
        rows["size"] = 6
    for place, (row, places) in enumerate(cut):
        rows["corners"][place] = [row[indices][corner] for corner in places]
        for name, _ in scalars:
            rows[name][place] = row[name]
        if laid and len(row[COORDINATES]) == 2 * len(row[indices]):
            rows[COORDINATES][place] = [row[COORDINATES][2 * corner + side] for corner in places for side in (0, 1)]
    head += [f"element face {len(cut)}", "property list uchar int vertex_indices"]
    head += [f"property {words[kind]} {name}" for name, kind in scalars]
    head += [f"property list uchar float {COORDINATES}"] if laid else []
    return "\n".join([*head, "end_header\n"]).encode("latin-1") + body + rows.tobytes()
