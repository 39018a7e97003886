"""The 4-wide tree of one mesh: checked, built once, and kept on disk by content."""

import hashlib
import os
import struct
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warpcam.accel import tree_cache
from warpcam.core.errors import WarpcamError
from warpcam.kernels.build import bvh4 as bvh4_build
from warpcam.kernels.runtime.cpu_pool import cpu_threads

MAX_DEPTH = bvh4_build.MAX_DEPTH
MAX_MAGNITUDE = 1e18  # of a coordinate [m]; beyond it a float32 ray test overflows
CACHED_ABOVE = 2000  # faces; smaller meshes build faster than a file opens

_MAGIC = b"warpcam bvh4\n"
_LAYOUT = 2  # part of every key: raise it when the rows' meaning changes
_SIZES = struct.Struct("<qqq")  # node rows, face rows, depth
_DIGEST_BYTES = hashlib.sha256().digest_size


@dataclass(frozen=True, eq=False)
class Bvh4:
    """A mesh's tree, as ``Meshes`` in ``kernels/types.py`` has it: rows and indices relative to the mesh.

    Attributes:
        nodes: (7 * node, 4) float32. The root is node 0.
        faces: (3 * face, 4) float32, in leaf order. Every face once, and again for each further leaf that a long face
            was cut into.
        depth: Levels of nodes, 1 to ``MAX_DEPTH``. A traversal that pushes at most three children a level needs a
            stack of ``3 * depth`` entries.
    """

    nodes: np.ndarray
    faces: np.ndarray
    depth: int


def build_bvh4s(meshes: Sequence[tuple[np.ndarray, np.ndarray, str | None]], *, cache: bool = True) -> list[Bvh4]:
    """Build the tree of each mesh, on all cores, or read it from the cache.

    ``tree_cache.py`` has the folder of files, named by content. A file there that is not whole and the mesh's own is
    ignored and written again; a folder that cannot be written means no cache.

    Args:
        meshes: Of each its vertices, (vertex, 3) float32, finite, magnitudes below 1e18 [m]; its faces, (face, 3)
            int32, indices of vertices, counterclockwise seen from the front; and what to call it in an error message.
            Faces without area are kept, no ray hits them. No faces at all give a tree of one node without children.
        cache: Keep the trees of meshes of more than 2,000 faces on disk.

    Raises:
        WarpcamError: An argument is not as described.
    """
    checked = [_checked(*mesh) for mesh in meshes]
    folder = tree_cache.folder() if cache and tree_cache.limit() else None
    places = [_place(folder, *arrays) for arrays in checked]
    found = [
        _read(*place, len(faces)) if place is not None else None if len(faces) else _empty()
        for place, (_, faces) in zip(places, checked, strict=True)
    ]
    missing = [k for k, tree in enumerate(found) if tree is None]
    if missing:
        bvh4_build.load()
    with ThreadPoolExecutor(cpu_threads()) as pool:
        trees = list(pool.map(lambda k: Bvh4(*bvh4_build.build(*checked[k])), missing))
    for k, tree in zip(missing, trees, strict=True):
        found[k] = tree
        if (place := places[k]) is not None:
            _write(*place, tree)
    if folder is not None and missing:
        tree_cache.trim(folder)
    return [tree for tree in found if tree is not None]


def _place(folder: Path | None, vertices: np.ndarray, faces: np.ndarray) -> tuple[Path, bytes] | None:
    """The file of a mesh's tree, and its key; None where it has none."""
    if folder is None or len(faces) <= CACHED_ABOVE:
        return None
    key = _key(vertices, faces)
    return folder / tree_cache.TREES / key.hex(), key


def _checked(vertices: np.ndarray, faces: np.ndarray, name: str | None) -> tuple[np.ndarray, np.ndarray]:
    """The arrays, contiguous, or the error that says what is wrong with them."""
    mesh = "mesh" if name is None else f"mesh '{name}'"
    for what, array, dtype in (("vertices", vertices, np.float32), ("faces", faces, np.int32)):
        if not isinstance(array, np.ndarray):
            raise WarpcamError(f"{mesh}: {what} must be a numpy array, got {type(array).__name__}")
        if array.dtype != dtype:
            raise WarpcamError(f"{mesh}: {what} must have dtype {np.dtype(dtype).name}, got {array.dtype}")
        if array.ndim != 2 or array.shape[1] != 3:
            raise WarpcamError(f"{mesh}: {what} must have shape (n, 3), got {array.shape}")
    if len(faces) > bvh4_build.MAX_FACES:
        raise WarpcamError(f"{mesh}: faces must be at most {bvh4_build.MAX_FACES}, got {len(faces)}")
    usable = np.abs(vertices) < MAX_MAGNITUDE  # false for NaN
    if not usable.all():
        row = int(np.argmin(usable.all(axis=1)))
        raise WarpcamError(
            f"{mesh}: vertices must be finite with magnitudes below {MAX_MAGNITUDE:g}, got {vertices[row].tolist()} "
            f"at vertex {row}"
        )
    if faces.size and not (0 <= faces.min() and faces.max() < len(vertices)):
        row = int(np.argmax(((faces < 0) | (faces >= len(vertices))).any(axis=1)))
        raise WarpcamError(
            f"{mesh}: faces must index its {len(vertices)} vertices, got {faces[row].tolist()} at face {row}"
        )
    return np.ascontiguousarray(vertices), np.ascontiguousarray(faces)


def _empty() -> Bvh4:
    nodes = np.zeros((7, 4), np.float32)
    nodes[:6] = bvh4_build.ABSENT
    return Bvh4(nodes, np.zeros((0, 4), np.float32), 1)


def _key(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """Digest of all that decides what a tree is: the mesh, the builder's source, the layout."""
    digest = hashlib.sha256(_MAGIC)
    digest.update(f"{_LAYOUT} {sys.byteorder} {len(vertices)} {len(faces)}\n".encode())
    for header in bvh4_build.HEADERS:
        digest.update(header.read_bytes())
    digest.update(vertices.data)
    digest.update(faces.data)
    return digest.digest()


def _read(path: Path, key: bytes, num_faces: int) -> Bvh4 | None:
    """The tree in a cache file; None unless the file is, to the last bit, what `_write` wrote for this key."""
    head_bytes = len(_MAGIC) + len(key) + _SIZES.size
    try:
        if not path.is_file():
            return None
        with path.open("rb") as file:
            head = file.read(head_bytes)
            if len(head) < head_bytes or not head.startswith(_MAGIC + key):
                return None
            node_rows, face_rows, depth = _SIZES.unpack(head[-_SIZES.size :])
            most = bvh4_build.max_listed(num_faces)
            if (
                not 3 * num_faces <= face_rows <= 3 * most
                or not 0 < node_rows <= 7 * most
                or not 0 < depth <= MAX_DEPTH
            ):
                return None
            body_bytes = 16 * (node_rows + face_rows)
            if os.fstat(file.fileno()).st_size != head_bytes + body_bytes + _DIGEST_BYTES:
                return None
            body = bytearray(file.read(body_bytes))
            digest = file.read()
    except OSError:
        return None
    if len(body) != body_bytes or hashlib.sha256(head + body).digest() != digest:
        return None
    tree_cache.touch(path)
    rows = np.frombuffer(body, np.float32).reshape(-1, 4)
    return Bvh4(rows[:node_rows], rows[node_rows:], depth)


def _write(path: Path, key: bytes, bvh: Bvh4) -> None:
    """Write a cache file, whole or not at all."""
    head = _MAGIC + key + _SIZES.pack(len(bvh.nodes), len(bvh.faces), bvh.depth)
    digest = hashlib.sha256(head)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=".", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(head)
                for rows in (bvh.nodes, bvh.faces):
                    digest.update(rows.data)
                    file.write(rows.data)
                file.write(digest.digest())
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError:
        pass
