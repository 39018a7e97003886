"""Models of BOP data sets: a .ply file of each object [mm], models_info.json, and objects.json with their names."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from warpcam.datasets.generate.object_models import ObjectModel, diameter
from warpcam.datasets.generate.shards import write_json

INFO, NAMES = "models_info.json", "objects.json"
TO_MILLIMETERS = 1000.0


def write_models(folder: Path, models: Sequence[ObjectModel]) -> None:
    """Write the files of all objects into a new folder."""
    folder.mkdir()
    infos = {}
    for number, model in enumerate(models, 1):
        vertices = TO_MILLIMETERS * model.vertices
        _write_ply(folder / f"obj_{number:06d}.ply", vertices, model.faces)
        low, size = vertices.min(axis=0), np.ptp(vertices, axis=0)
        infos[str(number)] = {
            "diameter": diameter(vertices),
            **{f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)},
            **{f"size_{axis}": float(value) for axis, value in zip("xyz", size, strict=True)},
        }
    write_json(folder / INFO, infos, indent=1)
    write_json(folder / NAMES, {str(number): model.name for number, model in enumerate(models, 1)}, indent=1)


def copy_models(folder: Path, out: Path) -> None:
    """Copy these files to where a data set has them; done again, it writes the same."""
    models = out / "models"
    models.mkdir(exist_ok=True)
    for path in sorted(folder.iterdir()):
        shutil.copyfile(path, (out if path.name == NAMES else models) / path.name)


def _write_ply(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    rows["count"], rows["corners"] = 3, faces
    path.write_bytes(head.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())
