"""Compilation of the kernels of labels for a GPU, by NVRTC, which needs none."""

from collections.abc import Callable
from pathlib import Path

import pytest
import warp as wp

from warpcam.kernels.flags import GeometryFlag, Lens, SceneFlag
from warpcam.kernels.plan.launches import SceneTypes
from warpcam.labeling import kernels

ARCH = 90
ALL = SceneTypes(GeometryFlag(0x3FF), SceneFlag(0))
MOVING = SceneTypes(GeometryFlag.BOX | GeometryFlag.MESH, SceneFlag.DEFORMING_MESHES)
KERNELS: dict[str, Callable[[], wp.Kernel]] = {
    "extents and poses": lambda: kernels.count_visible,
    "boxes": lambda: kernels.box_kernel(ALL),
    "masks of a pinhole": lambda: kernels.cover_kernel(kernels.CoverKey(ALL, Lens.PINHOLE, 16, True)),
    "masks of a table": lambda: kernels.cover_kernel(kernels.CoverKey(MOVING, Lens.RAY_TABLE_WITH_ORIGINS, 96)),
    "points of a pinhole": lambda: kernels.projection_kernel(Lens.PINHOLE),
    "points of a table": lambda: kernels.projection_kernel(Lens.RAY_TABLE_WITH_ORIGINS),
    "keypoints": lambda: kernels.keypoint_kernel(ALL, False),
    "keypoints beside moving meshes": lambda: kernels.keypoint_kernel(MOVING, True),
}


@pytest.mark.parametrize("name", KERNELS)
def test_kernels_compile_for_cuda(name: str, tmp_path: Path) -> None:
    module = KERNELS[name]().module
    (path,) = wp.compile_aot_module(module, arch=ARCH, module_dir=tmp_path / "module", use_ptx=True)
    assert path.stat().st_size > 0
