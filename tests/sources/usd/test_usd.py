"""Stages as a whole: units, instances, visibility, cameras, labels, time."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from views import quaternion

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSemantics
from usd_stages import above, add_square, image, metric, pose


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
    """Points land as the definition of the aperture says; pixels are square, the width decides."""
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


@pytest.mark.parametrize("shape", [(60, 40), (40, 40), (20, 40)])
def test_orthographic_cameras_see_as_usd_says(shape: tuple[int, int], device: wp.Device) -> None:
    """The view is as wide as the horizontal aperture, about its offset."""
    stage = metric(Usd.Stage.CreateInMemory(), 0.01)
    add_square(stage, "/it", z=-100.0, half=10.0)
    camera = UsdGeom.Camera.Define(stage, "/cam")
    camera.CreateProjectionAttr("orthographic")
    camera.CreateHorizontalApertureAttr(800.0)  # in tenths of a centimetre
    camera.CreateVerticalApertureAttr(300.0)
    camera.CreateHorizontalApertureOffsetAttr(100.0)
    camera.CreateVerticalApertureOffsetAttr(-50.0)
    width, height = shape
    asked = wc.Camera("/cam", width=width, height=height, outputs=("points",))
    points = image(wc.from_usd(stage, device=device), "points", asked)
    seen = np.isfinite(points[..., 0])
    pixel = 0.8 / width  # [m]
    assert seen.sum() == pytest.approx((0.2 / pixel) ** 2, rel=0.2)
    rows, columns = np.nonzero(seen)
    np.testing.assert_allclose(points[seen][:, 0], 0.1 + (columns + 0.5 - 0.5 * width) * pixel, atol=1e-6)
    np.testing.assert_allclose(points[seen][:, 1], -0.05 - (rows + 0.5 - 0.5 * height) * pixel, atol=1e-6)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_apertures_change_with_time(stage: Usd.Stage, projection: str, device: wp.Device) -> None:
    add_square(stage, "/it", z=-2.0, half=0.5)
    camera = UsdGeom.Camera.Define(stage, "/cam")
    camera.CreateProjectionAttr(projection)
    camera.CreateFocalLengthAttr(20.0)
    for time, aperture in ((1.0, 20.0), (2.0, 40.0)):
        camera.CreateHorizontalApertureAttr().Set(aperture, time)
    scene = wc.from_usd(stage, device=device)
    renderer = wc.Renderer(scene, [wc.Camera("/cam", width=32, height=32, outputs=("segmentation",))])
    for time, seen in ((1.0, 16), (2.0, 8), (1.0, 16)):
        scene.set_time(time)
        assert (renderer.render()["/cam"]["segmentation"] == 0).sum() == seen**2


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


def test_labels_of_samples_and_labels_that_say_nothing(stage: Usd.Stage, device: wp.Device) -> None:
    prim = add_square(stage, "/it").GetPrim()
    prim.CreateAttribute("semantic:Semantics:params:semanticData", Sdf.ValueTypeNames.String)
    assert wc.from_usd(stage, device=device).semantics == {}
    UsdSemantics.LabelsAPI.Apply(prim, "class").CreateLabelsAttr().Set(["mug"], 1.0)
    prim.GetAttribute("semantic:Semantics:params:semanticData").Set("cup", 1.0)
    assert wc.from_usd(stage, device=device).semantics == {"cup": 1, "mug": 2}


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
