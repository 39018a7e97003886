"""What may be asked of the suite on the command line. Imports nothing that has to be installed beside warpcam."""

import argparse
from pathlib import Path

ABOUT = "time warpcam and its peers side by side on the same scenes, and write a table, JSON and a plot"
SWEEPS = ("worlds", "pixels", "shapes", "faces", "lights")  # of sweeps.py


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--case", nargs="+", metavar="NAME", help="scenes (default: all whose files are installed)")
    parser.add_argument("--peer", nargs="+", metavar="NAME", help="renderers (default: all that are installed)")
    parser.add_argument(
        "--setting", nargs="+", metavar="NAME", help="8192x64, 1024x256 or cpu (default: the first, on a CPU the last)"
    )
    parser.add_argument(
        "--outputs",
        nargs="+",
        metavar="NAME",
        help="sets of outputs: ds (depth and segmentation), rgb, rgb-shadows, rgb-ds-shadows, ds+OUTPUT for any one "
        "more, or extras for all of the latter (default: the first four)",
    )
    parser.add_argument("--worlds", type=int, metavar="N", help="in place of the setting's own")
    parser.add_argument("--size", metavar="WxH", help="pixels of one image, in place of the setting's own")
    parser.add_argument("--replays", type=int, metavar="N", help="frames to time (default: 12 or more)")
    parser.add_argument("--device", metavar="D", help="cpu, cuda:0, ... (default: the first GPU, or the CPU)")
    parser.add_argument("--threads", type=int, metavar="N", help="CPU threads warpcam may use; the peers use one")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="default: warpcam-bench.json")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the results; .svg and .pdf work, too")
    parser.add_argument("--merge", nargs="+", type=Path, metavar="FILE.json", help="measure nothing: show these runs")
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument("--sweep", choices=SWEEPS, help="instead of cases: one scene, ever more of something")
    instead.add_argument("--host", action="store_true", help="instead of cases: what a frame costs in Python")
    parser.add_argument("--points", nargs="+", type=int, metavar="N", help="of the sweep (default: all)")
