"""Rate of ``warpcam dataset`` with COCO's labels: ``python -m warpcam.benchmarks.datasets``.

Parts: "total", images a second of the whole command, of its shards alone once the first is done, with each encoder and
number of workers; "stages", milliseconds an image of each stage by itself, those of the host by one thread; "mujoco",
the same loop with ``mujoco.Renderer`` (datasets_mujoco.py); "ray", the same as "total" by actors of a Ray cluster that
is started here. JSON is written after each.
"""

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpcam.benchmarks import machine
from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate import Plan, Worlds, device_jpeg, generate, read_recipes, statistics
from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.writers.coco import CocoWriter
from warpcam.datasets.writers.encode import encode_colors
from warpcam.datasets.writers.writer import ShardLayout
from warpcam.sources.mujoco import batch_file

RECIPES = """
poses:
  b[al]*: {low: [-0.6, -1.0, 0.1], high: [0.6, -0.1, 0.5]}
  can: {low: [-0.6, -1.0, 0.1], high: [0.6, -0.1, 0.5]}
  egg: {low: [-0.6, -1.0, 0.1], high: [0.6, -0.1, 0.5]}
  pill: {low: [-0.6, -1.0, 0.1], high: [0.6, -0.1, 0.5]}
spacing: 0.28
cameras:
  orbit:
    shell:
      {target: [0.0, -0.5, 0.2], spread: [0.1, 0.1, 0.1], radius: [1.3, 2.2], azimuth: [200, 340], elevation: [15, 65]}
    fovy: [38, 52]
scene:
  light_directions: {low: 0, high: 25, of: turn}
  light_diffuse: {low: 0.6, high: 1.3, of: factor}
distractors: {count: [0, 6], low: [-0.8, -1.2, 0.0], high: [0.8, 0.0, 0.8], size: [0.02, 0.08]}
labels:
  classes: {ball: ball, block: block, can: can, egg: egg, pill: pill, vase: vase}
"""  # of the demo scene, as examples/dataset.yaml has them
PARTS = ("total", "stages", "mujoco", "ray")
Row = dict[str, Any]


def pixels(text: str) -> tuple[int, int]:
    """Width and height of WxH."""
    width, height = map(int, text.split("x"))
    return width, height


class Clock:
    """Seconds of stages, which are functions that it wraps; each waits for the device at its end."""

    def __init__(self, device: wp.Device):
        self._device = device
        self.seconds: dict[str, float] = {}

    def timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any, **keywords: Any) -> Any:
            wp.synchronize_device(self._device)
            start = time.perf_counter()
            found = call(*arguments, **keywords)
            wp.synchronize_device(self._device)
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
            return found

        return run


def totals(plan: Plan, workers: list[int], encoders: list[Row], make: Callable[..., None]) -> Iterator[Row]:
    """Rates of each encoder and number of workers; each worker gets as many samples as one alone."""
    for encoder in encoders:
        for count in workers:
            with tempfile.TemporaryDirectory() as folder:
                whole = dataclasses.replace(plan, out=f"{folder}/out", count=plan.count * count, **encoder)
                yield {**encoder, "workers": count, "count": whole.count, **rates(whole, count, make)}


def rates(plan: Plan, workers: int, make: Callable[..., None]) -> Row:
    """Images a second of all, and from when every worker has made its first shard to the last shard."""
    told: list[tuple[float, int]] = []

    def progress(samples: int) -> None:
        told.append((time.perf_counter(), samples))

    start = time.perf_counter()
    make(plan, workers=workers, progress=progress)
    seconds = time.perf_counter() - start
    done = np.cumsum([samples for _, samples in told])
    first = int(np.searchsorted(done, min(workers * plan.shard_size, plan.count // 2)))
    steady = (done[-1] - done[first]) / max(told[-1][0] - told[first][0], 1e-9)
    return {"seconds": seconds, "images_per_s": plan.count / seconds, "steady_images_per_s": float(steady)}


def stages(plan: Plan, batches: int) -> Row:
    """Milliseconds an image of each stage."""
    worlds = Worlds(plan)
    clock, count = Clock(worlds.device), batches * plan.worlds
    list(worlds.draw(range(plan.worlds)))  # what is compiled and captured at first
    stage: Any = worlds
    stage._vary = clock.timed("randomise", worlds._vary)
    stage._look = clock.timed("render", worlds._look)
    stage._labels.read = clock.timed("labels", worlds._labels.read)
    frames: list[Frame] = []
    start = time.perf_counter()
    for batch in range(batches):
        frames = list(worlds.draw(range(batch * plan.worlds, (batch + 1) * plan.worlds)))
    whole = time.perf_counter() - start
    found = {name: 1e3 * seconds / count for name, seconds in clock.seconds.items()}
    found["copy, frames" + (", encode" if plan.jpeg == "torchcodec" else "")] = 1e3 * whole / count - sum(
        found.values()
    )
    return {**found, **{f"{name} (a thread)": ms for name, ms in host_stages(plan, worlds, frames).items()}}


def host_stages(plan: Plan, worlds: Worlds, frames: list[Frame]) -> Row:
    """Milliseconds an image of what threads of the host do."""
    with tempfile.TemporaryDirectory() as folder:
        layout = ShardLayout(
            folder=Path(folder), index=0, frames=len(frames), first=0, cameras=worlds.cameras, classes=worlds.classes,
            keypoint_names=worlds.keypoint_names, models=(), width=plan.width, height=plan.height,
            image_format=plan.image_format, quality=plan.quality, options={"min_pixels": 1},
        )  # fmt: skip
        writer = CocoWriter(layout)
        files = [frame.jpeg or encode_colors(frame.colors, plan.image_format, plan.quality) for frame in frames]
        encoded = [dataclasses.replace(frame, jpeg=file) for frame, file in zip(frames, files, strict=True)]
        work: dict[str, Callable[[int], Any]] = {
            "masks, boxes and file": lambda place: writer.encode(encoded[place]),
            "file": lambda place: (Path(folder) / str(place)).write_bytes(files[place]),
            "statistics": lambda place: statistics.of_frame(frames[place]),
        }
        if plan.jpeg != "torchcodec":
            work["encode"] = lambda place: encode_colors(frames[place].colors, plan.image_format, plan.quality)
        found = {}
        for name, call in work.items():
            start = time.perf_counter()
            for place in range(len(frames)):
                call(place)
            found[name] = 1e3 * (time.perf_counter() - start) / len(frames)
        return found


def mujoco_rates(plan: Plan, count: int) -> Row:
    """Rate of the loop with ``mujoco.Renderer``, in a process of its own; or why there is none."""
    backend = os.environ.get("MUJOCO_GL") or ("egl" if resolve(plan.device).is_cuda else "osmesa")
    with tempfile.TemporaryDirectory() as folder:
        task = dataclasses.replace(plan, out=f"{folder}/out", device="cpu", worlds=1, count=count)
        arguments = [task.scene, task.out, str(count), f"{task.width}x{task.height}", task.image_format]
        command = [sys.executable, "-m", "warpcam.benchmarks.datasets_mujoco", *arguments]
        environment = {**os.environ, "MUJOCO_GL": backend}
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no message"]
        return {"backend": backend, "skipped": f"mujoco.Renderer by {backend} does not run: {lines[-1]}"[:300]}
    return {"backend": backend, **json.loads(done.stdout.strip().splitlines()[-1])}


def results(options: argparse.Namespace, plan: Plan, encoders: list[Row]) -> Iterator[tuple[str, Row]]:
    """Each part's rows."""
    if "total" in options.parts:
        for row in totals(plan, options.workers, encoders, generate):
            yield "total", row
    if "stages" in options.parts:
        for encoder in encoders:
            yield "stages", {**encoder, "ms": stages(dataclasses.replace(plan, **encoder), options.batches)}
    if "mujoco" in options.parts:
        yield "mujoco", mujoco_rates(plan, options.mujoco_count)
    if "ray" in options.parts:
        if find_spec("ray") is None:
            yield "ray", {"skipped": "ray is not installed: pip install 'warpcam[ray]'"}
            return
        from warpcam.datasets.generate.cluster import generate_on_ray

        for row in totals(dataclasses.replace(plan, device=None), options.workers, encoders[:1], generate_on_ray):
            yield "ray", row


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", help="of one worker (default: the first GPU, or the CPU)")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=["total", "stages", "mujoco"])
    parser.add_argument("--size", type=pixels, default=(640, 480), metavar="WxH")
    parser.add_argument("--count", type=int, default=4000, help="samples of each worker")
    parser.add_argument("--shard-size", type=int, default=500, help="samples of a shard")
    parser.add_argument("--worlds", type=int, default=64, help="drawn at once")
    parser.add_argument("--workers", nargs="+", type=int, default=[1, 4], help="processes, or actors of Ray")
    parser.add_argument("--batches", type=int, default=10, help="of the stages")
    parser.add_argument("--mujoco-count", type=int, default=300, help="images of mujoco.Renderer")
    parser.add_argument("--png", action="store_true", help="PNG as well")
    parser.add_argument("--out", help="JSON file")
    options = parser.parse_args(arguments)
    device = resolve(options.device)
    encoders: list[Row] = [{"image_format": "jpg", "jpeg": "pillow"}]
    if device.is_cuda and device_jpeg.is_installed():
        encoders.insert(0, {"image_format": "jpg", "jpeg": "torchcodec"})
    if options.png:
        encoders.append({"image_format": "png", "jpeg": "pillow"})
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "recipes.yaml").write_text(RECIPES)
        width, height = options.size
        plan = Plan(
            str(batch_file.DEMO), f"{folder}/warm", "coco", options.count, width=width, height=height,
            recipes=read_recipes(Path(folder) / "recipes.yaml"), worlds=options.worlds, shard_size=options.shard_size,
            device=options.device,
        )  # fmt: skip
        report: Row = {"about": __doc__, "machine": machine.describe(device), "cores": len(os.sched_getaffinity(0))}
        report |= {"size": options.size, "worlds": options.worlds, "shard_size": options.shard_size, "results": []}
        generate(dataclasses.replace(plan, count=options.worlds, **encoders[0]))  # compiles all kernels
        for part, row in results(options, plan, encoders):
            report["results"].append({"part": part, **row})
            print(part, json.dumps(row), flush=True)
            if options.out:
                Path(options.out).write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    try:
        main()
    except WarpcamError as error:
        sys.exit(f"warpcam: {error}")
