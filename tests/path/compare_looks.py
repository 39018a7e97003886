"""``python -m tests.path.compare_looks``: FLIP of the look "pbr" beside "path", on the scenes compared with Mitsuba.

Prints a table in Markdown. Cameras are those of the comparison; pictures are ``rgb``, the real-time ones with shadows
and smooth edges.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from pxr import Usd

import warpcam as wc
from warpcam.benchmarks import image_metrics, machine

HELPERS = str(Path(__file__).resolve().parents[1] / "helpers")
if HELPERS not in sys.path:
    sys.path.append(HELPERS)
import judged_scenes as judged  # noqa: E402
from judged_stages import CAMERA, scene_of  # noqa: E402
from usd_stages import metric  # noqa: E402

SAMPLES = 1024


class Row(NamedTuple):
    """One scene.

    Attributes:
        scene: Its name.
        flip: Mean FLIP of the two pictures, 0 to 1.
        light: Mean radiance of "pbr" over that of "path".
    """

    scene: str
    flip: float
    light: float


def compare(name: str, samples: int, device: wp.Device) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        stage = metric(Usd.Stage.CreateNew(str(Path(folder) / "stage.usda")))
        scene = scene_of(stage, judged.SCENES[name], device)
        fast = _drawn(scene, "pbr", shadows=True, antialiasing=4)
        reference = _drawn(scene, "path", wc.PathOptions(samples=samples))
    flip, _ = image_metrics.flip(reference["rgb"], fast["rgb"])
    return Row(name, flip, float(fast["hdr"].mean() / reference["hdr"].mean()))


def _drawn(scene: wc.Scene, look: Any, path: wc.PathOptions | None = None, **more: Any) -> dict[str, np.ndarray]:
    camera = wc.Camera(
        CAMERA.name,
        width=judged.SIZE,
        height=judged.SIZE,
        lens=wc.Pinhole(fovy=judged.FOVY),
        position=(0.0, 0.0, 0.0),
        outputs=("rgb", "hdr"),
        **more,
    )
    images = wc.Renderer(scene, [camera], look=look, path=path).render()[CAMERA.name]
    return {name: image[0].cpu().numpy() for name, image in images.items()}


def table(rows: Sequence[Row]) -> str:
    lines = ["| scene | FLIP | light of `pbr` over that of `path` |", "|---|---:|---:|"]
    lines += [f"| {row.scene} | {row.flip:.3f} | {row.light:.2f} |" for row in rows]
    return "\n".join([*lines, f"| mean | {np.mean([row.flip for row in rows]):.3f} | |"])


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=SAMPLES, help="paths of each pixel (default: %(default)s)")
    parser.add_argument("--device", default=None, help="cpu, cuda:0, ... (default: the first GPU, or the CPU)")
    options = parser.parse_args(arguments)
    device = wp.get_device(options.device or ("cuda:0" if wp.is_cuda_available() else "cpu"))
    rows = [compare(name, options.samples, device) for name in judged.SCENES]
    print(f"{judged.SIZE} x {judged.SIZE} pixels, {options.samples} paths a pixel, {machine.describe(device)['cpu']}"
          f"{', ' + device.name if device.is_cuda else ''}\n")  # fmt: skip
    print(table(rows))


if __name__ == "__main__":
    main()
