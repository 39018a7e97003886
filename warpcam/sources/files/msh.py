"""MuJoCo's own binary files of meshes (.msh): four counts, then positions, normals, texture coordinates and faces."""

from pathlib import Path

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.sources.common.geometry import MeshGeometry, unit

HEADER = 16  # bytes: numbers of vertices, normals, texture coordinates and faces
GMSH = b"$MeshFormat"


def read(path: Path, access: FileAccess) -> MeshGeometry:
    """Read a file; its unit is the metre.

    Raises:
        RefusedError: The file, or what its header says, is too large.
        WarpcamError: The file is none, or has no faces.
    """
    data = access.read(path)
    if data.lstrip().startswith(GMSH):
        raise WarpcamError(f"{path}: is a file of Gmsh; read are MuJoCo's binary .msh files")
    if len(data) < HEADER:
        raise WarpcamError(f"{path}: is no .msh file: it has {len(data)} bytes, and a header alone has {HEADER}")
    points, normals, coordinates, count = (int(number) for number in np.frombuffer(data, "<i4", 4))
    for what, number in (("vertices", points), ("faces", count)):
        access.check("elements", number, f"{path}: its header says of {what} that it")
    sizes = (3 * points, 3 * normals, 2 * coordinates, 3 * count)
    expected = HEADER + 4 * sum(sizes)
    if min(sizes) < 0 or normals not in (0, points) or coordinates not in (0, points) or expected != len(data):
        raise WarpcamError(
            f"{path}: is no .msh file of MuJoCo: its header says {points} vertices, {normals} normals, {coordinates} "
            f"texture coordinates and {count} faces, which are {expected} bytes; it has {len(data)}"
        )
    numbers = np.split(np.frombuffer(data, "<f4", sum(sizes[:3]), HEADER).astype(np.float64), np.cumsum(sizes[:2]))
    vertices, directions, places = (part.reshape(-1, width) for part, width in zip(numbers, (3, 3, 2), strict=True))
    faces = np.frombuffer(data, "<i4", sizes[3], expected - 4 * sizes[3]).reshape(-1, 3)
    if not count:
        raise WarpcamError(f"{path}: has no triangles that can be drawn")
    if faces.min() < 0 or faces.max() >= points:
        worst = faces.min() if faces.min() < 0 else faces.max()
        raise WarpcamError(f"{path}: faces must be indices from 0 to {points - 1}, got {worst}")
    if not np.isfinite(vertices[faces]).all():
        raise WarpcamError(f"{path}: vertices must be finite")
    uvs = (places * (1.0, -1.0) + (0.0, 1.0))[faces] if coordinates else None  # v is counted downwards
    return MeshGeometry(
        path.stem, vertices, faces.astype(np.int32), unit(directions)[faces] if normals else None, uvs, two_sided=True
    )
