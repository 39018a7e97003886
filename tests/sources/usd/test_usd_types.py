"""Attributes of unexpected types: each costs itself one warning, by prim and name, and nothing else of the stage."""

import ast
import logging
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd

from warpcam.sources import usd as room
from warpcam.sources.usd.attributes import AttributeReader

QUAD = """point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
int[] faceVertexCounts = [4]
int[] faceVertexIndices = [0, 1, 2, 3]
color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] (interpolation = "vertex")
float[] primvars:displayOpacity = [1]
int[] primvars:st:indices = [0, 1, 2, 3]
texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")"""
SOLID = "color3f[] primvars:displayColor = [(1, 0, 0)]"
PRIMS = {
    "Mesh": f"{QUAD}\nnormal3f[] normals = [(0, 0, 1)] (interpolation = \"constant\")",
    "Mesh and its normals": f"{QUAD}\nnormal3f[] primvars:normals = [(0, 0, 1)] (interpolation = \"constant\")",
    "Mesh and its subset": f"{QUAD}\ndef GeomSubset \"part\" {{\nuniform token elementType = \"face\"\n"
    "int[] indices = [0]\nuniform token familyName = \"materialBind\"\n}",
    "TetMesh": "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]\n"
    "int4[] tetVertexIndices = [(0, 1, 2, 3)]",
    "Points": f"point3f[] points = [(0, 0, 0), (1, 0, 0)]\nfloat[] widths = [0.1]\n{SOLID}",
    "Points and their widths": "point3f[] points = [(0, 0, 0)]\nfloat[] primvars:widths = [0.1]",
    "BasisCurves": "point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 1, 0)]\nint[] curveVertexCounts = [4]\n"
    "float[] widths = [0.1]",
    **dict.fromkeys(("Cube", "Sphere", "Cylinder", "Cylinder_1", "Capsule", "Capsule_1", "Cone", "Plane"), SOLID),
    "Camera": "float2 clippingRange = (0.1, 10)",
    "SphereLight": "bool inputs:enableColorTemperature = 1",
    "CylinderLight": "",
    "DiskLight": "",
    "RectLight": "",
    "DistantLight": "",
    "DomeLight": "asset inputs:texture:file = @gone.png@",
    "DomeLight_1": "",
    "PointInstancer": "point3f[] positions = [(0, 0, 0)]\nint[] protoIndices = [0]\nrel prototypes = </Fine>\n"
    "quath[] orientations = [(1, 0, 0, 0)]\nint64[] ids = [3]\ncolor3f[] primvars:displayColor = [(1, 0, 0)]",
    "ParticleField3DGaussianSplat": "point3f[] positions = [(0, 0, 0)]\nfloat[] opacities = [1]",
    "Xform": "double3 xformOp:translate = (1, 2, 3)\nuniform token[] xformOpOrder = [\"xformOp:translate\"]\n"
    "token[] semantics:labels:kind = [\"cup\"]\nstring semantic:a:params:semanticData = \"cup\"",
}  # fmt: skip
APIS = '["SemanticsLabelsAPI:kind"]'
# Types of attributes that are not in the schemas of the prims.
TYPES = {
    "inputs:shaping:cone:angle": "float",
    "inputs:shadow:enable": "bool",
    "inputs:texture:file": "asset",
    "poleAxis": "token",
    "primvars:displayColor": "color3f[]",
    "primvars:displayOpacity": "float[]",
    "primvars:normals": "normal3f[]",
    "primvars:st": "texCoord2f[]",
    "primvars:st:indices": "int[]",
    "primvars:widths": "float[]",
    "semantic:a:params:semanticData": "string",
    "semantics:labels:kind": "token[]",
    "xformOp:translate": "double3",
}
ALWAYS = {"Mesh and its subset": (), "Xform": ("purpose", "xformOp:translate")}  # beside what is read from each file
OTHERS: dict[str, Any] = {
    "float": 0.5,
    "string": "left",
    "asset": Sdf.AssetPath("left.png"),
    "bool[]": [True],
    "float3[]": [(1.0, 2.0, 3.0)],
    "float4[]": [(1.0, 2.0, 3.0, 4.0)],
    "matrix4d": Gf.Matrix4d(1.0),
    "string[]": ["left", "right"],
}
NUMBERS = re.compile(r"(point|normal|vector|color|texCoord|half|float|double|uchar|int64|int)(\d?)[hfd]?")


def stage_of(name: str) -> tuple[Usd.Stage, Sdf.Layer]:
    """A prim of the kind at /It beside a sphere, and the layer over it."""
    kind = name.split()[0]
    apis = f"(prepend apiSchemas = {APIS})" if kind == "Xform" else ""
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().ImportFromString(
        f'#usda 1.0\n(\nmetersPerUnit = 1\nupAxis = "Z"\n)\ndef Sphere "Fine" {{}}\n'
        f'def {kind} "It" {apis} {{\n{PRIMS[name]}\n}}\n'
    )
    return stage, stage.GetSessionLayer()


def path_of(name: str) -> str:
    return "/It/part" if name == "Mesh and its subset" else "/It"


def read_by(kind: str, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the attributes that are read."""
    names: dict[str, None] = {}
    get, primvar = AttributeReader.get, AttributeReader.primvar

    def spy(self: AttributeReader, prim: Usd.Prim, name: str, *rest: Any, **more: Any) -> Any:
        if str(prim.GetPath()) == path_of(kind) and (
            name in TYPES or prim.GetPrimDefinition().GetAttributeDefinition(name)
        ):
            names[name] = None
        return get(self, prim, name, *rest, **more)

    def spy_primvar(self: AttributeReader, given: Any, *rest: Any, **more: Any) -> Any:
        if str(given.GetAttr().GetPrim().GetPath()) == path_of(kind):
            names[str(given.GetAttr().GetName())] = None
        return primvar(self, given, *rest, **more)

    with monkeypatch.context() as patch:
        patch.setattr(AttributeReader, "get", spy)
        patch.setattr(AttributeReader, "primvar", spy_primvar)
        wc.from_usd(stage_of(kind)[0], device="cpu")
    return [*names, *ALWAYS.get(kind, ("purpose",))]


def form(type_name: str, primvar: bool) -> tuple[str, bool]:
    """A type without its role and its precision; a primvar may be one value or an array of it."""
    array, single = type_name.endswith("[]") and not primvar, type_name.removesuffix("[]")
    found = NUMBERS.fullmatch(single)
    if found is not None:
        return ("whole" if found[1].startswith("int") else "real") + found[2], array
    return single.replace("token", "string"), array


def others(name: str, attribute: str) -> list[str]:
    """Types that the attribute must not have."""
    stage, _ = stage_of(name)
    definition = stage.GetPrimAtPath(path_of(name)).GetPrimDefinition().GetAttributeDefinition(attribute)
    wanted = str(definition.GetTypeName()) if definition else TYPES[attribute]
    primvar = attribute.startswith("primvars:") and not attribute.endswith(":indices")
    wider = ("float3[]", "float4[]") if attribute == "primvars:st" else ()  # of which the first two numbers are read
    return [other for other in OTHERS if form(other, primvar) != form(wanted, primvar) and other not in wider]


def with_another(name: str, attribute: str, other: str, times: bool) -> Usd.Stage:
    stage, over = stage_of(name)
    prim = Sdf.CreatePrimInLayer(over, path_of(name))
    spec = Sdf.AttributeSpec(prim, attribute, Sdf.ValueTypeNames.Find(other))
    if times:
        for time in (0.0, 1.0):
            over.SetTimeSample(spec.path, time, OTHERS[other])
    else:
        spec.default = OTHERS[other]
    return stage


def drawn_beside(stage: Usd.Stage, times: bool = False) -> None:
    scene = wc.from_usd(stage, device="cpu")
    if times:
        scene.set_time(1.0)
    assert "/Fine" in scene.shapes


def told(caplog: pytest.LogCaptureFixture, name: str, attribute: str) -> list[str]:
    messages = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    return [
        message for message in messages if f"has {attribute} " in message and message.endswith(f": {path_of(name)}")
    ]


@pytest.mark.parametrize("name", PRIMS)
def test_another_type_costs_the_attribute_a_warning(
    name: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    names = read_by(name, monkeypatch)
    assert len(names) >= 3
    for attribute in names:
        wrong = others(name, attribute)
        assert len(wrong) >= 6
        for place, other in enumerate(wrong):
            caplog.clear()
            times = place % 2 == 1
            drawn_beside(with_another(name, attribute, other, times), times)
            said = told(caplog, name, attribute)
            assert len(said) == 1, (attribute, other, caplog.text)
            assert f"of type {other} " in said[0]


@pytest.mark.parametrize("name", PRIMS)
def test_a_relationship_in_the_place_of_an_attribute(
    name: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for attribute in read_by(name, monkeypatch):
        if f" {attribute} " in PRIMS[name] or attribute.startswith("xformOp"):  # an attribute already
            continue
        stage, over = stage_of(name)
        Sdf.RelationshipSpec(Sdf.CreatePrimInLayer(over, path_of(name)), attribute).targetPathList.explicitItems = [
            "/Fine"
        ]
        caplog.clear()
        drawn_beside(stage)
        assert len(told(caplog, name, attribute)) == 1, (attribute, caplog.text)


@pytest.mark.parametrize("name", PRIMS)
def test_tokens_and_numbers_that_are_none(
    name: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    first, _ = stage_of(name)
    definition = first.GetPrimAtPath(path_of(name)).GetPrimDefinition()
    for attribute in read_by(name, monkeypatch):
        schema = definition.GetAttributeDefinition(attribute)
        type_name = str(schema.GetTypeName()) if schema else TYPES[attribute]
        value: Any = {"float": float("nan"), "double": float("nan"), "color3f": (1.0, float("nan"), 1.0)}.get(type_name)
        if schema and schema.GetMetadata("allowedTokens"):
            value = "strange"
        if value is None:
            continue
        stage, over = stage_of(name)
        spec = Sdf.AttributeSpec(
            Sdf.CreatePrimInLayer(over, path_of(name)), attribute, Sdf.ValueTypeNames.Find(type_name)
        )
        spec.default = value
        caplog.clear()
        drawn_beside(stage)
        assert len(told(caplog, name, attribute)) == 1, (attribute, caplog.text)


@pytest.mark.parametrize(
    ("name", "attribute", "type_name", "value"),
    [
        ("Mesh", "points", "double3[]", [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]),
        ("Mesh", "primvars:displayColor", "half3", (1, 1, 1)),
        ("Mesh", "primvars:st", "texCoord3f[]", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]),
        ("TetMesh", "surfaceFaceVertexIndices", "int[]", [0, 1, 2]),
        ("Sphere", "radius", "int", 2),
        ("Camera", "focalLength", "double", 35.0),
        ("DistantLight", "inputs:color", "double3", (1, 1, 1)),
    ],
)
def test_types_that_have_the_same_numbers(
    name: str, attribute: str, type_name: str, value: Any, caplog: pytest.LogCaptureFixture
) -> None:
    stage, over = stage_of(name)
    spec = Sdf.AttributeSpec(Sdf.CreatePrimInLayer(over, "/It"), attribute, Sdf.ValueTypeNames.Find(type_name))
    spec.default = value
    drawn_beside(stage)
    assert attribute not in caplog.text


def calls(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            yield node.func.attr


def reads_past_the_door(source: str) -> list[str]:
    """Calls that give values of attributes, or targets, of whatever type they have."""
    past = ("Get", "GetTargets", "GetForwardedTargets", "ComputeFlattened", "GetLocalTransformation", "GetOpTransform")
    return [call for call in calls(ast.parse(source)) if call in past]


def test_all_values_are_read_by_the_reader_of_attributes() -> None:
    files = list(Path(room.__path__[0]).glob("*.py"))
    assert len(files) > 10
    for file in files:
        if file.name != "attributes.py":
            assert not reads_past_the_door(file.read_text()), file
    assert reads_past_the_door("prim.GetAttribute('radius').Get(time)") == ["Get"]
