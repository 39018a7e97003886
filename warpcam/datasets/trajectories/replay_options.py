"""The command ``warpcam replay``."""

import argparse
import re
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from warpcam.core.errors import WarpcamError

ABOUT = "render the states of robomimic's or robosuite's demonstrations, and write a file with the images"


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = ABOUT
    parser.add_argument("demos", type=Path, metavar="DEMOS", help="an HDF5 file with states and models")
    parser.add_argument("--output", type=Path, required=True, metavar="FILE", help="the HDF5 file to write")
    parser.add_argument("--cameras", nargs="+", required=True, metavar="NAME", help="of the model")
    parser.add_argument("--size", default="84x84", metavar="WxH", help="of one image (default: %(default)s)")
    parser.add_argument("--depth", action="store_true", help="add depth [m]")
    parser.add_argument("--episodes", type=int, metavar="N", help="only the first ones (default: all)")
    parser.add_argument("--batch", type=int, default=64, metavar="N", help="states of one frame (default: %(default)s)")
    parser.add_argument(
        "--geom-groups", nargs="+", type=int, metavar="N", help="of geoms that are drawn (default: as the environment)"
    )
    parser.add_argument(
        "--replace-path", metavar="OLD=NEW", help="where files of the models lie here, in place of a beginning of paths"
    )
    parser.add_argument("--compression", type=int, metavar="N", help="level of gzip, 0 to 9 (default: none)")
    parser.add_argument("--append", action="store_true", help="go on with a replay that was interrupted")
    parser.add_argument("--device", metavar="D", help="cpu, cuda:0, ... (default: the first GPU, or the CPU)")


def run(options: argparse.Namespace) -> int:
    """Replay, and show progress."""
    from warpcam.datasets.trajectories.replay import replay

    size = re.fullmatch(r"(\d+)x(\d+)", options.size)
    if size is None:
        raise WarpcamError(f"--size must be WxH, like 84x84, got {options.size!r}")
    columns = (
        TextColumn("demonstrations"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as progress:
        bar = progress.add_task("replay", total=None)
        count = replay(
            options.demos, options.output, cameras=options.cameras, width=int(size[1]), height=int(size[2]),
            depth=options.depth, episodes=options.episodes, batch=options.batch, geom_groups=options.geom_groups,
            edit_model=_edit(options.replace_path), device=options.device, compression=options.compression,
            append=options.append, progress=lambda done, total: progress.update(bar, completed=done, total=total),
        )  # fmt: skip
    print(f"{count} demonstrations in {options.output}")
    return 0


def _edit(paths: str | None) -> Callable[[str], str] | None:
    if paths is None:
        return None
    old, equals, new = paths.partition("=")
    if not old or not equals:
        raise WarpcamError(f"--replace-path must be OLD=NEW, got {paths!r}")
    return lambda xml: xml.replace(f'"{old}', f'"{new}')
