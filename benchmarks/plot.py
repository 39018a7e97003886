"""Pictures of results: how many times longer the best peer takes, or how a sweep's cost grows."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from warpcam.benchmarks.cases import CASES
from warpcam.benchmarks.options import SWEEPS
from warpcam.benchmarks.report import OURS, Report, Row
from warpcam.core.errors import WarpcamError

COLORS = ("#2b6cb0", "#dd8452", "#55a868", "#8172b3", "#937860", "#c44e52", "#64b5cd")
MARKS = {"warpcam": "o-", "mujoco_warp": "s--", "newton": "^--", "mujoco_warp_pbr": "v--", "mujoco": "d--"}


def draw(report: Report, path: Path) -> None:
    """Draw the report in the format its file's name ends in."""
    makers = {"cases": draw_cases, "sweep": draw_sweep}
    if report["kind"] not in makers:
        raise WarpcamError(f"--plot: there is no picture of kind {report['kind']}")
    figure = makers[report["kind"]]([row for row in report["results"] if "ms" in row])
    machine = report["runs"][0]["machine"]
    peers = ("mujoco-warp", "newton", "mujoco-warp-pbr")
    versions = ", ".join(f"{name} {machine[name]}" for name in peers if name in machine)
    figure.supxlabel(f"{machine['device']}; {versions}", x=0.99, ha="right", fontsize=7, color="#666666")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise WarpcamError(f"--plot: {str(path)!r} cannot be written: {error}") from None


def draw_cases(rows: list[Row]) -> Figure:
    """A panel for each number of pixels: bars of the best peer's time over ours, by case and set of outputs."""
    rows = [row for row in rows if "best_peer" in row and row["case"] in CASES]
    if not rows:
        raise WarpcamError("--plot: no result has both warpcam and a peer")
    settings = list(dict.fromkeys(row["setting"] for row in rows))
    figure = Figure(figsize=(11.0, 0.6 + 3.4 * len(settings)), layout="constrained")
    for axes, setting in zip(np.atleast_1d(figure.subplots(len(settings))), settings, strict=True):
        draw_ratios(axes, setting, [row for row in rows if row["setting"] == setting])
    return figure


def draw_ratios(axes: Axes, setting: str, rows: list[Row]) -> None:
    measured = {row["case"] for row in rows}
    cases = [name for name in CASES if name in measured]
    outputs = list(dict.fromkeys(row["outputs"] for row in rows))
    width = 0.8 / len(outputs)
    for index, name in enumerate(outputs):
        chosen = [row for row in rows if row["outputs"] == name]
        places = [cases.index(row["case"]) + (index + 0.5) * width - 0.4 for row in chosen]
        ratios = [row["best_peer"]["ratio"] for row in chosen]
        bars = axes.bar(places, ratios, width * 0.92, label=name, color=COLORS[index % len(COLORS)])
        axes.bar_label(bars, [f"{ratio:.0f}" if ratio >= 9.5 else f"{ratio:.1f}" for ratio in ratios], fontsize=6)
    for ratio, style in ((1.0, "-"), (3.0, ":"), (10.0, ":")):
        axes.axhline(ratio, color="#444444", linewidth=0.7, linestyle=style, zorder=0)
    axes.set_yscale("log")
    axes.set_yticks([1, 3, 10, 30, 100], ["1x", "3x", "10x", "30x", "100x"])
    axes.set_xticks(range(len(cases)), cases, rotation=20, ha="right", fontsize=8)
    axes.set_ylabel("best peer's time / warpcam's")
    worlds, pixels = max(row["worlds"] for row in rows), f"{rows[0]['width']}x{rows[0]['height']}"
    number = "1 world" if worlds == 1 else f"{worlds} worlds"
    axes.set_title(f"{number}, {pixels}" if setting != "cpu" else f"CPU, {pixels}", fontsize=9, loc="left")
    axes.legend(fontsize=7, ncols=len(outputs), frameon=False, loc="upper right")
    axes.margins(x=0.01, y=0.2)
    axes.set_ylim(bottom=min([0.8, *(0.8 * row["best_peer"]["ratio"] for row in rows)]))


def draw_sweep(rows: list[Row]) -> Figure:
    """A panel for each sweep: milliseconds a frame against what there is ever more of."""
    if not rows:
        raise WarpcamError("--plot: the sweep has no results")
    sweeps = [name for name in SWEEPS if any(row["sweep"] == name for row in rows)]
    across = min(3, len(sweeps))
    down = -(-len(sweeps) // across)
    figure = Figure(figsize=(4.4 * across, 0.2 + 3.5 * down), layout="constrained")
    panels = np.ravel(figure.subplots(down, across))
    for axes, sweep in zip(panels, sweeps, strict=False):
        draw_growth(axes, sweep, [row for row in rows if row["sweep"] == sweep])
    for axes in panels[len(sweeps) :]:
        axes.set_axis_off()
    return figure


def draw_growth(axes: Axes, sweep: str, rows: list[Row]) -> None:
    lines: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        lines.setdefault((row["renderer"], row["outputs"]), []).append(row)
    outputs = list(dict.fromkeys(name for _, name in lines))
    for (renderer, name), line in lines.items():
        line.sort(key=lambda row: row["x"])
        x = np.array([row["x"] for row in line], dtype=float)
        look: dict[str, Any] = {"markersize": 4, "color": COLORS[outputs.index(name) % len(COLORS)]}
        axes.plot(x, [row["ms"]["median"] for row in line], MARKS[renderer], label=f"{renderer} {name}", **look)
        if renderer == OURS:  # what cost in proportion to the work would be, from the last point back
            work = (x / x[-1]) ** (2.0 if sweep == "pixels" else 1.0)
            axes.plot(x, line[-1]["ms"]["median"] * work, ":", color="#999999", linewidth=0.8)
    axes.set_ylim(bottom=0.4 * min(row["ms"]["median"] for row in rows))
    axes.set_xscale("log")
    axes.set_yscale("log")
    points = sorted({row["x"] for row in rows})
    axes.set_xticks(points, [f"{x:,}" for x in points], fontsize=7, rotation=40, ha="right", rotation_mode="anchor")
    axes.minorticks_off()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    first = rows[0]
    beside = [] if sweep == "worlds" else [f"{first['worlds']} worlds"]
    beside += [] if sweep == "pixels" else [f"{first['width']}x{first['height']}"]
    axes.set_title(", ".join(beside), fontsize=9, loc="left")
    axes.set_xlabel("pixels a side" if sweep == "pixels" else sweep)
    axes.set_ylabel("ms a frame")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, frameon=False)
