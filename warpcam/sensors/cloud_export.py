"""Point clouds of one world as files, and as objects of other libraries."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

COLORS = ("rgb", "rgba", "albedo")  # the first that a cloud has is its colour
PLY_NAMES = ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha")  # of positions, normals and colours
OPEN3D_NAMES = ("positions", "colors")


def write_ply(path: str | Path, cloud: Mapping[str, Any], world: int = 0) -> None:
    """Write one world's cloud to a binary PLY file, without padding.

    ``rgb``, or else ``rgba`` or ``albedo``, becomes the colour, bytes or numbers from 0 to 1, and ``normals`` the
    normals; all others become properties of their own names, one of several channels as ``name_0``, ``name_1`` and so
    on. Waits for the device.

    Args:
        path: Of the file.
        cloud: As ``PointClouds.read`` gives it.
        world: Which.

    Raises:
        WarpcamError: There is no such world, ``cloud`` is none, trimesh is not installed, colours or normals have other
            channels, a file cannot have an attribute of that name, or the file cannot be written.
    """
    try:
        import trimesh
    except ModuleNotFoundError as error:
        raise WarpcamError(
            f"{error.name} is not installed, and write_ply needs it: pip install 'warpcam[meshes]'"
        ) from error
    points, color = _points_of(cloud, world, "write_ply")
    columns = _columns_of({name: each for name, each in points.items() if name not in ("points", "normals", color)})
    if not len(points["points"]):  # trimesh knows no colours of nothing
        points, color, columns = {"points": points["points"]}, None, {}
    normals = points.get("normals")
    shape = trimesh.Trimesh(
        vertices=points["points"],
        vertex_normals=normals,
        vertex_colors=None if color is None else _bytes_of(points[color]),
        vertex_attributes=columns,
        process=False,
    )
    data = trimesh.exchange.ply.export_ply(shape, vertex_normal=normals is not None)
    try:
        Path(path).write_bytes(data)
    except OSError as error:
        raise WarpcamError(f"write_ply: {path} cannot be written: {error.strerror}") from None


def to_open3d(cloud: Mapping[str, Any], world: int = 0) -> Any:
    """One world's cloud for Open3D, without padding: an ``open3d.t.geometry.PointCloud`` in host memory.

    Its ``positions`` are the points; ``colors``, in [0, 1], are of ``rgb``, or else of ``rgba`` or ``albedo``, bytes or
    numbers from 0 to 1; all others keep their names and have (point, channels). ``to_legacy()`` makes an
    ``open3d.geometry.PointCloud`` of it. Waits for the device.

    Args:
        cloud: As ``PointClouds.read`` gives it.
        world: Which.

    Raises:
        WarpcamError: There is no such world, ``cloud`` is none, Open3D is not installed, colours or normals have other
            channels, or Open3D has another use for the name of an attribute.
    """
    try:
        import open3d
    except ModuleNotFoundError as error:
        raise WarpcamError(f"{error.name} is not installed, and to_open3d needs it: pip install open3d") from error
    points, color = _points_of(cloud, world, "to_open3d")
    for name in OPEN3D_NAMES:
        if name in points:
            raise WarpcamError(f"to_open3d: cloud has an attribute {name!r}, a name that Open3D has of its own")
    result = open3d.t.geometry.PointCloud(open3d.core.Tensor(points.pop("points")))
    for name, values in points.items():
        if name == color:
            most = np.float32(255.0 if values.dtype == np.uint8 else 1.0)
            result.point["colors"] = open3d.core.Tensor(values[:, :3].astype(np.float32) / most)
        else:
            result.point[name] = open3d.core.Tensor(values if values.ndim > 1 else values[:, None])
    return result


def _points_of(cloud: Any, world: Any, call: str) -> tuple[dict[str, np.ndarray], str | None]:
    """Arrays of one world on the host, of the points that are not padding, without ``count``; and the colour's name."""
    if not isinstance(cloud, Mapping) or not {"points", "count"} <= set(cloud):
        raise WarpcamError(f"{call}: cloud must be what PointClouds.read gives, got {type(cloud).__name__}")
    num_worlds = len(cloud["count"])
    if isinstance(world, bool) or not isinstance(world, int | np.integer) or not 0 <= world < num_worlds:
        raise WarpcamError(f"{call}: world must be 0 to {num_worlds - 1}, got {world!r}")
    count = int(cloud["count"][world])
    points = {
        name: np.ascontiguousarray(torch_interop.to_numpy(values[world, :count]))
        for name, values in cloud.items()
        if name != "count"
    }
    color = next((name for name in COLORS if name in points), None)
    for name, allowed in ((color, (3, 4)), ("normals", (3,))):
        shape = points[name].shape if name in points else (0, 3)
        if len(shape) != 2 or shape[1] not in allowed:
            wanted = " or ".join(map(str, allowed))
            raise WarpcamError(f"{call}: {name} must have {wanted} channels, got {(*shape[1:], 1)[0]}")
    if color is not None and points[color].dtype not in (np.uint8, np.float32):
        raise WarpcamError(f"{call}: {color} must be uint8 or float32, got {points[color].dtype}")
    return points, color


def _columns_of(attributes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Numbers of each point by the names that a PLY file has for them."""
    columns: dict[str, np.ndarray] = {}
    for name, values in attributes.items():
        several = enumerate(values.T) if values.ndim > 1 else ()
        channels = {f"{name}_{k}": numbers for k, numbers in several} or {name: values}
        for key, numbers in channels.items():
            if key in PLY_NAMES or key in columns:
                raise WarpcamError(f"write_ply: cloud has an attribute {name!r}, but the file has {key!r} already")
            if not (key.isascii() and key.isprintable()) or " " in key or not key:
                raise WarpcamError(f"write_ply: names in a file must be ASCII without spaces, got {name!r}")
            columns[key] = numbers
    return columns


def _bytes_of(colors: np.ndarray) -> np.ndarray:
    """Colours as bytes, of bytes or of numbers from 0 to 1."""
    if colors.dtype == np.uint8:
        return colors
    return np.rint(255.0 * np.clip(np.nan_to_num(colors), 0.0, 1.0)).astype(np.uint8)
