"""The command: checks what was asked for, measures it, and writes the JSON again after each renderer."""

import argparse
import contextlib
import importlib.util
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
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
    from warpcam.benchmarks import gpus, host
    from warpcam.benchmarks import report as reports

    {"host": host.show, "gpus": gpus.show}.get(report["kind"], reports.show)(report)


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

    from warpcam.benchmarks import host, measure, peers, runner, sweeps
    from warpcam.benchmarks import report as reports
    from warpcam.core.device import resolve

    wp.config.log_level = wp.LOG_WARNING
    device = resolve(options.device)
    out = options.out or OUT
    if options.host:
        report = reports.new("host", device)
        with wp.ScopedDevice(device):
            host.measure(chosen("--case", options.case or ["humanoid", "yam"], all_cases()), device, report)
        reports.write(report, out)
        return report

    if options.gpus:
        return measured_on_every_gpu(options, device, out)

    timing = "CUDA graph replays between events" if device.is_cuda else "plain calls"
    threads = None if device.is_cuda else os.environ.get("WARPCAM_CPU_THREADS", "all")
    report = reports.new(
        "sweep" if options.sweep else "cases", device, timing=timing, warpcam_cpu_threads=threads, cold=options.cold
    )
    default = ["warpcam"] if options.sweep else peers.installed()
    asked = chosen("--peer", options.peer or default, {name: name for name in peers.PEERS})
    renderers = [name for name in peers.PEERS if name in asked]
    for name in renderers:
        need(name, hint=peers.INSTALL[name])
    if options.replays is not None:
        cases.positive("--replays", options.replays)
    points = sweeps.points(options) if options.sweep else [(point, {}) for point in case_points(options, device)]
    screen = reports.console()
    if lacking := left_out(options):
        report["runs"][0]["left_out"] = lacking
        for name, install in lacking.items():
            screen.print(f"left out: {name}, not installed; pip install {install}", style="yellow", markup=False)
    with measure.on_one_stream(device):
        for (case, setting, wanted), marks in points:
            worlds, size = setting.worlds_of(case), (setting.width, setting.height)
            marks = {"setting": setting.name, **marks}
            for row in runner.measure_case(case, worlds, size, wanted, renderers, device, options.replays):
                report["results"].append({**row, **marks})
                reports.write(report, out)
                took = f"{row['ms']['median']:.3f} ms" if "ms" in row else row["error"]
                screen.print(f"{reports.name_of(row)}: {row['renderer']}: {took}", style="dim", markup=False)
    print(f"written: {out}")
    return report


def measured_on_every_gpu(options: argparse.Namespace, device: Any, out: Path) -> dict[str, Any]:
    from warpcam.benchmarks import cases, gpus
    from warpcam.benchmarks import report as reports

    for option, value in (("--worlds", options.worlds), ("--replays", options.replays)):
        if value is not None:
            cases.positive(option, value)
    asked = chosen("--case", options.case or ["humanoid", "yam"], all_cases())
    report = reports.new("gpus", device, timing="render() in a loop, by the host's clock")
    for row in gpus.rows(asked, options.worlds, options.replays):
        report["results"].append(row)
        reports.write(report, out)
    return report


def case_points(options: argparse.Namespace, device: Any) -> list[Any]:
    """Return the points to measure: each case in each setting with all its sets of outputs."""
    from warpcam.benchmarks import cases

    settings = options.setting or ["8192x64" if device.is_cuda else "cpu"]
    names: list[str] = []
    for name in options.outputs or cases.COMMON:
        names += cases.EXTRAS if name == "extras" else [name]
    wanted = chosen("--outputs", names, cases.WANTED)
    known = all_cases()
    found = chosen("--case", options.case, known) if options.case else [c for c in known.values() if available(c)]
    return [
        (case, cases.resized(setting, options.worlds, options.size), wanted)
        for setting in chosen("--setting", settings, cases.SETTINGS)
        for case in found
    ]


def left_out(options: argparse.Namespace) -> dict[str, str]:
    """Return the cases that a run leaves out for lack of packages, and the packages' names for pip."""
    from warpcam.benchmarks import peers

    lacking: dict[str, str] = {}
    if options.sweep:
        return lacking
    if not options.peer:
        lacking = {name: peers.INSTALL[name] for name in peers.PEERS if name not in peers.installed()}
    if not options.case:
        for case in all_cases().values():
            if not available(case):
                lacking[f"case {case.name}"] = "newton" if case.newton else str(case.package).replace("_", "-")
    return lacking


def all_cases() -> Mapping[str, Any]:
    from warpcam.benchmarks import cases

    return cases.CASES


def available(case: Any) -> bool:
    packages = (case.package, "newton" if case.newton else None)
    return all(package is None or importlib.util.find_spec(package) is not None for package in packages)


def chosen(option: str, names: Sequence[str], known: Mapping[str, Any]) -> list[Any]:
    for name in names:
        if name not in known:
            raise WarpcamError(f"{option}: {name!r} came, known are: {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)]
