"""Stages made here: what each of their parts becomes, by closed forms."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from closed_form import box, capsule, cylinder, ellipsoid
from views import Around, depth, look_at, quaternion

import warpcam as wc
from warpcam.parts import FIELDS

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdSemantics, UsdShade, Vt
from stages import above, add_material, add_mesh, add_square, image, metric

DIRECTIONS = ((0.6, -0.8, 0.5), (-0.7, 0.3, -0.4))


@pytest.fixture
def stage() -> Usd.Stage:
    """Empty, in metres, z up."""
    return metric(Usd.Stage.CreateInMemory())


def expected(entry: Any, frame: np.ndarray, around: Around) -> np.ndarray:
    """Depth of a solid of ``closed_form`` in a frame, (4, 4)."""
    back = np.linalg.inv(frame)
    rays = around.rays()
    t, _ = entry(np.broadcast_to(back[:3, :3] @ around.eye + back[:3, 3], rays.shape), rays @ back[:3, :3].T)
    return t.reshape(around.size, around.size)


def check(scene: wc.Scene, entry: Any, frame: np.ndarray, rough: float = 2e-5, few: float = 0.002) -> None:
    low, high = scene.bounds()
    for direction in DIRECTIONS:
        around = Around(low, high, direction)
        ours, theirs = depth(scene, around), expected(entry, frame, around)
        hit = np.isfinite(ours) & np.isfinite(theirs)
        assert np.isfinite(theirs).mean() > 0.02
        wrong = np.isfinite(ours) != np.isfinite(theirs)
        wrong[hit] |= np.abs(ours[hit] - theirs[hit]) > rough * around.radius
        assert wrong.mean() <= few


def pose(prim: Any, scale: tuple = (1.0, 1.0, 1.0)) -> np.ndarray:
    """Turn, shift and stretch a prim; returns the frame."""
    matrix = Gf.Matrix4d().SetScale(Gf.Vec3d(*scale)) * Gf.Matrix4d().SetRotate(Gf.Rotation((1, 2, 3), 40.0))
    matrix.SetTranslateOnly((0.3, -0.2, 0.5))
    UsdGeom.Xformable(prim).AddTransformOp().Set(matrix)
    return np.array(matrix).T


TURNED = {"X": np.array(((0, 0, 1), (1, 0, 0), (0, 1, 0.0))), "Y": np.array(((0, 1, 0), (0, 0, 1), (1, 0, 0.0)))}


def about(frame: np.ndarray, axis: str) -> np.ndarray:
    turned = frame.copy()
    turned[:3, :3] = frame[:3, :3] @ TURNED.get(axis, np.eye(3))
    return turned


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (2.0, 2.0, 2.0), (0.5, 1.5, 2.5), (-1.0, 2.0, 0.7)])
@pytest.mark.parametrize("kind", ["Cube", "Sphere"])
def test_cubes_and_spheres_take_any_scale(
    stage: Usd.Stage, kind: str, scale: tuple, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    prim = stage.DefinePrim("/it", kind)
    frame = pose(prim, scale)
    entry = (lambda o, d: box(o, d, np.ones(3))) if kind == "Cube" else (lambda o, d: ellipsoid(o, d, np.ones(3)))
    scene = wc.from_usd(stage, device=device)
    assert not scene._parts.meshes
    check(scene, entry, frame)


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize("kind", ["Cylinder", "Capsule", "Cone"])
@pytest.mark.parametrize("even", [True, False])
def test_solids_about_an_axis(stage: Usd.Stage, kind: str, axis: str, even: bool, device: wp.Device) -> None:
    solid = getattr(UsdGeom, kind).Define(stage, "/it")
    solid.CreateAxisAttr(axis)
    solid.CreateRadiusAttr(0.4)
    solid.CreateHeightAttr(1.6)
    frame = pose(solid, (1.5, 1.5, 1.5) if even else (0.8, 1.3, 1.9))
    entries = {
        "Cylinder": lambda o, d: cylinder(o, d, 0.4, 0.8),
        "Capsule": lambda o, d: capsule(o, d, 0.4, 0.8),
        "Cone": lambda o, d: cone(o, d, 0.4, 0.8),
    }
    scene = wc.from_usd(stage, device=device)
    assert bool(scene._parts.meshes) != even
    check(scene, entries[kind], about(frame, axis), 2e-5 if even else 2e-3, 0.002 if even else 0.006)


@pytest.mark.parametrize("scale", [(1.5, 1.5, -0.7), (-1.5, 1.5, 0.7), (-1.0, -1.0, -2.0), (1.2, -1.2, -1.2)])
def test_cones_are_exact_when_mirrored(stage: Usd.Stage, scale: tuple, device: wp.Device) -> None:
    solid = UsdGeom.Cone.Define(stage, "/it")
    solid.CreateRadiusAttr(0.4)
    solid.CreateHeightAttr(1.6)
    frame = pose(solid, scale)
    scene = wc.from_usd(stage, device=device)
    assert not scene._parts.meshes
    check(scene, lambda o, d: cone(o, d, 0.4, 0.8), frame)


def cone(o: np.ndarray, d: np.ndarray, radius: float, half: float) -> tuple:
    """About z, its tip at +half."""
    slope = radius / (2.0 * half)
    z, dz = half - o[..., 2], -d[..., 2]  # down from the tip; its radius there is slope * z
    a = d[..., 0] ** 2 + d[..., 1] ** 2 - (slope * dz) ** 2
    b = o[..., 0] * d[..., 0] + o[..., 1] * d[..., 1] - slope**2 * z * dz
    c = o[..., 0] ** 2 + o[..., 1] ** 2 - (slope * z) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b * b - a * c)
        sides = np.stack(((-b - root) / a, (-b + root) / a))
        depth_there = z + sides * dz
        sides = np.where((depth_there >= 0.0) & (depth_there <= 2.0 * half) & (sides > 0.0), sides, np.inf)
        base = (-half - o[..., 2]) / d[..., 2]
        at = o + base[..., None] * d
        base = np.where((at[..., 0] ** 2 + at[..., 1] ** 2 <= radius**2) & (base > 0.0), base, np.inf)
    return np.minimum(np.nanmin(np.where(np.isnan(sides), np.inf, sides), axis=0), base), None


@pytest.mark.parametrize("kind", ["Cylinder_1", "Capsule_1"])
def test_solids_of_two_equal_radii_are_exact(stage: Usd.Stage, kind: str, device: wp.Device) -> None:
    prim = stage.DefinePrim("/it", kind)
    for name in ("radiusTop", "radiusBottom"):
        prim.GetAttribute(name).Set(0.4)
    prim.GetAttribute("height").Set(1.6)
    prim.GetAttribute("axis").Set("Z")
    entry = cylinder if kind == "Cylinder_1" else capsule
    scene = wc.from_usd(stage, device=device)
    assert not scene._parts.meshes
    check(scene, lambda o, d: entry(o, d, 0.4, 0.8), np.eye(4))
    prim.GetAttribute("radiusTop").Set(0.2)
    assert wc.from_usd(stage, device=device)._parts.meshes


@pytest.mark.parametrize(("axis", "spans"), [("X", (0, 2, 4)), ("Y", (4, 0, 2)), ("Z", (2, 4, 0))])
@pytest.mark.parametrize("sides", [True, False])
def test_planes_are_as_wide_as_usd_says(
    stage: Usd.Stage, axis: str, spans: tuple, sides: bool, device: wp.Device
) -> None:
    plane = UsdGeom.Plane.Define(stage, "/it")
    plane.CreateAxisAttr(axis)
    plane.CreateWidthAttr({"X": 4.0, "Y": 4.0, "Z": 2.0}[axis])  # along z, x, x
    plane.CreateLengthAttr({"X": 2.0, "Y": 2.0, "Z": 4.0}[axis])  # along y, z, y
    plane.CreateDoubleSidedAttr(sides)
    scene = wc.from_usd(stage, device=device)
    low, high = scene.bounds()
    np.testing.assert_allclose(high - low, spans, atol=1e-6)
    normal = np.eye(3)["XYZ".index(axis)]
    for sign in (1.0, -1.0):
        eye = 3.0 * sign * normal
        camera = wc.Camera(
            "c", width=8, height=8, lens=wc.Pinhole(fovy=20.0), position=eye,
            rotation=quaternion(look_at(eye, np.zeros(3))), outputs=("depth",),
        )  # fmt: skip
        assert np.isfinite(image(scene, "depth", camera)).all() == (sides or sign > 0.0)


def test_endless_planes(stage: Usd.Stage, device: wp.Device) -> None:
    plane = UsdGeom.Plane.Define(stage, "/it")
    plane.CreateWidthAttr(0.0)
    plane.CreateLengthAttr(0.0)
    for sides in (False, True):
        plane.CreateDoubleSidedAttr(sides)
        scene = wc.from_usd(stage, device=device)
        assert scene.shapes == ("/it", "/it/back")[: 1 + sides]
        assert image(scene, "depth", above(3.0, 8, 1000.0)) == pytest.approx(3.0)
        below = wc.Camera(
            "c", width=8, height=8, lens=wc.Pinhole(fovy=20.0), position=(0, 0, -3), outputs=("depth",),
            rotation=(0.0, 1.0, 0.0, 0.0),
        )  # fmt: skip
        assert np.isfinite(image(scene, "depth", below)).all() == sides


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
    """They stay square to the surface: here of a slope that is stretched."""
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


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.0254])
@pytest.mark.parametrize("up", ["Y", "Z"])
def test_units_and_axes(unit: float, up: str, device: wp.Device) -> None:
    stage = metric(Usd.Stage.CreateInMemory(), unit, up)
    cube = UsdGeom.Cube.Define(stage, "/it")
    cube.CreateSizeAttr(1.0)
    upwards = np.eye(3)["XYZ".index(up)]
    UsdGeom.Xformable(cube).AddTranslateOp().Set(tuple(3.0 * upwards))
    low, high = wc.from_usd(stage, device=device).bounds()
    np.testing.assert_allclose(high, unit * np.array((0.5, 0.5, 3.5)), rtol=1e-5)
    np.testing.assert_allclose(low, unit * np.array((-0.5, -0.5, 2.5)), rtol=1e-5)
    low, high = wc.from_usd(stage, device=device, up_axis=None, meters_per_unit=1.0).bounds()
    np.testing.assert_allclose(high, 0.5 + 3.0 * upwards, rtol=1e-5)


def test_units_that_are_not_said(caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Sphere.Define(stage, "/it")
    _, high = wc.from_usd(stage, device=device).bounds()
    assert high[0] == pytest.approx(0.01)
    assert "does not say its metersPerUnit; USD's default of 0.01 is taken" in caplog.text


def test_sizes_that_nobody_means(stage: Usd.Stage, caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    UsdGeom.Sphere.Define(stage, "/it").CreateRadiusAttr(1e5)
    wc.from_usd(stage, device=device)
    assert "m across; if that is wrong, give meters_per_unit, which is 1" in caplog.text


def test_point_instances_share_their_mesh(stage: Usd.Stage, device: wp.Device) -> None:
    instancer = UsdGeom.PointInstancer.Define(stage, "/all")
    pose(instancer)
    add_square(stage, "/all/Protos/square", half=0.2)
    cube = UsdGeom.Cube.Define(stage, "/all/Protos/cube")
    cube.CreateSizeAttr(0.3)
    UsdGeom.Xformable(cube).AddTranslateOp().Set((0, 0, 0.5))
    instancer.CreatePrototypesRel().SetTargets(["/all/Protos/square", "/all/Protos/cube"])
    instancer.CreateProtoIndicesAttr([0, 0, 1, 0])
    places = [(-1, -1, 0), (1, -1, 0), (0, 0, 0), (-1, 1, 0)]
    instancer.CreatePositionsAttr(places)
    turns = [Gf.Quath(1, 0, 0, 0), Gf.Quath(0.7071, 0, 0, 0.7071), Gf.Quath(1, 0, 0, 0), Gf.Quath(0, 0, 0, 1)]
    instancer.CreateOrientationsAttr(turns)
    instancer.CreateScalesAttr([(1, 1, 1), (1, 1, 1), (2, 2, 2), (1, 1, 1)])
    instancer.CreateInvisibleIdsAttr([3])
    scene = wc.from_usd(stage, device=device)
    assert scene.instances == ("/all[0]", "/all[1]", "/all[2]", "/all[3]")
    assert scene.shapes == ("/all[0]/square", "/all[1]/square", "/all[2]/cube")
    assert len(scene._parts.meshes) == 1
    frame = np.array(UsdGeom.Xformable(instancer).GetLocalTransformation()).T
    positions = scene.array("shape_positions").numpy()[0]
    homogeneous = np.array([(*place, 1.0) for place in (places[0], places[1], (0, 0, 1.0))])  # 0.5 scaled by 2
    np.testing.assert_allclose(positions, (homogeneous @ frame.T)[:, :3], atol=1e-6)
    assert scene.array("shape_sizes").numpy()[0, 2] == pytest.approx(0.3)
    eye = (frame @ (0, 0, 5.0, 1))[:3]
    down = wc.Camera(
        "down", width=64, height=64, lens=wc.Pinhole(fovy=45.0), position=eye, rotation=quaternion(frame[:3, :3]),
        outputs=("instances", "segmentation"),
    )  # fmt: skip
    images = wc.Renderer(scene, [down]).render()["down"]
    assert set(images["instances"].unique().tolist()) == {-1, 0, 1, 2}
    np.testing.assert_array_equal(images["instances"].cpu(), images["segmentation"].cpu())


def test_an_instancer_of_itself(stage: Usd.Stage, device: wp.Device) -> None:
    instancer = UsdGeom.PointInstancer.Define(stage, "/a")
    instancer.CreatePrototypesRel().SetTargets(["/a"])
    instancer.CreateProtoIndicesAttr([0])
    instancer.CreatePositionsAttr([(0, 0, 0)])
    with pytest.raises(wc.WarpcamError, match="point instancer /a has itself among its prototypes"):
        wc.from_usd(stage, device=device)


def test_instanceable_prims_share_their_mesh(stage: Usd.Stage, device: wp.Device) -> None:
    stage.DefinePrim("/Proto", "Xform")
    add_square(stage, "/Proto/square", half=0.3)
    for name, x in (("a", -1.0), ("b", 1.0)):
        prim = UsdGeom.Xform.Define(stage, f"/World/{name}")
        prim.GetPrim().GetReferences().AddInternalReference("/Proto")
        prim.GetPrim().SetInstanceable(True)
        prim.AddTranslateOp().Set((x, 0, 0))
        UsdGeom.Xformable(prim).AddScaleOp().Set((1, 1, 1) if name == "a" else (2, 1, 1))
    UsdGeom.Imageable(stage.GetPrimAtPath("/Proto")).MakeInvisible()
    stage.GetPrimAtPath("/Proto").SetActive(True)
    for name in ("a", "b"):
        UsdGeom.Imageable(stage.GetPrimAtPath(f"/World/{name}")).CreateVisibilityAttr("inherited")
    scene = wc.from_usd(stage, device=device)
    assert scene.shapes == ("/World/a/square", "/World/b/square")
    assert scene.instances == ("/World/a", "/World/b")
    assert len(scene._parts.meshes) == 2  # for two stretches
    seen = np.isfinite(image(scene))
    x = np.arange(32) / 8 - 1.9375
    np.testing.assert_array_equal(seen[16], (np.abs(x + 1) < 0.3) | (np.abs(x - 1) < 0.6))


def test_visibility_and_purpose(stage: Usd.Stage, device: wp.Device) -> None:
    for name in ("default", "render", "proxy", "guide"):
        parent = UsdGeom.Xform.Define(stage, f"/{name}")
        parent.CreatePurposeAttr(name)
        UsdGeom.Sphere.Define(stage, f"/{name}/it")
    hidden = UsdGeom.Xform.Define(stage, "/hidden")
    hidden.MakeInvisible()
    UsdGeom.Sphere.Define(stage, "/hidden/it")
    assert wc.from_usd(stage, device=device).shapes == ("/default/it", "/render/it")
    assert wc.from_usd(stage, device=device, purposes=("guide", "proxy")).shapes == ("/proxy/it", "/guide/it")


def test_cameras_see_as_usd_says(stage: Usd.Stage, device: wp.Device) -> None:
    """Where a point lands, by the definition of the aperture; pixels are square, the width decides."""
    point = np.array((0.35, -0.2, -4.0))
    sphere = UsdGeom.Sphere.Define(stage, "/dot")
    sphere.CreateRadiusAttr(0.02)
    UsdGeom.Xformable(sphere).AddTranslateOp().Set(tuple(point))
    camera = UsdGeom.Camera.Define(stage, "/cam")
    camera.CreateFocalLengthAttr(24.0)
    camera.CreateHorizontalApertureAttr(20.0)
    camera.CreateVerticalApertureAttr(15.0)
    camera.CreateHorizontalApertureOffsetAttr(1.5)
    camera.CreateVerticalApertureOffsetAttr(-0.7)
    scene = wc.from_usd(stage, device=device)
    assert scene.cameras == ("/cam",)
    for width, height in ((200, 150), (200, 200), (100, 200)):
        asked = wc.Camera("/cam", width=width, height=height, outputs=("segmentation",))
        rows, columns = np.nonzero(image(scene, "segmentation", asked) == 0)
        x, y = 24.0 * point[:2] / -point[2]  # on the sensor
        tall = 20.0 * height / width
        assert columns.mean() + 0.5 == pytest.approx(width * (0.5 + (x - 1.5) / 20.0), abs=0.7)
        assert rows.mean() + 0.5 == pytest.approx(height * (0.5 - (y + 0.7) / tall), abs=0.7)


def test_camera_clipping_and_orthographic_cameras(device: wp.Device) -> None:
    stage = metric(Usd.Stage.CreateInMemory(), 0.1)
    add_square(stage, "/near", z=-10.0, half=2.0)
    add_square(stage, "/far", z=-30.0, half=40.0)
    camera = UsdGeom.Camera.Define(stage, "/cam")
    camera.CreateProjectionAttr("orthographic")
    camera.CreateHorizontalApertureAttr(80.0)
    camera.CreateVerticalApertureAttr(80.0)  # eight units
    scene = wc.from_usd(stage, device=device)
    asked = wc.Camera("/cam", width=16, height=16, outputs=("depth",))
    seen = image(scene, "depth", asked)
    assert seen[8, 8] == pytest.approx(1.0)
    assert (seen < 2.0).sum() == 64  # 4 of 8 units each way
    camera.CreateClippingRangeAttr(Gf.Vec2f(15.0, 25.0))
    scene = wc.from_usd(stage, device=device)
    assert not np.isfinite(image(scene, "depth", asked)).any()
    asked = wc.Camera("/cam", width=16, height=16, outputs=("depth",), near=0.0, far=9.0)
    assert image(scene, "depth", asked)[8, 8] == pytest.approx(1.0)


def test_semantics(stage: Usd.Stage, device: wp.Device) -> None:
    left, right = UsdGeom.Xform.Define(stage, "/left"), UsdGeom.Xform.Define(stage, "/right")
    for parent, x in ((left, -1.0), (right, 1.0)):
        square = add_square(stage, f"{parent.GetPath()}/square", half=0.5)
        UsdGeom.Xformable(square).AddTranslateOp().Set((x, 0, 0))
    UsdSemantics.LabelsAPI.Apply(left.GetPrim(), "class").CreateLabelsAttr(["table", "furniture"])
    old = right.GetPrim()
    old.CreateAttribute("semantic:Semantics:params:semanticType", Sdf.ValueTypeNames.String).Set("class")
    old.CreateAttribute("semantic:Semantics:params:semanticData", Sdf.ValueTypeNames.String).Set("cup")
    camera = above(3.0, 32, 4.0, "semantics")
    scene = wc.from_usd(stage, device=device, semantics={"cup": 7, "furniture": 3})
    seen = image(scene, "semantics", camera)
    assert (seen[16, 8], seen[16, 24], seen[0, 0]) == (3, 7, 0)
    scene = wc.from_usd(stage, device=device)
    assert scene.semantics == {"cup": 1, "furniture": 2, "table": 3}
    seen = image(scene, "semantics", camera)
    assert (seen[16, 8], seen[16, 24], seen[0, 0]) == (3, 1, 0)


def test_what_nobody_labels_has_no_label(device: wp.Device) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = wc.from_mujoco(model, data, device=device)
    for output, none in (("semantics", 0), ("instances", -1), ("segmentation", 0)):
        assert image(scene, output)[16, 16] == none


def test_time_samples(stage: Usd.Stage, device: wp.Device) -> None:
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(10.0)
    parent = UsdGeom.Xform.Define(stage, "/moves")
    shift = parent.AddTranslateOp()
    shift.Set((0, 0, 0), 0.0)
    shift.Set((0, 0, 2), 10.0)
    cube = UsdGeom.Cube.Define(stage, "/moves/cube")
    size = cube.CreateSizeAttr()
    size.Set(1.0, 0.0)
    size.Set(2.0, 10.0)
    blinking = add_square(stage, "/blinks", half=3.0, z=-1.0)
    visibility = UsdGeom.Imageable(blinking).CreateVisibilityAttr()
    visibility.Set("invisible", 0.0)
    visibility.Set("inherited", 5.0)
    scene = wc.from_usd(stage, num_worlds=2, device=device)
    camera = above(5.0, 16, 4.0)
    renderer = wc.Renderer(scene, [camera])
    tensor = renderer.images["above"]["depth"]
    for time, depth_, behind in (
        (0.0, 4.5, np.inf),
        (5.0, 5.0 - 1.0 - 0.75, 6.0),
        (10.0, 2.0, 6.0),
        (0.0, 4.5, np.inf),
    ):
        scene.set_time(time)
        renderer.render()
        for world in range(2):
            assert float(tensor[world, 8, 8]) == pytest.approx(depth_)
            assert float(tensor[world, 0, 0]) == pytest.approx(behind)
    with pytest.raises(wc.WarpcamError, match="set_time: time must be a finite number, got nan"):
        scene.set_time(float("nan"))


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


def test_the_whole_way_of_a_path(tmp_path: Path, device: wp.Device) -> None:
    """A reference in a folder beside, relative to the file that has it; a payload; and both in a package."""
    (tmp_path / "parts").mkdir()
    part = metric(Usd.Stage.CreateNew(str(tmp_path / "parts" / "part.usda")))
    part.SetDefaultPrim(add_square(part, "/square").GetPrim())
    part.Save()
    whole = metric(Usd.Stage.CreateNew(str(tmp_path / "whole.usda")))
    whole.DefinePrim("/a").GetReferences().AddReference("./parts/part.usda")
    whole.DefinePrim("/b").GetPayloads().AddPayload("./parts/part.usda")
    whole.Save()
    from pxr import UsdUtils

    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "whole.usda"), str(tmp_path / "whole.usdz"))
    for name in ("whole.usda", "whole.usdz"):
        assert wc.from_usd(tmp_path / name, device=device).shapes == ("/a", "/b")


def test_poses_of_many_worlds(stage: Usd.Stage, device: wp.Device) -> None:
    UsdGeom.Xform.Define(stage, "/robot").AddTranslateOp().Set((1, 2, 3))
    cube = UsdGeom.Cube.Define(stage, "/robot/link")
    cube.CreateSizeAttr(0.4)
    UsdGeom.Xformable(cube).AddTranslateOp().Set((0.5, 0, 0))
    hand = UsdGeom.Xform.Define(stage, "/robot/hand")
    UsdGeom.Xformable(hand).AddTranslateOp().Set((0, 1, 0))
    UsdGeom.Sphere.Define(stage, "/robot/hand/tip").CreateRadiusAttr(0.1)
    UsdGeom.Camera.Define(stage, "/robot/hand/eye")
    UsdLux.SphereLight.Define(stage, "/robot/hand/lamp")
    add_square(stage, "/floor", z=-1)
    scene = wc.from_usd(stage, num_worlds=5, device=device)
    link, tip, floor = (scene.shapes.index(f"/{name}") for name in ("robot/link", "robot/hand/tip", "floor"))
    np.testing.assert_allclose(scene.array("shape_positions").numpy()[:, link], np.tile((1.5, 2, 3), (5, 1)))
    random = np.random.default_rng(0)
    poses = np.concatenate((random.normal(size=(5, 2, 3)), random.normal(size=(5, 2, 4))), axis=-1).astype(np.float32)
    where = str(scene.array("shape_positions").device)
    scene.set_poses(["/robot", "/robot/hand"], torch.tensor(poses, device=where))
    turns = np.array([[rotation_of(pose[3:]) for pose in world] for world in poses])

    def at(name: str) -> np.ndarray:
        return scene.array(name).numpy()

    expected_link = poses[:, 0, :3] + turns[:, 0] @ (0.5, 0, 0)
    np.testing.assert_allclose(at("shape_positions")[:, link], expected_link, atol=1e-5)
    np.testing.assert_allclose(at("shape_rotations")[:, link], turns[:, 0], atol=1e-5)
    np.testing.assert_allclose(at("shape_positions")[:, tip], poses[:, 1, :3], atol=1e-5)
    np.testing.assert_allclose(at("camera_positions")[:, 0], poses[:, 1, :3], atol=1e-5)
    np.testing.assert_allclose(at("camera_rotations")[:, 0], turns[:, 1], atol=1e-5)
    np.testing.assert_allclose(at("light_positions")[:, 0], poses[:, 1, :3], atol=1e-5)
    np.testing.assert_allclose(at("light_directions")[:, 0], -turns[:, 1, :, 2], atol=1e-5)
    np.testing.assert_allclose(at("shape_positions")[:, floor], 0.0)
    body = scene.bodies.index("/robot/hand")
    np.testing.assert_allclose(at("body_positions")[:, body], poses[:, 1, :3], atol=1e-5)
    # What is driven by itself does not follow what is above it.
    scene.set_poses(["/robot"], poses[:1, :1])
    np.testing.assert_allclose(at("shape_positions")[:, link], np.tile(expected_link[0], (5, 1)), atol=1e-5)
    np.testing.assert_allclose(at("shape_positions")[:, tip], poses[:, 1, :3], atol=1e-5)


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
    )


def test_worlds_of_their_own(stage: Usd.Stage, device: wp.Device) -> None:
    """Visibility and colours, with no mesh stored twice."""
    for name, x in (("a", -1.0), ("b", 1.0)):
        UsdGeom.Xform.Define(stage, f"/{name}").AddTranslateOp().Set((x, 0, 0))
        square = add_square(stage, f"/{name}/square", half=0.5)
        square.CreateDisplayColorAttr([(1, 1, 1)])
    scene = wc.from_usd(stage, num_worlds=3, device=device)
    renderer = wc.Renderer(scene, [above(3.0, 16, 4.0, "albedo", "segmentation")])
    images = renderer.render()["above"]
    assert images["albedo"][:, 8, 4].tolist() == [[255] * 3] * 3
    scene.set_colors(["/a"], np.array([[[1, 0, 0]], [[0, 1, 0]], [[0, 0, 1]]], np.float32))
    scene.set_visible(["/b"], np.array([[True], [False], [True]]))
    renderer.render()
    assert images["albedo"][:, 8, 4].tolist() == [[255, 0, 0], [0, 255, 0], [0, 0, 255]]
    assert (images["segmentation"][:, 8, 12, 0] >= 0).tolist() == [True, False, True]
    scene.set_visible(["/b"], np.array([[True], [True], [False]]))
    scene.set_visible(["/a/square"], np.array([[False]]))
    renderer.render()
    assert (images["segmentation"][:, 8, 12, 0] >= 0).tolist() == [True, True, False]
    assert (images["segmentation"][:, 8, 4, 0] >= 0).tolist() == [False] * 3
    scene.set_visible(["/a/square"], np.array([[True]]))
    renderer.render()
    assert images["albedo"][:, 8, 4].tolist() == [[255, 0, 0], [0, 255, 0], [0, 0, 255]]


def test_four_thousand_variations_share_their_mesh(stage: Usd.Stage, device: wp.Device) -> None:
    """Poses, visibilities, colours and textures of each world's own; meshes and images are there once."""
    count, side = 4096, 32
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, side + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    faces = [(a, a + side + 1, a + side + 2, a + 1) for a in first]
    for name in ("left", "right"):
        mesh = add_mesh(stage, f"/{name}/mesh", np.append(grid, np.zeros((len(grid), 1)), axis=1), faces)
        st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
        st.Set([tuple(map(float, place + 0.5)) for place in grid])
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(
            UsdShade.Material(add_material(stage, f"/Looks/{name}", diffuseColor=(1.0, 1.0, 1.0)).GetPrim().GetParent())
        )
    pool = {
        name: np.full((64, 64, 3), color, np.uint8) for name, color in (("red", (255, 0, 0)), ("blue", (0, 0, 255)))
    }
    one, many = (wc.from_usd(stage, num_worlds=n, device=device, textures=pool) for n in (1, count))
    random = np.random.default_rng(0)
    poses = np.zeros((count, 2, 7), np.float32)
    poses[:, :, 3] = 1.0
    poses[:, :, 0] = (-1.0, 1.0)
    swapped, seen, painted, image = random.random((4, count)) < 0.5
    poses[swapped] = poses[swapped][:, ::-1]
    colors = np.where(painted[:, None, None], np.float32((0.0, 1.0, 0.0)), np.float32((1.0, 1.0, 1.0)))
    many.set_poses(["/left", "/right"], poses)
    many.set_visible(["/left"], seen[:, None])
    many.set_colors(["/right"], np.ascontiguousarray(colors))
    many.set_textures(["/Looks/left"], image[:, None].astype(np.int32))
    seen_images = wc.Renderer(many, [above(3.0, 4, 3.0, "albedo")]).render()["above"]["albedo"].cpu().numpy()
    sides = np.where(swapped[:, None, None], seen_images[:, 1, (3, 0)], seen_images[:, 1, (0, 3)])
    shown = np.where(seen[:, None], np.where(image[:, None], (0, 0, 255), (255, 0, 0)), 0)
    np.testing.assert_array_equal(sides[:, 0], shown)
    np.testing.assert_array_equal(sides[:, 1], np.where(painted[:, None], (0, 255, 0), 255))
    for part, name in (("_meshes", "faces"), ("_meshes", "nodes"), ("_meshes", "uvs"), ("_textures", "texels")):
        assert getattr(getattr(many, part), name).shape == getattr(getattr(one, part), name).shape
    own = sum(many.array(name).capacity for name in FIELDS)
    assert own < count * 2 * 200  # bytes: what a shape, a body and a material have of their own


def test_driving_neither_allocates_nor_binds_again(stage: Usd.Stage, device: wp.Device) -> None:
    UsdGeom.Xform.Define(stage, "/x")
    UsdGeom.Cube.Define(stage, "/x/cube")
    scene = wc.from_usd(stage, num_worlds=4, device=device)
    poses = wp.zeros((4, 1, 7), dtype=wp.float32, device=device)
    colors = wp.zeros((4, 1, 4), dtype=wp.float32, device=device)
    scene.set_poses(["/x"], poses)
    scene.set_colors(["/x"], colors)
    tables = scene.tables()
    pointers = {name: scene.array(name).ptr for name in ("shape_positions", "shape_colors")}
    scene.set_poses(["/x"], poses)
    scene.set_colors(["/x"], colors)
    assert scene.tables() is tables
    assert pointers == {name: scene.array(name).ptr for name in pointers}


BAD_DRIVING = {
    "set_poses: the scene has no '/nothing'; it has: '/', '/x', '/x/cube'": lambda s: s.set_poses(
        ["/nothing"], np.zeros((1, 1, 7), np.float32)
    ),
    "set_poses: poses must have shape (3 or 1, 1, 7), got (2, 1, 7)": lambda s: s.set_poses(
        ["/x"], np.zeros((2, 1, 7), np.float32)
    ),
    "set_poses: paths must be a sequence of paths like [\"/World/Box\"], got '/x'": lambda s: s.set_poses(
        "/x", np.zeros((1, 1, 7), np.float32)
    ),
    "set_poses: paths names something twice: ['/x', '/x']": lambda s: s.set_poses(
        ["/x", "/x"], np.zeros((1, 2, 7), np.float32)
    ),
    "set_colors: colors must have shape (3 or 1, 1, 3 or 4), got (1, 1, 5)": lambda s: s.set_colors(
        ["/x"], np.zeros((1, 1, 5), np.float32)
    ),
    "set_visible: visible must be an array of uint8, got": lambda s: s.set_visible(["/x"], np.zeros((1, 1))),
    "set_visible: '/empty' has no shapes that were visible when the scene was read": lambda s: s.set_visible(
        ["/empty"], np.zeros((1, 1), bool)
    ),
    "set_textures: the scene has no material '/x'; it has: none": lambda s: s.set_textures(
        ["/x"], np.zeros((1, 1), np.int32)
    ),
}


@pytest.mark.parametrize("text", BAD_DRIVING)
def test_driving_badly(text: str, stage: Usd.Stage) -> None:
    UsdGeom.Xform.Define(stage, "/x")
    UsdGeom.Cube.Define(stage, "/x/cube")
    if "/empty" in text:
        UsdGeom.Xform.Define(stage, "/empty")
    scene = wc.from_usd(stage, num_worlds=3, device="cpu")
    with pytest.raises(wc.WarpcamError) as caught:
        BAD_DRIVING[text](scene)
    assert text in str(caught.value)


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
