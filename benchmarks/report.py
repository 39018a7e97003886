"""Results: how they are kept as JSON, brought together from several runs, and shown as a table.

A report is {"format": 1, "kind": "cases" | "suite" | "sweep" | "host" | "gpus", "runs": [...], "results": [...]}: a run
says with what command, when and on what it was measured, a result is one renderer on one problem with one set of
outputs.
"""

import datetime
import json
import shlex
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import warp as wp
from rich import box
from rich.console import Console
from rich.table import Table

from warpcam.benchmarks import machine
from warpcam.benchmarks.options import MORE
from warpcam.core.errors import WarpcamError

FORMAT = 1
Row = dict[str, Any]
Report = dict[str, Any]
# What makes a result the same measurement as another, of which the later one counts.
PROBLEM = ("case", "setting", "worlds", "width", "height", "outputs", "sweep", "x")
OURS = "warpcam"


def new(kind: str, device: wp.Device, **more: Any) -> Report:
    run = {
        "command": shlex.join(["warpcam", "bench", *arguments(sys.argv)]),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "machine": machine.describe(device),
        **more,
    }
    return {"format": FORMAT, "kind": kind, "runs": [run], "results": []}


def arguments(argv: Sequence[str]) -> list[str]:
    """Return the arguments after the command, whichever way it was called."""
    return list(argv[2:] if argv[1:2] == ["bench"] else argv[1:])


def write(report: Report, path: Path) -> None:
    """Write a report in one piece: whoever ends the run meanwhile finds the one before."""
    rank(report["results"])
    new = path.with_name(f"{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new.write_text(json.dumps(report, indent=1) + "\n")
        new.replace(path)
    except OSError as error:
        raise WarpcamError(f"--out: {str(path)!r} cannot be written: {error.strerror}") from None


def merge(paths: Iterable[Path]) -> Report:
    """One report of several of a kind; where two have measured the same, the one named later counts."""
    merged: Report = {}
    for path in paths:
        report = read("--merge", path)
        if not merged:
            merged = report
            continue
        if report["kind"] != merged["kind"]:
            raise WarpcamError(f"--merge: {str(path)!r} is of kind {report['kind']}, those before of {merged['kind']}")
        merged["runs"] += report["runs"]
        merged["results"] += report["results"]
    latest = {key(row): row for row in merged["results"]}
    merged["results"] = list(latest.values())
    rank(merged["results"])
    return merged


def read(option: str, path: Path) -> Report:
    try:
        report: Report = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise WarpcamError(f"{option}: {str(path)!r} cannot be read: {error}") from None
    if not isinstance(report, dict) or report.get("format") != FORMAT:
        raise WarpcamError(f"{option}: {str(path)!r} is not a report of this suite")
    return report


def continued(path: Path, report: Report) -> Report:
    """Return the report at a path as one that a run goes on with: without what failed, which is tried again."""
    earlier = read("--resume", path)
    if earlier["kind"] != report["kind"]:
        raise WarpcamError(f"--resume: {str(path)!r} is of kind {earlier['kind']}, this run of {report['kind']}")
    results = [row for row in earlier["results"] if "error" not in row]
    return {**report, "runs": earlier["runs"] + report["runs"], "results": results}


def measured(report: Report) -> set[tuple[Any, ...]]:
    return {key(row) for row in report["results"] if "error" not in row}


def key(row: Row) -> tuple[Any, ...]:
    return (*problem(row), row["renderer"])


def problem(row: Row) -> tuple[Any, ...]:
    return tuple(row.get(key) for key in PROBLEM)


def rank(rows: list[Row]) -> None:
    """Say how many times longer the peers took, the best of them, which failed, and what one more output costs."""
    problems = by_problem(rows)
    for same in problems.values():
        timed = [row for row in same if "median" in row.get("ms", ())]
        peers = [row for row in timed if row["renderer"] != OURS]
        failed = [row["renderer"] for row in same if "error" in row and row["renderer"] != OURS]
        for ours in (row for row in timed if row["renderer"] == OURS):
            for row in peers:
                row["times_warpcam"] = row["ms"]["median"] / ours["ms"]["median"]
            for name in ("best_peer", "failed_peers"):
                ours.pop(name, None)
            if peers:
                best = min(peers, key=lambda row: row["ms"]["median"])
                ours["best_peer"] = {"renderer": best["renderer"], "ratio": best["times_warpcam"]}
            if failed:
                ours["failed_peers"] = failed
            base, name = without_more(ours["outputs"])
            for row in problems.get(problem({**ours, "outputs": base}), ()):
                if row["renderer"] == OURS and "median" in row.get("ms", ()):
                    ours[name] = ours["ms"]["median"] / row["ms"]["median"]


def by_problem(rows: list[Row]) -> dict[tuple[Any, ...], list[Row]]:
    problems: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        problems.setdefault(problem(row), []).append(row)
    return problems


def without_more(outputs: str) -> tuple[str | None, str]:
    """The set of outputs that another is compared with, if any, and how a result tells the ratio."""
    if outputs.startswith("ds+"):
        return "ds", "times_ds"
    plain, _, more = outputs.rpartition("-")
    return (plain if more in MORE else None), "times_plain"


def console() -> Console:
    """Return a console as wide as the table needs if the output is not a terminal."""
    terminal = Console()
    return terminal if terminal.is_terminal else Console(width=200)


def show(report: Report) -> None:
    columns = ["case", "worlds", "size", "outputs", "renderer", "ms", "p10 - p90", "G rays/s", "ratio", "ids", "depth"]
    columns += ["rgb", "PSNR", "set-up + first (s)", "of it kernels", "peak MB"]
    table = Table(*columns, box=box.HORIZONTALS, header_style="bold")
    for rows in by_problem(report["results"]).values():
        for row in rows:
            table.add_row(*cells(row))
        table.add_section()
    screen = console()
    screen.print(table)
    screen.print(
        "ratio: how many times longer than warpcam (what one more output costs, of ds; smooth edges and the like, of "
        "none). ids, depth: fraction of pixels that differ from the first renderer's; rgb: mean difference of 255, "
        "PSNR in dB.",
        style="dim",
    )
    show_failures(screen, report)


def show_failures(screen: Console, report: Report) -> None:
    for row in report["results"]:
        if "error" in row:
            line = row["error"].strip().splitlines()[-1]
            screen.print(f"failed: {name_of(row)}: {row['renderer']}: {line}", style="red", markup=False)


def name_of(row: Row) -> str:
    return f"{row['case']} {row['worlds']} x {row['width']}x{row['height']} {row['outputs']}"


def cells(row: Row) -> list[str]:
    start = [row["case"], str(row["worlds"]), f"{row['width']}x{row['height']}", row["outputs"], row["renderer"]]
    if "ms" not in row:
        return [*start, "failed"]
    ms, gap = row["ms"], row.get("difference", {})
    ratio = ""
    if "times_ds" in row:
        ratio = f"{row['times_ds']:.2f} of ds"
    elif "times_plain" in row:
        ratio = f"{row['times_plain']:.2f} of none"
    elif "times_warpcam" in row:
        ratio = f"{row['times_warpcam']:.2f}x"
    return [
        *start,
        f"{ms['median']:.3f}",
        f"{ms['p10']:.3f} - {ms['p90']:.3f}",
        f"{row['grays_per_s']:.3f}",
        ratio,
        *(f"{gap[key]:.1e}" if key in gap else "" for key in ("ids_mismatch", "depth_mismatch")),
        *(f"{gap[key]:.1f}" if key in gap else "" for key in ("rgb_mean_difference", "rgb_psnr_db")),
        f"{row['setup_s'] + row['first_frame_s']:.1f}",
        f"{row['compile_s']:.1f}" if "compile_s" in row else "",
        f"{row['peak_memory_mb']:.0f}" if "peak_memory_mb" in row else "",
    ]
