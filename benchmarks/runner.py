"""Measures renderers on problems: one row of results for each set of outputs."""

import functools
import gc
import time
import traceback
from collections.abc import Iterable, Iterator
from typing import Any

import warp as wp

from warpcam.benchmarks import compare, measure, peers, problem
from warpcam.benchmarks.cases import Case, Wanted
from warpcam.benchmarks.problem import POSE_SETS, Problem
from warpcam.benchmarks.report import Row

# Images are compared in this many sets of poses, and in as many worlds as make this many pixels a camera.
CHECKED_SETS = 2
CHECKED_PIXELS = 2**18


def measure_case(
    case: Case,
    worlds: int,
    size: tuple[int, int],
    wanted: Iterable[Wanted],
    renderers: Iterable[str],
    device: wp.Device,
    frames: int | None,
) -> Iterator[Row]:
    """Measure each renderer with each set of outputs: a row each, as soon as it is there."""
    start = time.perf_counter()
    wanted = list(wanted)
    try:
        shared = problem.build(case, worlds, *size)
    except Exception:
        facts = {"case": case.name, "worlds": worlds, "width": size[0], "height": size[1]}
        for one in wanted:
            yield {**facts, "outputs": one.name, "renderer": "any", "error": traceback.format_exc(limit=-3)}
        return
    build_s = time.perf_counter() - start
    references: dict[str, Any] = {}
    for renderer in filter(case.seen_by, renderers):
        asked = [one for one in wanted if one.by_peers or renderer == "warpcam"]
        memory = measure.Memory(device)
        shared.place(0)
        start = time.perf_counter()
        try:
            with measure.kernel_loads() as loads:
                peer = peers.create(renderer, shared)
        except Exception:
            for one in asked:
                yield {**shared.facts(one), "renderer": renderer, "error": traceback.format_exc(limit=-4)}
            continue
        create_s, create_compile_s = time.perf_counter() - start, measure.covered(loads)
        for one in asked:
            row: Row = {**shared.facts(one), "renderer": renderer, "build_s": build_s}
            try:
                row |= measure_outputs(renderer, peer, one, shared, memory, device, frames, references)
                row["setup_s"] += create_s
                row["compile_s"] += create_compile_s
            except Exception:
                row["error"] = traceback.format_exc(limit=-4)
            yield row
        del peer
        gc.collect()


def measure_outputs(
    renderer: str,
    peer: peers.Peer,
    wanted: Wanted,
    shared: Problem,
    memory: measure.Memory,
    device: wp.Device,
    frames: int | None,
    references: dict[str, Any],
) -> Row:
    peer.release()
    gc.collect()
    memory.reset_peak()
    start = time.perf_counter()
    with measure.kernel_loads() as loads:
        peer.prepare(wanted)
        wp.synchronize_device(device)
        row: Row = {"setup_s": time.perf_counter() - start}
        # Each once before any is captured: a graph cannot hold a compilation.
        row["first_frame_s"] = measure.time_first(functools.partial(peer.frame, peer.variants[0]), device)
    row["compile_s"] = measure.covered(loads)
    for variant in peer.variants[1:]:
        peer.frame(variant)
    if peer.told_memory_mb is not None:
        row["told_memory_mb"] = peer.told_memory_mb

    def timed(variant: str, count: int | None) -> dict[str, Any]:
        return measure.time_frames(functools.partial(peer.frame, variant), peer.place, POSE_SETS, device, count)

    best = peer.variants[0]
    if len(peer.variants) > 1:  # a few frames of each tell the fastest
        few = {variant: timed(variant, POSE_SETS)["median"] for variant in peer.variants}
        best = min(peer.variants, key=lambda variant: few[variant])
        row |= {"variant": best, "variants": few}
    row["ms"] = timed(best, frames)
    row["grays_per_s"] = 1e-6 * shared.rays / row["ms"]["median"]
    row |= memory.figures()
    if peer.lacks:
        row["lacks"] = list(peer.lacks)
    if not wanted.by_peers:
        return row

    checked = max(1, min(shared.worlds, CHECKED_PIXELS // (shared.width * shared.height)))
    images = []
    for index in range(CHECKED_SETS):
        peer.place(index)
        peer.frame(best)
        # Copied: on a CPU an array may be the renderer's own memory, which the next frame overwrites.
        images.append([{name: image.copy() for name, image in one.items()} for one in peer.images(checked)])
    if wanted.name not in references:
        references[wanted.name] = (renderer, images)
        return row
    row["compared_with"], theirs = references[wanted.name]
    gaps = [compare.difference(one, other) for one, other in zip(images, theirs, strict=True)]
    row["difference"] = {key: worst(key, [gap[key] for gap in gaps]) for key in gaps[0]}
    return row


def worst(key: str, values: list[float]) -> float:
    return min(values) if key in ("hit_fraction", "rgb_psnr_db") else max(values)
