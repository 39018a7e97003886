"""``python -m tests.path.compare_looks``: FLIP of the look "pbr" beside "path", on the scenes compared with Mitsuba.

Prints a table in Markdown. Cameras are those of the comparison; pictures are ``rgb``, the real-time ones with shadows
and smooth edges.
"""

import argparse
import math
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


HIDDEN = {"ambient_occlusion": math.inf, "soft_shadows": True}
WAYS: dict[str, dict[str, Any]] = {
    "alone": {},
    "hidden": HIDDEN,
    "reflections": {"reflections": True},
    "both": {**HIDDEN, "reflections": True},
    "indirect": {"soft_shadows": True, "indirect_light": True, "reflections": True},
}


class Row(NamedTuple):
    """One scene.

    Attributes:
        scene: Its name.
        flips: Mean FLIP of "pbr" beside "path", 0 to 1, in each of ``WAYS``.
        lights: Mean radiance of "pbr" over that of "path", likewise.
    """

    scene: str
    flips: tuple[float, ...]
    lights: tuple[float, ...]


def compare(name: str, samples: int, device: wp.Device) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        stage = metric(Usd.Stage.CreateNew(str(Path(folder) / "stage.usda")))
        scene = scene_of(stage, judged.SCENES[name], device)
        reference = _drawn(scene, {"look": "path", "path": wc.PathOptions(samples=samples)})
        drawn = [_drawn(scene, {"look": "pbr", **way}, shadows=True, antialiasing=4) for way in WAYS.values()]
    flips = tuple(image_metrics.flip(reference["rgb"], images["rgb"])[0] for images in drawn)
    return Row(name, flips, tuple(float(images["hdr"].mean() / reference["hdr"].mean()) for images in drawn))


def _drawn(scene: wc.Scene, options: dict[str, Any], **more: Any) -> dict[str, np.ndarray]:
    camera = wc.Camera(
        CAMERA.name,
        width=judged.SIZE,
        height=judged.SIZE,
        lens=wc.Pinhole(fovy=judged.FOVY),
        position=(0.0, 0.0, 0.0),
        outputs=("rgb", "hdr"),
        **more,
    )
    images = wc.Renderer(scene, [camera], **options).render()[CAMERA.name]
    return {name: image[0].cpu().numpy() for name, image in images.items()}


def table(rows: Sequence[Row]) -> str:
    names = [f"{number}, {way}" for number in ("FLIP", "light") for way in WAYS]
    lines = [f"| scene | {' | '.join(names)} |", "|---|" + len(names) * "---:|"]
    for row in rows:
        numbers = [*(f"{flip:.3f}" for flip in row.flips), *(f"{light:.2f}" for light in row.lights)]
        lines.append(f"| {row.scene} | {' | '.join(numbers)} |")
    means = [f"{np.mean(column):.3f}" for column in zip(*(row.flips for row in rows), strict=True)]
    return "\n".join([*lines, f"| mean | {' | '.join(means)} |{len(WAYS) * ' |'}"])


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
