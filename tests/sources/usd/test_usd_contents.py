"""Wrong contents of the right type, targets of another kind, and inputs of shaders: drawn, or told by name."""

from typing import Any

import pytest

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd

FINE = 'def Sphere "Fine" {}\n'
QUAD = """point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
int[] faceVertexCounts = [4]
int[] faceVertexIndices = [0, 1, 2, 3]"""
BOUND = 'def Sphere "It" (prepend apiSchemas = ["MaterialBindingAPI"])'
INSTANCER = 'def PointInstancer "It" {\nint[] protoIndices = [0]\npoint3f[] positions = [(0, 0, 0)]'


def stage_of(body: str) -> Usd.Stage:
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().ImportFromString(f'#usda 1.0\n(\nmetersPerUnit = 1\nupAxis = "Z"\n)\n{FINE}{body}\n')
    return stage


WRONG: dict[str, str] = {
    "has radius of -1, and 0 is taken: /It": 'def Sphere "It" {\ndouble radius = -1\n}',
    "has inputs:radius of -1, and 0 is taken: /It": 'def SphereLight "It" {\nfloat inputs:radius = -1\n}',
    "has inputs:intensity of -2, and 0 is taken: /It": 'def DomeLight "It" {\nfloat inputs:intensity = -2\n}',
    "has inputs:shaping:cone:angle of 270, and 180 is taken: /It": (
        'def SphereLight "It" {\nfloat inputs:shaping:cone:angle = 270\n}'
    ),
    "has inputs:colorTemperature that is not finite, and its default, 6500.0, is taken: /It": (
        'def SphereLight "It" {\nbool inputs:enableColorTemperature = true\nfloat inputs:colorTemperature = nan\n}'
    ),
    "has an empty clippingRange, which is left out: /It": 'def Camera "It" {\nfloat2 clippingRange = (3, 1)\n}',
    "has a focalLength that is not positive, and makes no image: /It": 'def Camera "It" {\nfloat focalLength = -1\n}',
    "has a horizontalAperture that is not positive, and makes no image: /It": (
        'def Camera "It" {\nfloat horizontalAperture = 0\n}'
    ),
    "has displayColor that is not finite, which is left out: /It": (
        'def Sphere "It" {\ncolor3f[] primvars:displayColor = [(nan, 1, 1)]\n}'
    ),
    "has displayColor of another number than its interpolation needs, which are left out: /It": (
        f'def Mesh "It" {{\n{QUAD}\ncolor3f[] primvars:displayColor = [(1, 1, 1)] (interpolation = "strange")\n}}'
    ),
    "has normals of another number than its interpolation needs, which are left out: /It": (
        f'def Mesh "It" {{\n{QUAD}\nnormal3f[] normals = [(0, 0, 1), (0, 0, 1)]\n}}'
    ),
    "is a mesh without faces: /It": 'def Mesh "It" {\npoint3f[] points = [(0, 0, 0)]\nint[] faceVertexCounts = [0]\n}',
    "has widths that are not finite, which are left out: /It": (
        'def Points "It" {\npoint3f[] points = [(0, 0, 0)]\nfloat[] widths = [nan]\n}'
    ),
    "has widths that are negative, which are not drawn: /It": (
        'def Points "It" {\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\nfloat[] widths = [-1, 1]\n}'
    ),
    "has ids of another number than its instances, which are all shown: /It": (
        f"{INSTANCER}\nint64[] ids = [5, 6]\nint64[] invisibleIds = [5]\nrel prototypes = </Fine>\n}}"
    ),
    "has instances whose poses are not finite, which are left out: /It": (
        f"{INSTANCER.replace('(0, 0, 0)', '(nan, 0, 0)')}\nrel prototypes = </Fine>\n}}"
    ),
    "has an xformOpOrder with xformOp:gone, which is no transform of it, and is left out: /It": (
        'def Sphere "It" {\nuniform token[] xformOpOrder = ["xformOp:gone"]\n}'
    ),
    "has prototypes that is no relationship, which is left out: /It": f"{INSTANCER}\nfloat prototypes = 3\n}}",
    "is a prototype that does not exist: /Fine.radius": f"{INSTANCER}\nrel prototypes = </Fine.radius>\n}}",
    "has material:binding that is no relationship, and shows display colours: /It": (
        f"{BOUND} {{\nfloat material:binding = 3\n}}"
    ),
    "has material:binding to /Fine, which is no material, and shows display colours: /It": (
        f"{BOUND} {{\nrel material:binding = </Fine>\n}}"
    ),
    "has material:binding to /gone, which is no material, and shows display colours: /It": (
        f"{BOUND} {{\nrel material:binding = </gone>\n}}"
    ),
    "has material:binding to several prims, and shows display colours: /It": (
        f"{BOUND} {{\nrel material:binding = [</Fine>, </gone>]\n}}"
    ),
    "has material:binding to /Fine, which is no material, and shows display colours: /Group": (
        'def Xform "Group" (prepend apiSchemas = ["MaterialBindingAPI"]) {\nrel material:binding = </Fine>\n'
        'def Sphere "It" {}\n}'
    ),
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_contents_are_told(text: str, caplog: pytest.LogCaptureFixture) -> None:
    assert "/Fine" in wc.from_usd(stage_of(WRONG[text]), device="cpu").shapes
    assert text in caplog.text


def test_a_size_that_is_negative_at_many_times_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    scene = wc.from_usd(stage_of('def Sphere "It" {\ndouble radius.timeSamples = {0: 1, 8: -7}\n}'), device="cpu")
    for time in range(9):
        scene.set_time(time)
    assert caplog.text.count("has radius of ") == 1


def test_transforms_keep_the_operations_that_can_be_used(caplog: pytest.LogCaptureFixture) -> None:
    stage = stage_of(
        'def Sphere "It" {\ndouble radius = 1\ndouble3 xformOp:translate = (0, 0, 5)\ntoken xformOp:rotateX = "left"\n'
        "double3 xformOp:scale = (2, 2, 2)\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX", "xformOp:scale"]\n}'
    )
    high = wc.from_usd(stage, device="cpu").bounds()[1]
    assert high[2] == pytest.approx(7.0)
    assert "has xformOp:rotateX of type token that USD cannot apply, which is left out: /It" in caplog.text


LOOK = """def Mesh "It" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
{quad}
texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
rel material:binding = </Look>
}}
def Material "Look" {{
token outputs:surface.connect = </Look/surface.outputs:surface>
token outputs:mdl:surface.connect = </Look/mdl.outputs:out>
def Shader "surface" {{
uniform token info:id = "{identifier}"
color3f inputs:diffuseColor.connect = </Look/image.outputs:rgb>
token outputs:surface
}}
def Shader "image" {{
uniform token info:id = "UsdUVTexture"
float2 inputs:st.connect = </Look/turn.outputs:result>
float3 outputs:rgb
}}
def Shader "turn" {{
uniform token info:id = "UsdTransform2d"
float2 inputs:in.connect = </Look/uv.outputs:result>
float2 outputs:result
}}
def Shader "uv" {{
uniform token info:id = "UsdPrimvarReader_float2"
float2 outputs:result
}}
def Shader "mdl" {{
uniform token info:implementationSource = "sourceAsset"
uniform asset info:mdl:sourceAsset = @OmniPBR.mdl@
bool inputs:enable_opacity = true
token outputs:out
}}
}}"""
NUMBER, COLOR, PAIR, FOUR, FLAG, NAME, FILE = "float", "color3f", "float2", "float4", "bool", "token", "asset"
INPUTS = {
    "surface": {
        **dict.fromkeys(("opacity", "roughness", "metallic", "occlusion", "ior", "opacityThreshold"), NUMBER),
        **dict.fromkeys(("emissiveColor", "normal"), COLOR),
    },
    "image": {
        **{"file": FILE, "wrapS": NAME, "wrapT": NAME, "sourceColorSpace": NAME},
        **dict.fromkeys(("scale", "bias", "fallback"), FOUR),
    },
    "turn": {"rotation": NUMBER, "scale": PAIR, "translation": PAIR},
    "uv": {"varname": NAME},
    "mdl": {
        **dict.fromkeys(("diffuse_color_constant", "emissive_color", "diffuse_tint"), COLOR),
        **dict.fromkeys(("opacity_constant", "reflection_roughness_constant", "metallic_constant"), NUMBER),
        "opacity_threshold": NUMBER,
        **dict.fromkeys(("enable_emission", "enable_opacity", "enable_opacity_texture"), FLAG),
        **dict.fromkeys(("diffuse_texture", "normalmap_texture", "opacity_texture", "ORM_texture"), FILE),
        **dict.fromkeys(("texture_scale", "texture_translate"), PAIR),
    },
}  # fmt: skip
VALUES: dict[str, Any] = {
    "float": 0.5,
    "float2": (0.5, 0.5),
    "float3": (0.5, 0.5, 0.5),
    "float4": (0.5, 0.5, 0.5, 0.5),
    "bool": True,
    "token": "strange",
    "float[]": [0.5],
    "matrix4d": Gf.Matrix4d(1.0),
}


@pytest.mark.parametrize(("shader", "name"), [(shader, name) for shader, names in INPUTS.items() for name in names])
def test_inputs_of_another_type(shader: str, name: str, caplog: pytest.LogCaptureFixture) -> None:
    own = {COLOR: "float3"}.get(INPUTS[shader][name], INPUTS[shader][name])
    for other, value in VALUES.items():
        if other == own and not (own == NAME and name.startswith(("wrap", "source"))):
            continue
        stage = stage_of(LOOK.format(quad=QUAD, identifier="Unknown" if shader == "mdl" else "UsdPreviewSurface"))
        spec = Sdf.CreatePrimInLayer(stage.GetRootLayer(), f"/Look/{shader}")
        for old in [old for old in spec.attributes if old.name == f"inputs:{name}"]:
            spec.RemoveProperty(old)
        Sdf.AttributeSpec(spec, f"inputs:{name}", Sdf.ValueTypeNames.Find(other)).default = value
        caplog.clear()
        assert set(wc.from_usd(stage, device="cpu").shapes) == {"/Fine", "/It"}
        said = [m.getMessage() for m in caplog.records if f"has {name} " in m.getMessage()]
        assert len(said) == 1, (other, caplog.text)
        assert said[0].endswith(f", and is left out: /Look/{shader}")


def test_a_connection_to_nothing_is_told(caplog: pytest.LogCaptureFixture) -> None:
    look = LOOK.format(quad=QUAD, identifier="UsdPreviewSurface").replace(
        "</Look/image.outputs:rgb>", "</gone.outputs:rgb>"
    )
    assert "/It" in wc.from_usd(stage_of(look), device="cpu").shapes
    assert "has diffuseColor connected to /gone.outputs:rgb, which is not there, and is left out: /Look" in caplog.text
