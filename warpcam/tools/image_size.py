"""Sizes of images on a command line."""

import re

from warpcam.core.errors import WarpcamError


def image_size(text: str) -> tuple[int, int]:
    """Width and height of a text like 256x192 [pixels]."""
    match = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", text)
    if match is None:
        raise WarpcamError(f"--size: {text!r} came, width x height in pixels like 256x192 is needed")
    return int(match[1]), int(match[2])
