"""Statistics of a data set as JSON, and as a page with bars."""

from collections.abc import Iterator, Sequence
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

from warpcam.datasets.generate.shards import write_json
from warpcam.datasets.generate.statistics import DEPTHS, SHARES, SIZES

STYLE = """
body { font: 14px sans-serif; max-width: 60em; margin: 2em auto; }
table { border-collapse: collapse; }
td, th { padding: 1px 8px; text-align: right; }
td.bar { width: 24em; text-align: left; }
td.bar div { background: #4682b4; height: 0.9em; }
"""


def write_statistics(out: Path, classes: Sequence[str], total: dict[str, Any]) -> None:
    """Write statistics.json and statistics.html."""
    edges = {"size_edges_px": SIZES.tolist(), "visibility_edges": SHARES.tolist(), "depth_edges_m": DEPTHS.tolist()}
    write_json(out / "statistics.json", {"classes": list(classes), **total, **edges}, indent=1)
    (out / "statistics.html").write_text(page(classes, total))


def page(classes: Sequence[str], total: dict[str, Any]) -> str:
    """The page, without files or scripts beside it."""
    seen = sum(total["instances"])
    parts = [
        f"<!doctype html><meta charset=utf-8><title>Statistics</title><style>{STYLE}</style><h1>Statistics</h1>",
        f"<p>{total['frames']:,} images, {seen:,} visible instances, {total['truncated']:,} of them at an edge.</p>",
        '<p><img src="contact_sheet.png" alt="some images with their labels" width="100%"></p>',
        "<h2>Visible instances of each class</h2>",
        *_table(classes, total["instances"]),
        "<h2>Sizes of visible boxes, root of the area [pixels]</h2>",
        *_table(_bins(SIZES), total["sizes"]),
        "<h2>Visibility: share of an instance's pixels that are visible</h2>",
        *_table(_bins(SHARES), total["visibility"]),
        "<h2>Depth of pixels [m]</h2>",
        *_table([*_bins(DEPTHS), "nothing"], [*total["depth"], total["depth_missing"]]),
    ]
    return "\n".join(parts) + "\n"


def _bins(edges: Any) -> list[str]:
    return [f"{low:.3g} to {high:.3g}" for low, high in pairwise(edges)]


def _table(names: Sequence[str], counts: Sequence[int]) -> Iterator[str]:
    most = max(1, *counts)
    yield "<table>"
    for name, count in zip(names, counts, strict=True):
        width = 100.0 * count / most
        yield (
            f"<tr><th>{escape(name)}</th><td>{count:,}</td>"
            f'<td class="bar"><div style="width: {width:.1f}%"></div></td></tr>'
        )
    yield "</table>"
