"""Real stages: depth against Embree's rays on triangles that pxr and trimesh made, not we."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from views import compare

import warpcam as wc

Usd = pytest.importorskip("pxr.Usd")
trimesh = pytest.importorskip("trimesh")
from pxr import UsdGeom  # noqa: E402

ROOTS = {name: Path(find_spec(name).origin).parent for name in ("warp", "newton", "mujoco") if find_spec(name)}
FILES = {
    "warp": [
        *(f"examples/assets/{name}.usd" for name in ("bear", "bunny", "cube", "nonuniform", "rocks", "sphere")),
        "tests/assets/torus.usda",
        "tests/assets/spiky.usd",
    ],
    "mujoco": ["testdata/usd_golden.usda", "testdata/simple_usd_preview_surface.usda"],
    "newton": [
        *(f"examples/assets/{name}" for name in ("ant.usda", "axis_cube.usda", "boxes_fourbar.usda", "cartpole.usda")),
        *(f"examples/assets/{name}" for name in ("crazyflie.usd", "curvedSurface.usd", "humanoid.usda")),
        *(f"examples/assets/{name}" for name in ("rj45_plug.usd", "sensor_contact_scene.usda", "unisex_shirt.usd")),
        *(f"tests/assets/negative_scale_{name}.usda" for name in ("cube", "mesh_pair", "sphere")),
        *(f"tests/assets/{name}.usda" for name in ("cube_cylinder", "tetmesh_simple", "simple_articulation_with_mesh")),
        *(f"tests/assets/kamino/testing/geoms/test_geom_{name}.usda" for name in ("box", "capsule", "cone")),
        *(f"tests/assets/kamino/testing/geoms/test_geom_{name}.usda" for name in ("cylinder", "ellipsoid", "sphere")),
    ],
}
PATHS = [ROOTS[package] / name for package, names in FILES.items() if package in ROOTS for name in names]

UPRIGHT = {"Z": np.eye(4), "Y": np.array(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1.0)))}
ALONG = {
    "X": trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)),
    "Y": trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)),
    "Z": np.eye(4),
}


def judge(path: Path) -> Any:
    """Return all that should be visible as one mesh, in metres, z up."""
    stage = Usd.Stage.Open(str(path))
    time = Usd.TimeCode(stage.GetStartTimeCode()) if stage.HasAuthoredTimeCodeRange() else Usd.TimeCode.EarliestTime()
    cache = UsdGeom.XformCache(time)
    root = UPRIGHT[UsdGeom.GetStageUpAxis(stage)] * np.array((*[[UsdGeom.GetStageMetersPerUnit(stage)]] * 3, [1.0]))
    pieces = []
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        imageable = UsdGeom.Imageable(prim)
        if not imageable or imageable.ComputeVisibility(time) == "invisible":
            continue
        if imageable.ComputePurpose() not in ("default", "render"):
            continue
        piece = piece_of(prim, time)
        if piece is not None:
            piece.apply_transform(root @ np.array(cache.GetLocalToWorldTransform(prim)).T)
            pieces.append(piece)
    return trimesh.util.concatenate(pieces)


def piece_of(prim: Any, time: Any) -> Any:
    def value(name: str) -> Any:
        return prim.GetAttribute(name).Get(time)

    kind = prim.GetTypeName()
    if kind == "Mesh":
        faces, start = [], 0
        indices = value("faceVertexIndices")
        for count in value("faceVertexCounts"):
            face = indices[start : start + count]
            faces += [(face[0], face[k], face[k + 1]) for k in range(1, count - 1)]
            start += count
        return trimesh.Trimesh(np.array(value("points")), np.array(faces), process=False)
    if kind == "TetMesh":
        faces = np.array(value("surfaceFaceVertexIndices")).reshape(-1, 3)
        return trimesh.Trimesh(np.array(value("points")), faces, process=False)
    if kind == "Cube":
        return trimesh.creation.box((value("size"),) * 3)
    if kind == "Sphere":
        return trimesh.creation.icosphere(5, value("radius"))
    if kind in ("Cylinder", "Capsule", "Cone"):
        radius, height = value("radius"), value("height")
        if kind == "Cylinder":
            solid = trimesh.creation.cylinder(radius, height, sections=256)
        elif kind == "Capsule":
            solid = trimesh.creation.capsule(height, radius, count=(128, 128))
        else:
            solid = trimesh.creation.cone(radius, height, sections=256)
        solid.apply_translation(-solid.bounds.mean(axis=0) * (0, 0, 1))
        solid.apply_transform(ALONG[value("axis")])
        return solid
    if kind == "Plane":
        assert value("axis") == "Z"
        return trimesh.creation.box((value("width"), value("length"), 1e-9))
    return None


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.name)
def test_depth_is_embrees(path: Path, device: wp.Device) -> None:
    mesh = judge(path)
    scene = wc.from_usd(path, device=device, double_sided=True)
    low, high = scene.bounds()
    assert np.allclose(low, mesh.bounds[0], atol=0.02 * np.ptp(mesh.bounds)), (low, mesh.bounds)
    assert np.allclose(high, mesh.bounds[1], atol=0.02 * np.ptp(mesh.bounds)), (high, mesh.bounds)
    compare(scene, mesh)


@pytest.mark.skipif("newton" not in ROOTS, reason="most of the files are Newton's")
def test_there_are_many_files() -> None:
    assert len(PATHS) >= 20
    assert all(path.is_file() for path in PATHS)
