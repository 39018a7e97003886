"""Ratios to the best peer over many scenes, and how they are spread."""

from dataclasses import dataclass

import numpy as np
from rich import box
from rich.table import Table

from warpcam.benchmarks.report import OURS, Report, Row, by_problem, console, show_failures


@dataclass(frozen=True)
class Spread:
    """Ratios of one set of outputs at one size.

    Attributes:
        scenes: How many scenes both warpcam and a peer have drawn.
        least: The least ratio, and the scene that has it.
        low: Ratio that a tenth of the scenes stays below.
        mean: Geometric mean.
        best: How often each peer is the best.
        unranked: Scenes that only warpcam, or only peers, have drawn.
        failed: How often each renderer has failed.
    """

    scenes: int
    least: tuple[float, str]
    low: float
    median: float
    mean: float
    best: dict[str, int]
    unranked: list[str]
    failed: dict[str, int]


def spreads(rows: list[Row]) -> dict[tuple[str, int, int, int], Spread]:
    """Spread of each set of outputs, number of worlds, width and height."""
    groups: dict[tuple[str, int, int, int], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["outputs"], row["worlds"], row["width"], row["height"]), []).append(row)
    return {name: spread(group) for name, group in groups.items()}


def spread(rows: list[Row]) -> Spread:
    ranked = [row for row in rows if "best_peer" in row]
    ratios = np.array([row["best_peer"]["ratio"] for row in ranked])
    scenes = dict.fromkeys(row["case"] for row in rows)
    unranked = [name for name in scenes if name not in {row["case"] for row in ranked}]
    best = [row["best_peer"]["renderer"] for row in ranked]
    failed = [row["renderer"] for row in rows if "error" in row]
    if not len(ratios):
        return Spread(0, (np.nan, ""), np.nan, np.nan, np.nan, {}, unranked, counts(failed))
    least = int(np.argmin(ratios))
    return Spread(
        scenes=len(ratios),
        least=(float(ratios[least]), ranked[least]["case"]),
        low=float(np.percentile(ratios, 10.0)),
        median=float(np.median(ratios)),
        mean=float(np.exp(np.log(ratios).mean())),
        best=counts(best),
        unranked=unranked,
        failed=counts(failed),
    )


def counts(names: list[str]) -> dict[str, int]:
    return {name: names.count(name) for name in dict.fromkeys(names)}


def show(report: Report) -> None:
    """Print a line for each scene and set of outputs, then how the ratios are spread."""
    screen = console()
    rows = report["results"]
    renderers = list(dict.fromkeys(row["renderer"] for row in rows if row["renderer"] != "any"))
    table = Table("case", "shapes", "worlds", "size", "outputs", *renderers, "ratio", "ids", box=box.HORIZONTALS)
    for same in by_problem(rows).values():
        table.add_row(*line(same, renderers))
    screen.print(table)
    screen.print(
        "Renderers: ms a frame. ratio: the best peer's time over warpcam's. ids: largest fraction of pixels whose ids "
        "differ from the first renderer's.",
        style="dim",
    )
    columns = ["outputs", "worlds", "size", "scenes", "least", "of", "10 %", "median", "geometric mean", "best peer"]
    table = Table(*columns, "failed", "without a ratio", box=box.HORIZONTALS)
    for (outputs, worlds, width, height), found in spreads(rows).items():
        table.add_row(
            *(outputs, str(worlds), f"{width}x{height}", str(found.scenes), f"{found.least[0]:.2f}", found.least[1]),
            *(f"{value:.2f}" for value in (found.low, found.median, found.mean)),
            listed(found.best),
            listed(found.failed),
            ", ".join(found.unranked),
        )
    screen.print(table)
    kernels = sum(row.get("compile_s", 0.0) for row in rows)
    screen.print(f"Kernels were compiled or read from the cache in {kernels:.0f} s.", style="dim")
    show_failures(screen, report)


def listed(numbers: dict[str, int]) -> str:
    return ", ".join(f"{name} {number}" for name, number in numbers.items())


def line(same: list[Row], renderers: list[str]) -> list[str]:
    by_name = {row["renderer"]: row for row in same}
    any_row, ours = same[0], by_name.get(OURS, {})
    times = []
    for name in renderers:
        row = by_name.get(name, by_name.get("any"))
        times.append("" if row is None else f"{row['ms']['median']:.3f}" if "ms" in row else "failed")
    gaps = [row["difference"]["ids_mismatch"] for row in same if "ids_mismatch" in row.get("difference", {})]
    start = [any_row["case"], str(any_row.get("geoms", "")), str(any_row["worlds"])]
    start += [f"{any_row['width']}x{any_row['height']}", any_row["outputs"]]
    ratio = f"{ours['best_peer']['ratio']:.2f}x" if "best_peer" in ours else ""
    return [*start, *times, ratio, f"{max(gaps):.1e}" if gaps else ""]
