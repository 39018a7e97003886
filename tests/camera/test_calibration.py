"""Calibrations from files of Kalibr, ROS and OpenCV, and the errors of files that cannot be used."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import torch

import warpcam as wc

pytest.importorskip("yaml")

CAMCHAIN = """
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0009, -1.2e-04]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.013, 0.05, -0.045, 1e-2]
  distortion_model: equidistant
  intrinsics: [190.9, 190.8, 254.9, 256.9]
  resolution: [512, 510]
omni:
  {camera_model: omni, intrinsics: [0.8, 833.0, 830.3, 373.8, 253.7], distortion_model: radtan,
   distortion_coeffs: [-0.33, 0.13, 0.0006, 0.0006], resolution: [752, 480]}
ds:
  {camera_model: ds, intrinsics: [-0.2, 0.6, 205.0, 206.0, 281.0, 183.0], distortion_model: none,
   distortion_coeffs: [], resolution: [640, 400]}
eucm: {camera_model: eucm, intrinsics: [0.6, 1.1, 205.0, 206.0, 281.0, 183.0], resolution: [640, 400]}
ideal:
  {camera_model: pinhole, intrinsics: [300, 301, 320, 240], distortion_model: none, resolution: [640, 480]}
"""
CAMERA_INFO = """image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [430.2, 0, 306.7, 0, 430.5, 227.2, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.337, 0.111, -0.0006, -0.0005, 0.0]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [371, 0, 300, 0, 0, 406, 220, 0, 0, 0, 1, 0]}
"""
MESSAGE = """header: {frame_id: camera}
height: 480
width: 640
distortion_model: equidistant
d: [0.01, -0.002, 0.0005, 0.0]
k: [310.0, 0.0, 320.0, 0.0, 311.0, 240.0, 0.0, 0.0, 1.0]
binning_x: 0
binning_y: 1
roi: {x_offset: 0, y_offset: 0, height: 480, width: 640, do_rectify: false}
---
height: 1
"""
OPENCV = """%YAML:1.0
---
calibration_time: "Fri 27 Nov 2026"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 410., 0., 320., 0., 405., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ -1.0e-01, 1.0000000000000001e-05, 0., 2.e-03 ]
"""
OPENCV_5 = """%YAML 1.2
---
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 410., 0., 320., 0., 405., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-nd-matrix
   sizes: [ 5 ]
   dt: d
   data: [ -0.1, 0.02, 0., 2.0e-03, 0.01 ]
image_width: 640
image_height: 480
board: !!opencv-new-kind [ 1, 2 ]
"""
PLACES = np.random.default_rng(4).uniform((-0.5, -0.4, -2.0), (0.5, 0.4, -1.0), (50, 3))


def read(folder: Path, text: str, name: str = "calibration.yaml", **options: Any) -> wc.Calibration:
    path = folder / name
    path.write_text(text)
    return wc.read_calibration(path, **options)


def numbers_of(lens: wc.Lens) -> Mapping[str, Any]:
    return {name: value for name, value in vars(lens).items() if value is not None}


def pixels_of(lens: wc.Lens) -> np.ndarray:
    return lens.project(torch.tensor(PLACES)).numpy()


def test_rows_as_opencv_5_writes_them(tmp_path: Path) -> None:
    found = read(tmp_path, OPENCV_5)
    assert (found.width, found.height) == (640, 480)
    expected = wc.Distorted(410.0, 405.0, 320.5, 240.5, (-0.1, 0.02, 0.0, 0.002, 0.01))
    np.testing.assert_allclose(pixels_of(found.lens), pixels_of(expected))


@pytest.mark.parametrize(
    ("camera", "size", "lens"),
    [
        ("cam0", (752, 480), wc.Distorted(458.6, 457.3, 367.7, 248.9, (-0.28, 0.07, 0.0009, -0.00012))),
        ("cam1", (512, 510), wc.Fisheye(fx=190.9, fy=190.8, cx=255.4, cy=257.4, k=(-0.013, 0.05, -0.045, 0.01))),
        (1, (512, 510), wc.Fisheye(fx=190.9, fy=190.8, cx=255.4, cy=257.4, k=(-0.013, 0.05, -0.045, 0.01))),
        (
            "omni",
            (752, 480),
            wc.Omnidirectional(0.8, 833.0, 830.3, 374.3, 254.2, coefficients=(-0.33, 0.13, 0.0006, 0.0006)),
        ),
        ("ds", (640, 400), wc.DoubleSphere(-0.2, 0.6, 205.0, 206.0, 281.5, 183.5)),
        ("eucm", (640, 400), wc.ExtendedUnified(0.6, 1.1, 205.0, 206.0, 281.5, 183.5)),
        ("ideal", (640, 480), wc.Pinhole(fx=300.0, fy=301.0, cx=320.5, cy=240.5)),
    ],
)
def test_kalibrs_chains(tmp_path: Path, camera: str | int, size: tuple[int, int], lens: wc.Lens) -> None:
    found = read(tmp_path, CAMCHAIN, camera=camera)
    assert (found.width, found.height) == size and found.name == ("cam1" if camera == 1 else camera)
    assert type(found.lens) is type(lens)
    np.testing.assert_allclose(pixels_of(found.lens), pixels_of(lens), atol=1e-9)


def test_a_chain_of_one_and_a_camera_without_a_name(tmp_path: Path) -> None:
    chain = CAMCHAIN.split("cam1:")[0]
    for text, name in ((chain, "cam0"), (chain.replace("cam0:", "").replace("\n  ", "\n"), None)):
        found = read(tmp_path, text)
        assert found.name == name and isinstance(found.lens, wc.Distorted)


def test_ros_files(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    found = read(tmp_path, CAMERA_INFO)
    assert (found.name, found.width, found.height) == ("narrow_stereo", 640, 480)
    matrix = np.array([[430.2, 0.0, 306.7], [0.0, 430.5, 227.2], [0.0, 0.0, 1.0]])
    turned = PLACES * (1.0, -1.0, -1.0)
    coefficients = np.array([-0.337, 0.111, -0.0006, -0.0005, 0.0])
    theirs = cv2.projectPoints(turned, np.zeros(3), np.zeros(3), matrix, coefficients)[0][:, 0]
    np.testing.assert_allclose(pixels_of(found.lens), theirs + 0.5, atol=1e-9)
    assert read(tmp_path, CAMERA_INFO, camera="narrow_stereo").name == "narrow_stereo"
    ideal = read(tmp_path, CAMERA_INFO.replace("-0.337, 0.111, -0.0006, -0.0005", "0, 0, 0, 0"))
    assert isinstance(ideal.lens, wc.Pinhole)
    rational = CAMERA_INFO.replace("plumb_bob", "rational_polynomial").replace(
        "0.0]\nrect", "0.0, 0.1, 0.2, 0.3]\nrect"
    )
    assert numbers_of(read(tmp_path, rational).lens)["coefficients"][5:] == [0.1, 0.2, 0.3]
    message = read(tmp_path, MESSAGE)
    assert isinstance(message.lens, wc.Fisheye) and numbers_of(message.lens)["k"] == [0.01, -0.002, 0.0005, 0.0]
    assert (message.lens.cx, message.width, message.name) == (320.5, 640, None)
    none = MESSAGE.replace("equidistant", '""').replace("d: [0.01, -0.002, 0.0005, 0.0]", "d: []")
    assert isinstance(read(tmp_path, none).lens, wc.Pinhole)


def test_opencvs_files(tmp_path: Path) -> None:
    found = read(tmp_path, OPENCV)
    assert isinstance(found.lens, wc.Distorted) and found.lens.coefficients == [-0.1, 1e-5, 0.0, 0.002]
    assert isinstance(read(tmp_path, OPENCV, fisheye=True).lens, wc.Fisheye)
    assert isinstance(read(tmp_path, OPENCV + "fisheye_model: 1\n").lens, wc.Fisheye)
    assert isinstance(read(tmp_path, OPENCV + "fisheye_model: 1\n", fisheye=False).lens, wc.Distorted)
    assert isinstance(read(tmp_path, OPENCV + "fisheye_model: 0\n", camera=0).lens, wc.Distorted)
    sized = OPENCV.replace("image_width: 640\nimage_height: 480", "image_size: [320, 200]")
    assert (read(tmp_path, sized).width, read(tmp_path, sized).height) == (320, 200)
    plain = "K: [[410, 0, 320], [0, 405, 240], [0, 0, 1]]\nD: [0.1, 0, 0, 0, 0]\nwidth: 640\nheight: 480\n"
    assert read(tmp_path, plain).lens.fx == 410.0


@pytest.mark.parametrize("suffix", ["yaml", "yml", "json"])
@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_what_opencv_writes(tmp_path: Path, suffix: str, count: int) -> None:
    cv2 = pytest.importorskip("cv2")
    matrix = np.array([[410.25, 0.0, 320.5], [0.0, 405.0, 240.0], [0.0, 0.0, 1.0]])
    coefficients = np.random.default_rng(count).normal(size=(count, 1)) * 1e-5
    path = tmp_path / f"written.{suffix}"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 640), ("image_height", 480), ("camera_matrix", matrix)):
        file.write(name, value)
    file.write("distortion_coefficients", coefficients)
    file.release()
    lens = wc.read_calibration(str(path)).lens
    assert lens.coefficients == coefficients[:, 0].tolist() and (lens.fx, lens.cx) == (410.25, 321.0)


def test_a_calibrated_camera_is_drawn(tmp_path: Path) -> None:
    found = read(tmp_path, CAMERA_INFO.replace("640", "64").replace("480", "48"))
    mjm = scenes.compile_xml('<geom size=".5" pos="0 0 -2"/>')
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device="cpu")
    camera = scenes.own_camera(width=found.width, height=found.height, lens=found.lens, outputs=("distance",))
    assert scenes.look(scene, camera)["distance"].shape == (1, 48, 64)


def changed(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


BAD: dict[str, tuple[str, dict[str, Any]]] = {
    "camera was not given; cameras are 'cam0', 'cam1', 'omni', 'ds', 'eucm', 'ideal'": (CAMCHAIN, {}),
    "camera 'cam7' is not there; cameras are 'cam0'": (CAMCHAIN, {"camera": "cam7"}),
    "camera 6 is not there; cameras are": (CAMCHAIN, {"camera": 6}),
    "camera -1 is not there; cameras are": (CAMCHAIN, {"camera": -1}),
    "fisheye is for OpenCV's files, got True; this one is Kalibr's": (CAMCHAIN, {"camera": 0, "fisheye": True}),
    "cam0: camera_model must be one of 'pinhole', 'omni', 'ds', 'eucm', got 'mirror'": (
        changed(CAMCHAIN, "camera_model: pinhole", "camera_model: mirror"),
        {"camera": 0},
    ),
    "cam0: distortion_model must be one of 'none', 'radtan', 'equidistant', got 'fov'": (
        changed(CAMCHAIN, "radtan", "fov"),
        {"camera": 0},
    ),
    "ds: distortion_model must be one of 'none', got 'radtan'": (
        changed(CAMCHAIN, "distortion_model: none", "distortion_model: radtan"),
        {"camera": "ds"},
    ),
    "cam0: distortion_model is missing; keys are cam_overlaps, camera_model, distortion_coeffs, intrinsics": (
        changed(CAMCHAIN, "  distortion_model: radtan\n", ""),
        {"camera": 0},
    ),
    "cam0: intrinsics must have 4 numbers, got 3": (changed(CAMCHAIN, "[458.6, ", "["), {"camera": 0}),
    "cam0: intrinsics must be of finite numbers, got 'wide'": (changed(CAMCHAIN, "458.6", "wide"), {"camera": 0}),
    "cam0: intrinsics must be of finite numbers, got nan": (changed(CAMCHAIN, "458.6", ".nan"), {"camera": 0}),
    "cam0: intrinsics must be of finite numbers, got True": (changed(CAMCHAIN, "458.6", "true"), {"camera": 0}),
    "cam0: intrinsics: focal lengths must be positive, got -458.6 and 457.3": (
        changed(CAMCHAIN, "458.6", "-458.6"),
        {"camera": 0},
    ),
    "cam0: resolution must be [width, height], got [752]": (changed(CAMCHAIN, "[752, 480]", "[752]"), {"camera": 0}),
    "cam0: resolution must be a positive whole number of pixels, got 752.5": (
        changed(CAMCHAIN, "752", "752.5"),
        {"camera": 0},
    ),
    "ds: alpha must be in [0, 1], got 1.6": (changed(CAMCHAIN, "-0.2, 0.6", "-0.2, 1.6"), {"camera": "ds"}),
    "camera 'left' is not there; the file has one camera, 'narrow_stereo'": (CAMERA_INFO, {"camera": "left"}),
    "camera 1 is not there; the file has one camera without a name": (OPENCV, {"camera": 1}),
    "fisheye came, False, and the file has its own distortion_model": (CAMERA_INFO, {"fisheye": False}),
    "model must be one of 'plumb_bob', 'rational_polynomial', 'equidistant', 'fisheye', 'none', '', got 'tsai'": (
        changed(CAMERA_INFO, "plumb_bob", "tsai"),
        {},
    ),
    "distortion_coefficients: data must have 4 or 5 numbers, got 6": (
        changed(CAMERA_INFO, "[-0.337", "[0, -0.337"),
        {},
    ),
    "distortion_coefficients: data must have 8 or 12 or 14 numbers, got 5": (
        changed(CAMERA_INFO, "plumb_bob", "rational_polynomial"),
        {},
    ),
    "distortion_model 'none' has no coefficients, got [-0.337": (changed(CAMERA_INFO, "plumb_bob", "none"), {}),
    "camera_matrix: data must have 9 numbers, got 8": (changed(CAMERA_INFO, "[430.2, 0, ", "[430.2, "), {}),
    "camera_matrix must be [fx, 0, cx, 0, fy, cy, 0, 0, 1], got [430.2, 1.0, 306.7": (
        changed(CAMERA_INFO, "430.2, 0,", "430.2, 1,"),
        {},
    ),
    "camera_matrix: focal lengths must be positive, got 0 and 430.5": (changed(CAMERA_INFO, "[430.2", "[0"), {}),
    "camera_matrix: data is missing; keys are rows, cols, values": (
        changed(CAMERA_INFO, "  data: [430", "  values: [430"),
        {},
    ),
    "image_width or image_Width or width is missing; keys are image_height, camera_name": (
        changed(CAMERA_INFO, "image_width: 640\n", ""),
        {},
    ),
    "image_height must be a positive whole number of pixels, got -480": (changed(CAMERA_INFO, "480", "-480"), {}),
    "camera_name must be a text, got [1, 2]": (changed(CAMERA_INFO, "narrow_stereo", "[1, 2]"), {}),
    "binning_y must be 0 or 1, got 2": (changed(MESSAGE, "binning_y: 1", "binning_y: 2"), {}),
    "roi: x_offset must be that of the whole image, 0, or 0, got 8": (
        changed(MESSAGE, "x_offset: 0", "x_offset: 8"),
        {},
    ),
    "roi: width must be that of the whole image, 640, or 0, got 320": (
        changed(MESSAGE, "width: 640, do", "width: 320, do"),
        {},
    ),
    "roi must be a mapping, got 5": (changed(MESSAGE, "roi: {x_offset: 0", "roi: 5\nother: {x_offset: 0"), {}),
    "fisheye_model must be 0 or 1, got 'yes'": (OPENCV + "fisheye_model: 'yes'\n", {}),
    "distortion_coefficients: data must have 4 numbers, got 5": (
        changed(OPENCV, "[ -1.0e-01", "[ 0, -1.0e-01"),
        {"fisheye": True},
    ),
    "camera_matrix or cameraMatrix or Camera_Matrix or K or k is missing; keys are none": ("{}", {}),
    "must be a mapping of keys to values, got list": ("[1, 2]", {}),
    "must be a mapping of keys to values, got NoneType": ("", {}),
    "is neither YAML nor JSON: while parsing a flow sequence": ("cam0: [1, 2", {}),
    "is neither YAML nor JSON: Expecting": ('{"cam0": ', {}),
    "is neither YAML nor JSON: maximum recursion": ("[" * 5000, {}),
    "is XML; allowed are YAML and JSON": ("<?xml version='1.0'?><opencv_storage/>", {}),
    "could not determine a constructor for the tag 'tag:yaml.org,2002:python/object/apply:os.mkdir'": (
        "camera_matrix: !!python/object/apply:os.mkdir [made]",
        {},
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_files_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, message: str) -> None:
    monkeypatch.chdir(tmp_path)
    text, options = BAD[message]
    with pytest.raises(wc.WarpcamError) as error:
        read(tmp_path, text, **options)
    assert message in str(error.value)
    assert str(error.value).startswith(f"read_calibration: {tmp_path / 'calibration.yaml'}")
    assert [path.name for path in tmp_path.iterdir()] == ["calibration.yaml"]  # nothing of a file is run


def test_files_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(wc.WarpcamError, match=r"read_calibration: .*gone.yaml cannot be read: .*No such file"):
        wc.read_calibration(tmp_path / "gone.yaml")
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(wc.WarpcamError, match=r"bytes.yaml cannot be read: 'utf-8' codec"):
        wc.read_calibration(tmp_path / "bytes.yaml")
    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(wc.WarpcamError, match=r"calibrations need it: pip install 'warpcam\[calibration\]'"):
        read(tmp_path, CAMERA_INFO)


@pytest.mark.parametrize("name", ["14481234", "00123", "1.50", "2020-01-01", "no", "1:04"])
def test_names_are_texts_as_they_are_written(tmp_path: Path, name: str) -> None:
    """Drivers name a camera by its serial number, without quotes."""
    text = f"camera_name: {name}\n" + CAMERA_INFO.partition("camera_name: narrow_stereo\n")[2]
    text = text if "image_width" in text else "image_width: 640\nimage_height: 480\n" + text
    assert read(tmp_path, text).name == name
    assert read(tmp_path, text, camera=name).name == name


def test_yaml_in_braces_and_numbers_that_json_does_not_know(tmp_path: Path) -> None:
    for text in (
        "{image_width: 64, image_height: 48, K: [50, 0, 32, 0, 50, 24, 0, 0, 1], D: [0, 0, 0, 0]}",
        '{"image_width": 64, "image_height": 48, "K": [50., 0., 32., 0., 50., 24., 0., 0., 1.], "D": [0., 0., 0., 0.]}',
        "# of a camera\n%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\nK: [50, 0, 32, 0, 50, 24, 0, 0, 1]\n"
        "D: [0, 0, 0, 0]\n",
    ):
        calibration = read(tmp_path, text)
        assert (calibration.width, calibration.height) == (64, 48)
        assert isinstance(calibration.lens, wc.Pinhole)


def test_arguments_of_another_kind(tmp_path: Path) -> None:
    for path in (None, 5, b"camchain.yaml", ["camchain.yaml"]):
        with pytest.raises(wc.WarpcamError, match="read_calibration: path must be a str or a path, got"):
            wc.read_calibration(path)  # type: ignore[arg-type]
    for text in (CAMCHAIN, CAMERA_INFO):
        for camera in (True, 1.0, [0], np.array([0, 1])):
            with pytest.raises(wc.WarpcamError, match="camera must be a name, an index or None, got"):
                read(tmp_path, text, camera=camera)
        with pytest.raises(wc.WarpcamError, match="fisheye must be True, False or None, got 'no'"):
            read(tmp_path, text, fisheye="no")
    assert read(tmp_path, CAMCHAIN, camera=np.int64(1)).name == "cam1"
