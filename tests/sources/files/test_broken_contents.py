"""Faults in files that libraries let through, or tell in errors of their own."""

from pathlib import Path

import numpy as np
import pytest

import warpcam as wc

pytestmark = pytest.mark.filterwarnings("ignore")  # trimesh's own


def test_vertices_of_two_coordinates(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    path = tmp_path / "a.obj"
    path.write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(wc.WarpcamError, match="vertices must have three coordinates"):
        wc.load(path, device="cpu")


def test_splats_with_a_row_too_short(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
    head = "".join(f"property float {name}\n" for name in names)
    rows = " ".join(["1"] * len(names)) + "\n" + " ".join(["1"] * (len(names) - 1)) + "\n"
    path = tmp_path / "a.ply"
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex 2\n{head}end_header\n{rows}")
    with pytest.raises(wc.WarpcamError, match="must be one number for each vertex"):
        wc.load(path, device="cpu")


def test_a_stage_that_is_no_utf8(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    path = tmp_path / "a.usda"
    path.write_bytes(b'#usda 1.0\ndef Xform "a"\n{\n    \xce\xff nonsense = 1\n}\n')
    with pytest.raises(wc.WarpcamError, match=r"a\.usda: USD cannot open it"):
        wc.load(path, device="cpu")


def test_a_robot_that_names_a_file_too_long(tmp_path: Path) -> None:
    pytest.importorskip("mujoco_warp")
    pytest.importorskip("trimesh")
    path = tmp_path / "a.urdf"
    visual = f'<visual><geometry><mesh filename="{"a" * 5000}.stl"/></geometry></visual>'
    path.write_text(f'<robot name="a"><link name="b">{visual}</link></robot>')
    with pytest.raises(wc.WarpcamError, match=r"a\.urdf"):
        wc.load(path, device="cpu")


def test_a_package_with_a_damaged_table(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    from pxr import Usd, UsdUtils

    Usd.Stage.CreateNew(str(tmp_path / "a.usda")).Save()
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "a.usda"), str(tmp_path / "a.usdz"))
    data = (tmp_path / "a.usdz").read_bytes()
    (tmp_path / "b.usdz").write_bytes(data.replace(b"PK\x01\x02", b"PK\x01\x03").replace(b"#usda", b"#usdx"))
    with pytest.raises(wc.WarpcamError, match=r"b\.usdz: USD cannot open it"):
        wc.load(tmp_path / "b.usdz", device="cpu")


def test_a_device_as_a_library_of_materials(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    path = tmp_path / "a.obj"
    path.write_text("mtllib /dev/zero\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert wc.load(path, device="cpu").num_worlds == 1


def test_coefficients_that_overflow(tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    path = tmp_path / "a.yaml"
    path.write_text(
        "cam0:\n  camera_model: pinhole\n  distortion_model: equidistant\n  intrinsics: [190, 190, 254, 256]\n"
        "  distortion_coeffs: [1.0e+308, 1.0e+308, 1.0e+308, 1.0e+308]\n  resolution: [512, 510]\n"
    )
    with pytest.raises(wc.WarpcamError, match="too large"):
        wc.read_calibration(path)


def test_colors_that_are_lists(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    from warpcam.sources.common.images import ply_colors

    rows = {"red": np.array([[], [1]], object), "green": np.zeros(2), "blue": np.zeros(2)}
    with pytest.raises(wc.WarpcamError, match="must be one number in each row"):
        ply_colors(rows, 2)
