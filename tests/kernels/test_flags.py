"""Flags of Python and enums of C++ have the same names and values."""

import re
from enum import IntFlag
from pathlib import Path

import pytest

import warpcam.kernels
from warpcam.kernels.flags import GeometryFlag, ImageFlag, Lens, SceneFlag, ShadingFlag, SplatFlag, TraceFlag

NATIVE = Path(warpcam.kernels.__file__).parent / "native"


def enum_of(header: str, name: str) -> dict[str, int]:
    """The members of an enum of C++ by name."""
    found = re.search(rf"enum {name}\s*{{(.*?)}}", (NATIVE / header).read_text(), re.DOTALL)
    assert found, f"{header} has no enum {name}"
    members: dict[str, int] = {}
    following = 0
    for part in re.sub(r"//[^\n]*", "", found[1]).split(","):
        if part.strip():
            key, _, value = (each.strip() for each in part.partition("="))
            factors = [int(each) for each in value.split("<<")] if value else [following]
            members[key] = factors[0] << factors[1] if len(factors) > 1 else factors[0]
            following = members[key] + 1
    return members


def members(flags: type[IntFlag], prefix: str = "") -> dict[str, int]:
    return {prefix + name: int(flag) for name, flag in flags.__members__.items()}


@pytest.mark.parametrize(
    ("flags", "header", "name"),
    [
        (GeometryFlag, "shapes/shape_types.h", "ShapeType"),
        (SceneFlag, "camera/shape_record.h", "SceneFeature"),
    ],
)
def test_shape_types_and_features_are_bits(flags: type[IntFlag], header: str, name: str) -> None:
    native = enum_of(header, name)
    assert members(flags) == {name: 1 << bit for name, bit in native.items()}


def test_lenses_are_alike() -> None:
    assert {lens.name: lens.value for lens in Lens} == enum_of("camera/shape_record.h", "Lens")


@pytest.mark.parametrize(
    ("flags", "prefix", "enums"),
    [
        (TraceFlag, "", [("traversal/trace_outputs.h", "Output"), ("flow/visibility_history.h", "FlowOutput")]),
        (ImageFlag, "", [("shading/appearance.h", "ImageBit")]),
        (
            ShadingFlag,
            "",
            [
                ("shading/appearance.h", "ShadingFlag"),
                ("shading/appearance.h", "LayerFact"),
                ("shading/world_overrides.h", "OverrideFact"),
                ("shading/tone_mapping.h", "ToneFlag"),
                ("shading/environment_map.h", "EnvironmentFlag"),
                ("shading/light_visibility.h", "VisibilityFlag"),
            ],
        ),
        (SplatFlag, "SPLAT_", [("splats/gaussian_blend.h", "SplatOutput")]),
    ],
)
def test_flags_are_the_enums(flags: type[IntFlag], prefix: str, enums: list[tuple[str, str]]) -> None:
    native: dict[str, int] = {}
    for header, name in enums:
        native |= enum_of(header, name)
    assert members(flags, prefix) == native
    assert len(set(native.values())) == len(native)
