"""The command: checks what was asked for, measures it, and writes the JSON again after each renderer."""

import argparse
import contextlib
import functools
import importlib.util
import math
import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from warpcam.benchmarks.options import check
from warpcam.core.errors import WarpcamError

OUT = Path("warpcam-bench.json")
NEEDED = {"mujoco": "warpcam[mujoco]", "mujoco_warp": "warpcam[mujoco]", "rich": "rich"}


def run(options: argparse.Namespace) -> int:
    """Returns 0, or 1 where something failed that was asked for."""
    check(options)
    need(*NEEDED)
    if options.plot is not None:
        need("matplotlib", hint="warpcam[bench]")
    from warpcam.benchmarks import report as reports

    if options.merge:
        report = reports.merge(options.merge)
        if options.out is not None:
            reports.write(report, options.out)
    else:
        report = measured(options)
    show(report)
    if options.plot is not None:
        from warpcam.benchmarks import plot

        plot.draw(report, options.plot)
        print(f"drawn: {options.plot}")
    return int(any("error" in row for row in report["results"]))


def show(report: dict[str, Any]) -> None:
    from warpcam.benchmarks import distribution, gpus, host
    from warpcam.benchmarks import report as reports

    {"host": host.show, "gpus": gpus.show, "suite": distribution.show}.get(report["kind"], reports.show)(report)


def need(*packages: str, hint: str | None = None) -> None:
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise WarpcamError(f"bench: {package} is not installed; pip install '{hint or NEEDED[package]}'")


def measured(options: argparse.Namespace) -> dict[str, Any]:
    with empty_caches() if options.cold else contextlib.nullcontext():
        return measured_here(options)


@contextlib.contextmanager
def empty_caches() -> Iterator[None]:
    """With caches of kernels and trees that begin empty."""
    import warp as wp

    kernels, trees = wp.config.kernel_cache_dir, os.environ.get("WARPCAM_CACHE_DIR")
    with tempfile.TemporaryDirectory() as folder:
        wp.config.kernel_cache_dir = os.environ["WARPCAM_CACHE_DIR"] = folder
        try:
            yield
        finally:
            wp.config.kernel_cache_dir = kernels
            os.environ.pop("WARPCAM_CACHE_DIR")
            os.environ.update({} if trees is None else {"WARPCAM_CACHE_DIR": trees})


def measured_here(options: argparse.Namespace) -> dict[str, Any]:
    from warpcam.benchmarks import cases

    if options.threads is not None:
        os.environ["WARPCAM_CPU_THREADS"] = str(cases.positive("--threads", options.threads))
    import warp as wp

    from warpcam.benchmarks import host, tasks
    from warpcam.benchmarks import report as reports
    from warpcam.core.device import resolve

    wp.config.log_level = wp.LOG_WARNING
    device = resolve(options.device)
    out = options.out or OUT
    if options.host:
        report = reports.new("host", device)
        with wp.ScopedDevice(device):
            host.measure(tasks.chosen("--case", options.case or ["humanoid", "yam"], cases.CASES), device, report)
        reports.write(report, out)
        return report

    if options.gpus:
        return measured_on_every_gpu(options, device, out)

    return measured_in_turn(options, device, out)


def measured_in_turn(options: argparse.Namespace, device: Any, out: Path) -> dict[str, Any]:
    """Measure one after another until all is there, or until the time is up."""
    from warpcam.benchmarks import cases, measure, peers, runner, tasks
    from warpcam.benchmarks import report as reports

    kind = "sweep" if options.sweep else "suite" if options.suite else "cases"
    timing = "CUDA graph replays between events" if device.is_cuda else "plain calls"
    threads = None if device.is_cuda else os.environ.get("WARPCAM_CPU_THREADS", "all")
    report = reports.new(kind, device, timing=timing, warpcam_cpu_threads=threads, cold=options.cold)
    default = ["warpcam"] if options.sweep else peers.installed()
    asked = tasks.chosen("--peer", options.peer or default, {name: name for name in peers.PEERS})
    renderers = [name for name in peers.PEERS if name in asked]
    for name in renderers:
        need(name, hint=peers.INSTALL[name])
    if options.replays is not None:
        cases.positive("--replays", options.replays)
    todo = tasks.tasks(options, device)
    screen = reports.console()
    if lacking := tasks.left_out(options):
        report["runs"][0]["left_out"] = lacking
        for name, install in lacking.items():
            screen.print(f"left out: {name}, not installed; pip install {install}", style="yellow", markup=False)
    for name in tasks.not_asked(todo, renderers):
        limits = f"at most {peers.FEW_WORLDS} worlds of at least {peers.LARGE_PIXELS} pixels"
        screen.print(f"left out: {name}, which is asked for {limits}", style="yellow", markup=False)
    if options.resume and out.exists():
        report = reports.continued(out, report)
    known = reports.measured(report)
    deadline = time.monotonic() + (math.inf if options.seconds is None else options.seconds)

    def is_measured(marks: Mapping[str, Any], row: dict[str, Any]) -> bool:
        return reports.key({**row, **marks}) in known

    def rows() -> Iterator[dict[str, Any]]:
        for task in todo:
            for row in runner.measure_case(
                task.case,
                task.settings,
                task.wanted,
                renderers,
                device,
                options.replays,
                functools.partial(is_measured, task.marks),
            ):
                yield {**row, **task.marks}

    with measure.on_one_stream(device):
        for row in rows():
            report["results"].append(row)
            reports.write(report, out)
            took = f"{row['ms']['median']:.3f} ms" if "ms" in row else row["error"]
            screen.print(f"{reports.name_of(row)}: {row['renderer']}: {took}", style="dim", markup=False)
            if time.monotonic() > deadline:
                screen.print(f"stopped after {options.seconds:g} s; --resume measures the rest", style="yellow")
                break
    print(f"written: {out}")
    return report


def measured_on_every_gpu(options: argparse.Namespace, device: Any, out: Path) -> dict[str, Any]:
    from warpcam.benchmarks import cases, gpus, tasks
    from warpcam.benchmarks import report as reports

    for option, value in (("--worlds", options.worlds), ("--replays", options.replays)):
        if value is not None:
            cases.positive(option, value)
    asked = tasks.chosen("--case", options.case or ["humanoid", "yam"], cases.CASES)
    report = reports.new("gpus", device, timing="render() in a loop, by the host's clock")
    for row in gpus.rows(asked, options.worlds, options.replays):
        report["results"].append(row)
        reports.write(report, out)
    return report
