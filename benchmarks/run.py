"""Time warpcam and its peers side by side: the same scenes, poses, cameras and images (depth and ids).

python benchmarks/run.py [--case NAME ...] [--peer NAME ...] [--worlds N] [--size WxH] [--device D] [--out FILE.json]

Timed is what a new frame takes: refitting (where a renderer has something to refit) and rendering, with every
world in a pose of its own. On a GPU a frame is a replay of a CUDA graph, on a CPU a plain call. The JSON is
written again after each renderer, so an interrupted run keeps what it has.
"""

import argparse
import datetime
import functools
import gc
import importlib
import importlib.metadata
import json
import os
import platform
import re
import shlex
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
CHECKED_WORLDS = 512


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", nargs="+", default=None, metavar="NAME", help="default: all")
    parser.add_argument("--peer", nargs="+", default=None, metavar="NAME", help="default: all that are installed")
    parser.add_argument("--worlds", type=int, default=None, help="default: the case's own number for this device")
    parser.add_argument("--size", default="64x64", metavar="WxH", help="pixels of each image")
    parser.add_argument("--device", default=None, help="a Warp device; default: the first GPU, else the CPU")
    parser.add_argument("--threads", type=int, default=None, help="CPU threads warpcam may use; the peers use one")
    parser.add_argument("--replays", type=int, default=None, help="frames to time; default: 30 or more")
    parser.add_argument("--out", type=Path, default=None, help="default: benchmarks/results/<device>.json")
    return parser.parse_args()


def machine(device: Any) -> dict[str, Any]:
    """What the numbers were measured on."""
    found: dict[str, Any] = {"device": device.name, "python": platform.python_version(), "system": platform.platform()}
    cpuinfo = Path("/proc/cpuinfo")
    model = re.search(r"model name\s*:\s*(.+)", cpuinfo.read_text()) if cpuinfo.exists() else None
    found["cpu"] = f"{model[1] if model else platform.processor()} ({os.cpu_count()} cores)"
    if device.is_cuda:
        query = ["nvidia-smi", f"--id={device.uuid}", "--query-gpu=driver_version", "--format=csv,noheader"]
        try:
            found["driver"] = subprocess.run(query, capture_output=True, text=True, check=True).stdout.strip()
        except (OSError, subprocess.CalledProcessError) as error:
            found["driver"] = f"unknown: {error}"
    for package in ("warp-lang", "mujoco", "mujoco-warp", "newton", "mjlab", "torch", "numpy"):
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def measure_peer(name: str, problem: Any, device: Any, replays: int | None, reference: Any) -> tuple[dict, Any]:
    """One renderer on one problem: its row for the JSON, and its images in each pose set."""
    import measure
    from peers import PEERS
    from problem import POSE_SETS

    before = measure.memory_used(device)
    problem.set_poses(0)
    module = importlib.import_module(PEERS[name])
    start = time.perf_counter()
    peer = module.create(problem)
    row: dict[str, Any] = {"setup_s": time.perf_counter() - start}
    variants = {v: measure.time_frames(functools.partial(peer.frame, v), device, replays) for v in peer.variants}
    best = min(variants, key=lambda variant: variants[variant]["median"])
    row |= {"ms": variants[best], "grays_per_s": 1e-6 * problem.rays / variants[best]["median"]}
    if len(variants) > 1:
        row |= {"variant": best, "variants": variants}
    if device.is_cuda:
        row["memory_mb"] = (measure.memory_used(device) - before) / 1e6

    images = []
    for pose in range(POSE_SETS):
        problem.set_poses(pose)
        peer.pull_poses()
        peer.frame(best)
        # Copied: on a CPU an array may be the renderer's own memory, which the next frame overwrites.
        images.append([(d.copy(), i.copy()) for d, i in peer.images(min(problem.worlds, CHECKED_WORLDS))])
        if reference is not None:
            row.setdefault("difference", []).append(measure.difference(images[pose], reference[pose]))
    return row, images


def measure_case(name: str, args: argparse.Namespace, device: Any, report: dict[str, Any]) -> None:
    import problem as problems
    from cases import CASES

    case, (width, height) = CASES[name], (int(n) for n in args.size.split("x"))
    worlds = args.worlds or (case.worlds if device.is_cuda else case.cpu_worlds)
    entry: dict[str, Any] = {"about": case.about, "worlds": worlds, "size": [width, height], "cameras": case.cameras}
    report["cases"][name] = entry
    start = time.perf_counter()
    try:
        problem = problems.build(case, worlds, width, height)
    except Exception:
        entry["error"] = traceback.format_exc(limit=-3)
        print(f"{name}: {entry['error']}", file=sys.stderr)
        return
    entry |= {"rays": problem.rays, "geoms": len(problem.drawn_geoms()), "mesh_faces": int(problem.mjm.nmeshface)}
    entry |= {"build_s": time.perf_counter() - start, "renderers": {}}
    rows, reference = entry["renderers"], None
    for peer in args.peer:
        print(f"{name}: {peer} ...", flush=True)
        try:
            rows[peer], images = measure_peer(peer, problem, device, args.replays, reference)
            if reference is None:
                entry["reference"], reference = peer, images
        except Exception:
            rows[peer] = {"error": traceback.format_exc(limit=-4)}
            print(rows[peer]["error"], file=sys.stderr)
        gc.collect()
        if "ms" in rows.get("warpcam", {}):
            for row in (row for row in rows.values() if "ms" in row):
                row["times_warpcam"] = row["ms"]["median"] / rows["warpcam"]["ms"]["median"]
        args.out.write_text(json.dumps(report, indent=1) + "\n")


def table(report: dict[str, Any]) -> str:
    """The report for people."""
    rows = ["case renderer ms p10-p90 Grays/s x-warpcam ids-differ depth-differs set-up-s first-s".split()]
    failures = []
    for name, case in report["cases"].items():
        for peer, row in case.get("renderers", {"-": case}).items():
            if "ms" not in row:
                failures.append(f"{name}: {peer} failed: {row['error'].strip().splitlines()[-1]}")
                continue
            ms, gaps = row["ms"], row.get("difference", [])
            cells = [name, peer, f"{ms['median']:.3f}", f"{ms['p10']:.3f}-{ms['p90']:.3f}", f"{row['grays_per_s']:.3f}"]
            cells.append(f"{row['times_warpcam']:.2f}" if "times_warpcam" in row else "")
            for key in ("ids_mismatch", "depth_mismatch"):
                cells.append(f"{max(gap[key] for gap in gaps):.1e}" if gaps else "")
            rows.append([*cells, f"{row['setup_s']:.1f}", f"{ms['first_frame_s']:.1f}"])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return "\n".join(lines + failures)


def main() -> None:
    args = arguments()
    if args.threads is not None:
        os.environ["WARPCAM_CPU_THREADS"] = str(args.threads)
    if str(HERE) not in sys.path:
        sys.path.insert(0, str(HERE))
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
    wp.init()
    import measure
    from cases import CASES
    from peers import PEERS

    for given, known in ((args.case, CASES), (args.peer, PEERS)):
        unknown = set(given or ()) - set(known)
        if unknown:
            sys.exit(f"unknown: {', '.join(sorted(unknown))}; known: {', '.join(known)}")
    installed = [peer for peer in PEERS if importlib.util.find_spec(peer) is not None]
    args.peer = [peer for peer in PEERS if peer in (args.peer or installed)]
    device = wp.get_device(args.device or ("cuda:0" if wp.is_cuda_available() else "cpu"))
    if args.out is None:
        threads = "" if args.threads is None else f"-{args.threads}-thread"
        args.out = HERE / "results" / (re.sub(r"\W+", "-", device.name.lower()).strip("-") + threads + ".json")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    report: dict[str, Any] = {
        "command": "python " + shlex.join(sys.argv),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "machine": machine(device),
        "timing": "CUDA graph replays between events" if device.is_cuda else "plain calls on the CPU",
        "warpcam_cpu_threads": None if device.is_cuda else os.environ.get("WARPCAM_CPU_THREADS", "all"),
        "cases": {},
    }
    with measure.on_one_stream(device):
        for name in args.case or CASES:
            measure_case(name, args, device, report)
    print(table(report))
    print(f"written: {args.out}")


if __name__ == "__main__":
    main()
