"""Results of ``warpcam.benchmarks.training`` as a table and as curves.

python -m warpcam.benchmarks.training_table training.json --plot training.png
"""

import argparse
import json
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from warpcam.benchmarks.report import console

Row = dict[str, Any]
GROUP = ("task", "renderer", "worlds", "size", "iterations", "epochs", "encoder", "precision")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="+")
    parser.add_argument("--plot", type=Path, help="image file of the curves")
    options = parser.parse_args(arguments)
    rows = [row for path in options.results for row in json.loads(path.read_text())["results"]]
    show(rows)
    if options.plot:
        plot(rows, options.plot)


def line(row: Row) -> str:
    """One run in words."""
    numbers = [f"{_number(row['steps_per_second'], ',.0f')} steps/s", f"return {row['trained']:.1f} of {row['most']:g}"]
    numbers.append(f"90 % after {_number(row['seconds_to_90'], '.1f')} s")
    if row["success"] is not None:
        numbers.append(f"success {100.0 * row['success']:.0f} %")
    return f"{row['task']}, {row['renderer']}, seed {row['seed']}: {', '.join(numbers)}"


def show(rows: Sequence[Row]) -> None:
    """Print medians over the seeds."""
    table = Table(
        "task",
        "renderer",
        "worlds",
        "epochs",
        "encoder",
        "seeds",
        "steps/s",
        "90 % (s)",
        "steps to 90 %",
        "return",
        "success",
    )
    for group in groups(rows):
        first = group[0]
        table.add_row(
            first["task"],
            first["renderer"],
            str(first["worlds"]),
            str(first["epochs"]),
            first["encoder"],
            str(len(group)),
            _number(median(group, "steps_per_second"), ",.0f"),
            _number(median(group, "seconds_to_90"), ".1f"),
            _number(median(group, "steps_to_90"), ",.0f"),
            _number(median(group, "trained"), ".1f"),
            _number(median(group, "success"), ".2f"),
        )
    console().print(table)


def groups(rows: Sequence[Row]) -> list[list[Row]]:
    """Runs that differ in their seed alone."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(json.dumps([row[name] for name in GROUP]), []).append(row)
    return list(found.values())


def median(group: Sequence[Row], name: str) -> float | None:
    """Median over the seeds; a time that a run has not come to is longer than all others. None if it is the median."""
    values = [float("inf") if row[name] is None else row[name] for row in group]
    middle = statistics.median(values)
    return None if middle == float("inf") else middle


def plot(rows: Sequence[Row], path: Path) -> None:
    """Draw the median of the mean return over time and over steps, and all seeds beside it."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    told = [name for name in ("task", "worlds", "epochs", "encoder") if len({row[name] for row in rows}) > 1]
    figure, axes = pyplot.subplots(1, 2, figsize=(10, 4), sharey=True)
    for color, group in zip(pyplot.rcParams["axes.prop_cycle"].by_key()["color"], groups(rows), strict=False):
        first = group[0]
        name = ", ".join([first["renderer"], *(f"{setting}: {first[setting]}" for setting in told)])
        returns = [
            [np.nan if point["mean_return"] is None else point["mean_return"] for point in row["curve"]]
            for row in group
        ]
        for axis, along, scale in ((axes[0], "seconds", 1.0), (axes[1], "steps", 1e-6)):
            places = [[scale * point[along] for point in row["curve"]] for row in group]
            for x, y in zip(places, returns, strict=True):
                axis.plot(x, y, color=color, alpha=0.25, linewidth=0.8)
            axis.plot(np.median(places, axis=0), np.median(returns, axis=0), color=color, label=name)
    axes[0].set(xlabel="time [s]", ylabel="mean return of 100 episodes")
    axes[1].set(xlabel="steps [million]")
    axes[1].legend(loc="lower right")
    for axis in axes:
        axis.axhline(0.9 * rows[0]["most"], color="grey", linestyle=":", linewidth=0.8)
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def _number(value: float | None, how: str) -> str:
    return "-" if value is None else format(value, how)


if __name__ == "__main__":
    main()
