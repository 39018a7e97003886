"""Measures renderers on problems: one row of results for each set of outputs."""

import functools
import gc
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import warp as wp

from warpcam.benchmarks import compare, measure, peers, problem
from warpcam.benchmarks.cases import Case, Setting, Wanted
from warpcam.benchmarks.problem import POSE_SETS, Problem
from warpcam.benchmarks.report import Row

# Images are compared in this many sets of poses, and in as many worlds as make this many pixels a camera.
CHECKED_SETS = 2
CHECKED_PIXELS = 2**18


def measure_case(
    case: Case,
    settings: Sequence[Setting],
    wanted: Iterable[Wanted],
    renderers: Iterable[str],
    device: wp.Device,
    frames: int | None,
    is_measured: Callable[[Row], bool] = lambda row: False,
) -> Iterator[Row]:
    """Measure each renderer in settings that have the same number of worlds, with each set of outputs.

    Yields a row each, as soon as it is there, but for those that `is_measured` says are there already.
    """
    worlds = settings[0].worlds_of(case)
    tasks = {
        renderer: asked
        for renderer in filter(case.seen_by, renderers)
        if (asked := [
            (setting, one)
            for setting in settings
            for one in wanted
            if peers.draws(renderer, one, worlds, setting)
            and not is_measured({**basics(case, worlds, setting, one), "renderer": renderer})
        ])
    }  # fmt: skip
    if not tasks:
        return
    start = time.perf_counter()
    try:
        shared = problem.build(case, worlds, settings[0].width, settings[0].height)
    except Exception:
        for setting, one in dict.fromkeys(task for asked in tasks.values() for task in asked):
            facts = basics(case, worlds, setting, one)
            yield {**facts, "renderer": "any", "error": traceback.format_exc(limit=-3)}
        return
    build_s = time.perf_counter() - start
    references: dict[tuple[str, str], Any] = {}
    for renderer, asked in tasks.items():
        memory = measure.Memory(device)
        shared.place(0)
        start = time.perf_counter()
        try:
            with measure.kernel_loads() as loads:
                peer = peers.create(renderer, shared)
        except Exception:
            for setting, one in asked:
                shared.resize(setting.width, setting.height)
                facts = {**shared.facts(one), "setting": setting.name, "renderer": renderer}
                yield {**facts, "error": traceback.format_exc(limit=-4)}
            continue
        create_s, create_compile_s = time.perf_counter() - start, measure.covered(loads)
        for setting, one in asked:
            shared.resize(setting.width, setting.height)
            row: Row = {**shared.facts(one), "setting": setting.name, "renderer": renderer, "build_s": build_s}
            try:
                reference = references.setdefault((setting.name, one.name), {})
                row |= measure_outputs(renderer, peer, one, shared, memory, device, frames, reference)
                row["setup_s"] += create_s
                row["compile_s"] += create_compile_s
            except Exception:
                row["error"] = traceback.format_exc(limit=-4)
            yield row
        del peer
        gc.collect()


def basics(case: Case, worlds: int, setting: Setting, wanted: Wanted) -> Row:
    """Return what tells a measurement from others, but for the renderer."""
    facts = {"case": case.name, "setting": setting.name, "worlds": worlds, "outputs": wanted.name}
    return {**facts, "width": setting.width, "height": setting.height}


def measure_outputs(
    renderer: str,
    peer: peers.Peer,
    wanted: Wanted,
    shared: Problem,
    memory: measure.Memory,
    device: wp.Device,
    frames: int | None,
    reference: dict[str, Any],
) -> Row:
    """Measure one set of outputs; images are compared with those of `reference`, which the first renderer fills."""
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
        frame = functools.partial(peer.frame, variant)
        return measure.time_frames(frame, peer.place, POSE_SETS, device, count, peer.on_host)

    best = peer.variants[0]
    if len(peer.variants) > 1:  # a few frames of each tell the fastest
        few = {variant: timed(variant, POSE_SETS)["median"] for variant in peer.variants}
        best = min(peer.variants, key=lambda variant: few[variant])
        row |= {"variant": best, "variants": few}
    row["ms"] = timed(best, frames)
    row["grays_per_s"] = 1e-6 * shared.rays / row["ms"]["median"]
    if not peer.on_host:  # else it is memory of another library's
        row |= memory.figures()
    if peer.lacks:
        row["lacks"] = list(peer.lacks)
    if not peers.COMPARED.issuperset(wanted.outputs):
        return row

    checked = max(1, min(shared.worlds, CHECKED_PIXELS // (shared.width * shared.height)))
    images = []
    for index in range(CHECKED_SETS):
        peer.place(index)
        peer.frame(best)
        # Copied: on a CPU an array may be the renderer's own memory, which the next frame overwrites.
        images.append([{name: image.copy() for name, image in one.items()} for one in peer.images(checked)])
    if not reference:
        reference |= {"renderer": renderer, "images": images}
        return row
    row["compared_with"], theirs = reference["renderer"], reference["images"]
    gaps = [compare.difference(one, other) for one, other in zip(images, theirs, strict=True)]
    row["difference"] = {key: worst(key, [gap[key] for gap in gaps]) for key in gaps[0]}
    return row


def worst(key: str, values: list[float]) -> float:
    return min(values) if key in ("hit_fraction", "rgb_psnr_db") else max(values)
