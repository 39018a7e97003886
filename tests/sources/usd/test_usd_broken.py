"""Stages that are broken: an error or a warning that says so, and nothing half-built."""

import base64
import os
import subprocess
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import fast_compile
import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Gf, Usd, UsdGeom, UsdLux
from usd_stages import above, add_mesh, add_square, image, metric

from warpcam.benchmarks import corpus

SQUARE = """def Mesh "it" {
    point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    uniform token subdivisionScheme = "none"
}"""


def written(path: Path, body: str) -> Path:
    path.write_text(f'#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n{body}\n')
    return path


BROKEN: dict[str, str] = {
    "USD cannot open it": 'def Xform "a" { garbage',
    "the stage has nothing that can be drawn": 'def Xform "a" {}',
    "faceVertexIndices has 7; allowed are 0 to 3": SQUARE.replace("0, 1, 2, 3", "0, 1, 2, 7"),
    "faceVertexIndices has -1; allowed are 0 to 3": SQUARE.replace("0, 1, 2, 3", "0, 1, 2, -1"),
    "faceVertexCounts sum up to 5, but there are 4 faceVertexIndices": SQUARE.replace("[4]", "[5]"),
    "curveVertexCounts sum up to 5, but there are 2 points": (
        'def BasisCurves "a" {\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n'
        "int[] curveVertexCounts = [5]\nfloat[] widths = [1]\n}"
    ),
    "'/a': points must be finite, got": 'def Points "a" {\npoint3f[] points = [(0, inf, 0)]\n}',
    "points must be finite, got": SQUARE.replace("(1, 1, 0)", "(1, nan, 0)"),
    "protoIndices has 2; there are 1 prototypes": 'def PointInstancer "a" { rel prototypes = [</a/b>]\n'
    "int[] protoIndices = [0, 2]\npoint3f[] positions = [(0, 0, 0), (1, 0, 0)]\n" + '\ndef Cube "b" {}\n}',
    "2 protoIndices came, with positions, orientations or scales of another number": (
        'def PointInstancer "a" { rel prototypes = [</a/b>]\n'
        "int[] protoIndices = [0, 0]\npoint3f[] positions = [(0, 0, 0)]\n" + '\ndef Cube "b" {}\n}'
    ),
    "has nothing to draw; 1 shapes came, none is visible": 'def Cube "a" {\ntoken visibility = "invisible"\n}',
}


@pytest.mark.parametrize("text", BROKEN)
def test_errors(text: str, tmp_path: Path) -> None:
    path = written(tmp_path / "it.usda", BROKEN[text])
    with pytest.raises(wc.WarpcamError) as caught:
        wc.from_usd(path, device="cpu")
    assert text in str(caught.value)


WARNINGS: dict[str, str] = {
    "is incomplete, USD left something out": (
        'def Xform "a" (references = </b>) {}\ndef Xform "b" (references = </a>) {}'
    ),
    "is of type Volume, which is not drawn: /a": 'def Volume "a" {}',
    "has no points: /a": 'def Points "a" {}',
    "has no widths, and is not drawn: /a": 'def Points "a" {\npoint3f[] points = [(0, 0, 0)]\n}',
    "has widths of another number than its interpolation needs, which are left out: /a": (
        'def Points "a" {\npoint3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]\nfloat[] widths = [0.1, 0.2]\n}'
    ),
    "has curves of too few points, which are left out: /a": (
        'def BasisCurves "a" {\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n'
        "int[] curveVertexCounts = [2]\nfloat[] widths = [1]\n}"
    ),
    "has a transform that is not finite, and is left out: /a": (
        'def Cube "a" {\ndouble3 xformOp:translate = (inf, 0, 0)\n'
        'uniform token[] xformOpOrder = ["xformOp:translate"]\n}'
    ),
    "has st of another number than its interpolation needs, which are left out: /a": SQUARE.replace("it", "a").replace(
        "int[] faceVertexCounts",
        'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "vertex")\nint[] faceVertexCounts',
    ),
    "has st whose indices are out of range, which are left out: /a": SQUARE.replace("it", "a").replace(
        "int[] faceVertexCounts",
        'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "vertex")\nint[] primvars:st:indices = [0, 0, 0, 1]\n'
        "int[] faceVertexCounts",
    ),
    "has displayColor whose indices are out of range, which are left out: /a": (
        'def Points "a" {\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\nfloat[] widths = [0.1]\n'
        'color3f[] primvars:displayColor = [(0, 0, 0), (1, 1, 1)] (interpolation = "vertex")\n'
        "int[] primvars:displayColor:indices = [0, 2]\n}"
    ),
    "is a subset of other things than faces, and is left out: /a/some": SQUARE.replace('"it"', '"a"').replace(
        "uniform token sub",
        'def GeomSubset "some" {\nuniform token elementType = "point"\nint[] indices = [0]\n'
        'uniform token familyName = "materialBind"\n}\nuniform token sub',
    ),
    "names faces that the mesh does not have, which are left out: /a/some": SQUARE.replace('"it"', '"a"').replace(
        "uniform token sub",
        'def GeomSubset "some" {\nint[] indices = [0, 1]\nuniform token familyName = "materialBind"\n}\n'
        "uniform token sub",
    ),
    "is a dome whose image is laid as mirroredBall, which is read as latlong: /a": (
        'def DomeLight "a" {\nasset inputs:texture:file = @gone.png@\ntoken inputs:texture:format = "mirroredBall"\n}'
    ),
    "is a light of type GeometryLight, which gives no light here: /a": 'def GeometryLight "a" {}',
    "is of a brightness that is not finite, and gives no light: /a": (
        'def DistantLight "a" {\nfloat inputs:exposure = 2000\n}'
    ),
    "shines, which meshes do not here: /a": SQUARE.replace('"it"', '"a" (prepend apiSchemas = ["MeshLightAPI"])'),
    "changes its faces with time, and is drawn as it was at first: /a": SQUARE.replace("it", "a").replace(
        "int[] faceVertexCounts = [4]", "int[] faceVertexCounts.timeSamples = {0: [4], 1: [4]}"
    ),
    "is moved by a skeleton, which is not followed: its points are drawn as they stand: /a": SQUARE.replace(
        '"it"', '"a" (prepend apiSchemas = ["SkelBindingAPI"])'
    ).replace("int[] faceVertexCounts", "int[] primvars:skel:jointIndices = [0, 0, 0, 0]\nint[] faceVertexCounts"),
    "has faces of less than three corners, which are left out: /a": SQUARE.replace("it", "a")
    .replace("[4]", "[4, 2]")
    .replace("0, 1, 2, 3]", "0, 1, 2, 3, 0, 1]"),
    "has no surface that is known here, and shows the shapes' display colours: /m": (
        'def Cube "a" (prepend apiSchemas = ["MaterialBindingAPI"]) {\nrel material:binding = </m>\n}\n'
        'def Material "m" {\ntoken outputs:surface.connect = </m/s.outputs:surface>\n'
        'def Shader "s" {\nuniform token info:id = "Strange"\ntoken outputs:surface\n}\n}'
    ),
}


@pytest.mark.parametrize("text", WARNINGS)
def test_warnings(text: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A scene with warnings is drawn as far as possible."""
    path = written(tmp_path / "it.usda", SQUARE + "\n" + WARNINGS[text])
    scene = wc.from_usd(path, device="cpu")
    assert "/it" in scene.shapes
    assert text in caplog.text
    assert np.isfinite(scene.bounds()).all()


@pytest.mark.parametrize(
    ("text", "arguments"),
    [
        ("from_usd: there is no file 'gone.usda'", {"path_or_stage": "gone.usda"}),
        ("path_or_stage must be a path or a pxr.Usd.Stage, got int", {"path_or_stage": 3}),
        ("num_worlds must be a whole number, at least 1, got 0", {"num_worlds": 0}),
        ("purposes must be a sequence of 'default', 'render', 'proxy', 'guide', got ['all']", {"purposes": ["all"]}),
        ('up_axis must be "Z", or None for the stage\'s own axes, got \'Y\'', {"up_axis": "Y"}),
        ("meters_per_unit must be a positive number, got 0", {"meters_per_unit": 0}),
        ("meters_per_unit must be a positive number, got True", {"meters_per_unit": True}),
        ("exposure must be a finite number up to 127 or None, got 1000", {"exposure": 1000}),
        ("textures must map names to images, got list", {"path_or_stage": __file__, "textures": ["a"]}),
        ("transparency must be True, False or None, got 1", {"path_or_stage": __file__, "transparency": 1}),
        ("semantics: must map labels to whole numbers, got 'cup': 'one'", {"semantics": {"cup": "one"}}),
        ("time must be a finite number, got 'now'", {"time": "now"}),
        ("textures: 'a': 'gone.png' cannot be read: No such file or directory", {"textures": {"a": "gone.png"}}),
        ("textures: 'a' must be a path or (height, width, 1, 3 or 4) uint8, got float64 (2, 2)",
         {"textures": {"a": np.zeros((2, 2))}}),
        ("device: 'cuda:99' came", {"device": "cuda:99"}),
    ],
)  # fmt: skip
def test_arguments(text: str, arguments: dict[str, Any]) -> None:
    stage = metric(Usd.Stage.CreateInMemory())
    UsdGeom.Cube.Define(stage, "/it")
    with pytest.raises(wc.WarpcamError) as caught:
        wc.from_usd(**{"path_or_stage": stage, "device": "cpu", **arguments})
    assert text in str(caught.value)


@pytest.mark.parametrize("unit", [0.0, -1.0, float("nan"), float("inf")])
def test_a_unit_that_is_none(unit: float) -> None:
    stage = metric(Usd.Stage.CreateInMemory(), unit=unit)
    UsdGeom.Cube.Define(stage, "/it")
    with pytest.raises(wc.WarpcamError, match=r"metersPerUnit is .*; give meters_per_unit, a positive number"):
        wc.from_usd(stage, device="cpu")
    assert wc.from_usd(stage, device="cpu", meters_per_unit=1.0).shapes == ("/it",)


def test_scales_of_nothing(device: wp.Device) -> None:
    """A flat mesh is a mesh; what has no area or no volume is left out."""
    stage = metric(Usd.Stage.CreateInMemory())
    add_square(stage, "/line")
    UsdGeom.Xformable(stage.GetPrimAtPath("/line")).AddScaleOp().Set((1, 0, 0))
    UsdGeom.Sphere.Define(stage, "/flat").AddScaleOp().Set((1, 1, 0))
    tube = [(-1, -1, 0), (1, -1, 0), (1, 1, 3), (-1, 1, 3)]
    add_mesh(stage, "/pressed", tube, [(0, 1, 2, 3)])
    UsdGeom.Xformable(stage.GetPrimAtPath("/pressed")).AddScaleOp().Set((1, 1, 0))
    scene = wc.from_usd(stage, device=device)
    assert scene.shapes == ("/pressed",)
    assert image(scene)[16, 16] == pytest.approx(3.0)


def test_a_pose_that_is_no_number_is_its_own_worlds(device: wp.Device) -> None:
    stage = metric(Usd.Stage.CreateInMemory())
    UsdGeom.Cube.Define(stage, "/it")
    scene = wc.from_usd(stage, 3, device=device)
    poses = np.tile(np.array((0, 0, 0, 1, 0, 0, 0), np.float32), (3, 1, 1))
    poses[1, 0, 3] = 0.0  # no quaternion
    scene.set_poses(["/it"], poses)
    renderer = wc.Renderer(scene, [above(5.0, 8)])
    depth = renderer.render()["above"]["depth"][..., 0]
    assert renderer.faulty.tolist() == [0, 1, 0]
    assert np.isfinite(depth[:, 4, 4].cpu().numpy()).tolist() == [True, False, True]


def test_many_lights_and_deep_trees(device: wp.Device) -> None:
    stage = metric(Usd.Stage.CreateInMemory())
    path = ""
    for depth in range(300):
        path += f"/d{depth}"
        UsdGeom.Xform.Define(stage, path)
    UsdGeom.Cube.Define(stage, path + "/cube")
    for number in range(40):
        UsdLux.DistantLight.Define(stage, f"/l{number}").CreateColorAttr(Gf.Vec3f(0.5, 1, 1))
    scene = wc.from_usd(stage, device=device)
    assert np.isfinite(image(scene, "rgb")).all()


@pytest.mark.skipif(
    not hasattr(sys, "getswitchinterval") or not Path("/proc/self/statm").exists(), reason="needs Linux"
)
def test_a_corpus_run_tells_what_became_of_each_file(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """In a process of its own, as it forks."""
    written(tmp_path / "good.usda", SQUARE)
    written(tmp_path / "empty.usda", "")
    (tmp_path / "bad.obj").write_text("f 1 2 3\n")
    command = [sys.executable, fast_compile.__file__, "-m", "warpcam.benchmarks.corpus", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "| .usda | 1 | 1 |" in done.stdout
    assert "| .obj | 1 | 0 |" in done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="it forks, and looks into /proc")
def test_a_corpus_run_sees_what_goes_wrong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gib = corpus.resident(os.getpid()) + 0.6  # a child begins with most of what this process holds

    def fails(kind: str) -> Any:
        def render(path: Path) -> str:
            if kind == "hung":
                time.sleep(30)
            if kind == "crashed (-9)":
                os.kill(os.getpid(), 9)
            if kind == "took too much memory":
                block = np.ones(int((gib + 0.5) * 2**30), np.uint8)
                time.sleep(5)
                return str(block.sum())
            raise KeyError(path)

        return render

    for kind in ("hung", "crashed (-9)", "took too much memory", "raised something else"):
        monkeypatch.setattr(corpus, "render", fails(kind))
        assert corpus.attempt(tmp_path, 0.5 if kind == "hung" else 20.0, gib).what == kind


@pytest.mark.parametrize(
    ("skinning", "moves"),
    [
        ("int[] primvars:skel:jointIndices = []\nuniform token[] skel:blendShapes = []", False),
        ("int[] primvars:skel:jointIndices.timeSamples = {1: [0, 0, 0, 0]}", True),
        ("int primvars:skel:jointIndices = 3", True),
        ('uniform token[] skel:blendShapes = ["smile"]', True),
    ],
)
def test_what_a_skeleton_moves(skinning: str, moves: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    skinned = SQUARE.replace('"it"', '"it" (prepend apiSchemas = ["SkelBindingAPI"])')
    skinned = skinned.replace("int[] faceVertexCounts", f"{skinning}\nint[] faceVertexCounts")
    wc.from_usd(written(tmp_path / "it.usda", skinned), device="cpu")
    assert ("is moved by a skeleton" in caplog.text) == moves


# A damaged binary layer, whose prim has no name.
NAMELESS = (
    "c-pO0%}*0S6o30g7Yp=5`7jz4J=KVTaM769ZA!&P#f5IQhLE_lQ<<dQU3V8k)tJV3@((catX>V?Jb2IpcTXnVgqu-AMS}qw>+CYSU67-1^Jd"
    "@YZ}!c+w{l@>D4!ckg9t7?;^Dv0{X?(DSMNPeGE{%I@bn=|<uKtc!Y7zO0{ag{Bk4(AT$C_J<rv{O;e!ENAK`w&1BAUgxINqz*ny#O4BelnZ"
    ";r|yF2z!=U&#pjR$EW*miOu|C3kp7=k`A~DUj#O`^EZa=X~2SD)&<3mKXJ-dSNI5a0}**)FQT^ifm+BGBWcTw&A93R!U%)xSF2Bm6C}xD50`"
    "CU$JFk1Is`~T*k<RLRmMfVAl*Zp;i%8Rjmd^-Kc?y%7~;Dkp)<@Y?VmrYz2X=W6jRSVS_P2*AUr5w{<7q3WJ>0O1Rh!cXbQfSl9YtJ8mG;#s"
    "uUVvgW{Wk}W8!MRbGM(PCPkj{!dh3b9Ymyao0gG<rtM(=)K3npmC16>QhQR?R!emQ{Ps@*9Ss4dKvnzpuI-b4*e4d4XfuW~kZh**vfrg$C&_"
    "_KAPOEJ+^@ON9`mpc8J3Fp>a4gu$@nSWZiwoiGxXDz5zjSx*5&Rz`}5j{T(wqX~E|Laf)-m)*F-uDn8gT>U%o9dY&HNf;fdFB1I)!RP8BSb{"
    "Us8@Gy+kf0xQ)-T|w<6(r1B2OxrJh}CzuqCj+1mUM3ZbTXpc0K+r&VG$_eChif4h)?`Js!$C2V^ouN^W&*$9-(~%#>6wA8M@)uC&;w=lKL~e"
    "5}Pd&mRx3+w(8Ec#MO`Mm*yOr+4#YXarsm_;#$b2z)fu`W@<k_H<3;+8w@3FEK{nIb|w4G2RaNNdFk#Kwrvcu8sxr*Qo#fE`LVxLY~vHx=3|"
    "7rCbiA!z%R`sGgHE>7f5S{VQat{ugUyy1M"
)


def test_a_prim_without_a_valid_name(tmp_path: Path) -> None:
    """USD ends the process that reads what such a layer refers to."""
    path = tmp_path / "it.usdc"
    path.write_bytes(zlib.decompress(base64.b85decode(NAMELESS)))
    with pytest.raises(wc.WarpcamError, match=r"it\.usdc: the file is damaged: a prim in it has no valid name"):
        wc.from_usd(path, device="cpu")
