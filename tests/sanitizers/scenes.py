"""Small scenes that reach every header of kernels/native, by name."""

import sys
from collections.abc import Callable
from pathlib import Path

import warp as wp

sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers"))
import golden_scenes

SCENES: dict[str, Callable[[wp.Device], object]] = {**golden_scenes.PICTURES}
