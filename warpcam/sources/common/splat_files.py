"""Clouds of Gaussians from .ply files that a user names."""

from importlib import import_module
from pathlib import Path

from warpcam.accel.gaussians import GaussianCloud
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.sources.common.gaussian_cloud import CloudGeometry
from warpcam.sources.common.warnings import WarningCollector


def read_cloud_file(path: Path, access: FileAccess) -> GaussianCloud:
    """The cloud in a .ply file, in the file's own axes and units.

    Raises:
        RefusedError: The file is larger than ``access`` allows.
        WarpcamError: It cannot be read, or has no Gaussians.
    """
    if path.suffix.lower() != ".ply":
        raise WarpcamError(f"Splats: clouds has {str(path)!r}; allowed are .ply files")
    if not path.is_file():
        raise WarpcamError(f"Splats: clouds has {str(path)!r}, and there is no such file")
    try:
        reader = import_module("warpcam.sources.files.mesh_file")
    except ModuleNotFoundError as error:
        raise WarpcamError(
            f"{error.name} is not installed, and .ply files need it: pip install 'warpcam[meshes]'"
        ) from None
    collector = WarningCollector(str(path))
    try:
        graph = reader.read_graph(path, collector, access)
    finally:
        collector.say()
    for item in graph.items:
        if isinstance(item.geometry, CloudGeometry):
            return item.geometry.cloud
    raise WarpcamError(f"{path}: has no Gaussian splats, but {len(graph.items)} meshes; load reads such files")
