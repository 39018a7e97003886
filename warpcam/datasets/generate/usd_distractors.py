"""Distractors in a USD stage: a stage of their own over that of the file."""

from pathlib import Path
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.datasets.generate.distractor_pool import ROOT, DistractorPool, Thing


def stage_with(scene: str, pool: DistractorPool, access: FileAccess) -> Any:
    """Stage of a file with a pool's things beside it, around its origin; ``access`` is what the file may open.

    Raises:
        RefusedError: A layer lies outside of what may be opened, or is too large.
        WarpcamError: USD cannot read the file, or is not installed.
    """
    try:
        from pxr import Sdf, Usd, UsdGeom
    except ModuleNotFoundError:
        raise WarpcamError("pxr is not installed, and this scene needs it: pip install 'warpcam[usd]'") from None
    from warpcam.sources.usd.opening import open_file

    below = open_file(scene, access)
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().subLayerPaths.append(str(Path(scene).resolve()))
    unit = UsdGeom.GetStageMetersPerUnit(below)
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(below))
    UsdGeom.Scope.Define(stage, Sdf.Path(ROOT))
    for path, thing in zip(pool.paths, pool.things, strict=True):
        _define(UsdGeom, stage, path, thing, 1.0 / unit)
    return stage


def _define(geometry: Any, stage: Any, path: str, thing: Thing, scale: float) -> None:
    """Define one thing of a size in the stage's units."""
    x, y, z = (float(scale * size) for size in thing.size)
    geometry.Xform.Define(stage, path)
    if thing.kind in ("capsule", "cylinder"):
        shape = (geometry.Capsule if thing.kind == "capsule" else geometry.Cylinder).Define(stage, f"{path}/shape")
        shape.CreateRadiusAttr(x)
        shape.CreateHeightAttr(2.0 * y)
    elif thing.kind == "box":
        shape = geometry.Cube.Define(stage, f"{path}/shape")
        shape.CreateSizeAttr(2.0)
        shape.AddScaleOp().Set((x, y, z))
    else:
        shape = geometry.Sphere.Define(stage, f"{path}/shape")
        shape.CreateRadiusAttr(x)
        if thing.kind == "ellipsoid":
            shape.AddScaleOp().Set((1.0, y / x, z / x))
    shape.CreateDisplayColorAttr([(0.5, 0.5, 0.5)])
