"""``python -m tests.path.compare_looks``: FLIP of the look "pbr" beside "path", on the scenes compared with Mitsuba.

Prints a table in Markdown. Cameras are those of the comparison; pictures are ``rgb``, the real-time ones with shadows
and smooth edges, without and with reflections.
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


class Row(NamedTuple):
    """One scene.

    Attributes:
        scene: Its name.
        flip: Mean FLIP of the two pictures, 0 to 1.
        light: Mean radiance of "pbr" over that of "path".
        hidden_flip: As ``flip``, with ambient occlusion and soft shadows.
        hidden_light: As ``light``, likewise.
        reflected_flip: As ``flip``, with reflections alone.
        reflected_light: As ``light``, likewise.
    """

    scene: str
    flip: float
    light: float
    hidden_flip: float
    hidden_light: float
    reflected_flip: float
    reflected_light: float


def compare(name: str, samples: int, device: wp.Device) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        stage = metric(Usd.Stage.CreateNew(str(Path(folder) / "stage.usda")))
        scene = scene_of(stage, judged.SCENES[name], device)
        reference = _drawn(scene, {"look": "path", "path": wc.PathOptions(samples=samples)})
        numbers: list[float] = []
        for options in ({}, {"ambient_occlusion": math.inf, "soft_shadows": True}, {"reflections": True}):
            fast = _drawn(scene, {"look": "pbr", **options}, shadows=True, antialiasing=4)
            flip, _ = image_metrics.flip(reference["rgb"], fast["rgb"])
            numbers += [flip, float(fast["hdr"].mean() / reference["hdr"].mean())]
    return Row(name, *numbers)


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
    lines = ["| scene | FLIP | light | FLIP, hidden | light, hidden | FLIP, reflections | light, reflections |"]
    lines += ["|---|" + "---:|" * 6]
    lines += [
        f"| {row.scene} | " + " | ".join(f"{n:.{3 - k % 2}f}" for k, n in enumerate(row[1:])) + " |" for row in rows
    ]
    means = np.mean([[row.flip, row.hidden_flip, row.reflected_flip] for row in rows], axis=0)
    return "\n".join([*lines, "| mean |" + "".join(f" {mean:.3f} | |" for mean in means)])


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
