"""Command-line options of the suite. Imports nothing that has to be installed beside warpcam."""

import argparse
from pathlib import Path

from warpcam.core.errors import WarpcamError

ABOUT = "time warpcam and its peers side by side on the same scenes, and write a table, JSON and a plot"
EXAMPLES = """examples:
  warpcam bench                                        all cases, all renderers that are installed
  warpcam bench --case humanoid yam --outputs ds rgb-shadows --setting 8192x64 1x640x480
  warpcam bench --case humanoid --peer warpcam --worlds 1024 --size 128x96 --plot humanoid.png
  warpcam bench --sweep worlds --plot worlds.png       how the cost grows
  warpcam bench --host                                 Python time of a frame, seconds to the first image
  warpcam bench --gpus                                 each GPU alone, and all at the same time
  warpcam bench --scene kitchen.xml --camera front      a scene of your own (MJCF, URDF, USD)
  warpcam bench --suite tuning --part 1/4              generated scenes, and how the ratios are spread over them
  warpcam bench --merge a.json b.json --plot all.png   show and draw what was measured
"""
# What is known elsewhere by these names, so that help needs no simulator.
CASES = (
    *("primitives", "primitives_rows", "humanoid", "n_humanoid", "shapes_256", "quadruped", "room_1000", "mug", "yam"),
    *("go1", "aloha_pot", "g1_terrain", "terrain_256", "flex", "franka_cabinet"),
    *("newton_shapes_256", "newton_quadruped", "newton_franka_cabinet", "newton_cloth"),
)
PEERS = ("mujoco_warp", "warpcam", "newton", "mujoco_warp_pbr", "mujoco")
LARGE = ("16x640x480", "4x1280x720", "1x1920x1080", "16x1920x1080")
SETTINGS = ("8192x64", "4096x64", "1024x64", "1024x128", "1024x256", "1x640x480", *LARGE, "cpu")
SUITE_SETTINGS = ("1024x64", "1024x128", "1024x256")  # of --suite and --scene
SUITE_OUTPUTS = ("ds", "rgb", "rgb-shadows")
HALVES = ("tuning", "held-out", "all")  # of the generated scenes
SWEEPS = ("worlds", "pixels", "shapes", "faces", "lights", "samples")
MORE = ("smooth", "reflections", "transparency")  # of rgb: rgb-smooth, ...

# Which options each kind of run takes beside its own.
MEASURED = {"peer", "worlds", "size", "replays", "device", "threads", "cold", "seconds", "resume", "out"}
TAKEN = {
    "cases": {*MEASURED, "case", "setting", "outputs", "plot"},
    "--suite": {*MEASURED, "setting", "outputs", "part"},
    "--scene": {*MEASURED, "setting", "outputs", "camera"},
    "--sweep": {*MEASURED, "points", "plot"},
    "--host": {"case", "device", "threads", "out"},
    "--gpus": {"case", "worlds", "replays", "out"},
    "--merge": {"out", "plot"},
}


def add(parser: argparse.ArgumentParser) -> None:
    parser.description, parser.epilog = ABOUT, EXAMPLES
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    what = parser.add_argument_group("measurements")
    what.add_argument(
        "--case", nargs="+", metavar="NAME", help=f"scenes: {', '.join(CASES)} (default: all whose files are installed)"
    )
    what.add_argument(
        "--peer", nargs="+", metavar="NAME", help=f"renderers: {', '.join(PEERS)} (default: all that are installed)"
    )
    what.add_argument(
        "--setting",
        nargs="+",
        metavar="NAME",
        help=f"worlds and pixels: {', '.join(SETTINGS)} (default: the first, on a CPU the last; of --suite and --scene "
        f"{', '.join(SUITE_SETTINGS)})",
    )
    what.add_argument(
        "--outputs",
        nargs="+",
        metavar="NAME",
        help="sets of outputs: ds (depth and segmentation), rgb, rgb-shadows, rgb-ds-shadows, rgb-d-shadows, "
        f"rgb or rgb-shadows with one of -{', -'.join(MORE)}, ds+OUTPUT for any one more, or extras for all of the "
        f"latter (default: the first four; of --suite and --scene {', '.join(SUITE_OUTPUTS)})",
    )
    what.add_argument("--worlds", type=int, metavar="N", help="in place of the setting's own")
    what.add_argument("--size", metavar="WxH", help="pixels of one image, in place of the setting's own")
    what.add_argument("--points", nargs="+", type=int, metavar="N", help="of the sweep (default: all)")
    what.add_argument("--camera", metavar="NAME", help="of the scene (default: its first, or one that sees all of it)")
    what.add_argument("--part", metavar="K/N", help="one of N parts of the suite")
    how = parser.add_argument_group("how")
    how.add_argument("--replays", type=int, metavar="N", help="frames to time (default: 12 or more)")
    how.add_argument("--device", metavar="D", help="cpu, cuda:0, ... (default: the first GPU, or the CPU)")
    how.add_argument("--threads", type=int, metavar="N", help="CPU threads warpcam may use; the peers use one")
    how.add_argument("--cold", action="store_true", help="begin with empty caches, so that all kernels are compiled")
    how.add_argument("--seconds", type=float, metavar="S", help="begin no measurement later than that")
    results = parser.add_argument_group("results")
    results.add_argument("--out", type=Path, metavar="FILE.json", help="default: warpcam-bench.json")
    results.add_argument("--resume", action="store_true", help="keep what --out holds, and measure what it lacks")
    results.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the results; .svg and .pdf work, too")
    instead = parser.add_argument_group("instead of cases").add_mutually_exclusive_group()
    instead.add_argument("--suite", choices=HALVES, help="generated scenes: half of them, or all")
    instead.add_argument("--scene", type=Path, metavar="FILE", help="a scene of your own: MJCF, URDF or USD")
    instead.add_argument("--sweep", choices=SWEEPS, help="one scene, ever more of something")
    instead.add_argument("--host", action="store_true", help="what a frame and a first image cost in Python")
    instead.add_argument("--gpus", action="store_true", help="every GPU alone, and beside all others")
    instead.add_argument("--merge", nargs="+", type=Path, metavar="FILE.json", help="measure nothing: show these runs")


def check(options: argparse.Namespace) -> None:
    """Refuse options that would be passed over."""
    kind = next((name for name in TAKEN if name != "cases" and getattr(options, name[2:])), "cases")
    taken = set(TAKEN[kind])
    if kind == "--sweep":
        taken -= {"worlds": {"worlds"}, "pixels": {"size"}}.get(options.sweep, set())
        kind = f"--sweep {options.sweep}"
    for name in ("case", "peer", "setting", "outputs", "worlds", "size", "points", "replays", "device", "threads"):
        if getattr(options, name) is not None and name not in taken:
            refuse(name, kind, taken)
    for name in ("camera", "part", "seconds", "cold", "resume", "out", "plot"):
        if getattr(options, name) and name not in taken:
            refuse(name, kind, taken)


def refuse(name: str, kind: str, taken: set[str]) -> None:
    known = ", ".join(f"--{one}" for one in sorted(taken))
    what = "cases are measured" if kind == "cases" else f"{kind} was asked for"
    raise WarpcamError(f"--{name}: came where {what}, which takes {known}")
