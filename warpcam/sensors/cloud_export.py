"""Point clouds of one world as files, and as objects of other libraries."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

COLORS = ("rgb", "rgba", "albedo")  # the first that a cloud has is its colour


def write_ply(path: str | Path, cloud: Mapping[str, Any], world: int = 0) -> None:
    """Write one world's cloud to a binary PLY file, without padding.

    ``rgb``, or else ``rgba`` or ``albedo``, becomes the colour, ``normals`` the normals; all others become properties
    of their own names, one of several channels as ``name_0``, ``name_1`` and so on. Waits for the device.

    Args:
        path: Of the file.
        cloud: As ``PointClouds.read`` gives it.
        world: Which.

    Raises:
        WarpcamError: There is no such world, ``cloud`` is none, or trimesh is not installed.
    """
    try:
        import trimesh
    except ModuleNotFoundError as error:
        raise WarpcamError(
            f"{error.name} is not installed, and write_ply needs it: pip install 'warpcam[meshes]'"
        ) from error
    points = _points_of(cloud, world, "write_ply")
    if not len(points["points"]):  # trimesh knows no colours of nothing
        points = {"points": points["points"]}
    color = next((name for name in COLORS if name in points), None)
    normals = points.get("normals")
    columns: dict[str, np.ndarray] = {}
    for name, values in points.items():
        if name in ("points", "normals", color):
            continue
        several = values.ndim > 1
        columns.update({f"{name}_{k}": values[:, k] for k in range(values.shape[1])} if several else {name: values})
    shape = trimesh.Trimesh(
        vertices=points["points"],
        vertex_normals=normals,
        vertex_colors=None if color is None else points[color],
        vertex_attributes=columns,
        process=False,
    )
    Path(path).write_bytes(trimesh.exchange.ply.export_ply(shape, vertex_normal=normals is not None))


def to_open3d(cloud: Mapping[str, Any], world: int = 0) -> Any:
    """One world's cloud for Open3D, without padding: an ``open3d.t.geometry.PointCloud`` in host memory.

    Its ``positions`` are the points; ``colors``, in [0, 1], are of ``rgb``, or else of ``rgba`` or ``albedo``; all
    others keep their names and have (point, channels). ``to_legacy()`` makes an ``open3d.geometry.PointCloud`` of it.
    Waits for the device.

    Args:
        cloud: As ``PointClouds.read`` gives it.
        world: Which.

    Raises:
        WarpcamError: There is no such world, ``cloud`` is none, or Open3D is not installed.
    """
    try:
        import open3d
    except ModuleNotFoundError as error:
        raise WarpcamError(f"{error.name} is not installed, and to_open3d needs it: pip install open3d") from error
    points = _points_of(cloud, world, "to_open3d")
    color = next((name for name in COLORS if name in points), None)
    result = open3d.t.geometry.PointCloud(open3d.core.Tensor(points.pop("points")))
    for name, values in points.items():
        if name == color:
            result.point["colors"] = open3d.core.Tensor(values[:, :3].astype(np.float32) / np.float32(255.0))
        else:
            result.point[name] = open3d.core.Tensor(values if values.ndim > 1 else values[:, None])
    return result


def _points_of(cloud: Any, world: Any, call: str) -> dict[str, np.ndarray]:
    """Arrays of one world on the host, of the points that are not padding, without ``count``."""
    if not isinstance(cloud, Mapping) or not {"points", "count"} <= set(cloud):
        raise WarpcamError(f"{call}: cloud must be what PointClouds.read gives, got {type(cloud).__name__}")
    num_worlds = len(cloud["count"])
    if isinstance(world, bool) or not isinstance(world, int | np.integer) or not 0 <= world < num_worlds:
        raise WarpcamError(f"{call}: world must be 0 to {num_worlds - 1}, got {world!r}")
    count = int(cloud["count"][world])
    return {
        name: np.ascontiguousarray(torch_interop.to_numpy(values[world, :count]))
        for name, values in cloud.items()
        if name != "count"
    }
