"""Stages that cannot be opened or show nothing: each has its sentence, with the way out."""

import zipfile
from pathlib import Path

import pytest

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Usd, UsdGeom
from usd_stages import metric

HEAD = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n'


def refusal(stage: Usd.Stage | Path, **arguments: object) -> str:
    with pytest.raises(wc.WarpcamError) as caught:
        wc.from_usd(stage, device="cpu", **arguments)
    return str(caught.value)


def binary(path: Path) -> bytes:
    stage = metric(Usd.Stage.CreateNew(str(path)))
    for number in range(50):
        UsdGeom.Cube.Define(stage, f"/cube{number}")
    stage.Save()
    return path.read_bytes()


@pytest.mark.parametrize(
    ("name", "data", "text"),
    [
        ("a.usda", b"", "the file is empty; write or download it again"),
        ("a.usdc", b"", "the file is empty; write or download it again"),
        ("a.usdz", b"", "the file is empty; write or download it again"),
        ("a.usd", b"version https://git-lfs.github.com/spec/v1\n", "a Git LFS pointer in the place of the file; run"),
        ("a.usd", b"\x89PNG\r\n\x1a\n", "it is no USD file: it begins with b'\\x89PNG"),
        ("a.obj", b"v 0 0 0\n", "it is no USD file: it begins with b'v 0 0 0"),
        ("a.usdc", b'#usda 1.0\ndef Cube "a" {}\n', "a text file of USD with another ending; rename it to"),
        ("a.usda", b'#usda 1.0\ndef Xform "a" {\n', "a.usda:3:1: Expected } at '' in </a>; mend that place, or write"),
        ("a.usdz", b"PK\x03\x04 and no more", "the package is truncated or damaged; write or download it again"),
    ],
)  # fmt: skip
def test_files_that_are_no_usd(name: str, data: bytes, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data)
    said = refusal(tmp_path / name)
    assert said.startswith(f"{tmp_path / name}: USD cannot open it: ")
    assert text in said
    assert "pxrInternal" not in said


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5, 0.99])
def test_binary_files_that_are_truncated(share: float, tmp_path: Path) -> None:
    whole = binary(tmp_path / "whole.usdc")
    part = whole[: int(share * len(whole))]
    (tmp_path / "part.usdc").write_bytes(part)
    said = refusal(tmp_path / "part.usdc")
    assert "the file is truncated" in said
    assert f"{len(part)} bytes are there; write or download it again" in said


def test_a_binary_file_with_the_ending_of_text(tmp_path: Path) -> None:
    (tmp_path / "a.usda").write_bytes(binary(tmp_path / "whole.usdc"))
    assert "a binary file of USD with another ending; rename it to .usdc or .usd" in refusal(tmp_path / "a.usda")


def test_a_package_without_a_stage(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.usdz", "w") as package:
        package.writestr("read.me", "hello")
    assert "its first file must be .usd, .usda or .usdc, and is 'read.me'" in refusal(tmp_path / "a.usdz")


def test_a_folder(tmp_path: Path) -> None:
    assert "is a folder; give a .usd, .usda, .usdc or .usdz file" in refusal(tmp_path)


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ("", "the stage is empty, it has no prims; write geometry into it"),
        ('def Xform "a" {\ndef Camera "b" {}\n}', "it has 1 Xform, 1 Camera; drawn are meshes, solids"),
        ('def Mesh "a" {}', "nothing that can be drawn: it has 1 Mesh; warnings say what is left out"),
        ('def Xform "a" (payload = @gone.usda@) {}', "it has 1 Xform; warnings say what is left out"),
        ('def Cube "a" {\nuniform token purpose = "guide"\n}', "/a; give purposes=('default', 'render', 'guide')"),
        ('def Cube "a" (active = false) {}', "prims are inactive, /a; call prim.SetActive(True)"),
        ('class Cube "a" {}\nover "b" {}', "only classes and overs, which are for other stages; give the stage"),
        ('def Xform "a" {\ntoken visibility = "invisible"\ndef Cube "b" {}\ndef Cube "c" {}\n}',
         "2 shapes came, none is visible: /a is invisible; make it visible; scene.set_visible hides it again"),
        ('def Cube "a" {\ndouble size = 0\n}', "visible: each is hidden, has no size, or a pose that is not finite"),
    ],
)  # fmt: skip
def test_stages_that_show_nothing(body: str, text: str, tmp_path: Path) -> None:
    (tmp_path / "a.usda").write_text(f"{HEAD}{body}\n")
    assert text in refusal(tmp_path / "a.usda")


def test_payloads_that_are_not_loaded(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "part.usda").write_text(f'{HEAD}def Xform "p" {{\ndef Cube "c" {{}}\n}}\n')
    parts = "".join(f'def Xform "{name}" (payload = @./part.usda@</p>) {{}}\n' for name in "abcd")
    (tmp_path / "all.usda").write_text(HEAD + parts)
    stage = Usd.Stage.Open(str(tmp_path / "all.usda"), Usd.Stage.LoadNone)
    said = refusal(stage)
    assert "payloads are not loaded, /a, /b, /c and 1 more; call stage.Load(), or open the stage without" in said
    stage.Load("/b")
    caplog.clear()
    assert wc.from_usd(stage, device="cpu").shapes == ("/b/c",)
    assert "has payloads that are not loaded, and are not drawn; stage.Load() loads them: /a, /c, /d" in caplog.text
    stage.Load()
    caplog.clear()
    assert len(wc.from_usd(stage, device="cpu").shapes) == 4
    assert "payloads" not in caplog.text


def test_a_population_mask_without_prims(tmp_path: Path) -> None:
    (tmp_path / "a.usda").write_text(f'{HEAD}def Cube "a" {{}}\n')
    stage = Usd.Stage.OpenMasked(str(tmp_path / "a.usda"), Usd.StagePopulationMask(["/gone"]))
    assert "the stage is empty, it has no prims; open it without a population mask" in refusal(stage)


def test_an_up_axis_that_is_none(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "a.usda").write_text(f'{HEAD.replace(chr(34) + "Z", chr(34) + "X")}def Cube "a" {{}}\n')
    assert wc.from_usd(tmp_path / "a.usda", device="cpu").shapes == ("/a",)
    assert "has upAxis 'X', known are Y and Z, and keeps its own axes" in caplog.text
