"""Physically based looks beside their peers: ``python -m warpcam.benchmarks.look_speed --out look_speed.json``.

Frames a second of ``rgb``: the look "pbr" with shadows beside the real-time tier of mujoco_warp_pbr, and the look
"path" beside its path tracer and Mitsuba 3, with as many paths a pixel and surfaces a path. Scenes are generated. A
renderer that does not start is in the results with the reason.
"""

import argparse
import json
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from PIL import Image

from warpcam.benchmarks import image_metrics, look_renderers, machine, measure, problem
from warpcam.benchmarks.pbr_scenes import SCENES
from warpcam.core.errors import WarpcamError

# Kind of light -> renderers, ours first, and (worlds, pixels of a side) on a GPU.
RENDERERS = {
    "pbr": ("warpcam pbr", "mujoco_warp_pbr realtime", "mujoco_warp_pbr optix"),
    "path": ("warpcam path", "mujoco_warp_pbr path", "mitsuba"),
}
PEERS = tuple(name for names in RENDERERS.values() for name in names[1:])
SIZES = {"pbr": ((1024, 64), (4096, 64), (256, 256)), "path": ((64, 64), (4, 512))}
CPU_SIZES = ((2, 64),)
SAMPLES = 64


def measured(name: str, scene: problem.Problem, samples: int, frames: int | None) -> tuple[dict[str, Any], np.ndarray]:
    """Times of a renderer, and its picture of the first world, (height, width, 3) uint8."""
    device = scene.d.qpos.device
    with measure.on_one_stream(device):
        scene.place(0)
        renderer = look_renderers.create(name, scene, samples)
        first = measure.time_first(renderer.frame, device)
        picture = renderer.image()
        times = measure.time_frames(
            renderer.frame, scene.place, problem.POSE_SETS, device, frames, on_host=renderer.on_host
        )
    worlds = 1 if name == "mitsuba" else scene.worlds  # it draws the first world alone
    found = {"ms": times, "first_frame_s": first, "frames_per_s": 1e3 * worlds / times["median"]}
    return found, picture


def rows_of(
    case: str, kind: str, names: Sequence[str], worlds: int, size: int, options: argparse.Namespace
) -> Iterator[dict[str, Any]]:
    """A row for each renderer of a problem, as soon as it is there; ratios and differences are to warpcam's."""
    scene = problem.build(SCENES[case], worlds, size, size)
    ours: tuple[float, np.ndarray] | None = None
    for name in names:
        row = {"case": case, "kind": kind, "renderer": name, "worlds": worlds, "size": size, "faces": scene.faces()}
        if kind == "path":
            row |= {"samples": options.samples, "bounces": look_renderers.DEPTH}
        try:
            found, picture = measured(name, scene, options.samples, options.frames)
        except Exception as error:  # a peer that does not start is a result, too
            if name.startswith("warpcam"):
                raise
            row |= {"error": str(error) or type(error).__name__, "trace": traceback.format_exc()}
        else:
            row |= found
            if name.startswith("warpcam"):
                ours = found["frames_per_s"], picture
            elif ours is not None:
                row["warpcam_over_this"] = ours[0] / found["frames_per_s"]
                row["mean_difference"] = float(np.abs(picture.astype(float) - ours[1]).mean())
                row["flip"] = image_metrics.flip(ours[1], picture)[0]
            if options.pictures:
                place = options.pictures / f"{case}-{size}x{size}-{worlds}-{name.replace(' ', '_')}.png"
                Image.fromarray(picture).save(place)
        print(line(row), flush=True)
        yield row


def line(row: dict[str, Any]) -> str:
    start = f"{row['case']:10} {row['worlds']:5} x {row['size']:3}x{row['size']:<3} {row['renderer']:25}"
    if "error" in row:
        return f"{start} failed: {row['error'].strip().splitlines()[-1]}"
    ratio = f", warpcam is {row['warpcam_over_this']:.2f} times as fast" if "warpcam_over_this" in row else ""
    flip = f", FLIP {row['flip']:.3f}" if "flip" in row else ""
    return f"{start} {row['frames_per_s']:12.1f} frames/s{ratio}{flip}"


def means(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Geometric mean over scenes of warpcam's frames a second over those of each peer, by peer and size."""
    ratios: dict[str, list[float]] = {}
    for row in rows:
        if "warpcam_over_this" in row:
            name = f"{row['renderer']}, {row['worlds']} x {row['size']}x{row['size']}"
            ratios.setdefault(name, []).append(row["warpcam_over_this"])
    return {name: float(np.exp(np.log(found).mean())) for name, found in ratios.items()}


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if wp.is_cuda_available() else "cpu")
    parser.add_argument("--scene", nargs="+", choices=SCENES, default=list(SCENES), metavar="NAME")
    parser.add_argument("--kind", nargs="+", choices=RENDERERS, default=list(RENDERERS), help="of light")
    parser.add_argument(
        "--peer",
        nargs="*",
        choices=PEERS,
        default=list(PEERS),
        metavar="NAME",
        help=f"{', '.join(PEERS)} (default: all)",
    )
    parser.add_argument("--worlds", type=int, help="in place of the numbers of worlds; needs --size")
    parser.add_argument("--size", type=int, help="pixels of a side; needs --worlds")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="paths of each pixel (default: %(default)s)")
    parser.add_argument("--frames", type=int, help="that are timed (default: as many as the device's speed allows)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="JSON")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="folder of pictures of each renderer")
    options = parser.parse_args(arguments)
    for name in ("worlds", "size", "samples", "frames"):
        value = getattr(options, name)
        if value is not None and value < 1:
            raise WarpcamError(f"--{name}: must be at least 1, got {value}")
    if (options.worlds is None) != (options.size is None):
        raise WarpcamError(f"--worlds, --size: both or none, got {options.worlds} and {options.size}")
    return options


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    device = wp.get_device(options.device)
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
    report: dict[str, Any] = {"about": __doc__, "machine": machine.describe(device), "results": []}
    with wp.ScopedDevice(device):
        for kind in options.kind:
            names = [n for n in RENDERERS[kind] if n not in PEERS or n in options.peer]
            sizes = (
                ((options.worlds, options.size),) if options.worlds else SIZES[kind] if device.is_cuda else CPU_SIZES
            )
            for case in options.scene:
                for worlds, size in sizes:
                    for row in rows_of(case, kind, names, worlds, size, options):
                        report["results"].append(row)
                        report["warpcam_over_peers"] = means(report["results"])
                        if options.out:
                            options.out.write_text(json.dumps(report, indent=1) + "\n")
    for name, ratio in report["warpcam_over_peers"].items():
        print(f"warpcam over {name}: {ratio:.2f} (geometric mean)")


if __name__ == "__main__":
    main()
