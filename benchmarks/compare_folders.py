"""Every MJCF file of some folders beside ``mujoco.Renderer``: how far colours, ids and depth differ.

    python -m warpcam.benchmarks.compare_folders FOLDER... [--cameras 2] [--size 160 120] [--out FILE.csv]

Both draw the free camera and the first of the model's own, the state being that of the first keyframe or, without one,
the model's. Files that MuJoCo cannot read by themselves, as those that others include, are passed over. Prints a line
for each picture and a summary; the CSV has the lines. Exit code 1: our renderer refused or failed where MuJoCo's drew.
"""

import argparse
import csv
import os
import statistics
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "osmesa")
# Mesa's software renderer is to look textures up as precisely as a GPU does, without its short cuts of eight bits.
os.environ.setdefault("GALLIVM_PERF", "no_filter_hacks,no_aos_sampling")

import mujoco
import numpy as np
import warp as wp

from warpcam.benchmarks import image_metrics
from warpcam.compat.mujoco import Renderer
from warpcam.core.errors import WarpcamError
from warpcam.sources.mujoco import batch_file

NEAR = 0.01  # depths that differ by no more than this part are alike


@dataclass(frozen=True)
class Pair:
    """Two pictures of one camera.

    Attributes:
        file: Of the model.
        camera: Its index, -1 for the free one.
        psnr: Of colours [dB].
        ids: Part of the pixels whose ids differ.
        depth: Part of the pixels whose depths differ by more than ``NEAR``.
        error: Why there is none of ours, else "".
    """

    file: str
    camera: int
    psnr: float = 0.0
    ids: float = 1.0
    depth: float = 1.0
    error: str = ""

    def line(self) -> str:
        if self.error:
            return f"{self.file} camera {self.camera}: {self.error}"
        differ = f"ids differ in {self.ids:.3%}, depth in {self.depth:.3%}"
        return f"{self.psnr:5.1f} dB, {differ}: {self.file} camera {self.camera}"


def find(folders: Sequence[Path]) -> Iterator[tuple[str, mujoco.MjModel]]:
    """Models below the folders, each with the name of its file from there."""
    for folder in folders:
        for path in sorted(folder.rglob("*.xml")):
            try:
                model = mujoco.MjModel.from_xml_path(str(path))
            except ValueError:
                continue
            if model.ngeom:
                yield str(path.relative_to(folder.parent)), model


def draw(
    kind: Any, model: mujoco.MjModel, state: mujoco.MjData, camera: int, size: tuple[int, int]
) -> list[np.ndarray]:
    """Colours, depth and ids by ``mujoco.Renderer`` or ours."""
    width, height = size
    pictures = []
    with kind(model, height, width) as renderer:
        for switch in (None, "depth", "segmentation"):
            if switch is not None:
                getattr(renderer, f"enable_{switch}_rendering")()
            renderer.update_scene(state, camera=camera)
            pictures.append(renderer.render().copy())
            if switch is not None:
                getattr(renderer, f"disable_{switch}_rendering")()
    return pictures


def compare(name: str, model: mujoco.MjModel, size: tuple[int, int], cameras: int) -> Iterator[Pair]:
    """Draw a model's cameras by both."""
    screen = model.vis.global_
    screen.offwidth, screen.offheight = max(screen.offwidth, size[0]), max(screen.offheight, size[1])
    state = mujoco.MjData(model)
    batch_file.restart(model, state)
    for camera in range(-1, min(cameras, model.ncam)):
        theirs = draw(mujoco.Renderer, model, state, camera, size)
        try:
            ours = draw(Renderer, model, state, camera, size)
        except WarpcamError as error:
            yield Pair(name, camera, error=" ".join(str(error).split()))
            continue
        far = np.abs(theirs[1] - ours[1]) > NEAR * np.abs(theirs[1])
        others = (theirs[2] != ours[2]).any(-1)
        yield Pair(name, camera, image_metrics.psnr(theirs[0], ours[0]), float(others.mean()), float(far.mean()))


def summary(pairs: Sequence[Pair]) -> str:
    drawn = [pair for pair in pairs if not pair.error]
    if not drawn:
        return "no pictures"
    psnr, ids, depth = ([getattr(pair, name) for pair in drawn] for name in ("psnr", "ids", "depth"))
    middle, mean = ([f"{of(values):.3%}" for values in (ids, depth)] for of in (statistics.median, statistics.mean))
    return (
        f"{len({pair.file for pair in pairs})} models, {len(drawn)} pictures, {len(pairs) - len(drawn)} missing; "
        f"PSNR median {statistics.median(psnr):.1f} dB, least {min(psnr):.1f}; of the pixels, median and mean, "
        f"ids differ in {middle[0]} and {mean[0]}, depth in {middle[1]} and {mean[1]}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--cameras", type=int, default=2, help="of the model's own, at most (default: %(default)s)")
    parser.add_argument("--size", type=int, nargs=2, default=(160, 120), metavar=("W", "H"), help="of a picture")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write the lines, too")
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_WARNING
    pairs = []
    for name, model in find(options.folders):
        for pair in compare(name, model, tuple(options.size), options.cameras):
            print(pair.line(), flush=True)
            pairs.append(pair)
    if options.out is not None:
        with options.out.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(field.name for field in fields(Pair))
            writer.writerows(
                (pair.file, pair.camera, f"{pair.psnr:.2f}", f"{pair.ids:.5f}", f"{pair.depth:.5f}", pair.error)
                for pair in pairs
            )
    print(summary(pairs))
    return int(any(pair.error for pair in pairs))


if __name__ == "__main__":
    sys.exit(main())
