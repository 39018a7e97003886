"""A page of pictures: the judge's, ours, and what differs, side by side."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

GAP = 2  # between pictures [pixels]
STRETCH = 4  # of differences, so that they can be seen
COLORS = 192  # of a palette: the files stay small


def difference(judge: np.ndarray, image: np.ndarray) -> np.ndarray:
    """The difference of each channel, times ``STRETCH``, on black."""
    return np.minimum(STRETCH * np.abs(judge.astype(np.int16) - image.astype(np.int16)), 255).astype(np.uint8)


def beside(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Pictures of one size in a row."""
    height, width, channels = pictures[0].shape
    paper = np.full((height, len(pictures) * (width + GAP) - GAP, channels), 255, np.uint8)
    for place, picture in enumerate(pictures):
        paper[:, place * (width + GAP) : place * (width + GAP) + width] = picture
    return paper


def save(path: Path, judge: np.ndarray, image: np.ndarray) -> None:
    """The judge's picture, ours, and what differs."""
    path.parent.mkdir(parents=True, exist_ok=True)
    row = Image.fromarray(beside([judge, image, difference(judge, image)]))
    row.quantize(COLORS, dither=Image.Dither.NONE).save(path, optimize=True)


def _finer(figures: Mapping[str, float]) -> str:
    """Cells of a summary beside the judge's finer picture."""
    names = ("median_finer_psnr", "least_finer_psnr")
    return " | ".join(f"{figures[name]:.1f}" if name in figures else "-" for name in names)


def write_page(path: Path, report: Mapping[str, Any], wanted: Mapping[str, float]) -> None:
    """Write the table and the pictures as Markdown."""
    names, rows = list(report["summary"]), report["results"]
    lines = [
        "# Gallery: warpcam and mujoco.Renderer",
        "",
        f"Pictures of {len(rows)} scenes, {report['size'][0]}x{report['size'][1]}, by warpcam and by {report['judge']}."
        " Those of the package warpcam are made here and crowded with thin things; all others come with other packages."
        " To make this page:",
        "",
        "```sh",
        "pip install --no-deps dm-control gymnasium gymnasium-robotics robosuite mjlab",
        "pip install flip-evaluator",
        "python -m warpcam.benchmarks.fidelity --peer --out benchmarks/results/fidelity.json --gallery docs",
        "```",
        "",
        "PSNR is over all channels of all pixels; more is better. FLIP is the difference that eyes see when two "
        "pictures are swapped, 0 to 1; less is better. Mesa is set not to round while it filters textures "
        "(`GALLIVM_PERF`). Rays of range finders are not drawn. The picture with 16 times the samples is "
        "mujoco.Renderer's own, of four times as many pixels each way, averaged: its figures say how much the judge's "
        "few samples matter. They have the colours that their triangles would have in the middle of the pixel, even "
        "where a triangle does not reach it; the finer picture also has finer mip levels. mujoco_warp is MuJoCo-Warp's "
        "own renderer with all its features on: textures, shadows, skybox and the same number of samples per pixel.",
        "",
        "| | shots | median PSNR [dB] | least PSNR [dB] | mean FLIP | largest FLIP "
        "| median PSNR beside the judge's finer picture [dB] | least [dB] |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    crowded = {f"{name}, crowded scenes": figures for name, figures in report["crowded"].items()}
    for name, figures in {**report["summary"], **crowded}.items():
        lines.append(
            f"| {name} | {figures['shots']} | {figures['median_psnr']:.1f} | {figures['least_psnr']:.1f} "
            f"| {figures['mean_flip']:.3f} | {figures['largest_flip']:.3f} | {_finer(figures)} |"
        )
    lines.append(
        f"| wanted | 30 | {wanted['median_psnr']:.1f} | {wanted['least_psnr']:.1f} | {wanted['mean_flip']:.3f} | | | |"
    )
    lines += ["", "| shot | scene | " + " | ".join(f"{name}: PSNR [dB] | FLIP" for name in names) + " |"]
    lines += ["|---|---|" + "---:|---:|" * len(names)]
    refused: list[str] = []
    for row in sorted(rows, key=lambda row: row["warpcam"]["psnr"]):
        cells = []
        for name in names:
            one = row.get(name, {})
            cells += [f"{one['psnr']:.1f}", f"{one['flip']:.3f}"] if "psnr" in one else ["-", "-"]
            if "error" in one:
                refused.append(f"`{row['shot']}` by {name}: {one['error']}")
        where = f"{row['package']}, {row['file']}, camera {row['camera']}"
        lines.append(f"| [{row['shot']}](#{row['shot']}) | {where} | {' | '.join(cells)} |")
    if refused:
        lines += ["", "Not drawn: " + "; ".join(refused)]
    lines += ["", f"Each row shows mujoco.Renderer, warpcam, and the difference of each channel, times {STRETCH}."]
    for row in rows:
        lines += ["", f"## {row['shot']}", "", f"![{row['shot']}](images/gallery/{row['shot']}.png)"]
    path.write_text("\n".join(lines) + "\n")
