"""File formats of labelled images: each writes shards, and merges what shards have in common."""

from collections.abc import Mapping
from importlib import import_module

from warpcam.core.errors import WarpcamError
from warpcam.datasets.writers.writer import Writer

# Module and class of each format, and the packages that it needs.
WRITERS: Mapping[str, tuple[str, str, tuple[str, ...]]] = {
    "coco": ("coco", "CocoWriter", ("pycocotools",)),
    "bop": ("bop", "BopWriter", ()),
    "lerobot": ("lerobot", "LeRobotWriter", ("pyarrow", "pandas", "imageio_ffmpeg")),
    "hdf5": ("hdf5", "Hdf5Writer", ("h5py",)),
    "webdataset": ("webdataset", "WebDatasetWriter", ("webdataset",)),
    "kitti": ("kitti", "KittiWriter", ()),
    "yolo": ("yolo", "YoloWriter", ()),
}


def find_writer(name: str) -> type[Writer]:
    """Class of a format.

    Raises:
        WarpcamError: There is no such format, or a package that it needs is not installed.
    """
    if name not in WRITERS:
        raise WarpcamError(f"--writer: {name!r} came; there are {', '.join(WRITERS)}")
    module, kind, packages = WRITERS[name]
    for package in packages:
        try:
            import_module(package)
        except ModuleNotFoundError:
            raise WarpcamError(
                f"{package} is not installed, and {name} needs it: pip install 'warpcam[datasets]'"
            ) from None
    found: type[Writer] = getattr(import_module(f"warpcam.datasets.writers.{module}"), kind)
    return found
