"""Shapes as meshes with texture coordinates: upright on their sides, seen from outside, where z is up."""

from typing import Any

import newton
import numpy as np

GEO = newton.GeoType
MERIDIANS, PARALLELS = 64, 32


def uv_mesh(kind: int, size: tuple[float, float, float], source: Any) -> newton.Mesh | None:
    """A shape as a mesh of its own size, or None if it has no texture coordinates.

    Args:
        kind: Of ``newton.GeoType``.
        size: As ``shape_scale`` has it; a mesh's is not applied.
        source: The mesh, for a mesh.
    """
    x, y = size[:2]
    plain: dict[str, Any] = {"compute_inertia": False}
    if kind == GEO.BOX:
        return _box(np.array(size))
    if kind in (GEO.SPHERE, GEO.ELLIPSOID):
        return _ball(np.array((x, x, x) if kind == GEO.SPHERE else size))
    if kind == GEO.CAPSULE:
        return newton.Mesh.create_capsule(x, y, up_axis=newton.Axis.Z, **plain)
    if kind == GEO.CYLINDER:
        return newton.Mesh.create_cylinder(x, y, up_axis=newton.Axis.Z, **plain)
    if kind == GEO.CONE:
        return newton.Mesh.create_cone(x, y, up_axis=newton.Axis.Z, **plain)
    if kind == GEO.MESH and isinstance(source, newton.Mesh) and source.uvs is not None:
        return source
    return None


def _box(half: np.ndarray) -> newton.Mesh:
    """The whole image on each side; on the top its upper edge is where y is largest."""
    corners, uvs, faces = [], [], []
    square = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1)), np.float64)
    ex, ey, ez = np.eye(3)
    # Outwards, to the right and upwards as seen from outside.
    sides = ((ex, ey, ez), (-ex, -ey, ez), (ey, -ex, ez), (-ey, ex, ez), (ez, ex, ey), (-ez, ex, -ey))
    for index, (out, right, above) in enumerate(sides):
        corners.append((out + square[:, :1] * right + square[:, 1:] * above) * half)
        uvs.append(0.5 + 0.5 * square)
        faces.append(np.array((0, 1, 2, 0, 2, 3)) + 4 * index)
    return _mesh(np.concatenate(corners), np.concatenate(faces), np.concatenate(uvs), None)


def _ball(radii: np.ndarray) -> newton.Mesh:
    """The image once around; its upper edge is the pole where z is largest."""
    across, up = np.meshgrid(np.linspace(0.0, 1.0, MERIDIANS + 1), np.linspace(0.0, 1.0, PARALLELS + 1))
    longitude, latitude = 2.0 * np.pi * across, np.pi * (up - 0.5)
    unit = np.stack(
        (np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)), axis=-1
    ).reshape(-1, 3)
    corner = (np.arange(PARALLELS)[:, None] * (MERIDIANS + 1) + np.arange(MERIDIANS)).reshape(-1, 1)
    above = MERIDIANS + 1
    faces = corner + np.array((0, 1, above + 1, 0, above + 1, above))
    uvs = np.stack((across, up), axis=-1).reshape(-1, 2)
    normals = unit / radii
    return _mesh(unit * radii, faces.reshape(-1), uvs, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _mesh(corners: np.ndarray, faces: np.ndarray, uvs: np.ndarray, normals: np.ndarray | None) -> newton.Mesh:
    return newton.Mesh(
        corners.astype(np.float32),
        faces.astype(np.int32),
        normals=None if normals is None else normals.astype(np.float32),
        uvs=uvs.astype(np.float32),
        compute_inertia=False,
    )
