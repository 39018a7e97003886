"""Files that others made for tests of importers: depth against Embree's rays on triangles that trimesh reads.

They are Debian's: ``apt-get install assimp-testmodels``, or a folder that WARPCAM_MESH_FILES names.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from views import compare

import warpcam as wc
from warpcam.sources.common import formats

trimesh = pytest.importorskip("trimesh")
from warpcam.sources.common import geometry  # noqa: E402
from warpcam.sources.files import mesh_file  # noqa: E402, trimesh may be missing

FOLDER = Path(os.environ.get("WARPCAM_MESH_FILES", "/usr/share/assimp/models"))
PATHS = sorted(path for path in FOLDER.rglob("*") if path.suffix.lower() in formats.MESHES)
Y_UP = np.array(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1.0)))


class BothSides(geometry.MeshGeometry):
    """Seen from behind, too, as Embree sees all."""

    def __init__(self, *arguments: Any):
        super().__init__(*arguments[:5], True)


@pytest.mark.filterwarnings("ignore")  # trimesh's own
@pytest.mark.parametrize("path", PATHS, ids=lambda path: str(path.relative_to(FOLDER)))
def test_depth_is_embrees(path: Path, device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_file, "MeshGeometry", BothSides)
    try:
        scene = wc.load(path, device=device)
    except wc.WarpcamError as error:
        pytest.skip(str(error)[:80])
    mesh = trimesh.load_scene(path, process=False).to_mesh()
    if mesh.area == 0.0:
        pytest.skip("its triangles have no area")
    if path.suffix.lower() in (".glb", ".gltf"):
        mesh.apply_transform(Y_UP)
    compare(scene, mesh)
