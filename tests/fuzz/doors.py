"""Public functions that open files, by format."""

from pathlib import Path
from typing import Any

import warpcam
from warpcam.datasets.generate.recipes import read_recipes
from warpcam.sensors.patterns import livox_csv, ouster_metadata


def _lidar(path: Path) -> Any:
    return ouster_metadata(path) if path.suffix == ".json" else livox_csv(path, samples=8)


def _load(path: Path) -> Any:
    return warpcam.load(path, device="cpu")


DOORS = {
    "mjcf": _load, "urdf": _load, "gltf": _load, "obj": _load, "ply": _load, "stl": _load, "usd": _load,
    "splats": _load, "dae": _load, "msh": _load, "calibration": warpcam.read_calibration, "recipes": read_recipes,
    "lidar": _lidar,
}  # fmt: skip
