"""``python -m tests.path.compare_looks``: FLIP of the look "pbr" beside "path", on the scenes compared with Mitsuba.

Prints a table in Markdown. Cameras are those of the comparison; pictures are ``rgb``, the real-time ones with shadows
and smooth edges, without and with reflections.
"""

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
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
        flip: Mean FLIP of "pbr" beside "path", 0 to 1.
        reflected: The same with reflections.
        light: Mean radiance of "pbr" over that of "path".
        reflected_light: The same with reflections.
    """

    scene: str
    flip: float
    reflected: float
    light: float
    reflected_light: float


def compare(name: str, samples: int, device: wp.Device) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        stage = metric(Usd.Stage.CreateNew(str(Path(folder) / "stage.usda")))
        scene = scene_of(stage, judged.SCENES[name], device)
        fast = [_drawn(scene, {"look": "pbr", "reflections": on}, shadows=True, antialiasing=4) for on in (False, True)]
        reference = _drawn(scene, {"look": "path", "path": wc.PathOptions(samples=samples)})
    flips = [image_metrics.flip(reference["rgb"], images["rgb"])[0] for images in fast]
    light = [float(images["hdr"].mean() / reference["hdr"].mean()) for images in fast]
    return Row(name, *flips, *light)


def _drawn(scene: wc.Scene, how: Mapping[str, Any], **more: Any) -> dict[str, np.ndarray]:
    camera = wc.Camera(
        CAMERA.name,
        width=judged.SIZE,
        height=judged.SIZE,
        lens=wc.Pinhole(fovy=judged.FOVY),
        position=(0.0, 0.0, 0.0),
        outputs=("rgb", "hdr"),
        **more,
    )
    images = wc.Renderer(scene, [camera], **how).render()[CAMERA.name]
    return {name: image[0].cpu().numpy() for name, image in images.items()}


def table(rows: Sequence[Row]) -> str:
    lines = ["| scene | FLIP | with reflections | light of `pbr` over that of `path` | with reflections |"]
    lines += ["|---|---:|---:|---:|---:|"]
    for row in rows:
        numbers = f"{row.flip:.3f} | {row.reflected:.3f} | {row.light:.2f} | {row.reflected_light:.2f}"
        lines.append(f"| {row.scene} | {numbers} |")
    means = [float(np.mean(column)) for column in zip(*((row.flip, row.reflected) for row in rows), strict=True)]
    return "\n".join([*lines, f"| mean | {means[0]:.3f} | {means[1]:.3f} | | |"])


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
