"""Calibrations from files: Kalibr's camchain, ROS's camera_info and OpenCV's FileStorage.

PyYAML parses all of them, OpenCV's dialect, too, so that OpenCV need not be installed. Nothing of a file is run.
"""

import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.camera.calibration_fields import Fields
from warpcam.camera.distorted import Distorted
from warpcam.camera.fisheye import Fisheye
from warpcam.camera.lens import FormulaLens, Pinhole
from warpcam.camera.wide_lenses import DoubleSphere, ExtendedUnified, Omnidirectional
from warpcam.core import plain_yaml
from warpcam.core.errors import RefusedError, WarpcamError
from warpcam.core.file_access import FileAccess, Limits, read_named

# Keys of ROS and OpenCV, and of what is often written with OpenCV.
MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "k")
COEFFICIENTS = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "Distortion_Coefficients", "D", "d")
WIDTH = ("image_width", "image_Width", "width")
HEIGHT = ("image_height", "image_Height", "height")
SIZE = ("image_size", "imageSize")
UNQUOTED = tuple(f"tag:yaml.org,2002:{kind}" for kind in ("int", "float", "bool", "timestamp"))
MODELS = ("plumb_bob", "rational_polynomial", "equidistant", "fisheye", "none", "")


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated camera.

    Attributes:
        name: Of the camera in its file, or None.
        width: Of the image [pixels].
        height: Of the image [pixels].
        lens: For ``Camera(lens=...)`` with an image of that size.
    """

    name: str | None
    width: int
    height: int
    lens: FormulaLens


def read_calibration(
    path: str | os.PathLike[str],
    camera: str | int | None = None,
    *,
    fisheye: bool | None = None,
    limits: Limits | None = None,
) -> Calibration:
    """Read the size and the lens of one camera from a calibration file.

    | file | models |
    |---|---|
    | Kalibr's camchain YAML | pinhole with none, radtan or equidistant; omni with none or radtan; ds; eucm |
    | ROS's camera_info YAML, and its message as text | plumb_bob, rational_polynomial, equidistant, fisheye, none |
    | OpenCV's FileStorage, YAML or JSON | ``calibrateCamera``'s with 4, 5, 8, 12 or 14 coefficients; ``fisheye``'s |

    Principal points, which these files count from the centre of the first pixel, are moved by 0.5. A pinhole whose
    coefficients are all 0 becomes ``Pinhole``. Poses, rectification and projection matrices are not read: the lens is
    that of the image as it comes from the sensor.

    Args:
        path: Of the file.
        camera: Name of a camera ("cam1"), or its index, in a file that has several.
        fisheye: True if the four coefficients of an OpenCV file are those of ``cv2.fisheye``. None: as the file's
            ``fisheye_model`` says, else not. Other files name their model.
        limits: Of the file's size, and of the entries that its aliases stand for; None is ``warpcam.Limits()``.

    Raises:
        WarpcamError: The file cannot be read, PyYAML is not installed, a key is missing or has another value than is
            allowed, the model has no lens here, or the file has several cameras and none was named. The text names the
            file, the key, what came and what is allowed.
    """
    if not isinstance(path, str | os.PathLike):
        raise WarpcamError(f"read_calibration: path must be a str or a path, got {path!r}")
    where = f"read_calibration: {os.fspath(path)}"
    if isinstance(camera, bool) or not isinstance(camera, str | int | np.integer | None):
        raise WarpcamError(f"{where}: camera must be a name, an index or None, got {camera!r}")
    if not isinstance(fisheye, bool | None):
        raise WarpcamError(f"{where}: fisheye must be True, False or None, got {fisheye!r}")
    fields = Fields(_parsed(path, where, limits), where)
    chain = fields.parts(lambda part: "camera_model" in part)
    if chain or fields.find(("camera_model",)):
        if fisheye is not None:
            raise WarpcamError(f"{where}: fisheye is for OpenCV's files, got {fisheye!r}; this one is Kalibr's")
        if chain:
            name = _chosen(chain, camera, where)
            return _kalibr(fields.part(name), name)
        _only(None, camera, where)
        return _kalibr(fields, None)
    return _of_matrix(fields, camera, fisheye)


def _parsed(path: str | os.PathLike[str], where: str, limits: Limits | None) -> Mapping[Any, Any]:
    try:
        import yaml
    except ModuleNotFoundError as error:
        raise WarpcamError(
            f"{where}: PyYAML is not installed, and calibrations need it: pip install 'warpcam[calibration]'"
        ) from error

    def construct_mapping(self: Any, node: Any, deep: bool = False) -> Any:
        for key, value in node.value:
            if key.value == "camera_name" and value.tag in UNQUOTED:
                value.tag = "tag:yaml.org,2002:str"
        return yaml.SafeLoader.construct_mapping(self, node, deep)

    def construct_opencv(self: Any, _: str, node: Any) -> Any:
        if isinstance(node, yaml.MappingNode):
            return self.construct_mapping(node, deep=True)
        if isinstance(node, yaml.SequenceNode):
            return self.construct_sequence(node, deep=True)
        return self.construct_scalar(node)

    # YAML's plain types; OpenCV's matrices, "opencv-matrix" and "opencv-nd-matrix", which OpenCV 5 has for rows, are
    # mappings, and names of cameras texts as they are written.
    loader: Any = type("Loader", (yaml.SafeLoader,), {"construct_mapping": construct_mapping})
    loader.add_multi_constructor("tag:yaml.org,2002:opencv-", construct_opencv)
    try:
        text = read_named(path, limits, "read_calibration").decode("utf-8-sig")
    except WarpcamError:
        raise
    except (OSError, ValueError) as error:
        raise WarpcamError(f"{where} cannot be read: {error}") from error
    if text.lstrip().startswith("<"):
        raise WarpcamError(f"{where} is XML; allowed are YAML and JSON, which OpenCV writes by the file's suffix")
    text = re.sub(r"^%YAML:.*$", "", text, count=1, flags=re.MULTILINE)  # OpenCV's own header, no directive of YAML
    try:
        read = _in_braces if text.lstrip().startswith("{") else _documents
        documents = read(text, loader, limits, where)
    except RefusedError:
        raise
    except (ValueError, RecursionError) as error:
        raise WarpcamError(f"{where} is neither YAML nor JSON: {str(error) or type(error).__name__}") from error
    if not documents or not isinstance(documents[0], Mapping):
        raise WarpcamError(
            f"{where} must be a mapping of keys to values, got {type((documents or [None])[0]).__name__}"
        )
    return documents[0]


def _in_braces(text: str, loader: Any, limits: Limits | None, where: str) -> list[Any]:
    """Read JSON, or else YAML, which also knows numbers like "1." and texts without quotes."""
    try:
        return [json.loads(text)]
    except ValueError as error:
        try:
            return _documents(text, loader, limits, where)
        except RefusedError:
            raise
        except ValueError:
            raise error from None


def _documents(text: str, loader: Any, limits: Limits | None, where: str) -> list[Any]:
    """Documents of YAML that are not empty."""
    import yaml

    try:
        plain_yaml.check(text, FileAccess(None, trusted=True, limits=limits), where)
        return [each for each in yaml.load_all(text, Loader=loader) if each is not None]
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error


def _chosen(names: Sequence[str], camera: str | int | None, where: str) -> str:
    """The name of the camera that was asked for, of those in a chain."""
    if camera is None and len(names) == 1:
        return names[0]
    if isinstance(camera, int | np.integer) and 0 <= camera < len(names):
        return names[camera]
    if isinstance(camera, str) and camera in names:
        return camera
    came = "camera was not given" if camera is None else f"camera {camera!r} is not there"
    raise WarpcamError(f"{where}: {came}; cameras are {', '.join(map(repr, names))}")


def _only(name: str | None, camera: str | int | None, where: str) -> None:
    """Raise if another camera than the file's only one was asked for."""
    if camera not in (None, name) and camera != 0:
        has = "one camera without a name" if name is None else f"one camera, {name!r}"
        raise WarpcamError(f"{where}: camera {camera!r} is not there; the file has {has}")


def _kalibr(fields: Fields, name: str | None) -> Calibration:
    model = fields.text(fields.require(("camera_model",)), ("pinhole", "omni", "ds", "eucm"))
    distortions = {"pinhole": ("none", "radtan", "equidistant"), "omni": ("none", "radtan")}.get(model, ("none",))
    distortion = "none"
    if fields.find(("distortion_model",)) is not None or model in ("pinhole", "omni"):
        distortion = fields.text(fields.require(("distortion_model",)), distortions)
    extra = {"pinhole": 0, "omni": 1}.get(model, 2)
    shape = fields.numbers(fields.require(("intrinsics",)), (4 + extra,))
    coefficients = [0.0] * 4
    if distortion != "none":
        coefficients = fields.numbers(fields.require(("distortion_coeffs",)), (4,))
    width, height = fields.size(fields.require(("resolution",)))
    fx, fy, cx, cy = shape[extra:]
    pixels = _pixels(fx, fy, cx, cy, f"{fields.where}: intrinsics")
    lenses: dict[str, Callable[[], FormulaLens]] = {
        "pinhole": lambda: _pinhole(pixels, coefficients, distortion == "equidistant"),
        "omni": lambda: Omnidirectional(shape[0], **pixels, coefficients=coefficients),
        "ds": lambda: DoubleSphere(shape[0], shape[1], **pixels),
        "eucm": lambda: ExtendedUnified(shape[0], shape[1], **pixels),
    }
    lens = lenses[model]()
    return _checked(Calibration(name, width, height, lens), fields.where)


def _of_matrix(fields: Fields, camera: str | int | None, fisheye: bool | None) -> Calibration:
    """A camera of ROS or OpenCV."""
    name = fields.label("camera_name") if fields.find(("camera_name",)) else None
    _only(name, camera, fields.where)
    key = fields.require(MATRIX)
    matrix = fields.numbers(key, (9,))
    fx, skew, cx, zero, fy, cy, *last = matrix
    if [zero, *last] != [0.0, 0.0, 0.0, 1.0] or skew != 0.0:
        raise WarpcamError(f"{fields.where}: {key} must be [fx, 0, cx, 0, fy, cy, 0, 0, 1], got {matrix}")
    if (size := fields.find(SIZE)) is not None:
        width, height = fields.size(size)
    else:
        width, height = fields.pixels(fields.require(WIDTH)), fields.pixels(fields.require(HEIGHT))
    model = None
    if (entry := fields.find(("distortion_model",))) is not None:
        if fisheye is not None:
            raise WarpcamError(f"{fields.where}: fisheye came, {fisheye!r}, and the file has its own distortion_model")
        model = fields.text(entry, MODELS)
        _require_whole(fields, width, height)
    elif fisheye is None and (flag := fields.find(("fisheye_model",))) is not None:
        fisheye = fields.flag(flag)
    is_fisheye = bool(fisheye) or model in ("equidistant", "fisheye")
    counts = _counts(model, is_fisheye)
    coefficients = [0.0] * 4
    if 0 not in counts or fields.find(COEFFICIENTS) is not None:
        coefficients = fields.numbers(fields.require(COEFFICIENTS), counts) or coefficients
    if model in ("none", "") and any(coefficients):
        raise WarpcamError(f"{fields.where}: distortion_model {model!r} has no coefficients, got {coefficients}")
    lens = _pinhole(_pixels(fx, fy, cx, cy, f"{fields.where}: {key}"), coefficients, is_fisheye)
    return _checked(Calibration(name, width, height, lens), fields.where)


def _require_whole(fields: Fields, width: int, height: int) -> None:
    """Raise if ROS's images are a part of the calibrated one, or smaller."""
    for name in ("binning_x", "binning_y"):
        if fields.find((name,)) and fields.number(name) not in (0.0, 1.0):
            raise WarpcamError(f"{fields.where}: {name} must be 0 or 1, got {fields.number(name):g}")
    if fields.find(("roi",)):
        roi = fields.part("roi")
        for name, whole in (("x_offset", 0), ("y_offset", 0), ("width", width), ("height", height)):
            if roi.find((name,)) and roi.number(name) not in (0.0, whole):
                raise WarpcamError(
                    f"{roi.where}: {name} must be that of the whole image, {whole}, or 0, got {roi.number(name):g}"
                )


def _counts(model: str | None, is_fisheye: bool) -> tuple[int, ...]:
    """Numbers of coefficients that a model may have."""
    if is_fisheye:
        return (4,)
    if model in ("none", ""):
        return (0, 4, 5, 8, 12, 14)
    return {"plumb_bob": (4, 5), "rational_polynomial": (8, 12, 14)}.get(model or "", (4, 5, 8, 12, 14))


def _pixels(fx: float, fy: float, cx: float, cy: float, where: str) -> dict[str, float]:
    """Focal lengths and principal point, counted from the image's edges."""
    if fx <= 0.0 or fy <= 0.0:
        raise WarpcamError(f"{where}: focal lengths must be positive, got {fx:g} and {fy:g}")
    return {"fx": fx, "fy": fy, "cx": cx + 0.5, "cy": cy + 0.5}


def _pinhole(pixels: Mapping[str, float], coefficients: Sequence[float], is_fisheye: bool) -> FormulaLens:
    if is_fisheye:
        return Fisheye(**pixels, k=coefficients)
    return Distorted(**pixels, coefficients=coefficients) if any(coefficients) else Pinhole(**pixels)


def _checked(calibration: Calibration, where: str) -> Calibration:
    """Raise if a number is none that the lens may have."""
    calibration.lens.numbers(calibration.width, calibration.height, 1, where)
    return calibration
