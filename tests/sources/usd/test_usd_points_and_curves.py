"""Points and curves of a stage."""

from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Usd, UsdGeom
from usd_stages import above, image

from warpcam.sources.usd import points_and_curves
from warpcam.sources.usd.points_and_curves import BASES, Curve, icosphere, tube


def set_values(prim: Any, how: str, **arrays: Any) -> None:
    for name, values in arrays.items():
        if name == "widths":
            prim.CreateWidthsAttr([float(value) for value in values])
            prim.SetWidthsInterpolation(how)
        else:
            prim.CreateDisplayColorAttr([tuple(map(float, value)) for value in values])
            prim.GetDisplayColorPrimvar().SetInterpolation(how)


@pytest.mark.parametrize("how", ["constant", "vertex"])
def test_points_are_balls(stage: Usd.Stage, how: str, device: wp.Device) -> None:
    points = UsdGeom.Points.Define(stage, "/dots")
    places = ((-1.0, 0.0, 0.0), (1.0, 0.5, 0.2), (0.2, -1.0, -0.3))
    points.CreatePointsAttr(places)
    widths = [0.6] if how == "constant" else [0.4, 0.8, 1.2]
    set_values(points, how, widths=widths)
    scene = wc.from_usd(stage, device=device)
    assert scene.shapes == ("/dots",)
    size = 128
    seen = image(scene, camera=above(3.0, size, 4.0))
    x = (np.arange(size) + 0.5) * 4.0 / size - 2.0
    x, y = np.meshgrid(x, -x)
    expected = np.full(x.shape, np.inf)
    for (px, py, pz), width in zip(places, np.broadcast_to(widths, 3), strict=True):
        rise = (0.5 * width) ** 2 - (x - px) ** 2 - (y - py) ** 2
        expected = np.fmin(expected, np.where(rise > 0.0, 3.0 - pz - np.sqrt(np.maximum(rise, 0.0)), np.inf))
    assert (np.isfinite(seen) == np.isfinite(expected)).mean() > 0.99
    both = np.isfinite(seen) & np.isfinite(expected)
    assert (np.abs(seen[both] - expected[both]) < 0.02).mean() > 0.97


def test_points_have_colours_of_their_own(stage: Usd.Stage, device: wp.Device) -> None:
    points = UsdGeom.Points.Define(stage, "/dots")
    points.CreatePointsAttr([(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    set_values(points, "constant", widths=[1.0])
    set_values(points, "vertex", displayColor=[(1, 0, 0), (0, 0, 1)])
    seen = image(wc.from_usd(stage, device=device), "albedo")
    assert seen[16, 8].tolist() == [255, 0, 0] and seen[16, 24].tolist() == [0, 0, 255]


def test_a_line_is_a_tube_between_its_points(stage: Usd.Stage, device: wp.Device) -> None:
    curves = UsdGeom.BasisCurves.Define(stage, "/rope")
    curves.CreateTypeAttr("linear")
    curves.CreatePointsAttr([(-1.5, -1.0, 0.0), (1.5, -1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 1.5, 0.0)])
    curves.CreateCurveVertexCountsAttr([2, 2])
    set_values(curves, "uniform", widths=[0.5, 1.0], displayColor=[(0, 1, 0), (1, 0, 0)])
    scene = wc.from_usd(stage, device=device)
    size = 64
    depth, color = (image(scene, name, above(3.0, size, 4.0, name)) for name in ("depth", "albedo"))
    x = (np.arange(size) + 0.5) * 4.0 / size - 2.0
    x, y = np.meshgrid(x, -x)
    thin, thick = (np.abs(y + 1.0) < 0.25) & (np.abs(x) < 1.5), (np.abs(x) < 0.5) & (y > 0.0) & (y < 1.5)
    assert (np.isfinite(depth) == (thin | thick)).mean() > 0.98
    assert depth[thin].min() == pytest.approx(2.75, abs=0.01) and depth[thick].min() == pytest.approx(2.5, abs=0.02)
    hit = np.isfinite(depth)
    assert (color[thin & hit] == (0, 255, 0)).all() and (color[thick & hit] == (255, 0, 0)).all()


def test_widths_along_a_curve(stage: Usd.Stage, device: wp.Device) -> None:
    curves = UsdGeom.BasisCurves.Define(stage, "/spike")
    curves.CreateBasisAttr("bezier")
    curves.CreatePointsAttr([(-1.5, 0, 0), (-0.5, 0, 0), (0.5, 0, 0), (1.5, 0, 0)])
    curves.CreateCurveVertexCountsAttr([4])
    set_values(curves, "varying", widths=[1.6, 0.0])
    seen = np.isfinite(image(wc.from_usd(stage, device=device), camera=above(3.0, 64, 4.0)))
    thick = seen.sum(axis=0) / 16.0
    x = (np.arange(64) + 0.5) / 16.0 - 2.0
    inside = np.abs(x) < 1.4
    assert thick[inside] == pytest.approx(0.8 - 1.6 / 3.0 * x[inside], abs=0.13)


@pytest.mark.parametrize("basis", list(BASES))
@pytest.mark.parametrize("wrap", ["nonperiodic", "periodic", "pinned"])
def test_curves_run_as_usd_says(basis: str, wrap: str) -> None:
    """Curves start where, and with the tangent that, the definitions of the bases say."""
    points = np.random.default_rng(0).normal(size=(9 if wrap == "periodic" else 10, 3))
    path = Curve(len(points), basis, wrap).at(points, 64)
    first = {"bezier": points[0], "bspline": (points[0] + 4 * points[1] + points[2]) / 6, "catmullRom": points[1]}
    last = {"bezier": points[-1], "bspline": (points[-3] + 4 * points[-2] + points[-1]) / 6, "catmullRom": points[-2]}
    if wrap == "periodic":
        assert path[-1] == pytest.approx(path[0], abs=1e-12)
        assert path[0] == pytest.approx(first[basis], abs=1e-12)
    elif wrap == "nonperiodic":
        assert path[0] == pytest.approx(first[basis], abs=1e-12)
        assert path[-1] == pytest.approx(last[basis], abs=1e-12)
    else:
        assert path[0] == pytest.approx(points[0], abs=1e-12) and path[-1] == pytest.approx(points[-1], abs=1e-12)
    if basis == "catmullRom":
        assert np.abs(path[:, None] - points[1:-1]).max(-1).min(0) == pytest.approx(0.0, abs=1e-12)


def test_tubes_and_balls_are_closed() -> None:
    t = np.linspace(0.0, 6.0, 50)
    knot = np.stack((np.cos(2 * t) * (2 + np.cos(3 * t)), np.sin(2 * t) * (2 + np.cos(3 * t)), np.sin(3 * t)), axis=1)
    _, faces, _, _ = tube(knot[None], np.full((1, 50, 4), 0.3), 8)
    for corners in (faces, icosphere(2)[1]):
        edges = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)])
        assert set(map(tuple, edges)) == {(b, a) for a, b in edges}
        assert len(set(map(tuple, edges))) == len(edges)


def test_many_strands_are_cut_coarsely(stage: Usd.Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(points_and_curves, "MOST_FACES", 2**14)
    random = np.random.default_rng(0)
    points = UsdGeom.Points.Define(stage, "/sand")
    points.CreatePointsAttr([tuple(map(float, place)) for place in random.normal(size=(320, 3))])
    set_values(points, "constant", widths=[0.01])
    hair = UsdGeom.BasisCurves.Define(stage, "/hair")
    hair.CreateBasisAttr("bspline")
    hair.CreatePointsAttr([tuple(map(float, place)) for place in random.normal(size=(640, 3))])
    hair.CreateCurveVertexCountsAttr([8] * 80)
    set_values(hair, "constant", widths=[0.01])
    scene = wc.from_usd(stage, device="cpu")
    assert scene.shapes == ("/sand", "/hair")
    assert all(2**12 < len(mesh.faces) <= 2**14 for mesh in scene._parts.meshes)


def test_points_of_an_instance_are_kept_once(stage: Usd.Stage) -> None:
    UsdGeom.Xform.Define(stage, "/kind")
    points = UsdGeom.Points.Define(stage, "/kind/dots")
    points.CreatePointsAttr([(0.0, 0.0, 0.0)])
    set_values(points, "constant", widths=[0.5])
    for name, x in (("/a", -1.0), ("/b", 1.0)):
        prim = UsdGeom.Xform.Define(stage, name)
        prim.AddTranslateOp().Set((x, 0.0, 0.0))
        prim.GetPrim().GetReferences().AddInternalReference("/kind")
        prim.GetPrim().SetInstanceable(True)
    scene = wc.from_usd(stage, device="cpu")
    assert len(scene.shapes) == 3 and len(scene._parts.meshes) == 2  # of what is referenced, and of its instances
