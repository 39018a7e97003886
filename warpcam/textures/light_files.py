"""Files of light from all around in float: Radiance's .hdr and OpenEXR's .exr, by OpenImageIO."""

import logging
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess, Limits

SUFFIXES = {".hdr": "hdr", ".exr": "openexr"}  # and OpenImageIO's names of their formats
BRIGHTEST = 65504.0  # of a half float: in place of what was too bright for the file's


def read_light(path: Any, limits: Limits | None, where: str) -> np.ndarray:
    """Return the linear radiance of an image file, (height, width, 3) float32.

    Args:
        path: Of a .hdr or .exr file.
        limits: Of sizes, which count before pixels are decoded; None is ``Limits()``.
        where: The argument, for messages.

    Raises:
        RefusedError: The file or its image is larger than the limits.
        WarpcamError: The file cannot be read, has no colours, holds NaNs or a part of an image, or pixels in another
            order; or OpenImageIO is not installed.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise WarpcamError(f"{where}: {str(path)!r} came; allowed are files {' and '.join(SUFFIXES)}")
    try:
        import OpenImageIO
    except ImportError:
        raise WarpcamError(f"{where}: {path.name} needs OpenImageIO: pip install 'warpcam[environments]'") from None
    access = FileAccess(None, trusted=True, limits=limits, where=where)
    access.check_file(path)
    if not path.is_file():
        raise WarpcamError(f"{where}: there is no file {str(path)!r}")
    OpenImageIO.attribute("try_all_readers", 0)  # a format by its suffix alone
    source = OpenImageIO.ImageInput.open(str(path))
    if source is None:
        raise WarpcamError(f"{where}: {str(path)!r} cannot be read: {OpenImageIO.geterror()}")
    try:
        spec = source.spec()
        access.check("image_pixels", spec.width * spec.height, str(path))
        access.take(12 * spec.width * spec.height, str(path))
        channels = _colors(list(spec.channelnames))
        if source.format_name() != SUFFIXES[path.suffix.lower()] or channels is None or spec.deep:
            raise WarpcamError(f"{where}: {str(path)!r} has no red, green and blue, but {', '.join(spec.channelnames)}")
        _require_whole(spec, f"{where}: {str(path)!r}")
        pixels = source.read_image(0, 0, 0, spec.nchannels, "float")
        if pixels is None:
            raise WarpcamError(f"{where}: {str(path)!r} cannot be read: {source.geterror()}")
    finally:
        source.close()
    return _usable(np.asarray(pixels, np.float32)[..., channels], path, where)


def _require_whole(spec: Any, what: str) -> None:
    """Refuse pixels that are a part of the image, or more than it, and rows that do not go down from the top."""
    data = (spec.width, spec.height, spec.x, spec.y)
    shown = (spec.full_width, spec.full_height, spec.full_x, spec.full_y)
    if data != shown:
        texts = ["{}x{} at {}, {}".format(*window) for window in (data, shown)]
        raise WarpcamError(f"{what} has pixels of {texts[0]}, and its image is {texts[1]}; allowed are whole images")
    if spec.get_int_attribute("Orientation", 1) != 1:
        raise WarpcamError(f"{what} has its pixels in another order than rows from the top, each from the left")


def _colors(names: list[str]) -> list[int] | None:
    """Places of red, green and blue; a grey image's is there three times."""
    if {"R", "G", "B"} <= set(names):
        return [names.index(name) for name in "RGB"]
    return [0, 0, 0] if names == ["Y"] else None


def _usable(light: np.ndarray, path: Path, where: str) -> np.ndarray:
    """The light without what no light is: colours beyond the file's primaries are negative, suns may be infinite."""
    if np.isnan(light).any():
        raise WarpcamError(f"{where}: {str(path)!r} holds numbers that are none (NaN)")
    below, beyond = int((light < 0.0).sum()), int(np.isinf(light).sum())
    if below or beyond:
        logging.getLogger("warpcam").warning(
            "%s: of the numbers in %s, %d are negative and become 0, and %d are infinite and become %g", where, path,
            below, beyond, BRIGHTEST,
        )  # fmt: skip
    light = np.where(np.isposinf(light), np.float32(BRIGHTEST), light)
    return np.ascontiguousarray(np.maximum(light, 0.0))
