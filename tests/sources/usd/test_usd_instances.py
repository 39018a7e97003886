"""Point instances whose prototypes are not drawn by themselves, and their colours."""

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Sdf, Usd, UsdGeom
from usd_stages import above, add_material, add_square, image, metric

RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)
BARE = (118, 118, 118)  # 0.18, encoded
LEFT, RIGHT = (16, 8), (16, 24)  # pixels at x = -1 and x = 1
TWO = """#usda 1.0
({unit})
{specifier} "Library" {{
    def Xform "tree" {{
        double3 xformOp:translate = (0, 0, 0.5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Mesh "crown" {{
            uniform token subdivisionScheme = "none"
            point3f[] points = [(-.3, -.3, 0), (.3, -.3, 0), (.3, .3, 0), (-.3, .3, 0)]
            int[] faceVertexCounts = [4]
            int[] faceVertexIndices = [0, 1, 2, 3]
        }}
    }}
}}
def PointInstancer "trees" {{
    rel prototypes = [</Library/tree>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(-1, 0, 0), (1, 0, 0)]
}}
"""


@pytest.mark.parametrize("specifier", ["class", "over", "def"])
def test_prototypes_of_a_library(specifier: str, device: wp.Device) -> None:
    """Classes and overs are drawn by their instances alone."""
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().ImportFromString(TWO.format(unit='metersPerUnit = 1\nupAxis = "Z"', specifier=specifier))
    depth = image(wc.from_usd(stage, device=device))
    np.testing.assert_allclose((depth[LEFT], depth[RIGHT]), 2.5, atol=1e-5)
    assert np.isfinite(depth[16, 16]) == (specifier == "def")


def squares(prototype: str = "/all/square") -> tuple[Usd.Stage, UsdGeom.PointInstancer]:
    stage = metric(Usd.Stage.CreateInMemory())
    instancer = UsdGeom.PointInstancer.Define(stage, "/all")
    add_square(stage, prototype, half=0.3)
    instancer.CreatePrototypesRel().SetTargets([prototype])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(-1, 0, 0), (1, 0, 0)])
    return stage, instancer


def paint(prim: UsdGeom.Imageable, name: str, values: list, interpolation: str) -> UsdGeom.Primvar:
    kind = Sdf.ValueTypeNames.Color3fArray if name == "displayColor" else Sdf.ValueTypeNames.FloatArray
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, kind, interpolation)
    primvar.Set(values)
    return primvar


def shown(stage: Usd.Stage, device: wp.Device) -> tuple[tuple[int, ...], tuple[int, ...]]:
    scene = wc.from_usd(stage, device=device)
    assert len(scene._parts.meshes) == 1
    albedo = image(scene, "albedo")
    return tuple(albedo[LEFT].tolist()), tuple(albedo[RIGHT].tolist())


@pytest.mark.parametrize("interpolation", ["vertex", "varying"])
def test_instances_have_colours_of_their_own(interpolation: str, device: wp.Device) -> None:
    """And share their mesh all the same."""
    stage, instancer = squares()
    primvar = paint(instancer, "displayColor", [(1, 0, 0), (0, 1, 0)], interpolation)
    assert shown(stage, device) == (RED, GREEN)
    primvar.SetIndices([1, 0])
    assert shown(stage, device) == (GREEN, RED)


def test_a_prototypes_own_colour_counts(device: wp.Device) -> None:
    stage, instancer = squares()
    paint(instancer, "displayColor", [(1, 0, 0), (0, 1, 0)], "vertex")
    paint(UsdGeom.Imageable(stage.GetPrimAtPath("/all/square")), "displayColor", [(0, 0, 1)], "constant")
    assert shown(stage, device) == (BLUE, BLUE)


def test_instances_of_instances(device: wp.Device) -> None:
    """Opinions of inner instances count before those of outer ones, of which nothing is left afterwards."""
    stage = metric(Usd.Stage.CreateInMemory())
    outer = UsdGeom.PointInstancer.Define(stage, "/outer")
    inner = UsdGeom.PointInstancer.Define(stage, "/outer/inner")
    add_square(stage, "/outer/inner/square", half=0.3)
    add_square(stage, "/after", half=0.3)
    for instancer, prototype, positions in (
        (inner, "/outer/inner/square", [(0, 0, 0)]),
        (outer, "/outer/inner", [(-1, 0, 0), (1, 0, 0)]),
    ):
        instancer.CreatePrototypesRel().SetTargets([prototype])
        instancer.CreateProtoIndicesAttr([0] * len(positions))
        instancer.CreatePositionsAttr(positions)
    paint(outer, "displayColor", [(1, 0, 0), (0, 1, 0)], "vertex")
    albedo = image(wc.from_usd(stage, device=device), "albedo")
    assert tuple(albedo[LEFT].tolist()) == RED and tuple(albedo[RIGHT].tolist()) == GREEN
    assert tuple(albedo[16, 16].tolist()) == BARE
    paint(inner, "displayColor", [(0, 0, 1)], "vertex")
    albedo = image(wc.from_usd(stage, device=device), "albedo")
    assert tuple(albedo[LEFT].tolist()) == BLUE


def test_instances_have_opacities_of_their_own(device: wp.Device) -> None:
    stage, instancer = squares()
    paint(instancer, "displayOpacity", [1.0, 0.5], "vertex")
    scene = wc.from_usd(stage, device=device)
    alpha = wc.Renderer(scene, [above(3.0, 32, 4.0, "rgba")]).render()["above"]["rgba"][0, ..., 3].cpu().numpy()
    assert alpha[LEFT] == 255 and alpha[RIGHT] == pytest.approx(128, abs=1) and alpha[16, 16] == 0


def test_colours_of_another_number_are_named(caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    stage, instancer = squares()
    paint(instancer, "displayColor", [(1, 0, 0)] * 3, "vertex")
    assert shown(stage, device) == (BARE, BARE)
    assert "has displayColor of another number than its instances: /all" in caplog.text


def test_values_that_change_with_time_are_named(caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    """Colours are those of the first sample, also where there is no value but samples."""
    stage = metric(Usd.Stage.CreateInMemory())
    square = add_square(stage, "/square")
    color = square.CreateDisplayColorPrimvar("constant")
    color.Set([(1, 0, 0)], 0.0)
    color.Set([(0, 1, 0)], 10.0)
    assert tuple(image(wc.from_usd(stage, device=device), "albedo")[16, 16].tolist()) == RED
    assert "has displayColor that changes with time, and keeps what it has at first: /square" in caplog.text
    attribute = add_material(stage, "/paint", diffuseColor=(0.5, 0.5, 0.5)).GetInput("diffuseColor").GetAttr()
    attribute.Clear()
    attribute.Set((0, 1, 0), 0.0)
    attribute.Set((0, 0, 1), 10.0)
    from pxr import UsdShade

    UsdShade.MaterialBindingAPI.Apply(square.GetPrim()).Bind(UsdShade.Material.Get(stage, "/paint"))
    assert tuple(image(wc.from_usd(stage, device=device), "albedo")[16, 16].tolist()) == GREEN
    assert "has a value that changes with time, and keeps its first: /paint/surface.inputs:diffuseColor" in caplog.text


def test_prototypes_move_with_time_and_are_not_exchanged(caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    stage, instancer = squares()
    root = UsdGeom.Xformable(stage.GetPrimAtPath(instancer.GetPrototypesRel().GetTargets()[0]))
    move = root.AddTranslateOp()
    move.Set((0, 0, 0), 0.0)
    move.Set((0, 0, 0.5), 10.0)
    scene = wc.from_usd(stage, device=device)
    before = scene.array("shape_positions").numpy()[0].copy()
    scene.set_time(10.0)
    np.testing.assert_allclose(scene.array("shape_positions").numpy()[0] - before, [(0, 0, 0.5)] * 2, atol=1e-6)
    assert not caplog.text
    add_square(stage, "/other")
    instancer.GetPrototypesRel().AddTarget("/other")
    instancer.GetProtoIndicesAttr().Clear()
    instancer.GetProtoIndicesAttr().Set([0, 0], 0.0)
    instancer.GetProtoIndicesAttr().Set([0, 1], 10.0)
    scene = wc.from_usd(stage, device=device)
    scene.set_time(10.0)
    assert "changes its prototypes with time, and keeps those it had at first: /all" in caplog.text
