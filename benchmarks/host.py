"""Cost of warpcam on the host: Python time of a replayed frame, and the time to the first image.

The first image is timed in a child process, twice: with empty caches, where everything is compiled, and with those
that the first child left.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from rich.table import Table

import warpcam as wc
from warpcam.benchmarks.cases import CASES, COMMON, DEPTH_AND_IDS, Case, Wanted
from warpcam.benchmarks.problem import compile_case
from warpcam.benchmarks.report import Report, console

CALLS = 2000
SIZE = 64  # pixels of its one image, square
WANTED = (DEPTH_AND_IDS, COMMON["rgb-ds-shadows"])


def measure(cases: Iterable[Case], device: wp.Device, report: Report) -> None:
    calls = CALLS if device.is_cuda else 20
    for case in cases:
        for wanted in WANTED:
            row = {
                "case": case.name,
                "outputs": wanted.name,
                "renderer": "warpcam",
                "worlds": 1,
                "width": 64,
                "height": 64,
            }
            row |= replayed(case, wanted, device, calls)
            with tempfile.TemporaryDirectory() as folder:
                row["cold"] = in_child(case, wanted, device, Path(folder))
                row["warm"] = in_child(case, wanted, device, Path(folder))
            report["results"].append(row)


def renderer_of(case: Case, wanted: Wanted, device: wp.Device) -> tuple[wc.Renderer, dict[str, float]]:
    """A renderer of one world, and the seconds its parts took up to the first image.

    ``cpu_s`` are those of CPUs, all threads together, which other work on the machine does not change.
    """
    mjm = compile_case(case)
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=1)
        wp.synchronize_device(device)
        started, spent = time.perf_counter(), time.process_time()
        scene = wc.from_mujoco_warp(mjm, m, d, reflections=False, transparency=False)
        looked = time.perf_counter()
        renderer = wc.Renderer(
            scene,
            [
                wc.Camera(name, width=SIZE, height=SIZE, outputs=wanted.outputs, shadows=wanted.shadows)
                for name in case.cameras
            ],
        )
        built = time.perf_counter()
        renderer.render()
        wp.synchronize_device(device)
    drawn, spent = time.perf_counter(), time.process_time() - spent
    parts = {"scene_s": looked - started, "renderer_s": built - looked, "first_render_s": drawn - built}
    return renderer, {**parts, "total_s": drawn - started, "cpu_s": spent}


def replayed(case: Case, wanted: Wanted, device: wp.Device, calls: int) -> dict[str, Any]:
    """Microseconds of Python in `render()`, which queues a graph and does not wait for it."""
    renderer, _ = renderer_of(case, wanted, device)
    with wp.ScopedDevice(device):
        times = []
        for call in range(calls):
            if call % 100 == 0:
                wp.synchronize_device(device)  # a full queue would make the host wait for the device
            start = time.perf_counter()
            renderer.render()
            times.append(1e6 * (time.perf_counter() - start))
        wp.synchronize_device(device)
    low, middle, high = np.percentile(times, (10.0, 50.0, 90.0))
    return {"render_us": {"median": float(middle), "p10": float(low), "p90": float(high), "calls": calls}}


def in_child(case: Case, wanted: Wanted, device: wp.Device, caches: Path) -> dict[str, float]:
    places = ("WARP_CACHE_PATH", "WARPCAM_CACHE_DIR", "CUDA_CACHE_PATH")
    environment = {**os.environ, **{name: str(caches / name.lower()) for name in places}}
    asked = [sys.executable, "-m", __name__, case.name, wanted.name, device.alias]
    child = subprocess.run(asked, env=environment, capture_output=True, text=True)
    if child.returncode != 0:
        raise RuntimeError(f"the child failed: {child.stderr.strip()[-2000:]}")
    found: dict[str, float] = json.loads(child.stdout.splitlines()[-1])
    return found


def show(report: Report) -> None:
    columns = ("case", "outputs", "render() (us)", "p10 - p90", "first image (s), caches empty", "caches full")
    table = Table(*columns, box=None)
    for row in report["results"]:
        us = row["render_us"]
        first = [
            f"{row[key]['total_s']:.2f} (scene {row[key]['scene_s']:.2f}, renderer {row[key]['renderer_s']:.2f}; "
            f"of CPUs {row[key]['cpu_s']:.2f})"
            for key in ("cold", "warm")
        ]
        table.add_row(row["case"], row["outputs"], f"{us['median']:.1f}", f"{us['p10']:.1f} - {us['p90']:.1f}", *first)
    console().print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description="The child: prints the seconds up to the first image as JSON.")
    for name in ("case", "outputs", "device"):
        parser.add_argument(name)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    wp.init()
    device = wp.get_device(options.device)
    wanted = next(one for one in WANTED if one.name == options.outputs)
    _, seconds = renderer_of(CASES[options.case], wanted, device)
    print(json.dumps(seconds))


if __name__ == "__main__":
    main()
