"""Sweeps: one scene, and ever more of something, to see how the cost grows."""

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from warpcam.benchmarks import procedural_scenes
from warpcam.benchmarks.cases import CASES, COMMON, DEPTH_AND_IDS, Case, Setting, Wanted, positive, resized

Point = tuple[Case, Setting, list[Wanted]]


def worlds_point(count: int) -> Point:
    return CASES["primitives"], Setting("sweep", count, 64, 64), [DEPTH_AND_IDS, COMMON["rgb-shadows"]]


def pixels_point(side: int) -> Point:
    return CASES["primitives"], Setting("sweep", 64, side, side), [DEPTH_AND_IDS, COMMON["rgb-shadows"]]


def shapes_point(count: int) -> Point:
    spec = partial(procedural_scenes.shapes, count)
    case = Case(f"shapes_{count}", "free shapes in a grid", spec, ("fixed",), scatter=(0.1, 3.0))
    return case, Setting("sweep", 1024, 64, 64), [DEPTH_AND_IDS, COMMON["rgb-shadows"]]


def faces_point(count: int) -> Point:
    case = Case(
        f"faces_{count}", "one bumpy ball", partial(procedural_scenes.ball_of, count), ("fixed",), scatter=(0.1, 3.0)
    )
    return case, Setting("sweep", 1024, 64, 64), [DEPTH_AND_IDS, COMMON["rgb-shadows"]]


def lights_point(count: int) -> Point:
    case = Case(f"lights_{count}", "64 shapes under spot lights", partial(procedural_scenes.lights, count), ("fixed",))
    return case, Setting("sweep", 1024, 64, 64), [COMMON["rgb-shadows"]]


def samples_point(count: int) -> Point:
    wanted = replace(COMMON["rgb-shadows"], antialiasing=count, by_peers=False)
    return CASES["humanoid"], Setting("sweep", 1024, 128, 128), [wanted]


SWEEPS: dict[str, tuple[Callable[[int], Point], tuple[int, ...]]] = {
    "worlds": (worlds_point, (1, 4, 16, 64, 256, 1024, 4096, 16384)),
    "pixels": (pixels_point, (32, 64, 128, 256, 512, 1024)),
    "shapes": (shapes_point, (1, 4, 16, 64, 128, 256, 400, 600, 1000, 2000, 4000)),
    "faces": (faces_point, (100, 1000, 10000, 100000, 1000000, 2000000)),
    "lights": (lights_point, (1, 2, 3, 4, 6, 8, 10)),
    "samples": (samples_point, (1, 4, 8, 16, 64)),
}


def points(options: argparse.Namespace) -> list[tuple[Point, dict[str, Any]]]:
    """The points of the sweep that was asked for, and what marks their results."""
    point, values = SWEEPS[options.sweep]
    found = []
    for value in options.points or values:
        case, setting, wanted = point(positive("--points", value))
        marks = {"sweep": options.sweep, "x": value}
        found.append(((case, resized(setting, options.worlds, options.size), wanted), marks))
    return found
