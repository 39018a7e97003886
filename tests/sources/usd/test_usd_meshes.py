"""USD's meshes: polygons, sides, normals, subdivision, subsets, points that change with time."""

from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt
from usd_stages import above, add_material, add_mesh, add_square, image, metric


def test_polygons_that_are_not_convex(stage: Usd.Stage, device: wp.Device) -> None:
    """An L: what its corner leaves free must stay free."""
    points = [(0, 0, 1), (2, 0, 1), (2, 1, 1), (1, 1, 1), (1, 2, 1), (0, 2, 1)]
    for first in range(6):
        order = [(first + k) % 6 for k in range(6)]
        add_mesh(stage, "/it", points, [order])
        seen = image(wc.from_usd(stage, device=device), "depth", above(3.0, 32, 4.0))
        x, y = np.meshgrid(np.arange(32) / 8 - 1.9375, 1.9375 - np.arange(32) / 8)
        inside = (x > 0) & (y > 0) & (x < 2) & (y < 2) & ~((x > 1) & (y > 1))
        np.testing.assert_array_equal(np.isfinite(seen), inside)
        assert seen[inside] == pytest.approx(2.0)


@pytest.mark.parametrize("sides", [None, True, False])
@pytest.mark.parametrize("mirrored", [True, False])
@pytest.mark.parametrize("left", [True, False])
@pytest.mark.parametrize("double", [True, False])
def test_sides_and_windings(
    stage: Usd.Stage, left: bool, double: bool, mirrored: bool, sides: bool | None, device: wp.Device
) -> None:
    square = add_square(stage, "/it", orientation="leftHanded" if left else "rightHanded", doubleSided=double)
    if mirrored:
        UsdGeom.Xformable(square).AddScaleOp().Set((-1, 1, 1))
    scene = wc.from_usd(stage, device=device, double_sided=sides)
    from_above = np.isfinite(image(scene)).any()
    flipped = wc.Camera(
        "below", width=8, height=8, lens=wc.Orthographic(height=1.0), position=(0, 0, -3), rotation=(0, 1, 0, 0),
        outputs=("depth", "normals"),
    )  # fmt: skip
    from_below = np.isfinite(image(scene, "depth", flipped)).any()
    both = double if sides is None else sides
    assert from_above == (both or not left)
    assert from_below == (both or left)
    if from_below:
        np.testing.assert_allclose(image(scene, "normals", flipped)[4, 4], (0, 0, -1), atol=1e-6)


@pytest.mark.parametrize("how", ["constant", "uniform", "vertex", "varying", "faceVarying"])
@pytest.mark.parametrize("primvar", [True, False])
def test_normals_of_every_interpolation(stage: Usd.Stage, how: str, primvar: bool, device: wp.Device) -> None:
    """Two squares side by side; what the normals say is not what the faces are."""
    points = [(-2, -1, 0), (0, -1, 0), (2, -1, 0), (2, 1, 0), (0, 1, 0), (-2, 1, 0)]
    mesh = add_mesh(stage, "/it", points, [(0, 1, 4, 5), (1, 2, 3, 4)])
    left, right = np.array((-0.6, 0.0, 0.8)), np.array((0.6, 0.0, 0.8))
    middle = np.array((0.0, 0.0, 1.0))
    per_point = [left, middle, right, right, middle, left]
    values = {
        "constant": [right],
        "uniform": [left, right],
        "vertex": per_point,
        "varying": per_point,
        "faceVarying": [left] * 4 + [right] * 4,
    }[how]
    array = Vt.Vec3fArray([Gf.Vec3f(*map(float, value)) for value in values])
    if primvar:
        UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, how).Set(array)
    else:
        mesh.CreateNormalsAttr(array)
        mesh.SetNormalsInterpolation(how)
    (mesh,) = wc.from_usd(stage, device=device)._parts.meshes
    per_face = np.array([right, right] if how == "constant" else [left, right])
    by_point = np.array(per_point)
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    for face, corners in enumerate(mesh.faces):
        for corner, vertex in enumerate(corners):
            at = np.argmin(np.linalg.norm(np.array(points) - mesh.vertices[vertex], axis=1))
            wanted = by_point[at] if how in ("vertex", "varying") else per_face[int(middles[face, 0] > 0.0)]
            np.testing.assert_allclose(mesh.normals[face, corner], wanted, atol=1e-6)


def test_normals_under_a_stretch(stage: Usd.Stage, device: wp.Device) -> None:
    """Normals stay square to the surface: here of a slope that is stretched."""
    mesh = add_mesh(stage, "/it", [(-1, -1, -1), (1, -1, 1), (1, 1, 1), (-1, 1, -1)], [(0, 1, 2, 3)])
    mesh.CreateNormalsAttr([(-1, 0, 1)] * 4)
    mesh.SetNormalsInterpolation("vertex")
    UsdGeom.Xformable(mesh).AddScaleOp().Set((1.5, 1.0, 0.5))
    scene = wc.from_usd(stage, device=device)
    wanted = np.array((-0.5, 0, 1.5)) / np.sqrt(2.5)
    np.testing.assert_allclose(image(scene, "normals")[16, 16], wanted, atol=1e-5)
    np.testing.assert_allclose(scene._parts.meshes[0].normals, np.broadcast_to(wanted, (2, 3, 3)), atol=1e-5)


def test_control_cages_are_smooth_but_for_sharp_edges(stage: Usd.Stage, device: wp.Device) -> None:
    for rise, smooth in ((0.2, True), (4.0, False)):
        points = [(-2, -1, 0), (0, -1, rise), (2, -1, 0), (2, 1, 0), (0, 1, rise), (-2, 1, 0)]
        add_mesh(stage, "/it", points, [(0, 1, 4, 5), (1, 2, 3, 4)], scheme="catmullClark")
        (mesh,) = wc.from_usd(stage, device=device)._parts.meshes
        ridge = np.abs(mesh.vertices[mesh.faces][..., 0]) < 1e-6
        slope = np.array((rise, 0.0, 2.0)) / np.hypot(rise, 2.0)
        np.testing.assert_allclose(np.abs(mesh.normals[~ridge]), np.tile(slope, (6, 1)), atol=1e-5)
        wanted = np.array((0.0, 0.0, 1.0)) if smooth else slope
        np.testing.assert_allclose(np.abs(mesh.normals[ridge]), np.tile(wanted, (6, 1)), atol=1e-5)


def test_holes_are_left_out(stage: Usd.Stage, device: wp.Device) -> None:
    points = [(-2, -1, 0), (0, -1, 0), (2, -1, 0), (2, 1, 0), (0, 1, 0), (-2, 1, 0)]
    add_mesh(stage, "/it", points, [(0, 1, 4, 5), (1, 2, 3, 4)], holeIndices=[0])
    seen = np.isfinite(image(wc.from_usd(stage, device=device)))
    assert not seen[:, :16].any()
    assert seen[16, 16:].all()


def test_geom_subsets_by_material(stage: Usd.Stage, device: wp.Device) -> None:
    points = [(-2, -1, 0), (0, -1, 0), (2, -1, 0), (2, 1, 0), (0, 1, 0), (-2, 1, 0), (-2, 2, 0), (0, 2, 0)]
    mesh = add_mesh(stage, "/it", points, [(0, 1, 4, 5), (1, 2, 3, 4), (5, 4, 7, 6)])
    colors = {"red": (1, 0, 0), "green": (0, 1, 0)}
    for name, color in colors.items():
        add_material(stage, f"/Looks/{name}", diffuseColor=color)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(UsdShade.Material.Get(stage, "/Looks/red"))
    subset = UsdShade.MaterialBindingAPI(mesh.GetPrim()).CreateMaterialBindSubset("half", Vt.IntArray([1]))
    UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(UsdShade.Material.Get(stage, "/Looks/green"))
    scene = wc.from_usd(stage, device=device)
    assert scene.shapes == ("/it/half", "/it")
    albedo = image(scene, "albedo", above(3.0, 32, 4.0, "albedo"))
    assert albedo[16, 8].tolist() == [255, 0, 0]
    assert albedo[16, 24].tolist() == [0, 255, 0]
    assert albedo[4, 8].tolist() == [255, 0, 0]


@pytest.mark.parametrize("sides", [False, True])
def test_meshes_change_their_points_with_time(stage: Usd.Stage, sides: bool, device: wp.Device) -> None:
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(8.0)
    cells = 12
    grid = np.linspace(-1.0, 1.0, cells + 1)
    x, y = (part.ravel() for part in np.meshgrid(grid, grid))
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = np.stack((corner, corner + 1, corner + cells + 2, corner + cells + 1), axis=1)

    def points(time: float) -> np.ndarray:
        return np.stack((x, y, 0.1 * time * np.sin(3.0 * x)), axis=1)

    def add(to: Usd.Stage, times: tuple, path: str = "/sheet", **more: Any) -> None:
        mesh = add_mesh(to, path, points(times[0]), faces.tolist(), doubleSided=sides, **more)
        for time in times if len(times) > 1 else ():
            mesh.GetPointsAttr().Set([tuple(map(float, point)) for point in points(time)], time)
        UsdGeom.Xformable(mesh).AddTranslateOp().Set((0.2, 0.0, 0.3))
        UsdGeom.Xformable(mesh).AddScaleOp().Set((1.0, 0.7, 2.0))

    add(stage, (0.0, 4.0, 8.0))
    add_square(stage, "/floor", z=-3.0, half=4.0)
    scene = wc.from_usd(stage, num_worlds=2, device=device)
    camera = above(5.0, 48, 4.0, "depth", "normals", "segmentation")
    renderer = wc.Renderer(scene, [camera])
    for time in (0.0, 8.0, 2.0, 4.0, 0.0):
        scene.set_time(time)
        images = renderer.render()["above"]
        still = metric(Usd.Stage.CreateInMemory())
        add(still, (time,))
        add_square(still, "/floor", z=-3.0, half=4.0)
        other = wc.from_usd(still, num_worlds=2, device=device)
        expected = wc.Renderer(other, [camera]).render()["above"]
        for name in ("depth", "normals"):
            gap = (images[name] - expected[name]).abs().cpu().numpy()
            assert (gap < 1e-4).mean() > 0.998, (time, name)
        assert (images["segmentation"] == expected["segmentation"]).float().mean() > 0.998
        for ours, theirs in zip(scene.bounds(), other.bounds(), strict=True):
            assert ours == pytest.approx(theirs, abs=1e-5)


def test_meshes_that_change_their_faces_stay(stage: Usd.Stage, caplog: pytest.LogCaptureFixture) -> None:
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(1.0)
    changing, losing = add_square(stage, "/changing"), add_square(stage, "/losing")
    for mesh in (changing, losing):
        mesh.GetPointsAttr().Set(mesh.GetPointsAttr().Get(), 0.0)
    changing.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3], 0.0)
    changing.GetFaceVertexIndicesAttr().Set([0, 1, 3, 2], 1.0)
    changing.GetPointsAttr().Set([(0, 0, 9)] * 4, 1.0)
    losing.GetPointsAttr().Set([(0, 0, 0)] * 3, 1.0)
    scene = wc.from_usd(stage, device="cpu")
    assert "changes its faces with time, and is drawn as it was at first: /changing" in caplog.text
    scene.set_time(1.0)
    assert "has other points than at first, or none, at some times, and stays as it was: /losing" in caplog.text
    assert image(scene)[16, 16] == pytest.approx(3.0)
